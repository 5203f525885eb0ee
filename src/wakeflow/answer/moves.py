"""Which input moves which number of an answer by how much, and what measuring it would leave of an interval."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..core.errors import known as required
from .measurements import target_number
from .result import Result
from .result_table import is_part
from .shares import InputPart, LandingResults

# -- Which input moves which number of an answer by how much -----------------------------------------------------------
SHARE = "share."
LEAST = 1e-3  # of the interval: what an input does less is nothing
DRAWN, SWEPT = "draws", "sweep"


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
    if landings is None or landings.measure_next is None:
        return []
    known, found = landings.inputs or {}, []
    for quantity, value, parts in _quantities(landings):
        for key, part in parts.items():
            number = known[key]
            found.append(
                InputMove(
                    quantity, value, "1", key, number.low, number.high, number.unit, -part.rise, part.rise,
                    part.uncertainty, part.variance, part.error, DRAWN,
                )
            )  # fmt: skip
    return found


def _quantities(landings: LandingResults) -> Iterator[tuple[str, float, Mapping[str, InputPart]]]:
    """Name and value of every number that the draws tell of, and what each unknown does to it."""
    for name, parts in (landings.of_targets or {}).items():
        number = target_number(landings, name)
        if number is not None:
            yield name, number.value, parts
    for name, places in (landings.measure_next or {}).items():
        for place, parts in places.items():
            yield f"{SHARE}{name}.{place}", landings.separation.fractions[name][place].value, parts


def grouped(moves: Iterable[InputMove]) -> dict[str, list[InputMove]]:
    """The moves of each quantity, the largest first."""
    found: dict[str, list[InputMove]] = {}
    for one in moves:
        found.setdefault(one.quantity, []).append(one)
    return {name: sorted(members, key=lambda one: -one.reach) for name, members in found.items()}


def least_sure(moves: Mapping[str, Sequence[InputMove]]) -> list[str]:
    """Of each fraction the recovery; without one the share that its inputs move most, in squares."""
    recovered = {name.split(".")[1]: name for name in moves if name.startswith("recovery.")}
    worst: dict[str, tuple[float, str]] = {}
    for name, members in moves.items():
        fraction = name.split(".")[1]
        if name == recovered.get(fraction) or (name.startswith(SHARE) and fraction not in recovered):
            moved = math.hypot(*(one.reach for one in members))
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
    landings = result.landings
    name, known = f"recovery.{fraction}", {} if landings is None else landings.inputs or {}
    parts = {} if landings is None else (landings.of_targets or {}).get(name, {})
    found = None if landings is None else landings.separation.recovery.get(fraction)
    if found is None or not parts:
        return []
    own, rows, left = result.joint.own, list[Remaining](), dict[str, float]()
    of = required(own.of_name(name))
    for key in sorted(parts, key=lambda one: -parts[one].half):
        if (measured and key not in measured) or parts[key].half < LEAST * found.half:
            continue
        now = 0.5 * (known[key].high - known[key].low)
        then = min(now, measured.get(key, 0.0))
        left[key] = then / now
        alone = min(found.half, own.known_better(of, {key: then / now}, found.value).half)
        together = min(alone, rows[-1].together if rows else alone, own.known_better(of, left, found.value).half)
        rows.append(Remaining(key, known[key].unit, now, then, alone, together))
    return rows
