"""The stage of the slab: the landings of granules that meet each other, from the cache, or flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from ..core.errors import known
from ..core.lazy import cached_property
from ..core.store import content_key
from ..planning.crowd import CrowdPlan
from ..planning.plan import Plan
from ..planning.variation import Variation
from ..scene import Scene
from .cache import StageCache, code_of
from .landings import Landings

if TYPE_CHECKING:
    from .landings import Tracked
    from .realisations import Realisations

__all__ = ["CrowdCompanion", "CrowdStage", "SlabFound"]

FEWEST = 2  # replicates of a companion
DRAWN = 4  # replicates of a draw
SMALL = 0.3  # of the accuracy asked for: landing error that a step of the slab may make, body widths (docs/crowd.md)


@dataclass(frozen=True)
class CrowdCompanion:
    """Part of the replicates flown again with one thing changed; ``name`` among the stages, factors on the step of the
    slab's clock and on its depth.
    """

    name: str
    step: float = 1.0
    depth: float = 1.0


@dataclass(frozen=True)
class SlabFound:
    """What the slab found: the landings of every fraction's granules that came in steady operation; the slab's
    ``depth`` (m), the ``start_up`` (s) that was dropped, and the ``replicates`` that were flown; the ``step`` of its
    clock (s) with the landing error that it was seen to make (body widths), and in how many replicates the feed
    ``jammed``.
    """

    landings: Mapping[str, Landings]
    depth: float
    start_up: float
    replicates: int
    step: float
    step_error: float
    jammed: int


@dataclass
class CrowdStage:
    """The slab of one scene under one plan through one airflow, in whose ``airs`` ``tracked`` has flown alone before.

    ``tracks_key``: everything that those tracks depend on.
    """

    scene: Scene
    plan: Plan
    cache: StageCache
    airs: Realisations
    tracks_key: str
    tracked: Tracked
    workers: int | None = None

    @property
    def crowd(self) -> CrowdPlan:
        """What the plan says of the slab. The plan must have one."""
        return known(self.plan.crowd)

    @cached_property
    def start_up(self) -> float:
        """Seconds until the slab is steady."""
        from .crowd_flight import steady_after

        return steady_after(self.plan, self.tracked.landings)

    @property
    def tolerance(self) -> float:
        """Landing error (body widths) of a step of the slab's clock: a mean shift moves about half of it as a share."""
        numerics = self.scene.numerics
        return max(numerics.tolerance, SMALL * self.plan.target_error)

    @cached_property
    def key(self) -> str:
        """Everything the slab's landings depend on."""
        feed, crowd = self.scene.feed, self.crowd
        fed = feed.mass_flow, feed.depth, self.scene.mass_shares(), repr(self.scene.collisions)
        flown = crowd.tracers, crowd.operation, crowd.count, crowd.replicates
        return content_key("crowd", self.tracks_key, self.tolerance, *fed, *flown, code_of("slab"))

    def fly(self, companion: CrowdCompanion | None = None) -> SlabFound:
        """The slab; under a ``companion``'s change some of its replicates."""
        from .crowd_flight import SlabFlight, load_crowd

        change = companion or CrowdCompanion("slab")
        depth = change.depth * self.crowd.depth
        replicates = self.crowd.replicates if companion is None else max(FEWEST, self.crowd.replicates // 4)
        step = None if companion is None else change.step * self.fly().step
        flight = SlabFlight(
            self.scene, self.plan, self.airs, depth, self.start_up, self.crowd.operation, self.tolerance,
            step, self.workers, partial(self.cache.tell, change.name),
        )  # fmt: skip
        key = content_key(self.key, change.step, depth, replicates)
        folder = self.cache.make(change.name, key, partial(flight.fly_all, replicates=replicates))
        found = load_crowd(folder, self.scene, replicates)
        how = found.step, found.step_error, found.jammed
        return SlabFound(found.landings, depth, self.start_up, replicates, *how)

    def fly_drawn(self, number: int, variation: Variation, airs: Realisations) -> Mapping[str, Landings]:
        """Landings of the first replicates under draw ``number``: what it makes of the granules, and its ``airs``."""
        from .crowd_flight import SlabFlight, load_crowd

        name, step = f"slab-draw-{number}", self.fly().step
        flight = SlabFlight(
            variation.fed(self.scene), self.plan, airs, self.crowd.depth, self.start_up, self.crowd.operation,
            self.tolerance, step, self.workers, partial(self.cache.tell, name), variation=variation,
        )  # fmt: skip
        key = content_key(self.key, "draw", number, repr(variation), DRAWN, code_of("draws"))
        folder = self.cache.make(name, key, partial(flight.fly_all, replicates=DRAWN))
        return load_crowd(folder, self.scene, DRAWN).landings
