"""The source that is the airflow's model: the granules of comparisons in other wakes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from ...flight.stages.pipeline import Pipeline
from ...flight.stages.track_stage import PerturbedRerun
from ...planning.cost import flown_again
from ...planning.stages import OWN, AirLabel, StageCost, Workload
from ...planning.wake import Wake
from ..shares import PERTURBED_RERUN, BudgetPart
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
        if not wakes or pipeline.field[1].times is None:
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
        if fraction.pipeline.plan.airflow.wake is not None:
            return {}
        return {bin_: [self._farthest(moved, wakes.seconds)] for bin_, moved in _moved(wakes, fraction)}

    def _farthest(self, moved: Mapping[Wake, float], seconds: float) -> BudgetPart:
        which = max(moved, key=lambda wake: abs(moved[wake]))
        return self.part(abs(moved[which]), seconds, f"farthest: {which} ({100 * moved[which]:+.2g} points)")


def _stage(wake: Wake) -> str:
    return f"{wake} wake"


def _moved(wakes: Comparison[Wake], fraction: FractionResults) -> Iterator[tuple[str, dict[Wake, float]]]:
    for number, bin_ in enumerate(fraction.shares):
        yield bin_, dict(differences(wakes, fraction.name, number))


MODEL = add(AirflowModel())
