"""The slab in which granules meet: a piece of the machine, periodic across the picture, fed at the true rate.

The plan says how deep it is, which granules in it are real ones, and for how long it runs. What decides whether it is
flown at all is the bound on ``collisions`` (``bounds``), a term like any other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.quantities import metres
from ..core.record import column
from ..scene import Fraction, Scene
from .uniform_fall import UniformFall

Array = NDArray[np.float64]
DIAMETERS = 15.0  # of the coarsest granules: default depth of the slab
MANY_IN_FLIGHT = 500.0  # granules at a time, below which the slab is made deeper: they come in fewer steps; chosen
CLOCK = 20.0  # granules whose steps take as long as a step of the clock itself
MASS_LEVELS = 512  # parts of equal mass that a size distribution is taken apart into
MAX_IN_FLIGHT = 1e4  # granules of a fraction that are simulated one by one; chosen, for the run time
LIGHT = 1e-4  # of the mass of the heaviest fraction's granules: lighter ones turn nobody, and fly as tracers; chosen
WORTHWHILE = 0.5  # of a fraction's mass: a coarse part that holds less is not worth its granules
SAMPLES, MAX_REPLICATES = 4, 16  # fewest that an interval is reported from; most that are flown
MIN_RAREST_GRANULES = 16.0  # granules of the rarest fraction in a replicate, in the mean: seldom none
EXPECTED_STEP = 1e-4  # s: that a granule of some mm is stepped by
STEPS_A_SECOND = 5.2e6  # such granule steps a second and core: measured with all forces, in steps as long as allowed
MAX_STEPS = 1.2e9  # granule steps of all replicates: some four minutes on two such cores; chosen
CORES = 2
BYTES_A_GRANULE = 1000.0  # of memory
NO_RATE = "the scene gives no feed.rate; give one, or --force collisions=on takes 1 kg/s per metre of depth"


@dataclass(frozen=True)
class CollisionPlan:
    """The slab in which granules meet. Each replicate is fed for as long again as it counts, until the last granule
    that counts has landed.
    """

    depth: float = column("m", "depth of the slab across the picture, periodic")
    tracers: Mapping[str, float] = column(
        "1", "share of each fraction's mass, its finest granules, that fly as tracers"
    )
    in_flight: Mapping[str, float] = column("1", "granules of each fraction that are simulated one by one, at a time")
    replicates: int = column("1", "independent runs of the slab, at most")
    fewest: int = column("1", "replicates that fly at least; more if they make the shares noticeably better known")
    start_up: float = column("s", "start-up of each, estimated; dropped")
    operation: float = column("s", "time of each that counts; at least")
    count: int = column("1", "tracers of a fraction that count, over all replicates")
    seconds: float = column("s", "run time expected of all replicates, on two cores")
    memory: float = column("bytes", "memory expected")

    def after(self, flown: int) -> int:
        """How many replicates fly where so many are not enough: half as many more."""
        return min(self.replicates, flown + 2 * max(1, flown // 4))


def why_no_collisions(scene: Scene, *, switched: bool = False) -> str:
    """Why no slab can be flown for a scene; empty where it can. ``switched``: for by hand."""
    if scene.feed.start == "resting":
        return "granules that start at rest on the body are no stream: they have no feed rate"
    return "" if scene.feed.rate or switched else NO_RATE


def too_many_to_collide(scene: Scene, laws: Mapping[str, tuple[str, float]]) -> str:
    """Why no slab can be flown at this feed rate: of the fraction with the heaviest granules, which turn all others,
    too many would be in flight to be simulated one by one. Empty where they are few enough. ``laws`` as in
    :func:`plan_collisions`.
    """
    stays = {name: _stay(scene, fraction, *laws[name]) for name, fraction in scene.fraction.items()}
    depth = _depth(scene, stays)
    heaviest, mass = _heaviest(scene)
    if _simulated(scene, heaviest, depth, stays[heaviest], mass)[1]:
        return ""
    number = float(number_rates(scene, heaviest).sum()) * depth / scene.feed.depth * stays[heaviest]
    enough = MAX_IN_FLIGHT / number
    return (
        f"{number:.2g} granules of {heaviest} would be in flight in a slab {metres(depth, 3)} deep, more than the "
        f"{MAX_IN_FLIGHT:g} that are simulated one by one; set collisions.depth below {metres(depth * enough, 2)}, or "
        f"feed.rate below {3600.0 * scene.feed.mass_flow * enough:.2g} kg/h"
    )


def plan_collisions(
    scene: Scene, laws: Mapping[str, tuple[str, float]], target: float, *, paired: bool = False
) -> CollisionPlan:
    """The slab for a scene, whose shares are asked for to within ``target``; ``laws``: of drag, and the factor on it;
    ``paired``: every second replicate flies in the airflow's mirror image, and the two of a pair count as one.

    Its steady operation is long enough for the fraction of most mass: a share of a half from n independent granules is
    known to 0.98 / sqrt(n) with 95 %. No more of them are asked for than the scene's feed.count, and for no more steps
    than a run can afford. A collisions.count that the scene gives is flown as it is, in all of its replicates. Raises
    SceneError where :func:`too_many_to_collide` says why none can be flown.
    """
    if obstacle := too_many_to_collide(scene, laws):
        raise SceneError(f"collisions: {obstacle}")
    stays = {name: _stay(scene, fraction, *laws[name]) for name, fraction in scene.fraction.items()}
    depth = _depth(scene, stays)
    tracers, rates, (_, mass) = {}, {}, _heaviest(scene)
    for name in scene.fraction:
        tracers[name], rates[name] = _simulated(scene, name, depth, stays[name], mass)
    in_flight = {name: rate * stays[name] for name, rate in rates.items()}
    start_up = max(stays[name] for name in scene.fraction if rates[name] or not any(rates.values()))
    count = scene.collisions.count or min(scene.feed.count, math.ceil((0.98 / target) ** 2))
    fewest = SAMPLES * (2 if paired else 1)
    replicates, operation = _timing(scene, rates, start_up, count, sum(in_flight.values()), fewest)
    lasting = operation + 2.0 * start_up
    seconds = (sum(in_flight.values()) + CLOCK) * replicates * lasting / EXPECTED_STEP / STEPS_A_SECOND / CORES
    memory = BYTES_A_GRANULE * sum(rates.values()) * lasting * CORES
    least = replicates if scene.collisions.count else fewest
    return CollisionPlan(depth, tracers, in_flight, replicates, least, start_up, operation, count, seconds, memory)


def _depth(scene: Scene, stays: Mapping[str, float]) -> float:
    """Depth of the slab (m): as asked for, or DIAMETERS of the coarsest granules; more where few would fly at once."""
    coarsest = max(float(fraction.diameters(np.array([0.5]))[0]) for fraction in scene.fraction.values())
    depth = scene.collisions.depth
    if not depth:
        depth = DIAMETERS * coarsest
        _, mass = _heaviest(scene)
        flying = sum(_simulated(scene, name, depth, stay, mass)[1] * stay for name, stay in stays.items())
        depth *= max(1.0, MANY_IN_FLIGHT / flying) if flying else 1.0
    return min(depth, scene.feed.depth)


def _timing(
    scene: Scene, rates: Mapping[str, float], start_up: float, count: int, at_once: float, least: int
) -> tuple[int, float]:
    """Replicates, at ``least`` so many, and the operation (s) of each that counts, for ``count`` granules of the
    fraction of most mass.
    """
    mass = scene.mass_shares()
    real = [name for name, rate in rates.items() if rate]
    if not real:
        return MAX_REPLICATES, start_up
    whole = count / rates[max(real, key=lambda name: mass[name])]
    whole = max(whole, least * MIN_RAREST_GRANULES / min(rates[name] for name in real))
    replicates = int(np.clip(whole / (4.0 * start_up), least, MAX_REPLICATES)) // 2 * 2
    most = math.inf if scene.collisions.count else MAX_STEPS
    affordable = most * EXPECTED_STEP / (at_once + CLOCK) - 2.0 * replicates * start_up
    return replicates, max(min(whole, affordable), least * start_up) / replicates


def granule_masses(scene: Scene, name: str) -> Array:
    """Mass (kg) of a granule in each of MASS_LEVELS parts of a fraction that weigh the same, finest first."""
    fraction = scene.fraction[name]
    diameter = fraction.diameters((np.arange(MASS_LEVELS) + 0.5) / MASS_LEVELS)
    return np.asarray(math.pi / 6.0 * fraction.properties.density * diameter**3)


def number_rates(scene: Scene, name: str) -> Array:
    """Granules (1/s) that the feed brings in each of these parts of a fraction."""
    return scene.feed.mass_flow * scene.mass_shares()[name] / MASS_LEVELS / granule_masses(scene, name)


def _heaviest(scene: Scene) -> tuple[str, float]:
    """The fraction with the heaviest median granule, and the mass (kg) of that."""
    middle = {name: float(np.median(granule_masses(scene, name))) for name in scene.fraction}
    name = max(middle, key=lambda kind: middle[kind])
    return name, middle[name]


def _simulated(scene: Scene, name: str, depth: float, stay: float, heaviest: float) -> tuple[float, float]:
    """Share of a fraction's mass that is too fine for a slab to simulate one by one; granules (1/s) of the rest.
    ``heaviest``: mass (kg) as of :func:`_heaviest`.
    """
    rates = number_rates(scene, name) * depth / scene.feed.depth
    alike = np.searchsorted(
        rates[::-1], rates, side="right"
    )  # parts that are as coarse or coarser: rates fall with size
    coarser = np.cumsum(rates[::-1])[alike - 1]
    fits = (coarser * stay <= MAX_IN_FLIGHT) & (granule_masses(scene, name) >= LIGHT * heaviest)
    fine = 1.0 - float(np.count_nonzero(fits)) / MASS_LEVELS
    if fine > 1.0 - WORTHWHILE:
        return 1.0, 0.0
    return fine, float(coarser[fits][0])


def _stay(scene: Scene, fraction: Fraction, law: str, scale: float) -> float:
    """Seconds that a median granule is in the slab."""
    if scene.air is None:
        drop = scene.drop + (scene.release[0] if scene.body else 0.0)
        speed = scene.release[1]
        free = (math.sqrt(speed**2 + 2.0 * scene.gravity * drop) - speed) / scene.gravity
        return free + (math.sqrt(2.0 * scene.drop / scene.gravity) if scene.body else 0.0)
    return UniformFall.of(scene, fraction, law, scale, fraction.properties.diameter).times().whole


def collision_lines(collisions: CollisionPlan) -> Iterator[str]:
    """The slab in words."""
    real = ", ".join(f"{number:.3g} {name}" for name, number in collisions.in_flight.items() if number)
    fine = ", ".join(
        name if share == 1.0 else f"the finer {share:.0%} of {name}"
        for name, share in collisions.tracers.items()
        if share
    )
    beside = f"; {fine} as tracers that these can hit" if fine else ""
    yield (
        f"collisions: a slab {1e3 * collisions.depth:.3g} mm deep, periodic across the picture, fed at the true rate: "
        f"{real or 'no granules'} in flight at a time{beside}"
    )
    least, number, seconds = "", f"{collisions.replicates}", f"{collisions.seconds:.0f}"
    if collisions.fewest < collisions.replicates:
        least = ", as many as make the shares noticeably better known"
        number = f"{collisions.fewest} to {number}"
        seconds = f"{collisions.seconds * collisions.fewest / collisions.replicates:.0f} to {seconds}"
    yield (
        f"of the slab {number} replicates{least}, each {collisions.start_up:.2g} s to start up and "
        f"{collisions.operation:.2g} s counted; about {seconds} s on two cores, "
        f"{collisions.memory / 1e6:.0f} MB; the answer is the one with "
        "collisions, the one without is next to it"
    )
