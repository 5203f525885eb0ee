"""A running solver followed by its log: where it stands, whether it has gone astray."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.errors import FoamError
from ...core.process import tail
from .case import read_parameters
from .programs import AirflowFailure, Cause
from .statistics import CD, HistoryTable

LOOK_EVERY = 0.2  # s of wall time between two looks at the history; chosen: an eye sees no faster
ABSURD = 1e3  # a drag coefficient that no body has above Re 1; below, drag grows as 1/Re
MAX_SWEEPS, UNSOLVED = 1000, 20  # OpenFOAM's own limit on a linear solver; reached so often in a row it is stuck
CRAWL, CRAWLING = 10.0, 200  # so many time steps in a row below so many of the least ones: time stands still
NEXT = 1e-9  # relative: a row of the history so much before a step belongs to the one before it
IMPULSE = 50  # first steps, in which a flow started from a guess pushes the body without bound as the step shrinks


@dataclass(frozen=True)
class Progress:
    """Where a solver is. ``time`` counts iterations when steady, else seconds of flow; ``left`` is wall seconds,
    estimated; infinite where nobody can say.
    """

    stage: str
    time: float
    cd: float
    residuals: dict[str, float]
    left: float

    def __str__(self) -> str:
        where = f"iteration {self.time:.0f}" if self.stage == "steady" else f"{self.stage}, t = {self.time:.4g} s"
        parts = [where, f"Cd {self.cd:.3f}"]
        if "p" in self.residuals:
            parts.append(f"pressure residual {self.residuals['p']:.1e}")
        if math.isfinite(self.left):
            parts.append(f"about {self.left:.0f} s left")
        return ", ".join(parts)


ProgressListener = Callable[[Progress], None]


class Watch:
    """Reads a solver's log line by line: residuals, time, drag; tells how far it is and ends it where it went astray.

    Which failure it finds does not depend on when it looks: lines and drags are judged in the order of the run.
    """

    def __init__(
        self, folder: Path, stage: str, listener: ProgressListener, *, expected: float, least_step: float = 0.0
    ) -> None:
        """``expected``: where the run may end; ``least_step`` (s): a shorter time step will never arrive."""
        self.folder, self.stage, self.listener = folder, stage, listener
        self.expected, self.least_step = expected, least_step
        self.absurd = ABSURD * max(1.0, 1.0 / _reynolds(folder))
        self.spent = self.covered = 0.0  # wall seconds, and flow time (s) or iterations, of the segments that ended
        self.begin()

    def begin(self) -> None:
        """A segment of the run begins."""
        self.drags = HistoryTable(self.folder, "forceCoefficients", (CD,))
        self.judged = len(self.drags.rows)
        self.residuals: dict[str, float] = {}
        self.started = self.looked = 0.0
        self.first = self.now = 0.0
        self.failed = False
        self.crawling = self.unsolved = 0

    def end(self) -> None:
        """The segment's program has ended. Raises AirflowFailure for a drag that nobody looked at so far."""
        if self.failed:
            return
        self._judge(np.inf)
        if self.started:
            self.spent += time.monotonic() - self.started
            self.covered += self.now - self.first

    def __call__(self, line: str) -> None:
        """Take in one line of the log. Raises AirflowFailure where the run can no longer end well."""
        try:
            self._take_in(line)
        except ValueError:  # of a number that is none
            log = self._log()
            raise FoamError(
                f"the solver printed {line[:60]!r}, which holds no number; is it OpenFOAM's? log: {log}",
                log=log, tail=tail(log) if log else "",
            ) from None  # fmt: skip

    def _take_in(self, line: str) -> None:
        if "Initial residual" in line:
            match = re.search(r"Solving for (\w+), Initial residual = ([^,]+).*No Iterations (\d+)", line)
            if match:
                self._equation(match[1], float(match[2]), int(match[3]))
        elif line.startswith("deltaT = "):
            self._time_step(float(line.split("=")[1]))
        elif line.startswith("Time = "):
            self._step(float(line.split("=")[1]))

    def _equation(self, name: str, residual: float, iterations: int) -> None:
        """Notice a residual that is not a number, and a pressure that its solver never finishes solving for."""
        self.residuals[name] = residual
        if not np.isfinite(residual):
            self._fail(Cause.DIVERGED, f"diverged: the residual of {name} is not a number")
        if name == "p":
            self.unsolved = self.unsolved + 1 if iterations >= MAX_SWEEPS else 0
            if self.unsolved >= UNSOLVED:
                self._fail(Cause.STALLED, f"stalled: the pressure took {iterations} sweeps {UNSOLVED} times in a row")

    def _time_step(self, step: float) -> None:
        """Notice time steps that will never arrive."""
        if step < self.least_step:
            self._fail(Cause.COLLAPSED, f"diverged: the time step collapsed to {step:.6g} s")
        self.crawling = self.crawling + 1 if step < CRAWL * self.least_step else 0
        if self.crawling >= CRAWLING:
            self._fail(Cause.STALLED, f"stalled: {CRAWLING} time steps in a row were below {step:.3g} s")

    def _step(self, now: float) -> None:
        if not self.started:
            self.first, self.started = now, time.monotonic()
        self.now = now
        if time.monotonic() - self.looked < LOOK_EVERY:
            return
        self.looked = time.monotonic()
        self._judge(now)
        if self.judged:
            drag = float(self.drags.rows[self.judged - 1, 1])
            self.listener(Progress(self.stage, now, drag, dict(self.residuals), self._left()))

    def _left(self) -> float:
        """Wall seconds left at the pace so far; infinite where that cannot be said."""
        covered = self.covered + self.now - self.first
        if not (covered > 0 and self.now < self.expected):  # past it: no idea
            return math.inf
        return (self.expected - self.now) * (self.spent + time.monotonic() - self.started) / covered

    def _judge(self, now: float) -> None:
        """Notice a drag that cannot be, in the steps before ``now``."""
        rows = self.drags.update()
        until = int(np.searchsorted(rows[:, 0], now * (1 - NEXT)))
        for i in range(self.judged, until):
            drag = float(rows[i, 1])
            if not np.isfinite(drag) or (abs(drag) > self.absurd and i >= IMPULSE):
                self._raise(Cause.DIVERGED, f"diverged: the drag coefficient reached {drag:.3g}")
        self.judged = max(until, self.judged)

    def _fail(self, cause: Cause, why: str) -> None:
        """Raise for something in the log; for an impossible drag where that was there first."""
        self._judge(self.now)
        self._raise(cause, why)

    def _raise(self, cause: Cause, why: str) -> None:
        self.failed, log = True, self._log()
        raise AirflowFailure(cause, f"the airflow {why}; log: {log}", log=log, tail=tail(log) if log else "")

    def _log(self) -> Path | None:
        """The solver's log, the newest of the folder."""
        return max(self.folder.glob("log.*Foam"), key=lambda path: path.stat().st_mtime, default=None)


def _reynolds(folder: Path) -> float:
    """Reynolds number of the case, from its parameters; 1 without them."""
    values = read_parameters(folder)
    numbers = [abs(float(values[name])) for name in ("inletSpeed", "bodyWidth", "nu") if name in values]
    return numbers[0] * numbers[1] / numbers[2] if len(numbers) == 3 else 1.0
