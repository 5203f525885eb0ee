"""Sources of the budget of granules that meet: part of the slab's replicates flown again with one thing changed.

Granules that meet part ways after a few collisions whatever is changed, so that a difference holds the sampling error
of the replicates that fly again, which its note tells; a difference within that says that none was found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..pipeline.crowd_stage import CrowdCompanion, SlabFound
from .landing_results import COMPANION, BudgetPart
from .source import FractionResults, Source, budget_sources
from .spread import student

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked
    from ..pipeline.pipeline import Pipeline

__all__ = ["SlabDepth", "SlabStep"]

COARSER = 2.0  # step of the companion over the answer's: changes more than the answer's own step errs
THINNER = 0.5  # depth of the companion's slab over the answer's


class _SlabAgain(Source[SlabFound]):
    """Some replicates of the slab under a companion's change."""

    how = COMPANION
    companion: ClassVar[CrowdCompanion]
    same_feed: ClassVar[bool] = False  # whether the same granules come, so that replicates are compared one by one

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> SlabFound | None:
        del tracked
        return pipeline.crowd(self.companion)

    def shares(self, fraction: FractionResults) -> Mapping[str, Sequence[BudgetPart]]:
        again = fraction.flights.of(self)
        if again is None or fraction.flights.crowd is None:
            return {}
        bins, name = len(fraction.shares) - 1, fraction.name
        changed = again.landings[name].counts(bins)
        own = fraction.landings.counts(bins)
        if self.same_feed:
            own = own[: len(changed)]
        apart = np.abs(changed.mean(axis=0) - own.mean(axis=0))
        seconds = fraction.pipeline.spent(self.companion.name)
        return {
            place: [self.part(float(apart[i]), seconds, self._noise(changed[:, i], own[:, i]))]
            for i, place in enumerate(fraction.shares)
        }

    def _noise(self, changed: np.ndarray, own: np.ndarray) -> str | None:
        """Half of the 95 % interval of the difference of means, in words; None where there are too few replicates."""
        if min(len(changed), len(own)) < 2:
            return None
        if self.same_feed:
            told, variance = f"a difference between the same {len(own)} replicates", (changed - own).var(ddof=1)
        else:
            told = f"a difference of {len(changed)} replicates from {len(own)}"
            variance = changed.var(ddof=1) + own.var(ddof=1) * len(changed) / len(own)
        half = student(len(changed) - 1) * float(np.sqrt(variance / len(changed)))
        return f"{told}, itself known to {100 * half:.2g} points"


class SlabStep(_SlabAgain):
    """The time step in which granules that meet are moved: part of the replicates with one twice as long."""

    name, place, same_feed = "slab-time-step", 21, True
    companion = CrowdCompanion("slab longer steps", step=COARSER)


class SlabDepth(_SlabAgain):
    """The slab's depth, beyond which it repeats itself: part of the replicates in one of half the depth."""

    name, place = "slab-depth", 22
    companion = CrowdCompanion("thinner slab", depth=THINNER)


for _source in (SlabStep(), SlabDepth()):
    budget_sources.add(_source.name, _source)
