"""The figures that suit the inputs of a table of many results, drawn into its folder."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

from ..answer.result import VOID
from ..answer.table import ResultTable
from ..core import sums
from .canvas import saved
from .many import draw_lines, draw_map, draw_trade_off, grid_of, main_quantities, numeric_inputs, pairs_of

OF_TABLE = re.compile(r"figures/((lines|map)-.*|trade-off)\.[a-z]+")  # the figures that a table had


def draw_table_figures(folder: Path, table: ResultTable) -> list[Path]:
    """Draw what suits the inputs of a table into figures/ of its ``folder``: a figure of lines for each, a map for each
    two that form a grid, and purity against recovery. Returns the files; those of an earlier table are removed, and
    nothing else: SHA256SUMS says which they are.
    """
    for name in sums.listed(folder):
        if OF_TABLE.fullmatch(name):
            (folder / name).unlink(missing_ok=True)
    files = _drawn(folder / "figures", table)
    sums.note(folder, [file for png in files for file in saved(png)])
    return files


def _drawn(folder: Path, table: ResultTable) -> list[Path]:
    table = of_worth(table)
    names, keys = main_quantities(table), numeric_inputs(table)
    files: list[Path] = []
    if not names or not table.done:
        return files
    for key in keys:
        files.append(folder / f"lines-{key}.png")
        draw_lines(files[-1], table, names, key)
    for x, y in itertools.combinations(keys, 2):
        if grid_of(table, x, y) is not None:
            files.append(folder / f"map-{x}-{y}.png")
            draw_map(files[-1], table, names, x, y)
    if any(pairs_of(table)):
        files.append(folder / "trade-off.png")
        draw_trade_off(files[-1], table)
    return files


def of_worth(table: ResultTable) -> ResultTable:
    """The table without void answers, which say nothing."""
    return ResultTable([one for one in table.entries if one.reason != VOID], table.targets)
