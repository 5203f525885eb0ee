"""Sources that are finite samples: of granules, and of the airflow's sheddings."""

from __future__ import annotations

from collections.abc import Sequence

from ...planning.plan import REPLICATES
from ..draws import ErrorSource as Column
from ..provenance import RefinedSettings
from ..shares import MEASURED, BudgetPart
from ..spread import cycles_of
from .source import FractionResults, Parts, Source, add, averaged, landed, sampled


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
