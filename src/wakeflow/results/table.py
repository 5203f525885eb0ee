"""One tidy table of many results: a row for each number of each scene, with its interval, its unit and the inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..core.errors import SceneError
from ..core.files import atomic_write
from ..core.lazy import cached_property
from ..core.registry import did_you_mean
from ..core.tables import Cell, CellTable
from ..scene.messages import unit_of
from .quantities import TableQuantity

DONE, FAILED, OPEN = "done", "failed", "open"
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
    def headings(self) -> list[str]:
        """The keys of the inputs, each with its unit behind it."""
        return [f"{key} ({unit})" if unit else key for key, unit in self.inputs.items()]

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

    def tidy(self) -> CellTable:
        """A row for each number of each scene, one without numbers for a scene that has none; an input's unit is
        written behind its key.
        """
        rows: list[list[Cell]] = []
        for entry in self.entries:
            head: list[Cell] = [entry.name, entry.state, *(_cell(entry.inputs.get(key)) for key in self.inputs)]
            numbers = [[q.name, q.value, *q.ends, q.error, q.numerical, q.unit] for q in entry.quantities]
            empty: list[list[Cell]] = [[None] * (2 + len(NUMBERS))]
            rows += [[*head, *row, entry.reason or None] for row in numbers or empty]
        return CellTable(["scene", "state", *self.headings, "quantity", *NUMBERS, "unit", "reason"], rows)

    def wide(self) -> CellTable:
        """A row a scene; the ends of a number's interval are in NAME.low and NAME.high."""
        columns: dict[str, Sequence[Cell]] = {"scene": [entry.name for entry in self.entries]}
        columns["state"] = [entry.state for entry in self.entries]
        for key, head in zip(self.inputs, self.headings, strict=True):
            columns[head] = [_cell(entry.inputs.get(key)) for entry in self.entries]
        for name in self.names:
            cells = [entry.by_name.get(name) for entry in self.entries]
            columns[name] = [None if one is None else one.value for one in cells]
            for place, end in enumerate(("low", "high")):
                ends: list[Cell] = [None if one is None else one.ends[place] for one in cells]
                if any(value is not None for value in ends):
                    columns[f"{name}.{end}"] = ends
        columns["reason"] = [entry.reason or None for entry in self.entries]
        return CellTable(list(columns), list(zip(*columns.values(), strict=True)))

    def frame(self, *, wide: bool = False) -> Any:
        """The table as a pandas DataFrame where pandas is installed, else as a dict of numpy arrays, by column.

        A row for each number of each scene, or ``wide``: a row a scene. Numbers that are missing are nan.
        """
        return (self.wide() if wide else self.tidy()).frame()

    def quantity(self, name: str) -> str:
        """``name``, where the table has such a number. Raises SceneError, naming the nearest, where it has not."""
        if name not in self.names:
            raise SceneError(f"no quantity {name!r} in this table{did_you_mean(name, list(self.names))}")
        return name

    def write_parquet(self, path: Path) -> bool:
        """Write the tidy table as Parquet where pyarrow is installed; whether it is."""
        if find_spec("pyarrow") is None:
            return False
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
        with atomic_write(path, "wb") as stream:
            parquet.write_table(arrow.Table.from_pydict(self.tidy().columns()), stream)
        return True


def _cell(value: Any) -> Cell:
    """An input as a cell: numbers stay, everything else is text."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "on" if value else "off"
    return float(value) if isinstance(value, int | float) else str(value)
