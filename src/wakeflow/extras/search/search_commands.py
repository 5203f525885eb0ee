"""The command of the search: search. What it prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...cli.options import Processes, Quiet, Scheduler
from ...core.quantities import split_quantity
from ...scene.overrides import changes_of
from ...show.screen import print_lines, print_table

if TYPE_CHECKING:
    from ...answer.result_table import TableQuantity
    from .designs import FoundDesign, Search

AS_IT_STANDS = "the scene as it is"
Held = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set", negative="", help="Hold a key in all designs at all levels: air.speed='5 m/s'. Repeatable."
    ),
]


def search(
    file: Path,
    *,
    budget: Annotated[str | None, Parameter(help="Time of one core instead of the file's: '20 min'.")] = None,
    settings: Held = (),
    out: Annotated[Path | None, Parameter(help="Folder; default runs/, the file's name and what is held.")] = None,
    workers: Processes = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Find the best design of a scene: goals, limits and bounds in a file, coarse rungs first, within a budget.

    Prints the designs that no other beats in all goals, the recommended one first, and what to measure to be surer. The
    same command goes on where an interrupted one ended.

    Parameters
    ----------
    file
        A TOML file with a [search] table (docs/extras.md).
    """
    from ...runs.progress import live
    from ...scene.changes import run_folder
    from .designs import search as find
    from .task import read_search_file

    held = changes_of(settings)
    task = read_search_file(file, held, budget)
    folder = out or Path("runs", run_folder(file.stem, task.scene, held, {}))
    with live(enabled=not quiet) as listener:
        result = find(task, folder, scheduler=scheduler, workers=workers, listener=listener)
    if not quiet:
        show_search(result)


def show_search(result: Search) -> None:
    """Print the front, the recommended design first, how sure it is, and what to measure to be surer."""
    from ...show.terminal import measure_next

    task = result.task
    keys = [axis.keys[0] for axis in task.within]
    rows = [
        [
            label,
            *(_value(design.changes[key]) for key in keys),
            *(_quantity(design.quantities.get(name)) for name in task.quantities),
        ]
        for label, design in _labelled(result)
    ]
    heads = ["", *(head.replace(".", "\n") for head in (*keys, *task.quantities))]
    print_table(heads, rows, f"designs for {', '.join(map(str, task.goals))}")
    print_lines([*_verdict(result, result.recommended), *measure_next(result.result), f"results: {result.folder}"])


def _labelled(result: Search) -> Iterator[tuple[str, FoundDesign]]:
    """The recommended design, the others on the front, and the scene as it is, each once."""
    best, unchanged = result.recommended, result.as_it_stands
    name = None if unchanged is None else unchanged.name
    yield "recommended" if best.name != name else f"recommended: {AS_IT_STANDS}", best
    for design in result.front:
        if design.name != best.name:
            yield "on the front" if design.name != name else f"on the front: {AS_IT_STANDS}", design
    if unchanged is not None and name not in {best.name, *(design.name for design in result.front)}:
        yield AS_IT_STANDS if unchanged.allowed else f"{AS_IT_STANDS}, beyond the limits", unchanged


def _verdict(result: Search, best: FoundDesign) -> Sequence[str]:
    levels = zip(result.tried, result.seconds, strict=True)
    cost = ", ".join(f"{tried} designs in {seconds:.0f} s" for tried, seconds in levels)
    lines = [f"recommended, the first: {best.folder}", f"computed, from the coarsest level on: {cost} of one core"]
    if not best.allowed:
        lines.append("! no design that was computed keeps the limits; this one comes nearest")
    if result.rivals:
        lines.append(f"! within the intervals {len(result.rivals)} other designs may be as good")
    return lines


def _quantity(quantity: TableQuantity | None) -> str:
    from ...show.words import quantity_text

    unit = "" if quantity is None or quantity.unit == "1" else f" {quantity.unit}"
    return f"{quantity_text(quantity)}{unit}"


def _value(value: object) -> str:
    """A value to four digits, with its unit."""
    from ...show.many_figures import input_words

    if isinstance(value, str) and (parts := split_quantity(value)):
        return f"{parts[0]:.4g} {parts[1]}".strip()
    return input_words(value)
