"""compare.html: finished runs side by side, one file that opens offline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ...answer.result_table import PARTS, THROUGHPUT, is_part
from ...core.files import atomic_write
from ...scene import RESERVED_BIN, Scene
from ..canvas import bins_across, fraction_colours
from ..figures import captions
from ..many_figures import main_quantities
from ..words import NO_VALUE, difference_text, percent
from .report_page import inlined_pictures, shape_of
from .rows import input_text, number, page_template

if TYPE_CHECKING:
    from ...answer.result import Result
    from ...answer.result_table import Entry, ResultTable, TableQuantity
    from ..words import Differences

COMPARED = (*PARTS, "lost.", THROUGHPUT, "airflow.")  # the rest is in differences.csv


class _Row(NamedTuple):
    """A quantity in every run, and by how much later runs differ from the first; ``clear``: one of them surely."""

    quantity: str
    values: list[str]
    differences: list[tuple[str, bool]]
    clear: bool


class _Pair(NamedTuple):
    """One picture of every run that has it, (run, base64 PNG); ``long``: too wide for half a page."""

    name: str
    caption: str
    pictures: list[tuple[str, str]]
    long: bool


def write_comparison(path: Path, table: ResultTable, differences: Differences, runs: Sequence[Result]) -> None:
    """Write the page of ``runs``, in the order of the ``table``'s entries: what differs in their scenes, their answers
    with the differences from the first and their intervals, and their pictures side by side.
    """
    names = [entry.name for entry in table.entries]
    scenes = [Scene.parse(run.scene) for run in runs]
    rows = _rows(table, differences)
    main = set(main_quantities(table))
    text = page_template("compare.html.j2").render(
        names=names, less=[f"{name if len(names) > 2 else ''} less {names[0]}" for name in names[1:]],
        made=[(name, run.provenance.date.replace("T", " "), run.plan.rung, run.versions["wakeflow"])
              for name, run in zip(names, runs, strict=True)],
        inputs=[(key, *(input_text(key, entry.inputs.get(key)) for entry in table.entries)) for key in table.inputs],
        main=[row for row in rows if row.quantity in main], rows=rows, bins=_bins(scenes),
        colours=fraction_colours(list(dict.fromkeys(name for scene in scenes for name in scene.fraction))),
        shares=[(entry.name, _shares(entry)) for entry in table.entries], pairs=_pairs(names, runs),
    )  # fmt: skip
    with atomic_write(path) as stream:
        stream.write(text)


def _rows(table: ResultTable, differences: Differences) -> list[_Row]:
    """The quantities that are reported, in the order of the table; those that are zero in every run are left out."""
    rows = []
    for name in (name for name in table.names if name.startswith(COMPARED)):
        numbers = [entry.by_name.get(name) for entry in table.entries]
        if not any(one is not None and (one.value or one.high) for one in numbers):
            continue
        later = [differences.get(name, {}).get(entry.name) for entry in table.entries[1:]]
        told = [(NO_VALUE, False) if one is None else (difference_text(one), one.clear) for one in later]
        rows.append(_Row(name, [_value(name, one) for one in numbers], told, any(clear for _, clear in told)))
    return rows


def _value(name: str, found: TableQuantity | None) -> str:
    if found is None:
        return NO_VALUE
    if is_part(name):
        return f"{percent(found)} %"
    return f"{number(found.value)} {found.unit}".removesuffix(" 1")


def _bins(scenes: Sequence[Scene]) -> list[str]:
    """The bins of all scenes, those of the first from left to right, and elsewhere."""
    return [*dict.fromkeys(name for scene in scenes for name in bins_across(scene)), RESERVED_BIN]


def _shares(entry: Entry) -> Mapping[tuple[str, str], Mapping[str, object]]:
    """Percent by fraction and bin: value, low and high, and their words."""
    found = {}
    for name, one in entry.by_name.items():
        kind, *of = name.split(".", 2)
        if kind == "share" and len(of) == 2:
            value, low, high = (100.0 * part for part in (one if one.known else (one.value,) * 3))
            found[of[0], of[1]] = {"value": value, "low": low, "high": high, "told": _value(name, one)}
    return found


def _pairs(names: Sequence[str], runs: Sequence[Result]) -> list[_Pair]:
    """The standard pictures that more than one run has; a run without a report has none."""
    texts = captions()
    folders = {name: inlined_pictures(run.folder / "figures", texts) for name, run in zip(names, runs, strict=True)}
    pairs = []
    for which, caption in texts.items():
        found = [(name, pictures[which]) for name, pictures in folders.items() if which in pictures]
        if len(found) > 1:
            pairs.append(_Pair(which, caption, found, any(shape_of(picture) == "long" for _, picture in found)))
    return pairs
