"""Axes of a sweep, and which combinations of their values it computes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.errors import SceneError
from ..core.quantities import converted, split_quantity
from ..core.record import JsonMapping, JsonTable
from ..core.registry import Registry
from ..scene.messages import unit_of
from ..scene.overrides import changes_of, setting

# -- An axis of a sweep ------------------------------------------------------------------------------------------------
MAX_SCENES = 20_000  # of a sweep: planning these takes minutes, and a table of more is read by nobody
DIGITS = 12  # of a value between two ends: 0.3, not 0.30000000000000004
ALIKE = 1e-9  # relative: numbers that differ by less are one, written in two units
SWITCHES = {"on": True, "off": False}
SCALES = ("linear", "log")
HOW = "write values a,b,c or a range start:stop:count, as in air.speed=3:5:3 or feed.width='20 mm:40 mm:5'"


@dataclass(frozen=True)
class Axis:
    """``key`` of a scene and its ``values``, as a scene file would have them.

    Keys that are tied, "a = b = -c", have one value, those after a minus its negative. A range has two ``ends`` and
    a ``unit`` too: a design that draws from it takes any number between them, by their logarithms where ``log``.
    """

    key: str
    values: tuple[Any, ...]
    ends: tuple[float, ...] = ()
    unit: str = ""
    log: bool = False

    @property
    def keys(self) -> list[str]:
        """The key, or those that are tied."""
        return [key.removeprefix("-") for key in self._tied]

    def changes(self, value: object) -> JsonTable:
        """What a ``value`` changes of a scene, by key."""
        return {key.removeprefix("-"): _negative(value) if key.startswith("-") else value for key in self._tied}

    @property
    def _tied(self) -> list[str]:
        return [key.strip() for key in self.key.split("=")]

    def at(self, place: float) -> Any:
        """The value at a ``place`` from 0 to 1 of a range; of listed values the one in whose equal part it lies."""
        if not self.ends:
            return self.values[min(int(place * len(self.values)), len(self.values) - 1)]
        low, high = self.ends
        number = low * (high / low) ** place if self.log else low + (high - low) * place
        rounded = float(f"{number:.{DIGITS}g}")
        return f"{rounded!r} {self.unit}" if self.unit else rounded

    def where(self, tables: Mapping[str, object]) -> float:
        """The place, from 0 to 1, of the value that a scene's flat ``tables`` (SI) hold; nan where it lies outside or
        among no listed ones, or where tied keys differ.
        """
        key = self.keys[0]
        if any(tables.get(tied) is None for tied in self.keys):
            return math.nan
        if not self.ends:
            held = (i for i, value in enumerate(self.values) if self._held(value, tables))
            return (next(held, math.nan) + 0.5) / len(self.values)
        try:
            low, high = (_si(end, self.unit, key) for end in self.ends)
        except ValueError:  # a unit of another kind: each design will say so
            return math.nan
        now = tables[key]
        if isinstance(now, bool) or not isinstance(now, int | float):
            return math.nan
        now = -now if self._tied[0].startswith("-") else now
        place = math.log(now / low) / math.log(high / low) if self.log and now > 0.0 else (now - low) / (high - low)
        inside = 0.0 <= place <= 1.0
        return place if inside and self._held(self.at(place), tables, ALIKE * abs(high - low)) else math.nan

    def _held(self, value: Any, tables: JsonMapping, within: float = 0.0) -> bool:
        """Whether the flat ``tables`` hold what a ``value`` makes of a scene, numbers to ``within``."""
        for key, wanted in self.changes(value).items():
            parts = split_quantity(wanted) if isinstance(wanted, str) else None
            plain = SWITCHES.get(wanted, wanted) if isinstance(wanted, str) else wanted
            try:
                number = _si(*parts, key) if parts else plain
            except ValueError:
                return False
            given = tables[key]
            if isinstance(given, int | float) and isinstance(number, int | float) and not isinstance(given, bool):
                if not math.isclose(given, number, rel_tol=ALIKE, abs_tol=within):
                    return False
            elif given != number:
                return False
        return True


def _si(number: float, unit: str, key: str) -> float:
    """A number of ``unit`` as the scene holds that of ``key``. Raises ValueError for a unit of another kind."""
    return converted(number, unit, unit_of(key) or "1") if unit else number


def _negative(value: object) -> object:
    """A number, or a quantity as in "5 mm", times -1."""
    if isinstance(value, str):
        return value[1:] if value.startswith("-") else f"-{value}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SceneError(f"{value!r} has no negative: a key after a minus takes numbers")
    return -value


def axis_of_text(text: str, option: str = "--set") -> Axis:
    """The axis KEY=VALUES of an ``option``: values with commas between them, or start:stop:count; a unit may follow,
    that of all numbers before it.

    >>> axis_of_text("air.speed=3:5:3 m/s").values
    ('3.0 m/s', '4.0 m/s', '5.0 m/s')
    >>> axis_of_text("air.speed=20,40 km/h").values
    ('20 km/h', '40 km/h')
    >>> axis_of_text("fraction.chaff.restitution=0.2,0.4").values
    (0.2, 0.4)

    Raises SceneError for any other text.
    """
    key, given = setting(text, option, "KEY=VALUES")
    low, high, *counts = [split_quantity(part) for part in given.split(":")] + [None] * 2
    if low and high and len(counts) == 3:
        if counts[0] is None or not counts[0][0].is_integer():
            raise SceneError(f"{option} {text!r}: the count, behind the second colon, is a whole number; {HOW}")
        count, unit = counts[0]
        last = unit or high[1] or low[1]
        if any(written and written != last for written in (low[1], high[1])):
            raise SceneError(f"{option} {text!r}: both ends in one unit, please")
        return _range(key, low[0], high[0], int(count), last)
    pieces = _in_units(f"{option} {text!r}", _pieces(given))
    return Axis(key, tuple(changes_of([f"{key}={piece}"])[key] for piece in pieces))


def _in_units(where: str, pieces: Sequence[str]) -> list[str]:
    """The values of a list, numbers alone with the unit that follows the last of them. Raises SceneError where units
    are behind others but not behind all.
    """
    parts = [split_quantity(piece) for piece in pieces]
    units = [part[1] for part in parts if part is not None]
    if len(units) < len(pieces) or not any(units) or all(units):
        return list(pieces)
    if any(units[:-1]):
        raise SceneError(f"{where}: write the unit once, behind the last value, or behind each value")
    return [*(f"{piece} {units[-1]}" for piece in pieces[:-1]), pieces[-1]]


def _pieces(text: str) -> list[str]:
    """The text cut at commas outside of brackets and quotes."""
    pieces, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "[{":
            depth += 1
        elif letter in "]}":
            depth -= 1
        if letter == "," and not depth and not quote:
            pieces.append("")
        else:
            pieces[-1] += letter
    return [piece.strip() for piece in pieces]


def axes_of(table: Mapping[str, object], where: str) -> list[Axis]:
    """The axes of a TOML table: dotted keys, each a list of values or { from, to, count, scale = "log" }.

    Raises SceneError, naming ``where`` and the key, for anything else.
    """
    return list(_axes(table, where, ()))


def _axes(table: Mapping[str, object], where: str, above: tuple[str, ...]) -> Sequence[Axis]:
    axes: list[Axis] = []
    for name, value in table.items():
        if not isinstance(name, str):
            raise SceneError(f"{where}: {name!r}: name a key of the scene")
        key = ".".join((*above, name))
        if isinstance(value, tuple | range | np.ndarray):
            value = list(value)
        if isinstance(value, list):
            if not value:
                raise SceneError(f"{where}: {key} = []: give at least one value")
            axes.append(Axis(key, tuple(value)))
        elif not isinstance(value, Mapping):
            axes.append(Axis(key, (value,)))
        elif {"from", "to"} <= set(value) and not isinstance(value["from"], list | Mapping):
            axes.append(_table_range(key, value, where))
        else:
            axes += _axes(value, where, (*above, name))
    return axes


def _table_range(key: str, table: Mapping[str, object], where: str) -> Axis:
    unknown = set(table) - {"from", "to", "count", "scale"}
    if unknown:
        raise SceneError(f"{where}: {key}.{unknown.pop()}: unknown key (known: from, to, count, scale)")
    scale, count = table.get("scale", "linear"), table.get("count", 2)
    if scale not in SCALES:
        raise SceneError(f"{where}: {key}.scale = {scale!r}: choose linear or log")
    if not isinstance(count, int) or isinstance(count, bool):
        raise SceneError(f"{where}: {key}.count = {count!r}: give a whole number")
    (low, low_unit), (high, unit) = (_quantity(f"{where}: {key}.{end}", table[end]) for end in ("from", "to"))
    if low_unit != unit:
        raise SceneError(f"{where}: {key}: both ends in one unit, please")
    return _range(key, low, high, count, unit, log=scale == "log")


def _quantity(where: str, value: object) -> tuple[float, str]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    parts = split_quantity(value) if isinstance(value, str) else None
    if parts is None:
        raise SceneError(f"{where} = {value!r}: give a number, or one with a unit such as '5 m/s'")
    return parts


def _range(key: str, low: float, high: float, count: int, unit: str, *, log: bool = False) -> Axis:
    """``count`` values from ``low`` to ``high``, both taken. Raises SceneError where there is no such range."""
    if count < 2 or not math.isfinite(low) or not math.isfinite(high) or low == high:
        raise SceneError(f"{key} = {low:g}:{high:g}:{count}: needs two different ends and a count of at least 2; {HOW}")
    if count > MAX_SCENES:
        raise SceneError(f"{key} = {low:g}:{high:g}:{count}: a sweep has {MAX_SCENES} scenes at most")
    if log and min(low, high) <= 0:
        raise SceneError(f"{key}: a range on scale log needs ends above 0")
    axis = Axis(key, (), (low, high), unit, log)
    values = tuple(axis.at(place) for place in np.linspace(0.0, 1.0, count).tolist())
    return Axis(key, values, (low, high), unit, log)


# -- Designs -----------------------------------------------------------------------------------------------------------
Changes = JsonTable  # dotted key to value
# (axes, count of scenes or 0, seed) to the changes of every scene
Design = Callable[[Sequence[Axis], int, int], list[Changes]]
designs: Registry[Design] = Registry("design of a sweep")


@designs.register("grid")
def full_grid(axes: Sequence[Axis], count: int, seed: int) -> list[Changes]:
    """Every combination; the last axis changes fastest."""
    del seed
    _no_count("grid", count)
    _few_enough(math.prod(len(axis.values) for axis in axes))
    return [_changes(axes, row) for row in itertools.product(*(axis.values for axis in axes))]


@designs.register("list")
def listed(axes: Sequence[Axis], count: int, seed: int) -> list[Changes]:
    """The first value of every axis, then the second of every axis: rows of a table."""
    del seed
    _no_count("list", count)
    lengths = {axis.key: len(axis.values) for axis in axes}
    _few_enough(max(lengths.values(), default=0))
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise SceneError(f'design = "list": every key needs as many values as the others ({counts})')
    return [_changes(axes, row) for row in zip(*(axis.values for axis in axes), strict=True)]


@designs.register("one-at-a-time")
def one_at_a_time(axes: Sequence[Axis], count: int, seed: int) -> list[Changes]:
    """The scene as it is, then every key alone at each of its values."""
    del seed
    _no_count("one-at-a-time", count)
    _few_enough(1 + sum(len(axis.values) for axis in axes))
    return [{}, *(axis.changes(value) for axis in axes for value in axis.values)]


@designs.register("latin-hypercube")
def latin_hypercube(axes: Sequence[Axis], count: int, seed: int) -> list[Changes]:
    """``count`` scenes, one in each of ``count`` equal parts of every range: McKay, Beckman & Conover 1979,
    Technometrics 21, 239.
    """
    from scipy.stats import qmc

    if count < 2:
        raise SceneError('design = "latin-hypercube": give count, the number of scenes, at least 2')
    _few_enough(count)
    return _drawn(axes, qmc.LatinHypercube(len(axes), rng=seed).random(count))


@designs.register("sobol")
def sobol(axes: Sequence[Axis], count: int, seed: int) -> list[Changes]:
    """``count`` scenes of a scrambled Sobol' sequence, which is balanced for powers of two: Owen 1998, J. Complexity
    14, 466.
    """
    from scipy.stats import qmc

    if count < 2 or count & (count - 1):
        raise SceneError('design = "sobol": give count, the number of scenes, as a power of two (8, 16, 32 ...)')
    _few_enough(count)
    return _drawn(axes, qmc.Sobol(len(axes), scramble=True, rng=seed).random(count))


def _drawn(axes: Sequence[Axis], places: Any) -> list[Changes]:
    return [changes_at(axes, row) for row in places.tolist()]


def changes_at(axes: Sequence[Axis], places: Sequence[float]) -> Changes:
    """What a scene at a place from 0 to 1 along each axis changes."""
    return _changes(axes, [axis.at(place) for axis, place in zip(axes, places, strict=True)])


def _changes(axes: Sequence[Axis], row: Sequence[object]) -> Changes:
    return {key: changed for axis, value in zip(axes, row, strict=True) for key, changed in axis.changes(value).items()}


def _few_enough(scenes: int) -> None:
    if scenes > MAX_SCENES:
        raise SceneError(f"a sweep of {scenes} scenes: {MAX_SCENES} at most; give fewer values, or draw a --count")


def _no_count(design: str, count: int) -> None:
    if count:
        raise SceneError(f'design = "{design}" takes its scenes from the values; leave count out')
