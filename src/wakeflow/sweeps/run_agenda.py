"""Doing an agenda: steps go to an executor as soon as what they need is done."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, field

from ..core.cluster import Cluster
from ..core.errors import ProgramError
from ..core.quantities import duration
from .agenda import Agenda, Step
from .work import JobEnd, fly_scene, solve_airflow_of

__all__ = ["SweepProgress", "do_agenda"]

TELL_EVERY = 1.0  # s between looks at the time left, where nothing ends


@dataclass
class SweepProgress:
    """How far an agenda is, in expected core-seconds, which say better than a count how much is left."""

    steps: int
    expected: float
    done: int = 0
    failed: int = 0
    behind: float = 0.0
    started: float = field(default_factory=time.monotonic)

    def ended(self, step: Step, outcome: JobEnd) -> None:
        """Count a step."""
        self.done += 1
        self.failed += bool(outcome.problem)
        self.behind += step.seconds

    @property
    def left(self) -> float | None:
        """Seconds left, if what is left costs what is behind has cost; None before anything is behind."""
        if not self.behind:
            return None
        return (time.monotonic() - self.started) * (self.expected - self.behind) / self.behind

    def __str__(self) -> str:
        left = "" if self.left is None or self.done == self.steps else f", about {duration(self.left)} left"
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{self.done} of {self.steps} stages{failed}{left}"


@dataclass
class _Board:
    """What waits, what is under way, what was found."""

    waiting: dict[str, list[Step]] = field(default_factory=dict)  # by the name of what they need
    running: dict[Future[JobEnd], Step] = field(default_factory=dict)
    found: dict[str, JobEnd] = field(default_factory=dict)

    def begin(self, executor: Executor, step: Step) -> None:
        """Hand a step out, or have it wait for what it needs."""
        if step.needs is None or step.needs in self.found:
            able = executor.on(step.ranks) if isinstance(executor, Cluster) else executor
            work = solve_airflow_of if step.airflow else fly_scene
            self.running[able.submit(work, step.job)] = step
        else:
            self.waiting.setdefault(step.needs, []).append(step)

    def end(self, executor: Executor, future: Future[JobEnd]) -> list[tuple[Step, JobEnd]]:
        """The step that has ended, and those that fail with the airflow that they fly in; hands out those it frees."""
        step = self.running.pop(future)
        outcome = _outcome(future)
        self.found[step.name] = outcome
        freed = self.waiting.pop(step.name, [])
        stuck = [other for other in freed if step.airflow and outcome.problem and not other.airflow]
        for other in freed:
            if other not in stuck:
                self.begin(executor, other)
        lost = [(other, JobEnd(f"its airflow failed: {outcome.problem}")) for other in self._after(stuck)]
        self.found |= {other.name: why for other, why in lost}
        return [(step, outcome), *lost]

    def _after(self, steps: list[Step]) -> list[Step]:
        """Steps with all that wait for them."""
        found = list(steps)
        for step in found:
            found += self.waiting.pop(step.name, [])
        return found


def do_agenda(
    agenda: Agenda, executor: Executor, tell: Callable[[str], None], ended: Callable[[Step, JobEnd], None]
) -> None:
    """Do every step; ``ended(step, outcome)`` hears of each in the order in which they end, ``tell`` how far it is.

    Steps are handed out in the order of the agenda: airflows first, then flights whose airflow is there.
    """
    progress, board = SweepProgress(len(agenda.steps), agenda.seconds), _Board()
    for step in agenda.steps:
        board.begin(executor, step)
    while board.running:
        tell(str(progress))
        for future in wait(board.running, timeout=TELL_EVERY, return_when=FIRST_COMPLETED).done:
            for step, outcome in board.end(executor, future):
                progress.ended(step, outcome)
                ended(step, outcome)
    tell(f"done {progress}")


def _outcome(future: Future[JobEnd]) -> JobEnd:
    try:
        return future.result()
    except ProgramError as problem:  # the worker died
        return JobEnd(str(problem))
