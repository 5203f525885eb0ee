"""The stage of the slab: the landings of granules that meet each other, from the cache, or flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

from ..core.store import content_key
from ..planning.crowd import CrowdPlan
from ..planning.plan import Plan
from ..scene import Scene
from .airflow_kinds import AirflowKind
from .cache import StageCache, code_of
from .landings import Landings

if TYPE_CHECKING:
    from .landings import Tracked

__all__ = ["Crowd", "CrowdCompanion", "CrowdStage"]

FEWEST = 2  # replicates of a companion


@dataclass(frozen=True)
class CrowdCompanion:
    """Part of the replicates flown again with one thing changed; ``name`` among the stages, factors on the tolerance
    and on the slab's depth.
    """

    name: str
    tolerance: float = 1.0
    depth: float = 1.0


@dataclass(frozen=True)
class Crowd:
    """What the slab found: the landings of every fraction's granules that came in steady operation; the slab's
    ``depth`` (m), the ``start_up`` (s) that was dropped, and the ``replicates`` that were flown.
    """

    landings: Mapping[str, Landings]
    depth: float
    start_up: float
    replicates: int


@dataclass
class CrowdStage:
    """The slab of one scene under one plan through one airflow, which ``tracked`` has flown through alone before.

    ``tracks_key``: everything that those tracks depend on.
    """

    scene: Scene
    plan: Plan
    cache: StageCache
    air: AirflowKind
    tracks_key: str
    tracked: Tracked
    workers: int | None = None

    @property
    def crowd(self) -> CrowdPlan:
        """What the plan says of the slab. The plan must have one."""
        assert self.plan.crowd is not None
        return self.plan.crowd

    @cached_property
    def start_up(self) -> float:
        """Seconds until the slab is steady."""
        from .crowd_flight import steady_after

        return steady_after(self.plan, self.tracked.landings)

    @cached_property
    def key(self) -> str:
        """Everything the slab's landings depend on."""
        feed, crowd = self.scene.feed, self.crowd
        fed = feed.mass_flow, feed.depth, self.scene.mass_shares(), repr(self.scene.collisions)
        flown = crowd.tracers, crowd.operation, crowd.count, crowd.replicates
        return content_key("crowd", self.tracks_key, self.scene.numerics.tolerance, *fed, *flown, code_of("crowd"))

    def fly(self, companion: CrowdCompanion | None = None) -> Crowd:
        """The slab; under a ``companion``'s change some of its replicates."""
        from .crowd_flight import CrowdFlight, load_crowd

        change = companion or CrowdCompanion("slab")
        depth = change.depth * self.crowd.depth
        replicates = self.crowd.replicates if companion is None else max(FEWEST, self.crowd.replicates // 4)
        flight = CrowdFlight(
            self.scene, self.plan, self.air.realisations, depth, self.start_up, self.crowd.operation,
            change.tolerance * self.scene.numerics.tolerance, self.workers, partial(self.cache.tell, change.name),
        )  # fmt: skip
        key = content_key(self.key, change.tolerance, depth, replicates)
        folder = self.cache.make(change.name, key, lambda part: flight.fly_all(part, replicates))
        return Crowd(load_crowd(folder, self.scene, replicates), depth, self.start_up, replicates)
