"""mesh -> airflow -> field -> tracks -> slab: every stage cached, each reading only what is before it.

The airflow and its field belong to the kind of airflow that the plan chose (``air.kinds.airflow_kinds``), the tracks to
``track_stage``, granules that meet each other to ``slab_stage``; how a stage is kept and timed is in ``cache``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...air.kinds.airflow_kinds import AirflowKind, CaseAir
from ...air.kinds.airflow_table import Airflow, FieldDivergence
from ...air.kinds.every_kind import airflow_kinds
from ...air.kinds.solved_air import SolvedAir, SteadyAir, TimeResolvedAir
from ...core.errors import SceneError, known
from ...core.lazy import cached_property
from ...core.store import Store, cache_root
from ...core.tables import Columns
from ...planning.feed_funnel import ENGINE, FunnelSummary, bead_engines
from ...planning.make import Planner
from ...planning.plan import Plan
from ...planning.stage_cache import Listener, StageCache, StageTimes, null_listener
from ...planning.stages import OWN, AirLabel, StageKey
from ...scene import Scene
from ..feed.impact_loads import ImpactSummary, impact_loads
from .air_loading import AirLoading, DrivenAir, LoadedCase
from .compilation import Compilation
from .film_stage import Film, FilmStage
from .input_samples import DrawStage, Ensemble, InputSamples
from .slab_stage import CollisionRerun, CollisionStage, SlabFound
from .track_stage import PerturbedRerun, TrackStage

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...air.mesh import MeshReport, MeshSpec
    from ...scene import Picture
    from .landings import Tracked


@dataclass
class Pipeline:
    """The stages of one scene under one plan; each is made at most once and comes from the cache where it can.

    ``grid`` is the place among the plan's grids, 0 the answer's; ``label`` tells the stages of another airflow of the
    same scene apart in ``seconds`` and to the listener. ``planner`` made ``plan`` and plans the scene at other rungs;
    by default it is one with the plan's own options. From the airflow of a ``neighbour`` that of this scene is solved
    on, on whatever mesh that one stands. ``whole``: the pipeline whose steady end this one is, None where it is a
    scene's own.
    """

    scene: Scene
    plan: Plan
    listener: Listener = null_listener
    workers: int | None = None
    store: Store = field(default_factory=lambda: Store(cache_root()))
    seconds: StageTimes = field(default_factory=StageTimes)
    grid: int = 0
    label: AirLabel = OWN
    planner: Planner | None = None
    compilation: Compilation = field(default_factory=Compilation, repr=False)
    neighbour: Pipeline | None = None
    whole: Pipeline | None = field(default=None, repr=False)
    _grids: dict[int, Pipeline] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        self._grids[self.grid] = self
        if self.planner is None:
            self.planner = Planner(self.scene, self.plan.force, self.plan.target_error)

    @property
    def cache(self) -> StageCache:
        """Where the stages are kept, under this airflow's label."""
        return StageCache(self.store, self.listener, self.seconds, self.label)

    def spent(self, stage: str) -> float:
        """The run time (s) of a stage that is made, when it was computed."""
        return self.seconds[StageKey(self.label, stage)].seconds

    # -- feed ----------------------------------------------------------------------------------------------------------

    @cached_property
    def funnel(self) -> FunnelSummary | None:
        """What the scene's feed funnel delivers; None without one, and where its beads are not computed."""
        if self.scene.funnel is None or not self.scene.funnel.computed:
            return None
        return bead_engines[ENGINE].compute(self.scene.funnel, self.cache.make, partial(self.cache.tell, "funnel"))

    @property
    def impact_loads(self) -> ImpactSummary | None:
        """What the falling stream does to the first body; None where there is none, or another may be met before it."""
        return impact_loads(self.scene, self.plan)

    # -- airflow -------------------------------------------------------------------------------------------------------

    @cached_property
    def kind(self) -> AirflowKind:
        """What computes the airflow."""
        made: type[AirflowKind] = airflow_kinds[self.plan.airflow.kind]
        return made(
            self.scene, self.plan, self.cache, self.grid, lambda: self.draft._in_case,
            nearest=self._nearest, loading=lambda: self.loading,
        )  # fmt: skip

    def _nearest(self) -> CaseAir | None:
        """The neighbour's airflow of this kind on the grid like it; else, in time, that on the next coarser grid, or
        where the granules are felt, the coarsest under their force as it is known first.
        """
        how = self.plan.airflow
        in_time = how.stepping == "time-resolved"
        if self.neighbour is not None:
            near = self.neighbour if in_time else self.neighbour.draft
            found = near.on_grid(min(self.grid, len(near.plan.airflow.scales) - 1)).kind
            if isinstance(found, TimeResolvedAir if in_time else SteadyAir):
                return found
        if not in_time or not how.scales[1:] or (self.grid == len(how.scales) - 1 and not how.loaded):
            return None
        coarse = self.on_grid(len(how.scales) - 1 if how.loaded else self.grid + 1).kind
        return coarse.early if isinstance(coarse, TimeResolvedAir) else None

    def solve_start(self) -> None:
        """Solve what the airflow starts from, which need not wait for its force."""
        near = self.kind.nearest()
        if isinstance(near, SolvedAir):
            near.start()
            _ = near.solution

    @property
    def _in_case(self) -> CaseAir:
        """The airflow, where it is in an OpenFOAM case. Raises SceneError where it is not."""
        if not isinstance(self.kind, CaseAir):
            raise SceneError(f"airflow {self.plan.airflow.kind}: it has neither mesh nor OpenFOAM case")
        return self.kind

    @property
    def mesh_spec(self) -> MeshSpec:
        """What the plan wants meshed. Raises SceneError for an airflow without a mesh."""
        return self._in_case.mesh_spec

    @property
    def mesh_quality(self) -> MeshReport | None:
        """Counts and quality of the mesh; None without one."""
        return self.kind.mesh_quality

    @property
    def solution(self) -> tuple[str, Path]:
        """Key and folder of the airflow, an OpenFOAM case. Raises SceneError for an airflow without one."""
        return self._in_case.solution

    @property
    def airflow(self) -> Airflow:
        """What was measured on the airflow, or is known of it; it is solved where it is not yet."""
        return self.kind.table

    @cached_property
    def loading(self) -> AirLoading | None:
        """The granules' force on the airflow, gathered in the steady one on the answer's own grid; None where the plan
        leaves it out.
        """
        if not self.plan.airflow.loaded:
            return None
        if self.whole is not None:
            return self.whole.loading
        if self.grid:
            return self.on_grid(0).loading
        how = self.compilation, self.workers
        if self.plan.airflow.stepping is None:
            return DrivenAir(self.scene, self.plan, self.cache, self.kind.bare, *how)
        own = self if self.plan.airflow.stepping == "steady" else self.draft
        return LoadedCase(self.scene, own.plan, own.cache, own._in_case.bare, *how)

    @cached_property
    def field(self) -> tuple[str, FlowField]:
        """Key and field on triangles that the tracker reads, of the whole channel. Raises SceneError in a vacuum."""
        if self.kind.field is None:
            raise SceneError("the granules fly in a vacuum: there is no airflow")
        return self.kind.field

    @property
    def divergence(self) -> FieldDivergence:
        """How well the triangles that the tracker reads conserve volume."""
        found = self.field[1].divergence()
        return FieldDivergence(found.rms, found.max)

    # -- the same scene in another airflow -----------------------------------------------------------------------------

    @cached_property
    def draft(self) -> Pipeline:
        """The same scene in its steady airflow: the other end of the bracket, and where the first in time starts."""
        plan = known(self.planner).at(self.scene).plan("draft")
        plan = replace(plan, airflow=plan.airflow.feeling(self.scene, loaded=self.plan.airflow.loaded))
        grid = min(self.grid, len(plan.airflow.scales) - 1)
        return replace(self, plan=plan, grid=grid, label=self.label._replace(draft=True), whole=self)

    def on_grid(self, grid: int) -> Pipeline:
        """The same scene on another of the plan's grids; the same one whenever it is asked for."""
        if grid not in self._grids:
            other = replace(self, grid=grid, label=self.label._replace(grid=self.plan.airflow.scales[grid]))
            self._grids[grid], other._grids = other, self._grids
        return self._grids[grid]

    # -- tracks --------------------------------------------------------------------------------------------------------

    @cached_property
    def _track_stage(self) -> TrackStage:
        return TrackStage(self.scene, self.plan, self.cache, self.kind, self.compilation, self.workers)

    @property
    def tracks_key(self) -> str:
        """Everything the tracks depend on."""
        return self._track_stage.key

    def tracks(self, rerun: PerturbedRerun | None = None) -> Tracked:
        """Every granule's landing; of the first replicates' granules under a ``companion``'s change."""
        return self._track_stage.fly(rerun)

    @property
    def draw_stage(self) -> DrawStage:
        """What draws and flies what nobody knows exactly."""
        return DrawStage(self._track_stage)

    def draws_of(self, ensemble: Ensemble) -> InputSamples | None:
        """The same under draws of what is known of the unknowns once something was measured."""
        return DrawStage(self._track_stage, ensemble).fly()

    def draws(self) -> InputSamples | None:
        """Part of the granules under many draws of what nobody knows exactly; None where all is known."""
        return self.draw_stage.fly()

    @cached_property
    def _collision_stage(self) -> CollisionStage:
        return CollisionStage(self._track_stage)

    @property
    def collisions_key(self) -> str | None:
        """Everything the slab depends on; None where the plan has none."""
        return None if self.plan.crowd is None else self._collision_stage.key

    def crowd(self, rerun: CollisionRerun | None = None, beside: SlabFound | None = None) -> SlabFound | None:
        """The landings of granules that meet each other, of more replicates than ``beside``, of some under a
        ``companion``'s change; None where the plan has no slab.
        """
        if self.plan.crowd is None:
            return None
        self.compilation.finish_slab(self.cache)
        return self._collision_stage.fly(rerun, beside)

    def shown(self, picture: Picture) -> dict[str, list[Columns]]:
        """The tracks that a picture draws, by fraction: flown for it, from the same feed."""
        return self._track_stage.shown(picture)

    def film(self, span: float | None = None) -> Film:
        """The granules that are in the machine over ``span`` (s), on one clock: flown for a film."""
        self.compilation.finish_slab(self.cache)
        known = self._track_stage.airs, self.tracks_key, self.tracks().landings, self.workers
        return FilmStage(self.scene, self.plan, self.cache, *known).fly(span)

    def compile_in_background(self) -> None:
        """Have the tracker compiled by another process while this one waits for OpenFOAM."""
        self.compilation.begin(self.store.root / "log.compile", slab=self.plan.crowd is not None)
