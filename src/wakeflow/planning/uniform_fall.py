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

from ..core.lazy import cached_property
from ..core.record import column
from ..laws.collision import approach_speed, collide
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_laws, relaxation_time, relaxed, slip_correction, terminal_velocity
from ..laws.forces.force import REACH
from ..laws.impaction import Front, Impaction, Met, approach, fronts
from ..laws.restitution import Restitution, restitution_at
from ..scene import Fraction, Scene

Array = NDArray[np.float64]
REYNOLDS = np.geomspace(1e-9, 1e8, 4096)  # of the table of terminal velocities; its error is below 1e-5
STEP_PART = 0.01  # of the time that the whole fall takes about; chosen: an error of about 1 %
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
        """The fall with the ``factor`` on the law that this granule has, its slip correction included."""
        air, tilt = scene.airstream, scene.channel.tilt
        speed = part * air.speed
        blows = speed if air.direction == "down" else -speed
        granule = diameter, fraction.properties.density, law, fraction.roundness, factor
        wind = blows * math.cos(tilt), -blows * math.sin(tilt)
        return cls(scene, FallingGranule(*granule, *wind, air.density, air.viscosity, scene.gravity), speed)

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
        """Arrival at the top of the first body; without one at once."""
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
    """Fall along gravity in real numbers; where the air blows across, that is the imaginary part."""
    pull = granule.gravity * (1.0 - granule.air_density / granule.density)
    air: Any = complex(granule.along, granule.across) if granule.across else granule.along
    least = min(room.down, room.up)
    passing = least / abs(air) if air != 0.0 else math.inf
    step = STEP_PART * min(math.sqrt(2.0 * least / granule.gravity), passing)
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


# -- What the air before the body does to a fraction: granules carried round, others turned ----------------------------
# Each size of a fraction is flown through the ideal flow before the body (``laws.impaction``) with its own drag, weight
# and fall speed, and falls straight beside it; both leave the slope by the collision law and fly to the floor in
# uniform air. The difference is what injection would get wrong; it decides whether a fraction is injected or resolved.
Complex = NDArray[np.complex128]
# How finely a fraction is sampled; chosen
SIZES = 6  # mass classes of a fraction
PLACES = 257  # quantiles of the curtain
FALL_STEPS = 200  # of the flight from the slope to the floor, in twice the time of a free fall
STRAIGHT = 0.1  # share missed, and body widths of landing shift, below which a fraction passes as falling straight:
# chosen, a tenth is lost beside the factors in the bounds
CLOSE = 0.999  # radii off the face: nearer, a granule bounces; chosen just below 1, where it stands after a bounce
WIDEST = 1e-9  # of the width, within which corners count as the highest or the widest: round-off
WITHIN = 0.95  # share of the mass whose landings the stated shift holds for


@dataclass(frozen=True)
class Deflection:
    """What the air does to a fraction before the first body."""

    efficiency: float = column("1", "mass that meets the body over mass that would, falling straight")
    missed: float = column("1", "share of the mass that would fall on the body and is carried round it")
    shift: float = column("body widths", "95 % of those that meet it land within that of where they would otherwise")
    diameters: tuple[float, ...] = column("m", "sizes for which reach is given")
    reach: tuple[float, ...] = column("m", "how far off the axis granules of each size still meet the body")

    @property
    def straight(self) -> bool:
        """Whether nearly all meet the body, nearly as if there were no air, and are thrown out to its side."""
        return self.missed < STRAIGHT and self.shift < STRAIGHT

    def meets(self, diameter: Array, offset: Array) -> NDArray[np.bool_]:
        """Which granules of ``diameter`` (n,) m that begin ``offset`` (n,) m off the axis meet the body."""
        return np.abs(offset) < np.interp(np.log(diameter), np.log(self.diameters), self.reach)


def axis(scene: Scene) -> float:
    """x (m) of the first body's top, which parts the curtain."""
    outline = scene.outline
    return float(outline[np.isclose(outline[:, 1], outline[:, 1].max(), atol=WIDEST * scene.width), 0].mean())


def front_of(scene: Scene) -> Front:
    """The ideal flow before the first body: the registered front of its shape, else the wedge of its size."""
    body = next(iter(scene.body.values()))
    outline = body.outline()
    x, y = outline.T
    widest = y[np.isclose(np.abs(x - 0.5 * (x.min() + x.max())), 0.5 * np.ptp(x), rtol=WIDEST)].max()
    make = fronts[body.shape] if body.shape in fronts else fronts["wedge"]
    return make(
        half=0.5 * float(np.ptp(x)), depth=float(y.max() - widest), channel=0.5 * scene.channel.width,
        speed=scene.airstream.speed,
    )  # fmt: skip


def deflection(scene: Scene, name: str, law: str, scale: float) -> Deflection | None:
    """What the air does to fraction ``name`` before the first body; drag by ``law`` times ``scale``.

    None without air or body, where gravity is at an angle to the air, and where the air comes from below: the slopes
    that granules fall on then lie in the wake.
    """
    if scene.air is None or scene.air.rises or not scene.body or not scene.plumb.upright:
        return None
    fraction, air = scene.fraction[name], scene.air
    share = (np.arange(SIZES) + 0.5) / SIZES
    diameters, count = np.unique(fraction.diameters(share), return_counts=True)
    granule = _Kind(
        tuple(diameters.tolist()), fraction.properties.density, law, fraction.roundness, scale,
        air.density, air.viscosity, air.mean_free_path, scene.gravity,
    )  # fmt: skip
    approached = _approached(front_of(scene), granule, *scene.release)
    weight = count / SIZES
    places = scene.feed.places((np.arange(PLACES) + 0.5) / PLACES) - axis(scene)
    full = approached.reach / approached.efficiency
    would = np.abs(places) < full[:, None]
    hits = np.abs(places) < approached.reach[:, None]
    return Deflection(
        efficiency=float(weight @ approached.efficiency),
        missed=float(weight @ np.mean(would & ~hits, axis=1)),
        shift=_landing_shift(scene, name, granule, approached, weight, places, hits),
        diameters=granule.diameters,
        reach=tuple(approached.reach.tolist()),
    )


@dataclass(frozen=True)
class _Kind:
    """Granules of one fraction, several sizes, and the air they are in."""

    diameters: tuple[float, ...]
    density: float
    law: str
    sphericity: float
    scale: float
    air_density: float
    viscosity: float
    mean_free_path: float
    gravity: float

    @property
    def pull(self) -> float:
        return self.gravity * (1.0 - self.air_density / self.density)

    def relax(self, slip: Array) -> Array:
        """Relaxation times (n, m) s of the n sizes at slips (n, m) m/s."""
        reynolds, slowest = self._scales
        return slowest / drag_laws[self.law].factor(reynolds * slip, self.sphericity)

    @cached_property
    def _scales(self) -> tuple[Array, Array]:
        """Reynolds numbers (n, 1) at 1 m/s, and relaxation times (n, 1) s at no slip."""
        d = np.array(self.diameters)[:, None]
        still = relaxation_time(d, self.density, self.viscosity) * slip_correction(d, self.mean_free_path) / self.scale
        return self.air_density * d / self.viscosity, still


@lru_cache(maxsize=256)
def _approached(front: Front, kind: _Kind, above: float, speed: float) -> Impaction:
    radius = 0.5 * np.array(kind.diameters)
    return approach(front, above=above, speed=speed, radius=radius, relax=kind.relax, pull=kind.pull)


def _landing_shift(
    scene: Scene, name: str, kind: _Kind, approached: Impaction, weight: Array, places: Array, hits: NDArray[np.bool_]
) -> float:
    """The 95th percentile, by mass, of the landing shifts (body widths) of those that meet the body; 0 if none does."""
    if not hits.any():
        return 0.0
    fraction = scene.fraction[name]
    below = _Below(
        scene.level - scene.channel.bottom, scene.airstream.speed, 0.5 * scene.channel.width,
        fraction.properties.restitution, fraction.properties.friction, fraction.inertia,
    )  # fmt: skip
    landings = _landings(front_of(scene), kind, scene.release, below)
    turned, straight = (_at(approached, landing, np.abs(places)) for landing in landings)
    mass = np.broadcast_to(weight[:, None], hits.shape)[hits]
    shift = np.abs(turned - straight)[hits] / scene.width
    order = np.argsort(shift)
    passed = np.cumsum(mass[order])
    return float(shift[order][min(np.searchsorted(passed, WITHIN * passed[-1]), len(order) - 1)])


def _at(approached: Impaction, values: Array, offset: Array) -> Array:
    """``values`` (n, m) of granules that start at ``approached.start``, at the offsets (k,) of others: (n, k). Only of
    those that met the face; beyond the last of them its value.
    """
    every = []
    for start, of_size, hit in zip(approached.start, values, approached.turned.hit, strict=True):
        every.append(np.interp(offset, start[hit], of_size[hit]) if hit.any() else np.zeros(len(offset)))
    return np.array(every)


@dataclass(frozen=True)
class _Below:
    """Where granules fly that leave the face, and how they rebound: it lies ``floor`` m above the channel's, in air of
    a ``speed`` (m/s), with ``wall`` m on either side.
    """

    floor: float
    speed: float
    wall: float
    restitution: float | Restitution
    friction: float
    inertia: float

    def bounced(self, radius: Array, v: Complex, normal: Array | Complex) -> Complex:
        """Velocities after a blow on a face at rest."""
        ways = v.real, v.imag, normal.real, normal.imag, 0.0, 0.0
        e = restitution_at(self.restitution, approach_speed(*ways))
        vx, vy, *_ = collide(*ways[:2], 0.0, *ways[2:], e, self.friction, 1.0 / self.inertia, radius)
        return np.asarray(vx + 1j * vy)


@lru_cache(maxsize=256)  # a search for settings plans the same machine again and again
def _landings(front: Front, kind: _Kind, release: tuple[float, float], below: _Below) -> tuple[Array, Array]:
    """How far off the axis (n, m) m granules land that the air turned before they met the face, and those that flew
    straight: they leave it, which is at rest, by the collision law, fly through uniform air, and bounce off the face
    again and off the channel's walls.
    """
    approached = _approached(front, kind, *release)
    turned, straight = (_landing(front, kind, below, met) for met in (approached.turned, approached.straight))
    return turned, straight


def _landing(front: Front, kind: _Kind, below: _Below, contacts: Met) -> Array:
    rim, floor = 0.5 * np.array(kind.diameters)[:, None], below.floor
    z, v = contacts.z.copy(), below.bounced(rim, contacts.v, contacts.normal)
    step = 2.0 * np.sqrt(2.0 * floor / kind.gravity) / FALL_STEPS
    for _ in range(FALL_STEPS):
        tau = kind.relax(np.abs(complex(below.speed) - v))
        way, after = relaxed(v, below.speed + kind.pull * tau, tau, step, np.exp(-step / tau))
        away = front.away(z + way)
        meets = front.inside(z + way) & (z.real < front.depth) | (np.abs(away) < rim * CLOSE)
        part = np.where(way.real > 0.0, np.clip((floor - z.real) / np.maximum(way.real, 1e-300), 0.0, 1.0), 1.0)
        if meets.any():
            normal = front.away(z)
            after = np.where(meets, below.bounced(rim, v, normal / np.maximum(np.abs(normal), 1e-300)), after)
        z, v = np.where(meets, z, z + part * way), after
        if np.all(z.real >= floor * (1.0 - 1e-12)):
            break
    return np.asarray(below.wall - np.abs((z.imag + below.wall) % (4.0 * below.wall) - 2.0 * below.wall))
