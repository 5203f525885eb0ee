"""``wakeflow verify extremes``: all rows of the stability matrix, as a report, as tables and as Markdown."""

from __future__ import annotations

import datetime
import json
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.files import atomic_write, write_json
from ...pipeline.compilation import compile_tracker
from . import airflows, contacts, granules, scenes  # noqa: F401 - they register rows
from .matrix import ERROR_UNITS, MISSED, extremes, fly_extreme

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["extreme_tables", "extremes_markdown", "run_extremes"]

Tell = Callable[[str], None]
Row = dict[str, Any]
HEAD = ("extreme", "what happened", "error", "allowed", "of", "against", "steps", "seconds", "verdict")
REFUSALS = ("refused", "with the number that says why")


def run_extremes(folder: Path, *, slow: bool, tell: Tell) -> dict[str, Any]:
    """Fly every row, with ``slow`` those of minutes too; ``extremes.json`` and ``extremes.md`` in ``folder`` hold the
    report. A row that is missed does not keep the others from being flown; ``missed`` names them.
    """
    compile_tracker()  # before anything is timed
    chosen = [name for name in extremes if slow or not extremes[name].slow]
    chosen.sort(key=_place)
    rows = []
    for done, name in enumerate(chosen):
        tell(f"{done + 1} of {len(chosen)}: {name}")
        rows.append(fly_extreme(name))
    left = len(extremes) - len(chosen)
    report: dict[str, Any] = {
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "rows": rows,
        "missed": [f"{row['name']}: {row['why']}" for row in rows if row["verdict"] == MISSED],
        "notes": [f"{unit}: {meaning}" for unit, meaning in ERROR_UNITS.items()]
        + [f"{row['name']}: {row['stops']}" for row in rows if row["stops"]]
        + [f"{row['name']}: {row['note']}" for row in rows if row["note"]]
        + ([f"{left} more rows take minutes: wakeflow verify extremes --slow"] if left else []),
    }
    report["notes"] += [f"MISSED {why}" for why in report["missed"]]
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "extremes.json", json.loads(json.dumps(report)))
    with atomic_write(folder / "extremes.md") as stream:
        stream.write(extremes_markdown(report))
    return report


def _place(name: str) -> int:
    """Rows of a group stand together, in the order in which the groups were registered."""
    groups = list(dict.fromkeys(extremes[one].group for one in extremes))
    return groups.index(extremes[name].group)


def extreme_tables(report: dict[str, Any]) -> list[Table]:
    """What was computed, and what is refused."""
    from rich.table import Table

    tables = []
    for title, head, cells in _grids(report["rows"]):
        table = Table(*head, title=title, title_justify="left", pad_edge=False, box=None)
        for row in cells:
            table.add_row(*row)
        tables.append(table)
    return tables


def extremes_markdown(report: dict[str, Any]) -> str:
    """The same as Markdown, with the notes."""
    lines = [f"{report['date']}, {report['machine']}", ""]
    for _, head, cells in _grids(report["rows"]):
        grid = [head, ["---"] * len(head), *cells]
        lines += [*(f"| {' | '.join(line)} |" for line in grid), ""]
    lines += [f"- {note}" for note in report["notes"]]
    return "\n".join(lines) + "\n"


def _grids(rows: Iterable[Row]) -> list[tuple[str, Sequence[str], list[list[str]]]]:
    """Title, head and cells of each table."""
    flown = [row for row in rows if not (row["refusal"] and not row["why"])]
    refused = [row for row in rows if row["refusal"] and not row["why"]]
    return [
        ("stability matrix: what happened at the ends of what can be asked for", HEAD, [_cells(row) for row in flown]),
        ("what is refused", REFUSALS, [[row["name"], row["refusal"]] for row in refused]),
    ]


def _cells(row: Row) -> list[str]:
    happened = ", ".join(f"{number} {fate}" for fate, number in row["fates"].items()) or "–"
    error, allowed, steps = row["error"], row["allowed"], row["steps"]
    return [
        f"{row['name']}{' (slow)' if row['slow'] else ''}", happened, "–" if error is None else f"{error:.1e}",
        "–" if allowed is None else f"{allowed:.2g}", row["unit"] if row["against"] else "–", row["against"] or "–",
        "–" if steps is None else f"{steps:.0f}", f"{row['seconds']:.2g}",
        row["verdict"].upper() if row["verdict"] == MISSED else row["verdict"],
    ]  # fmt: skip
