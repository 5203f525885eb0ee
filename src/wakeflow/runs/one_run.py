"""run(): one scene computed in one folder; and of a finished run its report drawn anew."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..answer.provenance import Refinement
from ..answer.result import Request, Result, asked_in, refinement_in
from ..core.errors import SceneError
from ..core.files import made_folder, path_of, remove_drafts
from ..core.process import check_workers
from ..core.store import cache_in_use, cache_root
from ..flight.stages.machine_rates import learn
from ..planning.stage_cache import Listener, null_listener
from ..scene import Scene
from ..scene.changes import stem_name
from ..scene.whole import States
from .answer import OneRun
from .effort import affordable
from .folder import LOCK, refuse_foreign
from .planned import make_plan
from .progress import as_listener, ignore
from .refine import refined
from .run_stages import as_blown, one_thread_of_blas, stages_of

if TYPE_CHECKING:
    from ..planning.plan import Plan


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
    the finest settings are chosen that are expected to fit into it (:mod:`.effort`).
    ``redraw`` draws a finished report anew; without ``report`` none is drawn, and a later call without that draws it.
    Raises SceneError for wrong input, ProgramError when Gmsh or OpenFOAM fails.
    """
    name = stem_name(Path(scene).stem) if isinstance(scene, Path | str) else "scene"
    asked, folder = Scene.of(scene), Path("runs", name) if out is None else path_of(out, "out")
    request = Request.asked(until, rung, force, target_error, near)
    listener, planned = as_listener(listener, planned)
    once = partial(
        run_once, folder=folder, request=request, workers=workers, listener=listener, planned=planned, redraw=redraw
    )
    if quick or budget is not None:
        asked, request = affordable(asked, request, partial(once, report=False), listener, quick=quick, budget=budget)
        return once(asked, request=request, report=report)
    if request.target_error is None or until is not None or not refine:
        return once(asked, report=report)

    plan = make_plan(asked, rung=rung, force=request.force, target_error=request.target_error)
    found = refined(asked, request.target_error, partial(once, report=False), plan, listener)
    return once(Scene.parse(found.scene), report=True, refinement=found.refinement) if report else found


def run_once(
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
) -> Result:
    """Run a scene as it is; ``refinement``: how its settings came about; ``made``: its plan, where there is one."""
    from filelock import FileLock, Timeout

    _check(scene, folder, request, workers)
    made_folder(folder)
    try:
        with FileLock(folder / LOCK, timeout=0), cache_in_use(cache_root()), one_thread_of_blas():
            remove_drafts(folder)
            remove_drafts(folder / "figures")
            pipeline, poured = stages_of(scene, request, workers, listener, planned, made)
            asked = as_blown(scene, pipeline)
            result = OneRun(asked, pipeline, poured, folder, request, redraw, report, refinement, pdf).result()
            if workers is None and request.near is None:  # all cores, from rest: as the plan expects it
                spent = {stage: one.seconds for stage, one in pipeline.seconds.items() if not one.cached}
                learn(pipeline.store.root, pipeline.plan.stages, spent)
            return result
    except Timeout:
        raise SceneError(f"another run is writing to {folder}; wait for it or choose another --out") from None


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
    scene, asked = asked_in(folder)
    if (told := Result.load(folder).calibration) is not None:
        raise SceneError(
            f"{folder} holds an answer that was calibrated with {told.source}; wakeflow calibrate draws it anew"
        )
    run_once(Scene.parse(scene), Path(folder), asked, redraw=True, refinement=refinement_in(folder), pdf=pdf)
    return Path(folder) / "report.html"
