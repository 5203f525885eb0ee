"""Progress below the cell of a notebook: one bar for the whole of a run, and what it is at."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from typing import Any

from ..pipeline.cache import Listener, silent
from ..planning.plan import Plan
from .live import Told
from .pace import DONE, FROM_CACHE

EVERY = 0.5  # s between pictures of the bar
Planned = Callable[[Plan], object]


def heard(listener: Listener | None, planned: Planned | None = None) -> tuple[Listener, Planned]:
    """A caller's ``listener`` and what hears of the plan. Without a listener: a bar below the cell of a notebook, and
    silence elsewhere.
    """
    if listener is None and _in_notebook():
        told = _InNotebook()
        return told, planned or told.planned
    return listener or silent, planned or unheard


def unheard(plan: Plan) -> None:
    """Nobody asks what will be done."""


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


@dataclass
class _InNotebook(Told):
    """A bar, what each thread is at, and the stages that were computed; drawn over itself."""

    now: dict[int, str] = field(default_factory=dict)
    finished: list[str] = field(default_factory=list)
    drawn: float = 0.0
    cell: Any = None  # IPython's handle of what is displayed, from the first word on

    def tell(self, stage: str, text: str) -> None:
        line = f"{stage}: {text}"
        if not text.startswith(DONE):
            self.now[threading.get_ident()] = line
        else:
            self.now.pop(threading.get_ident(), None)
            if not text.startswith(FROM_CACHE):
                self.finished.append(line)
        if text.startswith(DONE) or time.monotonic() - self.drawn >= EVERY:
            self.drawn = time.monotonic()
            self._draw()

    def _draw(self) -> None:
        display = import_module("IPython.display")
        shown = display.HTML(self._html())
        if self.cell is None:
            self.cell = display.display(shown, display_id=True)
        else:
            self.cell.update(shown)

    def _html(self) -> str:
        told = str(self.progress)
        bar = f'<progress max="1" value="{self.progress.part:.3f}"></progress> {escape(told)}<br>' if told else ""
        lines = [*(f"✓ {line}" for line in self.finished), *self.now.values()]
        return bar + "<br>".join(f"<small>{escape(line)}</small>" for line in lines)
