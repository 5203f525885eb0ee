"""The reports of ``wakeflow verify`` as tables, for a terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "airflow_markdown",
    "airflow_tables",
    "goal_table",
    "markdown",
    "mesh_tables",
    "problem_table",
    "row_tables",
    "share_table",
]


COLUMNS = (
    "method", "setting", "median", "95 %", "own", "us/granule", "CPU us", "granules/s", "steps", "M stages/s/core",
    "others %", "bin share %",
)  # fmt: skip
AIRFLOW = (
    "case", "rung", "quantity", "published", "ours", "95 % or mesh error", "deviation %", "gate", "met", "order",
    "cells", "core-s", "date", "status", "source",
)  # fmt: skip
MOMENTUM = ("case", "front Cp: 2 cos^2 beta", "computed", "base Cp", "Cd by momentum", "computed", "ratio")
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
    """The goals, what was measured, and whether they are met."""
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
    """Every exact problem at every tolerance: error, observed order, and how the stated error compares with the actual
    one.
    """
    from rich.table import Table

    table = Table("problem", "tolerance", "error (m)", "steps", "order", "expected", "error / tolerance",
                  title="exact problems, worst granule", title_justify="left", pad_edge=False, box=None)  # fmt: skip
    for row in report["rows"]:
        order = "–" if row["order"] is None else f"{row['order']:.2f}"
        expected = "–" if row["expected_order"] is None else f"{row['expected_order']:g}"
        table.add_row(row["problem"], f"{row['tolerance']:.0e}", f"{row['error']:.1e}", f"{row['steps']:.0f}", order,
                      expected, f"{row['ratio']:.1e}")  # fmt: skip
    return table


def mesh_tables(report: dict[str, Any]) -> list[Table]:
    """One table a flow: cost and error of each meshing strategy."""
    from rich.table import Table

    tables = []
    for flow, found in report["flows"].items():
        title = f"{flow}: relative errors of steady airflows against core-seconds"
        table = Table("strategy", "cells", "core-s", "Cd", "base Cp", "reversal length", title=title,
                      title_justify="left", pad_edge=False, box=None)  # fmt: skip
        for row in found["rows"]:
            errors = (f"{100 * row[f'{name}_error']:.2g} %" for name in ("cd", "cp_base", "reversal"))
            table.add_row(row["strategy"], str(row["cells"]), f"{row['seconds']:.1f}", *errors)
        tables.append(table)
    return tables


def share_table(report: dict[str, Any]) -> Table:
    """Bin shares by this tracker and by OpenFOAM's parcels, %."""
    from rich.table import Table

    title = f"bin shares of {report['granules']} granules a fraction, %, with 95 % intervals"
    table = Table("fraction", "bin", "ours, a run's field", "ours, OpenFOAM's interpolant", "OpenFOAM", "difference",
                  "without contacts", title=title, title_justify="left", pad_edge=False, box=None)  # fmt: skip
    for column in table.columns[2:]:
        column.justify = "right"
    for row in report["rows"]:
        shares = (_measured(row[key]) for key in ("own", "same", "peer", "difference", "free"))
        table.add_row(row["fraction"], row["place"], *shares)
    return table


def _measured(row: Sequence[float] | None) -> str:
    return "–" if row is None else f"{row[0]:.2f} ± {0.5 * (row[2] - row[1]):.2f}"


def airflow_tables(report: dict[str, Any]) -> list[Table]:
    """Published and computed airflow, and the momentum model beside it."""
    from rich.table import Table

    tables = []
    for title, head, rows in (
        ("airflow: published and computed", AIRFLOW[:-1], [_airflow_cells(row)[:-1] for row in report["rows"]]),
        ("the momentum model beside the computed airflow", MOMENTUM, map(_momentum_cells, report["momentum"])),
    ):
        table = Table(*head, title=title, title_justify="left", pad_edge=False, box=None)
        for row in rows:
            table.add_row(*row)
        tables.append(table)
    return tables


def airflow_markdown(report: dict[str, Any]) -> str:
    """The same as Markdown, with the sources."""
    lines = [f"{report['date']}, {report['machine']}", ""]
    lines += [*_grid(AIRFLOW, map(_airflow_cells, report["rows"])), ""]
    lines += [*_grid(MOMENTUM, map(_momentum_cells, report["momentum"])), ""]
    lines += [f"- {note}" for note in report["notes"]]
    lines += [f"failed: {failure['case']}: {failure['why']}" for failure in report["failed"]]
    return "\n".join(lines)


def _airflow_cells(row: dict[str, Any]) -> list[str]:
    def percent(value: float | None, signed: bool = False) -> str:
        if value is None:
            return "–"
        digits = ".0f" if abs(value) >= 0.995 else ".2g"
        return f"{100 * value:{'+' if signed else ''}{digits}}"

    theirs = "–" if row["theirs"] is None else " to ".join(f"{value:.5g}" for value in dict.fromkeys(row["theirs"]))
    band = "–" if row["low"] is None else f"{row['low']:.4g} to {row['high']:.4g}"
    return [
        row["title"], row["rung"], row["quantity"], theirs, "–" if row["ours"] is None else f"{row['ours']:.4g}",
        band, percent(row["deviation"], True), row["gate"],
        {None: "–", True: "yes", False: "NO"}[row["met"]], "–" if row["order"] is None else f"{row['order']:.2f}",
        str(row["cells"]), f"{row['core_seconds']:.0f}", row["date"], row["status"] or "–",
        "; ".join(filter(None, (row["source"], row["why"] and f"reported: {row['why']}"))) or "–",
    ]  # fmt: skip


def _momentum_cells(row: dict[str, Any]) -> list[str]:
    names = ("cp_model", "cp_computed", "cp_base", "cd_model", "cd_computed")
    return [row["title"], *(f"{row[name]:.2f}" for name in names), f"{row['cd_model'] / row['cd_computed']:.2f}"]
