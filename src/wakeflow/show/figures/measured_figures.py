"""Measured shares beside computed ones, each with its 95 % interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...answer.budget.agreement import Agreement, agreement_in, measured_in
from ...core.number import Number
from ..canvas import INK, new_figure, save
from ..outcome import Outcome, add_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from ..canvas import Paper

BEFORE, MEASURED, AFTER = "#4878a8", INK, "#c8622e"
ROW = 0.42  # inches a tray
APART = 0.2  # rows between the intervals of one tray
NOTHING = 0.02  # of a share: trays that neither hold more than that of it are not drawn, if others are


def draw_measured(paper: Paper, found: Agreement, after: Sequence[Number] | None = None) -> Axes:
    """Draw a row a tray: the computed share and the measured one, and where there was a calibration the share
    ``after`` it, each with its 95 % interval.
    """
    shown = [i for i, tray in enumerate(found.trays) if max(tray.measured.high, tray.computed.high) > NOTHING]
    shown = shown or list(range(len(found.trays)))
    trays = [found.trays[i] for i in shown]
    figure = new_figure(6.4, 1.5 + ROW * len(trays), paper)
    axes: Axes = figure.add_subplot()
    lines = [("computed", BEFORE, "s", [tray.computed for tray in trays]),
             ("measured", MEASURED, "o", [tray.measured for tray in trays])]  # fmt: skip
    if after is not None:
        lines.append(("computed, after the calibration", AFTER, "D", [after[i] for i in shown]))
    for place, (label, colour, mark, numbers) in enumerate(lines):
        level = np.arange(len(numbers)) + APART * (place - 0.5 * (len(lines) - 1))
        value, low, high = (100.0 * np.array(part) for part in zip(*map(tuple, numbers), strict=True))
        ends = np.array([value - low, high - value])
        axes.errorbar(value, level, xerr=ends, fmt=mark, ms=4, lw=1.6, capsize=2, color=colour, label=label)
    axes.set_yticks(range(len(trays)), [tray.about for tray in trays], fontsize=8)
    axes.set_ylim(len(trays) - 0.5, -0.5)
    axes.set_xlim(-2.0, 102.0)
    axes.set_xlabel("share (%) with its 95 % interval")
    axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    axes.legend(fontsize=7, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    save(figure, paper, _columns(found))
    return axes


def _columns(found: Agreement) -> dict[str, ArrayLike]:
    table: dict[str, ArrayLike] = {"tray": [tray.about for tray in found.trays]}
    for head, cells in found.cells().columns().items():
        if head not in ("fraction", "bin"):
            table[head] = cells
    return table


def _beside(outcome: Outcome) -> tuple[Agreement] | None:
    measured = measured_in(outcome.result)
    return None if measured is None or outcome.result.landings is None else (agreement_in(outcome.result, measured),)


add_figure(
    "measured",
    "Measured shares and computed ones, each with its 95 % interval.",
    draw_measured,
    _beside,
)
