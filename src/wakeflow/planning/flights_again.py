"""How often granules fly again so that the budget knows an error: what a source of the budget adds to the cost.

A source of the budget that flies granules again (``results.sources``) has an entry here under its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ..core.registry import Registry
from .airflow import AirflowPlan
from .plan import COMPARED, REPLICATES
from .wake import Wake

__all__ = ["FlownAgain", "flights_again", "times_again"]

FlownAgain = Mapping[str, float]  # by stage: how long it takes, in flights of the granules of a comparison
FINER_STEPS = 2.0  # times as long: flights at a hundredth of the tolerance; measured on the shipped rhombus, 2.0 to 2.8

flights_again: Registry[Callable[[AirflowPlan], FlownAgain]] = Registry("source that flies granules again")
flights_again.add("inputs", lambda _: {"draws": REPLICATES / COMPARED})  # as many granules as the answer has
flights_again.add("integration", lambda _: {"companion": FINER_STEPS})
flights_again.add(
    "airflow-model",
    lambda airflow: {f"{'draft ' if w is Wake.STEADY else ''}{w} wake": 1.0 for w in airflow.wakes_beside},
)
flights_again.add("air-loading", lambda airflow: {"unloaded": 1.0} if airflow.loaded else {})
flights_again.add("mesh", lambda airflow: {f"grid x {scale:.2g} tracks": 1.0 for scale in airflow.scales[1:]})
flights_again.add("slab-time-step", lambda _: {})  # of the slab, whose cost counts them
flights_again.add("slab-depth", lambda _: {})


def times_again(airflow: AirflowPlan) -> dict[str, float]:
    """The stages in which granules fly again beside the answer's own, and what each takes in flights of a comparison's
    granules.
    """
    return {stage: times for name in flights_again for stage, times in flights_again[name](airflow).items()}
