"""The source that is the history force among granules that meet: the slab flies without it.

A bound on what it moves a granule by says little where landings are spread: the shares hardly change. So part of the
granules fly alone, with the force and without it, and what that changes of their shares counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..answer.shares import PERTURBED_RERUN
from ..pipeline.pipeline import Pipeline
from ..pipeline.track_stage import PerturbedRerun
from ..planning.cost import flown_again
from ..planning.plan import Plan
from ..planning.stages import StageCost, Workload
from ..planning.terms import REMEMBERING
from .slab import beyond_chance
from .source import FractionResults, Parts, Source, add

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

AGAIN = PerturbedRerun("history force", remembers=True)
LONGER = 2.0  # times as long as without the force: measured on the shipped rhombus


def forgotten(plan: Plan, name: str) -> bool:
    """Whether granules of fraction ``name`` meet others without a force that could move them too far to be left out."""
    return plan.crowd is not None and bool(plan.fractions[name].forgets)


class HistoryForce(Source["Tracked"]):
    """The history force of granules that meet, by granules alone."""

    name, how, place = REMEMBERING[0], PERTURBED_RERUN, 31

    def costs(self, work: Workload) -> Iterable[StageCost]:
        return [flown_again(work, AGAIN.name, LONGER)] if work.forgets else []

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Tracked | None:
        del tracked  # the same granules without the force are part of the answer's
        asked = any(forgotten(pipeline.plan, name) for name in pipeline.scene.fraction)
        return pipeline.tracks(AGAIN) if asked else None

    def shares(self, fraction: FractionResults) -> Parts:
        """What the force changes of a share beyond the chance of so many granules."""
        again = fraction.flights.of(self) if forgotten(fraction.pipeline.plan, fraction.name) else None
        if again is None:
            return {}
        bins, images = len(fraction.shares) - 1, fraction.pipeline.scene.images
        changed = again.landings[fraction.name].counts(bins, images)
        own, seconds = fraction.compared.counts(bins, images), fraction.pipeline.spent(AGAIN.name)
        return {
            place: [self.part(*beyond_chance(changed[:, i], own[:, i], seconds, paired=True))]
            for i, place in enumerate(fraction.shares)
        }


add(HistoryForce())
