"""A granule's fall through the channel's uniform air: how long it takes, and how fast it comes where.

Along gravity; where that is at an angle to the channel the air blows the granule across as well. Exponential steps
with the drag of their beginning: good to about 1 %, which is enough for bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_laws, relaxed, slip_correction, terminal_velocity
from ..laws.forces.force import REACH
from ..scene import Fraction, Scene

Array = NDArray[np.float64]
REYNOLDS = np.geomspace(1e-9, 1e8, 4096)  # of the table of terminal velocities; its error is below 1e-5
STEP = 0.01  # of the time that the whole fall takes about; chosen: an error of about 1 %
MAX_STEPS = 3000  # 30 times that: a granule that has not come through by then hangs in the air
MIN_LANDING = 0.1  # of the air speed: what a landing speed is at least taken for, where a granule nearly hangs


class FallPoint(NamedTuple):
    """A point of a fall; way and speed along gravity, downward positive."""

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


class FallingGranule(NamedTuple):
    """A granule, and the air that it falls through, with its velocity (m/s) ``along`` gravity, downward positive, and
    ``across`` it.
    """

    diameter: float  # m
    density: float  # kg/m3
    law: str  # of drag
    sphericity: float
    scale: float  # of the drag law, this granule's slip correction included
    along: float
    across: float
    air_density: float
    viscosity: float
    gravity: float

    @property
    def settling(self) -> float:
        """Terminal velocity (m/s), negative where it rises."""
        law = self.air_density, self.viscosity, self.gravity, self.law, self.sphericity, self.scale
        return float(terminal_velocity(self.diameter, self.density, *law))

    def tau(self, slip: Array) -> Array:
        """Relaxation times (n,) s at slips (n,) m/s."""
        reynolds = self.air_density * slip * self.diameter / self.viscosity
        factor = self.scale * drag_laws[self.law].factor(reynolds, self.sphericity)
        return self.density * self.diameter**2 / (18.0 * self.viscosity) / factor


@dataclass(frozen=True)
class UniformFall:
    """A fall of one ``granule`` through the channel's uniform air, of ``speed`` (m/s), in a ``scene``; downward, along
    gravity, is positive.
    """

    scene: Scene
    granule: FallingGranule
    speed: float

    @classmethod
    def of(
        cls, scene: Scene, fraction: Fraction, law: str, scale: float, diameter: float, *, part: float = 1.0
    ) -> UniformFall:
        """The fall of a granule of ``diameter`` (m), with the fraction's drag ``law`` times ``scale``, in this ``part``
        of the air's speed.
        """
        slip = float(slip_correction(diameter, scene.airstream.mean_free_path))
        return cls.by_factor(scene, fraction, law, scale / slip, diameter, part=part)

    @classmethod
    def by_factor(
        cls, scene: Scene, fraction: Fraction, law: str, factor: float, diameter: float, *, part: float = 1.0
    ) -> UniformFall:
        """The same with the ``factor`` on the law that this granule has, its slip correction included."""
        air, tilt = scene.airstream, scene.channel.tilt
        speed = part * air.speed
        blows = speed if air.direction == "down" else -speed
        own = diameter, fraction.properties.density, law, fraction.roundness, factor
        wind = blows * math.cos(tilt), -blows * math.sin(tilt)
        return cls(scene, FallingGranule(*own, *wind, air.density, air.viscosity, scene.gravity), speed)

    def times(self) -> FallTimes:
        """Times and speeds of the whole fall; without a body from the entry to the end."""
        scene, speed = self.scene, self.scene.release[1]
        before, arrival = self.arrival() if scene.body else (0.0, abs(speed))
        points = self.points(0.0 if scene.body else speed, self.room)
        time, _, landing = points[-1]
        reach = REACH * scene.width
        near = next((t for t, way, _ in points if abs(way) >= reach), time) if scene.body else time
        speeds = np.array([point.speed for point in points])
        tau = float(np.mean(self.granule.tau(np.abs(self.granule.along - speeds))))
        return FallTimes(before + time, time, near, arrival, max(abs(landing), MIN_LANDING * self.speed), tau)

    @property
    def room(self) -> FallRoom:
        """What a granule can fall through from the body, or from its entry without one."""
        scene, channel, tilt = self.scene, self.scene.channel, self.scene.channel.tilt
        if scene.plumb.upright and scene.body:
            return FallRoom(-channel.bottom, channel.top)
        down, up = scene.level - channel.bottom, max(channel.top - scene.level, channel.width)
        if scene.plumb.upright:
            return FallRoom(down, up)
        x, half = scene.feed.position, 0.5 * channel.width
        return FallRoom(down, up, half - x, half + x, tilt)

    def arrival(self) -> Arrival:
        """At the top of the first body; without one at once."""
        above, speed = self.scene.release
        if above == 0.0:
            return Arrival(0.0, speed)
        room = max(self.scene.channel.top - self.scene.level - above, self.scene.width)
        time, _, arrival = self.points(speed, FallRoom(above, room))[-1]
        return Arrival(time, arrival)

    def points(self, speed: float, room: FallRoom) -> tuple[FallPoint, ...]:
        """Points of the fall that begins with ``speed`` (m/s) along gravity, until it has come to the room's end."""
        return _fall(self.granule, speed, room)


class FallRoom(NamedTuple):
    """How far (m) a fall can go down, up, right and left, along axes that lean by ``tilt`` (rad) against gravity."""

    down: float
    up: float
    right: float = math.inf
    left: float = math.inf
    tilt: float = 0.0

    def holds(self, way: complex) -> bool:
        """Whether a fall is still inside after a ``way`` (m), along gravity and, its imaginary part, across."""
        if not self.tilt:
            return -self.up < way.real < self.down
        way *= complex(math.cos(self.tilt), math.sin(self.tilt))
        return -self.up < way.real < self.down and -self.left <= way.imag <= self.right


@lru_cache(maxsize=1024)  # a plan asks for the same falls for its forces, its estimate of collisions and the slab
def _fall(granule: FallingGranule, speed: float, room: FallRoom) -> tuple[FallPoint, ...]:
    """Along gravity in real numbers; where the air blows across, that is the imaginary part."""
    pull = granule.gravity * (1.0 - granule.air_density / granule.density)
    air: Any = complex(granule.along, granule.across) if granule.across else granule.along
    least = min(room.down, room.up)
    passing = least / abs(air) if air != 0.0 else math.inf
    step = STEP * min(math.sqrt(2.0 * least / granule.gravity), passing)
    time, way, velocity = 0.0, air * 0.0, air * 0.0 + speed
    points: list[FallPoint] = []
    while not points or (len(points) < MAX_STEPS and room.holds(way)):
        tau = float(granule.tau(np.array([abs(air - velocity)]))[0])
        further, velocity = relaxed(velocity, air + pull * tau, tau, step, math.exp(-step / tau))
        way += further
        time += step
        points.append(FallPoint(time, way.real, velocity.real))
    return tuple(points)


def fall_speeds(scene: Scene, name: str, law: str, factor: float, diameter: float, drop: Array) -> Array:
    """Fall speeds (n,) m/s of a granule of ``diameter`` (m) after falling ``drop`` (n,) m from the feed, drag in the
    channel's uniform air (``factor`` times the ``law``) included; NaN where that carries it up before.
    """
    _, speed = scene.release
    if scene.air is None:
        return np.sqrt(speed**2 + 2.0 * scene.gravity * drop)
    fall = UniformFall.by_factor(scene, scene.fraction[name], law, factor, diameter)
    room = scene.channel.top - scene.channel.bottom + scene.release[0]
    rows = np.array([(0.0, 0.0, speed), *fall.points(speed, FallRoom(float(drop.max()), room))])
    down = rows[: int(rows[:, 1].argmax()) + 1]
    return np.asarray(np.interp(drop, down[:, 1], down[:, 2], right=np.nan))


def settling_air(scene: Scene) -> tuple[float, float]:
    """Density (kg/m3) and viscosity (Pa s) of the air of terminal velocities: the scene's, or standard air."""
    return STANDARD_AIR if scene.air is None else (scene.air.density, scene.air.viscosity)


def settling_velocities(
    diameter: Array, density: float, drag: Array, law: str, sphericity: float, air: tuple[float, float],
    gravity: float = GRAVITY,
) -> Array:  # fmt: skip
    """Terminal velocities (n,) m/s of granules of ``diameter`` (n,) m with the factors ``drag`` (n,) on their drag
    ``law``, in ``air`` of a density (kg/m3) and a viscosity (Pa s); nan of what does not sink.

    The same root as :func:`wakeflow.laws.drag.terminal_velocity`, from a table of f(Re) Re, for very many granules.
    """
    rho, mu = air
    table = np.log(drag_laws[law].factor(REYNOLDS, np.full(REYNOLDS.shape, sphericity)) * REYNOLDS)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.log(rho * (density - rho) * gravity * diameter**3 / (18.0 * mu**2 * drag))
    return np.asarray(np.exp(np.interp(weight, table, np.log(REYNOLDS))) * mu / (rho * diameter))
