"""What granules meet: bodies and how they move, and each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import number, numbers
from ..core.errors import SceneError
from ..laws.vibration import MAX_ROCK, Record, integrated
from .granules import Granules
from .tracks import ClockStep

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Motion that repeats: displacement(t) = amplitude sin(2 pi frequency t + phase); m, Hz, rad. Or, made by
    :meth:`sampled`, along ``record``; amplitude is then its largest displacement, frequency 1 / its period. Or about a
    ``pivot`` (2,) m at rest; amplitude is then one angle (rad), anticlockwise, of at most MAX_ROCK to either side.
    """

    amplitude: Sequence[float] | float
    frequency: float
    phase: float = 0.0
    record: Record | None = None
    pivot: Sequence[float] | None = None

    @classmethod
    def sampled(
        cls, time: ArrayLike, acceleration: ArrayLike, direction: Sequence[float] = (0.0, 1.0), phase: float = 0.0
    ) -> Motion:
        """Motion by one period of measured acceleration (k,) m/s2 at times (k,) s along ``direction`` (2,), any length;
        ``phase`` rad of the period at t = 0. See :func:`wakeflow.laws.vibration.integrated`, also for what it raises.
        """
        size = math.hypot(*numbers("motion: direction", direction))
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

    @property
    def opposite(self) -> Motion:
        """The motion that undoes it."""
        return replace(self, amplitude=(-np.asarray(self.amplitude, dtype=float)).tolist())

    def reach(self, points: Array) -> Array:
        """The largest displacement (2,) m of points (k, 2) m: about a pivot a bound, the farthest one's chord."""
        if self.pivot is None:
            return np.array(np.abs(np.asarray(self.amplitude, dtype=float)))
        away = float(np.linalg.norm(points - np.asarray(self.pivot), axis=1).max())
        return np.full(2, 2.0 * away * math.sin(0.5 * abs(float(np.asarray(self.amplitude)))))

    def at(self, time: ArrayLike, place: ArrayLike = (0.0, 0.0)) -> tuple[Array, Array, Array]:
        """Displacement (..., 2) m, velocity m/s and acceleration m/s2 at times (...) s; of a body that rocks those of
        what is at the ``place`` (..., 2) m when it is in the middle of its motion.
        """
        t, along = numbers("time", time, "s")[..., None], np.asarray(self.amplitude, dtype=float)
        if self.record is not None:
            moved = self.record.at(t + self.phase * self.record.period / (2 * np.pi))
            out, rate, pull = (part / self.record.reach for part in moved)
        else:
            omega = 2 * np.pi * self.frequency
            out, c = np.sin(omega * t + self.phase), np.cos(omega * t + self.phase)
            rate, pull = omega * c, -(omega**2) * out
        if self.pivot is None:
            return along * out, along * rate, along * pull
        away, out, turn = np.asarray(place, dtype=float) - np.asarray(self.pivot), along * out, along * rate
        moved = np.sin(out) * across(away) - 2.0 * np.sin(0.5 * out) ** 2 * away
        there = away + moved
        return moved, turn * across(there), along * pull * across(there) - turn**2 * there

    def __post_init__(self) -> None:
        values = numbers("motion: amplitude", self.amplitude, "m" if self.pivot is None else "rad")
        for name, unit in (("frequency", "Hz"), ("phase", "rad")):
            object.__setattr__(self, name, number(f"motion: {name}", getattr(self, name), unit))
        shape, count = ((2,), "two finite numbers") if self.pivot is None else ((), "one finite number")
        if values.shape != shape or not np.all(np.isfinite([*values.flat, self.frequency, self.phase])):
            raise SceneError(f"motion: amplitude {self.amplitude} must be {count}, as frequency and phase")
        if self.pivot is None:
            object.__setattr__(self, "amplitude", tuple(values.tolist()))
        else:
            self._check_rocking(float(values))
        if self.frequency < 0:
            raise SceneError(f"motion: frequency = {self.frequency:g} Hz must not be negative")

    def _check_rocking(self, angle: float) -> None:
        place = numbers("motion: pivot", self.pivot, "m")  # type: ignore[arg-type]
        if place.shape != (2,) or not np.all(np.isfinite(place)):
            raise SceneError(f"motion: pivot {self.pivot} must be two finite numbers")
        if self.record is not None:
            raise SceneError("motion: samples are of a motion along a line; leave out pivot")
        if abs(angle) > MAX_ROCK:
            raise SceneError(f"motion: amplitude = {angle:g} rad about a pivot, allowed up to {MAX_ROCK:.4g} rad")
        object.__setattr__(self, "amplitude", angle)
        object.__setattr__(self, "pivot", tuple(place.tolist()))


def across(vectors: Array) -> Array:
    """Vectors (..., 2) turned anticlockwise by a right angle."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


@dataclass(frozen=True, eq=False)
class Body:
    """A solid: a closed ``outline`` (k, 2) m, either way round, or an ``open`` polyline that is solid on its left side.

    ``capture``: at this part of the impacts (True: at all) it keeps the granule. That ends the track, and counts as
    crossing the ``line`` of that number, -1: none.
    ``restitution`` and ``friction`` replace the granules' own.
    Raises SceneError for an outline that is no polygon.
    """

    outline: Array
    motion: Motion | None = None
    capture: float = False
    restitution: float | None = None
    friction: float | None = None
    open: bool = False
    line: int = -1

    def __post_init__(self) -> None:
        points = numbers("body: outline", self.outline, "m")
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
        part = float(self.capture) if isinstance(self.capture, bool) else self.capture
        given = ("restitution", self.restitution, 1.0), ("friction", self.friction, np.inf), ("capture", part, 1.0)
        for name, value, top in given:
            if value is not None and not 0 <= number(f"body: {name}", value) <= top:
                raise SceneError(f"body: {name} = {value:g}, allowed 0 to {top:g}")
        object.__setattr__(self, "outline", points)

    @property
    def reach(self) -> Array:
        """Largest displacement (2,) m of the body; zeros at rest."""
        return np.zeros(2) if self.motion is None else self.motion.reach(self.outline)

    @property
    def edges(self) -> tuple[Array, Array]:
        """Start and end of every edge, two (k, 2) arrays."""
        if self.open:
            return self.outline[:-1], self.outline[1:]
        return self.outline, np.roll(self.outline, -1, axis=0)


@dataclass(frozen=True, eq=False)
class Collisions:
    """Granules fly together and meet, in a slab of the machine that is periodic across the picture.

    ``depth`` of the slab (m), some ten to twenty diameters of the largest granules. Coefficients of ``restitution``,
    ``friction`` and ``tangential_restitution`` between granules: numbers, or symmetric tables (k, k) by ``fraction`` of
    the two. ``tracers`` are fractions too fine and too many to be simulated one by one: those that fly are a sample;
    the others can hit them, with the efficiency of impaction (:mod:`wakeflow.laws.impaction`), and does not notice, nor
    do they meet each other. ``forces``: those of each fraction among those of all; none: all. ``step`` (s) of the
    clock; None: as long as ``tolerance`` allows, found by flights of a sample (docs/model.md); ``measured`` hears
    it then, before the others fly. Raises SceneError for values out of range.
    """

    depth: float
    restitution: Any = 0.5
    friction: Any = 0.3
    tangential_restitution: Any = 0.0
    tracers: Sequence[int] = ()
    step: float | None = None
    measured: Callable[[ClockStep], object] | None = None
    forces: Sequence[Collection[str]] = ()

    def __post_init__(self) -> None:
        for name, unit in (("depth", "m"), ("step", "s")):
            if getattr(self, name) is None and name == "step":
                continue
            value = number(f"collisions: {name}", getattr(self, name), unit)
            if not (np.isfinite(value) and value > 0):
                raise SceneError(f"collisions: {name} = {value:g} must be positive and finite")
            object.__setattr__(self, name, value)
        for name, top in (("restitution", 1.0), ("friction", np.inf), ("tangential_restitution", 1.0)):
            values = numbers(f"collisions: {name}", getattr(self, name))
            if values.ndim not in (0, 2) or (values.ndim == 2 and values.shape[0] != values.shape[1]):
                raise SceneError(f"collisions: {name} of shape {values.shape}, expected a number or a table (k, k)")
            if not np.all((values >= 0) & (values <= top)):
                raise SceneError(f"collisions: {name} = {getattr(self, name)}: allowed 0 to {top:g}")
            if values.ndim == 2 and not np.array_equal(values, values.T):
                raise SceneError(f"collisions: {name} is not symmetric: two granules meet either way round")
            object.__setattr__(self, name, values)

    def tables(self, grains: Granules) -> tuple[Array, Array, Array]:
        """Restitution, friction and tangential restitution (k, k) for the fractions of ``grains``; raises SceneError
        where a table has too few of them, or the slab is thinner than a granule that others can hit.
        """
        most = int(grains.fraction.max(initial=0)) + 1
        if len(grains) and grains.fraction.min() < 0:
            raise SceneError("collisions: granule fraction: must not be negative")
        square = []
        for name in ("restitution", "friction", "tangential_restitution"):
            values = getattr(self, name)
            if values.ndim == 2 and len(values) < most:
                raise SceneError(f"collisions: {name} is a table of {len(values)} fractions, the granules have {most}")
            square.append(np.array(np.broadcast_to(values, (most, most)) if values.ndim == 0 else values, order="C"))
        solid = ~np.isin(grains.fraction, np.asarray(self.tracers, dtype=np.int64))
        thick = float(grains.diameter[solid].max(initial=0.0))
        if self.depth < thick:
            raise SceneError(
                f"collisions: depth = {self.depth:g} m is less than the largest granule, {thick:g} m: take ten of them"
            )
        return square[0], square[1], square[2]
