"""The materials file of a calibration: each fraction as it turned out to be, for the next scene."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...core.number import Number
from ...laws.restitution import Restitution
from ...scene import Fraction, Scene
from ...scene.fraction import MAX_COEFFICIENT
from ...scene.rebound import Coefficient

HEAD = """# Granules as measured shares made them known. Put materials = "{file}" at the head of a scene, and
# material = "{example}" into its fraction. The intervals are those of each number alone; how they go together
# is in correlations.csv of the calibration. What is not of a fraction (air, feed, wake) is in inputs.csv.
"""
PREFIX = "measured-"
PARTS = ("terminal_velocity", "restitution", "friction", "rebound_scatter")


def materials_text(scene: Scene, inputs: Mapping[str, Number], source: str) -> str:
    """The file as TOML. ``inputs``: what is known of the numbers of the scene, by key; ``source``: of what."""
    names = list(scene.fraction)
    text = HEAD.format(file="materials.toml", example=PREFIX + names[0])
    return text + "".join(_material(name, scene.fraction[name], inputs, source) for name in names)


def _material(name: str, fraction: Fraction, inputs: Mapping[str, Number], source: str) -> str:
    own = fraction.properties
    known = {part: inputs.get(f"fraction.{name}.{part}") for part in (*PARTS, "density", "size")}
    diameter, density = (known[part] for part in ("size", "density"))
    why = f"calibrated with {source}"
    lines = [
        "", f"[{PREFIX}{name}]", f"diameter = {own.diameter if diameter is None else diameter.value:.6g}",
        f"density = {own.density if density is None else density.value:.6g}", 'confidence = "measured"',
        f"source = {_quoted(why)}",
    ]  # fmt: skip
    for part in PARTS:
        value = getattr(own, part)
        if value is None or isinstance(value, Restitution):
            continue  # a sphere's drag; a law of the speed of approach stays with the scene
        found = known[part]
        table: dict[str, Any] = {"value": float(value) if found is None else found.value}
        if part != "rebound_scatter":
            table["std"] = _std(fraction, part)
        if found is not None:
            table["uncertainty"] = max(found.half, 1e-9)
        lines += _part(f"{PREFIX}{name}.{part}", table, why if found is not None else "as in the scene")
    if isinstance(own.restitution, Restitution):
        lines += _part(f"{PREFIX}{name}.restitution", {"value": float(own.restitution(np.ones(1))[0]), "std": 0.0},
                       "at an approach of 1 m/s; the scene's law is not in this file")  # fmt: skip
    if own.tangential_restitution:
        table = {"value": own.tangential_restitution}
        lines += _part(f"{PREFIX}{name}.tangential_restitution", table, "as in the scene")
    lines += _part(f"{PREFIX}{name}.impact", {"model": fraction.impact_model}, "as in the scene")
    return "\n".join(lines) + "\n"


def _part(head: str, table: Mapping[str, Any], source: str) -> list[str]:
    texts = {key: _quoted(value) if isinstance(value, str) else f"{value:.6g}" for key, value in table.items()}
    rows = [f"{key} = {text}" for key, text in texts.items()]
    return [f"[{head}]", *rows, 'confidence = "measured"', f"source = {_quoted(source)}"]


def _quoted(text: str) -> str:
    """A text as TOML has it, which unlike JSON knows no halves of a letter and no bare DEL."""
    whole = text.encode(errors="replace").decode()
    return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")


def _std(fraction: Fraction, part: str) -> float:
    """How a number differs from granule to granule, as in the scene or its material."""
    given = getattr(fraction, part)
    if isinstance(given, Coefficient):
        p = np.array([0.158655, 0.841345])
        low, high = given.quantile(p, MAX_COEFFICIENT.get(part, np.inf))
        return float(high - low) / 2
    return 0.0 if given is not None else float(getattr(fraction.spread_material, f"{part}_std"))
