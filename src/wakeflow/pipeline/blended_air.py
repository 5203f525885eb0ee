"""The best estimate's air: between the steady wake and the one in time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.errors import known
from ..core.lazy import cached_property
from .airflow import Airflow, ResidenceTimes
from .airflow_kinds import airflow_kinds
from .realisations import Realisations
from .residence import residence_times
from .solved_air import TimeResolvedAir

if TYPE_CHECKING:
    from ..field import FlowField
    from ..laws.best_estimate import WakeEstimate

__all__ = ["BestEstimateAir"]


@airflow_kinds.register("best-estimate")
class BestEstimateAir(TimeResolvedAir):
    """The wake between the steady one and the one in time, as much of each as the plan's best estimate says."""

    means = "a best estimate between the steady wake and the one in time"

    @property
    def estimate(self) -> WakeEstimate:
        """The plan's."""
        return known(self.plan.airflow.wake)

    def make_field(self) -> tuple[str, FlowField]:
        return self.between(self.estimate.theta.value, self.estimate.strength.value)

    def make_table(self) -> Airflow:
        """That of the time-resolved airflow where it came to rest, and so is no end."""
        from .wake_table import blended_airflow

        if self.resolved[1].times is None:
            return self.measured
        mean = self.between(self.estimate.theta.value, 0.0)[1]
        return blended_airflow(self.flow_spec, self.estimate, mean, self.steady().measured, self.measured)

    @cached_property
    def residence(self) -> ResidenceTimes | None:
        if self.resolved[1].times is None:
            return None
        ends = {"answer": self.make_field(), "steady": self.between(0.0, 0.0), "time_resolved": self.resolved}
        airs = {which: (key, Realisations(field, cycles=self.cycles)) for which, (key, field) in ends.items()}
        return residence_times(self.scene, self.cache, airs)
