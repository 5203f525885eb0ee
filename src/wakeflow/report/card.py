"""Answers in a few lines of HTML, as a notebook shows them below a cell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

from ..results.table import DONE
from .many import main_quantities
from .words import NO_VALUE, expected, holds, percent

if TYPE_CHECKING:
    from ..results.landing_results import Separation
    from ..results.result import Result
    from ..results.table import ResultTable

__all__ = ["result_card", "table_card"]

TOLD = 3  # warnings, the gravest
ROWS = 50  # of a table; all are in its frame


def result_card(result: Result) -> str:
    """The shares of a finished run with their intervals, bold in a fraction's targets; the gravest warnings; links to
    the report.
    """
    warnings = "".join(f"<li>{escape(text)}</li>" for text in result.warnings[:TOLD])
    told = f"<ul>{warnings}</ul>" if warnings else ""
    page = result.folder / "report.html"
    more = f'<a href="{escape(str(page))}">{escape(str(page))}</a>' if page.exists() else escape(str(result.folder))
    if result.landings is None:
        return f"<p>no shares: the run ended after {escape(str(result.options.until))}</p>{told}{more}"
    table = "".join(_rows(result, result.landings.separation))
    return f"<table>{table}</table><small>{escape(holds(result))}</small>{told}{more}"


def table_card(table: ResultTable) -> str:
    """A row a scene: its inputs, and what the table is made for, in percent with 95 % intervals."""
    names = main_quantities(table)
    inputs = [f"{key} ({unit})" if unit else key for key, unit in table.inputs.items()]
    rows = [_row("th", [escape(head) for head in ("scene", *inputs, *(f"{name}, %" for name in names))])]
    for entry in table.entries[:ROWS]:
        found = (entry.by_name.get(name) for name in names)
        numbers = [percent(one) for one in found]
        asked = [escape(f"{entry.inputs.get(key, NO_VALUE)}") for key in table.inputs]
        rows.append(_row("td", [escape(entry.name), *asked, *(numbers if entry.state == DONE else [entry.state])]))
    more = len(table.entries) - ROWS
    return f"<table>{''.join(rows)}</table>" + (f"<small>{more} more in .frame()</small>" if more > 0 else "")


def _rows(result: Result, separation: Separation) -> Iterator[str]:
    yield _row("th", ["% of its mass", *map(escape, separation.fractions), "kg/h", "purity"])
    for place in separation.bins:
        shares = [
            f"<b>{percent(places[place])}</b>" if place in result.targets(name) else percent(places[place])
            for name, places in separation.fractions.items()
        ]
        pure = "<br>".join(f"{escape(name)} {percent(one)}" for name, one in expected(result, place)) or NO_VALUE
        yield _row("td", [escape(place), *shares, f"{separation.throughput[place]:.3g}", pure])
    yield _row("td", ["recovery", *(percent(separation.recovery.get(name)) for name in separation.fractions), "", ""])


def _row(kind: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{kind}>{cell}</{kind}>' for cell in cells)}</tr>"
