"""Lengths of a scene without a unit that are far off its scale, and so were most likely meant in another unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from statistics import median

from ..core.quantities import metres, quantity, speaking
from .messages import dotted, units_in
from .schema import Place, at, unit_and_example, values_in

OFF = 100.0  # times the scene's scale: a centimetre that was meant is a metre, a millimetre a thousandth of one
LARGEST = 20.0  # m: beyond any separator, where a whole scene was written without units
MACHINE = ("body", "channel", "feed", "bin", "vibration", "funnel")  # tables whose lengths have one scale
EVERYWHERE: Sequence[Place] = ((),)


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


def doubts(data: Mapping[str, object], among: Iterable[Place]) -> dict[str, str]:
    """What to ask about each doubted length of a scene's tables in the places ``among``, by its key."""
    places = list(among)
    found = [one for one in doubted_lengths(data) if any(one[0][: len(place)] == place for place in places)]
    usual, asked = units_in(data).get("m", "m"), {}
    for place, length, scale in found:
        with speaking({"m": usual}):
            usually = f"lengths of this scene are about {metres(scale, 2)}"
        meant = f"'{length:g} {'mm' if usual == 'm' else usual}', or '{length:g} m' if that is meant"
        asked[dotted(place)] = f"{dotted(place)} = {length:g} m: unit forgotten? Other {usually}; write {meant}"
    return asked


def with_units(data: Mapping[str, object]) -> dict[str, object]:
    """A copy of tables in SI numbers whose doubted lengths say that they are metres."""
    copy = deepcopy(dict(data))
    for place, length, _ in list(doubted_lengths(copy)):
        at(copy, place[:-1])[place[-1]] = f"{length!r} m"
    return copy
