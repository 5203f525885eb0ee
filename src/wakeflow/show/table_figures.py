"""The figures that suit a table of many results, drawn into its folder, and recovery over purity of dividers."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ..answer.dividers import Dividers
from ..answer.result import VOID
from ..answer.result_table import ResultTable
from ..core import sums
from ..core.number import Number
from ..core.tables import CellTable
from .canvas import COLOURS, new_figure, save, saved
from .many_figures import draw_lines, draw_map, draw_trade_off, grid_of, main_quantities, numeric_inputs, pairs_of

COMMAND = "figures"  # whose files they are in a folder
OF_TABLE = re.compile(r"figures/((lines|map)-.*|trade-off)\.[a-z]+")  # the figures that a table had


def draw_table_figures(folder: Path, table: ResultTable) -> list[Path]:
    """Draw what suits the inputs of a table into figures/ of its ``folder``: a figure of lines for each, a map for each
    two that form a grid, and purity against recovery. Returns the files; those of an earlier table are removed, and
    nothing else: SHA256SUMS says which they are. Raises SceneError where one of others would be replaced.
    """
    drawn = _figures(folder / "figures", of_worth(table))
    files = [file for png in drawn for file in saved(png)]
    sums.refuse_foreign(folder, files, COMMAND)
    for name in sums.listed(folder):
        if OF_TABLE.fullmatch(name):
            (folder / name).unlink(missing_ok=True)
    with sums.writing(folder, lambda: files, COMMAND):
        for png, draw in drawn.items():
            draw(png)
    return list(drawn)


def _figures(folder: Path, table: ResultTable) -> dict[Path, Callable[[Path], None]]:
    """What draws each figure, by its file."""
    names, keys = main_quantities(table), numeric_inputs(table)
    if not names or not table.done:
        return {}
    found: dict[Path, Callable[[Path], None]] = {
        folder / f"lines-{key}.png": partial(draw_lines, table=table, names=names, key=key) for key in keys
    }
    for x, y in itertools.combinations(keys, 2):
        if grid_of(table, x, y) is not None:
            found[folder / f"map-{x}-{y}.png"] = partial(draw_map, table=table, names=names, x=x, y=y)
    if any(pairs_of(table)):
        found[folder / "trade-off.png"] = partial(draw_trade_off, table=table)
    return found


def of_worth(table: ResultTable) -> ResultTable:
    """The table without void answers, which say nothing."""
    return ResultTable([one for one in table.entries if one.reason != VOID], table.targets)


DIVIDER_HEADS = (
    "purity asked (%)", "purity (%)", "purity low (%)", "purity high (%)", "recovery (%)", "recovery low (%)",
    "recovery high (%)", "from, to along the line (m)",
)  # fmt: skip


def draw_dividers(path: Path, found: Sequence[Dividers]) -> None:
    """Draw what dividers give at every purity asked: recovery over purity, both on granules that did not choose."""
    figure = new_figure(5.6, 4.0)
    axes = figure.add_subplot(xlabel="purity (%)", ylabel=f"recovery of {found[0].fraction} (%)")
    able = [one for one in found if one.possible and one.purity.value is not None]
    pure, got = (
        np.array([_numbers(part) for part in side]).T
        for side in ([one.purity for one in able], [one.recovery for one in able])
    )
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


def _numbers(found: Number) -> tuple[float, float, float]:
    """Percent, nan where unknown."""
    value, low, high = (100.0 * one if np.isfinite(one) else np.nan for one in found)
    return value, low, high
