"""docs/validation.md, made of the records of the proofs: ``python tests/proofs/validation_page.py``.

A record, ``tests/proofs/records/NAME.toml``, holds what a command printed: the command, the date, its tables, notes on
them, and the claim that the page prints. ``python tests/proofs/validation_page.py NAME runs/verify/REPORT.md`` puts the
tables and the date of a new report in place of the old ones; read the claim and the notes again then.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from textwrap import fill
from typing import Any

ROOT = Path(__file__).parents[2]
RECORDS = Path(__file__).with_name("records")
PAGE = ROOT / "docs" / "validation.md"
CHAPTERS = ("granules", "air", "runs")
HEADINGS = {"granules": "Granules in flight", "air": "The airflow", "runs": "Whole runs"}
ABOUT = """\
# Validation

Every claim of this page is a record of a proof: what its command printed, and when. Computed numbers are next to exact
ones, to other programs' and to measured ones; what is missed is said. The tables, how they were made and why something
is missed are in `tests/proofs/records/`, one file a section. `wakeflow verify` writes a new report to `runs/verify`, a
study prints its tables. Most were computed on a shared machine; times are of processors. This page is written by
`python tests/proofs/validation_page.py`.
"""


def records() -> dict[str, dict[str, Any]]:
    """Every record by its name."""
    return {path.stem: tomllib.loads(path.read_text()) for path in sorted(RECORDS.glob("*.toml"))}


def record_of(section: str) -> dict[str, Any]:
    """The record under a heading of the page."""
    (found,) = (record for record in records().values() if record["section"] == section)
    return found


def page() -> str:
    """The page: a heading a record, its claim, where it is from."""
    parts = [ABOUT]
    known = records()
    for chapter in CHAPTERS:
        parts.append(f"## {HEADINGS[chapter]}\n")
        for name, record in known.items():
            if record["chapter"] == chapter:
                source = f"(`{record['command']}`, {record['date']}, `tests/proofs/records/{name}.toml`)"
                text = fill(f"{record['claim']} {source}", 120, break_long_words=False, break_on_hyphens=False)
                parts.append(f"### {record['section']}\n\n{text}\n")
    return "\n".join(parts)


def text_of(record: dict[str, Any]) -> str:
    """A record as its file."""
    keys = ("section", "chapter", "command", "date", "claim")
    lines = [*(f"{key} = {_quoted(record[key])}" for key in keys), f"notes = '''\n{record['notes'].strip()}\n'''"]
    for table in record.get("table", ()):
        lines += ["", "[[table]]", f"title = {_quoted(table['title'])}", f"head = {_listed(table['head'])}", "rows = ["]
        lines += [*(f"  {_listed(row)}," for row in table["rows"]), "]"]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _listed(cells: list[str]) -> str:
    return f"[{', '.join(map(_quoted, cells))}]"


def with_report(record: dict[str, Any], report: str) -> dict[str, Any]:
    """A record with the tables and the date of a report that ``wakeflow verify`` wrote as Markdown."""
    tables = []
    for title, lines in re.findall(r"^### (.+)\n\n((?:\|.*\n)+)", report, re.MULTILINE):
        head, _, *rows = ([cell.strip() for cell in line[1:-1].split("|")] for line in lines.splitlines())
        tables.append({"title": title, "head": head, "rows": rows})
    return record | {"date": report[:10], "table": tables}


if __name__ == "__main__":
    if len(sys.argv) == 3:
        kept = RECORDS / f"{sys.argv[1]}.toml"
        kept.write_text(text_of(with_report(records()[kept.stem], Path(sys.argv[2]).read_text())))
    PAGE.write_text(page())
