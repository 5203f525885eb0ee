"""The figures that suit the inputs of a table of many results, drawn into its folder."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ..answer.result import VOID
from ..answer.result_table import ResultTable
from ..core import sums
from .canvas import saved
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
