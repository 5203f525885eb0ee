"""Lengths of a scene without a unit that are far off its scale, and so were most likely meant in another unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from statistics import median

from ..core.quantities import metres, quantity, speaking
from .messages import dotted, units_in
from .schema import Place, at, unit_and_example, values_in

OFF = 100.0  # times the scene's scale: a centimetre that was meant is a metre, a millimetre a thousandth of one
LARGEST = 20.0  # m: beyond any separator, where a whole scene was written without units
MACHINE = ("body", "channel", "feed", "bin", "vibration", "funnel")  # tables whose lengths have one scale
MAX_DOUBTS = 3  # doubts in one message


def doubted_lengths(data: Mapping[str, object]) -> Iterator[tuple[Place, float, float]]:
    """Place and value (m) of every length in a scene's tables that is without a unit and is OFF times the median of
    all of them, or above LARGEST; and that median (m). One with a unit is never doubted.
    """
    given = {
        place: (value, _metres(value))
        for place, value, node in values_in(data)
        if place[0] in MACHINE and (unit_and_example(node) or ("",))[0] == "m"
    }
    sizes = [abs(length) for _, length in given.values() if length]
    scale = median(sizes) if sizes else 0.0
    for place, (value, length) in given.items():
        if not isinstance(value, str) and length and (abs(length) >= OFF * scale or abs(length) > LARGEST):
            yield place, length, scale


def _metres(value: object) -> float | None:
    """The length that a value says; None where it says none, which is another message's matter."""
    if not isinstance(value, str):
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
    try:
        return quantity(value, "m", "")
    except ValueError:
        return None


def doubts(data: Mapping[str, object], among: Iterable[Place] = ((),)) -> str:
    """What to ask about the doubted lengths of a scene's tables, empty for none; ``among``: those in these places."""
    found = [one for one in doubted_lengths(data) if any(one[0][: len(place)] == place for place in among)]
    if not found:
        return ""
    usual = units_in(data).get("m", "m")
    lengths = [f"{dotted(place)} = {length:g} m" for place, length, _ in found[:MAX_DOUBTS]]
    more = f" and {len(found) - MAX_DOUBTS} more" if len(found) > MAX_DOUBTS else ""
    _, length, scale = found[0]
    with speaking({"m": usual}):
        usually = f"lengths of this scene are about {metres(scale, 2)}"
    meant = f"'{length:g} {'mm' if usual == 'm' else usual}', or '{length:g} m' if that is meant"
    return f"{', '.join(lengths)}{more}: unit forgotten? Other {usually}; write {meant}"


def with_units(data: Mapping[str, object]) -> dict[str, object]:
    """A copy of tables in SI numbers whose doubted lengths say that they are metres."""
    copy = deepcopy(dict(data))
    for place, length, _ in list(doubted_lengths(copy)):
        at(copy, place[:-1])[place[-1]] = f"{length!r} m"
    return copy
