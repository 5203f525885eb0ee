"""Tables of a result: CSV files whose columns carry units, and what the terminal shows.

``result`` is everywhere the dict that result.json holds; shares are of a fraction's mass, purities of a bin's mass.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import atomic_write

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "BUDGET_COLUMNS",
    "IMPACT_COLUMNS",
    "SEPARATION_COLUMNS",
    "budget_rows",
    "budget_sources",
    "budget_table",
    "condensed",
    "error_text",
    "expected",
    "impact_rows",
    "percent",
    "separation_rows",
    "separation_table",
    "source_seconds",
    "targets",
    "write_budget_csv",
    "write_impact_csv",
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
IMPACT_COLUMNS = (  # normal: into the slope; tangential: down it; power: from the vibration to the stream
    "fraction",
    "slope",
    "mass flow (kg/h)",
    "fall speed (m/s)",
    "normal force (N)",
    "tangential force (N)",
    "power (W)",
    "speed after, x (m/s)",
    "speed after, y (m/s)",
)
ALL = "all"  # in a table of impacts: all fractions, or all slopes
SLOPES = 6  # of a body with more of them only all together are shown
KINDS = {"left-out": "terms left out", "not-computed": "terms not computed"}  # in a budget's table
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


def impact_rows(result: Result) -> list[dict[str, Any]]:
    """One row a fraction and slope, keys as IMPACT_COLUMNS, then all fractions together; of a body with many slopes one
    row for all of them. Nothing where no granule falls on a body.
    """
    table = result.get("impact")
    if not table or not table["total"]["mass_flow"]:
        return []
    every, total = [*table["fractions"].items(), (ALL, table)], {**table["total"], "fall_speed": None}
    rows = []
    for name, part in every:
        slopes = {ALL: total if name == ALL else part["total"]} if len(table["slopes"]) > SLOPES else part["slopes"]
        for slope, row in slopes.items():
            if row["mass_flow"]:
                numbers = [row.get("fall_speed"), row["normal"], row["tangential"], row["power"], *row["velocity"]]
                cells = [name, slope, 3600.0 * row["mass_flow"], *numbers]
                rows.append(dict(zip(IMPACT_COLUMNS, cells, strict=True)))
    return rows


def write_impact_csv(path: Path | str, result: Result) -> None:
    """Write :func:`impact_rows`; empty cells where nothing is known."""
    _write_csv(path, IMPACT_COLUMNS, impact_rows(result))


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
    """Bins by fractions: shares in percent with half their 95 % interval; throughput, purity, recovery."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    separation = result["separation"]
    fractions = separation["fractions"]
    title = "share of each fraction's mass, %, with 95 % interval"
    table = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
    table.add_column("bin")
    for name in fractions:
        table.add_column(name, justify="right")
    table.add_column("kg/h", justify="right")
    table.add_column("purity", justify="right")
    for place in separation["bins"]:
        cells = [
            Text(percent(places[place]), style="bold green" if place in targets(result, name) else "")
            for name, places in fractions.items()
        ]
        purest = "\n".join(f"{name} {percent(row)}" for name, row in expected(result, place)) or NONE
        table.add_row(place, *cells, f"{separation['throughput'][place]:.3g}", purest)
    table.add_section()
    table.add_row("recovery", *(percent(separation["recovery"].get(name)) for name in fractions), "", "")
    return table


def expected(result: Result, place: str) -> list[tuple[str, Mapping[str, Any]]]:
    """Whose purity matters in a bin: the fractions that have it as target, else the one that makes up most of it."""
    purity = result["separation"]["purity"].get(place)
    if not purity:
        return []
    wanted = [(name, row) for name, row in purity.items() if place in targets(result, name)]
    return wanted or [max(purity.items(), key=lambda item: item[1]["value"])]


def budget_table(result: Result) -> Table:
    """The known errors of every quantity, the run time that knowing them took, and below it what is unknown."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    result = {**result, "budget": condensed(result["budget"])}
    errors = {
        s: [p["error"] for e in result["budget"] for p in e["parts"] if p["source"] == s]
        for s in budget_sources(result)
    }
    sources = [source for source, found in errors.items() if any(error is not None for error in found)]
    unknown = [source for source in errors if source not in sources]
    title = "budget: error of each share, percentage points"
    table = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
    if any(_unit(entry) != POINTS for entry in result["budget"]):
        table.title = "budget: errors, of shares in percentage points"
    table.add_column("quantity", no_wrap=True)
    totals = any(entry["total"]["error"] is not None for entry in result["budget"])  # else the note says why not
    for source in [*sources, "total"] if totals else sources:
        table.add_column(source.replace("-", "-\n"), justify="right", overflow="fold")
    for entry in result["budget"]:
        parts = {part["source"]: part["error"] for part in entry["parts"]}
        cells = [_bare(entry, parts[source]) if source in parts else NONE for source in sources]
        unit = "" if _unit(entry) == POINTS else f"\n({_unit(entry)})"
        total = [_bare(entry, entry["total"]["error"])] if totals else []
        table.add_row(entry["quantity"].removeprefix("share.") + unit, *cells, *total)
    if result["budget"]:
        table.add_section()
        cost = source_seconds(result)
        table.add_row("run time (s)", *(_seconds(cost[source]) for source in sources))
    notes = dict.fromkeys(_term_notes(result))
    if unknown:
        notes[f"unknown, so that no total is claimed: {', '.join(unknown)}"] = None
    table.caption, table.caption_justify = "\n".join(notes) or None, "left"
    return table


def _term_notes(result: Result) -> Iterator[str]:
    """Which terms stand behind the parts that :func:`condensed` made, for each fraction."""
    for entry in result["budget"]:
        for part in entry["parts"]:
            if part["source"] in KINDS.values():
                fraction = entry["quantity"].split(".")[1]
                yield f"{fraction}, {part['source']}: {part['note']}"


def condensed(budget: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The budget with the terms that are left out added up: one part for those that were left out as small enough for
    the accuracy asked for, one for those that could matter and are not computed.
    """
    rows = []
    for entry in budget:
        parts = [part for part in entry["parts"] if "kind" not in part]
        for kind, title in KINDS.items():
            terms = [part for part in entry["parts"] if part.get("kind") == kind]
            if terms:
                names = ", ".join(part["source"] for part in terms)
                error = min(1.0, sum(part["error"] for part in terms))
                parts.append({**terms[0], "source": title, "error": error, "note": names})
        known = [part for part in parts if part["error"] is not None]
        rows.append({**entry, "parts": known + [part for part in parts if part["error"] is None]})
    return rows


def budget_sources(result: Result) -> list[str]:
    """Every source of error in the budget, in order of appearance."""
    return list(dict.fromkeys(part["source"] for entry in result["budget"] for part in entry["parts"]))


def error_text(entry: Mapping[str, Any], error: float | None) -> str:
    """An error as shown: percentage points for shares, the quantity's own unit otherwise."""
    if error is None:
        return UNKNOWN
    if _unit(entry) == POINTS:
        return "0" if error == 0 else f"{100 * error:.0f}" if error >= 0.1 else f"{100 * error:.2g}"
    return f"{error:.2g} {_unit(entry)}"


def _bare(entry: Mapping[str, Any], error: float | None) -> str:
    """An error without its unit, for a table that names it elsewhere."""
    return error_text(entry, error).removesuffix(f" {_unit(entry)}")


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
