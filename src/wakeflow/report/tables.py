"""Tables of a result: CSV files whose columns carry units, and what the terminal shows.

``result`` is everywhere the dict that result.json holds; shares are of a fraction's mass, purities of a bin's mass.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import atomic_write

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "BUDGET_COLUMNS",
    "SEPARATION_COLUMNS",
    "budget_rows",
    "budget_sources",
    "budget_table",
    "error_text",
    "expected",
    "percent",
    "separation_rows",
    "separation_table",
    "source_seconds",
    "targets",
    "write_budget_csv",
    "write_separation_csv",
]

Result = Mapping[str, Any]
SEPARATION_COLUMNS = (  # low and high: the 95 % interval
    "fraction",
    "bin",
    "share (%)",
    "share low (%)",
    "share high (%)",
    "purity (%)",
    "purity low (%)",
    "purity high (%)",
    "target",
    "bin throughput (kg/h)",
)
BUDGET_COLUMNS = ("quantity", "source", "error", "unit of error", "run time (s)", "how")
NONE = "–"
UNKNOWN = "unknown"
POINTS = "1"  # the unit of shares: fractions of 1 in result.json


def percent(row: Mapping[str, Any] | None) -> str:
    """``"62.1 ± 0.8"`` from a measured number in 0..1: percent and half its 95 % interval; a dash for none.

    The number of decimals follows the interval, so that it never shows as zero unless it is.
    """
    value = None if row is None else row.get("value", row.get("share"))
    if row is None or value is None:
        return NONE
    if row["low"] is None or row["high"] is None:
        return f"{100 * value:.1f}"
    half = 50.0 * (row["high"] - row["low"])
    digits = 1 if half <= 0 else min(4, max(1, -math.floor(math.log10(half))))
    return f"{100 * value:.{digits}f} ± {half:.{digits}f}"


def separation_rows(result: Result) -> list[dict[str, Any]]:
    """One row a fraction and bin, keys as SEPARATION_COLUMNS; None where a bin stays empty and has no purity."""
    separation = result["separation"]
    rows = []
    for name, places in separation["fractions"].items():
        for place, share in places.items():
            purity = (separation["purity"].get(place) or {}).get(name) or {}
            values = [share["share"], share["low"], share["high"], *(purity.get(k) for k in ("value", "low", "high"))]
            numbers = [None if v is None else 100.0 * v for v in values]
            wanted = place in targets(result, name)
            cells = [name, place, *numbers, wanted, separation["throughput"][place]]
            rows.append(dict(zip(SEPARATION_COLUMNS, cells, strict=True)))
    return rows


def budget_rows(result: Result) -> list[dict[str, Any]]:
    """One row a quantity and source of error, keys as BUDGET_COLUMNS, and the total; None where unknown."""
    rows = []
    for entry in result["budget"]:
        parts = [*entry["parts"], {"source": "total", "how": "", **entry["total"]}]
        for part in parts:
            cells = [entry["quantity"], part["source"], part["error"], _unit(entry), part["seconds"], part["how"]]
            rows.append(dict(zip(BUDGET_COLUMNS, cells, strict=True)))
    return rows


def write_separation_csv(path: Path | str, result: Result) -> None:
    """Write :func:`separation_rows`; percent and kg/h, empty cells where nothing is known."""
    _write_csv(path, SEPARATION_COLUMNS, separation_rows(result))


def write_budget_csv(path: Path | str, result: Result) -> None:
    """Write :func:`budget_rows`; empty cells where nothing is known."""
    _write_csv(path, BUDGET_COLUMNS, budget_rows(result))


def _write_csv(path: Path | str, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    with atomic_write(path) as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: "" if v is None else _cell(v) for k, v in row.items()} for row in rows)


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.10g}" if isinstance(value, float) else value


# -- the terminal ------------------------------------------------------------------------------------------------------


def separation_table(result: Result) -> Table:
    """Fractions by bins: shares in percent with half their 95 % interval; recovery, purity, throughput."""
    from rich.table import Table
    from rich.text import Text

    separation = result["separation"]
    bins = separation["bins"]
    table = Table(title="share of each fraction's mass, %, with 95 % interval", title_justify="left", pad_edge=False)
    table.add_column("fraction")
    for place in bins:
        table.add_column(place, justify="right")
    table.add_column("recovery", justify="right")
    for name, places in separation["fractions"].items():
        wanted = targets(result, name)
        cells = [Text(percent(places[place]), style="bold green" if place in wanted else "") for place in bins]
        table.add_row(Text(name, style="bold"), *cells, percent(separation["recovery"].get(name)))
    table.add_section()
    purest = [expected(result, place) for place in bins]
    table.add_row("purity", *("\n".join(f"{n}\n{percent(row)}" for n, row in found) or NONE for found in purest), "")
    table.add_row("kg/h", *(f"{separation['throughput'][place]:.4g}" for place in bins), "")
    return table


def expected(result: Result, place: str) -> list[tuple[str, Mapping[str, Any]]]:
    """Whose purity matters in a bin: the fractions that have it as target, else the one that makes up most of it."""
    purity = result["separation"]["purity"].get(place)
    if not purity:
        return []
    wanted = [(name, row) for name, row in purity.items() if place in targets(result, name)]
    return wanted or [max(purity.items(), key=lambda item: item[1]["value"])]


def budget_table(result: Result) -> Table:
    """What each source of error contributes to every quantity, and the run time that knowing it took."""
    from rich.table import Table
    from rich.text import Text

    sources = budget_sources(result)
    table = Table(title="budget: error of each share, percentage points", title_justify="left", pad_edge=False)
    if any(_unit(entry) != POINTS for entry in result["budget"]):
        table.title = "budget: error of each number"
    table.add_column("quantity")
    for source in sources:
        table.add_column(source, justify="right")
    table.add_column("total", justify="right")
    for entry in result["budget"]:
        errors = {part["source"]: part["error"] for part in entry["parts"]}
        cells = [error_text(entry, errors[s]) if s in errors else NONE for s in sources]
        table.add_row(entry["quantity"], *(Text(c, style="dim" if c == UNKNOWN else "") for c in cells),
                      error_text(entry, entry["total"]["error"]))  # fmt: skip
    if result["budget"]:
        table.add_section()
        cost = source_seconds(result)
        table.add_row("run time (s)", *(_seconds(cost[s]) for s in sources), "")
    return table


def budget_sources(result: Result) -> list[str]:
    """Every source of error in the budget, in order of appearance."""
    return list(dict.fromkeys(part["source"] for entry in result["budget"] for part in entry["parts"]))


def error_text(entry: Mapping[str, Any], error: float | None) -> str:
    """An error as shown: percentage points for shares, the quantity's own unit otherwise."""
    if error is None:
        return UNKNOWN
    if _unit(entry) == POINTS:
        return "0" if error == 0 else f"{100 * error:.2g}"
    return f"{error:.2g} {_unit(entry)}"


def _unit(entry: Mapping[str, Any]) -> str:
    return str(entry.get("unit", POINTS))


def source_seconds(result: Result) -> dict[str, float | None]:
    """The run time (s) behind each source; the same run serves all quantities, so the largest counts."""
    spent: dict[str, float | None] = {}
    for entry in result["budget"]:
        for part in entry["parts"]:
            known = [s for s in (spent.get(part["source"]), part["seconds"]) if s is not None]
            spent[part["source"]] = max(known) if known else None
    return spent


def _seconds(value: float | None) -> str:
    return NONE if value is None else f"{value:.1f}"


def targets(result: Result, name: str) -> tuple[str, ...]:
    """The bins where a fraction should land; empty when the scene names none."""
    target = result["scene"]["fraction"].get(name, {}).get("target") or ()
    return (target,) if isinstance(target, str) else tuple(target)
