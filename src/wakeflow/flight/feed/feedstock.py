"""Feed, vibration and impact: from the falling curtain to granules in the field.

Injected (the paper's model): a granule falls straight down onto the slope under it, arrives with its own speed (drag
included), meets the body at the phase of the vibration that a uniform stream meets, and leaves by eq. (1)-(2) with the
velocity in the lab frame. Its first contact lies on the outline offset by its radius: a slope or a corner. Those that
the air would carry round the body (``planning.uniform_fall``) are released above it and tracked from there.

Resolved: all are released above the body and the tracker does the impact; for fractions that the air turns aside.

Without a body the curtain enters the channel at the feed's level.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from ... import flight as tracking
from ...air.field import FlowField
from ...core.geometry import edges, halved, normals
from ...laws.collision import approach_speed, scattered_rebound
from ...laws.constants import GRAVITY, STANDARD_AIR
from ...laws.drag import drag_factor_for_terminal_velocity, slip_correction
from ...laws.forces import forces
from ...laws.gas import MEAN_FREE_PATH
from ...laws.restitution import Restitution, restitution_at
from ...laws.size import normal_quantile
from ...planning.plan import REPLICATES, FractionPlan, Plan, replicate_size
from ...planning.uniform_fall import axis
from ...scene import Scene, Speeds, Vibration
from ...scene.changes import GranuleVariation
from .. import Granules
from ..granules import toss_of
from .first_contact import first_contact, motion_by, motion_of

Array = NDArray[np.float64]
MIXING = 1024  # shedding periods over which release times spread: their fraction cut off biases the phase that much
MIN_WAY = 0.01  # body widths over which an acceleration is taken from speeds
HALVINGS = 60  # of a bracket in time: to round-off
AS_GIVEN = GranuleVariation()
NO_TRAITS = np.zeros((0, 2))  # of granules that have nothing of their own
CLEARANCE = 1e-3  # of its radius: how far above a contact a resolved granule may start at the least


# -- Random numbers of granules at birth -------------------------------------------------------------------------------
ROUND_OFF = 1e-12  # quantiles keep that far from 0 and 1, where a distribution may be infinite
PLACED = 5  # random numbers of a granule at most that say where, when and how large: dimensions of its Sobol set
REMEMBERED = 2**13  # of such numbers, of as many granules at most: 20 MB in all
EVERY = slice(None)  # granule of a replicate
TRAITS = 4  # and those of what else is its own: restitution, friction, terminal velocity, angle at its first impact


def samples(
    name: str,
    count: int,
    seed: int,
    replicates: Sequence[int] = range(REPLICATES),
    dimensions: int = 4,
    part: slice = EVERY,
) -> tuple[Array, NDArray[np.int64]]:
    """Scrambled Sobol points (n, dimensions) in the unit cube of some ``replicates``, and the one each belongs to; of
    each replicate all granules, or a ``part``.

    The stream depends on the fraction's own name and on the replicate, not on the other fractions.
    """
    rows = range(replicate_size(count))[part]
    make = _remembered if len(rows) <= REMEMBERED else _points
    parts = [make(name, rows, seed, replicate, dimensions) for replicate in replicates]
    return np.concatenate(parts), np.repeat(np.asarray(replicates), len(rows))


def traits_of(name: str, count: int, seed: int, replicates: Sequence[int], part: slice = EVERY) -> Array:
    """Points (n, TRAITS) in the unit cube for what each granule has of its own, beside the first of ``samples``.

    They are the next dimensions of a Sobol set of their own: where and when granules are released is the same with them
    and without, so that the effect of a spread is seen between the same granules.
    """
    rows = range(replicate_size(count))[part]
    return np.concatenate(
        [_points(name, rows, seed, replicate, PLACED + TRAITS, 1)[:, PLACED:] for replicate in replicates]
    )


def blows_of(name: str, count: int, seed: int, replicates: Sequence[int], part: slice = EVERY) -> Array:
    """Standard normal numbers (n,), by which a flake is turned at its first impact."""
    size, number = replicate_size(count), zlib.crc32(name.encode())
    streams = (np.random.default_rng([seed, number, replicate, 2]) for replicate in replicates)
    return np.concatenate([stream.standard_normal(size)[part] for stream in streams])


def _points(name: str, rows: range, seed: int, replicate: int, dimensions: int, *apart: int) -> Array:
    """The points ``rows`` of one set; ``apart`` tells sets of one fraction and replicate from each other."""
    from scipy.stats import qmc

    source = np.random.default_rng([seed, zlib.crc32(name.encode()), replicate, *apart])
    sobol = qmc.Sobol(dimensions, scramble=True, rng=source)
    if rows.start:
        sobol.fast_forward(rows.start)
    points = sobol.random(len(rows))
    return np.asarray(np.clip(points, ROUND_OFF, 1 - ROUND_OFF))


_remembered = lru_cache(maxsize=64)(_points)  # a search flies the same granules through many scenes


# -- Granules as a draw of what is unknown has them --------------------------------------------------------------------
MAX_SCATTER = 1.0  # rad, as the tracker takes it


def varied_granules(grains: Granules, variation: GranuleVariation) -> Granules:
    """``grains`` with the variation's shift and factors; what leaves the range of a quantity ends at it."""
    restitution = grains.restitution
    by_law, change = isinstance(restitution, Restitution), variation.restitution
    return grains.replace(
        diameter=grains.diameter * variation.size,
        density=grains.density * variation.density,
        restitution=restitution.shifted(change) if by_law else np.clip(restitution + change, 0.0, 1.0),
        friction=grains.friction * variation.friction,
        scatter=np.minimum(grains.scatter * variation.scatter, MAX_SCATTER),
        drag_scale=grains.drag_scale * variation.drag,
        inertia=grains.inertia / variation.inverse_inertia,
        spin_lift=grains.spin_lift * variation.spin_lift,
    )


# -- Granules as they enter the field ----------------------------------------------------------------------------------
@dataclass(frozen=True)
class Feedstock:
    """One fraction's granules as they enter the field; which have met the body; which replicate each belongs to."""

    granules: Granules
    injected: NDArray[np.bool_]
    replicate: NDArray[np.int64]


def contact_points(outline: Array, x: Array, radius: Array) -> tuple[Array, Array]:
    """Where granules falling straight down at ``x`` (n,) with ``radius`` (n,) first touch the outline.

    Returns the height of their centres (n,), -inf where they fall past, and the unit outward normal (n, 2) there. The
    surface is the outline offset by the radius: straight over the faces, round at the corners.
    """
    height = np.full(x.shape, -np.inf)
    normal = np.tile([0.0, 1.0], (len(x), 1))
    starts, ends = edges(outline)
    for start, end, outward in zip(starts, ends, normals(outline), strict=True):
        if outward[1] <= 0:
            continue
        foot = x - outward[0] * radius
        y = start[1] + (foot - start[0]) * (end[1] - start[1]) / (end[0] - start[0]) + outward[1] * radius
        higher = (foot <= start[0]) & (foot >= end[0]) & (y > height)
        height[higher], normal[higher] = y[higher], outward
    for corner in outline:
        across = (x - corner[0]) / radius
        with np.errstate(invalid="ignore"):
            y = corner[1] + radius * np.sqrt(1.0 - across**2)  # NaN beside the corner compares false
        higher = y > height
        height[higher] = y[higher]
        normal[higher] = np.stack([across, np.sqrt(np.clip(1.0 - across**2, 0.0, 1.0))], axis=1)[higher]
    return height, normal


def arrival(scene: Scene, plan: FractionPlan, grains: Granules, drop: Array, speed: Array) -> Array:
    """Speed of fall (n,) m/s after falling ``drop`` (n,) m from ``speed`` (n,) m/s in the channel's uniform air.

    NaN where they never get there (carried up). The same tracker and laws as everywhere, in a column of
    uniform flow; in a vacuum in closed form.
    """
    if scene.air is None:
        return np.sqrt(speed**2 + 2 * scene.gravity * np.maximum(drop, 0.0))
    reach = max((float(np.ptp(scene.outline[:, 1])) if scene.body else 0.0) + scene.release[0], scene.width) + 1.0
    higher = np.ceil(np.log2((float(drop.max(initial=0.0)) + 0.5) / reach))
    reach *= 2.0 ** max(0.0, higher)  # the same for any part of the granules
    flow = scene.air.speed if scene.air.rises else -scene.air.speed
    if not scene.plumb.upright:
        flow = 0.0  # what it falls before it comes into the channel is outside, where the air rests
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, reach), (-1.0, reach)])
    column = FlowField.from_arrays(
        corners,
        np.array([(0, 1, 2), (0, 2, 3)]),
        np.tile([0.0, flow], (4, 1)),
        pressure=np.zeros(4),
        density=scene.air.density,
        viscosity=scene.air.viscosity,
    )
    still = grains.replace(
        position=np.stack([np.full(drop.shape, 0.3), drop], axis=1),  # off the column's diagonal and its nodes
        velocity=np.stack([np.zeros(drop.shape), -speed], axis=1),
        time=np.zeros(len(drop)),
    )
    level = np.array([(-1.0, 0.0), (1.0, 0.0)])
    tracks = tracking.track(
        column, still, until=1e3, tolerance=1e-6, length=scene.width, drag=plan.drag, lines=(level,),
        forces=[force for force in plan.forces if forces[force].calm], gravity=(0.0, -scene.gravity),
    )  # fmt: skip
    return np.where(tracks.line == 0, -tracks.velocity[:, 1], np.nan)


def fall_start(scene: Scene, radius: Array) -> tuple[Array, Array]:
    """Heights (n,) m of the centres where the fall of granules of ``radius`` (n,) m to the first body begins, clear of
    it, and the fall speeds (n,) m/s there.
    """
    above, _ = scene.release
    level = np.maximum(above, (1.0 + CLEARANCE) * radius)
    fall = scene.feed.speed or 0.0
    return scene.level + level, np.sqrt(
        np.maximum(0.0, fall**2 - 2 * scene.gravity * level) if fall else np.zeros(radius.shape)
    )


def _times(scene: Scene, points: Array, field_period: float) -> Array:
    """Times (s) of a stream that is uniform over the vibration's and the shedding's periods, from points (n, 2); 0 in a
    channel without a body.
    """
    if not scene.body:
        return np.zeros(len(points))
    if scene.vibration is None:
        return points[:, 0] * field_period
    period = scene.vibration.period
    if scene.feed.start == "resting":
        points = np.stack([np.full(len(points), _dead_point(scene.vibration) / period), points[:, 1]], axis=1)
    whole = int(np.ceil(MIXING * field_period / period)) if field_period else 1
    return period * (np.floor(points[:, 1] * whole) + points[:, 0])


def _dead_point(vibration: Vibration) -> float:
    """Time (s) within the first period at which the vibrating body stands still at its lowest along the vibration."""
    motion, period, along = motion_by(vibration), vibration.period, vibration.along
    if vibration.samples is None:
        return 0.75 * period
    times = np.linspace(0.0, period, 4097)
    lowest = int(np.argmin(motion.at(times)[0] @ along))
    bracket = times[max(lowest - 1, 0)], times[min(lowest + 1, len(times) - 1)]
    return float(halved(lambda time: motion.at(time)[1] @ along < 0.0, *bracket, HALVINGS)[1])


def _lying(scene: Scene, x: Array, radius: Array) -> Array:
    """Centres (n, 2) m of granules that lie on the body at its lower dead point, where all is at rest in the lab."""
    lying = np.stack([x, contact_points(scene.outline, x, radius)[0]], axis=1)
    vibration = scene.vibration
    return lying if vibration is None else lying + motion_by(vibration).at(_dead_point(vibration), lying)[0]


def granules_of(
    scene: Scene, name: str, plan: FractionPlan, diameter: Array, settling: Array | None = None,
    traits: Array = NO_TRAITS,
) -> Granules:  # fmt: skip
    """Granules of ``diameter`` (n,) m with a fraction's properties and drag, at rest at the origin; ``settling`` (n,)
    m/s: each granule's own terminal velocity where it was measured, in standard air; ``traits`` (n, 2) in the unit
    square, of its restitution and friction, without which all have the middle ones.
    """
    origin, fraction = np.zeros((len(diameter), 2)), scene.fraction[name]
    properties, scale = fraction.properties, np.asarray(plan.drag_scale)
    if settling is not None:
        law, air = plan.drag, (*STANDARD_AIR, GRAVITY)
        scale = drag_factor_for_terminal_velocity(diameter, properties.density, settling, *air, law, fraction.roundness)
        scale = scale * slip_correction(diameter)
    scale = scale / slip_correction(diameter, MEAN_FREE_PATH if scene.air is None else scene.air.mean_free_path)
    restitution = friction = None
    if len(traits):
        restitution = fraction.coefficients("restitution", traits[:, 0])
        friction = fraction.coefficients("friction", traits[:, 1])
    return Granules(
        position=origin,
        velocity=origin,
        diameter=diameter,
        density=properties.density,
        sphericity=fraction.roundness,
        restitution=properties.restitution if restitution is None else restitution,
        friction=properties.friction if friction is None else friction,
        drag_scale=scale,
        inertia=fraction.inertia,
        scatter=properties.rebound_scatter,
        tangential_restitution=properties.tangential_restitution,
        capture_speed=fraction.capture_speed or (0.0 if fraction.sticks is None else np.inf),
        sticks=1.0 if fraction.sticks is None else fraction.sticks,
        shape=fraction.shape,
        flake=fraction.flake,
    )


@dataclass(frozen=True)
class Curtain:
    """Granules of a fraction that hang over the machine, at rest, at ``x`` (n,) m as if the channel stood upright; when
    each starts is in them. ``chance`` (n,): by which its shape turns the first wall it meets; ``blows``: makes what
    turns a flake there, (n,) as of :func:`~wakeflow.laws.flake.flung`.
    """

    scene: Scene
    plan: FractionPlan
    grains: Granules
    x: Array
    chance: Array
    blows: Callable[[], Array]


Entered = tuple[Granules, NDArray[np.bool_]]  # and which of them have met the body
ENTERED = ("position", "velocity", "time", "spin", "arrival")  # what an impact changes


def feedstock(
    scene: Scene,
    plan: Plan,
    name: str,
    field_period: float,
    replicates: Sequence[int] = range(REPLICATES),
    variation: GranuleVariation = AS_GIVEN,
    part: slice = EVERY,
) -> Feedstock:
    """The granules of one fraction as they enter the field; ``field_period`` (s) of a time-resolved airflow, or 0.

    ``replicates``: only those, and of each a ``part``, the same granules as among all, but for what a ``variation``
    changes of each.
    """
    points, traits, replicate, born = _born(scene, plan.fractions[name], name, replicates, part)
    grains = varied_granules(born, variation).replace(time=_times(scene, points[:, 2:], field_period))
    blows = partial(blows_of, name, scene.feed.count, scene.feed.seed, replicates, part)
    curtain = Curtain(scene, plan.fractions[name], grains, scene.feed.places(points[:, 0]), traits[:, 3], blows)
    granules, met = entered(curtain)
    return Feedstock(hung(scene, granules), met, replicate)


def entered(curtain: Curtain) -> Entered:
    """How a curtain comes into the field, in one of four ways: into a channel without a body at the feed's level, lying
    on the body at its lower dead point, from the first impact, or above the body, which the tracker lets them meet.
    """
    scene, grains = curtain.scene, curtain.grains
    if not scene.body:
        grains = entering(scene, grains, curtain.x, curtain.chance)
    elif scene.feed.start == "resting":
        grains = grains.replace(position=_lying(scene, curtain.x, grains.diameter / 2))
    elif curtain.plan.mode == "injected":
        return struck(curtain)
    else:
        grains = released_above(curtain)
    return grains, np.zeros(len(grains), dtype=bool)


def released_above(curtain: Curtain) -> Granules:
    """The granules of a curtain above the body, at the level where their fall begins."""
    fall = fall_start(curtain.scene, 0.5 * curtain.grains.diameter)
    position, velocity = released(curtain.scene, curtain.plan, curtain.grains, curtain.x, *fall)
    return curtain.grains.replace(position=position, velocity=velocity, arrival=velocity)


def struck(curtain: Curtain) -> Entered:
    """The granules that meet the body, from their first impact; the others from above it."""
    scene, plan, x, grains = curtain.scene, curtain.plan, curtain.x, released_above(curtain)
    level, speed = fall_start(scene, 0.5 * grains.diameter)
    height, normal = contact_points(scene.outline, x, grains.diameter / 2)
    meets = np.isfinite(height)
    if plan.impaction is not None:
        meets &= plan.impaction.meets(grains.diameter, x - axis(scene))
    fall = arrival(scene, plan, grains, level - np.where(meets, height, level - 1.0), speed)
    met = meets & np.isfinite(fall)
    i, entered = np.flatnonzero(met), {key: getattr(grains, key).copy() for key in ENTERED}
    pull = _pull(scene, plan, grains[i], level[i] - height[i], speed[i], fall[i])
    entered["time"][i], wall = first_contact(fall[i], normal[i], grains.time[i], motion_of(scene), pull)
    since = entered["time"][i] - grains.time[i]
    came = fall[i] + pull * since
    entered["position"][i, 1] = height[i] - since * (fall[i] + 0.5 * pull * since)
    entered["arrival"][i, 1] = -came
    entered["velocity"][i], entered["spin"][i] = _rebound(
        grains[i], came, normal[i], wall, curtain.chance[i], curtain.blows()[i]
    )
    return grains.replace(**entered), met


def _born(
    scene: Scene, plan: FractionPlan, name: str, replicates: Sequence[int], part: slice
) -> tuple[Array, Array, NDArray[np.int64], Granules]:
    """Random numbers (n, 4 or more) of where and when granules come and of what each has of its own (n, TRAITS), the
    replicate (n,) of each, and the granules, at rest at the origin.
    """
    fraction, feed = scene.fraction[name], scene.feed
    measured = isinstance(fraction.terminal_velocity, Speeds)
    points, replicate = samples(name, feed.count, feed.seed, replicates, PLACED if measured else 4, part)
    traits = np.zeros((len(points), TRAITS))
    if fraction.varies or feed.scatter > 0.0:
        traits = traits_of(name, feed.count, feed.seed, replicates, part)
    settling = fraction.settling(points[:, 4] if measured else traits[:, 2])
    diameter = fraction.diameters(points[:, 1])
    return points, traits, replicate, granules_of(scene, name, plan, diameter, settling, traits[:, :2])


def _pull(scene: Scene, plan: FractionPlan, grains: Granules, drop: Array, speed: Array, fall: Array) -> Array:
    """Downward acceleration (n,) m/s2 with which granules come to the slope: over the way that a vibration adds."""
    if scene.vibration is None or not len(drop):
        return np.zeros(len(drop))
    if scene.air is None:
        return np.full(len(drop), scene.gravity)
    way = max(float(np.linalg.norm(scene.motion[0])), MIN_WAY * scene.width)
    later = arrival(scene, plan, grains, drop + way, speed)
    return np.nan_to_num((later**2 - fall**2) / (2 * way), nan=0.0)


def entering(scene: Scene, grains: Granules, x: Array, chance: Array) -> Granules:
    """The curtain where there is no body: at the feed's level, with the velocity it has there, turned by an angle that
    the part ``chance`` (n,) of all angles lies below; as if the channel stood upright.
    """
    y = np.minimum(scene.level, highest(scene, grains, x))
    velocity = np.broadcast_to(scene.plumb.hung(scene.entry), (len(x), 2))
    if scene.feed.scatter > 0.0:
        turn = np.exp(1j * scene.feed.scatter * normal_quantile(chance)) * (velocity[:, 0] + 1j * velocity[:, 1])
        velocity = np.stack([turn.real, turn.imag], axis=1)
    return grains.replace(position=np.stack([x, y], axis=1), velocity=velocity)


def highest(scene: Scene, grains: Granules, x: Array) -> Array:
    """The height (n,) m up to which granules of the feed at ``x`` (n,) m are in the channel; as if it stood upright."""
    return scene.plumb.highest(x, 0.5 * grains.diameter, 1e-6 * scene.width)


def hung(scene: Scene, grains: Granules) -> Granules:
    """Granules of a feed that falls along -y, as they come where gravity is at an angle to the channel."""
    plumb = scene.plumb
    if plumb.upright:
        return grains
    came = None if grains.arrival is None else plumb.turned(grains.arrival)
    position, velocity = plumb.placed(grains.position), plumb.turned(grains.velocity)
    return grains.replace(position=position, velocity=velocity, arrival=came)


def _rebound(
    grains: Granules, fall: Array, normal: Array, wall: Array, chance: Array, xi: Array
) -> tuple[Array, Array]:
    """Velocity (n, 2) m/s and spin (n,) rad/s of granules falling straight down on walls of unit ``normal`` (n, 2),
    which the shape of each turns by an angle that the part ``chance`` (n,) of all angles lies below; ``xi`` (n,) as of
    :func:`~wakeflow.laws.flake.flung`.
    """
    falling = np.stack([np.zeros(len(fall)), -fall], axis=1)
    e = restitution_at(grains.restitution, approach_speed(0.0, -fall, *normal.T, *wall.T))
    angle = grains.scatter * normal_quantile(chance) if grains.scatter.any() else grains.scatter
    velocity, spin, _ = scattered_rebound(
        falling, np.zeros(len(fall)), normal, wall, e, grains.friction, 1.0 / grains.inertia, grains.diameter / 2,
        grains.tangential_restitution, angle, toss_of(grains), xi,
    )  # fmt: skip
    return velocity, spin


def released(
    scene: Scene, plan: FractionPlan, grains: Granules, x: Array, level: Array, speed: Array
) -> tuple[Array, Array]:
    """Where granules that the tracker takes from the start begin: at ``level``, or where they come into the channel."""
    top = highest(scene, grains, x)
    velocity = np.stack([np.zeros(len(x)), -speed], axis=1)
    above = np.flatnonzero(level > top)
    if len(above):
        fall = arrival(scene, plan, grains[above], (level - top)[above], speed[above])
        velocity[above, 1] = -np.nan_to_num(fall, nan=0.0)
    return np.stack([x, np.minimum(level, top)], axis=1), velocity
