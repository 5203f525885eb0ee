"""Runs that exist side by side: what differs in their scenes, and by how much their answers do."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import SceneError
from ..core.files import atomic_write
from ..results.quantities import TableQuantity, quantities_of
from ..results.result import Result
from ..results.table import DONE, Entry, ResultTable
from ..scene import Scene
from ..scene.changes import differing

__all__ = ["Difference", "RunComparison", "compare"]

HEADS = ("scene", "against", "quantity", "difference", "low", "high", "clear", "unit")


@dataclass(frozen=True)
class Difference:
    """A quantity of one run less that of the first: ``value`` and its 95 % interval, None where one of them has none.

    What is unknown of the scene is the same in both runs and moves both alike: the interval of a share holds what
    computing adds, and takes that as independent (squares of the arms add up: Zou & Donner 2008, Stat. Med. 27, 1693).
    Runs that feed the same granules agree better than that, so that it errs on the wide side.
    """

    scene: str
    against: str
    quantity: str
    unit: str
    value: float
    low: float | None
    high: float | None

    @property
    def clear(self) -> bool:
        """Whether the interval leaves zero out."""
        return self.low is not None and self.high is not None and (self.low > 0.0 or self.high < 0.0)


@dataclass(frozen=True)
class RunComparison:
    """Runs in one ``table``, whose inputs are the keys in which their scenes differ."""

    table: ResultTable

    def __repr__(self) -> str:
        return f"<RunComparison: {self.table!r}>"

    def _repr_html_(self) -> str:
        """The table of main numbers, as a notebook shows it."""
        from ..report.card import table_card

        return table_card(self.table)

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Of every later run from the first, quantity by quantity."""
        return tuple(_differences(self.table.entries))

    def frame(self, *, wide: bool = False) -> Any:
        """As :meth:`wakeflow.Sweep.frame`."""
        return self.table.frame(wide=wide)

    def write(self, folder: Path) -> None:
        """Write compare.csv, differences.csv and figures."""
        from ..report.many import draw_table_figures

        self.table.write_csv(folder / "compare.csv")
        with atomic_write(folder / "differences.csv") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(HEADS)
            for one in self.differences:
                ends = ["" if end is None else f"{end:.10g}" for end in (one.low, one.high)]
                clear = "yes" if one.clear else "no"
                writer.writerow([one.scene, one.against, one.quantity, f"{one.value:.10g}", *ends, clear, one.unit])
        draw_table_figures(folder / "figures", self.table)


def compare(runs: Sequence[Result | Path | str]) -> RunComparison:
    """Set finished runs, or their folders, side by side; the first is what the others are compared with.

    Raises SceneError with fewer than two, and where a folder holds no finished run.
    """
    found = [run if isinstance(run, Result) else Result.load(run) for run in runs]
    if len(found) < 2:
        raise SceneError("give at least two runs to compare")
    if twice := [run.folder for run in found if [other.folder for other in found].count(run.folder) > 1]:
        raise SceneError(f"{twice[0]} is given twice")
    columns = differing([Scene.parse(run.scene) for run in found]) | _options(found)
    names = _names([run.folder for run in found])
    targets: dict[str, tuple[str, ...]] = {}
    entries = []
    for place, (name, run) in enumerate(zip(names, found, strict=True)):
        inputs = {key: values[place] for key, values in columns.items()}
        entries.append(Entry(name, inputs, DONE, "", quantities_of(run)))
        for fraction in run.scene["fraction"]:
            targets.setdefault(fraction, run.targets(fraction))
    return RunComparison(ResultTable(tuple(entries), targets))


def _options(runs: Sequence[Result]) -> dict[str, list[Any]]:
    """How the runs were asked for, where that differs: the rung that was computed, the accuracy, switched terms."""
    terms = dict.fromkeys(term for run in runs for term in run.options.force)
    columns: dict[str, list[Any]] = {
        "rung": [run.plan.rung for run in runs],
        "target-error": [run.plan.target_error for run in runs],
        **{f"force.{term}": [run.options.force.get(term) for run in runs] for term in terms},
    }
    return {key: values for key, values in columns.items() if any(value != values[0] for value in values)}


def _names(folders: Sequence[Path]) -> list[str]:
    """The last parts of the folders' paths, as many as tell them apart."""
    parts = [folder.absolute().parts for folder in folders]
    deep = max(len(one) for one in parts)
    for count in range(1, deep + 1):
        names = ["/".join(one[-count:]) for one in parts]
        if len(set(names)) == len(names):
            return names
    return [str(folder) for folder in folders]


def _differences(entries: Sequence[Entry]) -> Iterator[Difference]:
    first = entries[0]
    for entry in entries[1:]:
        for one in entry.quantities:
            base = first.by_name.get(one.name)
            if base is None:
                continue
            yield Difference(entry.name, first.name, one.name, one.unit, one.value - base.value, *_ends(base, one))


def _ends(base: TableQuantity, one: TableQuantity) -> tuple[float | None, float | None]:
    if base.low is None or base.high is None or one.low is None or one.high is None:
        return None, None
    value = one.value - base.value
    if one.numerical is not None and base.numerical is not None:
        half = math.hypot(one.numerical, base.numerical)
        return value - half, value + half
    low = value - math.hypot(one.value - one.low, base.high - base.value)
    return low, value + math.hypot(one.high - one.value, base.value - base.low)
