"""The source that is the granules' force on the air: what it does to the steady airflow, and to the shares."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..answer.shares import PERTURBED_RERUN, LoadingEffect
from ..pipeline.pipeline import Pipeline
from ..pipeline.track_stage import PerturbedRerun
from ..planning.cost import flown_again
from ..planning.stages import StageCost, Workload
from ..planning.terms import LOADING
from .comparison import Shares, shares_of
from .source import FractionResults, Parts, Source, add

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

WITHOUT = PerturbedRerun("unloaded", loaded=False)
# Of what the force moves: the error of taking the steady end's change for that of both ends, of granules that follow
# the air (approach Stokes number below FOLLOWS) and of others. Measured in the shipped rhombus by the study air_loading
# --both (tests/proofs/studies): 1.2 for dust (1.4), 0.1 for chaff (16) and wheat (98), of which three times
OTHER_WAKE, OWN_WAY, FOLLOWS = 1.2, 0.3, 5.0


@dataclass(frozen=True)
class Unloaded:
    """Shares in air that does not feel the granules beside those of the same granules in the answer's air, and the run
    time (s) of the former.
    """

    without: Shares
    loaded: Shares
    seconds: float

    def effect(self, name: str, place: int) -> LoadingEffect:
        """Of a fraction in bin number ``place``."""
        return LoadingEffect(float(self.without[name][:, place].mean()), float(self.loaded[name][:, place].mean()))

    def effects(self, bins: Sequence[str]) -> dict[str, dict[str, LoadingEffect]]:
        """Of every fraction in every bin, elsewhere included, by their names in order."""
        return {name: {bin_: self.effect(name, i) for i, bin_ in enumerate(bins)} for name in self.loaded}


class LoadedAir(Source[Unloaded]):
    """The granules' force on the air: what the last pass changed, and of an airflow in time a part of what the force
    does, since the change is that of the steady wake.
    """

    name, how, place = LOADING, PERTURBED_RERUN, 55
    if_large = "lower feed.rate, or run rung draft, whose air the force is solved in"

    def costs(self, work: Workload) -> Iterable[StageCost]:
        return [flown_again(work, WITHOUT.name, 1.0)] if work.airflow.loaded else []

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Unloaded | None:
        """The granules of the comparisons in air that does not feel them; None where no air does."""
        if pipeline.loading is None:
            return None
        without = shares_of(pipeline, pipeline.tracks(WITHOUT))
        return Unloaded(without, shares_of(pipeline, tracked), pipeline.spent(WITHOUT.name))

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


UNLOADED = add(LoadedAir())
