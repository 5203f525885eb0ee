"""Curves of recovery against purity."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..answer.dividers import Dividers
from ..core.number import Number
from ..core.tables import CellTable
from .canvas import COLOURS, new_figure, save

# -- The figure of the dividers ----------------------------------------------------------------------------------------
DIVIDER_HEADS = (
    "purity asked (%)", "purity (%)", "purity low (%)", "purity high (%)", "recovery (%)", "recovery low (%)",
    "recovery high (%)", "from, to along the line (m)",
)  # fmt: skip


def draw_dividers(path: Path, found: Sequence[Dividers]) -> None:
    """Draw what dividers give at every purity asked: recovery over purity, both on granules that did not choose."""
    figure = new_figure(5.6, 4.0)
    axes = figure.add_subplot(xlabel="purity (%)", ylabel=f"recovery of {found[0].fraction} (%)")
    able = [one for one in found if one.possible and one.purity.value is not None]
    pure, got = (np.array([_numbers(part) for part in side]).T for side in zip(*map(_both, able), strict=True))
    axes.fill_between(pure[0], got[1], got[2], color=COLOURS[0], alpha=0.18, linewidth=0)
    axes.fill_betweenx(got[0], pure[1], pure[2], color=COLOURS[0], alpha=0.18, linewidth=0)
    axes.plot(pure[0], got[0], "o-", ms=3, color=COLOURS[0])
    save(figure, path)


def write_dividers(path: Path, found: Sequence[Dividers]) -> None:
    """Write what :func:`draw_dividers` draws as CSV, with the stretches at each purity; empty where none reaches it."""
    rows = []
    for one in found:
        numbers = [*_numbers(one.purity), *_numbers(one.recovery)] if one.possible else [None] * 6
        cells = [None if number is None or np.isnan(number) else number for number in numbers]
        rows.append([100 * one.asked, *cells, "; ".join(f"{low:.6g} {high:.6g}" for low, high in one.stretches)])
    CellTable(DIVIDER_HEADS, rows).write_csv(path, 6)


def _both(one: Dividers) -> tuple[Number, Number]:
    return one.purity, one.recovery


def _numbers(found: Number) -> tuple[float, float, float]:
    """Percent, nan where unknown."""
    value, low, high = (100.0 * one if np.isfinite(one) else np.nan for one in found)
    return value, low, high
