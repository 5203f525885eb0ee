"""Where down is: gravity at an angle to the channel, and the feed, which hangs with it.

Coordinates are the channel's, which stands upright in them; a tilt turns gravity. The feed is described as in an
upright channel, as a curtain that falls along -y, and turns with gravity about the middle of the curtain at the feed's
level. An upright channel's points and velocities are given back as they are, to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..laws.constants import GRAVITY

Array = NDArray[np.float64]
CLEAR = 1e-3  # of its radius: how far from the wall beside it a granule may begin at the least
ALONG = 1e-9  # sine of the angle to a border below which a line never comes to it: round-off


@dataclass(frozen=True)
class Plumb:
    """Gravity turned by ``tilt`` (rad) from -y towards +x; ``pivot`` (m): the point about which the feed turns;
    ``left``, ``right``, ``low``, ``high`` (m) of the channel; ``strength`` of gravity (m/s2).
    """

    tilt: float
    pivot: tuple[float, float]
    left: float
    right: float
    low: float
    high: float
    strength: float = GRAVITY

    @property
    def upright(self) -> bool:
        """Whether gravity points down the channel's axis."""
        return self.tilt == 0.0

    @property
    def down(self) -> Array:
        """Unit vector (2,) of gravity."""
        return np.array([math.sin(self.tilt), -math.cos(self.tilt)])

    @property
    def across(self) -> Array:
        """Unit vector (2,) at a right angle to gravity; +x in an upright channel."""
        return np.array([math.cos(self.tilt), math.sin(self.tilt)])

    @property
    def gravity(self) -> tuple[float, float]:
        """m/s2."""
        return self.strength * float(self.down[0]), self.strength * float(self.down[1])

    def turned(self, velocity: Array) -> Array:
        """Velocities (..., 2) of a feed that falls along -y, as they are in the channel."""
        return velocity if self.upright else velocity @ np.array([self.across, -self.down])

    def placed(self, points: Array) -> Array:
        """Points (..., 2) m of a feed that falls along -y, where they are in the channel."""
        return points if self.upright else self.turned(points - self.pivot) + self.pivot

    def hung(self, velocity: Array) -> Array:
        """Velocities (..., 2) in the channel as they are where gravity points along -y: undoes :meth:`turned`."""
        return velocity if self.upright else velocity @ np.array([self.across, -self.down]).T

    def seen(self, points: Array) -> Array:
        """Points (..., 2) m in the channel as they are where gravity points along -y: undoes :meth:`placed`."""
        return points if self.upright else self.hung(points - self.pivot) + self.pivot

    def way(self, direction: Array) -> float:
        """How far (m) it is from the pivot to the channel's border along a unit vector (2,)."""
        (x, y), (right, up) = self.pivot, direction.tolist()
        ends = (self.left if right < 0.0 else self.right) - x, (self.low if up < 0.0 else self.high) - y
        ways = [end / part for end, part in zip(ends, (right, up), strict=True) if abs(part) > ALONG]
        return max(0.0, float(min(ways)))

    def highest(self, x: Array, radius: Array, slack: float) -> Array:
        """Up to which height y (n,) m of the upright feed its granules at ``x`` (n,) m, of ``radius`` (n,) m, lie in
        the channel, ``slack`` (m) below its top and clear of the wall that gravity leads away from.
        """
        top = self.high - slack
        if self.upright:
            return np.full(len(x), top)
        (sine, cosine), off = self.down * (1.0, -1.0), x - self.pivot[0]
        room = np.full(len(x), np.inf)
        if cosine > ALONG:
            room = (top - self.pivot[1] - off * sine) / cosine
        wall = self.pivot[0] - self.left if sine > 0.0 else self.right - self.pivot[0]
        side = wall - (1.0 + CLEAR) * radius + math.copysign(1.0, sine) * off * cosine
        if abs(sine) > ALONG:
            room = np.minimum(room, side / abs(sine))
        return self.pivot[1] + room
