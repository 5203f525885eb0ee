"""Which input moves which number of an answer by how much: a row for each input and number, from whatever tells it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot

from .landing_results import LandingResults
from .quantities import is_part

__all__ = ["InputMove", "grouped", "least_sure", "regressed_moves"]

SHARE = "share."
REGRESSION, SWEEP = "regression", "sweep"


@dataclass(frozen=True)
class InputMove:
    """What one input alone does to a number of the answer.

    ``quantity`` as in a sweep's table, its ``value`` and ``measure`` ("1" for parts of a whole); the input's ``key``,
    the ends ``low`` and ``high`` that it was taken to, and their ``unit``; ``at_low`` and ``at_high``: the changes of
    the quantity there, None where that was not computed, with the half ``error`` of their 95 % interval, None where
    unknown. From the regression on a run's draws also the input's part ``index`` of the quantity's variance
    (first-order index), known to +- ``index_error``. ``how``: regression, or sweep.
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
        """Whether the quantity is a part of a whole, whose changes are told in percentage points."""
        return self.measure == "1" and is_part(self.quantity)

    @property
    def reach(self) -> float:
        """The larger of the two changes."""
        return max(abs(self.at_low or 0.0), abs(self.at_high or 0.0))


def regressed_moves(landings: LandingResults | None) -> list[InputMove]:
    """What the regression on a run's draws says of every share; nothing where no input is unknown, or where an older
    version that did not tell directions made the result.
    """
    if landings is None or landings.measure_next is None:
        return []
    known, found = landings.inputs or {}, []
    for name, places in landings.measure_next.items():
        for place, parts in places.items():
            value = landings.separation.fractions[name][place].value
            for key, part in parts.items():
                if part.rise is None:
                    return []
                number = known[key]
                found.append(
                    InputMove(
                        f"{SHARE}{name}.{place}", value, "1", key, number.low, number.high, number.unit, -part.rise,
                        part.rise, part.uncertainty, part.variance, part.error, REGRESSION,
                    )
                )  # fmt: skip
    return found


def grouped(moves: Iterable[InputMove]) -> dict[str, list[InputMove]]:
    """The moves of each quantity, the largest first."""
    found: dict[str, list[InputMove]] = {}
    for one in moves:
        found.setdefault(one.quantity, []).append(one)
    return {name: sorted(members, key=lambda one: -one.reach) for name, members in found.items()}


def least_sure(moves: Mapping[str, Sequence[InputMove]]) -> list[str]:
    """Of each fraction the share that its inputs move most, in squares."""
    worst: dict[str, tuple[float, str]] = {}
    for name, members in moves.items():
        if name.startswith(SHARE):
            fraction, moved = name.split(".")[1], hypot(*(one.reach for one in members))
            if moved > worst.get(fraction, (-1.0, ""))[0]:
                worst[fraction] = moved, name
    return [name for _, name in worst.values()]
