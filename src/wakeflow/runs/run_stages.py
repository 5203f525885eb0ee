"""The stages of a scene as a run asks for them: under its plan, fed by its funnel, near another's airflow."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ..air.kinds.airflow_kinds import CaseAir
from ..answer.result import Request, request_in
from ..core.errors import SceneError, known
from ..core.store import content_key
from ..flight.stages.air_loading import exerted_by
from ..flight.stages.pipeline import Pipeline, unweighed
from ..planning.feed_funnel import FunnelSummary
from ..planning.stage_cache import Listener, StageTimes, thread_safe
from ..planning.stages import AirLabel
from ..planning.unknowns import half_of
from ..scene import Scene
from .planned import make_plan
from .progress import ignore

if TYPE_CHECKING:
    from ..planning.plan import Plan

CHANNEL = "air.fan.channel_loss"
FEW = 3  # airflows that are solved for a fan, of a kind
EVEN = 1e-3  # of the air's speed: how near to the fan's it is where the scene says that it is exact


def one_thread_of_blas() -> AbstractContextManager[object]:
    """Threads of the run's own share the cores; those of BLAS would wait for each other, and sum in their own order."""
    from threadpoolctl import threadpool_limits

    import_module("scipy.linalg")  # brings a BLAS of its own, and only what is loaded can be limited
    limits: AbstractContextManager[object] = threadpool_limits(1, user_api="blas")
    return limits


def stages_of(
    scene: Scene,
    request: Request,
    workers: int | None,
    listener: Listener,
    planned: Callable[[Plan], object] = ignore,
    made: Plan | None = None,
    before: tuple[Path, ...] = (),
) -> tuple[Pipeline, FunnelSummary | None]:
    """The stages of a scene, fed by its funnel where it has one, and what that funnel delivers; ``planned`` hears of
    the plan before, which may have been ``made`` elsewhere. ``before``: the folders of runs that start near it.
    """
    if scene.funnel is not None and not scene.funnel.computed:
        scene = scene.fed()
    plan_of = partial(make_plan, rung=request.rung, force=request.force, target_error=request.target_error)
    plan = plan_of(scene) if made is None else made
    planned(plan)
    one_at_a_time = thread_safe(listener)
    beside = None if request.near is None else _neighbour(Path(request.near), before, one_at_a_time)
    pipeline = Pipeline(
        plan.airflow.flown(scene), plan, one_at_a_time, workers, label=AirLabel(bool(before)),
        seconds=StageTimes() if beside is None else beside.seconds, near=None if beside is None else beside.airs,
    )  # fmt: skip
    poured = pipeline.funnel
    if poured is not None and request.until != "funnel":
        fed = _fed(scene, poured)
        plan = plan_of(fed)  # the bounds on loading follow the rate
        pipeline = replace(pipeline, scene=plan.airflow.flown(fed), plan=plan)
    fan = None if pipeline.scene.air is None else pipeline.scene.air.fan
    if fan is not None and plan.airflow.stepping and request.until not in ("funnel", "mesh"):
        pipeline = _blown(pipeline, plan_of)
    return pipeline, poured


def _blown(pipeline: Pipeline, plan_of: Callable[[Scene], Plan]) -> Pipeline:
    """The stages with the air at the speed at which the fan's curve meets the drop that is computed: first that of the
    steady airflow, which any other starts from, then the answer's own. Each is solved FEW times at most, and no more
    once the speed lies within the interval that the answer takes it to have; what is left is in the result.
    """
    steady = pipeline.plan.airflow.stepping == "steady"
    for of_answer in (True,) if steady else (False, True):
        loaded = of_answer and pipeline.plan.airflow.loaded
        for _ in range(FEW):
            scene, air = pipeline.scene, pipeline.air if of_answer else pipeline.airs.bare_steady[0]
            point, speed = known(air.numbers.by_fan(scene, loaded=loaded)), scene.airstream.speed
            near = point.off <= max(EVEN * speed, half_of(scene, "air.speed", "air_speed", speed))
            if near or not point.meets > 0.0:
                break
            pipeline.listener("airflow", f"the fan has the air at {point.meets:.3g} m/s by its drop, not {speed:.3g}")
            blown = scene.replace({CHANNEL: air.numbers.loss(scene, loaded=loaded)})
            plan = plan_of(blown)
            pipeline = replace(pipeline, scene=plan.airflow.flown(blown), plan=plan)
    return pipeline


def as_blown(scene: Scene, pipeline: Pipeline) -> Scene:
    """The scene as it was asked for, with the channel's loss that the ``pipeline`` found its fan by."""
    fan = None if pipeline.scene.air is None else pipeline.scene.air.fan
    if fan is None or scene.airstream.fan == fan:
        return scene
    return scene.replace({CHANNEL: fan.channel_loss})


def _neighbour(folder: Path, before: tuple[Path, ...], listener: Listener) -> Pipeline:
    """The stages of the run in ``folder``, which may have ended with its airflow; ``before``: those that start from it.

    Raises SceneError where there is none, or where it starts from one of those itself.
    """
    here = folder.resolve()
    if here in before:
        raise SceneError(f"--near {folder}: that airflow starts from itself; name a run that was started from rest")
    tables, request = request_in(folder, whole=False)
    return stages_of(Scene.parse(tables), request, None, listener, before=(*before, here))[0]


def _fed(scene: Scene, poured: FunnelSummary) -> Scene:
    """The scene with the funnel's rate as its feed's. Raises SceneError where it needs one and the flow stopped."""
    if not poured.rate and not scene.feed.rate:
        raise SceneError(
            f"funnel: the flow stops with {poured.left} of {poured.beads} beads inside; widen "
            "funnel.orifice, shake it harder (funnel.gamma) or give feed.rate"
        )
    return scene.fed(poured.rate.value if poured.rate else None)


def airflow_key(scene: Scene, plan: Plan) -> str:
    """What tells the airflow of a scene from those of others; empty where it costs nothing."""
    air = Pipeline(plan.airflow.flown(scene), plan).air
    if air.at_once:
        return ""
    spec = repr(air.flow_spec) if isinstance(air, CaseAir) else repr(air.scene.air)
    return content_key(repr(plan.airflow), spec, exerted_by(scene, plan) if plan.airflow.loaded else None)


def flights_key(scene: Scene, plan: Plan) -> str:
    """What tells the flights of a scene from others in the same airflow."""
    how = {name: repr(row.tracked) for name, row in plan.fractions.items()}
    return content_key(unweighed(scene), list(scene.bin), how)
