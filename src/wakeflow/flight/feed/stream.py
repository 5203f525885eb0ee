"""The feed of a slab: every granule of a stretch of operation, in the order in which it comes.

Granules come as a Poisson process, each fraction at its own rate and independently of the others: what a feeder does
that mixes well and neither doses nor clogs. Sizes, given by mass, are drawn by number, for each of these granules is a
real one. What is too fine for that comes as tracers, of which each represents many granules and for the same mass.

A curtain that starts at rest is infinitely dense where it starts. The slab begins where it has fallen FALLEN of its way
down to the body, each granule as it comes there alone, spread by the air's turbulence; no two overlap
where they are born. A fraction's law of restitution is taken at that speed.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ... import flight as tracking
from ...air.field import FlowField
from ...core.errors import known
from ...laws.flake import section
from ...laws.restitution import Restitution, restitution_at
from ...planning.collisions import MASS_LEVELS, CollisionPlan, number_rates
from ...planning.plan import FractionPlan, Plan
from ...scene import Scene
from ...scene.changes import AS_GIVEN, GranuleVariation, Variation
from .. import Granules
from .feedstock import entering, fall_start, granules_of, highest, hung, released, varied_granules

Array = NDArray[np.float64]
FALLEN = 0.4  # of the way to the body, where granules from rest have come apart; chosen
FALLS = 2048  # granules of a fraction whose fall to the slab is computed; more of them begin as one of these
LONGEST, TOLERANCE = 10.0, 1e-3  # s, and body widths, of that fall
ROUNDS = 200  # in which granules that overlap at birth are given other places, before the feed counts as too dense


@dataclass(frozen=True)
class SlabFeed:
    """The granules that one replicate of a slab is fed with, by time of birth.

    ``fraction`` (n,) is each one's place among the scene's; ``mass`` (n,) kg what it represents; ``counted``
    (n,) whether it came in steady operation. ``granules.fraction``
    is the same place, plus the number of fractions for ``tracers``.
    """

    granules: Granules
    fraction: NDArray[np.int64]
    mass: Array
    counted: NDArray[np.bool_]
    tracers: tuple[int, ...]


def slab_stream(
    scene: Scene,
    plan: Plan,
    field: FlowField | None,
    replicate: int,
    *,
    begin: float,
    start_up: float,
    operation: float,
    depth: float,
    part: float = 1.0,
    variation: Variation = AS_GIVEN,
) -> SlabFeed:
    """The feed of one ``replicate`` of a slab of ``depth`` (m): from ``begin`` (s) on for the ``start_up`` (s), the
    ``operation`` (s) that counts, and as long again as the start-up, until what counts has landed among others; its
    granules as a ``variation`` has them. Of a ``part`` of the depth those that come there in the whole slab.
    """
    rng = np.random.default_rng([scene.feed.seed, zlib.crc32(b"slab"), replicate])
    source = _Source(scene, plan, known(plan.collisions), field, rng, operation + 2.0 * start_up, depth)
    given = [(number, name, variation.of(name)) for number, name in enumerate(scene.fraction)]
    parts = [source.fed(*row, tracers=tracers) for row in given for tracers in (False, True)]
    order = np.argsort(np.concatenate([part.granules.time for part in parts]), kind="stable")
    granules = _joined([part.granules for part in parts])[order]
    fraction, mass = (np.concatenate([getattr(part, key) for part in parts])[order] for key in ("fraction", "mass"))
    tracers = tuple(
        len(scene.fraction) + i for i, name in enumerate(scene.fraction) if source.collisions.tracers[name] > 0.0
    )
    granules = granules.replace(depth=depth * rng.random(len(granules)))
    granules = _apart(rng, granules, len(scene.fraction), depth, scene.gravity)
    if part < 1.0:  # which has other neighbours across its ends
        kept = np.flatnonzero(granules.depth < part * depth)
        granules = _apart(rng, granules[kept], len(scene.fraction), part * depth, scene.gravity)
        fraction, mass = fraction[kept], mass[kept]
    since = granules.time
    granules = hung(scene, granules.replace(time=begin + since))
    counted = (since >= start_up) & (since < start_up + operation)
    return SlabFeed(granules, fraction, mass, counted, tracers)


@dataclass(frozen=True)
class _Source:
    """Where the granules of a slab of ``depth`` (m) come from over the ``whole`` time (s) that it is fed."""

    scene: Scene
    plan: Plan
    collisions: CollisionPlan
    field: FlowField | None
    rng: np.random.Generator
    whole: float
    depth: float

    def fed(self, number: int, name: str, variation: GranuleVariation, *, tracers: bool) -> SlabFeed:
        """The real granules, or the tracers, of one fraction; times from 0, unsorted."""
        scene, rng, fraction = self.scene, self.rng, self.scene.fraction[name]
        time, p = self._tracers(name) if tracers else self._singles(name, variation)
        drawn = rng.permutation(len(p))[:FALLS] if len(p) > FALLS else np.arange(len(p))
        diameter = fraction.diameters(p[drawn])
        traits = rng.random((len(drawn), 3))
        settling, how = fraction.settling(traits[:, 2]), self.plan.fractions[name]
        grains = varied_granules(granules_of(scene, name, how, diameter, settling, traits[:, :2]), variation)
        x = scene.feed.places(rng.random(len(drawn)))
        grains = self._born(how, grains, x, int(rng.integers(2**62)))
        if len(p) > FALLS:
            grains = grains[rng.integers(FALLS, size=len(p))]
        diameter = grains.diameter
        grains = grains.replace(time=time, fraction=number + (len(scene.fraction) if tracers else 0))
        if isinstance(grains.restitution, Restitution):
            grains = grains.replace(restitution=restitution_at(grains.restitution, np.abs(grains.velocity[:, 1])))
        mass = np.pi / 6.0 * grains.density * diameter**3
        if tracers and len(p):
            flow = scene.feed.mass_flow * scene.mass_shares()[name] * self.depth / scene.feed.depth  # kg/s
            mass = np.full(len(p), self.collisions.tracers[name] * flow * self.whole / len(p))
        return SlabFeed(grains, np.full(len(p), number), mass, np.zeros(len(p), dtype=bool), ())

    def _singles(self, name: str, variation: GranuleVariation) -> tuple[Array, Array]:
        """Times (s) and mass quantiles of the granules that are simulated one by one: a Poisson process, of larger
        granules a slower one, since the mass that is fed is given.
        """
        rates = number_rates(self.scene, name) * self.depth / self.scene.feed.depth / variation.size**3
        rates[: round(self.collisions.tracers[name] * MASS_LEVELS)] = 0.0
        total = float(rates.sum())
        if total == 0.0:
            return np.zeros(0), np.zeros(0)
        time = self.whole * self.rng.random(self.rng.poisson(total * self.whole))
        level = self.rng.choice(MASS_LEVELS, len(time), p=rates / total)
        return time, (level + self.rng.random(len(time))) / MASS_LEVELS

    def _tracers(self, name: str) -> tuple[Array, Array]:
        """Times (s) and mass quantiles of tracers, so many that those that count are as many as the plan says."""
        collisions, fine = self.collisions, self.collisions.tracers[name]
        if fine == 0.0:
            return np.zeros(0), np.zeros(0)
        count = round(collisions.count / collisions.replicates * self.whole / collisions.operation)
        time = self.whole * (np.arange(count) + self.rng.random(count)) / count
        return time, fine * self.rng.random(count)

    def _born(self, how: FractionPlan, grains: Granules, x: Array, seed: int) -> Granules:
        """Granules where the slab begins, as they come there alone from where the feed does."""
        scene, field = self.scene, self.field
        if not scene.body:
            chance = np.random.default_rng(seed).random(len(x)) if scene.feed.scatter > 0.0 else x
            return entering(scene, grains, x, chance)
        plumb = scene.plumb
        level, speed = fall_start(scene, 0.5 * grains.diameter)
        start = slab_top(scene, grains, x)
        if field is None or not len(x):
            falls = -np.sqrt(speed**2 + 2.0 * scene.gravity * (level - start))
            velocity = np.stack([np.zeros(len(x)), falls], axis=1)
            return grains.replace(position=np.stack([x, start], axis=1), velocity=velocity)
        position, velocity = released(scene, how, grains, x, level, speed)
        low = float(start.min())
        line = plumb.placed(np.array([(-scene.channel.width, low), (scene.channel.width, low)]))
        whole = np.linspace(0.0, field.period, len(x), endpoint=False)
        fall = tracking.track(
            field, hung(scene, grains.replace(position=position, velocity=velocity, time=whole)), until=LONGEST,
            tolerance=TOLERANCE, length=scene.width, drag=how.drag, forces=how.forces, lines=(line,), seed=seed,
            gravity=scene.plumb.gravity,
        )  # fmt: skip
        comes = (fall.line == 0)[:, None]  # upward air does not let others come so far: they begin where the feed does
        fallen, speeds = plumb.seen(fall.position), plumb.hung(fall.velocity)
        return grains.replace(position=np.where(comes, fallen, position), velocity=np.where(comes, speeds, velocity))


def slab_top(scene: Scene, grains: Granules, x: Array) -> Array:
    """Height (n,) m at which granules of the feed at ``x`` (n,) m enter the slab, as they come there alone; as if the
    channel stood upright.
    """
    level, _ = fall_start(scene, 0.5 * grains.diameter)
    return np.minimum(level - FALLEN * (level - scene.level), highest(scene, grains, x))


def _apart(rng: np.random.Generator, grains: Granules, tracers: int, depth: float, gravity: float) -> Granules:
    """The granules of a slab of ``depth`` (m) where no two overlap when they are born, ``tracers`` (those of so high a
    fraction) with any. The later one of a pair that would is given another place, as often as it takes.
    """
    solid = np.flatnonzero(grains.fraction < tracers)
    if len(solid) < 2:
        return grains
    x, z = grains.position[:, 0].copy(), grains.depth.copy()
    width = grains.diameter[solid] * section(grains.shape[solid], grains.flake[solid])[1]
    speed = np.maximum(np.abs(grains.velocity[solid, 1]), np.sqrt(gravity * width))
    ahead = float(speed.min()) * grains.time[solid]  # way that separates those born later, at least
    for _ in range(ROUNDS):
        later = _overlapping(np.stack([x[solid], ahead, z[solid]], axis=1), width, depth)
        if not len(later):
            break
        x[solid[later]] = x[_alike(rng, grains.fraction, solid[later])]
        z[solid[later]] = depth * rng.random(len(later))
    return grains.replace(position=np.stack([x, grains.position[:, 1]], axis=1), depth=z)


def _alike(rng: np.random.Generator, fraction: NDArray[np.int64], some: NDArray[np.int64]) -> NDArray[np.int64]:
    """Any granule of the same ``fraction`` for each of ``some``."""
    return np.array([rng.choice(np.flatnonzero(fraction == fraction[granule])) for granule in some], dtype=np.int64)


def _overlapping(points: Array, width: Array, depth: float) -> NDArray[np.int64]:
    """The later one of every pair of spheres at ``points`` (n, 3) m, of ``width`` (n,) m, that overlap; the third
    coordinate is periodic.
    """
    from scipy.spatial import cKDTree

    low = points.min(axis=0)
    extent = points.max(axis=0) - low + 4.0 * float(width.max())  # only the third coordinate comes round
    box = np.array([extent[0], extent[1], depth])
    pairs = cKDTree(np.mod(points - low, box), boxsize=box).query_pairs(float(width.max()), output_type="ndarray")
    if not len(pairs):
        return np.zeros(0, dtype=np.int64)
    apart = points[pairs[:, 0]] - points[pairs[:, 1]]
    apart[:, 2] -= depth * np.round(apart[:, 2] / depth)
    touch = np.linalg.norm(apart, axis=1) < 0.5 * (width[pairs[:, 0]] + width[pairs[:, 1]])
    return np.unique(pairs[touch].max(axis=1))


def _joined(parts: list[Granules]) -> Granules:
    """The granules of several fractions as one; they have no places across the slab yet, and remember no impact."""
    names = [field.name for field in fields(Granules) if field.name not in ("depth", "arrival")]
    return Granules(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
