"""What was asked, as the page tells it: the machine in the user's units, the materials with their sources, the scene
with its defaults, and what is known of the rung.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...core.quantities import say, speaking
from ...laws.material import materials
from ...laws.restitution import Restitution
from ...laws.uncertainties import default_margins
from ...results.result import Request
from ...scene import Fraction, Scene
from ...scene.changes import flat
from ...scene.messages import unit_of
from ..sketch import UNITS

__all__ = [
    "MaterialRow", "Proof", "input_text", "machine_rows", "material_rows", "proofs_of", "scene_in_full", "source_of",
]  # fmt: skip

ELSEWHERE = ("fraction", "numerics", "picture", "uncertainty", "force")  # tables that the page tells in other places
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
OWN = {"diameter": "size"}  # keys of a scene whose name differs from the material's
FEW = 3  # of a list: more entries are counted, not told
MM_BELOW = 1e-3  # m: smaller lengths are told in micrometres


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


def input_text(key: str, value: Any) -> str:
    """A value of a key of the scene with its unit, as machines are told of."""
    with speaking(UNITS):
        return _said(key, value)


def _said(key: str, value: Any) -> str:
    unit = unit_of(key)
    if isinstance(value, list) and (len(value) > FEW or any(isinstance(one, list) for one in value)):
        return f"{len(value)} values"
    if isinstance(value, list):
        return f"({', '.join(_said(key, one) for one in value)})"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return say(value, unit) if unit else f"{value:.6g}"


def material_rows(scene: Scene) -> list[MaterialRow]:
    """Every property of every fraction that the answer rests on."""
    with speaking(UNITS):
        return [row for name, fraction in scene.fraction.items() for row in _material(name, fraction)]


def _material(name: str, fraction: Fraction) -> Iterator[MaterialRow]:
    own = fraction.properties
    for key, (quantity, unit) in QUANTITIES.items():
        value = getattr(own, key)
        if value is None or (value == 0.0 and key.startswith(("rebound", "tangential"))):
            continue
        text = str(value) if isinstance(value, str) else _law(value) if isinstance(value, Restitution) else ""
        yield MaterialRow(name, quantity, text or _length(float(value), unit), *_evidence(fraction, key))


def _law(value: Restitution) -> str:
    return ", ".join(f"{key} {part:g}" if isinstance(part, float) else f"{part}" for key, part in vars(value).items())


def _length(value: float, unit: str) -> str:
    small = unit == "m" and value < MM_BELOW
    return f"{1e6 * value:.4g} µm" if small else say(value, unit, 4).replace("^3", "³")


def _evidence(fraction: Fraction, key: str) -> tuple[str, str]:
    """How far to trust a property of a fraction, and where it is from."""
    if fraction.material is None or getattr(fraction, OWN.get(key, key)) is not None:
        return "given", "the scene"
    material = materials[fraction.material]
    found = material.evidence.get(key)
    told = (material.confidence, material.source) if found is None else (found.confidence, found.source)
    return told[0], f"{fraction.material}: {told[1]}"


def source_of(key: str, why: str) -> str:
    """What the interval of the number at ``key`` of a scene rests on: the scene, a measurement, or a default with its
    source.
    """
    if not why.startswith("default"):
        return why
    entry = key.rpartition(".")[2] if key.startswith("fraction.") else key.replace(".", "_")
    margin = default_margins().get(entry)
    return why if margin is None else f"{why}: {margin.source}"


def scene_in_full(scene: Scene, asked: Request | None = None) -> str:
    """The scene as TOML in SI units with every default that was used, and what was ``asked`` beside it, as --rung or
    --force; loading it gives a scene that computes the same.
    """
    import tomlkit

    tables = json.loads(scene.model_dump_json(exclude_none=True, by_alias=True))
    if asked is not None:
        beside = {"rung": asked.rung, "target_error": asked.target_error}
        tables["numerics"].update({key: value for key, value in beside.items() if value is not None})
        tables["force"] = {**tables.get("force", {}), **asked.force}
    return tomlkit.dumps(_rounded(tables))


def _rounded(value: Any) -> Any:
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
