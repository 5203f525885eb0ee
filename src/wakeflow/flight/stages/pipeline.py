"""mesh -> airflow -> field -> tracks -> slab: every stage cached, each reading only what is before it.

The airflow and its field are a ``FlownAir`` (``air.kinds.airflow_kinds``), which ``airs`` makes by the plan; the tracks
belong to ``track_stage``, granules that meet each other to ``slab_stage``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...air.kinds.airflow_kinds import FlownAir
from ...air.kinds.airflow_table import Airflow, FieldDivergence
from ...core.lazy import cached_property
from ...core.process import cores
from ...core.store import Store, cache_root
from ...core.tables import Columns
from ...planning.feed_funnel import ENGINE, FunnelSummary, bead_engines
from ...planning.plan import Plan
from ...planning.stage_cache import Listener, StageCache, StageTimes, null_listener
from ...planning.stages import OWN, AirLabel, StageKey
from ...planning.unknowns import Dependence
from ...scene import Scene
from .air_loading import AirLoading
from .airs import Airs
from .compilation import Compilation
from .input_samples import DrawStage, InputSamples, Joined
from .slab_stage import CollisionRerun, CollisionStage, SlabFound
from .track_stage import ANSWER, PerturbedRerun, TrackStage

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...air.mesh import MeshSpec
    from ...scene import Picture
    from .landings import Tracked


@dataclass
class Pipeline:
    """The stages of one scene under one plan; each is made at most once and comes from the cache where it can.

    ``label`` tells the stages of another airflow of the same scene apart in ``seconds`` and to the listener. From the
    airs ``near`` it those of this scene are solved on, on whatever meshes those are.
    """

    scene: Scene
    plan: Plan
    listener: Listener = null_listener
    workers: int | None = None
    store: Store = field(default_factory=lambda: Store(cache_root()))
    seconds: StageTimes = field(default_factory=StageTimes)
    label: AirLabel = OWN
    compilation: Compilation = field(default_factory=Compilation, repr=False)
    near: Airs | None = field(default=None, repr=False)

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

    # -- airflow -------------------------------------------------------------------------------------------------------

    @cached_property
    def airs(self) -> Airs:
        """Every air of the scene under its plan."""
        return Airs(self.scene, self.plan, self.cache, self.near, self.compilation, self.workers or cores())

    @cached_property
    def air(self) -> FlownAir:
        """What granules fly through: the plan's, on its finest grid."""
        return self.airs.answers[0]

    def through(self, air: FlownAir) -> Pipeline:
        """The same scene flown through another of its airs."""
        other = replace(self, plan=air.plan, label=air.cache.label)
        vars(other).update(airs=self.airs, air=air)
        return other

    @cached_property
    def grids(self) -> tuple[Pipeline, ...]:
        """The same scene on each of the plan's grids, this one first."""
        return self, *map(self.through, self.airs.answers[1:])

    @cached_property
    def steady(self) -> Pipeline:
        """The same scene in its steady airflow: the other end of the bracket, and where the first in time starts."""
        return self.through(self.airs.steady[0])

    @property
    def mesh_spec(self) -> MeshSpec:
        """What the plan wants meshed. Raises SceneError for an airflow without a mesh."""
        return self.air.in_case.mesh_spec

    @property
    def solution(self) -> tuple[str, Path]:
        """Key and folder of the airflow, an OpenFOAM case. Raises SceneError for an airflow without one."""
        return self.air.in_case.solution

    @property
    def airflow(self) -> Airflow:
        """What was measured on the airflow, or is known of it; it is solved where it is not yet."""
        return self.air.numbers

    @property
    def loading(self) -> AirLoading | None:
        """The granules' force on the airflow; None where the plan leaves it out."""
        return self.airs.loading

    @property
    def field(self) -> tuple[str, FlowField]:
        """Key and field on triangles that the tracker reads, of the whole channel. Raises SceneError in a vacuum."""
        return self.air.key, self.air.field

    @property
    def divergence(self) -> FieldDivergence:
        """How well the triangles that the tracker reads conserve volume."""
        divergence = self.air.field.divergence()
        return FieldDivergence(divergence.rms, divergence.max)

    # -- tracks --------------------------------------------------------------------------------------------------------

    @cached_property
    def track_stage(self) -> TrackStage:
        return TrackStage(self.scene, self.plan, self.cache, self.air, self.compilation, self.workers or cores())

    @property
    def tracks_key(self) -> str:
        """Everything the tracks depend on."""
        return self.track_stage.key

    def tracks(self, rerun: PerturbedRerun = ANSWER) -> Tracked:
        """Every granule's landing; of the first replicates' granules under a ``companion``'s change."""
        return self.track_stage.fly(rerun)

    def draws(self, joined: Joined = Dependence.joined) -> InputSamples | None:
        """Part of the granules under many draws of what nobody knows exactly, ``joined`` as the scene says or as an
        ``Ensemble`` does; None where all is known.
        """
        return DrawStage(self.track_stage, joined).fly()

    @cached_property
    def _collision_stage(self) -> CollisionStage | None:
        return None if self.plan.crowd is None else CollisionStage(self.track_stage, self.plan.crowd)

    @property
    def collisions_key(self) -> str:
        """Everything the slab depends on; empty where the plan has none."""
        return "" if self._collision_stage is None else self._collision_stage.key

    def crowd(self, beside: SlabFound | None = None) -> SlabFound | None:
        """The landings of granules that meet each other, of more replicates than ``beside``; None where the plan has no
        slab.
        """
        return None if self._collision_stage is None else self._collision_stage.fly(beside)

    def crowd_again(self, rerun: CollisionRerun) -> tuple[SlabFound, ...]:
        """The same of some replicates with one thing changed; nothing where the plan has no slab."""
        return () if self._collision_stage is None else (self._collision_stage.fly_again(rerun),)

    def shown(self, picture: Picture) -> dict[str, list[Columns]]:
        """The tracks that a picture draws, by fraction: flown for it, from the same feed."""
        return self.track_stage.shown(picture)

    def compile_in_background(self) -> None:
        """Have the tracker compiled by another process while this one waits for OpenFOAM."""
        self.compilation.begin(self.store.root / "log.compile", slab=self.plan.crowd is not None)
