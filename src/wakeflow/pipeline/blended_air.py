"""The best estimate's air: between the steady wake and the one in time."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import write_json
from ..core.store import content_key
from .airflow_kinds import TimeResolvedAir, airflow_kinds
from .cache import code_of

if TYPE_CHECKING:
    from ..field import FlowField
    from ..laws.best_estimate import WakeEstimate

__all__ = ["BestEstimateAir", "residence_row"]


@airflow_kinds.register("best-estimate")
class BestEstimateAir(TimeResolvedAir):
    """The wake between the steady one and the one in time, as much of each as the plan's best estimate says."""

    @property
    def estimate(self) -> WakeEstimate:
        """The plan's."""
        assert self.plan.airflow.wake is not None
        return self.plan.airflow.wake

    def make_field(self) -> tuple[str, FlowField]:
        return self.between(self.estimate.theta.value, self.estimate.strength.value)

    def make_table(self) -> dict[str, Any]:
        """That of the time-resolved airflow where it came to rest, and so is no end."""
        from .wake_table import wake_table

        if self.resolved[1].times is None:
            return self.measured
        mean = self.between(self.estimate.theta.value, 0.0)[1]
        return wake_table(self.flow_spec, self.estimate, mean, self.steady().measured, self.measured)

    @cached_property
    def residence(self) -> dict[str, Any] | None:
        if self.resolved[1].times is None:
            return None
        airs = {"answer": self.make_field(), "steady": self.between(0.0, 0.0), "time_resolved": self.resolved}
        body, air = next(iter(self.scene.body.values())), self.scene.air
        assert air is not None
        asked = body.outline().tolist(), air.direction, air.speed, self.cycles
        key = content_key("residence", [name for name, _ in airs.values()], asked, code_of("residence"))

        def work(part: Path) -> None:
            found = {}
            for which, (_, field) in airs.items():
                self.cache.tell("residence", f"fine dust in the near wake: {which}")
                found[which] = residence_row(field, *asked)
            write_json(part / "residence.json", found)

        table: dict[str, Any] = json.loads((self.cache.make("residence", key, work) / "residence.json").read_text())
        return table


def residence_row(
    field: FlowField | Sequence[FlowField], outline: Any, direction: Any, speed: float, cycles: int
) -> dict[str, float | None]:
    """Value and interval; null for what is longer than tracers are followed."""
    from ..tracking.residence import residence_time

    found = residence_time(field, outline, direction, speed, sheddings=cycles)
    ends = {"value": found.value, "low": found.low, "high": found.high}
    return {name: number if math.isfinite(number) else None for name, number in ends.items()}
