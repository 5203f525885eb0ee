"""The source that is the numbers of the scene that nobody knows exactly."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from ...flight.stages.pipeline import Pipeline
from ...planning.cost import flown_again
from ...planning.plan import COMPARED, INPUT_SAMPLES, REPLICATES
from ...planning.stages import StageCost, Workload
from ..shares import PERTURBED_RERUN, weightiest
from .source import INPUTS, FractionResults, Parts, Source, add

if TYPE_CHECKING:
    from ...flight.stages.input_samples import InputSamples
    from ...flight.stages.landings import Tracked

STAGE = "draws"
SAMPLE_SECONDS = {"steady": 0.004, "time-resolved": 0.004}  # s: to draw the granules of a fraction anew, and its air


class UnknownInputs(Source["InputSamples"]):
    """The numbers of the scene that are not known exactly: the range of the share over draws of them all."""

    name, how, place = INPUTS, PERTURBED_RERUN, 15

    def costs(self, work: Workload) -> Iterable[StageCost]:
        """As many granules fly as the answer has."""
        each = SAMPLE_SECONDS.get(work.airflow.stepping or "steady", 0.0)
        drawn = 0.0 if work.airflow.rung == "none" else INPUT_SAMPLES * each * work.fractions
        return [flown_again(work, STAGE, REPLICATES / COMPARED, more=drawn)]

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> InputSamples | None:
        return pipeline.draws()

    def shares(self, fraction: FractionResults) -> Parts:
        if fraction.flights.of(self) is None:
            return {}
        found, among, seconds = {}, fraction.flights.among, fraction.pipeline.spent(STAGE)
        for bin_ in fraction.shares:
            of = fraction.answer.of_share(fraction.name, [bin_])
            over, effects = fraction.answer.number(of), fraction.answer.effects(of, fraction.name)
            told = ", ".join(f"{key} {one.points}" for key, one in weightiest(effects))
            note = f"depends most on (points each) {told}" if told else ""
            if note and among is not None:
                note += f"; {among.factor(fraction.name):.2g} times what they move of granules alone"
            low, high = over.low - over.value, over.high - over.value
            found[bin_] = [replace(self.part(max(-low, high), seconds, note), low=low, high=high)]
        return found


UNKNOWN = add(UnknownInputs())
