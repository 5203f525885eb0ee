"""Sources that computing makes: finite samples, of granules and of the airflow's sheddings, and steps in time: the
tracker's, and the intervals over which the air's noise is held.

Other intervals with other numbers would differ by chance. So the same granules fly in intervals twice as long, with the
sum of two numbers in place of each: along the same Brownian path. The scheme is of first order at least, so that the
answer's own intervals err by no more than the difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import hypot, sqrt
from typing import TYPE_CHECKING

import numpy as np

from ...flight.stages.landings import Landings
from ...flight.stages.pipeline import PerturbedRerun, Pipeline
from ...planning.plan import COMPARED, REPLICATES
from ...planning.stages import StageCost, Workload
from ..draws import ErrorSource as Column
from ..provenance import RefinedSettings
from ..shares import MEASURED, PERTURBED_RERUN, BudgetPart
from ..spread import cycles_of
from .source import RATE, FractionResults, Parts, Source, add, averaged, landed, sampled

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked


FINER_STEPS = "companion"  # the stage
FINER = 0.01  # tolerance of the companion run over the scene's: a tenth may give the same steps, cut at the cells
SLOWER = 3.0  # times as long: flights at a hundredth of the tolerance; measured on the shipped rhombus, 2.4 to 3.8
STEP_RATE = 1.0  # of the share that finer steps put into or out of a bin, with the tolerance
LANDED_WITHIN = 95  # percentile over the granules of how far a companion run moves a landing
CHEAPER = 0.55  # of a flight's time; measured on the shipped rhombus, steady, granules alone
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
    reruns = (PerturbedRerun(FINER_STEPS, looser=FINER, times=SLOWER),)

    def shares(self, fraction: FractionResults) -> Parts:
        """Mean of the share of granules that the finer steps put into a bin or take out of it (:func:`mean_share`)."""
        coarse, fine = fraction.compared.bin, self._finer(fraction).bin
        numbers = [*range(len(fraction.shares) - 1), -1]  # elsewhere last
        changed = [float(np.sum((coarse == number) != (fine == number))) for number in numbers]
        errors = [mean_share(count, len(coarse)) for count in changed]
        return {place: [self._part(fraction, error)] for place, error in zip(fraction.shares, errors, strict=True)}

    def landing(self, fraction: FractionResults) -> Sequence[BudgetPart]:
        moved = fraction.compared.position - self._finer(fraction).position
        shift = np.linalg.norm(moved, axis=1) / fraction.pipeline.scene.width
        return [self._part(fraction, float(np.percentile(shift, LANDED_WITHIN)))]

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        fewer = (then.tolerance / now.tolerance) ** STEP_RATE
        flown, again = (COMPARED / REPLICATES * settings.granules for settings in (now, then))
        changed = max(0.0, part.size * (flown + 1.0) - JEFFREYS)
        return mean_share(changed / flown * fewer * again, again)

    def _finer(self, fraction: FractionResults) -> Landings:
        (flown,) = fraction.flights.of(self)
        return flown.landings[fraction.name]

    def _part(self, fraction: FractionResults, error: float) -> BudgetPart:
        return self.part(error, self.seconds(fraction))


class Noise(Source["Tracked"]):
    """The intervals of the air's noise: the same granules in intervals twice as long."""

    name, how, place = "noise", PERTURBED_RERUN, 25
    reruns = (PerturbedRerun("longer noise", noises=2, times=CHEAPER),)

    def costs(self, work: Workload) -> Iterable[StageCost]:
        return () if work.scene.air is None else super().costs(work)

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[Tracked]:
        noisy = any(how.random for how in pipeline.plan.fractions.values())
        return super().fly(pipeline, tracked) if noisy else ()

    def shares(self, fraction: FractionResults) -> Parts:
        if not fraction.pipeline.plan.fractions[fraction.name].random:
            return {}
        (flown,) = fraction.flights.of(self)
        scene, first, second = fraction.pipeline.scene, fraction.compared, flown.landings[fraction.name]
        moved = (landings.counts(len(scene.bin), scene.images).mean(axis=0) for landings in (first, second))
        parts, seconds = {}, self.seconds(fraction)
        for i, (place, here, there) in enumerate(zip(fraction.shares, *moved, strict=True)):
            number = i if i < len(scene.bin) else -1  # elsewhere last
            changed = float(np.sum((first.bin == number) != (second.bin == number)))
            chance = sqrt(mean_share(changed, len(first.bin)) / len(first.bin))
            parts[place] = [replace(self.part(hypot(there - here, chance), seconds), of_granules=chance)]
        return parts

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """What chance leaves of the difference falls with the granules."""
        error, chance = part.size, part.of_granules or 0.0
        return hypot(sqrt(max(0.0, error**2 - chance**2)), chance * (now.granules / then.granules) ** RATE)


add(Integration())
NOISE = add(Noise())


# -- Finite samples: of granules, and of the airflow's sheddings -------------------------------------------------------
class Sampling(Source[None]):
    """The finite number of granules: half of the 95 % interval over independent replicates."""

    name, how, place = "sampling", MEASURED, 10

    def shares(self, fraction: FractionResults) -> Parts:
        spent = fraction.flights.tracking
        return {bin_: [self.part(spread.sampling, spent)] for bin_, spread in fraction.spreads.items()}

    def column(self, fractions: Sequence[FractionResults]) -> Sequence[Column]:
        return [Column(self.name, fractions[0].flights.sample_errors.sampling, together=True)]

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        return max(sampled(part.size, now, then), 0.5 * REPLICATES / landed(then))


class AirflowStatistics(Source[None]):
    """The finite sample of the airflow: half of the 95 % interval over its shedding cycles, or its realisations."""

    name, how, place = "airflow-statistics", MEASURED, 60
    if_unknown = "numerics.rung = '3d', or air.time = 'all' of a case of yours"
    if_large = "run rung 3d (--rung 3d)"

    def shares(self, fraction: FractionResults) -> Parts:
        cycles = cycles_of([fraction.landings])
        clusters = cycles * (1 + int(fraction.landings.realisation.max()))
        if clusters == 1:
            return self.unless_known(fraction)
        note = f"from {clusters} " + ("shedding cycles" if cycles > 1 else "states of the airflow")
        return {bin_: [self.part(spread.airflow, note=note)] for bin_, spread in fraction.spreads.items()}

    def column(self, fractions: Sequence[FractionResults]) -> Sequence[Column]:
        return [Column(self.name, fractions[0].flights.sample_errors.airflow, together=True)]

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        return part.size * averaged(now, then)


add(Sampling())
add(AirflowStatistics())
