"""Which input moves which number of an answer by how much, and what measuring it would leave of an interval.

Known to a fraction f of what it is known to now, and still where it is expected, an input does to every draw of the
joint answer (:mod:`wakeflow.answer.joint`) what it alone does there at f times its distance; all else stays, so that no
measurement of an input leaves less than what computing adds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..core.number import Number
from ..core.quantities import say, speaking
from .result import Result
from .result_table import is_part
from .shares import InputPart, LandingResults

SHARE = "share."
LEAST = 1e-3  # of the interval: what an input does less is nothing
DRAWN, SWEPT = "draws", "sweep"
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


NOBODY = Method(math.inf, False, "nobody measures it", "")


def method_of(key: str) -> Method:
    """How the number at a key is measured; NOBODY where it is not."""
    return METHODS.get(key) or METHODS.get(key.rpartition(".")[2] if key.startswith("fraction.") else "", NOBODY)


def purchases(result: Result, name: str, number: Number, parts: Mapping[str, InputPart]) -> list[Purchase]:
    """What each measurement alone would make of a ``number`` of the answer called ``name``, the most useful first."""
    bins, listed = result.joint.own, []
    inputs, of = {} if result.landings is None else result.landings.inputs, bins.of_name(name)
    for key, part in parts.items():
        known, method = inputs[key], method_of(key)
        if of is None or not part.tells or not known.half > method.half(known.value) > 0.0:
            continue
        half = method.half(known.value)
        narrower = bins.known_better(of, {key: half / known.half}, number.value)
        if number.half - narrower.half >= GAIN:
            listed.append(Purchase(key, half, known.unit, method, narrower))
    return sorted(listed, key=lambda purchase: purchase.number.half)[:MAX_LISTED]


def worth_measuring(result: Result) -> Iterator[tuple[str, Number, list[Purchase]]]:
    """Name and number of each recovery and purity of a target, and the measurements that would narrow it."""
    landings = result.landings
    if landings is None:
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


# -- Which input moves which number of an answer by how much -----------------------------------------------------------
@dataclass(frozen=True)
class InputMove:
    """What one input alone does to a number of the answer.

    ``quantity`` as in a sweep's table, its ``value`` and ``measure`` ("1" for parts of a whole); the input's ``key``,
    the ends ``low`` and ``high`` that it was taken to, and their ``unit``; ``at_low`` and ``at_high``: the changes of
    the quantity there, None where that was not computed, with the half ``error`` of their 95 % interval, None where
    unknown. From a run's draws also the input's part ``index`` of the quantity's variance (first-order index), known
    to +- ``index_error``. ``how``: draws, or sweep.
    """

    quantity: str
    value: float
    measure: str
    key: str
    low: float
    high: float
    unit: str
    at_low: float | None
    at_high: float | None
    error: float | None
    index: float | None
    index_error: float | None
    how: str

    @property
    def is_part(self) -> bool:
        """Whether the quantity is a part of a whole, whose changes are reported in percentage points."""
        return self.measure == "1" and is_part(self.quantity)

    @property
    def reach(self) -> float:
        """The larger of the two changes."""
        return max(abs(self.at_low or 0.0), abs(self.at_high or 0.0))


def drawn_moves(landings: LandingResults | None) -> list[InputMove]:
    """What a run's draws say of every share, and of recoveries and purities of targets; nothing where no input is
    unknown.
    """
    if landings is None:
        return []
    return [
        InputMove(quantity, value, "1", key, number.low, number.high, number.unit, -part.rise, part.rise,
                  part.uncertainty, part.variance, part.error, DRAWN)
        for quantity, value, parts in _quantities(landings)
        for key, part in parts.items()
        for number in [landings.inputs[key]]
    ]  # fmt: skip


def _quantities(landings: LandingResults) -> Iterator[tuple[str, float, Mapping[str, InputPart]]]:
    """Name and value of every number that the draws tell of, and what each unknown does to it."""
    for name, parts in landings.of_targets.items():
        number = target_number(landings, name)
        if number is not None:
            yield name, number.value, parts
    for name, places in landings.measure_next.items():
        for place, parts in places.items():
            yield f"{SHARE}{name}.{place}", landings.separation.fractions[name][place].value, parts


def grouped(moves: Iterable[InputMove]) -> dict[str, list[InputMove]]:
    """The moves of each quantity, the largest first."""
    groups: dict[str, list[InputMove]] = {}
    for move in moves:
        groups.setdefault(move.quantity, []).append(move)
    return {name: sorted(members, key=lambda move: -move.reach) for name, members in groups.items()}


def least_sure(moves: Mapping[str, Sequence[InputMove]]) -> list[str]:
    """Name of each fraction's recovery; without one that of the share that its inputs move most, in squares."""
    recovered = {name.split(".")[1]: name for name in moves if name.startswith("recovery.")}
    worst: dict[str, tuple[float, str]] = {}
    for name, members in moves.items():
        fraction = name.split(".")[1]
        if name == recovered.get(fraction) or (name.startswith(SHARE) and fraction not in recovered):
            moved = math.hypot(*(move.reach for move in members))
            if moved > worst.get(fraction, (-1.0, ""))[0]:
                worst[fraction] = moved, name
    return [name for _, name in worst.values()]


# -- What measuring an input would leave of an interval ----------------------------------------------------------------
@dataclass(frozen=True)
class Remaining:
    """What is left of the 95 % interval of a fraction's recovery once an input is known better: of the input's ``key``
    in ``unit``, half of the interval ``now`` and as it is to be ``measured``; half of the recovery's interval then,
    ``alone`` and ``together`` with all inputs before it.
    """

    key: str
    unit: str
    now: float
    measured: float
    alone: float
    together: float


def remaining(result: Result, fraction: str, measured: Mapping[str, float]) -> list[Remaining]:
    """What measuring leaves of the recovery of a ``fraction``, the input that moves it most first.

    ``measured``: half of the 95 % interval of an input (SI) as it is to be known; empty: each in turn exactly. Each is
    taken to be where it is expected. Empty where no recovery is known or no input moves it.
    """
    landings, name = result.landings, f"recovery.{fraction}"
    recovery = None if landings is None else landings.separation.recovery.get(fraction)
    of = None if recovery is None else result.joint.own.of_name(name)
    if landings is None or recovery is None or of is None:
        return []
    parts = landings.of_targets.get(name, {})
    bins, rows, left = result.joint.own, list[Remaining](), dict[str, float]()
    for key in sorted(parts, key=lambda of_input: -parts[of_input].half):
        if (measured and key not in measured) or parts[key].half < LEAST * recovery.half:
            continue
        known = landings.inputs[key]
        then = min(known.half, measured.get(key, 0.0))
        left[key] = then / known.half
        alone = min(recovery.half, bins.known_better(of, {key: left[key]}, recovery.value).half)
        together = min(alone, rows[-1].together if rows else alone, bins.known_better(of, left, recovery.value).half)
        rows.append(Remaining(key, known.unit, known.half, then, alone, together))
    return rows
