"""Runs that exist side by side: what differs in their scenes, and by how much their answers do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..answer.budget.agreement import Agreement, agreement_in
from ..answer.result import Result
from ..answer.result_table import DONE, Difference, Entry, ResultTable, differences_of, quantities_of
from ..core import own_files
from ..core.errors import SceneError
from ..core.files import made_folder
from ..core.record import JsonMapping
from ..core.tables import CellTable
from ..scene import Scene
from ..scene.changes import differing
from ..scene.measured import Measured, read_trays

DIFFERENCES = {  # heads of differences.csv, and what each is of a difference
    "scene": "scene", "against": "against", "quantity": "quantity", "difference": "value", "low": "low", "high": "high",
    "clear": "clear", "unit": "unit",
}  # fmt: skip


class InTable:
    """Results in one ``table``."""

    table: ResultTable

    def _repr_html_(self) -> str:
        """The table of main numbers, as a notebook shows it."""
        from ..show.views import table_card

        return table_card(self.table)


@dataclass
class GrowingTable:
    """A table while it grows; the targets of a fraction are those of the first run that has it."""

    entries: dict[str, Entry] = field(default_factory=dict)
    targets: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def add(self, name: str, inputs: JsonMapping, result: Result) -> None:
        """Take in a finished run under a name."""
        self.entries[name] = Entry(name, inputs, DONE, result.caveat, quantities_of(result), result.folder)
        for fraction in result.scene["fraction"]:
            self.targets.setdefault(fraction, result.targets(fraction))

    @property
    def table(self) -> ResultTable:
        """The table of all that was taken in."""
        return ResultTable(tuple(self.entries.values()), self.targets)


@dataclass(frozen=True)
class RunComparison(InTable):
    """``runs`` in one ``table``, whose inputs are the keys in which their scenes differ."""

    table: ResultTable
    runs: tuple[Result, ...] = field(repr=False)

    def __repr__(self) -> str:
        return f"<RunComparison: {self.table!r}>"

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Differences of every later run from the first, quantity by quantity."""
        return tuple(differences_of(self.table.entries))

    @property
    def by_quantity(self) -> dict[str, dict[str, Difference]]:
        """The differences by quantity and run."""
        rows: dict[str, dict[str, Difference]] = {}
        for difference in self.differences:
            rows.setdefault(difference.quantity, {})[difference.scene] = difference
        return rows

    def frame(self, *, wide: bool = False) -> Any:
        """Table of the runs, as :meth:`wakeflow.Sweep.frame` gives that of a sweep."""
        return self.table.frame(wide=wide)

    def write(self, folder: Path) -> None:
        """Write compare.html, compare.csv, differences.csv and figures."""
        from ..show.html.pages import write_comparison
        from ..show.many_figures import draw_table_figures

        files = page, whole, apart = [folder / name for name in ("compare.html", "compare.csv", "differences.csv")]
        own_files.refuse_foreign(made_folder(folder), files, "compare")
        with own_files.writing(folder, lambda: files, "compare"):
            draw_table_figures(folder, self.table)
            self.table.tidy().write_csv(whole)
            CellTable.of(self.differences, DIFFERENCES).write_csv(apart)
            write_comparison(page, self.table, self.by_quantity, self.runs)


def compare(runs: Sequence[Result | Path | str]) -> RunComparison:
    """Set finished runs, or their folders, side by side; the first is what the others are compared with.

    Raises SceneError with fewer than two, and where a folder holds no finished run.
    """
    if isinstance(runs, Result | Path | str) or not isinstance(runs, Iterable):
        raise SceneError("give a list of runs to compare, as in compare([one, other])")
    results = [run if isinstance(run, Result) else Result.load(run) for run in runs]
    if len(results) < 2:
        raise SceneError("give at least two runs to compare")
    folders = [run.folder.resolve() for run in results]
    if twice := [run.folder for run, folder in zip(results, folders, strict=True) if folders.count(folder) > 1]:
        raise SceneError(f"{twice[0]} is given twice")
    columns = differing([Scene.parse(run.scene) for run in results]) | _options(results)
    names = _names([run.folder for run in results])
    rows = GrowingTable()
    for place, (name, run) in enumerate(zip(names, results, strict=True)):
        rows.add(name, {key: values[place] for key, values in columns.items()}, run)
    return RunComparison(rows.table, tuple(results))


def _options(runs: Sequence[Result]) -> dict[str, list[object]]:
    """How the runs were asked for, where that differs: the rung that was computed, the accuracy, switched terms."""
    terms = dict.fromkeys(term for run in runs for term in run.options.force)
    columns: dict[str, list[object]] = {
        "rung": [run.plan.rung for run in runs],
        "target-error": [run.plan.target_error for run in runs],
        **{f"force.{term}": [run.options.force.get(term) for run in runs] for term in terms},
    }
    return {key: values for key, values in columns.items() if any(value != values[0] for value in values)}


def _names(folders: Sequence[Path]) -> list[str]:
    """The last parts of the folders' paths, as many as tell them apart; ? for a byte that is not UTF-8."""
    parts = [Path(str(folder.absolute()).encode(errors="replace").decode()).parts for folder in folders]
    for count in range(1, max(map(len, parts)) + 1):
        names = ["/".join(folder[-count:]) for folder in parts]
        if len(set(names)) == len(names):
            return names
    return [str(folder) for folder in folders]


def beside_trays(folder: Path, file: Path) -> Agreement:
    """How a finished run agrees with the measured shares of a CSV file. Raises SceneError as reading either does."""
    return agreement_in(Result.load(folder), Measured.of(read_trays(file)))


def write_agreement(agreement: Agreement, folder: Path) -> tuple[Path, Path]:
    """Write the table and the picture of an agreement, agreement.csv and measured.png; returns both."""
    from ..show.canvas import saved
    from ..show.figures.budget_figures import draw_measured

    table, figure = folder / "agreement.csv", folder / "measured.png"
    files = [table, *saved(figure)]
    own_files.refuse_foreign(made_folder(folder), files, "trays")
    with own_files.writing(folder, lambda: files, "trays"):
        agreement.cells().write_csv(table)
        draw_measured(figure, agreement)
    return table, figure
