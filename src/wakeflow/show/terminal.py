"""What a person at a terminal sees of results: of a run its budget, the air, warnings, and last the answer;
sweeps and comparisons.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from textwrap import shorten
from typing import TYPE_CHECKING

from ..answer.measurements import PAGE
from ..answer.result import VOID
from ..answer.result_table import DONE, FAILED, Difference, Entry, ResultTable, is_part
from ..answer.shares import SHARE_UNIT, BudgetRow, Separation, least_certain, weightiest
from ..core.number import Number
from . import words
from .many_figures import input_words, main_quantities
from .plan_words import UNITS
from .screen import counted, plain, print_lines, print_table, screen_table, warn
from .words import NO_VALUE, difference_text, percent, quantity_text

if TYPE_CHECKING:
    from pathlib import Path

    from rich.table import Table
    from rich.text import Text

    from ..answer.budget.agreement import Agreement
    from ..answer.result import Result
    from .words import Differences

HOW_TO_MEASURE = f"How to measure: {PAGE}. Write what you find as {{ value = ..., uncertainty = ... }}."
WEIGHS, MAX_PARTS = 0.1, 4  # of the largest error of a quantity, and how many errors are reported on screen
UNBROKEN = 1000  # letters, in which no line of a table breaks
SHORTEST = 0.5  # s: shorter run times are not worth a word


def show_result(result: Result) -> None:
    """Print the budget, the funnel, the airflow, what pictures say, the gravest warnings, and last the answer."""
    from rich.console import Console

    console = Console()
    if result.landings is not None:
        console.print(budget_table(result.landings.budget))
    if result.funnel is not None:
        console.print(words.funnel_words(result.funnel), highlight=False)
    if result.airflow is not None:
        console.print(words.air_words(result.airflow), highlight=False)
        if result.airflow.loading is not None:
            console.print(words.loading_words(result), highlight=False)
    for name, picture in (result.pictures or {}).items():
        console.print(f"figures/{name}: {picture.text}", highlight=False, markup=False)
    if result.refinement is not None:
        for line in (*result.refinement.unmet, *result.refinement.measure):
            console.print(f"• {line}", highlight=False, markup=False)
    warn(result.warnings, result.grades)
    print_lines([f"results: {result.folder}"])
    if result.landings is not None:  # the answer last: it is what stays in sight
        if result.landings.without_collisions is not None:
            console.print(alone_table(result.landings.separation, result.landings.without_collisions))
        console.print(separation_table(result, result.landings.separation))


def separation_table(result: Result, separation: Separation) -> Table:
    """Bins by fractions: shares in percent with their 95 % interval; throughput, purity, recovery. Intervals are below
    their numbers where the screen is too narrow for them beside.
    """
    from rich.console import Console

    beside, console = _separated(result, separation, parted=False), Console()
    unbroken = console.measure(beside, options=console.options.update(max_width=UNBROKEN)).maximum
    return beside if unbroken <= console.width else _separated(result, separation, parted=True)


def _separated(result: Result, separation: Separation, *, parted: bool) -> Table:
    from rich.text import Text

    met = result.landings is not None and result.landings.slab is not None
    of = (
        "VOID: "
        if result.void
        else ""
        if result.calibration is None
        else f"calibrated with {result.calibration.source}: "
    )
    title = f"{of}share of each fraction's mass, %{', granules colliding' if met else ''}"
    rows: list[list[str | Text]] = []
    for row in words.bins_in_words(result, separation):
        pairs = [(_parted(share) if parted else share, wanted) for share, wanted in row.shares]
        shares = [Text(share, style="bold green" if wanted else "") for share, wanted in pairs]
        purest = "\n".join(f"{name} {_parted(share)}".strip() for name, share in row.purities)
        rows.append([row.place, *shares, row.flow, purest])
    below = [] if result.void else measure_next(result)  # more exact numbers mend no answer that is worth nothing
    first = [*words.verdict_lines(result), *words.money_lines(result)]
    caption = "\n".join(filter(None, [*first, words.holds(result), words.in_three_dimensions(result), *below]))
    heads = ["bin", *separation.fractions, "kg/h", "purity"]
    return screen_table(heads, [*rows[: -words.SUMMED], [], *rows[-words.SUMMED :]], title, caption)


def _parted(text: str) -> str:
    """A percentage with its interval below it, so that columns stay narrow."""
    return text.replace(" ", "\n", 1)


def measure_next(result: Result) -> list[str]:
    """What a measurement would make of each recovery and each purity of a target; without targets, on which numbers
    each fraction's least certain share depends most.
    """
    if lines := words.measurement_lines(result):
        return [*lines, HOW_TO_MEASURE]
    lines = []
    for name, (place, parts) in ({} if result.landings is None else least_certain(result.landings)).items():
        if known := weightiest(parts):
            inputs = ", ".join(f"{key} {part.points}" for key, part in known)
            lines.append(f"{name} in {place} depends most on (points each): {inputs}")
    return [*lines, HOW_TO_MEASURE] if lines else []


def alone_table(separation: Separation, alone: Separation) -> Table:
    """Bins by fractions: the shares of granules that meet no others, and what collisions change of them, in points."""

    def row(name: str, pairs: Iterable[tuple[Number | None, Number | None]]) -> list[str]:
        return [name, *(f"{words.percent(without)}  ({words.change_of(without, met)})" for without, met in pairs)]

    rows = [
        row(place, ((alone.fractions[name][place], together[place]) for name, together in separation.fractions.items()))
        for place in separation.bins
    ]
    recoveries = row("recovery", ((alone.recovery.get(n), separation.recovery.get(n)) for n in separation.fractions))
    title = "without collisions, %, and what they change, points"
    return screen_table(["bin", *separation.fractions], [*rows, [], recoveries], title)


def budget_table(budget: Sequence[BudgetRow]) -> Table:
    """The largest known errors of every quantity, the run time that knowing each source took, and what is unknown."""
    shown = words.condensed(budget)
    known = {part.source for row in shown for part in row.parts if part.error is not None}
    totals = any(row.total.error is not None for row in shown)  # else the note says why not
    rows = []
    for row in shown:
        unit = "" if row.measure == SHARE_UNIT else f" ({row.measure})"
        total = [_bare(row, row.total.error)] if totals else []
        rows.append([row.quantity.removeprefix("share.") + unit, _largest(row), *total])
    title = "budget: the largest errors, of shares in percentage points (all: budget.csv)"
    heads = ["quantity", "what limits it", *(["total"] if totals else [])]
    return screen_table(heads, rows, title, _budget_notes(shown, known), left=2)


def _largest(row: BudgetRow) -> str:
    """The largest errors of a quantity in words, those that weigh beside the largest."""
    parts = sorted((part for part in row.parts if part.error), key=lambda part: -(part.error or 0.0))
    if not parts:
        return words.NO_VALUE
    weighing = [part for part in parts if (part.error or 0.0) >= WEIGHS * (parts[0].error or 0.0)][:MAX_PARTS]
    return ", ".join(f"{part.source} {_bare(row, part.error)}" for part in weighing)


def _budget_notes(rows: Sequence[BudgetRow], known: Collection[str]) -> str:
    """Which terms are behind each sum of terms, and which sources are unknown."""
    notes: dict[str, None] = {}  # in order, each once
    for row in rows:
        for part in row.parts:
            if part.source in words.TERMS.values():
                notes[f"{row.quantity.split('.')[1]}, {part.source}: {part.note}"] = None
    cost = {source: spent for source, spent in words.source_seconds(rows).items() if spent >= SHORTEST}
    if cost:
        notes[f"run time, s: {', '.join(f'{source} {spent:.0f}' for source, spent in cost.items())}"] = None
    if unknown := [source for source in words.budget_columns(rows) if source not in known]:
        notes[f"unknown, so that no total is claimed: {', '.join(unknown)}"] = None
    return "\n".join(notes)


def _bare(row: BudgetRow, error: float | None) -> str:
    """An error without its unit, for a table that names it elsewhere."""
    return words.error_text(row, error).removesuffix(f" {row.measure}")


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


def show_sweep(table: ResultTable, folder: Path) -> None:
    """Print the table of a sweep, what failed, and the ``folder`` where everything is."""
    show_table(table)
    print_lines((f"! {entry.name}: {entry.reason}" for entry in table.entries if entry.state == FAILED), "yellow")
    print_lines([f"results: {folder}"])


def show_table(table: ResultTable) -> None:
    """Print a row a scene: its inputs and the quantities that it is made for, with their 95 % intervals; where not
    all columns fit beside each other, in several tables.
    """
    from rich.console import Console

    table = table.read_in(UNITS)
    shown, names = table.entries[:MAX_ROWS], main_quantities(table)
    inputs = list(zip(_heads(table), *(_inputs(table, entry) for entry in shown), strict=True))
    numbers = list(
        zip((_quantity_head(table, name) for name in names), *(_cells(names, entry) for entry in shown), strict=True)
    )
    console, title = Console(), "percent, with 95 % interval"
    for columns in _fitting(inputs, numbers, console.width):
        rows = zip(*(cells for _, *cells in columns), strict=True)
        print_table([head for head, *_ in columns], rows, title, left=0)
        title = ""
    if len(table.entries) > MAX_ROWS:
        console.print(f"more in the file: {counted(len(table.entries) - MAX_ROWS, 'scene')}")
    print_lines(_doubts(table), "yellow")


def _doubts(table: ResultTable) -> Iterator[str]:
    """What is against the numbers of a table."""
    for caveat, names in table.caveats.items():
        where = ", ".join(names[:MAX_NAMED_SCENES])
        if len(names) == len(table.done) > 1:
            where = "every scene"
        elif len(names) > MAX_NAMED_SCENES:
            where += f" and {len(names) - MAX_NAMED_SCENES} more"
        yield f"! {where}: {'the answer is void' if caveat == VOID else f'intervals {caveat}'}"
    for key in table.idle():
        yield f"! {key} changes no number here: what is left out of these scenes does not feel it"


def _quantity_head(table: ResultTable, name: str) -> str:
    """Head of a column: the parts of its name below each other, and the unit of what is no percentage."""
    head = name.replace(".", "\n")
    return head if is_part(name) or table.names[name] in ("", "1") else f"{head}\n({table.names[name]})"


def _inputs(table: ResultTable, entry: Entry) -> list[str]:
    return [input_words(entry.inputs.get(key)) for key in table.inputs] or [entry.name]


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


def show_comparison(table: ResultTable, keys: Sequence[str], differences: Differences) -> None:
    """Print what differs in the scenes, the answers, and the ``differences`` from the first run; of runs that are the
    same computation, which their ``keys`` say, that alone.
    """
    from rich.console import Console

    first, *others = (entry.name for entry in table.entries)
    if len(set(keys)) == 1:
        print_lines([f"{' and '.join([first, *others])} are the same computation"])
        return
    if len(table.inputs) > MAX_KEYS:
        _show_keys(table)
        show_table(replace(table, entries=[replace(entry, inputs={}) for entry in table.entries]))
    else:
        show_table(table)
    same = [name for name, key in zip(others, keys[1:], strict=True) if key == keys[0]]
    print_lines(f"{name} is the same computation as {first}" for name in same)
    wanted = {*main_quantities(table), "airflow.cd", "airflow.cp_base", "airflow.pressure_drop"}
    rows = [
        [quantity, *(_difference(row[name]) if name in row else NO_VALUE for name in others)]
        for quantity, row in differences.items()
        if quantity in wanted
    ]
    shown = screen_table(["less " + first, *others], rows, "differences", DIFFERENCES_HOLD)
    Console().print(shown if rows else f"no number of {first} is in another of these runs")


def _show_keys(table: ResultTable) -> None:
    """Print the keys in which scenes differ, a line each: of machines that have little in common."""
    table = table.read_in(UNITS)
    cells = [[input_words(entry.inputs.get(key)) for entry in table.entries] for key in table.inputs]
    rows = [
        [head, *(shorten(cell, LONGEST_VALUE, placeholder=" ...") for cell in row)]
        for head, row in zip(table.headings, cells, strict=True)
    ]
    print_table(["key", *(entry.name for entry in table.entries)], rows, "what differs")


def _difference(difference: Difference) -> Text:
    return plain(difference_text(difference), "bold" if difference.clear else "")


def show_agreement(agreement: Agreement) -> None:
    """Print a row a tray, both shares with their 95 % intervals, and the verdict in a sentence."""
    rows = [
        [tray.about, percent(tray.measured), percent(tray.computed), f"{100 * tray.used:.0f}", f"{tray.pull:+.1f}"]
        for tray in agreement.trays
    ]
    heads = ["tray", "measured, %", "computed, %", "of the interval, %", "from the others, sd"]
    caption = "of the interval: the part of both 95 % intervals together that the difference takes"
    print_table(heads, rows, "measured and computed shares", caption)
    print_lines([agreement.sentence])
