"""One tidy table of many results: a row for each number of each scene, with its interval, its unit and the inputs."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import SceneError
from ..core.files import atomic_write
from ..core.frames import frame_of
from ..core.lazy import cached_property
from ..core.registry import did_you_mean
from ..scene.messages import unit_of
from .quantities import TableQuantity

__all__ = ["DONE", "FAILED", "OPEN", "Entry", "ResultTable", "cell_frame", "write_cells"]

DONE, FAILED, OPEN = "done", "failed", "open"
Cell = str | float | None
NUMBERS = ("value", "low", "high", "error", "numerical")


@dataclass(frozen=True)
class Entry:
    """One scene of a table: its ``inputs`` (SI), its ``state`` (done, failed or open), the ``reason`` why it failed, or
    what stands against the intervals of one that is done (:attr:`Result.caveat`), its numbers.
    """

    name: str
    inputs: Mapping[str, Any]
    state: str
    reason: str = ""
    quantities: tuple[TableQuantity, ...] = ()

    @cached_property
    def by_name(self) -> dict[str, TableQuantity]:
        """The numbers by their names."""
        return {one.name: one for one in self.quantities}


@dataclass(frozen=True)
class ResultTable:
    """The numbers of many scenes. Its rows do not depend on the order in which they were computed."""

    entries: Sequence[Entry]
    targets: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # bins where each fraction should land

    def __repr__(self) -> str:
        """How many scenes there are, and in what they differ."""
        over = f" over {', '.join(self.inputs)}" if self.inputs else ""
        return f"{len(self.done)} of {len(self.entries)} scenes done{over}"

    @cached_property
    def inputs(self) -> dict[str, str]:
        """The keys in which the scenes differ, and their units."""
        keys = dict.fromkeys(key for entry in self.entries for key in entry.inputs)
        return {key: unit_of(key) for key in keys}

    @cached_property
    def names(self) -> dict[str, str]:
        """The numbers that any scene has, and their units."""
        return {one.name: one.unit for entry in self.entries for one in entry.quantities}

    @cached_property
    def done(self) -> tuple[Entry, ...]:
        """The scenes that have numbers."""
        return tuple(entry for entry in self.entries if entry.state == DONE)

    @cached_property
    def caveats(self) -> dict[str, list[str]]:
        """The scenes that are done, by what stands against their intervals; those that nothing does are left out."""
        found: dict[str, list[str]] = {}
        for entry in self.done:
            if entry.reason:
                found.setdefault(entry.reason, []).append(entry.name)
        return found

    def idle(self) -> list[str]:
        """The inputs that change no number: scenes that differ in such a one alone have the same."""
        return [key for key in self.inputs if self._is_idle(key)]

    def _is_idle(self, key: str) -> bool:
        alike: dict[str, list[Entry]] = {}
        for entry in self.done:
            others = {name: value for name, value in entry.inputs.items() if name != key}
            alike.setdefault(repr(others), []).append(entry)
        pairs = [(group[0], other) for group in alike.values() for other in group[1:]]
        return bool(pairs) and all(one.quantities == other.quantities for one, other in pairs)

    @property
    def columns(self) -> list[str]:
        """The heads of the tidy table; an input's unit stands behind its key."""
        heads = [f"{key} ({unit})" if unit else key for key, unit in self.inputs.items()]
        return ["scene", "state", *heads, "quantity", *NUMBERS, "unit", "reason"]

    def rows(self) -> list[list[Cell]]:
        """The tidy table: a row for each number of each scene, one without numbers for a scene that has none."""
        found: list[list[Cell]] = []
        for entry in self.entries:
            head: list[Cell] = [entry.name, entry.state, *(_cell(entry.inputs.get(key)) for key in self.inputs)]
            numbers = [[q.name, q.value, *q.ends, q.error, q.numerical, q.unit] for q in entry.quantities]
            empty: list[list[Cell]] = [[None] * (2 + len(NUMBERS))]
            found += [[*head, *row, entry.reason or None] for row in numbers or empty]
        return found

    def wide(self) -> dict[str, list[Cell]]:
        """A row a scene: columns by their heads; a number's interval stands in NAME.low and NAME.high."""
        table: dict[str, list[Cell]] = {"scene": [entry.name for entry in self.entries]}
        table["state"] = [entry.state for entry in self.entries]
        for key, head in zip(self.inputs, self.columns[2:], strict=False):
            table[head] = [_cell(entry.inputs.get(key)) for entry in self.entries]
        for name in self.names:
            cells = [entry.by_name.get(name) for entry in self.entries]
            table[name] = [None if one is None else one.value for one in cells]
            for place, end in enumerate(("low", "high")):
                ends: list[Cell] = [None if one is None else one.ends[place] for one in cells]
                if any(value is not None for value in ends):
                    table[f"{name}.{end}"] = ends
        table["reason"] = [entry.reason or None for entry in self.entries]
        return table

    def frame(self, *, wide: bool = False) -> Any:
        """The table as a pandas DataFrame where pandas is installed, else as a dict of numpy arrays, by column.

        Tidy, as :meth:`rows`, or ``wide``: a row a scene. Numbers that are missing are nan.
        """
        if wide:
            table = self.wide()
        else:
            rows = self.rows()
            table = {head: [row[place] for row in rows] for place, head in enumerate(self.columns)}
        return cell_frame(table)

    def quantity(self, name: str) -> str:
        """``name``, where the table has such a number. Raises SceneError, naming the nearest, where it has not."""
        if name not in self.names:
            raise SceneError(f"no quantity {name!r} in this table{did_you_mean(name, list(self.names))}")
        return name

    def write_csv(self, path: Path) -> None:
        """Write the tidy table; empty where nothing is known, ten digits a number."""
        write_cells(path, self.columns, self.rows())

    def write_wide_csv(self, path: Path) -> None:
        """Write the table with a row a scene."""
        table = self.wide()
        write_cells(path, list(table), [list(row) for row in zip(*table.values(), strict=True)])

    def write_parquet(self, path: Path) -> bool:
        """Write the tidy table as Parquet where pyarrow is installed; whether it is."""
        if find_spec("pyarrow") is None:
            return False
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
        rows = self.rows()
        columns = {head: _array([row[place] for row in rows]) for place, head in enumerate(self.columns)}
        with atomic_write(path, "wb") as stream:
            parquet.write_table(arrow.Table.from_pydict(columns), stream)
        return True


def cell_frame(table: Mapping[str, Sequence[Cell]]) -> Any:
    """Columns of cells by their heads, as of :func:`wakeflow.core.frames.frame_of`."""
    return frame_of({head: _array(cells) for head, cells in table.items()})


def write_cells(path: Path, heads: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """Write rows as CSV; empty where nothing is known, ten digits a number."""
    with atomic_write(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(heads)
        writer.writerows([_text(cell) for cell in row] for row in rows)


def _cell(value: Any) -> Cell:
    """An input as a cell: numbers stay, everything else is text."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "on" if value else "off"
    return float(value) if isinstance(value, int | float) else str(value)


def _array(cells: Sequence[Cell]) -> Any:
    """A column: of float with nan where nothing is known, or of text."""
    if any(isinstance(cell, str) for cell in cells):
        return np.array(["" if cell is None else _text(cell) for cell in cells], dtype=object)
    return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)


def _text(cell: Cell) -> str:
    return "" if cell is None else f"{cell:.10g}" if isinstance(cell, float) else cell
