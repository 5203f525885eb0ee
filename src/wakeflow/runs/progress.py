"""How far a run is, and who hears of it: a terminal, a log, the cell of a notebook."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ..core.process import cores
from ..core.quantities import duration
from ..core.store import cache_root
from ..flight.stages.machine_rates import on_this_machine as on_this_machine  # handed on
from ..planning.cost import wall_seconds
from ..planning.plan import Plan
from ..planning.stage_cache import Listener, null_listener
from ..planning.stages import StageCost

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.live import Live


DONE, FROM_CACHE = "done", "done (from the cache)"  # how the text of a stage begins that is done
TRUSTED = 20.0  # s: until about as much of a kind of work is done its expected time is trusted more than its pace
GROWS = 1.25  # times the one reported before: the time left never grows by more
OVERDUE = 0.95  # of a stage's expected time: no more counts as done before the stage says so


@dataclass
class RunProgress:
    """The stages that are expected, and what was heard of them since ``started`` (s, of the ``clock``)."""

    expected: Sequence[StageCost] = ()
    cores: int = 2
    clock: Callable[[], float] = time.monotonic
    started: float = 0.0
    done: Counter[str] = field(default_factory=Counter)  # by stage: how often it is done
    under_way: dict[str, float] = field(default_factory=dict)  # by stage: since when
    took: dict[str, float] = field(default_factory=dict)  # by stage: s, each time it was done now
    cached: set[str] = field(default_factory=set)  # stages that came from the cache
    least: float = math.inf  # s: the shortest time left that was reported

    def begin(self, expected: Sequence[StageCost], cores: int) -> None:
        """Start anew, with these stages."""
        self.expected, self.cores, self.started, self.least = expected, cores, self.clock(), math.inf
        for known in (self.done, self.under_way, self.took):
            known.clear()

    def hear(self, stage: str, text: str) -> None:
        """Take note of what a listener hears."""
        if text.startswith(FROM_CACHE):
            self.cached.add(stage)
        if text.startswith(FROM_CACHE) and not self.done[stage]:  # what costs nothing now says nothing of the pace
            self.expected = [cost for cost in self.expected if cost.name != stage]
        elif text.startswith(DONE):
            began = self.under_way.pop(stage, None)
            if began is not None and not text.startswith(FROM_CACHE):
                self.took[stage] = self.took.get(stage, 0.0) + self.clock() - began
            self.done[stage] += not text.startswith(FROM_CACHE)
        else:
            self.under_way.setdefault(stage, self.clock())

    @property
    def number(self) -> int:
        """The place of the stage that is under way among the expected ones, counted from one."""
        return min(len(self.expected), 1 + sum(self.done[cost.name] >= cost.times for cost in self.expected))

    @property
    def part(self) -> float:
        """What part of the expected time has been worked off."""
        whole = wall_seconds(self.expected, self.cores)
        return 1.0 - wall_seconds(self._ahead(), self.cores) / whole if self.expected else 0.0

    @property
    def left(self) -> float | None:
        """Seconds until the end, each kind of work at its own pace so far: a solver that takes twice as long as was
        expected says nothing of flights. None where nothing is known of what is to come.
        """
        if not self.expected:
            return None
        paces = self._paces()
        ahead = [replace(cost, seconds=cost.seconds * paces[cost.key.stage.work]) for cost in self._ahead()]
        return wall_seconds(ahead, self.cores)

    def _paces(self) -> dict[str, float]:
        """Seconds that stages take over those expected of them, by kind of work."""
        sums = {cost.key.stage.work: [TRUSTED, TRUSTED] for cost in self.expected}
        for cost, taken, expected in self._seen():
            both = sums[cost.key.stage.work]
            both[0], both[1] = both[0] + taken, both[1] + expected
        return {kind: taken / expected for kind, (taken, expected) in sums.items()}

    def _seen(self) -> Iterator[tuple[StageCost, float, float]]:
        """Stages that are done or overdue, with the seconds that they took so far and those expected of them."""
        now = self.clock()
        for cost in self.expected:
            if cost.name in self.took:
                yield cost, self.took[cost.name], self.done[cost.name] * cost.seconds
            if now - self.under_way.get(cost.name, now) > cost.seconds:
                yield cost, now - self.under_way[cost.name], cost.seconds

    def _ahead(self) -> list[StageCost]:
        """The stages with what they were expected to take still."""
        now, costs = self.clock(), []
        for cost in self.expected:
            ahead = max(0, cost.times - self.done[cost.name]) * cost.seconds
            if ahead and cost.name in self.under_way:
                ahead -= min(now - self.under_way[cost.name], OVERDUE * cost.seconds)
            costs.append(replace(cost, seconds=ahead, times=1))
        return costs

    def __str__(self) -> str:
        """Stage n of m, and the time left; empty where nothing is known. The time reported before grows by a quarter
        at most: beyond that it is reported as "at least".
        """
        left = self.left
        if left is None:
            return ""
        self.least = min(self.least, left)
        return f"stage {self.number} of {len(self.expected)}, {time_left(left, self.least)} left"

    @property
    def from_cache(self) -> str:
        """How many stages came from the cache, in a line; empty for none."""
        count = len(self.cached)
        return f"{count} stage{'s' if count > 1 else ''} from the cache" if count else ""


def time_left(seconds: float, least: float) -> str:
    """A time left in words, which never grows by more than a quarter above the ``least`` one reported before."""
    return f"at least {duration(GROWS * least)}" if seconds > GROWS * least else f"about {duration(seconds)}"


PLAIN_EVERY = 10.0  # s between lines of a stage when the output is not a terminal
BAR = 24  # letters


@dataclass
class ProgressListener:
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
class _OnTerminal(ProgressListener):
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
        if status := str(self.progress):
            grid = Table.grid(padding=(0, 1))
            grid.add_row(ProgressBar(total=1.0, completed=self.progress.part, width=BAR), status)
            lines.insert(0, grid)
        return Group(*lines)


@dataclass
class _InLines(ProgressListener):
    """A line of a stage now and then, and at its end; as text, or each a JSON object."""

    console: Console = field(kw_only=True)
    as_json: bool = False
    last: dict[str, float] = field(default_factory=dict)  # when a stage was reported

    def tell(self, stage: str, text: str) -> None:
        now = time.monotonic()
        if not text.startswith(DONE) and now - self.last.get(stage, -PLAIN_EVERY) < PLAIN_EVERY:
            return
        if text.startswith(FROM_CACHE) and (stage in self.last or not self.as_json):
            return  # it is read again and again: a program hears of it once, a person of all of them together
        self.last[stage] = now
        self.console.print(self._line(stage, text), highlight=False, markup=False, soft_wrap=True)

    def _line(self, stage: str, text: str) -> str:
        if not self.as_json:
            status = "" if text.startswith(DONE) else str(self.progress)
            return f"{stage}: {text}" + (f" ({status})" if status else "")
        progress, left = self.progress, self.progress.left
        seconds_left = None if left is None else round(left, 1)
        known = {"stage": stage, "text": text, "number": progress.number, "of": len(progress.expected)}
        return json.dumps({**known, "seconds_left": seconds_left})


@contextmanager
def live(*, enabled: bool, as_json: bool = False) -> Iterator[ProgressListener]:
    """A listener of a run: on a terminal a bar for the whole of it, elsewhere a line now and then, both on stderr; with
    ``as_json`` such lines are JSON objects: stage, text, number, of, seconds_left. Not ``enabled``: silent.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not enabled:
        yield ProgressListener()
    elif console.is_terminal and not as_json:
        listener = _OnTerminal(console=console)
        with _shown(listener, console):
            yield listener
        _tell_cached(listener, console)
    else:
        lines = _InLines(console=console, as_json=as_json)
        yield lines
        if not as_json:
            _tell_cached(lines, console)


def _tell_cached(listener: ProgressListener, console: Console) -> None:
    if line := listener.progress.from_cache:
        console.print(line, highlight=False)


def _shown(listener: _OnTerminal, console: Console) -> Live:
    from rich.live import Live

    return Live(get_renderable=listener.__rich__, console=console, transient=True, refresh_per_second=4)


EVERY = 0.5  # s between pictures of the bar
Planned = Callable[[Plan], object]


def as_listener(listener: Listener | None, planned: Planned | None = None) -> tuple[Listener, Planned]:
    """A caller's ``listener`` and what hears of the plan. Without a listener: a bar below the cell of a notebook, and
    silence elsewhere.
    """
    if listener is None and _in_notebook():
        in_notebook = _InNotebook()
        return in_notebook, planned or in_notebook.planned
    return listener or null_listener, planned or ignore


def ignore(plan: Plan) -> None:
    """Do nothing: nobody asks what will be done."""


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


@dataclass
class _InNotebook(ProgressListener):
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
        status = str(self.progress)
        bar = f'<progress max="1" value="{self.progress.part:.3f}"></progress> {escape(status)}<br>' if status else ""
        lines = [*(f"✓ {line}" for line in self.finished), *self.now.values()]
        return bar + "<br>".join(f"<small>{escape(line)}</small>" for line in lines)
