"""What the compared trackers fly, and how one flight becomes a row: errors, rates, and what an error costs.

Four kinds of granules, a steady and a time-resolved wake. Granules enter as in the shipped scene ``rhombus``. So that
OpenFOAM's tracker can follow, the body is at rest afterwards and drag is Putnam's law for spheres: a fraction whose law
carries a factor (a measured terminal velocity) gets that factor into its density instead, which is the same
acceleration.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.tracker.reference import TrackingProblem
from proofs.tracker.rk4 import Ends
from wakeflow.air.field import EMPTY, FlowField
from wakeflow.core.errors import known
from wakeflow.core.files import scene_templates
from wakeflow.core.geometry import contains, distance_to
from wakeflow.core.record import JsonTable
from wakeflow.flight import Body, Granules
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.feed.first_contact import motion_of
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.plan import Plan
from wakeflow.planning.stage_cache import Listener
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

Array = NDArray[np.float64]
KINDS = {  # name: (fraction of the scene, changes of the scene)
    "heavy grain": ("wheat", {"feed.mode": "injected"}),
    "chaff": ("chaff", {"feed.mode": "injected"}),
    "dust 20 um": ("dust", {"feed.mode": "resolved", "fraction.dust.size": "20 um"}),
    "dust 1 um": ("dust", {"feed.mode": "resolved", "fraction.dust.size": "1 um"}),
}
SPEED = 5.0  # m/s, of the air in the shipped scene
STROUHAL = 0.18  # of the rhombus' diagonal
SNAPSHOTS = 32
PATIENCE = 20.0  # channel heights at air speed


@dataclass(frozen=True)
class BenchmarkCase:
    """One kind of granule in one airflow; the first ``len(grains)`` of a stream, at rest bodies, edges of bins (m)."""

    kind: str
    air: str
    problem: TrackingProblem
    grains: Granules
    bins: Array
    replicate: NDArray[np.int64]  # which of the independent samples each granule belongs to

    def some(self, count: int) -> Granules:
        """A subject with ``count`` of its granules, spread evenly over all."""
        return self.grains[np.linspace(0, len(self.grains) - 1, min(count, len(self.grains))).astype(int)]


def shipped(listener: Listener, rung: str = "draft") -> tuple[Scene, Plan, Pipeline]:
    """The shipped scene, its plan and the stages that make its airflow (from the cache where they are there).

    With the paper's granules: the trackers that it is compared with know no scatter.
    """
    scene = Scene.load(scene_templates()["rhombus"], {"fraction.*.impact": "paper"})
    plan = make_plan(scene, rung=rung, force={"air-loading": False})
    return scene, plan, Pipeline(scene, plan, listener)


def benchmark_case(
    kind: str, air: str, scene: Scene, field: FlowField, count: int, of: tuple[str, dict[str, object]] | None = None
) -> BenchmarkCase:
    """``count`` granules of a kind in a field that ends at the scene's floor; ``of`` a fraction of the scene with some
    changes instead of those that the kind represents.
    """
    fraction, changes = of or KINDS[kind]
    changed = scene.replace({**changes, "feed.count": count, "numerics.rung": "draft"})
    plan = make_plan(changed, force={"air-loading": False})
    feed = feedstock(changed, plan, fraction, 0.0)
    grains = feed.granules
    moved = np.where(feed.injected[:, None], motion_of(changed).at(grains.time)[0], 0.0)
    grains = as_spheres(grains).replace(
        position=grains.position - moved,  # from the body at rest, with the velocity that the moving one gave
        time=_phases(field, len(grains)),
    )
    bodies = (*(Body(body.outline()) for body in changed.body.values()), *_side_walls(field))
    assert changed.air is not None
    height = changed.channel.top - changed.channel.bottom
    until = PATIENCE * height / changed.air.speed
    edges = sorted({x for one in changed.on_sides("floor").values() for x in one.ends})
    problem = TrackingProblem(field, bodies, until, changed.width, gravity=changed.plumb.gravity)
    free = _free(grains, field, bodies)
    return BenchmarkCase(kind, air, problem, grains[free], np.array(edges), feed.replicate[free])


def as_spheres(grains: Granules) -> Granules:
    """Points that do not turn, with the drag of spheres and the same terminal velocity: OpenFOAM's parcels."""
    density = grains.density / grains.drag_scale
    return grains.replace(density=density, drag_scale=1.0, sphericity=1.0, inertia=None, spin=0.0)


def _side_walls(field: FlowField) -> list[Body]:
    """Walls along both sides of the field's box, over its whole height."""
    (left, low), (right, high) = field.points.min(axis=0), field.points.max(axis=0)
    thick = 0.05 * (right - left)
    low, high = low - thick, high + thick
    sides = ((left - thick, left), (right, right + thick))
    return [Body(np.array([(a, low), (b, low), (b, high), (a, high)])) for a, b in sides]


def _phases(field: FlowField, count: int) -> Array:
    """Birth times (n,), spread evenly over the period of a time-resolved airflow (golden ratio sequence)."""
    turns = np.arange(count, dtype=float) * 0.6180339887498949 % 1.0
    return np.asarray(turns * field.period, dtype=np.float64)


def _free(grains: Granules, field: FlowField, bodies: tuple[Body, ...]) -> NDArray[np.bool_]:
    """Granules that begin in the mesh and in no wall."""
    start = field.locate(grains.position) >= 0
    for body in bodies:
        away = distance_to(grains.position, body.outline)
        start &= ~contains(body.outline, grains.position) & (away >= 0.5 * grains.diameter * (1.0 - 1e-9))
    return start


def travelling_wave(field: FlowField, speed: float, width: float, strength: float = 0.4) -> FlowField:
    """A steady wake with an analytic wave on it, for a quick time-resolved field; it is not a computed airflow.

    Stream function psi = s U D / (2 pi) sin(2 pi (y / L + t / P)) exp(-(x / 0.75 D)^2) behind the body, fading in over
    two widths; P = D / (St U), L = 0.8 U P: what a vortex street looks like at first glance. ``strength`` s, ``speed``
    U (m/s, downward), ``width`` D (m); 32 snapshots a period.
    """
    period = width / (STROUHAL * speed)
    times = np.arange(SNAPSHOTS) * period / SNAPSHOTS
    x, y = field.points.T

    def psi(x: Array, y: Array, t: float) -> Array:
        ramp = np.clip((-y / width - 0.5) / 2.0, 0.0, 1.0)
        moving = np.sin(2 * np.pi * (y / (0.8 * speed * period) + t / period)) * np.exp(-((x / (0.75 * width)) ** 2))
        return np.asarray(strength * speed * width / (2 * np.pi) * ramp**2 * (3 - 2 * ramp) * moving)

    def wave(t: float) -> Array:
        across = psi(x, y + eps, t) - psi(x, y - eps, t), psi(x - eps, y, t) - psi(x + eps, y, t)
        return np.stack(across, axis=1) / (2 * eps)

    eps = 1e-6 * width

    def kept(values: Array) -> Array:
        return np.tile(values, (SNAPSHOTS, 1)) if values.size else values

    shots = np.stack([field.velocity + wave(t) for t in times])
    pressure, k, dissipation = (kept(values) for values in (field.pressure, field.k, field.dissipation))
    return replace(field, velocity=shots, times=times, period=period, pressure=pressure, k=k, dissipation=dissipation)


def resampled(field: FlowField, onto: FlowField) -> FlowField:
    """The velocity of a time-resolved ``field`` on the triangles of another, which end at the scene's floor."""
    field = field.snapshots()
    from scipy.spatial import cKDTree

    nearest = cKDTree(field.points).query(onto.points)[1]
    shots = []
    for number, t in enumerate(field.times):
        value = field.sample(onto.points, t)[0]
        outside = np.isnan(value).any(axis=1)  # boundary points, by round-off
        value[outside] = field.velocity[number, nearest[outside]]
        shots.append(value)
    return replace(onto, velocity=np.stack(shots), times=field.times, period=field.period, pressure=EMPTY)


ERROR = 1e-4  # body widths, where speeds are compared
ERRORS = ("median", "p95")
ASKED = {"OpenFOAM": 100.0, "explicit RK4": 1.0}  # times faster than each rival's best setting: the goal


@dataclass(frozen=True)
class CurvePoint:
    """One method at one setting: landing errors in body widths, cost, rates. None where a number is not known."""

    kind: str
    air: str
    method: str
    setting: str
    median: float | None
    p95: float | None
    judged: int  # granules whose landing the reference knows
    others: float  # share of them with other contacts than the reference's, or not landed; without a count of contacts
    # (OpenFOAM's tracker): with any contact in the reference
    bin_error: float  # largest error of a bin's share
    seconds: float  # per granule, on the clock, with the cores it uses
    cpu: float  # processor seconds per granule, over all cores: other work on the machine disturbs them least
    steps: float | None  # per granule
    evaluations: float | None  # per granule
    own_median: float | None = None  # error against the method's own finest setting

    @property
    def evaluation_rate(self) -> float | None:
        """Stage evaluations a second and core."""
        return None if self.evaluations is None else self.evaluations / self.cpu


def score(case: BenchmarkCase, reference: Ends, ends: Ends, **own: Any) -> CurvePoint:
    """Errors over the granules that fly freely in the reference and in the method, the rest as a share."""
    met = known(reference.impacts)
    free = reference.landed & (met == 0)
    same = free & ends.landed if ends.impacts is None else free & ends.landed & (ends.impacts == 0)
    error = np.linalg.norm(ends.position[same] - reference.position[same], axis=1) / case.problem.length
    alike = same if ends.impacts is None else ends.landed & (met == ends.impacts)
    judged = int(reference.landed.sum())
    return CurvePoint(
        kind=case.kind,
        air=case.air,
        median=float(np.median(error)) if len(error) else None,
        p95=float(np.percentile(error, 95)) if len(error) else None,
        judged=judged,
        others=1.0 - float(alike[reference.landed].mean()) if judged else 0.0,
        bin_error=_bin_error(case.bins, reference, ends),
        steps=None if ends.steps is None else float(ends.steps.mean()),
        **own,
    )


def _bin_error(edges: Array, reference: Ends, ends: Ends) -> float:
    """Largest difference of a bin's share, over the granules that the reference lands."""
    count = int(reference.landed.sum())
    shares = [
        np.histogram(one.position[reference.landed & one.landed, 0], edges)[0] / max(count, 1)
        for one in (reference, ends)
    ]
    return float(np.abs(shares[0] - shares[1]).max())


def timed(work: Callable[[], object], repeats: int = 3) -> tuple[float, float]:
    """Median wall seconds and median processor seconds (of all threads) of a call."""
    wall, cpu = [], []
    for _ in range(repeats):
        begun, busy = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - begun)
        cpu.append(time.process_time() - busy)
    return statistics.median(wall), statistics.median(cpu)


def cost_at(rows: Iterable[CurvePoint], error: float, which: str = "median") -> float | None:
    """Processor seconds a granule for which a method's best setting reaches ``error``; None when none does.

    ``which`` error: median or p95.

    Read off the lower envelope of the points (error, seconds), straight between them in logarithms; a method whose
    cheapest setting is more accurate costs what that setting costs.
    """
    points = sorted((float(value), row.cpu) for row in rows if (value := getattr(row, which)) is not None and value > 0)
    envelope: list[tuple[float, float]] = []
    for value, seconds in points:  # from the smallest error on: only those cheaper than all more accurate ones
        if not envelope or seconds < envelope[-1][1]:
            envelope.append((value, seconds))
    if not envelope or error < envelope[0][0]:
        return None
    errors, costs = np.log(envelope).T
    return float(np.exp(np.interp(np.log(error), errors, costs)))


def times_faster(rows: Sequence[CurvePoint]) -> list[JsonTable]:
    """How many times less processor time than its rivals' the tracker takes at ERROR, for the median error and for the
    95th percentile, None where one of both does not get there; and whether the median is what is ``asked``.
    """
    found = []
    for kind, air in dict.fromkeys((row.kind, row.air) for row in rows):
        here = [row for row in rows if (row.kind, row.air) == (kind, air)]
        for than, asked in ASKED.items():
            if theirs := [row for row in here if row.method.startswith(than)]:
                ours = [row for row in here if row.method == "wakeflow"]
                costs = {name: [cost_at(some, ERROR, name) for some in (theirs, ours)] for name in ERRORS}
                ratios = {name: one / other if one and other else None for name, (one, other) in costs.items()}
                met = (ratios["median"] or 0.0) >= asked
                found.append({"kind": kind, "air": air, "than": than, **ratios, "asked": asked, "met": met})
    return found
