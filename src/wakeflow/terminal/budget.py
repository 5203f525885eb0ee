"""The table of the budget: the largest known errors, and what is unknown."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from ..report.words import NO_VALUE, TERMS, budget_columns, condensed, error_text, source_seconds
from ..results.landing_results import SHARE_UNIT, BudgetRow

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["budget_table"]

WEIGHS, MOST_PARTS = 0.1, 4  # of the largest error of a quantity, and how many errors are told on screen
SHORTEST = 0.5  # s: shorter run times are not worth a word


def budget_table(budget: Sequence[BudgetRow]) -> Table:
    """The largest known errors of every quantity, the run time that knowing each source took, and what is unknown."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    rows = condensed(budget)
    known = {part.source for row in rows for part in row.parts if part.error is not None}
    title = "budget: the largest errors, of shares in percentage points (all: budget.csv)"
    table = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
    table.add_column("quantity", no_wrap=True)
    table.add_column("what limits it")
    totals = any(row.total.error is not None for row in rows)  # else the note says why not
    if totals:
        table.add_column("total", justify="right")
    for row in rows:
        unit = "" if row.measure == SHARE_UNIT else f" ({row.measure})"
        total = [_bare(row, row.total.error)] if totals else []
        table.add_row(row.quantity.removeprefix("share.") + unit, _largest(row), *total)
    table.caption, table.caption_justify = _budget_notes(rows, known), "left"
    return table


def _largest(row: BudgetRow) -> str:
    """The largest errors of a quantity in words, those that weigh beside the largest."""
    parts = sorted((part for part in row.parts if part.error), key=lambda part: -(part.error or 0.0))
    if not parts:
        return NO_VALUE
    weighing = [part for part in parts if (part.error or 0.0) >= WEIGHS * (parts[0].error or 0.0)][:MOST_PARTS]
    return ", ".join(f"{part.source} {_bare(row, part.error)}" for part in weighing)


def _budget_notes(rows: Sequence[BudgetRow], known: Collection[str]) -> str | None:
    """Which terms stand behind each sum of terms, and which sources are unknown."""
    notes: dict[str, None] = {}  # in order, each once
    for row in rows:
        for part in row.parts:
            if part.source in TERMS.values():
                notes[f"{row.quantity.split('.')[1]}, {part.source}: {part.note}"] = None
    cost = {source: spent for source, spent in source_seconds(rows).items() if spent >= SHORTEST}
    if cost:
        notes[f"run time, s: {', '.join(f'{source} {spent:.0f}' for source, spent in cost.items())}"] = None
    if unknown := [source for source in budget_columns(rows) if source not in known]:
        notes[f"unknown, so that no total is claimed: {', '.join(unknown)}"] = None
    return "\n".join(notes) or None


def _bare(row: BudgetRow, error: float | None) -> str:
    """An error without its unit, for a table that names it elsewhere."""
    return error_text(row, error).removesuffix(f" {row.measure}")
