"""Messages for what is wrong with a scene: one line with field, value and what is allowed, in the unit that the user
wrote; and for lengths that may have lost their unit.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from statistics import median

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ..core.quantities import converted, metres, quantity, speaking, split_quantity
from ..core.record import JsonMapping
from ..core.registry import did_you_mean
from .pictures import picture_tables
from .schema import Place, allowed_range, at, described, known_keys, unit_and_example, values_in

WANTED = {  # pydantic's types of errors, in the user's words
    "greater_than": "too small",
    "greater_than_equal": "too small",
    "less_than": "too large",
    "less_than_equal": "too large",
    "float_type": "needs a number",
    "int_type": "needs a whole number",
    "int_from_float": "needs a whole number",
    "finite_number": "needs a finite number",
    "string_type": "needs a text between quotes",
    "bool_type": "needs true or false",
    "list_type": "needs a list between [ ]",
    "string_pattern_mismatch": "a name begins with a letter and goes on with letters, digits, - and _, 41 at most",
}
SIZES = {"too_short": ("least", "min_length"), "too_long": ("most", "max_length")}
TOO_LARGE = ("less_than", "less_than_equal")
TOO_SMALL = ("greater_than", "greater_than_equal")
GONE = {"animation": " (wakeflow animate films a finished run)"}
BELOW = {"air.speed": "; which way it blows is said by air.direction"}
PYDANTIC = re.compile(r"[a-z-]*\[.*\]")  # what it says of kinds of values, among the keys: list[str]
FOLLOWS = "default_factory_not_called"  # as of air.density: what it follows from is wrong, and is told there
TABLE = ("model_type", "dict_type", "model_attributes_type")


def explain(problem: ValidationError, data: Mapping[str, object]) -> Iterator[str]:
    """Each mistake in the tables ``data``: where, the value given, what is wrong, what is allowed."""
    for error in problem.errors():
        if error["type"] == FOLLOWS:
            continue
        if not error["loc"]:  # of all tables together
            yield _words(error)
            continue
        place = _place(error)
        key, value = dotted(place), at(data, place)
        if error["type"].startswith("union_tag"):
            kinds = list(picture_tables())
            given = error.get("ctx", {}).get("tag")
            near = GONE.get(str(given)) or did_you_mean(given, kinds)
            hint = "missing" if given is None else f"{given!r} is unknown{near}"
            yield f"{key}.kind: {hint} (known: {', '.join(kinds)})"
        elif error["type"] == "extra_forbidden":
            known = known_keys(described(place[:-1], data), at(data, place[:-1]))
            yield f"{key}: unknown key{did_you_mean(str(place[-1]), known)} (known: {', '.join(known)})"
        elif error["type"] == "missing":
            yield f"{key}: missing{_allowed(place, data, None)}"
        elif error["type"] == "value_error" and not isinstance(value, Mapping):
            yield f"{key} = {value!r}: {_words(error)}"
        elif error["type"] in TABLE:
            yield f"{key} = {value!r}: {_no_table(place, data)}"
        elif isinstance(value, Mapping):
            yield f"{key}: {_words(error)}"
        else:
            unit_lost = _unit_lost(place, data, value) if error["type"] in TOO_LARGE else ""
            hint = BELOW.get(key, "") if error["type"] in TOO_SMALL else ""
            yield f"{key} = {value!r}: {_words(error)}{_allowed(place, data, value)}{unit_lost}{hint}"


def units_in(data: Mapping[str, object]) -> dict[str, str]:
    """The unit that the tables ``data`` use most for each unit of the SI: {"m": "mm", "rad": "deg"}."""
    counted: dict[str, Counter[str]] = {}
    for _, value, node in values_in(data):
        unit, written = unit_and_example(node), split_quantity(value) if isinstance(value, str) else None
        if unit and written and _converts(written[1], unit[0]):
            counted.setdefault(unit[0], Counter())[written[1]] += 1
    return {unit: of.most_common(1)[0][0] for unit, of in counted.items()}


def unit_of(key: str) -> str:
    """The unit of the numbers of a dotted key, in a list and in a list of points too: "m/s" for air.speed; empty for
    plain numbers and for other values.
    """
    place: Place = tuple(key.split("."))
    nodes = (described(where, {}) for where in (place, (*place, 0), (*place, 0, 0)))
    unit, _ = next(filter(None, map(unit_and_example, nodes)), ("1", ""))
    return "" if unit == "1" else unit


def dotted(place: Place) -> str:
    """A place as the user writes it, fraction.wheat.size; in a list counted from one: fraction.wheat.target[2]."""
    return "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")


def _place(error: ErrorDetails) -> Place:
    """Where the mistake is, without pydantic's words for itself, or the kind of a picture or a bin after its name."""
    first, *rest = error["loc"]  # the user's own key, whatever is in it
    inner = [first, *(part for part in rest if not PYDANTIC.fullmatch(str(part)))]
    if inner[0] in ("picture", "bin") and len(inner) > 2:
        del inner[2]
    return tuple(inner)


def _words(error: ErrorDetails) -> str:
    if error["type"] in SIZES:
        word, limit = SIZES[error["type"]]
        count = error["ctx"][limit]
        return f"needs at {word} {count} {'entry' if count == 1 else 'entries'}"
    text = error["msg"].removeprefix("Value error, ")
    return WANTED.get(error["type"], f"{text[0].lower()}{text[1:]}")


def _no_table(place: Place, data: JsonMapping) -> str:
    """What to say of a value where a table belongs; "body.width = 60" forgets which body."""
    known = known_keys(described(place, data))
    names = list(at(data, place[:-1])) if len(place) > 1 else []
    if place[-1] in known and (named := [name for name in names if isinstance(at(data, (*place[:-1], name)), Mapping)]):
        return f"which one? {', '.join(dotted((*place[:-1], name, place[-1])) for name in named)}"
    keys = f" (its keys: {', '.join(known)})" if known else ""
    return f"is a table: write [{dotted(place)}] and its keys below it{keys}"


def _allowed(place: Place, data: Mapping[str, object], value: object) -> str:
    """The range of a field, in the unit of the value as it is written."""
    node = described(place, data)
    measure = unit_and_example(node)
    unit, _ = measure or ("1", "")
    written = split_quantity(value) if measure and isinstance(value, str) else None
    spoken = {unit: written[1]} if written and _converts(written[1], unit) else {}
    with speaking(spoken):
        words = allowed_range(node, unit)
    return f" (allowed: {words})" if words else ""


def _unit_lost(place: Place, data: Mapping[str, object], value: object) -> str:
    """What to ask of a number alone that is too large, where scenes usually give such numbers another unit."""
    unit, example = unit_and_example(described(place, data)) or ("1", "")
    usual = split_quantity(example)
    if not isinstance(value, int | float) or usual is None or usual[1] == unit:
        return ""
    alone = "" if unit == "1" else f": a number alone is in {unit}"
    return f"; unit forgotten{alone}? Write '{value:g} {usual[1]}' if that is meant"


def _converts(written: str, unit: str) -> bool:
    """Whether a unit as it is written is one of the kind of ``unit``."""
    try:
        converted(1.0, written, unit)
    except ValueError:
        return False
    return True


# -- Lengths without a unit that are far off the scene's scale, and so were most likely meant in another ---------------
OFF = 100.0  # times the scene's scale: a centimetre that was meant is a metre, a millimetre a thousandth of one
LARGEST = 20.0  # m: beyond any separator, where a whole scene was written without units
MACHINE = ("body", "channel", "feed", "bin", "vibration", "funnel")  # tables whose lengths have one scale
EVERYWHERE: Sequence[Place] = ((),)


def doubted_lengths(data: Mapping[str, object]) -> Iterator[tuple[Place, float, float]]:
    """Place and value (m) of every length in a scene's tables that is without a unit and is OFF times the median of
    all of them, or above LARGEST; and that median (m). One with a unit is never doubted.
    """
    given = {
        place: (value, _metres_in(value))
        for place, value, node in values_in(data)
        if place[0] in MACHINE and (unit_and_example(node) or ("",))[0] == "m"
    }
    sizes = [abs(length) for _, length in given.values() if length]
    scale = median(sizes) if sizes else 0.0
    for place, (value, length) in given.items():
        if not isinstance(value, str) and length and (abs(length) >= OFF * scale or abs(length) > LARGEST):
            yield place, length, scale


def _metres_in(value: object) -> float:
    """The length that a value says; 0 where it says none, which is another message's matter."""
    if not isinstance(value, str):
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
    try:
        return quantity(value, "m", "")
    except ValueError:
        return 0.0


def doubts(data: Mapping[str, object], among: Iterable[Place]) -> dict[str, str]:
    """What to ask about each doubted length of a scene's tables in the places ``among``, by its key."""
    places = list(among)
    result = [item for item in doubted_lengths(data) if any(item[0][: len(place)] == place for place in places)]
    usual, questions = units_in(data).get("m", "m"), {}
    for place, length, scale in result:
        with speaking({"m": usual}):
            usually = f"lengths of this scene are about {metres(scale, 2)}"
        meant = f"'{length:g} {'mm' if usual == 'm' else usual}', or '{length:g} m' if that is meant"
        questions[dotted(place)] = f"{dotted(place)} = {length:g} m: unit forgotten? Other {usually}; write {meant}"
    return questions


def with_units(data: Mapping[str, object]) -> dict[str, object]:
    """A copy of tables in SI numbers whose doubted lengths say that they are metres."""
    copy = deepcopy(dict(data))
    for place, length, _ in list(doubted_lengths(copy)):
        at(copy, place[:-1])[place[-1]] = f"{length!r} m"
    return copy
