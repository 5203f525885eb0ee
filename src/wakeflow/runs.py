"""run(): the pipeline, its budget and the report of one scene, in one folder."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .core.beside import beside
from .core.errors import SceneError
from .core.files import atomic_write
from .core.graded import gravest_first
from .core.process import cores
from .core.record import from_json, to_json
from .core.registry import did_you_mean
from .core.sources import code_key
from .core.store import content_key, digest_files
from .laws.momentum import momentum_pressure
from .pipeline.cache import Listener, in_turn, silent
from .pipeline.pipeline import Pipeline
from .planning.machine_rates import learn
from .planning.make import Planner, make_plan
from .progress import heard, unheard
from .refining.loop import refined
from .report.views import Result
from .results.air_loading import loading_of
from .results.airflow_summary import (
    Airflow,
    FieldDivergence,
    FieldTruncation,
    MomentumModel,
    airflow_of,
    with_residence,
)
from .results.budget import flights_ahead, fly_again, make_budget, together
from .results.companions import airflow_on_grids
from .results.crowd_summary import crowd_of
from .results.funnel_summary import FunnelSummary, funnel_of
from .results.impact_summary import impact_of
from .results.input_summary import inputs_of
from .results.inputs import Inputs
from .results.landing_results import BudgetRow, LandingResults, Separation
from .results.notices import notices
from .results.partition import partition_curves
from .results.plan_summary import summary_of
from .results.provenance import provenance_of
from .results.refinement import Refinement
from .results.result import (
    FILE,
    SCHEMA,
    FlightResults,
    MeshSummary,
    Request,
    asked_in,
    key_in,
    provenance_in,
    refinement_in,
)
from .results.separation import separate
from .results.solved_case import cells_of, forces_of
from .results.source import Flights
from .results.sources import MODEL, UNLOADED
from .results.total import totalled
from .scene import Scene

if TYPE_CHECKING:
    from .field import FlowField
    from .pipeline.film_stage import Film
    from .pipeline.landings import Landings, Tracked
    from .planning.plan import Plan
    from .report import Landed

__all__ = ["film_of", "help_along", "report_again", "run", "versions"]

PACKAGES = ("wakeflow", "numpy", "scipy", "numba", "gmsh", "meshio", "foamlib", "pyvista")
STOPS = ("funnel", "mesh", "airflow", "tracks")  # stages after which a run can be asked to stop


def run(
    scene: Scene | Path | str,
    out: Path | str | None = None,
    *,
    until: str | None = None,
    rung: str | None = None,
    force: Mapping[str, bool] | None = None,
    target_error: float | None = None,
    near: Path | str | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
    redraw: bool = False,
    report: bool = True,
    refine: bool = True,
    crew: int = 1,
) -> Result:
    """Compute ``scene``, or that of a scene file, and write results to the folder ``out`` (runs/scene, or runs/ and the
    file's name); finished stages come from the cache.

    ``until`` stops after "funnel", "mesh", "airflow" or "tracks" (no separation then); ``rung``, ``force`` and
    ``target_error`` override the plan (``planning.make_plan``); ``workers`` threads track. The steady airflow is solved
    on from that of the run in the folder ``near``, whatever its mesh, speed or size, else from rest; the answer hangs
    on it within what it may move once it counts as steady, and is kept apart. With a ``target_error`` the
    scene's granules, tolerance, mesh and averages are chosen so that computing alone knows every bin share to it
    (:mod:`wakeflow.refining`), unless ``refine`` is False. ``listener(stage, text)`` hears of progress, one call at a
    time: ``print`` serves, and a notebook shows a bar by itself; ``planned(plan)`` hears before of what will be done.
    ``redraw`` draws a finished report anew; without ``report`` none is drawn, and a later call without that draws it.
    ``crew``: how many processes fly the scene's granules side by side, the others by :func:`help_along`.
    Raises SceneError for wrong input, ProgramError when Gmsh or OpenFOAM fails.
    """
    name = Path(scene).stem if isinstance(scene, Path | str) else "scene"
    asked, folder = Scene.of(scene), Path("runs", name) if out is None else Path(out)
    request = Request(until, rung, dict(force or {}), target_error, None if near is None else str(near))
    listener, planned = heard(listener, planned)
    once = partial(
        _run_once,
        folder=folder,
        request=request,
        workers=workers,
        listener=listener,
        planned=planned,
        redraw=redraw,
        crew=crew,
    )
    if target_error is None or until is not None or not refine:
        return once(asked, report=report)

    plan = make_plan(asked, rung=rung, force=force, target_error=target_error)
    found = refined(asked, target_error, partial(once, report=False), plan, listener)
    return once(Scene.parse(found.scene), report=True, refinement=found.refinement) if report else found


def _run_once(
    scene: Scene,
    *,
    folder: Path,
    request: Request,
    workers: int | None,
    listener: Listener,
    planned: Callable[[Plan], object],
    redraw: bool,
    report: bool,
    crew: int = 1,
    refinement: Refinement | None = None,
    pdf: bool = False,
) -> Result:
    """Run a scene as it stands; ``refinement``: how its settings came about."""
    from filelock import FileLock, Timeout

    _check(scene, folder, request, workers)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", timeout=0), _one_thread_of_blas():
            pipeline, poured = _pipeline(scene, request, workers, listener, crew, planned)
            result = _Run(scene, pipeline, poured, folder, request, redraw, report, refinement, pdf).result()
            if workers is None and crew == 1 and request.near is None:  # all cores, from rest: as the plan expects it
                spent = {str(stage): one.seconds for stage, one in pipeline.seconds.items() if not one.cached}
                learn(pipeline.store.root, pipeline.plan.stages, spent)
            return result
    except Timeout:
        raise SceneError(f"another run is writing to {folder}; wait for it or choose another --out") from None


def _one_thread_of_blas() -> AbstractContextManager[object]:
    """Threads of the run's own share the cores; those of BLAS would wait for each other, and sum in their own order."""
    from threadpoolctl import threadpool_limits

    import_module("scipy.linalg")  # brings a BLAS of its own, and only what is loaded can be limited

    limits: AbstractContextManager[object] = threadpool_limits(1, user_api="blas")
    return limits


def _pipeline(
    scene: Scene,
    request: Request,
    workers: int | None,
    listener: Listener,
    crew: int,
    planned: Callable[[Plan], object] = unheard,
) -> tuple[Pipeline, FunnelSummary | None]:
    """The stages of a scene, fed by its funnel where it has one, and what that funnel delivers; ``planned`` hears of
    the plan before.
    """
    planner, rung = Planner(scene.fed(), request.force, request.target_error), request.rung
    plan = planner.plan(rung)
    planned(plan)
    beside = None if request.near is None else _neighbour(Path(request.near), (), in_turn(listener))
    pipeline = Pipeline(
        plan.airflow.flown(scene), plan, in_turn(listener), workers, planner=planner, crew=crew, neighbour=beside,
        seconds={} if beside is None else beside.seconds,
    )  # fmt: skip
    poured = funnel_of(pipeline.funnel)
    if poured is not None and request.until != "funnel":
        fed = _fed(scene, poured)
        planner = planner.at(fed)  # the bounds on loading follow the rate
        plan = planner.plan(rung)
        pipeline = replace(pipeline, scene=plan.airflow.flown(fed), plan=plan, planner=planner)
    return pipeline, poured


def _neighbour(folder: Path, before: tuple[Path, ...], listener: Listener) -> Pipeline:
    """The stages of the run in ``folder``, which may have ended with its airflow; ``before``: those that start from it.

    Raises SceneError where there is none, or where it starts from one of those itself.
    """
    here = folder.resolve()
    if here in before:
        raise SceneError(f"--near {folder}: that airflow starts from itself; name a run that was started from rest")
    tables, request = asked_in(folder, whole=False)
    further = None if request.near is None else _neighbour(Path(request.near), (*before, here), listener)
    scene = Scene.parse(tables).fed()
    plan = Planner(scene, request.force, request.target_error).plan(request.rung)
    return Pipeline(plan.airflow.flown(scene), plan, listener, label="neighbour ", neighbour=further)


def help_along(scene: Scene, request: Request, *, workers: int, crew: int) -> None:
    """Fly what :func:`run` flies of a scene beside another process that runs it with the same ``crew``; each flies the
    pieces that no other is at. Writes nothing but the cache.
    """
    with _one_thread_of_blas():
        pipeline, _ = _pipeline(scene, request, workers, silent, crew)
        fly_again(Flights(pipeline, pipeline.tracks(), pipeline.crowd()))


def _check(scene: Scene, folder: Path, request: Request, workers: int | None) -> None:
    """Raise SceneError where a run cannot be made as it was asked for."""
    if request.until not in (None, *STOPS):
        raise SceneError(f"until = {request.until!r}: choose funnel, mesh, airflow or tracks")
    if request.until == "funnel" and scene.funnel is None:
        raise SceneError("until = 'funnel': the scene has no [funnel] table")
    if workers is not None and workers < 1:
        raise SceneError(f"workers = {workers}: at least 1")
    if request.near is not None and Path(request.near).resolve() == folder.resolve():
        raise SceneError(f"--near {request.near}: is the run's own folder; name another run")
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"--out {folder}: is a file; name a folder")


def _fed(scene: Scene, poured: FunnelSummary) -> Scene:
    """The scene with the funnel's rate as its feed's. Raises SceneError where it needs one and the flow stopped."""
    if poured.rate is None and scene.feed.rate is None:
        raise SceneError(
            f"funnel: the flow stops with {poured.left} of {poured.beads} beads inside; widen "
            "funnel.orifice, shake it harder (funnel.gamma) or give feed.rate"
        )
    return scene.fed(None if poured.rate is None else poured.rate.value)


@dataclass(frozen=True)
class _Run:
    """One run: the scene as asked for, the pipeline that computes it, and where its answer goes."""

    asked: Scene
    pipeline: Pipeline
    poured: FunnelSummary | None
    folder: Path
    request: Request
    redraw: bool
    report: bool
    refinement: Refinement | None = None
    pdf: bool = False

    def result(self) -> Result:
        """Make the stages that are asked for, then the report where it is not the one that stands there."""
        until, flown = self.request.until, None
        with beside(self._ahead()):
            mesh, airflow = self._air()
            tracked = None if until in ("funnel", "mesh", "airflow") else self.pipeline.tracks()
            if tracked is not None and until is None:
                flown = Flights(self.pipeline, tracked, self.pipeline.crowd())
                fly_again(flown)
        if tracked is not None and airflow is not None:
            airflow = self._flown(airflow)
        flights = None if tracked is None else self._flights(tracked)
        landings = None if flown is None else self._landings(flown)
        scene, plan = self.pipeline.scene, self.pipeline.plan
        slab = None if landings is None else landings.slab
        told = notices(scene, self.pipeline, airflow, self.poured, tracked, slab)
        small = together(() if landings is None else landings.budget, plan.target_error)
        known = gravest_first((*plan.notices, *told, *small))
        key, solver = self._key(tracked), None if airflow is None else self.pipeline.kind.solver
        result = Result(
            schema=SCHEMA,
            scene=self.asked.tables(),
            options=self.request,
            plan=summary_of(plan),
            funnel=self.poured,
            airflow=airflow,
            mesh=mesh,
            flights=flights,
            landings=landings,
            warnings=tuple(notice.text for notice in known),
            grades=tuple(notice.grade.value for notice in known),
            seconds={str(stage): spent for stage, spent in self.pipeline.seconds.items()},
            versions=versions(),
            key=key,
            provenance=provenance_in(self.folder, key) or provenance_of(scene, solver),
            refinement=self.refinement,
            folder=self.folder,
        )
        result = self._drawn(result, tracked, None if flown is None else flown.landings)
        result.save()
        return result

    def _ahead(self) -> list[Callable[[], object]]:
        """What another core makes while this one waits for the airflow; nothing on one core, or without such a wait."""
        pipeline, until = self.pipeline, self.request.until
        threads = cores() if pipeline.workers is None else pipeline.workers
        if threads < 2 or until in ("funnel", "mesh") or pipeline.kind.at_once:
            return []
        spare = replace(pipeline, workers=threads - 1)

        def solve(grid: int) -> object:
            return spare.on_grid(grid).solution

        solved = [partial(solve, grid) for grid in range(1, len(pipeline.plan.airflow.scales))]
        return [*solved, *(flights_ahead(spare) if until is None else [])]  # flights wait for the steady airflow

    def _air(self) -> tuple[MeshSummary | None, Airflow | None]:
        """The mesh and the airflow; None without air, and where the run stops before them."""
        pipeline, scene, until = self.pipeline, self.pipeline.scene, self.request.until
        if scene.air is None or until == "funnel":
            return None, None
        if until not in ("mesh", "airflow") and not pipeline.kind.at_once:
            pipeline.compile_beside()
        mesh = from_json(MeshSummary, pipeline.mesh_quality, "mesh.json")
        if until == "mesh":
            return mesh, None
        airflow = airflow_of(pipeline)
        momentum = _momentum(scene, airflow) if scene.body and airflow.cp_base is not None else None
        return mesh, airflow.extended(grids=airflow_on_grids(pipeline), momentum=momentum)

    def _flown(self, airflow: Airflow) -> Airflow:
        """The airflow with what is known of the field that granules fly in."""
        measured = {"divergence": _divergence(self.pipeline), "truncation": _truncation(self.pipeline)}
        told = airflow.extended(**measured, loading=loading_of(self.pipeline))
        return with_residence(told, self.pipeline.residence)

    def _flights(self, tracked: Tracked) -> FlightResults:
        return FlightResults(tracked.fates, tracked.injected, impact_of(self.pipeline.scene, self.pipeline.plan))

    def _landings(self, flights: Flights) -> LandingResults:
        scene = self.pipeline.scene
        separation, budget, inputs = _with_totals(scene, flights)
        crowd = flights.crowd
        alone = None if crowd is None else _with_totals(scene, replace(flights, crowd=None))[0]
        slab = None if crowd is None else crowd_of(self.pipeline.plan, crowd)
        wakes = flights.of(MODEL)
        bracket = None if wakes is None else wakes.means(list(scene.bin))
        unloaded = flights.of(UNLOADED)
        effects = None if unloaded is None else unloaded.effects(separation.bins)
        summary, parts = inputs_of(inputs)
        separation = replace(separation, cut=partition_curves(scene, self.pipeline.plan, flights.landings))
        return LandingResults(separation, bracket, budget, alone, slab, effects, summary, parts)

    def _key(self, tracked: Tracked | None) -> str:
        """What the answer depends on: scene, order of its tables, plan, request, tracks, versions and sources."""
        scene = self.pipeline.scene  # flown without its air at rung none, fed by its funnel
        order = [list(keyed) for keyed in (scene.body, scene.fraction, scene.bin)]
        code = digest_files([Path(__file__).parent])
        made_for = (self.asked.tables(), order, self.pipeline.plan.summary(), to_json(self.request))
        crowd = self.pipeline.crowd_key if tracked and self.request.until is None else None
        return content_key(*made_for, self.pipeline.tracks_key if tracked else None, crowd, versions(), code)

    def _drawn(self, result: Result, tracked: Tracked | None, answer: Mapping[str, Landings] | None) -> Result:
        """The result with the pictures of its report, which is drawn where it does not stand in the folder already; the
        ``answer``'s landings, where there is one, stand in them.
        """
        from . import report

        folder, scene = self.folder, self.pipeline.scene
        stands = key_in(folder) == result.key
        if not stands:  # the new answer is there: the older one goes whole, so that no mixture is left
            (folder / FILE).unlink(missing_ok=True)
            report.clear_report(folder)
            (folder / "granules.npz").unlink(missing_ok=True)
        if tracked is not None:
            landings = tracked.landings if answer is None else answer
            granules = _some_granules(scene, landings)
            with atomic_write(folder / "granules.npz", "wb") as stream:
                np.savez(stream, names=np.array(list(landings)), **granules)
            wanted = self.request.until is None and self.report
            if wanted and (self.redraw or not stands or not report.is_whole(folder, scene.picture)):
                _report(self.pipeline, tracked, landings, granules, result, pdf=self.pdf)
            return replace(result, pictures=report.pictures_of(folder))
        if self.request.until == "funnel" and self.poured is not None:
            report.draw_discharge(folder / "figures" / "discharge.png", self.poured)
        return result


def _with_totals(scene: Scene, flights: Flights) -> tuple[Separation, tuple[BudgetRow, ...], Inputs | None]:
    """The shares of the granules of ``flights`` with all parts of their error in the intervals, and these parts."""
    found = separate(scene, flights.landings)
    budget, inputs = make_budget(flights, found), flights.inputs(found.fractions)
    return totalled(found, budget, inputs, scene), budget, inputs


def _report(
    pipeline: Pipeline,
    tracked: Tracked,
    answer: Mapping[str, Landings],
    granules: Mapping[str, Any],
    result: Result,
    *,
    pdf: bool,
) -> None:
    from .report import Outcome, write_report

    pipeline.listener("report", "drawing")
    scene = pipeline.scene
    landings = {name: _landed(landing) for name, landing in answer.items()}
    flow = None if scene.air is None else pipeline.field[1]
    shown = {name: pipeline.shown(picture) for name, picture in scene.picture.items()}
    air = result.airflow
    cells, history = (None, None) if air is None else (cells_of(pipeline), forces_of(pipeline, air))
    outcome = Outcome(scene, flow, tracked.drawn, landings, result, shown, granules, cells, history)
    write_report(result.folder, outcome, _field_files(pipeline, air), pdf=pdf)
    pipeline.listener("report", "done")


def _field_files(pipeline: Pipeline, airflow: Airflow | None) -> Path | None:
    """The folder in the cache with the field's files for ParaView, which all runs in this airflow share; None without
    air.
    """
    from .report.vtk import write_field

    scene = pipeline.scene
    if scene.air is None:
        return None
    upstream, flow = pipeline.field
    asked = scene.numerics.snapshots, scene.symmetric
    key = content_key("vtk", upstream, *asked, code_key("wakeflow.report.vtk.air"), versions()["pyvista"])

    def work(part: Path) -> None:
        write_field(part, flow, scene, airflow)

    return pipeline.cache.make("vtk", key, work)


def _landed(landing: Landings) -> Landed:
    from .report import Landed

    return Landed(landing.position[:, 0], landing.position[:, 1], landing.mass_shares, landing.bin)


def report_again(folder: Path | str, *, pdf: bool = False) -> Path:
    """Draw the report of a finished run anew, from its result.json and the cache, with ``pdf`` every figure as PDF too.
    Returns the path of report.html.

    Raises SceneError where the folder holds no finished run.
    """
    scene, asked = asked_in(folder)
    _run_once(
        Scene.parse(scene), folder=Path(folder), request=asked, workers=None, listener=silent, planned=unheard,
        redraw=True, report=True,
        refinement=refinement_in(folder), pdf=pdf,
    )  # fmt: skip
    return Path(folder) / "report.html"


def film_of(
    folder: Path | str,
    span: float | None = None,
    fractions: Sequence[str] = (),
    listener: Listener = silent,
) -> tuple[Scene, FlowField | None, Film]:
    """The scene of a finished run as it was flown, its air, and its granules over ``span`` (s), flown for a film; of
    all ``fractions``, or of those alone.

    What the run's own cache still holds is not computed again. Raises SceneError where the folder holds no such run,
    and for a fraction that it has not.
    """
    tables, asked = asked_in(folder)
    for name in fractions:
        if name not in tables["fraction"]:
            known = list(tables["fraction"])
            raise SceneError(f"unknown fraction {name!r}{did_you_mean(name, known)} (known: {', '.join(known)})")
    with _one_thread_of_blas():
        pipeline, _ = _pipeline(Scene.parse(tables), asked, None, listener, 1)
        air = None if pipeline.scene.air is None else pipeline.field[1]
        film = pipeline.film(span)
    return pipeline.scene, air, replace(film, paths={name: film.paths[name] for name in fractions or film.paths})


def versions() -> dict[str, str]:
    """Of python and of the packages that answers rest on."""
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": sys.version.split()[0]}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def _momentum(scene: Scene, airflow: Airflow) -> MomentumModel:
    """The paper's momentum model of the first body, for comparison: pressure on its front, and Cd with the computed
    base pressure.
    """
    assert scene.air is not None
    assert airflow.cp_base is not None
    assert airflow.cp_base.value is not None
    model = momentum_pressure(next(iter(scene.body.values())).outline(), scene.air.direction)
    return MomentumModel(model.front, model.drag(airflow.cp_base.value))


def _divergence(pipeline: Pipeline) -> FieldDivergence:
    return from_json(FieldDivergence, pipeline.divergence, "divergence")


def _truncation(pipeline: Pipeline) -> FieldTruncation | None:
    lost = pipeline.truncation
    return None if lost is None else from_json(FieldTruncation, lost, "truncation")


def _some_granules(scene: Scene, landings: Mapping[str, Landings]) -> dict[str, Any]:
    """A fixed subsample of at most numerics.keep granules a fraction, as columns; shares use all of them."""
    rows: dict[str, list[np.ndarray]] = {}
    mass = scene.mass_shares()
    for index, (name, landing) in enumerate(landings.items()):
        count = len(landing.bin)
        kept = np.unique(np.linspace(0, count - 1, min(count, scene.numerics.keep)).astype(int))
        columns = {
            "fraction": np.full(len(kept), index),
            "weight": mass[name] * landing.mass_shares[kept] / landing.mass_shares[kept].sum(),
            **{
                field: getattr(landing, field)[kept]
                for field in ("position", "bin", "diameter", "fate", "time", "impacts")
            },
        }
        for field, values in columns.items():
            rows.setdefault(field, []).append(values)
    return {name: np.concatenate(parts) for name, parts in rows.items()}
