"""A result as tables: its CSV files, whose columns carry units, its shares in words, and the cards of notebooks.

Shares are of a fraction's mass, purities of a bin's mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..answer.table import DONE
from ..core.number import Number
from ..core.tables import Cell, CellTable
from .many import main_quantities
from .words import NO_VALUE, expected, holds, percent

if TYPE_CHECKING:
    from ..answer.result import Result
    from ..answer.shares import BudgetRow, Separation
    from ..answer.table import ResultTable
    from ..injection.impact_loads import ImpactForces, ImpactSummary

SEPARATION_COLUMNS = (  # low and high: the 95 % interval, of which computing alone makes a part
    "fraction", "bin", "share (%)", "share low (%)", "share high (%)", "share by computing alone (+- %)", "purity (%)",
    "purity low (%)", "purity high (%)", "target", "not in the interval", "bin throughput (kg/h)",
    "share without collisions (%)", "share without collisions low (%)", "share without collisions high (%)",
)  # fmt: skip
BUDGET_COLUMNS = ("quantity", "source", "error", "unit of error", "run time (s)", "how")
IMPACT_COLUMNS = (  # normal: into the slope; tangential: down it; power: from the vibration to the stream
    "fraction", "slope", "mass flow (kg/h)", "fall speed (m/s)", "normal force (N)", "tangential force (N)",
    "power (W)", "speed after, x (m/s)", "speed after, y (m/s)",
)  # fmt: skip
ALL = "all"  # in a table of impacts: all fractions, or all slopes
SLOPES = 6  # of a body with more of them only all together are shown
HOUR = 3600.0  # s
TOLD = 3  # warnings on a card, the gravest
ROWS = 50  # of a card's table; all are in its frame


def separation_cells(result: Result, separation: Separation) -> CellTable:
    """One row a fraction and bin: percent, kg/h; None where a bin stays empty and has no purity, and where granules met
    no others anyway.
    """
    rows: list[list[Cell]] = []
    alone = None if result.landings is None else result.landings.without_collisions
    lacking = {
        row.quantity: "; ".join(part.source for part in row.parts if part.error is None) for row in result.budget
    }
    for name, places in separation.fractions.items():
        for place, share in places.items():
            pure = (separation.purity.get(place) or {}).get(name)
            numbers = [*_ends(share), _percent(share.numerical), *_ends(pure)]
            missing = lacking.get(f"share.{name}.{place}", "")
            flow, single = separation.throughput[place], None if alone is None else alone.fractions[name][place]
            rows.append([name, place, *numbers, place in result.targets(name), missing, flow, *_ends(single)])
    return CellTable(SEPARATION_COLUMNS, rows)


def _ends(number: Number | None) -> list[float | None]:
    """A number and its interval in percent."""
    return [None] * 3 if number is None else [_percent(one) for one in (number.value, *number.ends)]


def _percent(number: float | None) -> float | None:
    return None if number is None else 100.0 * number


def budget_cells(budget: Sequence[BudgetRow]) -> CellTable:
    """One row a quantity and source of error, and the total; None where unknown."""
    rows: list[list[Cell]] = []
    for row in budget:
        parts = [(part.source, part.error, part.seconds, part.how) for part in row.parts]
        for source, error, seconds, how in [*parts, ("total", row.total.error, row.total.seconds, "")]:
            rows.append([row.quantity, source, error, row.measure, seconds, how])
    return CellTable(BUDGET_COLUMNS, rows)


def impact_cells(impact: ImpactSummary | None) -> CellTable:
    """One row a fraction and slope, then all fractions together; of a body with many slopes one row for all of them.
    No rows where no granule falls on a body.
    """
    rows: list[list[Cell]] = []
    if impact is not None and impact.total.mass_flow:
        whole = len(impact.slopes) > SLOPES
        for name, fraction in impact.fractions.items():
            streams = {ALL: fraction.total} if whole else fraction.slopes
            rows += [_impact(name, slope, one.fall_speed, one) for slope, one in streams.items()]
        slopes = {ALL: impact.total} if whole else impact.slopes
        rows += [_impact(ALL, slope, None, forces) for slope, forces in slopes.items()]
    return CellTable(IMPACT_COLUMNS, [row for row in rows if row[IMPACT_COLUMNS.index("mass flow (kg/h)")]])


def _impact(name: str, slope: str, fall_speed: float | None, forces: ImpactForces) -> list[Cell]:
    numbers = [fall_speed, forces.normal, forces.tangential, forces.power, *(forces.velocity or (None, None))]
    return [name, slope, HOUR * forces.mass_flow, *numbers]


def write_tables(folder: Path, result: Result) -> None:
    """Write separation.csv, budget.csv and impact.csv of what a result holds: percent, kg/h, empty where unknown."""
    if result.landings is not None:
        separation_cells(result, result.landings.separation).write_csv(folder / "separation.csv")
        budget_cells(result.landings.budget).write_csv(folder / "budget.csv")
    impacts = impact_cells(None if result.flights is None else result.flights.impact)
    if impacts.rows:
        impacts.write_csv(folder / "impact.csv")


# -- in words ----------------------------------------------------------------------------------------------------------


class BinWords(NamedTuple):
    """A bin in words: each fraction's share and whether it should land there, the throughput, whose purity matters."""

    place: str
    shares: list[tuple[str, bool]]
    flow: str
    purities: list[tuple[str, str]]


def bins_in_words(result: Result, separation: Separation) -> Iterator[BinWords]:
    """The shares of every bin, percent with 95 % interval; the recoveries last."""
    for place in separation.bins:
        shares = [(percent(places[place]), place in result.targets(n)) for n, places in separation.fractions.items()]
        pure = [(name, percent(found)) for name, found in expected(result, place)]
        yield BinWords(place, shares, f"{separation.throughput[place]:.3g}", pure or [("", NO_VALUE)])
    recoveries = [(percent(separation.recovery.get(name)), False) for name in separation.fractions]
    yield BinWords("recovery", recoveries, "", [])


def result_card(result: Result) -> str:
    """The shares of a finished run as HTML, with their intervals, bold in a fraction's targets; the gravest warnings;
    links to the report.
    """
    warnings = "".join(f"<li>{escape(text)}</li>" for text in result.warnings[:TOLD])
    told = f"<ul>{warnings}</ul>" if warnings else ""
    page = result.folder / "report.html"
    more = f'<a href="{escape(str(page))}">{escape(str(page))}</a>' if page.exists() else escape(str(result.folder))
    if result.landings is None:
        return f"<p>no shares: the run ended after {escape(str(result.options.until))}</p>{told}{more}"
    separation = result.landings.separation
    rows = [_row("th", ["% of its mass", *map(escape, separation.fractions), "kg/h", "purity"])]
    for one in bins_in_words(result, separation):
        shares = [f"<b>{share}</b>" if wanted else share for share, wanted in one.shares]
        pure = "<br>".join(f"{escape(name)} {share}".strip() for name, share in one.purities)
        rows.append(_row("td", [escape(one.place), *shares, one.flow, pure]))
    return f"<table>{''.join(rows)}</table><small>{escape(holds(result))}</small>{told}{more}"


def table_card(table: ResultTable) -> str:
    """A row a scene as HTML: its inputs, and what the table is made for, in percent with 95 % intervals."""
    names = main_quantities(table)
    rows = [_row("th", [escape(head) for head in ("scene", *table.headings, *(f"{name}, %" for name in names))])]
    for entry in table.entries[:ROWS]:
        numbers = [percent(entry.by_name.get(name)) for name in names] if entry.state == DONE else [entry.state]
        asked = [escape(f"{entry.inputs.get(key, NO_VALUE)}") for key in table.inputs]
        rows.append(_row("td", [escape(entry.name), *asked, *numbers]))
    more = len(table.entries) - ROWS
    return f"<table>{''.join(rows)}</table>" + (f"<small>{more} more in .frame()</small>" if more > 0 else "")


def _row(kind: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{kind}>{cell}</{kind}>' for cell in cells)}</tr>"
