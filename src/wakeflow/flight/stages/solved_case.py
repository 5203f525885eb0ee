"""What pictures show of a solved airflow's OpenFOAM case: its cells, and the forces as the solver recorded them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...air.foam.polymesh import read_polymesh
from ...air.foam.read import loop_of
from ...air.foam.statistics import CD, CL, read_table
from ...air.kinds.airflow_kinds import CaseAir
from ...air.kinds.airflow_table import Airflow
from .pipeline import Pipeline

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneCells:
    """The cells of a plane mesh: ``points`` (n, 2) m, and of each of ``cells`` the indices of its corners, in order."""

    points: Array
    cells: Sequence[NDArray[np.int64]]


@dataclass(frozen=True)
class ForceHistory:
    """Drag and lift coefficients ``cd`` and ``cl`` (n,) of all bodies, at each ``time`` (n,): s where the airflow is
    resolved ``in_time``, else iterations.

    ``start_up``: what was dropped of the beginning (s) before they were averaged, None where the last ones count alone;
    ``loop``: first and last time (s) of the stretch whose air is kept, None where there is none.
    """

    time: Array
    cd: Array
    cl: Array
    in_time: bool
    start_up: float | None
    loop: tuple[float, float] | None


def cells_of(pipeline: Pipeline) -> PlaneCells | None:
    """The cells that the airflow was solved in; None where it is known without, or solved in three dimensions."""
    case = _case(pipeline)
    if case is None or pipeline.plan.airflow.span:
        return None
    plane = read_polymesh(case).plane
    return PlaneCells(plane.points, plane.cells)


def forces_of(pipeline: Pipeline, airflow: Airflow) -> ForceHistory | None:
    """The recorded forces of the airflow as it was solved, ``airflow`` what is known of it; None without any."""
    case = _case(pipeline)
    rows = np.zeros((0, 3)) if case is None else read_table(case, "forceCoefficients", (CD, CL))
    if case is None or len(rows) < 2:
        return None
    kept, statistics = loop_of(case), airflow.statistics
    loop = (first := float(kept["times"][0]), first + float(kept["period"])) if kept else None
    in_time, start_up = airflow.stepping == "time-resolved", statistics.start_up if statistics else None
    half = isinstance(pipeline.air, CaseAir) and pipeline.air.half
    lift = np.zeros(len(rows)) if half else rows[:, 2]  # that of the other half takes it away
    return ForceHistory(rows[:, 0], rows[:, 1], lift, in_time, start_up, loop)


def _case(pipeline: Pipeline) -> Path | None:
    return pipeline.air.case if isinstance(pipeline.air, CaseAir) else None
