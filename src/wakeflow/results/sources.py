"""The sources of the budget.

Measured: sampling (spread of independent replicates) and the airflow's statistics (spread of shedding cycles). By
companions, the same granules flown again: the inputs (draws of what the scene does not say exactly), integration (at a
hundredth of the tolerance), the airflow's model (another wake) and the mesh (on other grids). Calibrated: each term
that is left out, by what lands within the plan's bound of a bin's ends. The rest is named and unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..pipeline.pipeline import Pipeline
from ..planning.bounds import LOADING, VIBRATION
from ..planning.wake import Wake
from .air_loading import Unloaded, fly_unloaded
from .companions import (
    Comparison,
    Grid,
    airflows,
    differences,
    finer_steps,
    grids,
    mesh_error,
    on_other_grids,
    steady_wake,
)
from .landing_results import CALIBRATED, COMPANION, MEASURED, UNKNOWN, BudgetPart
from .left_out import left_out_terms, swung
from .separation import upper_limit
from .source import FractionResults, Source, budget_sources
from .spread import cycles_of
from .total import INPUTS

if TYPE_CHECKING:
    from ..pipeline.draws import Draws
    from ..pipeline.landings import Tracked

__all__ = [
    "AirflowModel",
    "AirflowStatistics",
    "Integration",
    "LeftOutTerms",
    "LoadedAir",
    "Mesh",
    "Sampling",
    "UnknownInputs",
]

Parts = Mapping[str, Sequence[BudgetPart]]
# Of what the force moves: the error of taking the steady end's change for that of both ends, of granules that follow
# the air (approach Stokes number below FOLLOWS) and of others. Measured in the shipped rhombus
# (study air_loading --both): 1.2 for dust (1.4), 0.1 for chaff (16) and wheat (98), of which three times
OTHER_WAKE, OWN_WAY, FOLLOWS = 1.2, 0.3, 5.0
AIR_SPEED = "air.speed"  # the unknown that stands for what the air beside a body that vibrates does
WEIGHTY, MOST_TOLD = 0.1, 3  # part of the variance from which an unknown is told, and how many are
LANDED_WITHIN = 95  # percentile over the granules of how far a companion run moves a landing


class Sampling(Source[None]):
    """The finite number of granules: half of the 95 % interval over independent replicates."""

    name, how, place = "sampling", MEASURED, 10

    def shares(self, fraction: FractionResults) -> Parts:
        spent = fraction.flights.tracking
        return {bin_: [self.part(spread.sampling, spent)] for bin_, spread in fraction.spreads.items()}


class Integration(Source["tuple[Tracked, float]"]):
    """The tracker's steps: the same granules at a hundredth of the tolerance."""

    name, how, place = "integration", COMPANION, 20

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> tuple[Tracked, float]:
        del tracked  # the answer's landings are compared fraction by fraction
        return finer_steps(pipeline)

    def shares(self, fraction: FractionResults) -> Parts:
        """Upper 95 % limit of the share of granules that the finer steps put into another bin."""
        finer, seconds = self._flown(fraction)
        same, fine = fraction.compared.bin, finer.landings[fraction.name].bin
        changed = upper_limit(int(np.sum(same != fine)), len(same))
        return fraction.everywhere(self.part(changed, seconds))

    def landing(self, fraction: FractionResults) -> Sequence[BudgetPart]:
        finer, seconds = self._flown(fraction)
        moved = fraction.compared.position - finer.landings[fraction.name].position
        shift = np.linalg.norm(moved, axis=1) / fraction.pipeline.scene.width
        return [self.part(float(np.percentile(shift, LANDED_WITHIN)), seconds)]

    def _flown(self, fraction: FractionResults) -> tuple[Tracked, float]:
        flown = fraction.flights.of(self)
        assert flown is not None
        return flown


class LeftOutTerms(Source[None]):
    """Every term that is not computed, each a part of its own name."""

    name, how, place = "terms-left-out", CALIBRATED, 30

    def shares(self, fraction: FractionResults) -> Parts:
        pipeline, flights = fraction.pipeline, fraction.flights
        found = left_out_terms(pipeline.scene, pipeline.plan, fraction.name, fraction.landings)
        inputs = flights.inputs({fraction.name: fraction.shares})
        if inputs is None or VIBRATION in pipeline.plan.force:
            return found
        for place, parts in found.items():
            if not any(part.source == VIBRATION for part in parts):
                continue
            effects = inputs.of_share(fraction.name, [place]).effects
            of_speed = next((one for one in effects if one.unknown.key == AIR_SPEED), None)
            found[place] = [swung(pipeline.scene, pipeline.plan, part, of_speed) for part in parts]
        return found


class AirflowModel(Source[Comparison[Wake]]):
    """The airflow's model: of a time-resolved airflow the farthest of the steady wake, the mean wake and half of the
    fluctuation. The two numbers of a best estimate are unknowns among the others; the ends are flown for comparison.
    """

    name, how, place, fills = "airflow-model", COMPANION, 50, True

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Comparison[Wake] | None:
        return airflows(pipeline, tracked)

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        return steady_wake(pipeline)

    def shares(self, fraction: FractionResults) -> Parts:
        wakes = fraction.flights.of(self)
        if wakes is None:
            return _unless_known(self.name, fraction)
        if fraction.pipeline.plan.airflow.wake is not None:
            return {}
        return {bin_: [self._farthest(moved, wakes.seconds)] for bin_, moved in _moved(wakes, fraction)}

    def _farthest(self, moved: Mapping[Wake, float], seconds: float) -> BudgetPart:
        which = max(moved, key=lambda wake: abs(moved[wake]))
        return self.part(abs(moved[which]), seconds, f"farthest: {which} ({100 * moved[which]:+.2g} points)")


class LoadedAir(Source[Unloaded]):
    """The granules' force on the air: what the last pass changed, and of an airflow in time a part of what the force
    does, since the change is that of the steady wake.
    """

    name, how, place = LOADING, COMPANION, 55

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Unloaded | None:
        return fly_unloaded(pipeline, tracked)

    def shares(self, fraction: FractionResults) -> Parts:
        flown, loading = fraction.flights.of(self), fraction.pipeline.loading
        if flown is None or loading is None:
            return {}
        plan = fraction.pipeline.plan
        follows = plan.fractions[fraction.name].stokes < FOLLOWS
        other = 0.0 if plan.airflow.stepping == "steady" else OTHER_WAKE if follows else OWN_WAY
        found = {}
        for number, bin_ in enumerate(fraction.shares):
            effect = flown.effect(fraction.name, number)
            moved, last = effect.loaded - effect.without, loading.last_change(fraction.name, number)
            told = f"the force moves the share by {100 * moved:+.2g} points, its last pass by {100 * last:+.2g}"
            error = abs(last) + other * abs(moved)
            found[bin_] = [self.part(error, flown.seconds, told)]
        return found


class AirflowStatistics(Source[None]):
    """The finite sample of the airflow: half of the 95 % interval over its shedding cycles, or its realisations."""

    name, how, place = "airflow-statistics", MEASURED, 60

    def shares(self, fraction: FractionResults) -> Parts:
        cycles = cycles_of([fraction.landings])
        clusters = cycles * (1 + int(fraction.landings.realisation.max()))
        if clusters == 1:
            return _unless_known(self.name, fraction)
        note = f"from {clusters} " + ("shedding cycles" if cycles > 1 else "states of the airflow")
        return {bin_: [self.part(spread.airflow, note=note)] for bin_, spread in fraction.spreads.items()}


class Mesh(Source[Comparison[Grid]]):
    """The cells of the airflow's mesh: the same granules in the airflow on other grids."""

    name, how, place, fills = "mesh", COMPANION, 40, True

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Comparison[Grid] | None:
        return grids(pipeline, tracked)

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        return on_other_grids(pipeline)

    def shares(self, fraction: FractionResults) -> Parts:
        flown = fraction.flights.of(self)
        if flown is None:
            return _unless_known(self.name, fraction)
        return {bin_: [self._part(flown, fraction.name, i)] for i, bin_ in enumerate(fraction.shares)}

    def _part(self, flown: Comparison[Grid], name: str, number: int) -> BudgetPart:
        found, (granules, sheddings) = mesh_error(flown, name, number)
        half = max(found.high - found.value, found.value - found.low)
        part = replace(self.part(half, flown.seconds, found.why), of_granules=float(granules))
        return replace(part, of_sheddings=float(sheddings)) if sheddings else part


class UnknownInputs(Source["Draws"]):
    """The numbers of the scene that are not known exactly: the range of the share over draws of them all."""

    name, how, place, fills = INPUTS, COMPANION, 15, True

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Draws | None:
        del tracked  # the draws are of the tracks in the cache
        return pipeline.draws()

    def shares(self, fraction: FractionResults) -> Parts:
        inputs = fraction.flights.inputs({fraction.name: fraction.shares})
        if inputs is None:
            return {}
        seconds = fraction.pipeline.spent("draws")
        found = {}
        for bin_ in fraction.shares:
            over = inputs.of_share(fraction.name, [bin_])
            weighty = [one for one in over.effects if one.share >= WEIGHTY][:MOST_TOLD]
            told = ", ".join(f"{one.unknown.key} {100 * one.share:.0f} %" for one in weighty)
            note = f"of its variance {told}" if told else None
            if note is not None and inputs.among is not None:
                note += f"; {inputs.factor(fraction.name):.2g} times what they move of granules alone"
            found[bin_] = [replace(self.part(over.half, seconds, note), low=over.low, high=over.high)]
        return found


def unknown(source: str) -> BudgetPart:
    """The part of a source whose error is not known."""
    return BudgetPart(source, None, 0.0, UNKNOWN)


def _unless_known(source: str, fraction: FractionResults) -> Parts:
    """The part of a source that no companion measured: unknown, unless the kind of airflow knows it."""
    unknown_parts = fraction.pipeline.kind.unknown_parts()
    return fraction.everywhere(unknown(source)) if source in unknown_parts else {}


def _moved(wakes: Comparison[Wake], fraction: FractionResults) -> Iterator[tuple[str, dict[Wake, float]]]:
    for number, bin_ in enumerate(fraction.shares):
        yield bin_, dict(differences(wakes, fraction.name, number))


MODEL, UNLOADED = AirflowModel(), LoadedAir()
# In the order in which they fly; each is named in the budget and run once.
for _source in (
    Sampling(), Integration(), MODEL, Mesh(), UNLOADED, AirflowStatistics(), LeftOutTerms(), UnknownInputs(),
):  # fmt: skip
    budget_sources.add(_source.name, _source)
