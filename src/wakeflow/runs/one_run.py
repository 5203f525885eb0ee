"""run(): one scene computed in one folder; and of a finished run its report drawn anew."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..air.kinds.airflow_table import Airflow, MeshReport
from ..answer.budget.agreement import verdicts_of
from ..answer.budget.budget import flights_ahead, fly_again, make_budget, of_granules_alone, total_notices
from ..answer.budget.mesh import airflow_on_grids
from ..answer.budget.model import MODEL, in_three_dimensions, loading_effects
from ..answer.budget.source import Flights
from ..answer.joint import effects_in
from ..answer.notices import air_notices, flight_notices, with_mesh_error
from ..answer.partition import partition_curves
from ..answer.provenance import Refinement, provenance_of
from ..answer.result import (
    FILE,
    GRANULES,
    JOINT,
    SCHEMA,
    FlightResults,
    Request,
    Result,
    key_in,
    provenance_in,
    refinement_in,
    replaced,
    request_in,
)
from ..answer.shares import InputSummary, LandingResults, collisions_of
from ..core import own_files
from ..core.errors import SceneError
from ..core.files import made_folder, path_of, remove_drafts
from ..core.graded import Notice, gravest_first, less_sure
from ..core.lazy import cached_property
from ..core.process import background, check_workers, cores
from ..core.store import cache_in_use, cache_root
from ..core.tables import save_arrays
from ..flight.feed.impact_loads import impact_loads
from ..flight.stages.machine_rates import learn
from ..flight.stages.pipeline import Pipeline
from ..planning.feed_funnel import FunnelSummary, by_law_line, discharge_lines
from ..planning.stage_cache import Listener, null_listener
from ..scene import Scene
from ..scene.changes import stem_name
from ..scene.scene_tables import States
from .folder import (
    COMMAND,
    LOCK,
    answer_key,
    drawn_ahead,
    refuse_foreign,
    report_into,
    seen_of,
    some_granules,
    versions,
    written_files,
)
from .planned import make_plan
from .progress import as_listener, ignore
from .refine import refined
from .run_stages import as_blown, one_thread_of_blas, stages_of
from .time_budget import affordable

if TYPE_CHECKING:
    from ..flight.stages.landings import Landings
    from ..planning.plan import Plan
    from ..show import AirAndTracks


@dataclass(frozen=True)
class OneRun:
    """One run: the scene as asked for, the pipeline that computes it, and where its answer goes."""

    given: Scene
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
        pipeline, until = self.pipeline, self.request.until
        with background(self._ahead()):
            mesh, airflow = self._air()
            flown = self.flights if until in (None, "tracks") else None
        if flown is not None and airflow is not None:  # what is known of the field that granules fly in
            airflow = replace(airflow, divergence=pipeline.divergence, truncation=pipeline.air.field.truncation)
        key, solver = self._key(flies=flown is not None), "" if airflow is None else pipeline.air.solver
        result = Result(
            schema=SCHEMA,
            scene=self.given.tables(),
            options=self.request,
            plan=pipeline.plan,
            funnel=self.poured,
            airflow=airflow,
            mesh=mesh,
            flights=None,
            landings=None,
            warnings=(),
            grades=(),
            seconds=pipeline.seconds,
            versions=versions(),
            key=key,
            provenance=provenance_in(self.folder, key) or provenance_of(pipeline.scene, solver),
            refinement=self.refinement,
            folder=self.folder,
        )
        if flown is None:
            return self.written(self._warned(result, ()), {})
        tracked, loads = flown.tracked, impact_loads(pipeline.scene, pipeline.plan)
        result = replace(result, flights=FlightResults(tracked.fates, tracked.injected, loads))
        if until is None:
            result = self._answered(result, flown)
        slab = None if result.landings is None else result.landings.slab
        result = self._warned(result, flight_notices(pipeline.scene, pipeline, tracked, slab))
        return self.written(result, flown.landings)

    @cached_property
    def flights(self) -> Flights:
        """The granules' flights, with all that the sources of the budget fly again where the run goes on to shares."""
        flown = Flights(self.pipeline, self.pipeline.tracks())
        if self.request.until is not None:
            return flown
        with background([self._draw_ahead]):
            return fly_again(flown)

    def _warned(self, result: Result, of_flights: Iterable[Notice]) -> Result:
        """The result with what a user must know of it; of its granules that are the notices ``of_flights``."""
        scene, pipeline = self.pipeline.scene, self.pipeline
        notices = [] if result.airflow is None else air_notices(scene, pipeline, result.airflow)
        if self.poured is not None:
            notices += map(less_sure, discharge_lines(self.poured))
        elif scene.funnel is not None and not scene.funnel.computed:
            notices.append(less_sure(by_law_line(scene.funnel)))
        small = total_notices(result.budget, pipeline.plan.target_error)
        known = gravest_first((*notices, *of_flights, *pipeline.plan.notices, *small))
        return replaced(
            result,
            warnings=tuple(notice.text for notice in known),
            grades=tuple(notice.grade.value for notice in known),
        )

    def written(self, result: Result, landings: Mapping[str, Landings]) -> Result:
        """The result with its pictures, its folder written; the ``landings`` of granules that flew are in them."""
        with own_files.writing(self.folder, partial(written_files, self.folder), COMMAND):
            result = replaced(result, limits=tuple(verdicts_of(result)))
            result = self._drawn(result, landings)
            result.save()
        return result

    def _ahead(self) -> list[Callable[[], object]]:
        """What another core makes while this one waits for the airflow; nothing on one core, or without such a wait."""
        pipeline, until = self.pipeline, self.request.until
        threads = cores() if pipeline.workers is None else pipeline.workers
        if threads < 2 or until in ("funnel", "mesh") or pipeline.air.at_once:
            return []
        spare = replace(pipeline)  # the two threads share what is in the cache, nothing else
        coarser = spare.grids[1:]  # from which the answer's airflow starts in time
        others = [spare.steady] if pipeline.plan.airflow.brackets else coarser
        solved: list[Callable[[], object]] = [partial(getattr, other.air.in_case, "solution") for other in others]
        if pipeline.plan.airflow.loaded:
            solved.insert(0, spare.airs.solve_start)  # while the force is gathered
        return solved if until is not None else [*solved, *flights_ahead(spare)]

    @cached_property
    def _seen(self) -> AirAndTracks:
        """What the report shows of the air and the tracks."""
        return seen_of(self.pipeline, self.pipeline.tracks())

    def _draw_ahead(self) -> None:
        """Draw what the report shows before there is an answer, while granules fly again."""
        if self.report:
            drawn_ahead(self.pipeline, self._seen, pdf=self.pdf)

    def _air(self) -> tuple[MeshReport | None, Airflow | None]:
        """The mesh and the airflow; None without air, and where the run stops before them."""
        pipeline, scene, until = self.pipeline, self.pipeline.scene, self.request.until
        if scene.air is None or until == "funnel":
            return None, None
        flies = until not in ("mesh", "airflow") or (until == "airflow" and pipeline.plan.airflow.loaded)
        if flies and not pipeline.air.at_once:
            pipeline.compile_in_background()
        mesh = pipeline.air.mesh_quality or None
        if until == "mesh":
            return mesh, None
        airflow = replace(pipeline.airflow, grids=airflow_on_grids(pipeline))
        loading = None if pipeline.loading is None else pipeline.loading.summary
        fan = airflow.by_fan(scene, loaded=loading is not None)
        table = replace(airflow, momentum=airflow.by_momentum(scene), loading=loading, fan=fan)
        return mesh, with_mesh_error(table)

    def _answered(self, result: Result, flights: Flights) -> Result:
        """The result with its shares, and all that is known of their errors."""
        scene = self.pipeline.scene
        joint, budget = make_budget(flights)
        separation, alone, slab = joint.own.separation(), None, None
        for collisions in flights.slab:
            alone = of_granules_alone(flights).own.separation()
            slab = collisions_of(self.pipeline.collision_stage.collisions, collisions)
        bracket = next((wakes.means(list(scene.bin)) for wakes in flights.of(MODEL)), {})
        loading = self.pipeline.loading
        effects = {} if loading is None else loading_effects(loading, separation.bins)
        known = {unknown.key: InputSummary.of(unknown) for unknown in flights.draws.unknowns}
        cuts = partition_curves(scene, self.pipeline.plan, flights.landings, joint.own)
        separation = replace(separation, cut=cuts)
        beside = in_three_dimensions(scene, self.pipeline.plan)
        parts, of_targets = effects_in(joint.own) if known else ({}, {})
        landings = LandingResults(
            separation, bracket, budget, alone, slab, effects, beside, known, parts, of_targets, joint.record()
        )
        return replace(result, landings=landings).with_joint(joint)

    def _key(self, *, flies: bool) -> str:
        """What the answer depends on."""
        collisions = self.pipeline.collisions_key if flies and self.request.until is None else None
        tracks = self.pipeline.tracks_key if flies else None
        return answer_key(self.given, self.request, self.pipeline.plan.summary(), tracks, collisions)

    def _drawn(self, result: Result, landings: Mapping[str, Landings]) -> Result:
        """The result with the pictures of its report, which is drawn where it is not in the folder already."""
        from .. import show as report

        folder, scene = self.folder, self.pipeline.scene
        unchanged = key_in(folder) == result.key
        if not unchanged:  # the new answer is there: the older one goes whole, so that no mixture is left
            (folder / FILE).unlink(missing_ok=True)
            report.clear_report(folder)
            for file in (GRANULES, JOINT):
                (folder / file).unlink(missing_ok=True)
        if result.landings is not None:
            save_arrays(folder / JOINT, result.joint.arrays(), compressed=True)
        if landings:
            granules = some_granules(scene, landings)
            save_arrays(folder / GRANULES, {"names": np.array(list(landings)), **granules})
            wanted = self.request.until is None and self.report
            if wanted and (self.redraw or not unchanged or not report.is_whole(folder, scene.picture)):
                report_into(self.pipeline, self._seen, landings, granules, result, pdf=self.pdf)
            return replaced(result, pictures=report.pictures_of(folder))
        if self.request.until == "funnel" and self.poured is not None:
            report.draw_discharge(folder / "figures" / "discharge.png", self.poured)
        return result


# -- run(), and one run of it ------------------------------------------------------------------------------------------
STOPS = ("funnel", "mesh", "airflow", "tracks")  # stages after which a run can be asked to stop


def run(
    scene: Scene | Path | str,
    out: Path | str | None = None,
    *,
    until: str | None = None,
    rung: str | None = None,
    force: States | None = None,
    target_error: float | str | None = None,
    near: Path | str | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
    planned: Callable[[Plan], object] | None = None,
    redraw: bool = False,
    report: bool = True,
    refine: bool = True,
    quick: bool = False,
    budget: float | str | None = None,
) -> Result:
    """Compute ``scene``, or that of a scene file, and write results to the folder ``out`` (runs/scene, or runs/ and the
    file's name); finished stages come from the cache.

    ``until`` stops after "funnel", "mesh", "airflow" or "tracks" (no separation then); ``rung``, ``force`` and
    ``target_error`` override the plan (``planning.make_plan``); ``workers`` threads track. The steady airflow is solved
    on from that of the run in the folder ``near``, whatever its mesh, speed or size, else from rest; the answer depends
    on it within what it may move once it counts as steady, and is kept apart. With a ``target_error`` the
    scene's granules, tolerance, mesh and averages are chosen so that computing alone knows every bin share to it
    (:mod:`.refine`), unless ``refine`` is False. ``listener(stage, text)`` hears of progress, one call at a
    time: ``print`` serves, and a notebook shows a bar by itself; ``planned(plan)`` hears before of what will be done.
    ``quick`` answers in half a minute with coarse settings and no time-resolved wake; with a ``budget`` (s, or "3 min")
    the finest settings are chosen that are expected to fit into it (:mod:`.time_budget`).
    ``redraw`` draws a finished report anew; without ``report`` none is drawn, and a later call without that draws it.
    Raises SceneError for wrong input, ProgramError when Gmsh or OpenFOAM fails.
    """
    given, folder = Scene.of(scene), folder_of(scene, out)
    request = Request.of(until, rung, force, target_error, near)
    listener, planned = as_listener(listener, planned)
    once = partial(
        run_once, folder=folder, request=request, workers=workers, listener=listener, planned=planned, redraw=redraw
    )
    if quick or budget is not None:
        given, request = affordable(given, request, partial(once, report=False), listener, quick=quick, budget=budget)
        return once(given, request=request, report=report)
    if request.target_error is None or until is not None or not refine:
        return once(given, report=report)

    plan = make_plan(given, rung=rung, force=request.force, target_error=request.target_error)
    result = refined(given, request.target_error, partial(once, report=False), plan, listener)
    return once(Scene.parse(result.scene), report=True, refinement=result.refinement) if report else result


def folder_of(scene: Scene | Path | str, out: Path | str | None) -> Path:
    """The folder ``out``, or runs/scene, or runs/ and the name of the scene's file."""
    if out is not None:
        return path_of(out, "out")
    return Path("runs", stem_name(Path(scene).stem) if isinstance(scene, Path | str) else "scene")


def run_once(scene: Scene, folder: Path, request: Request, **how: Any) -> Result:
    """Run a scene as it is; ``how``: as of :func:`running`."""
    with running(scene, folder, request, **how) as run:
        return run.result()


@contextmanager
def running(
    scene: Scene,
    folder: Path,
    request: Request,
    *,
    workers: int | None = None,
    listener: Listener = null_listener,
    planned: Callable[[Plan], object] = ignore,
    redraw: bool = False,
    report: bool = True,
    refinement: Refinement | None = None,
    pdf: bool = False,
    made: Plan | None = None,
) -> Iterator[OneRun]:
    """The run of a scene as it is, in its folder, into which nobody else writes while the block runs; ``refinement``:
    how its settings came about; ``made``: its plan, where there is one.
    """
    from filelock import FileLock, Timeout

    _check(scene, folder, request, workers)
    made_folder(folder)
    try:
        lock = FileLock(folder / LOCK, timeout=0).acquire()
    except Timeout:
        raise SceneError(f"another run is writing to {folder}; wait for it or choose another --out") from None
    with lock, cache_in_use(cache_root()), one_thread_of_blas():
        remove_drafts(folder)
        remove_drafts(folder / "figures")
        pipeline, poured = stages_of(scene, request, workers, listener, planned, made)
        blown = as_blown(scene, pipeline)
        yield OneRun(blown, pipeline, poured, folder, request, redraw, report, refinement, pdf)
        if workers is None and request.near is None:  # all cores, from rest: as the plan expects it
            spent = {stage: took.seconds for stage, took in pipeline.seconds.items() if not took.cached}
            learn(pipeline.store.root, pipeline.plan.stages, spent)


def _check(scene: Scene, folder: Path, request: Request, workers: int | None) -> None:
    """Raise SceneError where a run cannot be made as it was asked for."""
    if request.until not in (None, *STOPS):
        raise SceneError(f"until = {request.until!r}: choose funnel, mesh, airflow or tracks")
    if request.until == "funnel" and (scene.funnel is None or not scene.funnel.computed):
        raise SceneError("until = 'funnel': the scene has no [funnel] table, or one whose beads are not computed")
    check_workers(workers)
    if request.near is not None and Path(request.near).resolve() == folder.resolve():
        raise SceneError(f"--near {request.near}: is the run's own folder; name another run")
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"--out {folder}: is a file; name a folder")
    refuse_foreign(folder)


# -- From a finished run: its report drawn anew ------------------------------------------------------------------------
def report_again(folder: Path | str, *, pdf: bool = False) -> Path:
    """Draw the report of a finished run anew, from its result.json and the cache, with ``pdf`` every figure as PDF too.
    Returns the path of report.html.

    Raises SceneError where the folder holds no finished run.
    """
    scene, request = request_in(folder)
    if (calibration := Result.load(folder).calibration) is not None:
        raise SceneError(
            f"{folder} holds an answer that was calibrated with {calibration.source}; wakeflow calibrate draws it anew"
        )
    run_once(Scene.parse(scene), Path(folder), request, redraw=True, refinement=refinement_in(folder), pdf=pdf)
    return Path(folder) / "report.html"
