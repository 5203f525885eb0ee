"""The source that is the tracker's steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...flight.stages.pipeline import Pipeline
from ...flight.stages.track_stage import PerturbedRerun
from ...planning.cost import flown_again
from ...planning.plan import COMPARED, REPLICATES
from ...planning.stages import StageCost, Workload
from ..provenance import RefinedSettings
from ..shares import PERTURBED_RERUN, BudgetPart
from .source import FractionResults, Parts, Source, add

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked

FINER_STEPS = "companion"  # the stage
FINER = 0.01  # tolerance of the companion run over the scene's: a tenth may give the same steps, cut at the cells
SLOWER = 3.0  # times as long: flights at a hundredth of the tolerance; measured on the shipped rhombus, 2.4 to 3.8
STEP_RATE = 1.0  # of the share that finer steps put into or out of a bin, with the tolerance
LANDED_WITHIN = 95  # percentile over the granules of how far a companion run moves a landing


JEFFREYS = 0.5  # added to those that changed their bin, and to those that did not


def mean_share(changed: float, total: float) -> float:
    """The mean of a share of which ``changed`` of ``total`` > 0 were found, before which nothing was known of it: of
    the beta distribution that Jeffreys' prior gives (Brown, Cai & DasGupta 2001, Stat. Sci. 16, 101).

    A sum of squares takes what is expected of its parts: their upper limits would count what no granule showed.
    """
    return (changed + JEFFREYS) / (total + 2.0 * JEFFREYS)


class Integration(Source["Tracked"]):
    """The tracker's steps: the same granules at a hundredth of the tolerance."""

    name, how, place = "integration", PERTURBED_RERUN, 20

    def costs(self, work: Workload) -> Iterable[StageCost]:
        return [flown_again(work, FINER_STEPS, SLOWER)]

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Tracked:
        return pipeline.tracks(PerturbedRerun(FINER_STEPS, tolerance=FINER * pipeline.scene.numerics.tolerance))

    def shares(self, fraction: FractionResults) -> Parts:
        """Mean of the share of granules that the finer steps put into a bin or take out of it (:func:`mean_share`)."""
        own, fine = fraction.compared.bin, self._finer(fraction).landings[fraction.name].bin
        numbers = [*range(len(fraction.shares) - 1), -1]  # elsewhere last
        changed = [float(np.sum((own == number) != (fine == number))) for number in numbers]
        errors = [mean_share(count, len(own)) for count in changed]
        return {place: [self._part(fraction, error)] for place, error in zip(fraction.shares, errors, strict=True)}

    def landing(self, fraction: FractionResults) -> Sequence[BudgetPart]:
        moved = fraction.compared.position - self._finer(fraction).landings[fraction.name].position
        shift = np.linalg.norm(moved, axis=1) / fraction.pipeline.scene.width
        return [self._part(fraction, float(np.percentile(shift, LANDED_WITHIN)))]

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        fewer = (then.tolerance / now.tolerance) ** STEP_RATE
        flown, again = (COMPARED / REPLICATES * settings.granules for settings in (now, then))
        found = max(0.0, part.size * (flown + 1.0) - JEFFREYS)
        return mean_share(found / flown * fewer * again, again)

    def _finer(self, fraction: FractionResults) -> Tracked:
        flown = fraction.flights.of(self)
        assert flown is not None
        return flown

    def _part(self, fraction: FractionResults, error: float) -> BudgetPart:
        return self.part(error, fraction.pipeline.spent(FINER_STEPS))


add(Integration())
