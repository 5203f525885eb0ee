"""report.html: one file that opens offline, the answer first. Pictures are inlined from the run's figures folder."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import atomic_write
from ..results.measured import Measured
from .csv import IMPACT_COLUMNS, impact_cells
from .figures import captions
from .pictures import found
from .words import (
    HOLDS,
    NO_VALUE,
    UNKNOWN_ERROR,
    budget_columns,
    change_of,
    condensed,
    error_text,
    expected,
    percent,
    source_seconds,
)

if TYPE_CHECKING:
    from ..results.airflow_summary import Airflow
    from ..results.funnel_summary import FunnelSummary
    from ..results.result import MeshSummary, Result

__all__ = ["render", "write_html"]

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
MOST_MOVED = 3  # shares that are told of a number
MINUTES_FROM = 120.0  # s: longer run times are written in minutes
SCALE = {"mm": 1e3, "cm²": 1e4, "g/s": 1e3, "g": 1e3, "us": 1e6}
HOW = {
    "measured": "from this run",
    "companion": "from flying granules again",
    "calibrated": "a true bound: all that lands within the shift of the bin's ends",
    "unknown": "not known",
}


def write_html(folder: Path | str, result: Result) -> Path:
    """Write ``folder/report.html`` from a result and the PNG files in ``folder/figures``."""
    folder = Path(folder)
    path = folder / "report.html"
    asked = found(folder / "figures")
    texts = {**captions(), **{name: picture.text or name for name, picture in asked.items()}}
    with atomic_write(path) as stream:
        stream.write(render(result, _pictures(folder / "figures", texts), folder.resolve().name, texts))
    return path


def render(
    result: Result, pictures: Mapping[str, str], title: str = "result", texts: Mapping[str, str] | None = None
) -> str:
    """The page as text; ``pictures``: name to base64 PNG; ``texts``: name to what it shows, in their order, the
    standard figures' captions by default.

    Raises jinja2.UndefinedError when the page asks for what a result has not.
    """
    import tomlkit
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(percent=percent, points=_points, number=_number, seconds=_seconds)
    environment.globals.update(change_of=change_of)
    shown = captions() if texts is None else texts
    return environment.get_template("report.html.j2").render(
        result=result,
        title=title,
        pictures=[(name, pictures[name], text) for name, text in shown.items() if name in pictures],
        airflow=_airflow_rows(result.airflow, result.mesh),
        ends=_end_rows(result.airflow),
        funnel=_funnel_rows(result.funnel),
        grids=() if result.airflow is None else result.airflow.grids or (),
        plan=result.plan,
        scene=tomlkit.dumps(_rounded(result.scene)),
        **_shares(result),
        **_impacts(result),
        **_budget(result),
        **_inputs(result),
        holds=HOLDS,
        unknown=UNKNOWN_ERROR,
        dash=NO_VALUE,
    )


def _shares(result: Result) -> dict[str, Any]:
    """What the page says of the separation."""
    landings = result.landings
    return {
        "separation": None if landings is None else landings.separation,
        "alone": None if landings is None else landings.without_collisions,
        "slab": None if landings is None else landings.slab,
        "bracket": {} if landings is None else landings.bracket or {},
        "air_loading": {} if landings is None else landings.air_loading or {},
        "answers": list(_answers(result)),
        "targets": {name: result.targets(name) for name in result.scene["fraction"]},
        "expected": lambda place: expected(result, place),
    }


def _impacts(result: Result) -> dict[str, Any]:
    """What the page says of first impacts and of fates."""
    flights = result.flights
    impact = None if flights is None else flights.impact
    return {
        "impact": impact,
        "impacts": impact_cells(impact),
        "impact_columns": IMPACT_COLUMNS,
        "fates": {} if flights is None else flights.fates,
    }


def _budget(result: Result) -> dict[str, Any]:
    """What the page says of the budget."""
    rows = condensed(result.budget)
    return {
        "budget": rows,
        "sources": budget_columns(rows),
        "spent": source_seconds(rows),
        "error_text": error_text,
        "how": HOW,
        "unsaid": list(dict.fromkeys(row.total.note for row in rows if row.total.error is None and row.total.note)),
    }


def _inputs(result: Result) -> dict[str, Any]:
    """What the page says of the numbers that are not known exactly, those first that move a share most."""
    landings = result.landings
    known = {} if landings is None else landings.inputs or {}
    parts = {} if landings is None else landings.measure_next or {}
    moves: dict[str, list[tuple[float, str]]] = {key: [] for key in known}
    for name, places in parts.items():
        for place, effects in places.items():
            for key, effect in effects.items():
                moves[key].append((effect.half, f"{name} in {place} {100 * effect.half:.2g}"))
    rows = []
    for key, number in known.items():
        most = sorted(moves[key], key=lambda one: -one[0])[:MOST_MOVED]
        rows.append(
            (most[0][0] if most else 0.0, {"key": key, "number": number, "moves": ", ".join(t for _, t in most)})
        )
    return {"inputs": [row for _, row in sorted(rows, key=lambda one: -one[0])]}


def _rounded(value: Any) -> Any:
    """Numbers to 12 digits: the last bits of a unit conversion are noise to a reader."""
    if isinstance(value, Mapping):
        return {key: _rounded(member) for key, member in value.items()}
    if isinstance(value, list):
        return [_rounded(member) for member in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def _pictures(folder: Path, names: Iterable[str]) -> dict[str, str]:
    files = {name: folder / f"{name}.png" for name in names}
    return {n: base64.b64encode(f.read_bytes()).decode("ascii") for n, f in files.items() if f.exists()}


def _answers(result: Result) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """(fraction, recovery in percent, its target bins) for every fraction that has a target."""
    recovery = {} if result.landings is None else result.landings.separation.recovery
    return ((name, percent(row), result.targets(name)) for name, row in recovery.items() if row is not None)


def _airflow_rows(airflow: Airflow | None, mesh: MeshSummary | None) -> list[tuple[str, str, str]]:
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


def _end_rows(airflow: Airflow | None) -> list[tuple[str, ...]]:
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


def _funnel_rows(funnel: FunnelSummary | None) -> list[tuple[str, str, str]]:
    """(name, value with interval, unit) of the feed funnel; nothing without one."""
    return list(_rows(funnel, FUNNEL))


def _rows(record: object, lines: Lines) -> Iterator[tuple[str, str, str]]:
    """(name, value with interval, unit) of every attribute in ``lines`` that a record has; nothing without a record."""
    for attribute, name, unit in lines if record is not None else ():
        value = getattr(record, attribute)
        if value is not None:
            yield name, _measured(value, SCALE.get(unit, 1.0)), unit


def _measured(value: str | float | Measured | Sequence[float], scale: float) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, Measured):
        return _interval(value, scale)
    if isinstance(value, float | int):
        return _number(value * scale)
    return " to ".join(_number(member * scale) for member in value)


def _interval(number: Measured, scale: float) -> str:
    text = NO_VALUE if number.value is None else _number(number.value * scale)
    if number.low is None or number.high is None:
        return text
    return f"{text} [{_number(number.low * scale)}, {_number(number.high * scale)}]"


def _number(value: float | None) -> str:
    """Four significant digits, thousands in full; a dash for None."""
    if value is None:
        return NO_VALUE
    if isinstance(value, int) or (value and IN_FULL[0] <= abs(value) < IN_FULL[1]):
        return f"{value:.0f}"
    return f"{value:.4g}"


def _points(value: float | None) -> str:
    """A share as percentage points, two digits; a dash for None."""
    return NO_VALUE if value is None else f"{100 * value:.2g}"


def _seconds(value: float | None) -> str:
    if value is None:
        return NO_VALUE
    return f"{value:.1f} s" if value < MINUTES_FROM else f"{value / 60:.1f} min"
