"""Error against run time: this tracker, an explicit one, and OpenFOAM's, on one interpolant with one reference."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from proofs.report import Report, Table, Tell
from proofs.tracker import cloud, flights
from proofs.tracker.curves import (
    ERROR,
    KINDS,
    SPEED,
    BenchmarkCase,
    CurvePoint,
    benchmark_case,
    resampled,
    score,
    shipped,
    timed,
    times_faster,
    travelling_wave,
)
from proofs.tracker.foam import FoamInterpolant, fly_parcels, make_foam_interpolant, start_up
from proofs.tracker.reference import fly_reference
from proofs.tracker.rk4 import Ends, fly_explicit
from wakeflow.air.field import FlowField
from wakeflow.core.errors import known
from wakeflow.core.files import scene_templates
from wakeflow.core.record import JsonTable
from wakeflow.flight import Fate, Granules, track
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.stage_cache import Listener
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

Fly = Callable[[Granules], tuple[Ends, float]]
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
STEPS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5)  # s, of the explicit tracker
STABLE = (2.5, 1.2, 0.6)  # in relaxation times, where those steps are not stable
LARGEST_STABLE = 2.78  # relaxation times: classical Runge-Kutta on the negative real axis
PEER = ((1e-3, 0.3), (1e-4, 0.3), (None, 0.3), (None, 0.1), (None, 0.03), (None, 0.01), (None, 0.003))  # deltaT, maxCo
PEER_SLOW = ((1e-5, 0.3), (None, 0.001))
COUNT = 16384  # granules of a kind; timed runs take as many of them as they need, the reference a few
MIN_RUN_TIME = 1.0  # s of a timed run
MIN_GRANULES = 2048  # granules of a timed run: the tracker hands its cores large blocks
TIMED = ("heavy grain", "chaff", "dust 20 um")  # in the quick comparison
COLUMNS = {
    "method": "{method}", "setting": "{setting}", "median": "{median:.1e}", "95 %": "{p95:.1e}",
    "own": "{own_median:.1e}", "us/granule": "{seconds:.3g*1e6}", "CPU us": "{cpu:.3g*1e6}",
    "granules/s": "{rate:.3g}", "steps": "{steps:.0f}", "M stages/s/core": "{evaluation_rate:.1f*1e-6}",
    "others %": "{others:.1f*100}", "bin share %": "{bin_error:.2f*100}",
}  # fmt: skip
TIMES = {
    "granule": "{kind}", "air": "{air}", "than": "{than}", "median": "{median:.3g}", "95 %": "{p95:.3g}",
    "asked": "{asked:.3g}", "met": "{met:yes|no}",
}  # fmt: skip


def run_benchmark(folder: Path, *, slow: bool = False, tell: Tell = lambda _: None) -> Report:
    """Fly every subject with every tracker; ``tracker.png`` in ``folder`` shows the curves.

    ``slow``: a computed time-resolved wake besides the synthetic one, OpenFOAM's cloud in its own solver, more and
    finer settings. Raises FoamError when OpenFOAM is not installed.
    """
    from proofs.tracker.picture import draw

    folder.mkdir(parents=True, exist_ok=True)
    scene, _, pipeline = shipped(_listener(tell))
    flying, facts = all_forces(pipeline.field[1], slow, tell)
    rows: list[CurvePoint] = []
    with tempfile.TemporaryDirectory(prefix="wakeflow-peer-") as room:
        tell("meshing the channel for everybody")
        foam = make_foam_interpolant(
            pipeline.field[1], pipeline.air.in_case.mesh_spec, scene.channel.top, scene.channel.bottom, Path(room)
        )
        for kind in KINDS:
            case = benchmark_case(kind, "steady", scene, foam.field, COUNT)
            reference, found = _ours_and_explicit(case, slow, tell)
            rows += found + _peer(case, reference, foam, Path(room, "run"), slow, tell)
        wave = travelling_wave(foam.field, SPEED, scene.width)
        for kind in KINDS if slow else TIMED:
            rows += _ours_and_explicit(benchmark_case(kind, "synthetic wave", scene, wave, COUNT), slow, tell)[1]
    if slow:
        rows += _shedding(scene, foam, tell)
    told = [asdict(row) | {"evaluation_rate": row.evaluation_rate, "rate": 1.0 / row.seconds} for row in rows]
    draw(told, folder / "tracker.png")
    times = times_faster(rows)
    tables = [
        Table(f"{kind}, {air}: landing error in body widths against run time", COLUMNS, same)
        for kind, air in dict.fromkeys((row.kind, row.air) for row in rows)
        if (same := [row for row in told if (row["kind"], row["air"]) == (kind, air)])
    ]
    faster = Table(f"times less processor time at an error of {ERROR:.0e} body widths", TIMES, times)
    facts |= {"granules": COUNT, "triangles": len(foam.field.triangles), "rows": told, "times_faster": times}
    return Report("tracker", [*flying, *tables, faster], facts)


def _listener(tell: Tell) -> Listener:
    return lambda stage, text: tell(f"{stage}: {text}")


def all_forces(steady: FlowField, slow: bool, tell: Tell) -> tuple[list[Table], JsonTable]:
    """Tables and facts of the flights of the shipped scene's answer, with all forces, in ``steady`` air with a wave on
    it; with ``slow`` in the answer's own airs, beside OpenFOAM's cloud in the solver of the time-resolved one.
    """
    scene = Scene.load(scene_templates()["rhombus"])
    airs, case = {"steady": steady, "synthetic wave": travelling_wave(steady, SPEED, scene.width)}, None
    if slow:
        pipeline = Pipeline(scene, make_plan(scene), _listener(tell))
        airs = {"steady": pipeline.steady.field[1], "time-resolved": pipeline.field[1]}
        case = cloud.SolvedCase.of(pipeline.air.in_case.solution[1] / "case", airs["time-resolved"])
    rows, asked = [], []
    for one in flights.flown_kinds(scene, airs, flights.MANY if slow else flights.FEW):
        found = list(flights.flight_rows(one, tell))
        rows += found
        if one.air == "time-resolved":
            asked.append((one, next(row for row in found if row["tolerance"] == flights.WANTED)))
    head = f"all forces: landing error in body widths, against tolerance {flights.REFERENCE:.0e}"
    tables, facts = [Table(head, flights.COLUMNS, rows)], {"all_forces": rows}
    if case is not None:
        with tempfile.TemporaryDirectory(prefix="wakeflow-peer-") as room:
            facts["cloud"] = list(cloud.cloud_rows(case, asked, Path(room, "run"), tell))
        facts["equal_error"] = list(cloud.at_equal_error(facts["cloud"]))
        head = "time-resolved air, next to OpenFOAM's cloud"
        tables.append(Table(f"{head}, forces that both know", cloud.COLUMNS, facts["cloud"]))
        tables.append(Table(f"{head}, at the same median error", cloud.EQUAL, facts["equal_error"]))
    return tables, facts


def _shedding(scene: Scene, foam: FoamInterpolant, tell: Tell) -> list[CurvePoint]:
    """The computed time-resolved wake of rung ``standard``, on the mesh of all trackers; takes OpenFOAM minutes."""
    _, _, pipeline = shipped(_listener(tell), rung="standard")
    field = resampled(pipeline.field[1], foam.field)
    rows = []
    for kind in KINDS:
        rows += _ours_and_explicit(benchmark_case(kind, "vortex shedding", scene, field, COUNT), True, tell)[1]
    return rows


def _ours_and_explicit(case: BenchmarkCase, slow: bool, tell: Tell) -> tuple[Ends, list[CurvePoint]]:
    label = f"{case.kind}, {case.air}"
    tell(f"{label}: reference")
    few = case.some(512 if slow else 128)
    reference = fly_reference(case.problem, few, seconds=900.0 if slow else 180.0)
    methods: list[tuple[str, str, Fly, int]] = [
        *(("wakeflow", f"tolerance {one:.0e}", partial(_ours, case, one), MIN_GRANULES) for one in TOLERANCES),
        *(("explicit RK4", f"step {one:.2g} s", partial(_explicit, case, one), 128) for one in _steps(case, slow)),
    ]
    rows = []
    for method, setting, fly, least in methods:
        tell(f"{label}: {method}, {setting}")
        ends, evaluations = fly(few)
        cost = _cost(case, fly, few, least)
        rows.append(score(case, reference, ends, method=method, setting=setting, evaluations=evaluations, **cost))
    return reference, rows


def _cost(case: BenchmarkCase, fly: Fly, few: Granules, least: int) -> dict[str, float]:
    """Wall and processor seconds a granule, of a run with so many granules that it lasts long enough, and at least
    ``least``.
    """
    each = timed(lambda: fly(few), 1)[0] / len(few)
    count = int(np.clip(MIN_RUN_TIME / max(each, 1e-9), least, len(case.grains)))
    grains = case.some(count)
    repeats = 3 if each * count < 3 * MIN_RUN_TIME else 1  # a single run of that length averages the machine's noise
    wall, cpu = timed(lambda: fly(grains), repeats)
    return {"seconds": wall / len(grains), "cpu": cpu / len(grains)}


def _ours(case: BenchmarkCase, tolerance: float, grains: Granules) -> tuple[Ends, float]:
    """Where this tracker's granules ended, and its stage evaluations a granule."""
    tracks = track(case.problem.field, grains, tolerance=tolerance, **case.problem.arguments)
    landed = (tracks.fate == Fate.ESCAPED) | (tracks.fate == Fate.BINNED)
    ends = Ends(tracks.position, tracks.time, landed, tracks.impacts, tracks.steps)
    return ends, float(tracks.evaluations.mean())


def _explicit(case: BenchmarkCase, step: float, grains: Granules) -> tuple[Ends, float]:
    """The same of the explicit tracker."""
    ends = fly_explicit(case.problem.field, grains, step=step, **case.problem.arguments)
    return ends, 4.0 * float(known(ends.steps).mean())


def _steps(case: BenchmarkCase, slow: bool) -> list[float]:
    """Steps of the explicit tracker: the usual ones that are stable for this granule, else some in its relaxation
    times.
    """
    tau = float(np.median(case.grains.density * case.grains.diameter**2)) / (18.0 * case.problem.field.viscosity)
    steps = [step for step in (*STEPS, *((1e-5,) if slow else ())) if step < LARGEST_STABLE * tau]
    return steps if len(steps) >= 3 else [share * tau for share in STABLE]


def _peer(
    case: BenchmarkCase, reference: Ends, foam: FoamInterpolant, folder: Path, slow: bool, tell: Tell
) -> list[CurvePoint]:
    """OpenFOAM's tracker over its step and maxCo, on one core: it uses no more."""
    few = case.some(len(reference.landed))
    free = reference.landed & (known(reference.impacts) == 0)
    until = 1.02 * float(reference.time[free].max())
    many, rows = case.some(2048), []
    begins = [start_up(foam, grains, folder) for grains in (few, many)]
    for scheme in ("Euler", "analytical"):
        found, ends = [], []
        for step, courant in (*PEER, *(PEER_SLOW if slow else ())):
            name = f"deltaT {step:.0e} s" if step else "deltaT one flight"
            tell(f"{case.kind}: OpenFOAM {scheme}, {name}, maxCo {courant:g}")
            how = {"scheme": scheme, "step": step or until, "courant": courant, "until": until, "folder": folder}
            run, spent = fly_parcels(foam, few, **how)
            seconds = (spent - begins[0]) / len(few)
            if seconds * len(few) < 0.3:  # its clock ticks in hundredths of a second
                seconds = (fly_parcels(foam, many, **how)[1] - begins[1]) / len(many)
            ends.append(run)
            found.append(score(
                case, reference, run, method=f"OpenFOAM {scheme}", setting=f"{name}, maxCo {courant:g}",
                seconds=max(seconds, 1e-6), cpu=max(seconds, 1e-6), evaluations=None,
            ))  # fmt: skip
        rows += _with_own(case, found, ends)
    return rows


def _with_own(case: BenchmarkCase, rows: list[CurvePoint], ends: list[Ends]) -> list[CurvePoint]:
    """The rows with the median distance (body widths) of their landings from those of the setting nearest to
    convergence.
    """
    finest = ends[int(np.argmin([np.inf if row.median is None else row.median for row in rows]))]
    found = []
    for row, one in zip(rows, ends, strict=True):
        both = one.landed & finest.landed
        distance = np.linalg.norm(one.position[both] - finest.position[both], axis=1) / case.problem.length
        own = float(np.median(distance)) if len(distance) and one is not finest else None
        found.append(replace(row, own_median=own))
    return found
