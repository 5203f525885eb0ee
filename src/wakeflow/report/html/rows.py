"""What was measured in the air, in the funnel and of the mesh, as rows of words; numbers as text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ...core.number import Number
from ..words import NO_VALUE

if TYPE_CHECKING:
    from ...funnel.delivered import FunnelSummary
    from ...meshing.quality import MeshReport
    from ...results.airflow_summary import Airflow

__all__ = ["airflow_rows", "end_rows", "funnel_rows", "number", "percentage_points", "seconds"]

Lines = tuple[tuple[str, str, str], ...]
AIRFLOW: Lines = (  # attribute, name, unit
    ("reynolds", "Reynolds number on the body's width", ""),
    ("turbulence", "turbulence model", ""),
    ("cells", "mesh cells", ""),
    ("cd", "drag coefficient of the body", ""),
    ("cl_rms", "lift coefficient, root mean square", ""),
    ("strouhal", "Strouhal number of the shedding", ""),
    ("cp_front", "pressure coefficient at the front", ""),
    ("cp_base", "base pressure coefficient", ""),
    ("pressure_drop", "pressure drop of the channel", "Pa"),
    ("flow_rate", "air flow per metre of depth", "m²/s"),
    ("mass_error", "inflow less outflow, over inflow", ""),
    ("y_plus", "y+ of the cells at the body", ""),
)
SUCTION = (
    ("cp_min", "suction zone: lowest pressure coefficient", ""),
    ("length", "suction zone: length downstream of the body", "mm"),
    ("width", "suction zone: width", "mm"),
    ("area", "suction zone: area", "cm²"),
    ("reversal_length", "length of the reversed flow on the axis", "mm"),
)
ENDS: Lines = (  # attribute, name, unit: of a best estimate beside its ends
    ("cd", "drag coefficient of the body", ""),
    ("cl_rms", "lift coefficient, root mean square", ""),
    ("cp_base", "base pressure coefficient", ""),
    ("residence_time", "near-wake residence time, times U / D", ""),
)
FUNNEL = (
    ("rate", "discharge rate, with 95 % interval", "g/s"),
    ("time_to_empty", "time until 99 % of the mass is out", "s"),
    ("beverloo", "Beverloo's law for one at rest, flat floor, bulk density as packed", "g/s"),
    ("beverloo_cone", "the same with Rose & Tanaka's cone factor", "g/s"),
    ("frequency", "frequency", "Hz"),
    ("gamma", "peak acceleration of the wall over g", ""),
    ("beads", "beads", ""),
    ("mass", "mass", "g"),
    ("left", "beads left inside", ""),
    ("packing", "packing of the poured bed", ""),
    ("overlap", "deepest overlap of two beads seen, in diameters", ""),
    ("youngs_modulus", "Young's modulus (softened; glass: 6e10)", "Pa"),
    ("contact_time", "duration of the quickest collision", "us"),
    ("time_step", "time step", "us"),
)
MESH = (
    ("min_angle", "mesh: smallest angle of a cell", "°"),
    ("max_aspect", "mesh: largest ratio of edges of a cell", ""),
)
CHECK_MESH = (
    ("non_orthogonality", "mesh: largest non-orthogonality (checkMesh)", "°"),
    ("skewness", "mesh: largest skewness (checkMesh)", ""),
)
DIVERGENCE = (
    ("rms", "divergence of the tracker's field, |div u| h / U: rms", ""),
    ("max", "divergence of the tracker's field, |div u| h / U: largest", ""),
)
MOMENTUM = (
    ("cp_front", "the paper's momentum model: pressure coefficient, mean over the front", ""),
    ("cd", "the paper's momentum model: drag coefficient, with the computed base pressure", ""),
)
TRUNCATION = (
    ("modes", "time-resolved field: modes kept", ""),
    ("velocity", "time-resolved field: velocity cut off, rms over rms of its fluctuation", ""),
    ("pressure", "time-resolved field: pressure cut off, rms over rms of its fluctuation", ""),
)
IN_FULL = (1e3, 1e7)  # numbers between them are written without exponent
MINUTES_FROM = 120.0  # s: longer run times are written in minutes
SCALE = {"mm": 1e3, "cm²": 1e4, "g/s": 1e3, "g": 1e3, "us": 1e6}


def airflow_rows(airflow: Airflow | None, mesh: MeshReport | None) -> list[tuple[str, str, str]]:
    """(name, value with interval, unit) of what was measured in the air; nothing for what is not known."""
    if airflow is None:
        return []
    parts: tuple[tuple[object, Lines], ...] = (
        (airflow, AIRFLOW),
        (airflow.suction, SUCTION),
        (airflow.momentum, MOMENTUM),
        (mesh, MESH),
        (airflow.mesh, CHECK_MESH),
        (airflow.divergence, DIVERGENCE),
        (airflow.truncation, TRUNCATION),
    )
    return [row for record, lines in parts for row in _rows(record, lines)]


def end_rows(airflow: Airflow | None) -> list[tuple[str, ...]]:
    """(name, steady, best estimate, time-resolved, unit) of what a best estimate lies between; nothing without one."""
    if airflow is None or airflow.ends is None:
        return []
    beside = (airflow.ends.steady, airflow, airflow.ends.time_resolved)
    zones = tuple(record.suction for record in beside)
    return [*_beside(beside, ENDS), *_beside(zones, SUCTION)]


def _beside(records: Sequence[object], lines: Lines) -> Iterator[tuple[str, ...]]:
    """(name, a value of each record, unit) of every attribute in ``lines`` that all of them have."""
    for attribute, name, unit in lines:
        values = [getattr(record, attribute, None) for record in records]
        told = [_measured(value, SCALE.get(unit, 1.0)) for value in values if value is not None]
        if len(told) == len(values):
            yield name, *told, unit


def funnel_rows(funnel: FunnelSummary | None) -> list[tuple[str, str, str]]:
    """(name, value with interval, unit) of the feed funnel; nothing without one."""
    return list(_rows(funnel, FUNNEL))


def _rows(record: object, lines: Lines) -> Iterator[tuple[str, str, str]]:
    """(name, value with interval, unit) of every attribute in ``lines`` that a record has; nothing without a record."""
    for attribute, name, unit in lines if record is not None else ():
        value = getattr(record, attribute)
        if value is not None:
            yield name, _measured(value, SCALE.get(unit, 1.0)), unit


def _measured(value: str | float | Number | Sequence[float], scale: float) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, Number):
        return _interval(value, scale)
    if isinstance(value, float | int):
        return number(value * scale)
    return " to ".join(number(member * scale) for member in value)


def _interval(found: Number, scale: float) -> str:
    text = number(found.value * scale) if math.isfinite(found.value) else NO_VALUE
    if not found.known:
        return text
    return f"{text} [{number(found.low * scale)}, {number(found.high * scale)}]"


def number(value: float | None) -> str:
    """Four significant digits, thousands in full; a dash for None."""
    if value is None:
        return NO_VALUE
    if isinstance(value, int) or (value and IN_FULL[0] <= abs(value) < IN_FULL[1]):
        return f"{value:.0f}"
    return f"{value:.4g}"


def percentage_points(value: float | None) -> str:
    """A share as percentage points, two digits; a dash for None."""
    return NO_VALUE if value is None else f"{100 * value:.2g}"


def seconds(value: float | None) -> str:
    """A run time, of more than two minutes in minutes; a dash for None."""
    if value is None:
        return NO_VALUE
    return f"{value:.1f} s" if value < MINUTES_FROM else f"{value / 60:.1f} min"
