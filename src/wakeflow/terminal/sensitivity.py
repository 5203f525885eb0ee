"""What a person at a terminal sees of a sensitivity: for each number the inputs that move it most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..core.quantities import say, speaking
from ..report.sketch import UNITS
from ..report.words import NO_VALUE
from ..results.sensitivity import InputMove
from ..sweeps.sensitivity import Sensitivity

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["show_sensitivity"]

MOST_INPUTS = 8  # told of a quantity; all are in the file


def show_sensitivity(found: Sensitivity, quantities: Sequence[str] = ()) -> None:
    """Print what each input alone does to ``quantities``, by default to each fraction's share that is moved most, and
    the part that it has of the variance; what failed, and where the draws do not tell enough.
    """
    from rich.console import Console

    console, shown = Console(), found.of(quantities)
    for name, moves in shown.items():
        told = [one for one in moves if one.error is None or one.error < one.reach]
        if told:
            console.print(_table(name, told[:MOST_INPUTS]))
        if rest := len(moves) - len(told):
            which = f"{rest} other input{'s' if rest > 1 else ''}" if told else "any input"
            console.print(f"{name}: what {which} may change is within its own error", soft_wrap=True)
    lines = [f"! {name}: {reason}" for name, reason in found.failed.items()]
    lines += [_advice(name, left, shown[name]) for name in shown if (left := found.unexplained(name)) is not None]
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _table(name: str, moves: Sequence[InputMove]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    one = moves[0]
    title = f"{name}, {_number(one, one.value)} {'%' if one.is_part else one.measure}; changes"
    table = Table(
        title=f"{title} in {'percentage points' if one.is_part else one.measure}", title_justify="left", pad_edge=False,
        collapse_padding=True, box=SIMPLE_HEAD,
    )  # fmt: skip
    table.add_column("input", overflow="fold")
    for head in ("from", "to", "at from", "at to", "±", "part"):
        table.add_column(head, justify="right", overflow="fold")
    for move in moves:
        table.add_row(*_row(move))
    return table


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
