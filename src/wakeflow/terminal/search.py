"""What a person at a terminal sees of a search: its front, the recommended design, what would make it surer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..core.quantities import split_quantity
from ..report.words import NO_VALUE, percent
from ..results.quantities import TableQuantity
from ..searching.designs import FoundDesign, Search
from .shares import measure_next

__all__ = ["show_search"]

AS_IT_STANDS = "the scene as it stands"


def show_search(found: Search) -> None:
    """Print the front, the recommended design first, how sure it is, and what to measure to be surer."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    task, best = found.task, found.recommended
    asked = task.asked
    goals = ", ".join(map(str, task.goals))
    table = Table(title=f"designs for {goals}", title_justify="left", pad_edge=False, box=SIMPLE_HEAD)
    keys = [axis.keys[0] for axis in task.within]
    table.add_column("")
    for head in keys + asked:
        table.add_column(head.replace(".", "\n"), justify="right", overflow="fold")
    for label, design in _labelled(found):
        cells = [_cell(design.quantities.get(name)) for name in asked]
        table.add_row(label, *(_value(design.changes[key]) for key in keys), *cells)
    console = Console()
    console.print(table)
    for line in [*_verdict(found, best), *measure_next(found.result), f"results: {found.folder}"]:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _labelled(found: Search) -> Iterator[tuple[str, FoundDesign]]:
    """The recommended design, the others on the front, and the scene as it stands, each once."""
    best, own = found.recommended, found.as_it_stands
    name = None if own is None else own.name
    yield "recommended" if best.name != name else f"recommended: {AS_IT_STANDS}", best
    for design in found.front:
        if design.name != best.name:
            yield "on the front" if design.name != name else f"on the front: {AS_IT_STANDS}", design
    if own is not None and name not in {best.name, *(design.name for design in found.front)}:
        yield AS_IT_STANDS if own.allowed else f"{AS_IT_STANDS}, beyond the limits", own


def _verdict(found: Search, best: FoundDesign) -> Sequence[str]:
    levels = zip(found.tried, found.seconds, strict=True)
    cost = ", ".join(f"{tried} designs in {seconds:.0f} s" for tried, seconds in levels)
    lines = [f"recommended, the first: {best.folder}", f"computed, from the coarsest level on: {cost} of one core"]
    if not best.allowed:
        lines.append("! no design that was computed keeps the limits; this one comes nearest")
    if found.rivals:
        lines.append(f"! within the intervals {len(found.rivals)} other designs may be as good")
    return lines


def _cell(one: TableQuantity | None) -> str:
    if one is None:
        return NO_VALUE
    if one.unit == "1":
        return percent(one)
    return f"{one.value:.4g} {one.unit}"


def _value(value: object) -> str:
    """A value to four digits, with its unit."""
    if isinstance(value, str) and (parts := split_quantity(value)):
        return f"{parts[0]:.4g} {parts[1]}".strip()
    return f"{value:.4g}" if isinstance(value, float) else str(value)
