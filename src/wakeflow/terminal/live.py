"""The live line of a run."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["live"]

PLAIN_EVERY = 10.0  # s between lines when the output is not a terminal


@contextmanager
def live(*, enabled: bool) -> Iterator[Callable[[str, str], None]]:
    """A listener (stage, text): a line a thread kept up to date on a terminal, a line now and then elsewhere."""
    from rich.console import Console

    console = Console(stderr=True)
    if not enabled:
        yield lambda *_told: None
    elif console.is_terminal:
        with console.status("starting", spinner="dots") as status:
            now: dict[int, str] = {}  # what each thread is doing

            def update(stage: str, text: str) -> None:
                now[threading.get_ident()] = f"[bold]{stage}[/]  {text}"
                if text.startswith("done"):
                    console.print(f"[green]✓[/] {stage}  [dim]{text.removeprefix('done').strip()}[/]")
                    del now[threading.get_ident()]
                status.update("\n".join(now.values()))

            yield update
    else:
        last: dict[str, float] = {}

        def plain(stage: str, text: str) -> None:
            now = time.monotonic()
            if text.startswith("done") or now - last.get(stage, -PLAIN_EVERY) >= PLAIN_EVERY:
                last[stage] = now
                console.print(f"{stage}: {text}", highlight=False, markup=False, soft_wrap=True)

        yield plain
