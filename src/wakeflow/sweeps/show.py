"""What a person at a terminal sees of many runs and of what they leave: costs, tables, differences, dividers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..core.cleaning import KeptStage
from ..core.quantities import duration
from ..report.many import main_quantities
from ..report.words import NO_VALUE, difference_text, percent
from ..results.difference import Difference
from ..results.dividers import Dividers, cut
from ..results.quantities import TableQuantity
from ..results.result import VOID
from ..results.table import DONE, Entry, ResultTable
from .comparison import RunComparison
from .compute import Sweep, SweepEstimate

__all__ = [
    "show_comparison",
    "show_dividers",
    "show_estimate",
    "show_removed",
    "show_stages",
    "show_sweep",
    "show_table",
]

FEW = 5  # scenes that are named in a line
MOST_ROWS = 50  # of a table on a terminal; all are in the file
GAP = 2  # letters between columns
LEVEL = ("floor", "top")  # lines along x
DIFFERENCES_HOLD = (
    "bold: zero lies outside of the interval, of what computing adds; of all that is not known where rungs or terms "
    "differ, and of purities"
)

Column = tuple[str, ...]  # its head and its cells


def show_estimate(estimate: SweepEstimate, workers: int) -> None:
    """Print how many scenes there are, what they share, and the cost."""
    from rich.console import Console

    console = Console()
    before = f", {estimate.finished} finished before" if estimate.finished else ""
    spent, alone = duration(estimate.seconds / workers), duration(estimate.seconds)
    lines = [
        f"{_counted(estimate.scenes, 'scene')}{before}: {_counted(estimate.airflows, 'airflow')} and "
        f"{_counted(estimate.flights, 'flight')} to compute",
        f"about {spent} on {_counted(workers, 'core')} ({alone} of one), {estimate.disk / 1e6:.0f} MB of disk",
        *(f"! {name}: {reason}" for name, reason in estimate.failed.items()),
    ]
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def show_sweep(found: Sweep) -> None:
    """Print the table of a sweep, what failed, and where everything is."""
    from rich.console import Console

    console = Console()
    show_table(found.table)
    for name, reason in found.failed.items():
        console.print(f"! {name}: {reason}", highlight=False, markup=False, style="yellow", soft_wrap=True)
    console.print(f"results: {found.folder}", highlight=False, soft_wrap=True)


def show_table(table: ResultTable) -> None:
    """Print a row a scene: its inputs and the quantities that it is made for, with half their 95 % intervals; where not
    all columns fit beside each other, in several tables.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    shown, names = table.entries[:MOST_ROWS], main_quantities(table)
    inputs = list(zip(_heads(table), *(_inputs(table, entry) for entry in shown), strict=True))
    numbers = list(
        zip((name.replace(".", "\n") for name in names), *(_cells(names, one) for one in shown), strict=True)
    )
    console, title = Console(), "percent, with 95 % interval"
    for columns in _fitting(inputs, numbers, console.width):
        drawn = Table(title=title, title_justify="left", pad_edge=False, collapse_padding=True, box=SIMPLE_HEAD)
        for head, *_ in columns:
            drawn.add_column(head, justify="right", overflow="fold")
        for row in zip(*(cells for _, *cells in columns), strict=True):
            drawn.add_row(*row)
        console.print(drawn)
        title = ""
    if len(table.entries) > MOST_ROWS:
        console.print(f"more in the file: {_counted(len(table.entries) - MOST_ROWS, 'scene')}")
    for line in _doubts(table):
        console.print(line, highlight=False, markup=False, style="yellow", soft_wrap=True)


def _doubts(table: ResultTable) -> Iterator[str]:
    """What stands against the numbers of a table."""
    for caveat, names in table.caveats.items():
        where = "every scene" if len(names) == len(table.done) > 1 else ", ".join(names[:FEW])
        more = f" and {len(names) - FEW} more" if where != "every scene" and len(names) > FEW else ""
        yield f"! {where}{more}: {'the answer is void' if caveat == VOID else f'intervals {caveat}'}"
    for key in table.idle():
        yield f"! {key} changes no number here: what is left out of these scenes does not feel it"


def _inputs(table: ResultTable, entry: Entry) -> list[str]:
    return [_text(entry.inputs.get(key)) for key in table.inputs] or [entry.name]


def _cells(names: Sequence[str], entry: Entry) -> list[str]:
    return [_cell(entry.by_name.get(name)) if entry.state == DONE else entry.state for name in names]


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


def show_comparison(found: RunComparison) -> None:
    """Print what differs in the scenes, the answers, and the differences from the first run."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    show_table(found.table)
    first, names = found.table.entries[0].name, set(main_quantities(found.table))
    names |= {"airflow.cd", "airflow.cp_base", "airflow.pressure_drop"}
    table = Table("less " + first, title="differences", title_justify="left", pad_edge=False, box=SIMPLE_HEAD)
    others = [entry.name for entry in found.table.entries[1:]]
    for name in others:
        table.add_column(name, justify="right", overflow="fold")
    rows: dict[str, dict[str, Difference]] = {}
    for one in found.differences:
        rows.setdefault(one.quantity, {})[one.scene] = one
    for quantity, row in rows.items():
        if quantity in names:
            table.add_row(quantity, *(_difference(row[name]) if name in row else NO_VALUE for name in others))
    table.caption, table.caption_justify = DIFFERENCES_HOLD, "left"
    Console().print(table if table.row_count else f"no number of {first} stands in another of these runs")


def _difference(one: Difference) -> str:
    text = difference_text(one).replace("[", "\\[")
    return f"[bold]{text}[/]" if one.clear else text


def show_dividers(found: Sequence[Dividers], on: str) -> None:
    """Print what dividers give at each purity asked; of a single one also the tables for a scene file."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    console, fraction = Console(), found[0].fraction
    title = f"{fraction} on {on}, percent; judged on granules that had no part in the choice, ± of their number alone"
    table = Table(title=title, title_justify="left", pad_edge=False, box=SIMPLE_HEAD)
    level = on in LEVEL  # places are the machine's own x there
    for head in ("purity asked", "purity", "recovery", f"stretches ({'x in mm' if level else 'mm along the line'})"):
        table.add_column(head, justify="right")
    for one in found:
        start = one.line[0, 0] if level else 0.0
        places = ", ".join(f"{1e3 * (start + low):.1f} to {1e3 * (start + high):.1f}" for low, high in one.stretches)
        judged = [percent(one.purity), percent(one.recovery)] if one.possible else [NO_VALUE, NO_VALUE]
        table.add_row(f"{100 * one.asked:.4g}", *judged, places or "no stretch reaches it")
    console.print(table)
    if len(found) > 1 or not found[0].possible:
        return
    for number, stretch in enumerate(found[0].stretches, 1):
        text = f"[bin.{fraction}-{number}]\n{_as_bin(found[0], stretch, on)}"
        console.print(text, markup=False, highlight=False, soft_wrap=True)
    if (found[0].purity.high or 1.0) < found[0].asked:
        console.print(
            f"! judged on other granules the product is less pure than the {100 * found[0].asked:.4g} % asked for: ask "
            "for more, or keep more granules to choose by with numerics.keep", style="yellow", soft_wrap=True,
        )  # fmt: skip


def _as_bin(found: Dividers, stretch: tuple[float, float], on: str) -> str:
    """The keys of a bin over a stretch: from and to on the floor, else the points of its line."""
    points = cut(found.line, *stretch)
    if on == "floor":
        return "\n".join(f'{key} = "{1e3 * x:.5g} mm"' for key, (x, _) in zip(("from", "to"), points, strict=True))
    ends = ", ".join(f'["{1e3 * x:.5g} mm", "{1e3 * y:.5g} mm"]' for x, y in points)
    return f"points = [{ends}]"


def show_removed(stages: Sequence[KeptStage], *, done: bool) -> None:
    """Say in one line what was or would be removed from the cache, and what making it again would take."""
    size, spent = sum(one.size for one in stages) / 1e6, sum(one.seconds or 0.0 for one in stages)
    verb, frees = ("removed", "freed") if done else ("would be removed", "would be freed")
    print(f"{len(stages)} stages {verb}, {size:.1f} MB {frees}, {duration(spent)} to make again")


def show_stages(stages: Sequence[KeptStage]) -> None:
    """Print what the cache holds, the one that was used longest ago first: size, time to make it again."""
    from datetime import UTC, datetime

    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table("used", "stage", "key", title="in the cache", title_justify="left", pad_edge=False, box=SIMPLE_HEAD)
    table.add_column("MB", justify="right")
    table.add_column("to make again", justify="right")
    for one in stages[:MOST_ROWS]:
        used = datetime.fromtimestamp(one.used, UTC).astimezone().strftime("%Y-%m-%d %H:%M")
        again = NO_VALUE if one.seconds is None else duration(one.seconds)
        table.add_row(used, one.stage, one.folder.name[:12], f"{one.size / 1e6:.1f}", again)
    if len(stages) > MOST_ROWS:
        rest = stages[MOST_ROWS:]
        again = duration(sum(one.seconds or 0.0 for one in rest))
        table.add_row("later", f"{len(rest)} more", "", f"{sum(one.size for one in rest) / 1e6:.1f}", again)
    table.add_section()
    total, spent = sum(one.size for one in stages), sum(one.seconds or 0.0 for one in stages)
    table.add_row("all", f"{len(stages)} stages", "", f"{total / 1e6:.1f}", duration(spent))
    Console().print(table)


def _heads(table: ResultTable) -> Sequence[str]:
    """Keys with their parts below each other, so that columns stay narrow."""
    heads = {key: key.replace(".", "\n") for key in table.inputs}
    return [f"{heads[key]}\n({unit})" if unit else heads[key] for key, unit in table.inputs.items()] or ["scene"]


def _cell(found: TableQuantity | None) -> str:
    return percent(found)


def _text(value: object) -> str:
    return NO_VALUE if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
