"""Granule materials: size, density, terminal velocity and rebound, each with its source and how far to trust it.

The data are in materials.toml, with the words for ``confidence`` at its head. What one granule has and another has
not is a standard deviation from granule to granule; a fraction draws for each of its own (scene/fraction.py).

The data are in uncertainties.toml, with the words for them at its head.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..core.errors import SceneError
from ..core.registry import Registry, did_you_mean
from .restitution import Restitution

SPREAD = ("restitution", "friction", "terminal_velocity")  # quantities with a mean and a standard deviation
PARTS = (*SPREAD, "rebound_scatter", "tangential_restitution", "impact")  # quantities with evidence of their own
CONFIDENCES = ("measured", "typical", "low")
LARGEST = {  # in SI units: beyond is a wrong unit
    "diameter": 0.1, "density": 3e4, "terminal_velocity": 100.0, "restitution": 1.0, "friction": 10.0,
    "rebound_scatter": 1.0, "tangential_restitution": 1.0,
}  # fmt: skip


@dataclass(frozen=True)
class Evidence:
    """How far to trust a number: ``confidence`` measured, typical or low, its ``source``, and the half of its 95 %
    interval where the material says it itself.
    """

    confidence: str
    source: str
    uncertainty: float | None = None


@dataclass(frozen=True)
class Moisture:
    """What was measured at the driest and at the wettest ``share`` of water (of the whole mass): the terminal velocity
    (m/s), and of what else was measured at both the friction.
    """

    share: tuple[float, float]
    terminal_velocity: tuple[float, float]
    source: str
    friction: tuple[float, float] | None = None

    @property
    def middle(self) -> float:
        """Share of water half way between both."""
        return 0.5 * (self.share[0] + self.share[1])

    def factor(self, quantity: str, share: float) -> float:
        """The factor on a ``quantity`` from the middle share of water to ``share``, linear; 1 where it was not
        measured.
        """
        ends: tuple[float, float] | None = getattr(self, quantity)
        if ends is None:
            return 1.0
        slope = (ends[1] - ends[0]) / (self.share[1] - self.share[0])
        return 1.0 + slope * (share - self.middle) / (0.5 * (ends[0] + ends[1]))


@dataclass(frozen=True)
class Material:
    """Properties of one granule material against steel, in SI units; ``terminal_velocity`` in air at 20 C.

    ``restitution_std``, ``friction_std`` and ``terminal_velocity_std``: from granule to granule.
    """

    diameter: float  # m, volume-equivalent
    density: float  # kg/m3, of the particle itself, not bulk
    terminal_velocity: float | None  # m/s; None: a sphere, drag from the law
    restitution: float | Restitution  # normal, against steel; a scene may give a law of the approach speed
    friction: float  # sliding, against steel
    confidence: str  # of size and terminal velocity
    source: str
    restitution_std: float = 0.0
    friction_std: float = 0.0
    terminal_velocity_std: float = 0.0  # m/s
    rebound_scatter: float = 0.0  # rad, rms angle by which its shape turns the wall's normal at an impact
    tangential_restitution: float = 0.0  # of a contact that sticks
    impact: str = "paper"  # name of its impact model: how a blow turns it
    dimensions: tuple[float, ...] | None = None  # m, length, width, thickness; None: a ball
    evidence: Mapping[str, Evidence] = field(default_factory=dict)  # of each of the quantities, by name
    moisture: Moisture | None = None  # what water does to it, where that was measured

    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))


materials: Registry[Material] = Registry("material")


def read_material(name: str, table: Mapping[str, Any], where: str) -> Material:
    """The material called ``name``, of a ``table`` as in materials.toml; ``where``: the file, for messages.

    Raises SceneError, one line: what is missing, unknown, or no value of its kind.
    """
    at = f"{where}: {name}"
    own = {key: value for key, value in table.items() if not isinstance(value, Mapping)}
    parts = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    _same_keys(at, own, ("diameter", "density", "confidence", "source"), ())
    _same_keys(at, parts, ("restitution", "friction", "impact"), (*PARTS, "dimensions", "moisture"))
    _words(at, own)
    found: dict[str, Any] = {"terminal_velocity": None, **own}
    for key in ("diameter", "density"):
        found[key] = _number(f"{at}.{key}", own[key], 0.0, LARGEST[key])
    moisture = parts.pop("moisture", None)
    sizes = parts.pop("dimensions", None)
    for key, part in parts.items():
        place = f"{at}.{key}"
        value = "model" if key == "impact" else "value"
        own_margin = () if key == "impact" else ("uncertainty",)
        _same_keys(place, part, (value, *(("std",) if key in SPREAD else ()), "confidence", "source"), own_margin)
        _words(place, part)
        found[key] = part[value] if key == "impact" else _number(place, part[value], 0.0, LARGEST[key])
        if key in SPREAD:
            found[f"{key}_std"] = _number(f"{place}.std", part["std"], 0.0, LARGEST[key])
    evidence = {
        key: Evidence(part["confidence"], part["source"], _margin(f"{at}.{key}", part)) for key, part in parts.items()
    }
    if sizes is not None:
        found["dimensions"], evidence["dimensions"] = _dimensions(f"{at}.dimensions", sizes)
    wet = None if moisture is None else _moisture(f"{at}.moisture", moisture)
    return Material(**found, evidence=evidence, moisture=wet)


def _margin(at: str, part: Mapping[str, Any]) -> float | None:
    """Half of the 95 % interval that a material gives of its own number; None where it gives none."""
    given = part.get("uncertainty")
    return None if given is None else _number(f"{at}.uncertainty", given, 0.0, 100.0)


def _dimensions(at: str, table: Mapping[str, Any]) -> tuple[tuple[float, ...], Evidence]:
    _same_keys(at, table, ("value", "confidence", "source"), ())
    _words(at, table)
    if not isinstance(table["value"], list) or len(table["value"]) != 3:
        raise SceneError(f"{at}.value = {table['value']!r}: give length, width and thickness")
    sides = tuple(_number(at, side, 1e-9, LARGEST["diameter"]) for side in table["value"])
    return sides, Evidence(table["confidence"], table["source"])


def _moisture(at: str, table: Mapping[str, Any]) -> Moisture:
    _same_keys(at, table, ("share", "terminal_velocity", "source"), ("friction",))
    ends: dict[str, tuple[float, float]] = {}
    for key in [one for one in ("share", "terminal_velocity", "friction") if one in table]:
        most = LARGEST.get(key, 1.0)
        if not isinstance(table[key], list) or len(table[key]) != 2:
            raise SceneError(f"{at}.{key} = {table[key]!r}: give two numbers, at the driest and at the wettest")
        low, high = (_number(f"{at}.{key}", one, 0.0, most) for one in table[key])
        ends[key] = low, high
    return Moisture(**ends, source=str(table["source"]))


def _same_keys(at: str, table: Mapping[str, Any], needed: Sequence[str], allowed: Sequence[str]) -> None:
    """Raise SceneError where a table lacks a key that is needed, or has one that is not allowed."""
    if missing := [key for key in needed if key not in table]:
        raise SceneError(f"{at}: lacks {', '.join(missing)}")
    known = [*needed, *(key for key in allowed if key not in needed)]
    if unknown := [key for key in table if key not in known]:
        raise SceneError(f"{at}.{unknown[0]}: unknown{did_you_mean(unknown[0], known)} (known: {', '.join(known)})")


def _words(at: str, table: Mapping[str, Any]) -> None:
    if table["confidence"] not in CONFIDENCES:
        raise SceneError(f"{at}.confidence = {table['confidence']!r}: write {', '.join(CONFIDENCES)}")
    if not isinstance(table["source"], str) or not table["source"]:
        raise SceneError(f"{at}.source: say where the number is from")


def _number(at: str, value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise SceneError(f"{at} = {value!r}: needs a number in SI units from {low:g} to {high:g}")
    return float(value)


def _shipped() -> None:
    file = Path(__file__).with_name("materials.toml")
    for name, table in tomllib.loads(file.read_text(encoding="utf-8")).items():
        materials.add(name, read_material(name, table, file.name))


_shipped()


# -- How far an input may be off where nobody says it ------------------------------------------------------------------
STATUSES = ("read", "derived", "chosen")
MARGIN_CONFIDENCES = ("measured", "typical", "low", "given", "all")


@dataclass(frozen=True)
class DefaultMargin:
    """Half of a 95 % interval of one quantity: ``relative`` to the number, ``absolute`` in its unit, by confidence, or
    ``in_widths`` of the first body.
    """

    relative: Mapping[str, float]
    absolute: Mapping[str, float]
    in_widths: float | None
    source: str
    status: str

    def half(self, value: float, confidence: str, width: float) -> float:
        """Half of the interval in the quantity's unit: of a ``value`` known with a ``confidence``, in a scene whose
        first body is ``width`` (m) wide.
        """
        if self.in_widths is not None:
            return self.in_widths * width
        table, scale = (self.relative, abs(value)) if self.relative else (self.absolute, 1.0)
        return scale * table.get("all", table.get(confidence, 0.0))


@cache
def default_margins() -> Mapping[str, DefaultMargin]:
    """Every entry of uncertainties.toml by its name."""
    text = (Path(__file__).parent / "uncertainties.toml").read_text(encoding="utf-8")
    return {name: _entry(name, table) for name, table in tomllib.loads(text).items()}


def _entry(name: str, table: dict[str, Any]) -> DefaultMargin:
    ways = [table[key] for key in ("relative", "absolute", "absolute_in_widths") if key in table]
    named = all(set(way) <= set(MARGIN_CONFIDENCES) for way in ways if isinstance(way, dict))
    if len(ways) != 1 or not named or table.get("status") not in STATUSES or not table.get("source"):
        raise SceneError(f"uncertainties.toml: {name}: breaks the rules at the head of the file")
    return DefaultMargin(
        table.get("relative", {}), table.get("absolute", {}), table.get("absolute_in_widths"), table["source"],
        table["status"],
    )  # fmt: skip
