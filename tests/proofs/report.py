"""Reports of the proofs and studies: rows under heads, to a terminal, as JSON and as Markdown, and their numbers.

A proof is a function ``run(slow=..., tell=...) -> Report``. Its tables are rows under columns that are templates of a
cell: ``Table("title", {"drag": "{cd:.3f}", "error %": "{error:.2g*100}"}, rows)``. A row is a mapping from names to
values; by these names where a proof has them: ``case``, ``quantity``, ``value`` with its 95 % interval ``low`` to
``high``, ``expected``, ``gate`` (what is asked, in words), ``met``, ``seconds``, ``source``.

A row is a mapping from names to values. A column is a head with a template, or a function of the row, that makes the
text of its cell: ``"{error:.1e}"``. What is None is shown as a dash; ``{share:.2f*100}`` multiplies by 100 first, and
``{met:yes|NO}`` chooses a word.
"""

from __future__ import annotations

import datetime
import os
import platform
import string
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from wakeflow.core.files import atomic_write, write_json
from wakeflow.core.number import student
from wakeflow.core.record import JsonMapping, JsonTable, to_json

if TYPE_CHECKING:
    from rich.console import Console

Row = JsonMapping
Tell = Callable[[str], None]
Column = str | Callable[[Row], str]
NOTHING = "–"
FOLDER = Path("runs", "verify")
WIDE = 150  # columns of a table that goes into a file


class _Words(string.Formatter):
    """Formats one value; see the module's text."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if value is None:
            return NOTHING
        if "|" in format_spec:
            return format_spec.split("|")[0 if value else 1]
        if "*" in format_spec:
            format_spec, factor = format_spec.split("*")
            value = value * float(factor)
        return str(super().format_field(value, format_spec))


def cell(column: Column, row: Row) -> str:
    """The text of a row in a column."""
    return _Words().vformat(column, (), row) if isinstance(column, str) else column(row)


@dataclass(frozen=True)
class Table:
    """Rows under heads: ``columns`` by head."""

    title: str
    columns: Mapping[str, Column]
    rows: Sequence[Row]

    def cells(self) -> list[list[str]]:
        """The text of every cell."""
        return [[cell(column, row) for column in self.columns.values()] for row in self.rows]

    def markdown(self) -> str:
        """The table with its title above it."""
        lines = [list(self.columns), ["---"] * len(self.columns), *self.cells()]
        return "\n".join([f"### {self.title}", "", *(f"| {' | '.join(line)} |" for line in lines), ""])

    def show(self, console: Console) -> None:
        """Print it; numbers to the right."""
        from rich.table import Table as RichTable

        found = self.cells()
        drawn = RichTable(title=self.title, title_justify="left", pad_edge=False, box=None)
        for number, head in enumerate(self.columns):
            numbers = all(line[number][:1] in "0123456789+-–" for line in found)
            drawn.add_column(head, justify="right" if numbers else "left")
        for line in found:
            drawn.add_row(*line)
        console.print(drawn, "")


@dataclass(frozen=True)
class Report:
    """What a proof found: its ``tables``, the ``facts`` that its JSON file holds, notes, and what was ``missed``."""

    name: str
    tables: Sequence[Table]
    facts: JsonMapping
    notes: Sequence[str] = ()
    missed: Sequence[str] = ()
    date: str = field(default_factory=lambda: datetime.datetime.now().astimezone().isoformat(timespec="seconds"))

    def data(self) -> JsonTable:
        """The JSON file's content."""
        machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
        head = {"date": self.date, "machine": machine, "load": os.getloadavg()[0]}
        whole = {**head, **self.facts, "notes": list(self.notes), "missed": list(self.missed)}
        return dict(to_json(whole))

    def markdown(self) -> str:
        """All tables, then the notes."""
        data = self.data()
        head = f"{data['date']}, {data['machine']}, load {data['load']:.1f}"
        return "\n".join([head, "", *(table.markdown() for table in self.tables), *(f"- {n}" for n in self._said())])

    def write(self, folder: Path) -> Report:
        """Write ``NAME.json`` and ``NAME.md`` into ``folder``; returns itself."""
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / f"{self.name}.json", self.data())
        with atomic_write(folder / f"{self.name}.md") as stream:
            stream.write(self.markdown() + "\n")
        return self

    def show(self, console: Console) -> None:
        """Print tables and notes, and where the files are."""
        for table in self.tables:
            table.show(console)
        for note in self._said():
            console.print(note, highlight=False)
        console.print(f"report: {FOLDER / self.name}.json", highlight=False, soft_wrap=True)

    def _said(self) -> list[str]:
        return [*self.notes, *(f"MISSED {why}" for why in self.missed)]


Interval = tuple[float, float, float]  # value, low, high


def mean_interval(values: ArrayLike, least: float = 0.0) -> Interval:
    """Mean of independent ``values`` and its 95 % interval by Student's t, whose half width is ``least`` at least."""
    found = np.asarray(values, dtype=float)
    value, half = float(found.mean()), least
    if len(found) > 1:
        half = max(half, student(len(found) - 1) * float(found.std(ddof=1)) / np.sqrt(len(found)))
    return value, value - half, value + half


def plus_minus(key: str, digits: int = 2, factor: float = 1.0) -> Column:
    """The column of an interval ``key`` of rows, as its value and half width; a dash where there is none."""

    def text(row: Row) -> str:
        if row[key] is None:
            return NOTHING
        value, low, high = (factor * number for number in row[key])
        return f"{value:.{digits}f} ± {0.5 * (high - low):.{digits}f}"

    return text
