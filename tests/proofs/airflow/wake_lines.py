"""The mean air along a body's axis and across its wake, as laser measurements are published: further quantities."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofs.airflow.measured import Quantity, QuantityValue, SolvedAirflow, quantities
from wakeflow.field import FlowField
from wakeflow.foam.case import read_parameters

Array = NDArray[np.float64]
REACH = 3.0  # widths behind the rear within which the fastest reversed air is looked for: near wakes end there
STEP = 0.01  # widths between the places that are looked at
ACROSS = 1.2  # widths to either side, as far as the profiles were measured
STATIONS = (0.95, 3.75, 9.4)  # widths behind the rear: where the Volvo rig's profiles were measured


@cache
def _mean(case: Path) -> tuple[FlowField, Array, Array, float, float]:
    """The mean field of a solved case; where the first body's axis leaves it (m), the unit vector along the air, the
    inlet's mean speed (m/s) and the body's width (m).
    """
    given = read_parameters(case)
    rear, along = (
        np.array(given[name].strip("()").split()[:2], dtype=float) for name in ("basePoint", "flowDirection")
    )
    field = FlowField.from_openfoam(case, "mean" if (case / "loop.json").exists() else "latest")
    return field, rear, along, float(given["inletSpeed"]), float(given["bodyWidth"])


def mean_axial(case: Path, behind: Array, across: Array) -> Array:
    """Mean velocity along the air over the inlet's mean speed, at places (n,) behind the first body's rear and across
    its axis, both in its widths; NaN outside of the mesh. On half a domain the other half is its mirror image.
    """
    field, rear, along, speed, width = _mean(case)
    beside = width * across
    if field.points[:, 0].min() > rear[0] - 1e-6 * width:  # only x >= 0 was meshed
        beside = np.abs(beside)
    places = rear + width * behind[:, None] * along + beside[:, None] * np.array([1.0, 0.0])
    return np.asarray(field.sample(places)[0] @ along / speed)


def _exact(value: float) -> QuantityValue | None:
    return QuantityValue(value, value, value) if np.isfinite(value) else None


def _reversed(airflow: SolvedAirflow, *, where: bool) -> QuantityValue | None:
    behind = np.arange(STEP, REACH, STEP)
    values = mean_axial(airflow.case, behind, np.zeros_like(behind))
    if np.isnan(values).all():
        return None
    fastest = int(np.nanargmin(values))
    return _exact(float(behind[fastest] if where else values[fastest]))


def _on_axis(airflow: SolvedAirflow, station: float) -> QuantityValue | None:
    return _exact(float(mean_axial(airflow.case, np.array([station]), np.zeros(1))[0]))


def _fastest_beside(airflow: SolvedAirflow, station: float) -> QuantityValue | None:
    across = np.arange(-ACROSS, ACROSS + STEP, STEP)
    values = mean_axial(airflow.case, np.full_like(across, station), across)
    return None if np.isnan(values).any() else _exact(float(values.max()))


def _add(name: str, label: str, of: Callable[[SolvedAirflow], QuantityValue | None]) -> None:
    quantities.add(name, Quantity(label, of))


_add("axis_least", "least mean u on the axis", partial(_reversed, where=False))
_add("axis_least_at", "its place behind the rear / D", partial(_reversed, where=True))
for _station in STATIONS:
    _add(f"axis_{_station:g}", f"mean u on the axis at {_station:g} D", partial(_on_axis, station=_station))
    _add(f"beside_{_station:g}", f"largest mean u at {_station:g} D", partial(_fastest_beside, station=_station))
