"""The live lines of a run: one bar for the whole of it on a terminal, lines now and then elsewhere."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..core.process import cores
from ..core.store import cache_root
from ..planning.machine_rates import on_this_machine
from .pace import DONE, FROM_CACHE, RunProgress

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.live import Live

    from ..planning.plan import Plan

PLAIN_EVERY = 10.0  # s between lines of a stage when the output is not a terminal
BAR = 24  # letters


@dataclass
class Told:
    """A listener (stage, text) that tells nobody; of a run that says what it plans it knows how far it is."""

    progress: RunProgress = field(default_factory=RunProgress)

    def planned(self, plan: Plan) -> None:
        """Hear what a run will do, before it does it."""
        self.progress.begin(on_this_machine(plan, cache_root())[0], cores())

    def __call__(self, stage: str, text: str) -> None:
        self.progress.hear(stage, text)
        self.tell(stage, text)

    def tell(self, stage: str, text: str) -> None:
        """Show what was heard."""


@dataclass
class _OnTerminal(Told):
    """A bar with a line below it for each thread, and a line above it for each stage that is computed."""

    console: Console = field(kw_only=True)
    now: dict[int, tuple[str, str]] = field(default_factory=dict)  # what each thread is doing

    def tell(self, stage: str, text: str) -> None:
        if not text.startswith(DONE):
            self.now[threading.get_ident()] = stage, text
            return
        self.now.pop(threading.get_ident(), None)
        if not text.startswith(FROM_CACHE):
            self.console.print(f"[green]✓[/] {stage}  [dim]{text.removeprefix(DONE).strip()}[/]", highlight=False)

    def __rich__(self) -> RenderableType:
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        lines: list[RenderableType] = [
            Text.assemble((stage, "bold"), f"  {text}") for stage, text in list(self.now.values())
        ]
        if told := str(self.progress):
            grid = Table.grid(padding=(0, 1))
            grid.add_row(ProgressBar(total=1.0, completed=self.progress.part, width=BAR), told)
            lines.insert(0, grid)
        return Group(*lines)


@dataclass
class _InLines(Told):
    """A line of a stage now and then, and at its end; as text, or each a JSON object."""

    console: Console = field(kw_only=True)
    as_json: bool = False
    last: dict[str, float] = field(default_factory=dict)  # when a stage was told

    def tell(self, stage: str, text: str) -> None:
        now = time.monotonic()
        if not text.startswith(DONE) and now - self.last.get(stage, -PLAIN_EVERY) < PLAIN_EVERY:
            return
        if text.startswith(FROM_CACHE) and stage in self.last:
            return  # it is read again and again; once is news
        self.last[stage] = now
        self.console.print(self._line(stage, text), highlight=False, markup=False, soft_wrap=True)

    def _line(self, stage: str, text: str) -> str:
        if not self.as_json:
            told = "" if text.startswith(DONE) else str(self.progress)
            return f"{stage}: {text}" + (f" ({told})" if told else "")
        progress, left = self.progress, self.progress.left
        seconds_left = None if left is None else round(left, 1)
        known = {"stage": stage, "text": text, "number": progress.number, "of": len(progress.expected)}
        return json.dumps({**known, "seconds_left": seconds_left})


@contextmanager
def live(*, enabled: bool, as_json: bool = False) -> Iterator[Told]:
    """A listener of a run: on a terminal a bar for the whole of it, elsewhere a line now and then, both on stderr; with
    ``as_json`` such lines are JSON objects: stage, text, number, of, seconds_left. Not ``enabled``: silent.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not enabled:
        yield Told()
    elif console.is_terminal and not as_json:
        told = _OnTerminal(console=console)
        with _shown(told, console):
            yield told
    else:
        yield _InLines(console=console, as_json=as_json)


def _shown(told: _OnTerminal, console: Console) -> Live:
    from rich.live import Live

    return Live(get_renderable=told.__rich__, console=console, transient=True, refresh_per_second=4)
