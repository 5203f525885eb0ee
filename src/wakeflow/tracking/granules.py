"""What is tracked, what it meets and how it ends: Granules, Body, Motion, Fate, Tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..laws.restitution import Restitution
from ..laws.vibration import Record, integrated
from .kernel import layout

__all__ = ["Body", "Fate", "Granules", "Motion", "Tracks"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
SCALARS = {  # name: (what it may be, in words; test)
    "diameter": ("positive", lambda x: x > 0),
    "density": ("positive", lambda x: x > 0),
    "sphericity": ("above 0 and at most 1", lambda x: (x > 0) & (x <= 1)),
    "restitution": ("0 to 1", lambda x: (x >= 0) & (x <= 1)),
    "friction": ("not negative", lambda x: x >= 0),
    "spin": ("finite", lambda x: x == x),
    "weight": ("not negative", lambda x: x >= 0),
    "drag_scale": ("positive", lambda x: x > 0),
    "time": ("finite", lambda x: x == x),
}


class Fate(IntEnum):
    """How a track ended; ``advice`` says what to do about it."""

    BINNED = layout.BINNED
    ESCAPED = layout.ESCAPED
    RESTING = layout.RESTING
    CAPTURED = layout.CAPTURED
    AIRBORNE = layout.AIRBORNE
    STOPPED = layout.STOPPED

    @property
    def advice(self) -> str:
        return ADVICE[self]


ADVICE = {
    Fate.BINNED: "crossed a line, or left the mesh on one",
    Fate.ESCAPED: "left the mesh, or was born outside it, where no line and no body is: add a bin there if it matters",
    Fate.RESTING: "lies still on a wall: a steeper slope or less friction would let it slide",
    Fate.CAPTURED: "touched a body that captures",
    Fate.AIRBORNE: "was still moving at the end: give it more time, or look whether a vortex holds it",
    Fate.STOPPED: "was born inside a body, or took more steps or impacts than allowed: look at its start and its path",
}


def _clean(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(np.broadcast_to(np.asarray(values, dtype=float), shape), order="C")
    except (TypeError, ValueError):
        raise SceneError(f"granule {name}: shape {np.shape(values)} does not fit {shape}") from None
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    _refuse(name, array, bad, "finite")
    return array


def _refuse(name: str, array: Array, bad: NDArray[np.bool_], allowed: str) -> None:
    if bad.any():
        first = int(bad.argmax())
        raise SceneError(
            f"granule {name}: {int(bad.sum())} of {len(array)} must be {allowed}, first {array[first]} at index {first}"
        )


@dataclass(frozen=True, eq=False)
class Granules:
    """n granules: ``position`` (n, 2) m, ``velocity`` (n, 2) m/s; all else (n,) or one number for all. SI units.

    ``diameter`` that of the sphere of equal volume; ``spin`` rad/s, counter-clockwise positive; ``fraction`` index of
    the fraction; ``weight`` what a granule stands for; ``drag_scale`` factor on the drag law (a calibrated terminal
    velocity); ``restitution`` a number each, or one :class:`~wakeflow.laws.restitution.Restitution` law of the normal
    approach speed for all; ``inertia`` I / (m r^2), None or inf for a point mass; ``time`` s, when it is born. Raises
    SceneError, naming the count and the first index, for values that are not finite or out of range.
    """

    position: Array
    velocity: Array
    diameter: Any
    density: Any
    sphericity: Any = 1.0
    restitution: Any = 0.5
    friction: Any = 0.3
    spin: Any = 0.0
    fraction: Any = 0
    weight: Any = 1.0
    drag_scale: Any = 1.0
    inertia: Any = None
    time: Any = 0.0

    def __post_init__(self) -> None:
        shape = np.shape(self.position)
        if len(shape) != 2 or shape[1] != 2:
            raise SceneError(f"granule position: shape {shape}, expected (n, 2)")
        for name in ("position", "velocity"):
            object.__setattr__(self, name, _clean(name, getattr(self, name), shape))
        for name, (allowed, test) in SCALARS.items():
            if isinstance(getattr(self, name), Restitution):
                continue
            array = _clean(name, getattr(self, name), shape[:1])
            _refuse(name, array, ~test(array), allowed)
            object.__setattr__(self, name, array)
        object.__setattr__(
            self, "fraction", np.array(np.broadcast_to(np.asarray(self.fraction, dtype=np.int64), shape[:1]))
        )
        inertia = np.inf if self.inertia is None else self.inertia
        inertia = np.array(np.broadcast_to(np.asarray(inertia, dtype=float), shape[:1]))
        _refuse("inertia", inertia, ~(inertia > 0), "positive")
        object.__setattr__(self, "inertia", inertia)

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, chosen: Any) -> Granules:
        """The chosen granules: a slice, indices or a mask."""
        own: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        return self.replace(**{name: v[chosen] for name, v in own.items() if not isinstance(v, Restitution)})

    def replace(self, **changes: Any) -> Granules:
        """The same granules with some properties replaced."""
        return Granules(**({f.name: getattr(self, f.name) for f in fields(self)} | changes))


@dataclass(frozen=True)
class Motion:
    """Translation that repeats: displacement(t) = amplitude sin(2 pi frequency t + phase); m, Hz, rad. Or, made by
    :meth:`sampled`, along ``record``; amplitude is then its largest displacement, frequency 1 / its period.
    """

    amplitude: Sequence[float]
    frequency: float
    phase: float = 0.0
    record: Record | None = None

    @classmethod
    def sampled(
        cls, time: ArrayLike, acceleration: ArrayLike, direction: Sequence[float] = (0.0, 1.0), phase: float = 0.0
    ) -> Motion:
        """Motion by one period of measured acceleration (k,) m/s2 at times (k,) s along ``direction`` (2,), any length;
        ``phase`` rad of the period at t = 0. See :func:`wakeflow.laws.vibration.integrated`, also for what it raises.
        """
        size = math.hypot(*direction)
        if not (math.isfinite(size) and size > 0):
            raise SceneError(f"motion: direction {direction} must be finite and not zero")
        record = integrated(time, acceleration)
        return cls([record.reach * part / size for part in direction], 1.0 / record.period, phase, record)

    @property
    def moves(self) -> bool:
        """Whether there is any motion."""
        return self.frequency > 0 and bool(np.any(np.asarray(self.amplitude, dtype=float)))

    @property
    def pace(self) -> float:
        """Angular frequency (rad/s); of samples: that of their fastest change, see ``Record.pace``."""
        return 2 * np.pi * self.frequency if self.record is None else self.record.pace

    def at(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Displacement (..., 2) m, velocity m/s and acceleration m/s2 at times (...) s."""
        t, along = np.asarray(time, dtype=float)[..., None], np.asarray(self.amplitude, dtype=float)
        if self.record is not None:
            moved = self.record.at(t + self.phase * self.record.period / (2 * np.pi))
            return (along * (moved[0] / self.record.reach), along * (moved[1] / self.record.reach),
                    along * (moved[2] / self.record.reach))  # fmt: skip
        omega = 2 * np.pi * self.frequency
        s, c = np.sin(omega * t + self.phase), np.cos(omega * t + self.phase)
        return along * s, along * (omega * c), along * (-(omega**2) * s)

    def __post_init__(self) -> None:
        values = np.asarray(self.amplitude, dtype=float)
        if values.shape != (2,) or not np.all(np.isfinite([*values, self.frequency, self.phase])):
            raise SceneError(f"motion: amplitude {self.amplitude} must be two finite numbers, as frequency and phase")
        if self.frequency < 0:
            raise SceneError(f"motion: frequency = {self.frequency:g} Hz must not be negative")


@dataclass(frozen=True, eq=False)
class Body:
    """A solid: a closed ``outline`` (k, 2) m, either way round, or an ``open`` polyline that is solid on its left side.

    ``capture`` ends a track at first contact; ``restitution`` and ``friction`` replace the granules' own.
    Raises SceneError for an outline that is no polygon.
    """

    outline: Array
    motion: Motion | None = None
    capture: bool = False
    restitution: float | None = None
    friction: float | None = None
    open: bool = False

    def __post_init__(self) -> None:
        points = np.array(self.outline, dtype=float)
        least = 2 if self.open else 3
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < least or not np.all(np.isfinite(points)):
            raise SceneError(f"body: outline of shape {points.shape}, expected at least {least} finite points (k, 2)")
        if not self.open and np.array_equal(points[0], points[-1]):
            points = points[:-1]
        following = points[1:] if self.open else np.roll(points, -1, axis=0)
        if np.any(np.all(points[: len(following)] == following, axis=1)):
            raise SceneError("body: two points of the outline that follow each other are equal")
        if not self.open:
            double = float(np.sum(points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]))
            if double == 0.0:
                raise SceneError("body: the outline encloses no area")
            points = points if double > 0 else points[::-1].copy()
        for name, value, top in (("restitution", self.restitution, 1.0), ("friction", self.friction, np.inf)):
            if value is not None and not 0 <= value <= top:
                raise SceneError(f"body: {name} = {value:g}, allowed 0 to {top:g}")
        object.__setattr__(self, "outline", points)


@dataclass(frozen=True, eq=False)
class Tracks:
    """How n granules ended: ``position`` (n, 2) m, ``velocity`` (n, 2) m/s, ``time`` (n,) s on the clock they were
    born by.

    ``fate`` (n,) values of :class:`Fate`; ``steps`` taken, ``impacts`` on bodies, ``line`` index that ended the track
    or -1; ``spin`` rad/s; ``evaluations`` of the equation of motion.
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
    recorded: list[Array] | None = None

    def __len__(self) -> int:
        return len(self.fate)

    @classmethod
    def empty(cls, count: int, *, recorded: bool = False) -> Tracks:
        """Room for the tracks of ``count`` granules."""
        numbers = {
            name: np.zeros(count, dtype=np.int64) for name in ("fate", "steps", "impacts", "line", "evaluations")
        }
        return cls(
            position=np.zeros((count, 2)),
            velocity=np.zeros((count, 2)),
            time=np.zeros(count),
            spin=np.zeros(count),
            recorded=[np.zeros((0, 5))] * count if recorded else None,
            **numbers,
        )

    def path(self, i: int) -> tuple[Array, Array, Array]:
        """Times (m,), positions (m, 2) and velocities (m, 2) of granule i; needs ``record=True``."""
        if self.recorded is None:
            raise SceneError("path: no paths were kept; call track(..., record=True)")
        table = self.recorded[i]
        return table[:, 0], table[:, 1:3], table[:, 3:5]

    def counts(self) -> dict[Fate, int]:
        """How many tracks ended in each fate; adds up to all of them."""
        return {fate: int(np.sum(self.fate == fate)) for fate in Fate}
