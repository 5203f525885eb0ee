"""What a person at a terminal sees of many runs: sweeps, comparisons, sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from textwrap import shorten
from typing import TYPE_CHECKING

from ..answer.result import VOID
from ..answer.result_table import DONE, Difference, Entry, ResultTable, is_part
from ..core.quantities import duration
from ..many.comparison import RunComparison
from ..many.compute import Sweep, SweepEstimate
from ..show.many_figures import input_words, main_quantities
from ..show.plan_words import UNITS
from ..show.words import NO_VALUE, difference_text, percent, quantity_text
from .screen import plain, print_lines, screen_table

if TYPE_CHECKING:
    from rich.text import Text

    from ..answer.budget.agreement import Agreement


MAX_NAMED_SCENES = 5  # scenes that are named in a line
MAX_ROWS = 50  # of a table on a terminal; all are in the file
MAX_INPUTS = 8  # told of a quantity; all are in the file
GAP = 2  # letters between columns
MAX_KEYS = 6  # in which compared scenes differ: more have a line each
LONGEST_VALUE = 30  # letters of a value in such a line
DIFFERENCES_HOLD = (
    "bold: zero lies outside of the interval, of what computing adds; of all that is not known where rungs or terms "
    "differ, and of purities"
)

Column = tuple[str, ...]  # its head and its cells


def show_estimate(estimate: SweepEstimate, workers: int) -> None:
    """Print how many scenes there are, what they share, and the cost."""
    before = f", {estimate.finished} finished before" if estimate.finished else ""
    spent, alone = duration(estimate.seconds / workers), duration(estimate.seconds)
    lines = [
        f"{_counted(estimate.scenes, 'scene')}{before}: {_counted(estimate.airflows, 'airflow')} and "
        f"{_counted(estimate.flights, 'flight')} to compute",
        f"about {spent} on {_counted(workers, 'core')} ({alone} of one), {estimate.disk / 1e6:.0f} MB of disk",
        *(f"! {name}: {reason}" for name, reason in estimate.failed.items()),
    ]
    print_lines(lines)


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def show_sweep(found: Sweep) -> None:
    """Print the table of a sweep, what failed, and where everything is."""
    show_table(found.table)
    print_lines((f"! {name}: {reason}" for name, reason in found.failed.items()), "yellow")
    print_lines([f"results: {found.folder}"])


def show_table(table: ResultTable) -> None:
    """Print a row a scene: its inputs and the quantities that it is made for, with their 95 % intervals; where not
    all columns fit beside each other, in several tables.
    """
    from rich.console import Console

    table = table.read_in(UNITS)
    shown, names = table.entries[:MAX_ROWS], main_quantities(table)
    inputs = list(zip(_heads(table), *(_inputs(table, entry) for entry in shown), strict=True))
    numbers = list(
        zip((_quantity_head(table, name) for name in names), *(_cells(names, one) for one in shown), strict=True)
    )
    console, title = Console(), "percent, with 95 % interval"
    for columns in _fitting(inputs, numbers, console.width):
        rows = zip(*(cells for _, *cells in columns), strict=True)
        console.print(screen_table([head for head, *_ in columns], rows, title, left=0))
        title = ""
    if len(table.entries) > MAX_ROWS:
        console.print(f"more in the file: {_counted(len(table.entries) - MAX_ROWS, 'scene')}")
    print_lines(_doubts(table), "yellow")


def _doubts(table: ResultTable) -> Iterator[str]:
    """What is against the numbers of a table."""
    for caveat, names in table.caveats.items():
        where = "every scene" if len(names) == len(table.done) > 1 else ", ".join(names[:MAX_NAMED_SCENES])
        more = (
            f" and {len(names) - MAX_NAMED_SCENES} more"
            if where != "every scene" and len(names) > MAX_NAMED_SCENES
            else ""
        )
        yield f"! {where}{more}: {'the answer is void' if caveat == VOID else f'intervals {caveat}'}"
    for key in table.idle():
        yield f"! {key} changes no number here: what is left out of these scenes does not feel it"


def _quantity_head(table: ResultTable, name: str) -> str:
    """Its parts below each other, and the unit of what is no percentage."""
    head = name.replace(".", "\n")
    return head if is_part(name) or table.names[name] in ("", "1") else f"{head}\n({table.names[name]})"


def _inputs(table: ResultTable, entry: Entry) -> list[str]:
    values = [entry.inputs.get(key) for key in table.inputs]
    return [NO_VALUE if value is None else input_words(value) for value in values] or [entry.name]


def _cells(names: Sequence[str], entry: Entry) -> list[str]:
    void = entry.reason == VOID
    return [quantity_text(entry.by_name.get(name), void=void) if entry.state == DONE else entry.state
            for name in names]  # fmt: skip


def _fitting(inputs: list[Column], numbers: list[Column], room: int) -> Iterator[list[Column]]:
    """The columns of each table: the inputs, and of the numbers as many as fit into so many letters, one at least."""
    left = [*numbers]
    while True:
        columns, used = [*inputs], sum(map(_width, inputs))
        while left and (len(columns) == len(inputs) or used + _width(left[0]) <= room):
            used += _width(left[0])
            columns.append(left.pop(0))
        yield columns
        if not left:
            return


def _width(column: Column) -> int:
    """Letters of a column and of the gap before it."""
    return max(len(line) for cell in column for line in cell.split("\n")) + GAP


def _heads(table: ResultTable) -> Sequence[str]:
    """Keys with their parts below each other, so that columns stay narrow."""
    heads = {key: key.replace(".", "\n") for key in table.inputs}
    return [f"{heads[key]}\n({unit})" if unit else heads[key] for key, unit in table.inputs.items()] or ["scene"]


def show_comparison(found: RunComparison) -> None:
    """Print what differs in the scenes, the answers, and the differences from the first run; of runs that are the same
    computation that alone.
    """
    from rich.console import Console

    keys = [run.key for run in found.runs]
    if len(set(keys)) == 1:
        print_lines([f"{' and '.join(entry.name for entry in found.table.entries)} are the same computation"])
        return
    if len(found.table.inputs) > MAX_KEYS:
        _show_keys(found.table)
        show_table(replace(found.table, entries=[replace(one, inputs={}) for one in found.table.entries]))
    else:
        show_table(found.table)
    for entry, key in list(zip(found.table.entries, keys, strict=True))[1:]:
        if key == keys[0]:
            print_lines([f"{entry.name} is the same computation as {found.table.entries[0].name}"])
    first, names = found.table.entries[0].name, set(main_quantities(found.table))
    names |= {"airflow.cd", "airflow.cp_base", "airflow.pressure_drop"}
    others = [entry.name for entry in found.table.entries[1:]]
    by_quantity: dict[str, dict[str, Difference]] = {}
    for one in found.differences:
        by_quantity.setdefault(one.quantity, {})[one.scene] = one
    rows = [
        [quantity, *(_difference(row[name]) if name in row else NO_VALUE for name in others)]
        for quantity, row in by_quantity.items()
        if quantity in names
    ]
    table = screen_table(["less " + first, *others], rows, "differences", DIFFERENCES_HOLD)
    Console().print(table if rows else f"no number of {first} is in another of these runs")


def _show_keys(table: ResultTable) -> None:
    """Print the keys in which scenes differ, a line each: of machines that have little in common."""
    from rich.console import Console

    table = table.read_in(UNITS)
    rows = [
        [f"{key} ({unit})" if unit else key, *(_input_cell(entry.inputs.get(key)) for entry in table.entries)]
        for key, unit in table.inputs.items()
    ]
    Console().print(screen_table(["key", *(entry.name for entry in table.entries)], rows, "what differs"))


def _input_cell(value: object) -> str:
    return NO_VALUE if value is None else shorten(input_words(value), LONGEST_VALUE, placeholder=" ...")


def _difference(one: Difference) -> Text:
    return plain(difference_text(one), "bold" if one.clear else "")


def show_agreement(found: Agreement) -> None:
    """Print a row a tray, both shares with their 95 % intervals, and the verdict in a sentence."""
    from rich.console import Console

    rows = [
        [tray.about, percent(tray.measured), percent(tray.computed), f"{100 * tray.used:.0f}", f"{tray.pull:+.1f}"]
        for tray in found.trays
    ]
    heads = ["tray", "measured, %", "computed, %", "of the interval, %", "from the others, sd"]
    caption = "of the interval: the part of both 95 % intervals together that the difference takes"
    Console().print(screen_table(heads, rows, "measured and computed shares", caption))
    print_lines([found.sentence])
