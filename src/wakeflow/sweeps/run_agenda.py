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
from .work import fly_scene, solve_airflow_of

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

    def ended(self, step: Step, problem: str) -> None:
        """Count a step."""
        self.done += 1
        self.failed += bool(problem)
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


def do_agenda(
    agenda: Agenda, executor: Executor, tell: Callable[[str], None], ended: Callable[[Step, str], None]
) -> None:
    """Do every step; ``ended(step, problem)`` hears of each in the order in which they end, ``tell`` how far it is.

    Steps are handed out in the order of the agenda as soon as what they need has ended: airflows first, then flights.
    """
    progress, left = SweepProgress(len(agenda.steps), agenda.seconds), list(agenda.steps)
    running: dict[Future[str], Step] = {}
    done: set[str | None] = {None}  # names of steps that have ended
    lost: dict[str | None, str] = {}  # by name why flights that need a step fail with it

    def end(step: Step, problem: str) -> None:
        done.add(step.name)
        if step.airflow and problem:
            lost[step.name] = f"its airflow failed: {problem}"
        progress.ended(step, problem)
        ended(step, problem)

    while True:
        while ready := [step for step in left if step.needs in done]:
            left = [step for step in left if step.needs not in done]
            for step in ready:
                if step.needs in lost and not step.airflow:
                    lost[step.name] = lost[step.needs]
                    end(step, lost[step.name])
                else:
                    running[_begun(step, executor)] = step
        if not running:
            break
        tell(str(progress))
        for future in wait(running, timeout=TELL_EVERY, return_when=FIRST_COMPLETED).done:
            end(running.pop(future), _problem(future))
    tell(f"done {progress}")


def _begun(step: Step, executor: Executor) -> Future[str]:
    able = executor.on(step.ranks) if isinstance(executor, Cluster) else executor
    return able.submit(solve_airflow_of if step.airflow else fly_scene, step.job)


def _problem(future: Future[str]) -> str:
    try:
        return future.result()
    except ProgramError as problem:  # the worker died
        return str(problem)
