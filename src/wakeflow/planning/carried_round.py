"""What the air before the body does to a fraction, and injection leaves out: granules carried round, others turned.

Each size of a fraction is flown through the ideal flow before the body (``laws.impaction``) with its own drag, weight
and fall speed, and falls straight beside it; both leave the slope by the collision law and fly to the floor in
uniform air. The difference is what injection would get wrong; it decides whether a fraction is injected or resolved.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..core.lazy import cached_property
from ..core.record import column
from ..laws.collision import approach_speed, collide
from ..laws.drag import drag_laws, relaxation_time, relaxed, slip_correction
from ..laws.impaction import Front, Impaction, Met, approach, fronts
from ..laws.restitution import restitution_at
from ..scene import Scene

Array = NDArray[np.float64]
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
    turned, straight = (
        _at(approached, _landing(scene, name, kind, contacts), np.abs(places))
        for contacts in (approached.turned, approached.straight)
    )
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


def _landing(scene: Scene, name: str, kind: _Kind, contacts: Met) -> Array:
    """How far off the axis (n, m) m granules land that met the face in ``contacts``: they leave the face, which is at
    rest, by the collision law, fly through uniform air, and bounce off the face again and off the channel's walls.
    """
    front, rim = front_of(scene), 0.5 * np.array(kind.diameters)[:, None]
    floor, air = scene.level - scene.channel.bottom, complex(scene.airstream.speed)
    z, v = contacts.z.copy(), _bounced(scene, name, rim, contacts.v, contacts.normal)
    step = 2.0 * np.sqrt(2.0 * floor / scene.gravity) / FALL_STEPS
    for _ in range(FALL_STEPS):
        tau = kind.relax(np.abs(air - v))
        way, after = relaxed(v, air + kind.pull * tau, tau, step, np.exp(-step / tau))
        away = front.away(z + way)
        meets = front.inside(z + way) & (z.real < front.depth) | (np.abs(away) < rim * CLOSE)
        part = np.where(way.real > 0.0, np.clip((floor - z.real) / np.maximum(way.real, 1e-300), 0.0, 1.0), 1.0)
        if meets.any():
            normal = front.away(z)
            after = np.where(meets, _bounced(scene, name, rim, v, normal / np.maximum(np.abs(normal), 1e-300)), after)
        z, v = np.where(meets, z, z + part * way), after
        if np.all(z.real >= floor * (1.0 - 1e-12)):
            break
    wall = 0.5 * scene.channel.width
    return np.asarray(wall - np.abs((z.imag + wall) % (4.0 * wall) - 2.0 * wall))


def _bounced(scene: Scene, name: str, radius: Array, v: Complex, normal: Array | Complex) -> Complex:
    fraction = scene.fraction[name]
    granule = fraction.properties
    ways = v.real, v.imag, normal.real, normal.imag, 0.0, 0.0
    e = restitution_at(granule.restitution, approach_speed(*ways))
    vx, vy, *_ = collide(
        *ways[:2], 0.0, *ways[2:], e, granule.friction, 1.0 / fraction.inertia, radius,
    )  # fmt: skip
    return np.asarray(vx + 1j * vy)
