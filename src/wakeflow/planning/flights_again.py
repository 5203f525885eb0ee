"""How often granules fly again so that the budget knows an error: what a source of the budget adds to the cost.

A source of the budget that flies granules again (``results.sources``) has an entry here under its name.
"""

from __future__ import annotations

from collections.abc import Callable

from ..core.registry import Registry
from .airflow import AirflowPlan
from .plan import COMPARED, REPLICATES

__all__ = ["flights_again", "times_again"]

flights_again: Registry[Callable[[AirflowPlan], int]] = Registry("source that flies granules again")
flights_again.add("inputs", lambda _: REPLICATES // COMPARED)  # as many granules as the answer has
flights_again.add("integration", lambda _: 0)  # finer steps: within the estimate's factor of three
flights_again.add("airflow-model", lambda airflow: len(airflow.wakes_beside))
flights_again.add("air-loading", lambda airflow: int(airflow.loaded))
flights_again.add("mesh", lambda airflow: len(airflow.scales) - 1)
flights_again.add("slab-time-step", lambda _: 0)  # of the slab, whose cost counts them
flights_again.add("slab-depth", lambda _: 0)


def times_again(airflow: AirflowPlan) -> int:
    """How often the granules of a comparison fly beside the answer's own."""
    return sum(flights_again[name](airflow) for name in flights_again)
