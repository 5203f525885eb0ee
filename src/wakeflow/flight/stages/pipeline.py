"""mesh -> airflow -> field -> tracks -> slab: every stage cached, each reading only what is before it.

The airflow and its field are a ``FlownAir`` (``air.kinds.airflow_kinds``), which ``airs`` makes by the plan; the tracks
and all that flies granules again belong to ``reruns``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from ...air.kinds.airflow_kinds import FlownAir
from ...air.kinds.airflow_table import Airflow, FieldDivergence
from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.process import cores
from ...core.store import Store, cache_root, content_key
from ...core.tables import Columns
from ...planning.feed_funnel import ENGINE, FunnelSummary, bead_engines
from ...planning.plan import Plan
from ...planning.stage_cache import Listener, StageCache, StageTimes, code_of, null_listener, version_of
from ...planning.stages import OWN, AirLabel, StageKey
from ...scene import Scene
from .air_loading import AirLoading
from .airs import Airs
from .compilation import Compilation
from .fraction_flights import Flight
from .reruns import ANSWER, CollisionStage, Found, PictureRerun, Rerun, SlabRerun, Work, unweighed

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...air.kinds.realisations import Realisations
    from ...scene import Picture
    from .landings import Tracked
    from .slab_stage import SlabFound

CODE = "flight.stages.fraction_flights", "flight.stages.landings"  # what computes the tracks


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

    @property
    def threads(self) -> int:
        """How many compute."""
        return self.workers or cores()

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
        return Airs(self.scene, self.plan, self.cache, self.near, self.compilation, self.threads)

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

    def realised(self, wake: tuple[float, ...]) -> Realisations:
        """The airflow with the theta and the strength of a ``wake``; empty: as it is."""
        airs = self.air.realisations
        return replace(airs, field=self.air.between(*wake), others=()) if wake and airs.field is not None else airs

    def flight(self, scene: Scene, airs: Realisations) -> Flight:
        """What flies granules of ``scene``, a variation of the own one, through ``airs`` as the answer's fly."""
        return Flight(scene, self.plan, airs, self.scene.numerics.tolerance, self.threads)

    @cached_property
    def tracks_key(self) -> str:
        """Everything the tracks depend on."""
        tables = unweighed(self.scene, "numerics", "funnel", "collisions", "force", "uncertainty")
        how = {name: row.tracked for name, row in self.plan.fractions.items()}
        versions = [version_of(package) for package in ("numpy", "scipy", "numba")]
        order = list(self.scene.bin)  # landings hold the bin's place in it
        flown = self.plan.airflow.mirrored, len(self.air.realisations), self.air.realisations.cycles
        return content_key("tracks", tables, order, *flown, repr(how), self.air.key, code_of(*CODE), versions)

    def run(self, rerun: Rerun[Found]) -> Found:
        """What a rerun of these granules in these airs finds, from the cache or flown."""
        return self.made(rerun.name, rerun.on(self))

    def made(self, name: str, work: Work[Found]) -> Found:
        """The same of any ``work`` on these granules, a stage by ``name``."""
        key = content_key(self.tracks_key, *work.key)
        return work.read(self.compilation.make(self.cache, name, key, work.fly, work.begun, slab=work.meet))

    def tracks(self) -> Tracked:
        """Every granule's landing, each alone."""
        return self.run(ANSWER)

    @cached_property
    def collision_stage(self) -> CollisionStage:
        """The slab. Raises SceneError where the plan has none."""
        if self.plan.crowd is None:
            raise SceneError("collisions: the plan has no granules meet; switch them on with --force collisions=on")
        return CollisionStage(self, self.plan.crowd)

    @property
    def collisions_key(self) -> str:
        """Everything the slab depends on; empty where the plan has none."""
        return "" if self.plan.crowd is None else self.collision_stage.key

    def crowd(self) -> SlabFound:
        """The landings of granules that meet each other. Raises SceneError where the plan has no slab."""
        return self.run(SlabRerun())

    def shown(self, picture: Picture) -> dict[str, list[Columns]]:
        """The tracks that a picture draws, by fraction: flown for it, from the same feed."""
        return self.run(PictureRerun("shown", picture=picture)) if picture.flown[0] else {}

    def compile_in_background(self) -> None:
        """Have the tracker compiled by another process while this one waits for OpenFOAM."""
        self.compilation.begin(self.store.root / "log.compile", slab=self.plan.crowd is not None)
