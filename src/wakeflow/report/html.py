"""report.html: one file that opens offline, the answer first. Pictures are inlined from the run's figures folder."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..core.files import atomic_write
from .pictures import found
from .tables import (
    IMPACT_COLUMNS,
    NONE,
    UNKNOWN,
    budget_sources,
    condensed,
    error_text,
    expected,
    impact_rows,
    percent,
    source_seconds,
    targets,
)  # fmt: skip

__all__ = ["render", "write_html"]

Result = Mapping[str, Any]

FIGURES = {  # file name: what it shows
    "pressure": "Pressure coefficient and streamlines. Dashed: the suction zone's border, Cp = −0.5.",
    "tracks": "Tracks through the channel; bins are the bars.",
    "discharge": "The feed funnel: mass left inside over time; dashed: Beverloo's law for a funnel at rest.",
    "landing": "Where the mass of each fraction lands; percent with 95 % interval.",
}
AIRFLOW = (  # key, name, unit
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
QUALITY = (
    ("min_angle", "mesh: smallest angle of a cell", "°"),
    ("max_aspect", "mesh: largest ratio of edges of a cell", ""),
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
SCALE = {"mm": 1e3, "cm²": 1e4, "g/s": 1e3, "g": 1e3, "us": 1e6}
HOW = {
    "measured": "from this run",
    "companion": "from flying granules again",
    "calibrated": "a bound on the shift times the landing density found",
    "unknown": "not known",
}


def write_html(folder: Path | str, result: Result) -> Path:
    """Write ``folder/report.html`` from result.json's dict and the PNG files in ``folder/figures``."""
    folder = Path(folder)
    path = folder / "report.html"
    asked = found(folder / "figures")
    texts = {**FIGURES, **{name: row["text"] or name for name, row in asked.items()}}
    with atomic_write(path) as stream:
        stream.write(render(result, _pictures(folder / "figures", texts), folder.resolve().name, texts))
    return path


def render(
    result: Result, pictures: Mapping[str, str], title: str = "result", texts: Mapping[str, str] = FIGURES
) -> str:
    """The page as text; ``pictures``: name to base64 PNG; ``texts``: name to what it shows, in their order.

    Raises jinja2.UndefinedError when the result lacks a key.
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
    environment.filters.update(percent=percent, number=_number, seconds=_seconds)
    template = environment.get_template("report.html.j2")
    budget = {"budget": condensed(result.get("budget") or [])}
    return template.render(
        result=result,
        title=title,
        separation=result.get("separation"),
        answers=list(_answers(result)),
        targets={name: targets(result, name) for name in result["scene"]["fraction"]},
        expected=lambda place: expected(result, place),
        pictures=[(name, pictures[name], text) for name, text in texts.items() if name in pictures],
        airflow=_airflow_rows(result.get("airflow"), result.get("mesh")),
        funnel=_funnel_rows(result.get("funnel")),
        grids=(result.get("airflow") or {}).get("grids") or [],
        bracket=result.get("bracket") or {},
        impacts=impact_rows(result),
        impact_columns=IMPACT_COLUMNS,
        budget=budget["budget"],
        sources=budget_sources(budget),
        spent=source_seconds(budget),
        error_text=error_text,
        unknown=UNKNOWN,
        dash=NONE,
        how=HOW,
        scene=tomlkit.dumps(_rounded(result["scene"])),
    )


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


def _answers(result: Result) -> list[tuple[str, str, tuple[str, ...]]]:
    """(fraction, recovery in percent, its target bins) for every fraction that has a target."""
    recovery = (result.get("separation") or {}).get("recovery", {})
    return [(name, percent(row), targets(result, name)) for name, row in recovery.items() if row is not None]


def _airflow_rows(airflow: Mapping[str, Any] | None, mesh: Mapping[str, Any] | None) -> list[tuple[str, str, str]]:
    """(name, value with interval, unit) of what was measured in the air; nothing for what is not known."""
    if airflow is None:
        return []
    quality = {**(mesh or {}), **(airflow.get("mesh") or {})}
    parts = (
        (airflow, AIRFLOW),
        (airflow.get("suction") or {}, SUCTION),
        (airflow.get("momentum") or {}, MOMENTUM),
        (quality, QUALITY),
        (airflow.get("divergence") or {}, DIVERGENCE),
        (airflow.get("truncation") or {}, TRUNCATION),
    )
    found = [(name, values.get(key), unit) for values, rows in parts for key, name, unit in rows]
    return [(name, _measured(value, SCALE.get(unit, 1.0)), unit) for name, value, unit in found if value is not None]


def _funnel_rows(funnel: Mapping[str, Any] | None) -> list[tuple[str, str, str]]:
    """(name, value with interval, unit) of the feed funnel; nothing without one."""
    found = [(name, (funnel or {}).get(key), unit) for key, name, unit in FUNNEL]
    return [(name, _measured(value, SCALE.get(unit, 1)), unit) for name, value, unit in found if value is not None]


def _measured(value: Any, scale: float) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, list | tuple):
        return " to ".join(_number(member * scale) for member in value)
    if not isinstance(value, Mapping):
        return _number(value * scale)
    text = _number(value["value"] * scale)
    if value["low"] is None or value["high"] is None:
        return text
    return f"{text} [{_number(value['low'] * scale)}, {_number(value['high'] * scale)}]"


def _number(value: float | None) -> str:
    """Four significant digits, thousands in full; a dash for None."""
    if value is None:
        return NONE
    if isinstance(value, int) or (value and 1e3 <= abs(value) < 1e7):
        return f"{value:.0f}"
    return f"{value:.4g}"


def _seconds(value: float | None) -> str:
    if value is None:
        return NONE
    return f"{value:.1f} s" if value < 120 else f"{value / 60:.1f} min"
