"""What a person at a terminal sees of a sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...answer.measurements import InputMove, Remaining
from ...answer.result import Result
from ...cli.screen import print_lines, print_table, screen_table
from ...core.errors import known
from ...core.quantities import say, speaking
from ...show.plan_words import UNITS
from ...show.words import NO_VALUE, percent
from .sensitivity import Sensitivity

if TYPE_CHECKING:
    from rich.table import Table

MAX_INPUTS = 8  # told of a quantity; all are in the file


def show_moves(found: Sensitivity, quantities: Sequence[str] = ()) -> None:
    """Print what each input alone does to ``quantities``, by default to each fraction's share that is moved most, and
    the part that it has of the variance; what failed, and where the draws do not tell enough.
    """
    from rich.console import Console

    console, shown = Console(), found.of(quantities)
    for name, moves in shown.items():
        sure = [one for one in moves if one.error is None or one.error < one.reach]
        if sure:
            console.print(_moves_table(name, sure[:MAX_INPUTS]))
        if rest := len(moves) - len(sure):
            which = f"{rest} other input{'s' if rest > 1 else ''}" if sure else "any input"
            console.print(f"{name}: what {which} may change is within its own error", soft_wrap=True)
    lines = [f"! {name}: {reason}" for name, reason in found.failed.items()]
    lines += [_advice(name, left, shown[name]) for name in shown if (left := found.unexplained(name)) is not None]
    print_lines(lines)


def show_remaining(result: Result, left: Mapping[str, Sequence[Remaining]]) -> None:
    """Print what measuring inputs would leave of the interval of each recovery."""

    for name, rows in left.items():
        value = known(known(result.landings).separation.recovery[name])
        title = f"recovery.{name}, {percent(value)} %; half of its 95 % interval, points, with inputs known better"
        heads = ("input", "now ±", "known to ±", "alone", "with those above")
        if rows:
            print_table(heads, map(_left, rows[:MAX_INPUTS]), title)


def _left(one: Remaining) -> list[str]:
    with speaking(UNITS):
        halves = [say(half, one.unit or "1", 2) for half in (one.now, one.measured)]
    return [one.key, *halves, *(f"{100 * half:.1f}" for half in (one.alone, one.together))]


def _moves_table(name: str, moves: Sequence[InputMove]) -> Table:
    one = moves[0]
    title = f"{name}, {_number(one, one.value)} {'%' if one.is_part else one.measure}; changes"
    title += f" in {'percentage points' if one.is_part else one.measure}"
    return screen_table(("input", "from", "to", "at from", "at to", "±", "part"), map(_row, moves), title)


def _row(one: InputMove) -> list[str]:
    with speaking(UNITS):
        ends = [say(end, one.unit or "1", 3) for end in (one.low, one.high)]
    changes = (NO_VALUE if change is None else f"{_number(one, change):+.2g}" for change in (one.at_low, one.at_high))
    error = NO_VALUE if one.error is None else f"{_number(one, one.error):.2g}"
    index = NO_VALUE if one.index is None else f"{100 * one.index:.0f} %"
    return [one.key, *ends, *changes, error, index]


def _number(one: InputMove, number: float) -> float:
    return float(f"{(100.0 if one.is_part else 1.0) * number:.3g}")


def _advice(name: str, left: float, moves: Sequence[InputMove]) -> str:
    """How to know more of a share of which what each input does alone explains too little."""
    keys = " ".join(f"--over {one.key}" for one in moves[:2])
    part = f"{100 * left:.0f} % of its uncertainty (of the variance)"
    return f"{name}: {part} is no single input's; runs at both ends of the largest tell more: {keys}"
