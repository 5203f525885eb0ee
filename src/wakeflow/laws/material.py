"""Granule materials: size, density, terminal velocity and rebound, each with its source and how far to trust it.

The data are in materials.toml, with the words for ``confidence`` at its head. What one granule has and another has
not is a standard deviation from granule to granule; a fraction draws for each of its own (scene/fraction.py).

The data are in uncertainties.toml, with the words for them at its head.
"""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..core.errors import SceneError
from ..core.files import atomic_write
from ..core.quantities import quantity
from ..core.registry import Registry, did_you_mean
from .restitution import Restitution

SPREAD = ("restitution", "friction", "terminal_velocity")  # quantities with a mean and a standard deviation
PARTS = (*SPREAD, "rebound_scatter", "tangential_restitution", "impact")  # quantities with evidence of their own
WET = ("diameter", "density", "terminal_velocity", "friction")  # quantities that may be known by moisture
CONFIDENCES = ("measured", "typical", "low")
MISSPELT = 0.75  # likeness of two words from which on one is the other misspelt; chosen
AS = re.compile(r"(?:^|, )as ([a-z ]+)(?:,|$)")  # in a source: the number is another material's
SIZES = ("diameter", "density")  # numbers, or tables with evidence of their own
NEEDED = ("restitution", "friction", "impact")
KNOWN = (*SIZES, *PARTS, "dimensions", "moisture")
QUANTITIES = {  # unit, largest number in it (beyond is a wrong unit), and how one is written with a unit
    "diameter": ("m", 0.1, "2.4 mm"), "density": ("kg/m^3", 3e4, "1.3 g/cm^3"),
    "terminal_velocity": ("m/s", 100.0, "7.8 m/s"), "restitution": ("1", 1.0, "50 %"), "friction": ("1", 10.0, "30 %"),
    "rebound_scatter": ("rad", 1.0, "9 deg"), "tangential_restitution": ("1", 1.0, "30 %"), "share": ("1", 1.0, "14 %"),
}  # fmt: skip


@dataclass(frozen=True)
class Evidence:
    """How far to trust a number: ``confidence`` measured, typical or low, its ``source``, and the half of its 95 %
    interval where the material says it itself.
    """

    confidence: str
    source: str
    uncertainty: float = math.nan


@dataclass(frozen=True)
class Moisture:
    """What was measured at the driest and at the wettest ``share`` of water (of the whole mass): the ``ends`` of each
    of the quantities of WET that were measured at both, in SI units.
    """

    share: tuple[float, float]
    source: str
    ends: Mapping[str, tuple[float, float]]

    @property
    def middle(self) -> float:
        """Share of water half way between both."""
        return 0.5 * (self.share[0] + self.share[1])

    def factor(self, quantity: str, share: float) -> float:
        """The factor on a ``quantity`` from the middle share of water to ``share``, linear; 1 where it was not
        measured.
        """
        if quantity not in self.ends:
            return 1.0
        ends = self.ends[quantity]
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
    confidence: str  # of what has no evidence of its own
    source: str
    restitution_std: float = 0.0
    friction_std: float = 0.0
    terminal_velocity_std: float = 0.0  # m/s
    rebound_scatter: float = 0.0  # rad, rms angle by which its shape turns the wall's normal at an impact
    tangential_restitution: float = 0.0  # of a contact that sticks
    impact: str = "paper"  # name of its impact model: how a blow turns it
    dimensions: tuple[float, ...] = ()  # m, length, width, thickness; none of a ball
    evidence: Mapping[str, Evidence] = field(default_factory=dict)  # of each of the quantities, by name
    moisture: Moisture | None = None  # what water does to it, where that was measured
    also: tuple[str, ...] = ()  # other names, and names of what is nearest to it

    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))

    def half_of(self, quantity: str, usual: float = math.nan) -> float:
        """Half of the 95 % interval of a quantity's mean where it says that itself, else the ``usual``."""
        half = self.evidence[quantity].uncertainty if quantity in self.evidence else math.nan
        return usual if math.isnan(half) else half

    def confidence_in(self, quantity: str) -> str:
        """How well one of its numbers is known."""
        return self.evidence[quantity].confidence if quantity in self.evidence else self.confidence

    def like(self, quantity: str) -> str:
        """The material whose number of a quantity this one has, as its source says: "as wheat"; empty: its own."""
        names = AS.findall(self.evidence[quantity].source) if quantity in self.evidence else ()
        return next((name for word in names if (name := word.replace(" ", "-")) in materials), "")

    def at_moisture(self, share: float) -> Material:
        """The material with a ``share`` of water (of its whole mass), as it was measured between its driest and its
        wettest.

        Raises SceneError where that was not measured, or not so dry or so wet.
        """
        wet = self.moisture
        if wet is None:
            have = ", ".join(name for name in materials if materials[name].moisture is not None)
            raise SceneError(f"no data say what water does to this material (there are some of {have})")
        low, high = wet.share
        if not low <= share <= high:
            raise SceneError(f"measured from {100 * low:g} % to {100 * high:g} % of water")
        moved = {
            key: wet.factor(name, share) * getattr(self, key)
            for name in wet.ends
            for key in ((name, f"{name}_std") if name in SPREAD else (name,))
            if getattr(self, key) is not None
        }
        return replace(self, **moved)


def near_material(name: object, known: Sequence[str]) -> str:
    """A hint where a known name is that of the same substance misspelt, or where one says itself that it is the nearest
    (``also``), else an empty string: broken rice is no broken wheat. Every word of the name must be alike.
    """
    for material in known:
        if _misspelt(str(name), material):
            return f"; did you mean {material!r}?"
    for material in known:
        if material in materials and any(_misspelt(str(name), word) for word in materials[material].also):
            return f"; the nearest is {material!r}"
    return ""


def _misspelt(name: str, other: str) -> bool:
    words, parts = re.split("[-_ ]+", name.lower().strip()), other.split("-")
    if len(words) != len(parts):
        return "".join(words) == "".join(parts)
    return all(SequenceMatcher(None, a, b).ratio() >= MISSPELT for a, b in zip(words, parts, strict=True))


class Materials(Registry[Material]):
    """The registry of materials, whose hints never offer another substance."""

    def __getitem__(self, name: str) -> Material:
        """The material called ``name``. Raises SceneError where there is none."""
        if name not in self:
            hint = near_material(name, list(self))
            raise SceneError(f"unknown material {name!r}{hint} (known: {', '.join(self)}; your own: docs/scenes.md)")
        return super().__getitem__(name)


materials: Registry[Material] = Materials("material")


def read_material(name: str, table: Mapping[str, Any], where: str) -> Material:
    """The material called ``name``, of a ``table`` as in materials.toml; ``where``: the file, for messages.

    Numbers are SI, or texts with a unit. Size and density may be tables with evidence of their own. Raises SceneError,
    one line: all that is missing or unknown, or the first that is no value of its kind.
    """
    at = f"{where}: {name}"
    if problems := [*_not_there(table), *_not_known(table)]:
        raise SceneError(f"{at}: {'; '.join(problems)} (wakeflow materials --new shows a whole one)")
    parts = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    _words(at, table)
    values: dict[str, Any] = {"terminal_velocity": None, "confidence": table["confidence"], "source": table["source"],
                             "also": tuple(map(str, table.get("also", ())))}  # fmt: skip
    for key in SIZES:
        values[key] = _number(f"{at}.{key}", parts.get(key, {"value": table[key]})["value"], key)
    moisture = parts.pop("moisture", None)
    sizes = parts.pop("dimensions", None)
    for key, part in parts.items():
        place = f"{at}.{key}"
        _words(place, part)
        if key not in SIZES:
            values[key] = part["model"] if key == "impact" else _number(place, part["value"], key)
        if key in SPREAD:
            values[f"{key}_std"] = _number(f"{place}.std", part["std"], key)
    evidence = {
        key: Evidence(part["confidence"], part["source"], _margin(f"{at}.{key}", key, part))
        for key, part in parts.items()
    }
    if sizes is not None:
        values["dimensions"], evidence["dimensions"] = _dimensions(f"{at}.dimensions", sizes)
    wet = None if moisture is None else _moisture(f"{at}.moisture", moisture)
    return Material(**values, evidence=evidence, moisture=wet)


def _keys_of(part: str) -> tuple[str, ...]:
    """The keys that a table of a material needs."""
    if part == "moisture":
        return ("share", "source")
    spread = ("std",) if part in SPREAD else ()
    return ("model" if part == "impact" else "value", *spread, "confidence", "source")


def _not_there(table: Mapping[str, Any]) -> list[str]:
    """What a material's table lacks, in one line of all of it."""
    lacking = [key for key in (*SIZES, "confidence", "source", *NEEDED) if key not in table]
    for part, keys in table.items():
        if isinstance(keys, Mapping) and part in KNOWN:
            lacking += [f"{part}.{key}" for key in _keys_of(part) if key not in keys]
        elif part in KNOWN and part not in SIZES:
            lacking.append(f"[{part}] as a table with {', '.join(_keys_of(part))}")
    return [f"lacks {', '.join(lacking)}"] if lacking else []


def _not_known(table: Mapping[str, Any]) -> list[str]:
    """Mistakes of a material's table: each key that no material has."""
    given: list[tuple[str, str, tuple[str, ...]]] = [
        ("", key, (*KNOWN, "confidence", "source", "also")) for key in table
    ]
    for part, keys in table.items():
        if isinstance(keys, Mapping) and part in KNOWN:
            extra = {"moisture": WET, "impact": ()}.get(part, ("uncertainty",))
            given += [(f"{part}.", key, (*_keys_of(part), *extra)) for key in keys]
    return [
        f"{place}{key}: unknown" + (did_you_mean(key, list(known)) or f" (known: {', '.join(known)})")
        for place, key, known in given
        if key not in known
    ]


def _margin(at: str, key: str, part: Mapping[str, Any]) -> float:
    """Half of the 95 % interval that a material gives of its own number; not a number where it gives none."""
    return _number(f"{at}.uncertainty", part["uncertainty"], key) if "uncertainty" in part else math.nan


def _dimensions(at: str, table: Mapping[str, Any]) -> tuple[tuple[float, ...], Evidence]:
    _words(at, table)
    if not isinstance(table["value"], list) or len(table["value"]) != 3:
        raise SceneError(f"{at}.value = {table['value']!r}: give length, width and thickness")
    sides = tuple(_number(at, side, "diameter") for side in table["value"])
    return sides, Evidence(table["confidence"], table["source"])


def _moisture(at: str, table: Mapping[str, Any]) -> Moisture:
    ends: dict[str, tuple[float, float]] = {}
    for key in [name for name in ("share", *WET) if name in table]:
        if not isinstance(table[key], list) or len(table[key]) != 2:
            raise SceneError(f"{at}.{key} = {table[key]!r}: give two numbers, at the driest and at the wettest")
        low, high = (_number(f"{at}.{key}", end, key) for end in table[key])
        if key == "share" and not low < high:
            raise SceneError(f"{at}.share = {table[key]!r}: give the driest first, then the wettest")
        if key != "share" and min(low, high) <= 0.0:
            raise SceneError(f"{at}.{key} = {table[key]!r}: give two numbers above 0")
        ends[key] = low, high
    share = ends.pop("share")
    if not ends:
        raise SceneError(f"{at}: give what was measured at both shares of water: {', '.join(WET)}")
    return Moisture(share, str(table["source"]), MappingProxyType(ends))


def _words(at: str, table: Mapping[str, Any]) -> None:
    if table["confidence"] not in CONFIDENCES:
        raise SceneError(f"{at}.confidence = {table['confidence']!r}: write {', '.join(CONFIDENCES)}")
    if not isinstance(table["source"], str) or not table["source"]:
        raise SceneError(f"{at}.source: say where the number is from")


def _number(at: str, value: Any, key: str) -> float:
    """A number of a quantity ``key``, in SI units, from itself or from a text with a unit."""
    unit, most, example = QUANTITIES[key]
    if isinstance(value, str):
        try:
            value = quantity(value, unit, example)
        except ValueError as problem:
            raise SceneError(f"{at} = {value!r}: {problem}") from None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= most:
        raise SceneError(f"{at} = {value!r}: needs a number in SI units from 0 to {most:g}, or such as {example!r}")
    return float(value)


def _shipped() -> None:
    file = Path(__file__).with_name("materials.toml")
    for name, table in tomllib.loads(file.read_text(encoding="utf-8")).items():
        materials.add(name, read_material(name, table, file.name))


_shipped()


def write_own_material(path: Path) -> None:
    """Write a commented material to fill in. Raises SceneError where a file stands there."""
    if os.path.lexists(path):
        raise SceneError(f"--new {path}: exists; choose another name")
    with atomic_write(path) as stream:
        stream.write(Path(__file__).with_name("my-material.toml").read_text(encoding="utf-8"))


# -- How far an input may be off where nobody says it ------------------------------------------------------------------
STATUSES = ("read", "derived", "chosen")
MARGIN_CONFIDENCES = ("measured", "typical", "low", "given", "all")


@dataclass(frozen=True)
class DefaultMargin:
    """Half of a 95 % interval of one quantity: ``relative`` to the number, ``absolute`` in its unit, by confidence, or
    ``in_widths`` of the first body; ``plate``: what the plate makes of it, measured alike.
    """

    relative: Mapping[str, float]
    absolute: Mapping[str, float]
    in_widths: float
    source: str
    status: str
    plate: float = 0.0

    def half(self, value: float, confidence: str, width: float) -> float:
        """Half of the interval in the quantity's unit: of a ``value`` known with a ``confidence``, in a scene whose
        first body is ``width`` (m) wide.
        """
        if self.in_widths:
            return self.in_widths * width
        table = self.relative or self.absolute
        return self._scale(value) * table.get("all", table.get(confidence, 0.0))

    def of_plate(self, value: float) -> float:
        """What the plate makes of the half of the interval of a ``value``, in the quantity's unit."""
        return self._scale(value) * self.plate

    def _scale(self, value: float) -> float:
        return abs(value) if self.relative else 1.0


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
        table.get("relative", {}), table.get("absolute", {}), table.get("absolute_in_widths", 0.0), table["source"],
        table["status"], table.get("plate", 0.0),
    )  # fmt: skip
