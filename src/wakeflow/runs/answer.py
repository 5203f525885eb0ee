"""One run's answer: stages made, budget drawn up, result.json filled."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..air.kinds.airflow_table import Airflow, MeshReport
from ..answer.budget.budget import flights_ahead, fly_again, make_budget, total_notices
from ..answer.budget.inputs import UNKNOWN
from ..answer.budget.mesh import airflow_on_grids
from ..answer.budget.model import MODEL, loading_effects
from ..answer.budget.source import Flights
from ..answer.budget.third_dimension import in_three_dimensions
from ..answer.budget.verdicts import verdicts_of
from ..answer.joint import JointAnswer, effects_in
from ..answer.notices import notices, with_mesh_error
from ..answer.partition import partition_curves
from ..answer.provenance import Refinement, provenance_of
from ..answer.result import FILE, GRANULES, JOINT, SCHEMA, FlightResults, Request, Result, key_in, provenance_in
from ..answer.shares import InputSummary, LandingResults, collisions_of
from ..core import sums
from ..core.graded import gravest_first
from ..core.lazy import cached_property
from ..core.process import background, cores
from ..core.tables import save_arrays
from ..flight.feed.impact_loads import impact_loads
from ..flight.stages.pipeline import Pipeline
from ..planning.feed_funnel import FunnelSummary
from ..scene import Scene
from .folder import (
    COMMAND,
    answer_key,
    drawn_ahead,
    report_into,
    seen_of,
    some_granules,
    versions,
    written_files,
)

if TYPE_CHECKING:
    from ..flight.stages.landings import Landings, Tracked
    from ..show import AirAndTracks


@dataclass(frozen=True)
class OneRun:
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
        with background(self._ahead()):
            mesh, airflow = self._air()
            tracked = None if until in ("funnel", "mesh", "airflow") else self.pipeline.tracks()
            if tracked is not None and until is None:
                with background([self._draw_ahead]):
                    flown = fly_again(Flights(self.pipeline, tracked, self.pipeline.crowd()))
        if tracked is not None and airflow is not None:
            airflow = self._flown(airflow)
        scene, plan, flights = self.pipeline.scene, self.pipeline.plan, None
        if tracked is not None:
            flights = FlightResults(tracked.fates, tracked.injected, impact_loads(scene, plan))
        landings, joint = (None, None) if flown is None else self._landings(flown)
        slab = None if landings is None else landings.slab
        told = notices(scene, self.pipeline, airflow, self.poured, tracked, slab)
        small = total_notices(() if landings is None else landings.budget, plan.target_error)
        known = gravest_first((*told, *plan.notices, *small))
        key, solver = self._key(tracked), None if airflow is None else self.pipeline.air.solver
        result = Result(
            schema=SCHEMA,
            scene=self.asked.tables(),
            options=self.request,
            plan=plan,
            funnel=self.poured,
            airflow=airflow,
            mesh=mesh,
            flights=flights,
            landings=landings,
            warnings=tuple(notice.text for notice in known),
            grades=tuple(notice.grade.value for notice in known),
            seconds=self.pipeline.seconds,
            versions=versions(),
            key=key,
            provenance=provenance_in(self.folder, key) or provenance_of(scene, solver),
            refinement=self.refinement,
            folder=self.folder,
        )
        return self.written(result, tracked, None if flown is None else flown.landings, joint)

    def written(
        self, result: Result, tracked: Tracked | None, answer: Mapping[str, Landings] | None, joint: JointAnswer | None
    ) -> Result:
        """The result with its pictures, its folder written."""
        with sums.writing(self.folder, partial(written_files, self.folder), COMMAND):
            result = result.with_joint(joint)
            result = replace(result, limits=tuple(verdicts_of(result))).with_joint(joint)
            result = self._drawn(result, tracked, answer, joint).with_joint(joint)
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
        solved: list[Callable[[], object]] = [partial(getattr, other, "solution") for other in others]
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
        mesh = pipeline.air.mesh_quality
        if until == "mesh":
            return mesh, None
        airflow = pipeline.airflow
        studies = airflow_on_grids(pipeline)
        loading = None if pipeline.loading is None else pipeline.loading.summary
        fan = airflow.by_fan(scene, loaded=loading is not None)
        table = replace(airflow, grids=studies, momentum=airflow.by_momentum(scene), loading=loading, fan=fan)
        return mesh, with_mesh_error(table, studies or ())

    def _flown(self, airflow: Airflow) -> Airflow:
        """The airflow with what is known of the field that granules fly in."""
        return replace(airflow, divergence=self.pipeline.divergence, truncation=self.pipeline.air.truncation)

    def _landings(self, flights: Flights) -> tuple[LandingResults, JointAnswer]:
        scene = self.pipeline.scene
        joint, budget = make_budget(flights)
        separation, crowd = joint.own.separation(), flights.crowd
        alone = None if crowd is None else make_budget(replace(flights, crowd=None))[0].own.separation()
        slab = None if crowd is None else collisions_of(self.pipeline.plan, crowd)
        wakes = flights.of(MODEL)
        bracket = None if wakes is None else wakes.means(list(scene.bin))
        loading = self.pipeline.loading
        effects = {} if loading is None else loading_effects(loading, separation.bins)
        draws = flights.of(UNKNOWN)
        known = {} if draws is None else {one.key: InputSummary.of(one) for one in draws.unknowns}
        cuts = partition_curves(scene, self.pipeline.plan, flights.landings, joint.own)
        separation = replace(separation, cut=cuts)
        beside = in_three_dimensions(scene, self.pipeline.plan)
        parts, of_targets = effects_in(joint.own) if known else ({}, {})
        return LandingResults(
            separation, bracket, budget, alone, slab, effects, beside, known, parts, of_targets, joint.record()
        ), joint

    def _key(self, tracked: Tracked | None) -> str:
        """What the answer depends on."""
        crowd = self.pipeline.collisions_key if tracked and self.request.until is None else None
        tracks = self.pipeline.tracks_key if tracked else None
        return answer_key(self.asked, self.request, self.pipeline.plan.summary(), tracks, crowd)

    def _drawn(
        self, result: Result, tracked: Tracked | None, answer: Mapping[str, Landings] | None, joint: JointAnswer | None
    ) -> Result:
        """The result with the pictures of its report, which is drawn where it is not in the folder already; the
        ``answer``'s landings, where there is one, are in them.
        """
        from .. import show as report

        folder, scene = self.folder, self.pipeline.scene
        stands = key_in(folder) == result.key
        if not stands:  # the new answer is there: the older one goes whole, so that no mixture is left
            (folder / FILE).unlink(missing_ok=True)
            report.clear_report(folder)
            for file in (GRANULES, JOINT):
                (folder / file).unlink(missing_ok=True)
        if joint is not None:
            save_arrays(folder / JOINT, joint.arrays(), compressed=True)
        if tracked is not None:
            landings = tracked.landings if answer is None else answer
            granules = some_granules(scene, landings)
            save_arrays(folder / GRANULES, {"names": np.array(list(landings)), **granules})
            wanted = self.request.until is None and self.report
            if wanted and (self.redraw or not stands or not report.is_whole(folder, scene.picture)):
                report_into(self.pipeline, self._seen, landings, granules, result, pdf=self.pdf)
            return replace(result, pictures=report.pictures_of(folder))
        if self.request.until == "funnel" and self.poured is not None:
            report.draw_discharge(folder / "figures" / "discharge.png", self.poured)
        return result
