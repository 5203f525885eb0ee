"""What a measurement would buy: the interval of a recovery or a purity, were a number of the scene known better.

Known to a fraction f of what it is known to now, and still where it is expected, an input does to every draw of the
joint answer (:mod:`wakeflow.answer.joint`) what it alone does there at f times its distance; all else stays, so that no
measurement of an input leaves less than what computing adds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ..core.errors import known as required
from ..core.number import Number
from ..core.quantities import say, speaking
from .result import Result
from .shares import InputPart, LandingResults

GAIN = 0.005  # of a share: a measurement that narrows an interval by less is not worth a line; chosen
MAX_LISTED = 3  # measurements of a quantity
PAGE = "docs/uncertainty.md"


@dataclass(frozen=True)
class Method:
    """How a number is measured, and how well: ``within`` of a 95 % interval, ``relative`` to the number or in its own
    unit; the section of docs/uncertainty.md that says how.
    """

    within: float
    relative: bool
    how: str
    section: str

    def half(self, value: float) -> float:
        """Half of the interval that it leaves of a number."""
        return self.within * abs(value) if self.relative else self.within


METHODS: Mapping[str, Method] = {  # by the last part of an input's key; what a workshop reaches: chosen, see the page
    "restitution": Method(0.03, False, "a drop test", "restitution-and-scatter-a-drop-test"),
    "rebound_scatter": Method(0.03, False, "a drop test on film", "restitution-and-scatter-a-drop-test"),
    "friction": Method(0.03, False, "a tilting plate", "friction-a-tilting-plate"),
    "terminal_velocity": Method(0.03, True, "an aspiration column", "terminal-velocity-an-aspiration-column"),
    "size": Method(0.02, True, "counting and weighing", "size-and-density"),
    "density": Method(0.02, True, "a pycnometer", "size-and-density"),
    "moisture": Method(0.005, False, "drying in an oven", "moisture"),
    "air.speed": Method(0.02, True, "an anemometer before the body", "the-air-an-anemometer"),
    "air.turbulence": Method(0.15, True, "a hot wire before the body", "the-air-an-anemometer"),
    "wake.theta": Method(0.1, False, "an anemometer behind the body", "the-wake-an-anemometer-behind-the-body"),
    "wake.strength": Method(0.1, False, "an anemometer behind the body", "the-wake-an-anemometer-behind-the-body"),
    "feed.width": Method(1e-3, False, "a film of the curtain", "the-feed-a-film-of-the-curtain"),
    "feed.position": Method(1e-3, False, "a film of the curtain", "the-feed-a-film-of-the-curtain"),
    "feed.height": Method(2e-3, False, "a ruler", "the-feed-a-film-of-the-curtain"),
}


@dataclass(frozen=True)
class Purchase:
    """One measurement: the ``key`` of the number, to which ``half`` of its interval in its ``unit``, by which
    ``method``, and the ``number`` of the answer that is then known so well.
    """

    key: str
    half: float
    unit: str
    method: Method
    number: Number


def method_of(key: str) -> Method | None:
    """How the number at a key is measured; None where nobody measures it."""
    return METHODS.get(key) or METHODS.get(key.rpartition(".")[2] if key.startswith("fraction.") else "")


def purchases(result: Result, name: str, number: Number, parts: Mapping[str, InputPart]) -> list[Purchase]:
    """What each measurement alone would make of a ``number`` of the answer called ``name``, the most useful first."""
    found = [made for key, part in parts.items() if (made := _bought(result, name, number, key, part)) is not None]
    found = [one for one in found if number.half - one.number.half >= GAIN]
    return sorted(found, key=lambda one: one.number.half)[:MAX_LISTED]


def _bought(result: Result, name: str, number: Number, key: str, part: InputPart) -> Purchase | None:
    known, own = required(required(result.landings).inputs)[key], result.joint.own
    method, now = method_of(key), 0.5 * (known.high - known.low)
    if method is None or not part.tells or not now > method.half(known.value) > 0.0:
        return None
    left = {key: method.half(known.value) / now}
    narrower = own.known_better(required(own.of_name(name)), left, number.value)
    return Purchase(key, method.half(known.value), known.unit, method, narrower)


def worth_measuring(result: Result) -> Iterator[tuple[str, Number, list[Purchase]]]:
    """For each recovery and purity of a target: its name, its number, and the measurements that would narrow it."""
    landings = result.landings
    if landings is None or not landings.of_targets or landings.inputs is None:
        return
    for name, parts in landings.of_targets.items():
        number = target_number(landings, name)
        if number is not None and (bought := purchases(result, name, number, parts)):
            yield name, number, bought


def target_number(landings: LandingResults, name: str) -> Number | None:
    """The number of the answer called recovery.FRACTION or purity.BIN.FRACTION."""
    kind, *of = name.split(".")
    if kind == "recovery":
        return landings.separation.recovery.get(of[0])
    return (landings.separation.purity.get(of[0]) or {}).get(of[1])


def measured_words(bought: Purchase) -> str:
    """``"the restitution of wheat to +- 0.03 (a drop test)"``."""
    parts = bought.key.split(".")
    what = f"the {parts[2]} of {parts[1]}" if parts[0] == "fraction" else bought.key
    with speaking({"m": "mm", "rad": "deg"}):
        half = say(bought.half, bought.unit, 2)
    return f"{what.replace('_', ' ')} to +- {half} ({bought.method.how})"
