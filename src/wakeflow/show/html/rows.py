"""What the page tells in tables: what was asked, the materials and their sources, what was measured in the air; and the
templates that take it.
"""

from __future__ import annotations

import json
import math
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...answer.result import Request
from ...core.number import Number
from ...core.quantities import say, speaking
from ...core.record import columns, to_json
from ...scene import Fraction, Scene
from ...scene.changes import flat
from ...scene.messages import unit_of
from ...scene.table import without_none
from .. import words
from ..plan_words import UNITS
from ..words import NO_VALUE

if TYPE_CHECKING:
    from ...answer.result import Result

# tables that the page tells in other places
ELSEWHERE = ("fraction", "numerics", "picture", "uncertainty", "force", "report", "limit", "price")
QUANTITIES = {  # of a material: name, unit
    "diameter": ("diameter of the equal sphere", "m"),
    "density": ("density", "kg/m^3"),
    "terminal_velocity": ("terminal velocity", "m/s"),
    "restitution": ("restitution", "1"),
    "friction": ("friction", "1"),
    "rebound_scatter": ("scatter of the rebound", "rad"),
    "tangential_restitution": ("tangential restitution", "1"),
    "impact": ("impact model", "1"),
}
MAX_LISTED = 3  # of a list: more entries are counted, not reported
MM_BELOW = 1e-3  # m: smaller lengths are reported in micrometres


class MaterialRow(NamedTuple):
    """One property of a fraction: its value in words, how far to trust it, and its source."""

    fraction: str
    quantity: str
    value: str
    confidence: str
    source: str


class Proof(NamedTuple):
    """What the program, on a rung, was compared with, what came out, and the section of docs/validation.md."""

    what: str
    found: str
    section: str


def machine_rows(scene: Scene) -> list[tuple[str, str]]:
    """(table, its keys with their values and units) of all that the scene sets, but for what the page tells in places
    of its own.
    """
    tables = {key: table for key, table in scene.tables().items() if key not in ELSEWHERE}
    rows: dict[str, list[str]] = {}
    with speaking(UNITS):
        for key, value in flat(tables).items():
            table, _, name = key.rpartition(".")
            rows.setdefault(table, []).append(f"{name.replace('_', ' ')} {_said(key, value)}")
    return [(table, ", ".join(said)) for table, said in rows.items()]


def input_text(key: str, value: object) -> str:
    """A value of a key of the scene with its unit, as machines are described; a dash where there is none."""
    with speaking(UNITS):
        return _said(key, value)


def _said(key: str, value: object) -> str:
    unit = unit_of(key)
    if value is None:
        return NO_VALUE
    if isinstance(value, list) and (len(value) > MAX_LISTED or any(isinstance(entry, list) for entry in value)):
        return f"{len(value)} values"
    if isinstance(value, list):
        return f"({', '.join(_said(key, entry) for entry in value)})"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return say(value, unit) if unit else f"{value:.6g}"


def material_rows(scene: Scene) -> list[MaterialRow]:
    """Every property of every fraction that the answer rests on."""
    with speaking(UNITS):
        return [row for name, fraction in scene.fraction.items() for row in _material(name, fraction)]


def _material(name: str, fraction: Fraction) -> Iterator[MaterialRow]:
    properties = fraction.properties
    for key, (quantity, unit) in QUANTITIES.items():
        value = getattr(properties, key)
        if value is None or (value == 0.0 and key.startswith(("rebound", "tangential"))):
            continue
        yield MaterialRow(name, quantity, _property(value, unit), *fraction.evidence(key))


def _property(value: object, unit: str) -> str:
    """A number with its unit, a name, or the numbers of a law."""
    if isinstance(value, int | float):
        return _length(value, unit)
    parts = vars(value).items() if not isinstance(value, str) else ()
    return ", ".join(f"{key} {part:g}" if isinstance(part, float) else f"{part}" for key, part in parts) or str(value)


def _length(value: float, unit: str) -> str:
    small = unit == "m" and value < MM_BELOW
    return f"{1e6 * value:.4g} µm" if small else say(value, unit, 4).replace("^3", "³")


def scene_in_full(scene: Scene, request: Request | None = None) -> str:
    """The scene as TOML in SI units with every default that was used, and what was ``request`` beside it, as --rung or
    --force; loading it gives a scene that computes the same.
    """
    import tomlkit

    tables = without_none(json.loads(scene.model_dump_json(exclude_none=True, by_alias=True)))
    if request is not None:
        beside = {"rung": request.rung, "target_error": request.target_error}
        tables["numerics"].update({key: value for key, value in beside.items() if value is not None})
        tables["force"] = {**tables.get("force", {}), **request.force}
    return tomlkit.dumps(_rounded(tables))


def _rounded(value: object) -> Any:
    """Numbers to 12 digits: the last bits of a unit conversion are noise to a reader. Empty tables are left out."""
    if isinstance(value, Mapping):
        whole = {key: _rounded(member) for key, member in value.items()}
        return {key: member for key, member in whole.items() if member != {}}
    if isinstance(value, list):
        return [_rounded(member) for member in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def proofs_of(rung: str) -> list[Proof]:
    """What was compared with others' computations and measurements on a rung, what is missing last."""
    text = Path(__file__).with_name("validation.toml").read_text(encoding="utf-8")
    return [
        Proof(row["what"], row["found"], row["section"])
        for row in tomllib.loads(text)["proof"]
        if rung in row["rungs"] or not row["rungs"]
    ]


# What the page tells of records; their types say what each number is, and its unit.
AIRFLOW = (
    "reynolds", "turbulence", "cells", "cd", "cl_rms", "strouhal", "cp_front", "cp_base", "pressure_drop", "flow_rate",
    "mass_error", "y_plus",
)  # fmt: skip
SUCTION = ("cp_min", "length", "width", "area", "reversal_length")
ENDS = ("cd", "cl_rms", "cp_base")  # of a best estimate beside its ends
FUNNEL = (
    "rate", "time_to_empty", "beverloo", "beverloo_cone", "frequency", "gamma", "beads", "mass", "left", "packing",
    "overlap", "youngs_modulus", "contact_time", "time_step",
)  # fmt: skip
IN_FULL = (1e3, 1e7)  # numbers between them are written without exponent
MINUTES_FROM = 120.0  # s: longer run times are written in minutes
SHOWN = {  # a unit as the page writes it, and how many of it are one
    "1": ("", 1.0), "m": ("mm", 1e3), "m2": ("cm²", 1e4), "m2/s": ("m²/s", 1.0), "deg": ("°", 1.0), "kg": ("g", 1e3),
    "kg/s": ("g/s", 1e3),
}  # fmt: skip


def airflow_rows(result: Result) -> list[tuple[str, ...]]:
    """(name, value with interval, unit) of what was measured in the air; nothing for what is not known."""
    airflow = result.airflow
    if airflow is None:
        return []
    return [
        *_cells("", AIRFLOW, airflow),
        *_cells("suction zone, ", SUCTION, airflow.suction),
        *_cells("the paper's momentum model, ", ("cp_front", "cd"), airflow.momentum),
        *_cells("mesh, ", ("min_angle", "max_aspect"), result.mesh),
        *_cells("mesh, ", ("non_orthogonality", "skewness"), airflow.mesh),
        *_cells("divergence of the tracker's field, |div u| h / U, ", ("rms", "max"), airflow.divergence),
        *_cells("time-resolved field, ", ("modes", "velocity", "pressure"), airflow.truncation),
    ]


def end_rows(result: Result) -> list[tuple[str, ...]]:
    """(name, steady, best estimate, time-resolved, unit) of what a best estimate lies between; nothing without one."""
    airflow = result.airflow
    if airflow is None or not airflow.ends:
        return []
    beside = (airflow.ends.steady, airflow, airflow.ends.time_resolved)
    return [*_cells("", ENDS, *beside), *_cells("suction zone, ", SUCTION, *(record.suction for record in beside))]


def funnel_rows(result: Result) -> list[tuple[str, ...]]:
    """(name, value with interval, unit) of the feed funnel; nothing without one."""
    return list(_cells("", FUNNEL, result.funnel))


def _cells(about: str, names: Sequence[str], *records: object) -> Iterator[tuple[str, ...]]:
    """(what it is, a value of each record, unit) of every column in ``names`` that all of the records have."""
    if not all(records):
        return
    known = {column.name: column for column in columns(type(records[0]))}
    tables = [to_json(record) for record in records]
    for name in names:
        if all(table[known[name].key] is not None for table in tables):
            unit, scale = SHOWN.get(known[name].unit, (known[name].unit, 1.0))
            said = name.replace("_", " ")
            meaning = known[name].meaning.partition("; null")[0].removeprefix(f"{said} ")
            yield (f"{about}{said}: {meaning}",
                   *(measured_text(getattr(record, name), scale) for record in records), unit)  # fmt: skip


def measured_text(value: str | float | Number | Sequence[float], scale: float) -> str:
    """A number with its interval, a word, or the numbers of a range, times ``scale``."""
    if isinstance(value, str):
        return value
    if isinstance(value, Number):
        return _interval(value, scale)
    if isinstance(value, float | int):
        return number(value * scale)
    return " to ".join(number(member * scale) for member in value)


def _interval(measured: Number, scale: float) -> str:
    text = number(measured.value * scale) if math.isfinite(measured.value) else NO_VALUE
    if not measured.known:
        return text
    return f"{text} ({number(measured.low * scale)} to {number(measured.high * scale)})"


def number(value: float | None) -> str:
    """Four significant digits, thousands in full; a dash for None and for NaN."""
    if value is None or math.isnan(value):
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


def page_template(name: str, folder: Path = Path(__file__).parent) -> Any:
    """A template of this package, or of another ``folder``, with the package's words in it."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, Path(__file__).parent]), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters.update(
        percent=words.percent, points=percentage_points, number=number, seconds=seconds,
        cells="{} cells".format,
    )  # fmt: skip
    environment.globals.update(rows=sys.modules[__name__], words=words, dash=words.NO_VALUE)
    return environment.get_template(name)
