"""Drag, lift, base pressure and shedding from the history of a run, with their intervals."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number
from .airflow_result import RunStatistics
from .case import FlowSpec
from .history import CD, read_table, spread
from .statistics import Statistics, evaluate, is_still
from .steady import WINDOW

__all__ = ["Coefficients", "averaged", "coefficients_of", "drag_of_each"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coefficients:
    """What the history says: intervals as of :class:`~wakeflow.foam.airflow_result.AirflowResult`; ``cp_base`` is the
    probe's.
    """

    cd: Number
    cl_rms: Number
    cp_base: Number
    strouhal: Number | None
    statistics: RunStatistics | None = None
    notes: list[str] = field(default_factory=list)


def drag_of_each(spec: FlowSpec, folder: Path, begin: float | None) -> dict[str, float]:
    """Cd of each of several bodies, averaged as Cd of a steady run is; else the mean from ``begin`` (s) on."""
    found = {}
    for name in spec.mesh.names if len(spec.mesh.names) > 1 else ():
        rows = read_table(folder, f"drag_{name}", (CD,))
        if begin is None:
            found[name] = float(_window(rows)[:, 1].mean())
            continue
        late = rows[rows[:, 0] >= begin]
        found[name] = float(np.trapezoid(late[:, 1], late[:, 0]) / np.ptp(late[:, 0]))
    return found


def coefficients_of(
    spec: FlowSpec, rows: Array, loop: dict[str, Any] | None, since: float | None = None
) -> Coefficients:
    """Steady: means over the last iterations with the range they moved through; those ``since`` an iteration where the
    airflow did not settle. Time-resolved: means since the end of the start-up; the last values of a wake that came to
    rest.
    """
    if loop is None:
        recent = _window(rows) if since is None else rows[rows[:, 0] > since]
        ended = _range if spec.stepping == "steady" else _last
        rms = float(recent[:, 2].std())
        lift = Number(rms, 0.0, float(np.ptp(recent[:, 2])))
        said = [] if since is None else [_unsettled(recent[:, 1])]
        return Coefficients(ended(recent[:, 1]), lift, ended(recent[:, 3]), None, notes=said)
    swings = spec.vibration is not None and is_still(rows, spec.convective_time, swings=True)
    found = None if swings else evaluate(rows, spec.accuracy)
    if found is None:  # an irregular wake that shed less than six times, or one that only swings with the body
        late = rows[rows[:, 0] >= loop["begin"]]
        rms = float(late[:, 2].std())
        wide = Number(rms, 0.0, float(np.ptp(late[:, 2])))
        note = f"the airflow shed too few vortices in {rows[-1, 0]:.3g} s for intervals: they are the ranges it spanned"
        said = [] if swings else [note]
        return Coefficients(_range(late[:, 1]), wide, _range(late[:, 3]), None, notes=said)
    told = averaged(spec, found)
    if found.stands:
        return told
    note = (
        f"the airflow's intervals are up to {found.excess:.1f} times as wide as asked after "
        f"{rows[-1, 0] / spec.convective_time:.0f} widths of travel, where the run was ended"
    )
    return replace(told, notes=[note])


def averaged(spec: FlowSpec, found: Statistics) -> Coefficients:
    """The coefficients of a run in time that ``found`` was made of."""
    number = None if found.frequency is None else found.frequency.times(spec.convective_time)
    told = RunStatistics(found.periods, found.begin, spec.accuracy, found.excess)
    return Coefficients(found.cd, found.cl_rms, found.cp_base, number, told)


def _unsettled(drag: Array) -> str:
    part = 50 * spread(drag)
    return (
        f"the steady airflow does not settle: over its last {len(drag)} iterations Cd swings by {part:.2g} % to either "
        "side of its mean"
    )


def _window(rows: Array) -> Array:
    """The last iterations or steps that a steady airflow is measured on."""
    return rows[-max(min(WINDOW, len(rows) // 4), 1) :]


def _last(values: Array) -> Number:
    return Number(float(values[-1]), float(values.min()), float(values.max()))


def _range(values: Array) -> Number:
    return Number(float(values.mean()), float(values.min()), float(values.max()))
