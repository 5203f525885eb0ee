"""Curves of error against run time, and of recovery against purity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..answer.dividers import Dividers
from ..core.number import Number
from ..core.tables import CellTable
from .canvas import COLOURS, new_figure, save

# -- Error against run time --------------------------------------------------------------------------------------------
HEADS = ("knob", "setting", "chosen", "error", "half", "inside", "seconds")
SETTING_MARKERS = "os^Dv*"
MIN_ERROR = 1e-5  # of a share: an error that is drawn no smaller


def draw_settings(path: Path, rows: Sequence[Mapping[str, Any]], title: str) -> None:
    """Write ``path`` as PNG and beside it as SVG: the error of each setting of a knob full, what the answer says of
    itself dotted, in percentage points over the seconds that it took.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = new_figure(7.0, 4.0)
    axes = figure.add_subplot(xlabel="run time, s", ylabel="largest error of a bin share, points", title=title)
    for number, knob in enumerate(dict.fromkeys(row["knob"] for row in rows)):
        mine = [row for row in rows if row["knob"] == knob]
        seconds = [row["seconds"] for row in mine]
        look: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            "marker": SETTING_MARKERS[number % len(SETTING_MARKERS)],
            "ms": 4.0,
        }
        axes.plot(seconds, [100 * max(row["error"], MIN_ERROR) for row in mine], "-", label=knob, **look)
        if all(row["half"] is not None for row in mine):
            axes.plot(seconds, [100 * max(row["half"], MIN_ERROR) for row in mine], ":", alpha=0.7, **look)
    for style, told in (("-", "error, against the best answer"), (":", "half of the stated interval")):
        axes.plot([], [], style, color="0.4", label=told)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7.5, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    save(figure, path)


def write_settings(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write what :func:`draw_settings` draws as CSV: errors and half widths as shares, seconds."""
    CellTable(HEADS, [[row[head] for head in HEADS] for row in rows]).write_csv(path)


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
