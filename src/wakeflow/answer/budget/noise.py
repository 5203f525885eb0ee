"""The source that is the intervals over which the air's noise is held.

Other intervals with other numbers would differ by chance. So the same granules fly in intervals twice as long, with the
sum of two numbers in place of each: along the same Brownian path. The scheme is of first order at least, so that the
answer's own intervals err by no more than the difference.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import hypot, sqrt
from typing import TYPE_CHECKING

import numpy as np

from ...flight.stages.pipeline import Pipeline
from ...flight.stages.track_stage import PerturbedRerun
from ...laws.forces import forces
from ...planning.cost import flown_again
from ...planning.plan import FractionPlan
from ...planning.stages import StageCost, Workload
from ..provenance import RefinedSettings
from ..shares import PERTURBED_RERUN, BudgetPart
from .source import RATE, FractionResults, Parts, Source, add
from .steps import mean_share

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked

LONGER = PerturbedRerun("longer noise", noises=2)
CHEAPER = 0.55  # of a flight's time; measured on the shipped rhombus, steady, granules alone


class Noise(Source["Tracked"]):
    """The intervals of the air's noise: the same granules in intervals twice as long."""

    name, how, place = "noise", PERTURBED_RERUN, 25

    def costs(self, work: Workload) -> Iterable[StageCost]:
        return [] if work.scene.air is None else [flown_again(work, LONGER.name, CHEAPER)]

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Tracked | None:
        return pipeline.tracks(LONGER) if any(map(_random, pipeline.plan.fractions.values())) else None

    def shares(self, fraction: FractionResults) -> Parts:
        flown = fraction.flights.of(self)
        if flown is None or not _random(fraction.pipeline.plan.fractions[fraction.name]):
            return {}
        scene, own, other = fraction.pipeline.scene, fraction.compared, flown.landings[fraction.name]
        moved = (one.counts(len(scene.bin), scene.images).mean(axis=0) for one in (own, other))
        found, seconds = {}, fraction.pipeline.spent(LONGER.name)
        for i, (place, here, there) in enumerate(zip(fraction.shares, *moved, strict=True)):
            number = i if i < len(scene.bin) else -1  # elsewhere last
            changed = float(np.sum((own.bin == number) != (other.bin == number)))
            chance = sqrt(mean_share(changed, len(own.bin)) / len(own.bin))
            found[place] = [replace(self.part(hypot(there - here, chance), seconds), of_granules=chance)]
        return found

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """What chance leaves of the difference falls with the granules."""
        error, chance = part.size, part.of_granules or 0.0
        return hypot(sqrt(max(0.0, error**2 - chance**2)), chance * (now.granules / then.granules) ** RATE)


def _random(how: FractionPlan) -> bool:
    """Whether a fraction's granules are moved by chance."""
    return any(forces[name].random for name in how.forces)


NOISE = add(Noise())
