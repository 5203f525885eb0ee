"""The report of ``wakeflow verify tracker`` as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["goal_table", "markdown", "problem_table", "row_tables"]


COLUMNS = (
    "method", "setting", "median", "95 %", "own", "us/granule", "CPU us", "granules/s", "steps", "M stages/s/core",
    "others %", "bin share %",
)  # fmt: skip
GOALS = ("goal", "wanted", "reached", "met", "note")
TITLE = "landing error in body widths against run time"


def row_tables(report: dict[str, Any]) -> list[Table]:
    """One table a kind of granule and airflow."""
    from rich.table import Table

    tables = []
    groups = dict.fromkeys((row["kind"], row["air"]) for row in report["rows"])
    for kind, air in groups:
        table = Table(*COLUMNS, title=f"{kind}, {air}: {TITLE}", title_justify="left", pad_edge=False, box=None)
        for column in table.columns[2:]:
            column.justify = "right"
        for row in report["rows"]:
            if (row["kind"], row["air"]) == (kind, air):
                table.add_row(*_cells(row))
        tables.append(table)
    return tables


def _cells(row: dict[str, Any]) -> list[str]:
    rate = row["evaluation_rate"]
    return [
        row["method"],
        row["setting"],
        _small(row["median"]),
        _small(row["p95"]),
        _small(row["own_median"]),
        f"{1e6 * row['seconds']:.3g}",
        f"{1e6 * row['cpu']:.3g}",
        f"{1 / row['seconds']:.3g}",
        "–" if row["steps"] is None else f"{row['steps']:.0f}",
        "–" if rate is None else f"{rate / 1e6:.1f}",
        f"{100 * row['others']:.1f}",
        f"{100 * row['bin_error']:.2f}",
    ]


def _small(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}"


def goal_table(report: dict[str, Any]) -> Table:
    """What was to be reached and what was."""
    from rich.table import Table

    table = Table(*GOALS, title="to reach, and reached", title_justify="left", pad_edge=False, box=None)
    for goal in report["goals"]:
        table.add_row(*_goal_cells(goal))
    return table


def _goal_cells(goal: dict[str, Any]) -> list[str]:
    reached = "–" if goal["reached"] is None else f"{goal['reached']:.3g} {goal['unit']}".strip()
    return [goal["what"], goal["wanted"], reached, "yes" if goal["met"] else "NO", goal["note"]]


def markdown(report: dict[str, Any]) -> str:
    """The same tables as Markdown."""
    lines = [f"{report['date']}, {report['machine']}, load {report['load']:.1f}", ""]
    for kind, air in dict.fromkeys((row["kind"], row["air"]) for row in report["rows"]):
        rows = [row for row in report["rows"] if (row["kind"], row["air"]) == (kind, air)]
        lines += [f"### {kind}, {air}", "", *_grid(COLUMNS, map(_cells, rows)), ""]
    lines += ["### To reach, and reached", "", *_grid(GOALS, map(_goal_cells, report["goals"])), ""]
    return "\n".join(lines)


def _grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def problem_table(report: dict[str, Any]) -> Table:
    """Every exact problem at every tolerance: error, observed order, what the stated error is worth."""
    from rich.table import Table

    table = Table("problem", "tolerance", "error (m)", "steps", "order", "expected", "error / tolerance",
                  title="exact problems, worst granule", title_justify="left", pad_edge=False, box=None)  # fmt: skip
    for row in report["rows"]:
        order = "–" if row["order"] is None else f"{row['order']:.2f}"
        expected = "–" if row["expected_order"] is None else f"{row['expected_order']:g}"
        table.add_row(row["problem"], f"{row['tolerance']:.0e}", f"{row['error']:.1e}", f"{row['steps']:.0f}", order,
                      expected, f"{row['ratio']:.1e}")  # fmt: skip
    return table
