"""A granule's vertical fall through the channel's uniform air: how long it takes, and how fast it comes where.

One-dimensional exponential steps with the drag of their beginning: good to about 1 %, which is enough for bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..laws.constants import GRAVITY
from ..laws.drag import drag_laws, relaxed, slip_correction, terminal_velocity
from ..laws.forces.record import REACH
from ..scene import Air, Fraction, Scene

Array = NDArray[np.float64]
STEP = 0.01  # of the time that the whole fall takes about; chosen: an error of about 1 %
MAX_STEPS = 3000  # 30 times that: a granule that has not come through by then hangs in the air
MIN_LANDING = 0.1  # of the air speed: what a landing speed is at least taken for, where a granule nearly hangs


class FallPoint(NamedTuple):
    """A point of a fall, downward positive."""

    time: float  # s
    way: float  # m
    speed: float  # m/s


class Arrival(NamedTuple):
    """How a granule comes to the top of the first body."""

    time: float  # s from its release
    speed: float  # m/s, downward


@dataclass(frozen=True)
class FallTimes:
    """Times and speeds of a fall from the release to the channel's end, at rest at the body between."""

    whole: float  # s, from the release to the end
    time: float  # s, from the body to the end
    near: float  # s of that within REACH body widths of the body
    arrival: float  # m/s at the body
    landing: float  # m/s at the end
    tau: float  # s, mean relaxation time after the body


@dataclass(frozen=True)
class UniformFall:
    """A vertical fall of one granule through the channel's uniform air; downward is positive."""

    scene: Scene
    air: Air
    diameter: float  # m
    density: float  # kg/m3
    law: str  # of drag
    sphericity: float
    scale: float  # of the drag law, this granule's slip correction included

    @classmethod
    def of(cls, scene: Scene, fraction: Fraction, law: str, scale: float, diameter: float) -> UniformFall:
        """The fall of a granule of ``diameter`` (m), with the fraction's drag ``law`` times ``scale``."""
        factor, phi = scale / float(slip_correction(diameter)), fraction.sphericity or 1.0
        return cls(scene, scene.airstream, diameter, fraction.properties.density, law, phi, factor)

    @property
    def along(self) -> float:
        """Velocity of the air (m/s), downward positive."""
        return self.air.speed if self.air.direction == "down" else -self.air.speed

    @property
    def settling(self) -> float:
        """Terminal velocity (m/s), negative where it rises."""
        law = (self.air.density, self.air.viscosity, GRAVITY, self.law, self.sphericity, self.scale)
        return float(terminal_velocity(self.diameter, self.density, *law))

    def tau(self, slip: Array) -> Array:
        """Relaxation times (n,) s at slips (n,) m/s."""
        return self._granule.tau(slip)

    def times(self) -> FallTimes:
        """Times and speeds of the whole fall; without a body from the entry to the end."""
        scene, channel = self.scene, self.scene.channel
        top, speed = scene.level, scene.release[1]
        if scene.body:
            before, arrival = self.arrival()
            points = self.points(0.0, -channel.bottom, channel.top)
        else:
            before, arrival = 0.0, abs(speed)
            points = self.points(speed, top - channel.bottom, max(channel.top - top, channel.width))
        time, _, landing = points[-1]
        reach = REACH * scene.width
        near = next((t for t, way, _ in points if abs(way) >= reach), time) if scene.body else time
        speeds = np.array([point.speed for point in points])
        tau = float(np.mean(self.tau(np.abs(self.along - speeds))))
        return FallTimes(before + time, time, near, arrival, max(abs(landing), MIN_LANDING * abs(self.along)), tau)

    def arrival(self) -> Arrival:
        """At the top of the first body; without one at once."""
        above, speed = self.scene.release
        if above == 0.0:
            return Arrival(0.0, speed)
        room = max(self.scene.channel.top - self.scene.level - above, self.scene.width)
        time, _, arrival = self.points(speed, above, room)[-1]
        return Arrival(time, arrival)

    def points(self, speed: float, down: float, up: float) -> tuple[FallPoint, ...]:
        """Points of the fall that begins with ``speed`` (m/s), until it has come ``down`` or ``up`` (m)."""
        return _fall(self._granule, speed, down, up)

    @property
    def _granule(self) -> _Granule:
        own = self.diameter, self.density, self.law, self.sphericity, self.scale
        return _Granule(*own, self.along, self.air.density, self.air.viscosity)


class _Granule(NamedTuple):
    """What a fall depends on: the granule, and the air with its velocity ``along`` the fall."""

    diameter: float
    density: float
    law: str
    sphericity: float
    scale: float
    along: float
    air_density: float
    viscosity: float

    def tau(self, slip: Array) -> Array:
        reynolds = self.air_density * slip * self.diameter / self.viscosity
        factor = self.scale * drag_laws[self.law].factor(reynolds, self.sphericity)
        return self.density * self.diameter**2 / (18.0 * self.viscosity) / factor


@lru_cache(maxsize=1024)  # a plan asks for the same falls for its forces, its estimate of collisions and the slab
def _fall(granule: _Granule, speed: float, down: float, up: float) -> tuple[FallPoint, ...]:
    along, pull = granule.along, GRAVITY * (1.0 - granule.air_density / granule.density)
    least = min(down, up)
    step = STEP * min(math.sqrt(2.0 * least / GRAVITY), least / abs(along))
    time = way = 0.0
    points: list[FallPoint] = []
    while len(points) < MAX_STEPS and not (way >= down or way <= -up):
        tau = float(granule.tau(np.array([abs(along - speed)]))[0])
        further, speed = relaxed(speed, along + pull * tau, tau, step, math.exp(-step / tau))
        way += further
        time += step
        points.append(FallPoint(time, way, speed))
    return tuple(points)


def fall_speeds(scene: Scene, name: str, law: str, factor: float, diameter: float, drop: Array) -> Array:
    """Fall speeds (n,) m/s of a granule of ``diameter`` (m) after falling ``drop`` (n,) m from the feed, drag in the
    channel's uniform air (``factor`` times the ``law``) included; NaN where that carries it up before.
    """
    _, speed = scene.release
    if scene.air is None:
        return np.sqrt(speed**2 + 2.0 * GRAVITY * drop)
    fraction = scene.fraction[name]
    phi, density = fraction.sphericity or 1.0, fraction.properties.density
    fall = UniformFall(scene, scene.air, diameter, density, law, phi, factor)
    room = scene.channel.top - scene.channel.bottom + scene.release[0]
    rows = np.array([(0.0, 0.0, speed), *fall.points(speed, float(drop.max()), room)])
    down = rows[: int(rows[:, 1].argmax()) + 1]
    return np.asarray(np.interp(drop, down[:, 1], down[:, 2], right=np.nan))
