"""Every flight of a run is a rerun: the answer's granules, all or some of them, with something changed or with nothing.

A class of reruns says what it changes, which flight that is and how its folder is read. :meth:`Pipeline.run` then keys,
keeps and times each alike, under its name among the stages.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from ...core.lazy import cached_property
from ...core.record import JsonTable
from ...core.store import content_key
from ...core.tables import Columns
from ...planning.collisions import CollisionPlan
from ...planning.cost import flown_again
from ...planning.dependence import Dependence
from ...planning.plan import COMPARED, INPUT_SAMPLES, REPLICATES
from ...planning.stage_cache import code_of
from ...planning.stages import OWN, AirLabel, StageCost, Workload
from ...planning.unknowns import half_of
from ...scene import Scene
from . import input_samples, slab_stage
from .input_samples import DrawStage, InputSamples, Joined
from .landings import Tracked, load_tracked, recorded_tracks
from .slab_stage import SlabFlight, SlabFound, late_in, steady_after

if TYPE_CHECKING:
    from ...scene import Picture
    from .pipeline import Pipeline

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

    def on(self, pipeline: Pipeline) -> Work[InputSamples]:
        stage, scene = DrawStage(pipeline, self.joined), pipeline.scene
        drawn = [[one.key, one.kind, one.value, one.low, one.high] for one in stage.unknowns]
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
    """The slab of one scene under one plan, which says of it what is in ``crowd``, through one airflow, in which the
    granules of the ``pipeline`` have flown alone before.
    """

    pipeline: Pipeline
    crowd: CollisionPlan

    @cached_property
    def start_up(self) -> float:
        """Seconds until the slab is steady."""
        return steady_after(self.crowd, late_in(self.pipeline.tracks().landings))

    @property
    def tolerance(self) -> float:
        """Landing error (body widths) of a step of the slab's clock: shares feel SHARE_OF_SHIFT of it at most."""
        return max(self.pipeline.scene.numerics.tolerance, STEP_ERROR_PART * self.pipeline.plan.target_error)

    @cached_property
    def key(self) -> str:
        """Everything the slab's landings depend on."""
        scene, crowd = self.pipeline.scene, self.crowd
        fed = scene.feed.mass_flow, scene.feed.depth, scene.mass_shares(), repr(scene.collisions)
        flown = crowd.depth, crowd.tracers, crowd.operation, crowd.count, crowd.replicates
        return content_key("crowd", self.pipeline.tracks_key, self.tolerance, *fed, *flown, code_of(*slab_stage.CODE))

    def flight(self, rerun: Rerun[SlabFound]) -> SlabFlight:
        """What flies the slab for a ``rerun``."""
        of, crowd = self.pipeline, self.crowd
        return SlabFlight(
            of.scene, of.plan, of.air.realisations, crowd.depth, self.start_up, crowd.operation, self.tolerance,
            workers=of.threads, tell=rerun.tell(of),
        )  # fmt: skip

    def work(self, flight: SlabFlight, replicates: int, *key: object, begun: tuple[Path, ...] = ()) -> Work[SlabFound]:
        """So many ``replicates`` of a ``flight``."""
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
        first = stage.crowd.fewest if len(pipeline.air.realisations) == 1 else stage.crowd.replicates
        replicates = max([first, *(stage.crowd.after(found.replicates) for found in self.beside)])
        return stage.work(stage.flight(self), replicates, begun=tuple(found.folder for found in self.beside))


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
        flight = replace(stage.flight(self), scene=scene, part=self.depth, step=self.step * pipeline.crowd().clock.step)
        replicates = max(MIN_REPLICATES, stage.crowd.replicates // 4)
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
