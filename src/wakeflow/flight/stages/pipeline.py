"""mesh -> airflow -> field -> tracks -> slab: every stage cached, each reading only what is before it.

The airflow and its field are a ``FlownAir`` (``air.kinds.airflow_kinds``), which ``airs`` makes by the plan. Every
flight in it is a rerun: the answer's granules, all or some of them, with something changed or with nothing. A class of
reruns says what it changes, which flight that is and how its folder is read; :meth:`Pipeline.run` keys, keeps and times
each alike, under its name among the stages.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from ...air.kinds.airflow_kinds import FlownAir
from ...air.kinds.airflow_table import Airflow, FieldDivergence
from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.process import cores
from ...core.record import JsonTable
from ...core.store import Store, cache_root, content_key
from ...core.tables import Columns
from ...planning.collisions import CollisionPlan
from ...planning.cost import flown_again
from ...planning.feed_funnel import ENGINE, FunnelSummary, bead_engines
from ...planning.plan import COMPARED, INPUT_SAMPLES, REPLICATES, Plan
from ...planning.stage_cache import Listener, StageCache, StageTimes, code_of, null_listener, version_of
from ...planning.stages import OWN, AirLabel, StageCost, StageKey, Workload
from ...planning.unknowns import Dependence, half_of
from ...scene import Scene
from . import input_samples, slab_stage
from .air_loading import AirLoading
from .airs import Airs
from .compilation import Compilation
from .fraction_flights import Flight
from .input_samples import DrawStage, InputSamples, Joined
from .landings import Tracked, load_tracked, recorded_tracks
from .slab_stage import SlabFlight, SlabFound, late_in, steady_after

if TYPE_CHECKING:
    from ...air.field import FlowField
    from ...air.kinds.airflow_kinds import Realisations
    from ...scene import Picture

CODE = "flight.stages.fraction_flights", "flight.stages.landings"  # what computes the tracks


# -- Reruns: granules flown, as they are or with something changed -----------------------------------------------------
Found = TypeVar("Found")


class Work(NamedTuple, Generic[Found]):
    """What a rerun is of one pipeline: the ``key`` of what it depends on beside the granules and their air, what does
    ``fly`` it into a folder and ``read`` it there; whether granules ``meet`` in it; the folders of finished ones that
    have ``begun`` it.
    """

    key: tuple[object, ...]
    fly: Callable[[Path], object]
    read: Callable[[Path], Found]
    meet: bool = False
    begun: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Rerun(ABC, Generic[Found]):
    """Granules of the answer flown again; ``name`` among the stages; ``times``: its run time as of ``flown_again``, 0
    where no plan counts it.
    """

    name: str
    times: float = 0.0

    @abstractmethod
    def on(self, pipeline: Pipeline) -> Work[Found]:
        """What it is of the granules of a ``pipeline`` in its air."""

    def costs(self, work: Workload, label: AirLabel = OWN) -> Iterable[StageCost]:
        """What it is expected to take, in the air with the ``label``."""
        return flown_again(work, self.name, self.times, label) if self.times else ()

    def tell(self, pipeline: Pipeline) -> Callable[[str], None]:
        """What hears of its progress."""
        return partial(pipeline.cache.tell, self.name)


# -- Granules that fly alone -------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class PerturbedRerun(Rerun[Tracked]):
    """Part of the granules flown again, the same ones, each alone: what a change changes is an error.

    ``looser``: factor on the scene's tolerance; ``wake``: theta and strength of the wake, as in ``field.blended_wake``,
    empty: the answer's own; ``noises``: intervals of noise that last as one; ``replicates``: the first of them, that
    fly; ``drawn``: tracks for pictures are kept.
    """

    times: float = 1.0
    looser: float = 1.0
    wake: tuple[float, ...] = ()
    noises: int = 1
    replicates: int = COMPARED
    drawn: bool = False

    def on(self, pipeline: Pipeline) -> Work[Tracked]:
        scene = pipeline.scene
        flight = replace(
            pipeline.flight(scene, pipeline.realised(self.wake)), tell=self.tell(pipeline), noises=self.noises,
            tolerance=self.looser * scene.numerics.tolerance, replicates=self.replicates,
        )  # fmt: skip
        key = flight.tolerance, self.wake, self.noises, self.replicates
        return Work(key, partial(flight.fly_all, drawn=self.drawn), partial(load_tracked, scene=scene))


ANSWER = PerturbedRerun("tracks", replicates=REPLICATES, drawn=True)  # all of them, with nothing changed


def unweighed(scene: Scene, *others: str) -> dict[str, object]:
    """The tables of a scene without what moves no granule: mass shares, targets, the feed's rate, pictures; and without
    ``others``.
    """
    tables: JsonTable = scene.model_dump(mode="json", by_alias=True)
    for fraction in tables["fraction"].values():
        del fraction["mass_share"], fraction["target"]
    del tables["feed"]["rate"], tables["feed"]["depth"]
    for name in ("picture", "report", "limit", "price", *others):
        del tables[name]
    return tables


@dataclass(frozen=True)
class PictureRerun(Rerun[dict[str, list[Columns]]]):
    """The tracks that a picture draws, by fraction, from the same feed."""

    picture: Picture = field(kw_only=True)

    def on(self, pipeline: Pipeline) -> Work[dict[str, list[Columns]]]:
        flown, names = self.picture.flown, self.picture.chosen(list(pipeline.scene.fraction))
        flight = replace(pipeline.flight(pipeline.scene, pipeline.air.realisations), tell=self.tell(pipeline))
        work = partial(flight.fly_pictured, names=names, count=flown[0], body_speed=flown[1])
        return Work((flight.tolerance, names, flown), work, partial(recorded_tracks, names=names))


# -- Granules under many draws of what nobody knows exactly ------------------------------------------------------------
SAMPLE_SECONDS = 0.004  # s: to draw the granules of a fraction anew, and its air


@dataclass(frozen=True)
class InputRerun(Rerun[InputSamples]):
    """Part of the granules under many draws, which are ``joined`` of independent standard normal numbers: as the scene
    ties them, or as an ``Ensemble`` does.
    """

    name: str = "draws"
    times: float = REPLICATES / COMPARED  # as many granules fly as the answer has
    joined: Joined = Dependence.joined

    def stage(self, pipeline: Pipeline) -> DrawStage:
        """What flies the draws."""
        of, tell = pipeline, self.tell(pipeline)
        return DrawStage(of.scene, of.plan, of.threads, tell, of.flight, of.realised, self.joined)

    def on(self, pipeline: Pipeline) -> Work[InputSamples]:
        stage, scene = self.stage(pipeline), pipeline.scene
        drawn = [[unknown.key, unknown.kind, unknown.value, unknown.low, unknown.high] for unknown in stage.unknowns]
        key = scene.numerics.tolerance, drawn, stage.design.tolist(), code_of(*input_samples.CODE)
        # The granules are the answer's, which are flown before this stage begins
        return Work(key, partial(stage.fly_all, pipeline.tracks()), stage.read)

    def costs(self, work: Workload, label: AirLabel = OWN) -> Iterable[StageCost]:
        drawn = 0.0 if work.airflow.rung == "none" else INPUT_SAMPLES * SAMPLE_SECONDS * work.fractions
        return flown_again(work, self.name, self.times, label, more=drawn)


# -- Granules that meet each other -------------------------------------------------------------------------------------
MIN_REPLICATES = 2  # replicates of a companion
STEP_ERROR_PART = 0.3  # of the accuracy asked for: landing error (body widths) of a step of the slab (docs/model.md)


@dataclass
class CollisionStage:
    """The slab of one scene under one plan, which says of it what is in ``collisions``, through one airflow, in which
    the granules of the ``pipeline`` have flown alone before.
    """

    pipeline: Pipeline
    collisions: CollisionPlan

    @cached_property
    def start_up(self) -> float:
        """Seconds until the slab is steady."""
        return steady_after(self.collisions, late_in(self.pipeline.tracks().landings))

    @property
    def tolerance(self) -> float:
        """Landing error (body widths) of a step of the slab's clock: shares feel SHARE_OF_SHIFT of it at most."""
        return max(self.pipeline.scene.numerics.tolerance, STEP_ERROR_PART * self.pipeline.plan.target_error)

    @cached_property
    def key(self) -> str:
        """Everything the slab's landings depend on."""
        scene, collisions = self.pipeline.scene, self.collisions
        fed = scene.feed.mass_flow, scene.feed.depth, scene.mass_shares(), repr(scene.collisions)
        flown = collisions.depth, collisions.tracers, collisions.operation, collisions.count, collisions.replicates
        return content_key(
            "collisions", self.pipeline.tracks_key, self.tolerance, *fed, *flown, code_of(*slab_stage.CODE)
        )

    def flight(self, rerun: Rerun[SlabFound]) -> SlabFlight:
        """What flies the slab for a ``rerun``."""
        of, collisions = self.pipeline, self.collisions
        return SlabFlight(
            of.scene, of.plan, of.air.realisations, collisions.depth, self.start_up, collisions.operation,
            self.tolerance, workers=of.threads, tell=rerun.tell(of),
        )  # fmt: skip

    def work(self, flight: SlabFlight, replicates: int, *key: object, begun: tuple[Path, ...] = ()) -> Work[SlabFound]:
        """Work of flying so many ``replicates`` of a ``flight``."""
        fly, read = partial(flight.fly_all, replicates=replicates), partial(flight.load, replicates=replicates)
        return Work((self.key, replicates, *key), fly, read, meet=True, begun=begun)


@dataclass(frozen=True)
class SlabRerun(Rerun[SlabFound]):
    """The answer of granules that meet: as many replicates as fly in any case, all where each has an airflow of its
    own; or more ``beside`` those of one before.
    """

    name: str = "slab"
    beside: tuple[SlabFound, ...] = ()

    def on(self, pipeline: Pipeline) -> Work[SlabFound]:
        stage = pipeline.collision_stage
        first = stage.collisions.fewest if len(pipeline.air.realisations) == 1 else stage.collisions.replicates
        replicates = max([first, *(stage.collisions.after(slab.replicates) for slab in self.beside)])
        return stage.work(stage.flight(self), replicates, begun=tuple(slab.folder for slab in self.beside))


@dataclass(frozen=True)
class CollisionRerun(Rerun[SlabFound]):
    """Part of the replicates of granules that meet flown again: factor on the step of the slab's clock, part of its
    depth that flies, how many halves of its interval are added to the ``restitution`` and to the ``friction`` of one
    granule on another.
    """

    step: float = 1.0
    depth: float = 1.0
    restitution: float = 0.0
    friction: float = 0.0

    def on(self, pipeline: Pipeline) -> Work[SlabFound]:
        stage, scene = pipeline.collision_stage, self.applied(pipeline.scene)
        flight = replace(
            stage.flight(self), scene=scene, part=self.depth, step=self.step * pipeline.collisions().clock.step
        )
        replicates = max(MIN_REPLICATES, stage.collisions.replicates // 4)
        return stage.work(flight, replicates, self.name, self.step, self.depth, repr(scene.collisions))

    def applied(self, scene: Scene) -> Scene:
        """The scene whose granules meet under this change."""
        law = scene.collisions
        restitution = law.restitution + self.restitution * half_of_meeting(scene, "restitution")
        friction = law.friction + self.friction * half_of_meeting(scene, "friction")
        met = {"restitution": min(1.0, max(0.0, restitution)), "friction": max(0.0, friction)}
        return scene.model_copy(update={"collisions": law.model_copy(update=met)})


def half_of_meeting(scene: Scene, number: str) -> float:
    """Half of the interval of a number of how one granule rebounds from another."""
    return half_of(scene, f"collisions.{number}", "collisions", getattr(scene.collisions, number))


# -- The pipeline ------------------------------------------------------------------------------------------------------
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
        """This scene flown through another of its airs."""
        other = replace(self, plan=air.plan, label=air.cache.label)
        vars(other).update(airs=self.airs, air=air)
        return other

    @cached_property
    def grids(self) -> tuple[Pipeline, ...]:
        """This scene on each of the plan's grids, this one first."""
        return self, *map(self.through, self.airs.answers[1:])

    @cached_property
    def steady(self) -> Pipeline:
        """This scene in its steady airflow: the other end of the bracket, and where the first in time starts."""
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
        """What any ``work`` on these granules finds, from the cache or made now: a stage by ``name``."""
        key = content_key(self.tracks_key, *work.key)
        return work.read(self.compilation.make(self.cache, name, key, work.fly, work.begun, slab=work.meet))

    def tracks(self) -> Tracked:
        """Every granule's landing, each alone."""
        return self.run(ANSWER)

    @cached_property
    def collision_stage(self) -> CollisionStage:
        """The slab. Raises SceneError where the plan has none."""
        if self.plan.collisions is None:
            raise SceneError("collisions: the plan has no granules meet; switch them on with --force collisions=on")
        return CollisionStage(self, self.plan.collisions)

    @property
    def collisions_key(self) -> str:
        """Everything the slab depends on; empty where the plan has none."""
        return "" if self.plan.collisions is None else self.collision_stage.key

    def collisions(self) -> SlabFound:
        """The landings of granules that meet each other. Raises SceneError where the plan has no slab."""
        return self.run(SlabRerun())

    def shown(self, picture: Picture) -> dict[str, list[Columns]]:
        """The tracks that a picture draws, by fraction: flown for it, from the same feed."""
        return self.run(PictureRerun("shown", picture=picture)) if picture.flown[0] else {}

    def compile_in_background(self) -> None:
        """Have the tracker compiled by another process while this one waits for OpenFOAM."""
        self.compilation.begin(self.store.root / "log.compile", slab=self.plan.collisions is not None)
