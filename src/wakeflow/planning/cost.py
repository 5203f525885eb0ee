"""What a plan will cost: seconds, memory and disk, before anything is started; good to a factor of three.

All numbers are measured: runs of the shipped scenes on two cores of 2020s hardware.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..funnel import estimated_seconds
from ..laws.forces import forces
from ..scene import Scene
from .airflow import AirflowPlan
from .airflow_cost import span_cost, typical_cells, typical_seconds
from .crowd import CrowdPlan
from .flights_again import times_again
from .plan import AT_ONCE, COMPARED, REPLICATES, FractionPlan, replicate_size

__all__ = ["AirflowCost", "airflow_cost", "estimate_cost"]

STARTED = 5.0  # s: importing, reading, writing the report
SECONDS_A_GRANULE = 150e-6  # s of both cores: one flight with drag and weight
LOADED = 60.0  # s: three passes of the air that feels the granules
PROGRAM = 4e8  # bytes: the interpreter with its libraries, and a field
BYTES_IN_FLIGHT = 1500.0  # bytes of memory a granule that is fed and flown at the time
BYTES_LANDED = 120.0  # bytes of memory a granule: its row of landings
FILES = 1e6  # bytes: tables and report
BYTES_A_CELL = 1500.0  # bytes of disk a cell: the mesh in text
BYTES_A_SNAPSHOT = 80.0  # bytes of disk a cell and snapshot: its fields
SNAPSHOTS = {"time-resolved": 150.0, "steady": 2.0}  # number kept of an airflow
CROWD_AGAIN = 0.25  # of the slab's time: part of it again with twice the step, and in a slab of half the depth
BYTES_STORED = 80.0  # bytes of disk a granule and fraction: its row of landings, compressed


class AirflowCost(NamedTuple):
    """What an airflow alone costs: ``seconds``, and bytes of ``disk``."""

    seconds: float
    disk: float


def airflow_cost(scene: Scene, airflow: AirflowPlan) -> AirflowCost:
    """What is shared by all scenes that fly in one airflow."""
    cells, deep = typical_cells(airflow, len(scene.body)), span_cost(scene, airflow)
    kept = 0.0 if airflow.span is not None else BYTES_A_SNAPSHOT * SNAPSHOTS[airflow.stepping or "steady"]
    return AirflowCost(typical_seconds(airflow) + deep.core_seconds, cells * (BYTES_A_CELL + kept) + deep.disk)


def estimate_cost(
    scene: Scene, airflow: AirflowPlan, fractions: Mapping[str, FractionPlan], crowd: CrowdPlan | None
) -> dict[str, float]:
    """``seconds``, ``memory`` and ``disk`` (bytes) of a run, its funnel and its slab included."""
    count = REPLICATES * replicate_size(scene.feed.count)
    at_once = max(min(count, AT_ONCE), count // REPLICATES)
    effort = sum(forces[force].effort for fraction in fractions.values() for force in fraction.forces)
    again = 1 + times_again(airflow) * COMPARED / REPLICATES
    tracks = SECONDS_A_GRANULE * count * (len(fractions) + effort) * again
    poured = 0.0 if scene.funnel is None else estimated_seconds(scene.funnel)
    loaded = LOADED if airflow.loaded else 0.0
    slab = 0.0 if crowd is None else crowd.seconds * (1.0 + CROWD_AGAIN)
    air, deep = airflow_cost(scene, airflow), span_cost(scene, airflow)
    return {
        "seconds": STARTED + air.seconds + loaded + tracks + slab + poured,
        "memory": max(PROGRAM + BYTES_IN_FLIGHT * at_once + BYTES_LANDED * count, deep.memory),
        "disk": FILES + air.disk + BYTES_STORED * count * len(fractions),
    }
