"""When a falling granule first meets a slope that moves, and how fast the wall is then.

A stream that is uniform in time meets the phases with density 1 + V_eta / V_n as long as the slope is nowhere faster
than the granules fall; above that earlier crests cast shadows, and the first contact is looked for on the path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry import halved_all
from ...scene import Scene, Vibration
from .. import Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]
PIECE = 0.4  # rad of the vibration looked at in one piece, as the tracker does
HALVINGS, ROUGHLY = 60, 12  # of a bracket: for a contact; for a dip, whose depth is missed by their square only


def motion_of(scene: Scene) -> Motion:
    """How the bodies of a scene move."""
    return Motion((0.0, 0.0), 0.0) if scene.vibration is None else motion_by(scene.vibration)


def motion_by(vibration: Vibration) -> Motion:
    """How bodies move that vibrate so."""
    if vibration.pivot is not None:
        return Motion(vibration.given["angle"], 1.0 / vibration.period, pivot=vibration.pivot)
    if vibration.samples is not None:
        return Motion.sampled(vibration.samples.time, vibration.samples.acceleration, tuple(vibration.along))
    return Motion(tuple(vibration.displacement), 1.0 / vibration.period)


def _displacement(motion: Motion, time: Array, place: Array) -> Array:
    """What ``Motion.at`` says first, in half the time along a line: halving asks for it again and again."""
    if motion.record is not None or motion.pivot is not None:
        return motion.at(time, place)[0]
    swing = np.sin(2 * np.pi * motion.frequency * time[..., None] + motion.phase)
    return np.asarray(motion.amplitude * swing)


@dataclass(frozen=True, eq=False)
class _Gap:
    """Distance of granules (n,) from their slopes along the normal: -n_y (V s + pull s^2 / 2) - n . d(t)."""

    fall_speed: Array
    pull: Array
    normal: Array
    passing: Array
    motion: Motion
    place: Array

    def at(self, t: Array, i: Index) -> Array:
        """Distance (m) of granules i at times t (s); s = t - passing."""
        s, n = t - self.passing[i], self.normal[i]
        moved = np.einsum("ij,ij->i", n, _displacement(self.motion, t, self.place[i]))
        return np.asarray(-n[:, 1] * s * (self.fall_speed[i] + 0.5 * self.pull[i] * s) - moved)

    def rate(self, t: Array, i: Index) -> Array:
        """Rate (m/s) at which the distance of granules i changes at times t (s)."""
        s, n = t - self.passing[i], self.normal[i]
        moving = np.einsum("ij,ij->i", n, self.motion.at(t, self.place[i])[1])
        return np.asarray(-n[:, 1] * (self.fall_speed[i] + self.pull[i] * s) - moving)

    def window(self) -> tuple[Array, Array]:
        """Times (n,) s at which granules pass the highest place of the slope and the lowest."""
        if self.motion.pivot is None:
            most = np.abs(self.normal @ np.asarray(self.motion.amplitude, dtype=float))
        else:
            most = np.array([np.hypot(*self.motion.reach(point[None])) for point in self.place])
        crest = most / self.normal[:, 1]
        v2, more = self.fall_speed**2, 2 * self.pull * crest
        before = 2 * crest / (self.fall_speed + np.sqrt(np.maximum(v2 - more, 0.0)))
        return self.passing - before, self.passing + 2 * crest / (self.fall_speed + np.sqrt(np.maximum(v2 + more, 0.0)))


def first_contact(
    fall_speed: Array,
    normal: Array,
    passing: Array,
    motion: Motion,
    pull: Array | float = 0.0,
    halvings: int = HALVINGS,
    place: ArrayLike = (0.0, 0.0),
) -> tuple[Array, Array]:
    """When granules first meet a slope that follows ``motion``, (n,) s, and the wall's velocity then, (n, 2) m/s.

    ``passing`` (n,) s: when each would touch the slope at rest, with ``fall_speed`` (n,) m/s straight down, which grows
    by ``pull`` (n,) m/s2; ``normal`` (n, 2) of the slope, upward. The first root of the distance along the normal is
    looked for from above all crests on, in pieces that are short against the vibration, each halved ``halvings`` times.
    Of a body that rocks: as the ``place`` (n, 2) m moves at which each would touch it at rest, to first order in its
    angle.
    """
    if not motion.moves or not len(passing):
        return passing.copy(), np.zeros((len(passing), 2))
    place = np.broadcast_to(np.asarray(place, dtype=float), (len(passing), 2))
    grows = np.broadcast_to(np.asarray(pull, dtype=float), passing.shape)
    gap = _Gap(fall_speed, grows, normal, passing, motion, place)
    low, last = gap.window()
    left, begin, end = np.arange(len(passing)), low.copy(), last.copy()
    while len(left):
        high = np.minimum(low + PIECE / motion.pace, last[left])
        to = _lowest(gap, left, low, high)
        met = (gap.at(to, left) <= 0) | (high >= last[left])
        begin[left[met]], end[left[met]] = low[met], to[met]
        left, low = left[~met], high[~met]
    time = _end_of(gap.at, np.arange(len(passing)), begin, end, above=True, halvings=halvings)
    return time, motion.at(time, place)[1]


def _lowest(gap: _Gap, i: Index, low: Array, high: Array) -> Array:
    """Where in pieces (low, high) the gap of granules i is least, as far as it matters: at the end, or in a dip that
    comes back above zero.
    """
    to = high.copy()
    dips = (gap.at(high, i) > 0) & (gap.rate(low, i) < 0) & (gap.rate(high, i) > 0)
    if dips.any():
        to[dips] = _end_of(gap.rate, i[dips], low[dips], high[dips], above=False, halvings=ROUGHLY)
    return to


def _end_of(
    value: Callable[[Array, Index], Array], i: Index, low: Array, high: Array, *, above: bool, halvings: int
) -> Array:
    """The time within (low, high) up to which a value is above zero, or not above; (n,), by bisection."""
    return halved_all(lambda time: (value(time, i) > 0) == above, low, high, halvings)[1]
