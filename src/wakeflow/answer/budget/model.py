"""Sources that are the air's model: other wakes, and what the passes of the granules' force on the air leave open."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import hypot
from typing import TYPE_CHECKING

from ...flight.stages.air_loading import AirLoading
from ...flight.stages.pipeline import Pipeline
from ...flight.stages.track_stage import PerturbedRerun
from ...planning.cost import flown_again
from ...planning.stages import OWN, AirLabel, StageCost, Workload
from ...planning.terms import LOADING
from ...planning.wake import Wake
from ..shares import MEASURED, PERTURBED_RERUN, LoadingEffect
from .flown_again import Comparison, differences, shares_of
from .source import FractionResults, Parts, Source, add

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked


class AirflowModel(Source[Comparison[Wake]]):
    """The airflow's model: of a time-resolved airflow the farthest of the steady wake, the mean wake and half of the
    fluctuation. The two numbers of a best estimate are unknowns among the others; the ends are flown for comparison.
    """

    name, how, place = "airflow-model", PERTURBED_RERUN, 50
    if_unknown = "numerics.rung = 'standard', or in a duct air.case, a solved OpenFOAM case of yours"
    if_large = "run rung 3d (--rung 3d)"

    def costs(self, work: Workload) -> Iterable[StageCost]:
        for wake in work.airflow.wakes_beside:
            yield flown_again(work, _stage(wake), 1.0, AirLabel(draft=True) if wake is Wake.STEADY else OWN)

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Comparison[Wake] | None:
        """The shares in the other wakes of the plan: the two ends between which the truth lies, and what is between
        them. None where the computed airflow is the flow itself, or is the steady end.
        """
        wakes = pipeline.plan.airflow.wakes_beside
        if not wakes or not pipeline.field[1].in_time:
            return None
        shares, seconds = {}, 0.0
        for wake, numbers in wakes.items():
            where, change = pipeline, PerturbedRerun(_stage(wake), wake=numbers)
            if wake is Wake.STEADY:  # on its own mesh, where a second core may have flown it already
                where, change = pipeline.steady, PerturbedRerun(_stage(wake))
            shares[wake] = shares_of(pipeline, where.tracks(change))
            seconds += where.spent(change.name)
        return Comparison({**shares, Wake.ANSWER: shares_of(pipeline, tracked)}, seconds)

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        if not pipeline.plan.airflow.brackets:
            return ()
        return [lambda: pipeline.steady.tracks(PerturbedRerun(_stage(Wake.STEADY)))]

    def shares(self, fraction: FractionResults) -> Parts:
        wakes = fraction.flights.of(self)
        if wakes is None:
            return self.unless_known(fraction)
        if fraction.pipeline.plan.airflow.wake:
            return {}
        found = {}
        for number, bin_ in enumerate(fraction.shares):
            which, moved = max(differences(wakes, fraction.name, number), key=lambda one: abs(one[1]))
            note = f"farthest: {which} ({100 * moved:+.2g} points)"
            found[bin_] = [self.part(abs(moved), wakes.seconds, note)]
        return found


def _stage(wake: Wake) -> str:
    return f"{wake} wake"


def loading_effects(loading: AirLoading, bins: Sequence[str]) -> dict[str, dict[str, LoadingEffect]]:
    """Of every fraction in every one of the ``bins``, elsewhere included, by their names in order."""
    last = loading.passes[-1].gathered.shares
    pairs = {name: zip(shares, last[name], strict=True) for name, shares in loading.first.shares.items()}
    return {name: {bin_: LoadingEffect(*pair) for bin_, pair in zip(bins, both, strict=True)}
            for name, both in pairs.items()}  # fmt: skip


class PassesOfLoading(Source[None]):
    """The granules' force on the air: what its last pass changed of a share in the steady airflow, and the part of what
    it does there that is not known for being gathered from few granules: a share moves with the force.
    """

    name, how, place = LOADING, MEASURED, 55
    if_large = "lower feed.rate"

    def shares(self, fraction: FractionResults) -> Parts:
        loading, found = fraction.pipeline.loading, {}
        if loading is None:
            return {}
        effects = loading_effects(loading, list(fraction.shares))[fraction.name]
        for number, (bin_, effect) in enumerate(effects.items()):
            moved, last = effect.loaded - effect.without, loading.last_change(fraction.name, number)
            note = (
                f"in the steady airflow the force moves the share by {100 * moved:+.2g} points, its last pass by "
                f"{100 * last:+.2g}; of the force {100 * loading.sampling:.2g} % are not known"
            )
            found[bin_] = [self.part(hypot(last, loading.sampling * moved), note=note)]
        return found


MODEL = add(AirflowModel())
add(PassesOfLoading())
