"""How tracks end: the fates, and the tracks of many granules."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from .kernel import layout as at

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Fate(IntEnum):
    """How a track ended; ``advice`` says what to do about it."""

    BINNED = at.BINNED
    ESCAPED = at.ESCAPED
    RESTING = at.RESTING
    CAPTURED = at.CAPTURED
    AIRBORNE = at.AIRBORNE
    STOPPED = at.STOPPED

    @property
    def advice(self) -> str:
        return ADVICE[self]


ADVICE = {
    Fate.BINNED: "crossed a line, or left the mesh on one",
    Fate.ESCAPED: "left the mesh, or was born outside it, where no line and no body is: add a bin there if it matters",
    Fate.RESTING: "lies still on a wall: a steeper slope or less friction would let it slide",
    Fate.CAPTURED: "stayed at a wall that keeps it, or part of what touches it, or that it came to slowly",
    Fate.AIRBORNE: "was still moving at the end: give it more time, or look whether a vortex holds it",
    Fate.STOPPED: "was born inside a body, or took more steps or impacts than allowed: look at its start and its path",
}


class ClockStep(NamedTuple):
    """The ``step`` of the common clock (s), and the ``step_error`` that it was chosen by: how far nine of ten of a
    sample that meets nobody land at most from where far finer flights put them (lengths); the error that was ``asked``,
    and how many ``trials`` it took: none where the step was ``given``, whose error is not known (NaN).
    """

    step: float
    step_error: float = math.nan
    asked: float = math.nan
    trials: int = 0

    @property
    def given(self) -> bool:
        """Whether nobody had to find it."""
        return not self.trials

    @property
    def reached(self) -> bool:
        """Whether it errs by no more than was asked; true where the step was given."""
        return not self.step_error > self.asked

    @property
    def told(self) -> str:
        """The choice in words."""
        landing = f"nine of ten land within {self.step_error:.2g} lengths ({self.asked:.2g} asked)"
        return f"steps of {self.step:.3g} s, by which {landing}; trials: {self.trials}"


@dataclass(frozen=True)
class CollisionFlight:
    """How they met: the ``clock``; ``steps`` of the clock and of granules (``flown``); ``standing`` (k, 3):
    time (s), how many lay still or, leaning on others, hardly moved, and how many were born; ``jammed``: that most of
    the second half of the feed does. Of granules that flew alone: a clock without a step, and none taken.
    """

    clock: ClockStep = field(default_factory=lambda: ClockStep(math.nan))
    steps: int = 0
    flown: int = 0
    standing: Array = field(default_factory=lambda: np.zeros((0, 3)))
    jammed: bool = False

    @property
    def advice(self) -> str:
        """What the user must know; empty where nothing is wrong."""
        return "; ".join(filter(None, (JAM if self.jammed else "", TOO_LONG * (not self.clock.reached))))


TOO_LONG = "no step of the clock was as exact as asked: look at clock.told"
JAM = "the feed jams: granules that lie still become more as long as it runs; widen the gap, or feed less"


@dataclass(frozen=True, eq=False)
class Tracks:
    """How n granules ended: ``position`` (n, 2) m, ``velocity`` (n, 2) m/s, ``time`` (n,) s on the clock they were
    born by.

    ``fate`` (n,) values of :class:`Fate`; ``steps`` taken, ``impacts`` on bodies, ``line`` index that ended the track
    or -1; ``spin`` rad/s; ``evaluations`` of the equation of motion; ``recorded`` paths, empty where none were kept.
    With ``collisions``: ``meetings`` (n,) with other granules; ``collisions``: how they were flown.
    """

    position: Array
    velocity: Array
    time: Array
    fate: Index
    steps: Index
    impacts: Index
    line: Index
    spin: Array
    evaluations: Index
    meetings: Index
    recorded: list[Array] = field(default_factory=list)
    collisions: CollisionFlight = field(default_factory=CollisionFlight)

    def __len__(self) -> int:
        return len(self.fate)

    @property
    def crowd(self) -> CollisionFlight:
        """``collisions`` by its earlier name."""
        return self.collisions

    @classmethod
    def empty(cls, count: int, *, recorded: bool = False) -> Tracks:
        """Room for the tracks of ``count`` granules."""
        names = ("fate", "steps", "impacts", "line", "evaluations", "meetings")
        numbers: dict[str, Any] = {name: np.zeros(count, dtype=np.int64) for name in names}
        return cls(
            position=np.zeros((count, 2)),
            velocity=np.zeros((count, 2)),
            time=np.zeros(count),
            spin=np.zeros(count),
            recorded=[np.zeros((0, at.RECORD))] * count * recorded,
            **numbers,
        )

    def keep(self, rows: Any, states: Array, counts: Index) -> None:
        """Take in how the granules ``rows`` (m,) ended, from the kernel's rows ``states`` and ``counts`` of each."""
        self.position[rows], self.velocity[rows] = states[:, [at.X, at.Y]], states[:, [at.VX, at.VY]]
        self.time[rows], self.spin[rows] = states[:, at.T], states[:, at.SPIN]
        self.fate[rows], self.line[rows] = counts[:, at.FATE], counts[:, at.LINE]
        self.steps[rows], self.impacts[rows] = counts[:, at.STEPS], counts[:, at.IMPACTS]
        self.evaluations[rows] = counts[:, at.EVALUATIONS]

    def path(self, i: int) -> tuple[Array, Array, Array]:
        """Times (m,), positions (m, 2) and velocities (m, 2) of granule i; needs ``record=True``."""
        table = self._record(i)
        return table[:, 0], table[:, 1:3], table[:, 3:5]

    def arriving(self, i: int) -> Array:
        """Velocities (m, 2) with which granule i came to the points of its path: what all but walls and others changed
        of the velocity at the point before. Where it strikes nothing these are those of :meth:`path`.
        """
        table = self._record(i)
        velocity, gained = table[:, 3:5], np.diff(table[:, at.REC_GAIN_X : at.REC_GAIN_Y + 1], axis=0)
        return np.concatenate([velocity[:1], velocity[:-1] + gained])

    def _record(self, i: int) -> Array:
        if not self.recorded:
            raise SceneError("path: no paths were kept; call track(..., record=True)")
        return self.recorded[i]

    def some(self, rows: Index) -> Tracks:
        """The tracks of the granules ``rows`` (m,)."""
        by_name = {f.name: getattr(self, f.name) for f in fields(self)}
        parts: dict[str, Any] = {name: value[rows] for name, value in by_name.items() if isinstance(value, np.ndarray)}
        return replace(self, **parts, recorded=[self.recorded[i] for i in rows] if self.recorded else [])

    def ends(self, bins: int) -> tuple[Index, Index]:
        """Where (n,) they ended, a place among the first ``bins`` lines or -1 for elsewhere, and their fates (n,): what
        crossed a line after those, such as the floor of a channel, has escaped; what a wall's bin captured is in it.
        """
        binned = (self.line >= 0) & (self.line < bins)
        beyond = (self.fate == Fate.BINNED) & ~binned
        fates = np.where(binned, Fate.BINNED, np.where(beyond, Fate.ESCAPED, self.fate))
        return np.where(binned, self.line, -1), fates

    def counts(self) -> dict[Fate, int]:
        """How many tracks ended in each fate; adds up to all of them."""
        return {fate: int(np.sum(self.fate == fate)) for fate in Fate}
