"""What an airflow will cost, before its mesh is made: cells, seconds of OpenFOAM, processes."""

from __future__ import annotations

from ..scene import Scene
from .airflow import AirflowPlan
from .span import SpanCost, cost_of

__all__ = ["ranks_for", "solver_seconds", "span_cost", "typical_cells"]

SECONDS = {"steady": 17.0, "time-resolved": 81.0}  # of solving on 2020s hardware at the usual mesh, a body, one core
UNMIRRORED = 3.4  # times as long: a steady solution of the whole channel, which has more cells and settles late
WORTH_IT = 60_000  # cells from which a second MPI rank pays
RANKS = 2  # from there on, on every machine: the number of ranks is part of what is computed, by rounding
CELLS = {"steady": 5000.0, "time-resolved": 8000.0}  # typical, a body


def ranks_for(cells: int) -> tuple[int, str]:
    """MPI ranks for a case of so many cells, whatever machine it runs on, and the reason."""
    if cells < WORTH_IT:
        return 1, f"one process: {cells} cells are too few to share (two MPI ranks from {WORTH_IT} cells)"
    return RANKS, f"{RANKS} MPI ranks of about {cells // RANKS} cells"


def typical_cells(scene: Scene, airflow: AirflowPlan, grid: int = 0) -> float:
    """Cells to expect on a grid of the plan, 0 the answer's, before it is meshed; good to a factor of two."""
    layers = 1 if airflow.span is None else airflow.span.layers
    if airflow.stepping is None:
        return 0.0
    return layers * CELLS[airflow.stepping] * len(scene.body) / _edges(scene, airflow, grid) ** 2


def span_cost(scene: Scene, airflow: AirflowPlan) -> SpanCost:
    """What the third dimension costs, before the mesh is made; nothing where it is not resolved."""
    if airflow.span is None:
        return SpanCost(0.0, 0.0, 0.0, 0.0, 0.0)
    scale = airflow.scales[0] * scene.numerics.mesh_scale
    return cost_of(airflow.span, CELLS["time-resolved"] * len(scene.body) / scale**2, scale)


def solver_seconds(scene: Scene, airflow: AirflowPlan, grid: int = 0) -> tuple[float, float]:
    """Seconds of OpenFOAM to expect on one core, on a grid of the plan: of the steady solution that a time-resolved one
    starts from, 0 where it is steady itself, and of the airflow; good to a factor of two.

    The time step goes with the cells' edges, and so do the iterations of a steady solution that settles; one of the
    whole channel often does not, and then ends after about as many on all meshes.
    """
    if airflow.stepping is None:
        return 0.0, 0.0
    edges = _edges(scene, airflow, grid)
    size = len(scene.body) / edges**3
    steady = airflow.stepping == "steady"
    half = airflow.half if steady else airflow.symmetric
    start = SECONDS["steady"] * size * (1.0 if half else UNMIRRORED * edges)
    if airflow.span is not None:
        return start, 0.0
    return (0.0, start) if steady else (start, SECONDS["time-resolved"] * size)


def _edges(scene: Scene, airflow: AirflowPlan, grid: int) -> float:
    """Cell edges on a grid, over the usual ones."""
    return airflow.scales[grid] * scene.numerics.mesh_scale
