"""Feed, vibration and impact: from the falling curtain to granules in the field.

Injected (the paper's model): a granule falls straight down onto the slope under it, arrives with its own speed (drag
included), meets the body at the phase of the vibration that a uniform stream meets, and leaves by eq. (1)-(2) with the
velocity in the lab frame. Its first contact lies on the outline offset by its radius: a slope or a corner.

Resolved: it is released above the body and the tracker does the impact; for granules that the air turns aside.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .field import FlowField
from .geometry import edges, normals
from .laws.collision import bounce
from .planning import FractionPlan, Plan
from .scene import GRAVITY, Fraction, Scene
from .tracking import Granules, track

__all__ = ["REPLICATES", "Feedstock", "arrival", "feedstock", "first_contact"]

Array = NDArray[np.float64]
REPLICATES = 16  # independent randomised samples a fraction: 15 degrees of freedom for the interval
MIXING = 1024  # shedding periods over which release times spread: their fraction cut off biases the phase that much
CLEARANCE = 1e-3  # of the body's width: how far above a contact a resolved granule may start at the least


@dataclass(frozen=True)
class Feedstock:
    """One fraction's granules as they enter the field; which replicate each belongs to; which have met the body."""

    granules: Granules
    replicate: NDArray[np.int64]
    injected: NDArray[np.bool_]


def _samples(name: str, count: int, seed: int) -> tuple[Array, NDArray[np.int64]]:
    """Scrambled Sobol points (n, 4) in the unit cube, and the replicate each belongs to; n >= count.

    Sobol sets are balanced for powers of two, so each replicate has that many; the stream depends on the
    fraction's own name only, not on the other fractions.
    """
    from scipy.stats import qmc

    power = max(0, int(np.ceil(np.log2(count / REPLICATES))))
    parts = []
    for replicate in range(REPLICATES):
        source = np.random.default_rng([seed, zlib.crc32(name.encode()), replicate])
        parts.append(qmc.Sobol(4, scramble=True, rng=source).random_base2(power))
    points = np.clip(np.concatenate(parts), 1e-12, 1 - 1e-12)
    return points, np.repeat(np.arange(REPLICATES), 2**power)


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


def arrival(scene: Scene, plan: Plan, how: FractionPlan, grains: Granules, drop: Array, speed: float) -> Array:
    """Downward speed (n,) m/s of granules after falling ``drop`` (n,) m from ``speed`` in the channel's uniform air.

    NaN where they never get there (carried up). The same tracker and laws as everywhere, in a column of
    uniform flow.
    """
    reach = float(drop.max()) + 1.0
    if scene.air is None:
        column = None
    else:
        flow = -scene.air.speed if scene.air.direction == "down" else scene.air.speed
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
        velocity=np.tile([0.0, -speed], (len(drop), 1)),
        time=np.zeros(len(drop)),
    )
    level = np.array([(-1.0, 0.0), (1.0, 0.0)])
    tracks = track(
        column, still, until=1e3, tolerance=1e-6, length=scene.width, forces=plan.forces, drag=how.drag, lines=(level,),
        gravity=(0.0, -GRAVITY),
    )  # fmt: skip
    return np.where(tracks.line == 0, -tracks.velocity[:, 1], np.nan)


def first_contact(
    fall_speed: Array, normal: Array, passing: Array, amplitude: Array, omega: float
) -> tuple[Array, Array]:
    """When granules first meet a slope that moves by ``amplitude`` (2,) sin(omega t), and the wall's velocity then.

    ``fall_speed`` (n,) straight down, ``normal`` (n, 2), ``passing`` (n,): the time each would touch the slope at rest.
    It touches at the first root of  V_n (t - passing) + a_n sin(omega t), V_n its approach speed, a_n the
    amplitude along the normal. While omega a_n < V_n there is one root, and a stream uniform in ``passing`` meets the
    phases with density 1 + V_eta / V_0; above that earlier crests cast shadows, and the first root is looked for.
    """
    approach = fall_speed * normal[:, 1]
    across = normal @ amplitude

    def gap(t: Array) -> Array:
        return -approach * (t - passing) - across * np.sin(omega * t)

    swing = np.abs(across)
    low, high = passing - swing / approach, passing + swing / approach  # above the highest crest, below the lowest
    if omega > 0:
        low, high = _first_descent(gap, low, high, approach, across, omega)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = gap(middle) > 0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return high, (omega * np.cos(omega * high))[:, None] * amplitude


def _first_descent(
    gap: Callable[[Array], Array], low: Array, high: Array, approach: Array, across: Array, omega: float
) -> tuple[Array, Array]:
    """The first falling stretch of the gap that ends below zero, within [low, high]; all of it where it only falls.

    The gap has its minima where cos(omega t) = -V_n / (omega a_n), once a period, and a maximum before each.
    """
    turns = np.abs(across) * omega > approach
    angle = np.arccos(np.clip(-approach / np.where(turns, np.abs(across) * omega, approach), -1.0, 1.0))
    shift = np.where(across < 0, np.pi, 0.0)
    minimum = (angle - shift + 2 * np.pi * np.ceil((omega * low - angle + shift) / (2 * np.pi))) / omega
    searching = turns.copy()
    while searching.any():
        reached = searching & ((gap(minimum) <= 0) | (minimum >= high))
        low = np.where(reached, np.maximum(low, minimum - 2 * angle / omega), low)
        high = np.where(reached, np.minimum(high, minimum), high)
        searching &= ~reached
        minimum = minimum + 2 * np.pi / omega
    return low, high


def _start(scene: Scene, top: float, radius: float) -> tuple[float, float]:
    """Height (m) of the centres where the fall begins, and the fall speed (m/s) there.

    With feed.speed the curtain begins at most one body width above the body, with the speed that makes
    feed.speed of it at the body's top.
    """
    least = (1.0 + CLEARANCE) * radius
    if scene.feed.height is not None:
        return top + max(scene.feed.height, least), 0.0
    assert scene.feed.speed is not None
    above = float(np.clip(scene.feed.speed**2 / (2 * GRAVITY), least, max(least, scene.width)))
    return top + above, float(np.sqrt(max(0.0, scene.feed.speed**2 - 2 * GRAVITY * above)))


def _times(scene: Scene, points: Array, field_period: float | None) -> Array:
    """Times (s) of a stream that is uniform over the vibration's and the shedding's periods, from points (n, 2)."""
    if scene.vibration is None:
        return points[:, 0] * (field_period or 0.0)
    period = 1.0 / scene.vibration.frequency
    whole = int(np.ceil(MIXING * field_period / period)) if field_period else 1
    return period * (np.floor(points[:, 1] * whole) + points[:, 0])


def _granules(fraction: Fraction, how: FractionPlan, diameter: Array) -> Granules:
    origin = np.zeros((len(diameter), 2))
    properties = fraction.properties
    return Granules(
        position=origin,
        velocity=origin,
        diameter=diameter,
        density=properties.density,
        sphericity=fraction.sphericity or 1.0,
        restitution=properties.restitution,
        friction=properties.friction,
        drag_scale=how.drag_scale,
    )


def feedstock(scene: Scene, plan: Plan, name: str, field_period: float | None) -> Feedstock:
    """The granules of one fraction as they enter the field; ``field_period`` (s) of a time-resolved airflow."""
    fraction, how = scene.fraction[name], plan.fractions[name]
    outline = next(iter(scene.body.values())).outline()
    points, replicate = _samples(name, scene.feed.count, scene.feed.seed)
    x = scene.feed.position + scene.feed.width * (points[:, 0] - 0.5)
    diameter = fraction.diameters(points[:, 1])
    grains = _granules(fraction, how, diameter)
    level, speed = _start(scene, float(outline[:, 1].max()), 0.5 * float(diameter.max()))
    position, velocity = _released(scene, plan, how, grains, x, level, speed)
    time = _times(scene, points[:, 2:], field_period)
    injected = np.zeros(len(x), dtype=bool)
    if how.mode == "injected":
        height, normal = contact_points(outline, x, diameter / 2)
        meets = np.isfinite(height)
        fall = arrival(scene, plan, how, grains, level - np.where(meets, height, level - 1.0), speed)
        injected = meets & np.isfinite(fall)
        i = np.flatnonzero(injected)
        amplitude, omega = scene.motion
        passing = time[i].copy()
        time[i], wall = first_contact(fall[i], normal[i], passing, amplitude, omega)
        position[i] = np.stack([x[i], height[i] - fall[i] * (time[i] - passing)], axis=1)
        falling = np.stack([np.zeros(len(i)), -fall[i]], axis=1)
        velocity[i] = bounce(falling, normal[i], wall, grains.restitution[i], grains.friction[i])
    return Feedstock(grains.replace(position=position, velocity=velocity, time=time), replicate, injected)


def _released(
    scene: Scene, plan: Plan, how: FractionPlan, grains: Granules, x: Array, level: float, speed: float
) -> tuple[Array, Array]:
    """Where granules that the tracker takes from the start begin: at ``level``, or at the channel's top below it."""
    top = scene.channel.top - 1e-6 * scene.width
    velocity = np.tile([0.0, -speed], (len(x), 1))
    if level > top:
        fall = arrival(scene, plan, how, grains, np.full(len(x), level - top), speed)
        velocity[:, 1] = -np.nan_to_num(fall, nan=0.0)
    return np.stack([x, np.full(len(x), min(level, top))], axis=1), velocity
