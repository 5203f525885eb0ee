"""What moves in pictures: the bodies, and recorded tracks, at any time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import distance_to, halved
from ..core.tables import AnyArray
from ..flight.feed.first_contact import motion_of

if TYPE_CHECKING:
    from ..scene import Scene

Array = NDArray[np.float64]
TOUCH = 1e-3  # of its radius: a recorded point nearer than that to a body is a contact


def body_displacement(scene: Scene, time: Array, place: Array | tuple[float, float] = (0.0, 0.0)) -> Array:
    """Where the bodies are off the middle of their vibration, (n, 2) m at times (n,) s; of bodies that rock, what is at
    the ``place`` (n, 2) m then.
    """
    return motion_of(scene).at(time, place)[0]


def seen_from_body(scene: Scene, time: Array, position: Array) -> Array:
    """Where (n, 2) m what is at ``position`` (n, 2) m at times (n,) s lies about a body in the middle of its motion."""
    return position + motion_of(scene).opposite.at(time, position)[0]


def along(cubics: Array, part: Array, span: Array) -> tuple[Array, Array]:
    """Positions (k, 2) m and velocities (k, 2) m/s on ``cubics`` (4, k, 2) m, of which each lasts a ``span`` (k,) s,
    after a ``part`` (k,) of it.
    """
    s, (start, first, second, third) = part[:, None], cubics
    slope = first + s * (2.0 * second + 3.0 * s * third)
    velocity = np.divide(slope, span[:, None], out=np.zeros_like(slope), where=span[:, None] > 0)
    return start + s * (first + s * (second + s * third)), velocity


@dataclass(frozen=True)
class Path2D:
    """One recorded track: time (m,) s, position (m, 2) m, velocity (m, 2) m/s, that before an impact ``arriving``
    (m, 2) m/s, the granule's diameter (m).

    Between two points it is the cubic of their positions and velocities (Hermite's): exact under constant acceleration,
    of fourth order in the time between them under any other.
    """

    time: Array
    position: Array
    velocity: Array
    arriving: Array
    diameter: float

    @classmethod
    def of(cls, track: Mapping[str, AnyArray]) -> Path2D:
        time, position, velocity, arriving = (track[key] for key in ("time", "position", "velocity", "arriving"))
        return cls(time, position, velocity, arriving, float(track["diameter"]))

    def cubics(self, i: NDArray[np.int64]) -> Array:
        """Coefficients, by which 1, s, s^2 and s^3 are multiplied, of the pieces from points ``i`` (k,) to the next
        ones, (4, k, 2) m, where s goes from 0 to 1.

        Along a body the velocity at the end is that of the second point; in front of an impact that before it. The one
        is taken that is nearer to what constant acceleration makes of the velocity at the first point.
        """
        span, way = (self.time[i + 1] - self.time[i])[:, None], self.position[i + 1] - self.position[i]
        first, struck, arriving = span * self.velocity[i], span * self.velocity[i + 1], span * self.arriving[i + 1]
        near = 2.0 * way - first
        before = np.linalg.norm(arriving - near, axis=1) < np.linalg.norm(struck - near, axis=1)
        last = np.where(before[:, None], arriving, struck)
        return np.stack([self.position[i], first, 3.0 * way - 2.0 * first - last, first + last - 2.0 * way])

    def at(self, time: Array) -> tuple[Array, Array]:
        """Positions (k, 2) m and velocities (k, 2) m/s at ``time`` (k,) s; before and after the track, its ends."""
        moments = np.clip(time, self.time[0], self.time[-1])
        if len(self.time) < 2:
            return np.tile(self.position[0], (len(moments), 1)), np.tile(self.velocity[0], (len(moments), 1))
        i = np.clip(np.searchsorted(self.time, moments, side="right") - 1, 0, len(self.time) - 2)
        span = self.time[i + 1] - self.time[i]
        part = np.divide(moments - self.time[i], span, out=np.zeros_like(span), where=span > 0)
        return along(self.cubics(i), part, span)

    def moments(self, step: float) -> Array:
        """Times (k,) s, those of the recorded points among them, between which it comes about a ``step`` (m) far."""
        way = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        pieces = np.maximum(1, np.ceil(way / step)).astype(int)
        begins = np.repeat(self.time[:-1], pieces)
        number = np.arange(len(begins)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        return np.append(begins + number * np.repeat(np.diff(self.time) / pieces, pieces), self.time[-1])

    def touches(self, scene: Scene) -> NDArray[np.int64]:
        """The recorded points at which it touches a body, in order."""
        seen = seen_from_body(scene, self.time, self.position)
        near = np.full(len(self.time), np.inf)
        for body in scene.body.values():
            near = np.minimum(near, distance_to(seen, body.outline()))
        return np.flatnonzero(near <= (1.0 + TOUCH) * self.diameter / 2)

    def falls_to(self, level: float, first: int) -> float:
        """Time (s) at which it first comes down to y = ``level`` (m) after recorded point ``first``; infinite where it
        never does.
        """
        below = np.flatnonzero(self.position[first:, 1] <= level)
        if not len(below) or below[0] == 0:
            return math.inf
        low, high = self.time[first + below[0] - 1], self.time[first + below[0]]
        return float(halved(lambda time: self.at(np.array([time]))[0][0, 1] > level, low, high, 60)[1])
