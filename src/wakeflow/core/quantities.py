"""Numbers with a unit: read from text without guessing, and said in the unit that the user writes.

pint knows the units. It does not read the numbers: to it "1,5" is 15, "1 500" is 500, and a turn is 6.28 with no unit,
so that 1800 rpm would be 188 Hz.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from tokenize import TokenError
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pint import Unit


NUMBER = r"[-+\u2212]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+\u2212]?[0-9]+)?"  # U+2212: a typographer's minus
UNIT = r"(?:1/)?[^\s\d.,;'\u2019_+*\u2212-].*"  # whatever could go on a number is none
QUANTITY = rf"^\s*{NUMBER}\s*{UNIT}$"  # as a JSON schema says it
_PARTS = re.compile(rf"\s*({NUMBER})\s*({UNIT}?)?\s*")
_GRAD = re.compile(r"\bgrad\b", re.IGNORECASE)  # to pint a gradian, in German a degree
_MARKED = re.compile(r"(?<=[0-9])[ ,'\u2019_](?=[0-9])")
PER_TONNE = {"t": 1.0, "kg": 1e3, "dt": 10.0}  # of prices, which pint does not know
PER_KWH = {"EUR/kWh": 1.0, "€/kWh": 1.0, "ct/kWh": 1e-2, "EUR/MWh": 1e-3, "€/MWh": 1e-3}
# What pint multiplies by, of the units that most scenes are written in: it takes longer to load than a plan to make
FACTORS = {
    ("mm", "m"): 1e-3, ("m", "mm"): 1e3,
    ("um", "m"): 1e-6, ("m", "um"): 1e6,
    ("deg", "rad"): math.pi / 180, ("rad", "deg"): 180 / math.pi,
    ("kg/hour", "kg/s"): 1 / 3600, ("kg/s", "kg/hour"): 3600.0, ("kg/s", "kg/h"): 3600.0,
    ("g", "kg"): 1e-3, ("kg", "g"): 1e3,
    ("%", "1"): 1e-2, ("1", "%"): 1e2,
    **{(f"{coin}/{per}", "EUR/t"): factor for coin in ("EUR", "€") for per, factor in PER_TONNE.items()},
    **{("EUR/t", f"{coin}/{per}"): 1 / factor for coin in ("EUR", "€") for per, factor in PER_TONNE.items()},
    **{(unit, "EUR/kWh"): factor for unit, factor in PER_KWH.items()},
    **{("EUR/kWh", unit): 1 / factor for unit, factor in PER_KWH.items()},
}  # fmt: skip
LENGTHS = ("m", "mm", "um")
DEGREES = {"C": "degC", "F": "degF"}  # of temperature: to pint a coulomb and a farad
NO_UNIT = re.compile(r"[^\w\s/*^().%‰°·⋅×⁻+-]")
TWO_MEANINGS = {  # units that are one thing here and another there: what each may be, and how that is written
    "ton": "1000 kg (t) or 907 kg (short_ton)", "hundredweight": "50.8 kg or 45.4 kg (write kg)",
    "cwt": "50.8 kg or 45.4 kg (write kg)", "gallon": "4.55 l or 3.79 l (write l)", "gal": "4.55 l or 3.79 l (write l)",
    "mil": "a thousandth of an inch (thou) or of a metre (mm)", "kt": "a knot (knot) or 1000 t",
    "mile": "1609 m or a sea mile, 1852 m (write m)",
}  # fmt: skip
NOT_READ = ArithmeticError, AssertionError, AttributeError, RecursionError, TokenError, TypeError, ValueError
_making = threading.Lock()
_SPOKEN: ContextVar[Mapping[str, str]] = ContextVar("spoken units")


def split_quantity(text: str) -> tuple[float, str] | None:
    """Number and unit of a text such as "50 mm", the unit empty where there is none; None for any other text."""
    match = _PARTS.fullmatch(text)
    return (float(match[1].replace("\u2212", "-")), (match[2] or "").strip()) if match else None


def quantity(text: str, unit: str, example: str) -> float:
    """The number in ``unit`` that a text such as "50 mm" says; "1" is the unit of a share, for which "90 %" is one.

    A frequency may be an angular speed: 1800 rpm and 188.5 rad/s are 30 Hz. An angle has a unit of angle, never none.
    Raises ValueError, saying how to write it, for all else: no unit, one of another kind or of two meanings, a decimal
    comma, digits in groups.
    """
    parts = split_quantity(text)
    if parts is not None and (grad := _GRAD.search(parts[1])):
        raise ValueError(f"needs deg or gon: {grad[0]!r} may be a degree or a hundredth of a right angle")
    for word in re.findall(r"[a-z_]+", parts[1].lower()) if parts is not None else ():
        if readings := TWO_MEANINGS.get(word) or TWO_MEANINGS.get(word.removesuffix("s")):
            raise ValueError(f"{word!r} may be {readings}: write which")
    if parts is not None and parts[1]:
        try:
            return converted(parts[0], parts[1], unit)
        except ValueError:
            pass
    number = "a number" if unit == "1" else f"a number in {unit}"
    needed = f"needs {number} or a string such as {example!r}"
    if _MARKED.search(text):
        cures = _pointed(text, unit, example) or needed
        raise ValueError(f"a decimal point is written '.', and thousands without a mark: {cures}")
    raise ValueError(needed)


def _pointed(text: str, unit: str, example: str) -> str:
    """The text with a comma as a point and, where it may part thousands, without marks between digits: what of these is
    a quantity.
    """
    plain, (before, comma, after) = text.strip(), text.strip().partition(",")
    meant = [f"{before.replace('.', '')}.{after}"] if comma and "," not in after else []
    if not meant or re.search(r",[0-9]{3}(?![0-9])", text):
        meant.append(_MARKED.sub("", plain))
    return " or ".join(filter(None, (_accepted(item, unit, example) for item in meant)))


def _accepted(text: str, unit: str, example: str) -> str:
    """How a scene file has the quantity of a text; empty where it is none."""
    parts = split_quantity(text)
    if parts is not None and not parts[1]:
        return text if unit == "1" else ""
    try:
        quantity(text, unit, example)
    except ValueError:
        return ""
    return repr(text)


def converted(value: float, given: str, wanted: str) -> float:
    """``value`` of the unit ``given`` in the unit ``wanted``. Raises ValueError for units of different kinds."""
    if given == wanted:
        return value
    if (factor := FACTORS.get((given, wanted))) is not None:
        return value * factor
    import pint

    registry = _registry()
    if wanted == "K":
        given = DEGREES.get(given, given)
    try:
        source, target = (_unit(item) for item in (given, wanted))
        if _kind(source) != _kind(target):  # one turn a period
            hertz, turns = registry.parse_units("Hz"), registry.parse_units("turn / second")
            source, target = (turns if item == hertz else item for item in (source, target))
        if _kind(source) == _kind(target):
            return float(registry.Quantity(value, source).to(target).magnitude)
    except (pint.PintError, *NOT_READ):
        pass  # what pint raises for text that is no unit
    raise ValueError(f"{given!r} is not a unit like {wanted!r}")


@cache
def _registry() -> Any:
    """pint's units. They are made at their first use, which two threads must not do at once."""
    import pint

    with _making:
        pint.application_registry.parse_units("m")
    return pint.application_registry


def _unit(text: str) -> Unit:
    """A unit of pint's from text: kg/m3 is kg/m^3, /min is 1/min."""
    if strange := NO_UNIT.search(text):
        raise ValueError(f"{strange[0]!r} is in no unit")  # pint passes over it
    named = "" if text == "1" else re.sub(r"(?<=[^\W\d_])(\d)", r"^\1", text)
    unit: Unit = _registry().parse_units(f"1{named}" if named.startswith("/") else named)
    return unit


def _kind(unit: Unit) -> Unit:
    """What the unit is made of; radians count, unlike in pint's dimensionality."""
    kind: Unit = _registry().get_root_units(unit)[1]
    return kind


@contextmanager
def speaking(units: Mapping[str, str]) -> Iterator[None]:
    """Let :func:`say` use ``units`` within this context: the user's unit for a unit of the SI, {"m": "mm"}."""
    before = _SPOKEN.set(units)
    try:
        yield
    finally:
        _SPOKEN.reset(before)


def spoken(unit: str) -> str:
    """The unit in which the user writes numbers in ``unit`` (of the SI); empty where they write none."""
    return _SPOKEN.get({}).get(unit, "")


def say(value: float, unit: str, digits: int = 6) -> str:
    """A number in ``unit`` (of the SI) with the unit that the user writes, such as "95 deg"; of a length that is very
    long or short in that, with another: 2.7 m in a scene whose sizes are in um.
    """
    wanted = spoken(unit) or unit
    shown = value if wanted == unit else converted(value, unit, wanted)
    if spoken(unit) in LENGTHS and shown and not 0.01 <= abs(shown) < 1e4:
        wanted = next((item for item in LENGTHS if abs(value) >= converted(1.0, item, "m")), LENGTHS[-1])
        shown = converted(value, "m", wanted)
    rounded = float(f"{shown:.{digits}g}")  # 140, not 1.4e+02
    return f"{rounded:g} {wanted}".removesuffix(" 1")


def metres(value: float, digits: int = 6) -> str:
    """A length in metres with the unit that the user writes lengths in."""
    return say(value, "m", digits)


def duration(seconds: float) -> str:
    """A time in the unit that suits it.

    >>> duration(42.0), duration(600.0), duration(9000.0)
    ('42 s', '10 min', '2.5 h')
    """
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
