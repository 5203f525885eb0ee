"""What an airflow will cost, before its mesh is made: cells, seconds of OpenFOAM, processes."""

from __future__ import annotations

from ..scene import Scene
from .airflow import AirflowPlan
from .span import SpanCost, cost_of

__all__ = ["ranks_for", "span_cost", "typical_cells", "typical_seconds"]

SECONDS = {"steady": 15.0, "time-resolved": 90.0}  # of solving on 2020s hardware at the rung's own mesh, one core
WORTH_IT = 60_000  # cells from which a second MPI rank pays
RANKS = 2  # from there on, on every machine: the number of ranks is part of what is computed, by rounding
CELLS = {"steady": 5000.0, "time-resolved": 8000.0}  # typical, a body


def ranks_for(cells: int) -> tuple[int, str]:
    """MPI ranks for a case of so many cells, whatever machine it runs on, and the reason."""
    if cells < WORTH_IT:
        return 1, f"one process: {cells} cells are too few to share (two MPI ranks from {WORTH_IT} cells)"
    return RANKS, f"{RANKS} MPI ranks of about {cells // RANKS} cells"


def typical_cells(airflow: AirflowPlan, bodies: int) -> float:
    """Cells to expect on the answer's grid, before it is meshed; good to a factor of two."""
    layers = 1 if airflow.span is None else airflow.span.layers
    return 0.0 if airflow.stepping is None else layers * CELLS[airflow.stepping] * bodies / airflow.scales[0] ** 2


def span_cost(scene: Scene, airflow: AirflowPlan) -> SpanCost:
    """What the third dimension costs, before the mesh is made; nothing where it is not resolved."""
    if airflow.span is None:
        return SpanCost(0.0, 0.0, 0.0, 0.0, 0.0)
    scale = airflow.scales[0] * scene.numerics.mesh_scale
    return cost_of(airflow.span, CELLS["time-resolved"] * len(scene.body) / scale**2, scale)


def typical_seconds(airflow: AirflowPlan) -> float:
    """Seconds of OpenFOAM to expect on one core, its starting solution included; good to a factor of three."""
    if airflow.stepping is None:
        return 0.0
    whole = 1.0 if airflow.half or airflow.stepping == "time-resolved" else 2.5
    one = SECONDS[airflow.stepping] * whole
    first = 0.0 if airflow.stepping == "steady" else SECONDS["steady"] * (1.0 if airflow.symmetric else 2.5)
    return sum(first / scale**2 + one / scale**3 for scale in airflow.scales)
