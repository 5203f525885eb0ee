"""The numbers of results as one list and one table, and what differs between results.

Read off the types of the result: what a record there gains is in the list, in every table and figure made of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from enum import StrEnum
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

from ..air.kinds.airflow_table import Airflow
from ..core.errors import SceneError
from ..core.files import atomic_write
from ..core.lazy import cached_property
from ..core.number import Number
from ..core.quantities import converted
from ..core.record import JsonMapping, columns
from ..core.registry import did_you_mean
from ..core.tables import Cell, CellTable
from ..planning.feed_funnel import FunnelSummary
from ..scene import RESERVED_BIN, Scene
from ..scene.messages import unit_of
from .joint import HOUR, JointAnswer, difference
from .result import VOID, Result
from .shares import Money, Separation

# -- The numbers of a result as one flat list --------------------------------------------------------------------------
SECONDS = "seconds"
RENAMED = {"fractions": "share"}  # as the rows of the budget are called
PARTS = ("share.", "purity.", "recovery.", "loss.", "dirt.")
THROUGHPUT = "throughput."


@dataclass(frozen=True, kw_only=True)
class TableQuantity(Number):
    """One number of a result, its ``unit`` ("1" for plain numbers), and ``error``, the total of its budget, None where
    parts are unknown or there is none.
    """

    name: str
    unit: str
    error: float | None = None


def is_part(name: str) -> bool:
    """Whether a number is a part of a whole, 0 to 1, with or without collisions."""
    return name.removeprefix("without_collisions.").startswith(PARTS)


def quantities_of(result: Result) -> tuple[TableQuantity, ...]:
    """Shares (share.FRACTION.BIN), purity.BIN.FRACTION, recovery.FRACTION, loss.FRACTION, lost.FRACTION, dirt.BIN,
    throughput.BIN; money.total and its parts; the airflow's and the funnel's numbers (airflow.cd, ...); seconds, the
    run time of all stages when they were computed.
    """
    errors = {row.quantity: row.total.error for row in result.budget if row.total.error is not None}
    quantities: list[TableQuantity] = []
    if result.landings is not None:
        for head in columns(type(result.landings)):
            part = getattr(result.landings, head.name)
            if isinstance(part, Separation):
                quantities += _inside(part, "" if head.name == "separation" else f"{head.key}.", errors)
        if result.landings.joint is not None:
            quantities = [_throughput(result, row) if row.name.startswith(THROUGHPUT) else row for row in quantities]
    if result.airflow is not None:
        quantities += _measured(result.airflow, "airflow.")
    if result.funnel is not None:
        quantities += _measured(result.funnel, "funnel.")
    spent = sum(stage.seconds for stage in result.seconds.values())
    return (*quantities, TableQuantity(spent, name=SECONDS, unit="s"))


def _throughput(result: Result, quantity: TableQuantity) -> TableQuantity:
    """A throughput (kg/h) with its interval: that of the part of the whole feed."""
    bins, of = result.joint.own, result.joint.own.of_name(quantity.name)
    if of is None:
        return quantity
    interval = bins.number(of, bounds=(0.0, HOUR * result.joint.flow))
    return replace(quantity, low=interval.low, high=interval.high)


def names_for(scene: Scene) -> list[str]:
    """Every name that :func:`quantities_of` may give to a number of a scene's results, whatever its rung."""
    bins = [*scene.with_top().bin, RESERVED_BIN]
    aimed = [name for name, fraction in scene.fraction.items() if fraction.targets]
    landed = [
        *(f"{RENAMED['fractions']}.{fraction}.{place}" for fraction in scene.fraction for place in bins),
        *(f"purity.{place}.{fraction}" for place in bins for fraction in scene.fraction),
        *(f"{kind}.{name}" for kind in ("recovery", "loss", "lost") for name in aimed),
        *(f"dirt.{place}" for place in scene.products),
        *(f"{THROUGHPUT}{place}" for place in bins),
        *(f"money.{head.key}" for head in columns(Money) if scene.price.given),
    ]
    names = [*landed, *(f"without_collisions.{name}" for name in landed), SECONDS]
    for prefix, kind, given in (("airflow", Airflow, scene.air), ("funnel", FunnelSummary, scene.funnel)):
        if given is not None:
            numbers = [head for head in columns(kind) if {Number, float} & {head.kind, *get_args(head.kind)}]
            names += [f"{prefix}.{head.key}" for head in numbers]
    return names


def _inside(record: object, prefix: str, errors: Mapping[str, float]) -> Iterator[TableQuantity]:
    for head in columns(type(record)):
        name = prefix + RENAMED.get(head.key, head.key)
        yield from _numbers(getattr(record, head.name), name, head.unit, errors)


def _measured(record: object, prefix: str) -> Iterator[TableQuantity]:
    """The numbers of a record, not those of records inside it, which say how it was computed."""
    for head in columns(type(record)):
        value = getattr(record, head.name)
        number = value.value if isinstance(value, Number) else value
        if isinstance(number, float) and not math.isnan(number):
            yield from _numbers(value, prefix + head.key, head.unit, {})


def _numbers(value: object, name: str, unit: str, errors: Mapping[str, float]) -> Iterator[TableQuantity]:
    if isinstance(value, Mapping):
        for key, member in value.items():
            yield from _numbers(member, f"{name}.{key}", unit, errors)
    elif isinstance(value, Number):
        yield TableQuantity(value.value, value.low, value.high, value.numerical, name=name, unit=unit,
                            error=errors.get(name))  # fmt: skip
    elif is_dataclass(value):
        yield from _inside(value, f"{name}.", errors)
    elif isinstance(value, float):
        yield TableQuantity(value, name=name, unit=unit, error=errors.get(name))


# -- One tidy table of many results ------------------------------------------------------------------------------------


class State(StrEnum):
    """Whether a scene of a table has its numbers."""

    DONE = "done"
    FAILED = "failed"
    OPEN = "open"


DONE, FAILED, OPEN = State
NUMBERS = ("value", "low", "high", "error", "numerical")
DIGITS = 12  # of an input in another unit: 0.3, not 0.30000000000000004


@dataclass(frozen=True)
class Entry:
    """One scene of a table: its ``inputs`` (SI), its ``state`` (done, failed or open), the ``reason`` why it failed, or
    what is against the intervals of one that is done (:attr:`Result.caveat`), its numbers, the folder of its run.
    """

    name: str
    inputs: JsonMapping
    state: State
    reason: str = ""
    quantities: tuple[TableQuantity, ...] = ()
    folder: Path | None = field(default=None, compare=False, repr=False)

    @cached_property
    def joint(self) -> JointAnswer | None:
        """Shares of the scene jointly; None without a run, or where that ended before them."""
        result = None if self.folder is None else Result.load(self.folder)
        return None if result is None or result.landings is None else result.joint

    @cached_property
    def by_name(self) -> dict[str, TableQuantity]:
        """The numbers by their names."""
        return {quantity.name: quantity for quantity in self.quantities}


@dataclass(frozen=True)
class ResultTable:
    """The numbers of many scenes. Its rows do not depend on the order in which they were computed."""

    entries: Sequence[Entry]
    targets: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # bins where each fraction should land
    units: Mapping[str, str] = field(default_factory=dict)  # of inputs by key, where they are not of the SI

    def __repr__(self) -> str:
        """How many scenes there are, and in what they differ."""
        over = f" over {', '.join(self.inputs)}" if self.inputs else ""
        return f"{len(self.done)} of {len(self.entries)} scenes done{over}"

    @cached_property
    def inputs(self) -> dict[str, str]:
        """The keys in which the scenes differ, and their units."""
        keys = dict.fromkeys(key for entry in self.entries for key in entry.inputs)
        return {key: self.units.get(key) or unit_of(key) for key in keys}

    def read_in(self, units: Mapping[str, str]) -> ResultTable:
        """The table with its inputs in the units that people read, {"kg/s": "kg/h"}, of those that are numbers."""
        said = {key: unit for key, unit in self.inputs.items()
                if unit in units and all(_plain(entry.inputs.get(key, 0.0)) for entry in self.entries)}  # fmt: skip

        def shown(key: str, value: Any) -> Any:  # without what converting does to the last digits
            return float(f"{converted(value, said[key], units[said[key]]):.{DIGITS}g}") if key in said else value

        entries = [replace(entry, inputs={key: shown(key, value) for key, value in entry.inputs.items()})
                   for entry in self.entries]  # fmt: skip
        return replace(self, entries=entries, units={**self.units, **{key: units[said[key]] for key in said}})

    @cached_property
    def headings(self) -> list[str]:
        """The keys of the inputs, each with its unit behind it."""
        return [f"{key} ({unit})" if unit else key for key, unit in self.inputs.items()]

    @cached_property
    def names(self) -> dict[str, str]:
        """The numbers that any scene has, and their units."""
        return {quantity.name: quantity.unit for entry in self.entries for quantity in entry.quantities}

    @cached_property
    def done(self) -> tuple[Entry, ...]:
        """The scenes that have numbers."""
        return tuple(entry for entry in self.entries if entry.state == DONE)

    @cached_property
    def caveats(self) -> dict[str, list[str]]:
        """The scenes that are done, by what is against their intervals; those that nothing does are left out."""
        reasons = dict.fromkeys(entry.reason for entry in self.done if entry.reason)
        return {reason: [entry.name for entry in self.done if entry.reason == reason] for reason in reasons}

    def idle(self) -> list[str]:
        """The inputs that change no number: scenes that differ in such a one alone have the same."""
        return [key for key in self.inputs if self._is_idle(key)]

    def _is_idle(self, key: str) -> bool:
        first: dict[str, Entry] = {}  # of those that differ in the key alone
        others = [{name: value for name, value in entry.inputs.items() if name != key} for entry in self.done]
        alike = [first.setdefault(repr(inputs), entry) for inputs, entry in zip(others, self.done, strict=True)]
        pairs = [(earlier, entry) for earlier, entry in zip(alike, self.done, strict=True) if earlier is not entry]
        return bool(pairs) and all(earlier.quantities == entry.quantities for earlier, entry in pairs)

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
            columns[name] = [None if quantity is None else quantity.value for quantity in cells]
            for place, end in enumerate(("low", "high")):
                ends: list[Cell] = [None if quantity is None else quantity.ends[place] for quantity in cells]
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


def _plain(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _cell(value: object) -> Cell:
    """An input as a cell: numbers stay, everything else is text."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "on" if value else "off"
    return float(value) if isinstance(value, int | float) else str(value)


# -- By how much the numbers of later results differ from those of a first one -----------------------------------------


@dataclass(frozen=True, kw_only=True)
class Difference(Number):
    """A quantity of one run less that of the first, with its 95 % interval where both have one.

    Shares, recoveries, purities and throughputs are compared draw by draw of the two joint answers: what both runs do
    not know is the same in both, everything else is each run's own. Other numbers, as those of the airflow, count as
    independent (squares of the arms add up: Zou & Donner 2008, Stat. Med. 27, 1693). ``void``: one of the two answers
    is worth nothing.
    """

    scene: str
    against: str
    quantity: str
    unit: str
    void: bool = False

    @property
    def clear(self) -> bool:
        """Whether the interval leaves zero out, of answers that are worth something."""
        return not self.void and (self.low > 0.0 or self.high < 0.0)


def differences_of(entries: Sequence[Entry]) -> Iterator[Difference]:
    """Differences of every later entry from the first, quantity by quantity."""
    for entry in entries[1:]:
        differences = (difference_of(entries[0], entry, quantity.name) for quantity in entry.quantities)
        yield from (row for row in differences if row is not None)


def difference_of(first: Entry, entry: Entry, name: str) -> Difference | None:
    """The number called ``name`` of an entry less that of the ``first``; None where either has none."""
    base, quantity = first.by_name.get(name), entry.by_name.get(name)
    if base is None or quantity is None:
        return None
    return Difference(*_difference(first, entry, base, quantity), scene=entry.name, against=first.name, quantity=name,
                      unit=quantity.unit, void=VOID in (first.reason, entry.reason))  # fmt: skip


def _difference(first: Entry, entry: Entry, base: TableQuantity, new: TableQuantity) -> Number:
    value = new.value - base.value
    if first.joint is not None and entry.joint is not None:
        interval = difference(entry.joint.own, first.joint.own, new.name)
        if interval is not None:
            return Number(value, min(interval.low, value), max(interval.high, value))
    if not (base.known and new.known):
        return Number(value)
    below, above = (math.hypot(*arms) for arms in (
        (new.value - new.low, base.high - base.value), (new.high - new.value, base.value - base.low)))  # fmt: skip
    part = is_part(new.name)  # parts of a whole differ by no more than one
    return Number(value, max(value - below, -1.0 if part else -math.inf), min(value + above, 1.0 if part else math.inf))
