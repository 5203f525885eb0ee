"""The pages: that of a result, and that of several side by side; what every part of their templates is handed."""

from __future__ import annotations

import base64
import shlex
import struct
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ...answer.budget.agreement import Agreement, agreement_in, measured_in
from ...answer.result_table import PARTS, THROUGHPUT, is_part
from ...answer.shares import BudgetPart, BudgetRow, PartitionCurve
from ...core.files import atomic_write
from ...core.quantities import say, speaking
from ...scene import RESERVED_BIN, Scene
from ...scene.rungs import rungs
from ...scene.uncertainty import source_of
from ...scene.user_files import LOGOS
from .. import words
from ..asked_pictures import finished_pictures
from ..canvas import bins_across, fraction_colours
from ..figures import captions
from ..many_figures import main_quantities
from ..outcome import PagePart, page_additions
from ..plan_words import UNITS
from ..words import NO_VALUE, difference_text, percent
from . import rows
from .rows import input_text, number, page_template

if TYPE_CHECKING:
    from ...answer.result import Result
    from ...answer.result_table import Entry, ResultTable, TableQuantity
    from ..outcome import Outcome
    from ..words import Differences

FRONT = {  # the figures beside the answer, as SVG: they are printed in the size that they are drawn in
    "sketch": "Sketch of the machine to scale with its measures; they are in the table of the machine.",
    "landing": "Where each fraction lands: histograms along the walls; the shares are in the table below.",
}
MAX_MOVED = 3  # shares that are reported of a number
LONG = 1.75  # width over height of a picture that takes the page's whole width
TALL = 0.8  # of one that takes a sheet's whole height
HOW = {
    "measured": "from this run",
    "companion": "from flying granules again",
    "calibrated": "a true bound: all that lands within the shift of the bin's ends",
    "unknown": "not known",
}


def write_html(folder: Path | str, outcome: Outcome) -> Path:
    """Write ``folder/report.html`` from a run and the PNG files in ``folder/figures``."""
    folder = Path(folder)
    path = folder / "report.html"
    drawn = finished_pictures(folder / "figures")
    texts = {**captions(), **{name: picture.text or name for name, picture in drawn.items()}}
    pictures = inlined_pictures(folder / "figures", texts) | inlined_pictures(folder / "figures", FRONT, ".svg")
    with atomic_write(path) as stream:
        parts = [page_additions[name].part(folder, outcome) for name in page_additions]
        stream.write(render(outcome.result, pictures, texts, outcome.scene, parts))
    return path


def render(
    result: Result, pictures: Mapping[str, str], texts: Mapping[str, str] | None = None, scene: Scene | None = None,
    parts: Sequence[PagePart] = (),
) -> str:  # fmt: skip
    """The page as text; ``pictures``: name to base64 PNG, SVG of those beside the answer; ``texts``: name to what it
    shows, in their order, the standard figures' captions by default; ``scene``: that of the result by default;
    ``parts``: what extras add.

    Raises jinja2.UndefinedError when the page asks for what a result has not.
    """
    scene = Scene.parse(result.scene) if scene is None else scene
    text: str = page_template("page.html.j2").render(
        result=result, title=scene.report.title or machine_name(result, scene), made=result.provenance,
        pictures=_shown(pictures, captions() if texts is None else texts),
        front=[(pictures[name], alt) for name, alt in FRONT.items() if name in pictures], parts=parts,
        grades=_grades(result), logo=_logo(scene), measurements=words.measurement_lines(result), scene=scene,
        colours=fraction_colours(list(scene.fraction)), bins=[*bins_across(scene), RESERVED_BIN],
        rung_about=rungs[result.plan.rung].meaning if result.plan.rung in rungs else "", origin=_origin(result),
        cuts=[] if result.landings is None else [_cut(cut) for cut in result.landings.separation.cut if cut.overlaps],
        budget=words.condensed(result.budget), made_of=_made_of, how=_how, inputs=_inputs(result),
        agreement=_agreement(result),
    )  # fmt: skip
    return text


def machine_name(result: Result, scene: Scene) -> str:
    """What a machine without a title is called: as the scene file that was typed, else as its bodies are."""
    typed = [Path(word) for word in shlex.split(result.provenance.command)[1:] if word.endswith(".toml")]
    return typed[0].stem if typed else " and ".join(scene.body) or "channel"


def inlined_pictures(folder: Path, names: Iterable[str], suffix: str = ".png") -> dict[str, str]:
    """The files of ``names`` in a folder as base64, those that there are."""
    files = {name: folder / f"{name}{suffix}" for name in names}
    return {n: base64.b64encode(f.read_bytes()).decode("ascii") for n, f in files.items() if f.exists()}


def shape_of(picture: str) -> str:
    """What a base64 PNG is on a page: "long" where half of its width is too narrow for it, "tall", or neither."""
    width, height = struct.unpack(">II", base64.b64decode(picture[:48])[16:24])
    return "long" if width > LONG * height else "tall" if width < TALL * height else ""


def _shown(pictures: Mapping[str, str], texts: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """The shape of each picture, the picture, and what it shows; the sketch has a place of its own."""
    names = [name for name in texts if name in pictures and name not in FRONT]
    return [(shape_of(pictures[name]), pictures[name], texts[name]) for name in names]


def _grades(result: Result) -> list[tuple[str, list[str]]]:
    """The warnings by grade, the gravest first, what is for information last and apart."""
    lines = zip(result.grades, result.warnings, strict=True)
    return [(grade, [line for _, line in part]) for grade, part in groupby(lines, key=lambda row: row[0])]


def _origin(result: Result) -> list[tuple[str, str]]:
    made = {name: value for name, value in vars(result.provenance).items() if name != "host"}  # a report is passed on
    provenance = [(name, words.NO_VALUE if value is None else str(value)) for name, value in made.items()]
    return [*provenance, *result.versions.items(), ("fingerprint of the answer", result.key)]


def _logo(scene: Scene) -> str:
    """The scene's logo as a data URL; empty without one, and where its file is gone since."""
    given = scene.report.logo
    if not given or not (path := Path(given)).is_file():
        return ""
    return f"data:{LOGOS[path.suffix.lower()]};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def _cut(curve: PartitionCurve) -> tuple[str, ...]:
    """A row of the partition curves' cuts; sizes in mm."""
    scale, unit = (1e3, "mm") if curve.by == "size" else (1.0, curve.unit)
    cut, cells = curve.cut, [words.NO_VALUE] * 3
    if cut is not None:
        sharp = rows.number(None if curve.ep is None else scale * curve.ep)
        cells = [f"{rows.measured_text(cut, scale)} {unit}", sharp, rows.number(curve.imperfection)]
    return (" or ".join(curve.product), curve.by, *cells, curve.why)


def _made_of(row: BudgetRow) -> str:
    """The parts of an error in words, the largest first, those that are zero left out, unknown ones last."""
    known = sorted((part for part in row.parts if part.error), key=lambda part: -(part.error or 0.0))
    unknown = [part for part in row.parts if part.error is None]
    parts = [f"{part.source} {words.error_text(row, part.error)}" for part in known]
    return ", ".join([*parts, *(f"{part.source} {words.UNKNOWN_ERROR}" for part in unknown)])


def _how(part: BudgetPart) -> str:
    """How a source's error is known, and what is behind it."""
    how = HOW.get(part.how, part.how)
    return f"{how}: {part.note}" if part.note else how


def _agreement(result: Result) -> Agreement | None:
    """How what was measured of the scene agrees with the answer; None where nothing was, or it is in the answer."""
    known = result.landings is None or result.calibration is not None
    measured = None if known else measured_in(result)
    return None if measured is None else agreement_in(result, measured)


def _inputs(result: Result) -> list[tuple[str, ...]]:
    """What the page says of the numbers that are not known exactly, those first that move a share most."""
    landings = result.landings
    if landings is None or not landings.inputs:
        return []
    moves: dict[str, list[tuple[float, str]]] = {key: [] for key in landings.inputs}
    for name, places in landings.measure_next.items():
        for place, effects in places.items():
            for key, effect in effects.items():
                moves[key].append((-effect.half, f"{name} in {place} {100 * effect.half:.2g}"))
    shown = []
    for key, input_ in landings.inputs.items():
        most = sorted(moves[key], key=lambda move: move[0])[:MAX_MOVED]
        with speaking(UNITS):
            ends = [say(value, input_.unit, 3) for value in (input_.value, input_.low, input_.high)]
        moved = ", ".join(text for _, text in most)
        shown.append((most[0][0] if most else 0.0, (key, *ends, source_of(key, input_.why), moved)))
    return [row for _, row in sorted(shown, key=lambda row: row[0])]


# -- Finished runs side by side: compare.html --------------------------------------------------------------------------
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
        if not any(value is not None and (value.value or value.high) for value in numbers):
            continue
        later = [differences.get(name, {}).get(entry.name) for entry in table.entries[1:]]
        changes = [(NO_VALUE, False) if change is None else (difference_text(change), change.clear) for change in later]
        rows.append(_Row(name, [_value(name, value) for value in numbers], changes, any(clear for _, clear in changes)))
    return rows


def _value(name: str, quantity: TableQuantity | None) -> str:
    if quantity is None:
        return NO_VALUE
    if is_part(name):
        return f"{percent(quantity)} %"
    return f"{number(quantity.value)} {quantity.unit}".removesuffix(" 1")


def _bins(scenes: Sequence[Scene]) -> list[str]:
    """The bins of all scenes, those of the first from left to right, and elsewhere."""
    return [*dict.fromkeys(name for scene in scenes for name in bins_across(scene)), RESERVED_BIN]


def _shares(entry: Entry) -> Mapping[tuple[str, str], Mapping[str, object]]:
    """Percent by fraction and bin: value, low and high, and their words."""
    shares = {}
    for name, share in entry.by_name.items():
        kind, *of = name.split(".", 2)
        if kind == "share" and len(of) == 2:
            value, low, high = (100.0 * part for part in (share if share.known else (share.value,) * 3))
            shares[of[0], of[1]] = {"value": value, "low": low, "high": high, "told": _value(name, share)}
    return shares


def _pairs(names: Sequence[str], runs: Sequence[Result]) -> list[_Pair]:
    """The standard pictures that more than one run has; a run without a report has none."""
    texts = captions()
    folders = {name: inlined_pictures(run.folder / "figures", texts) for name, run in zip(names, runs, strict=True)}
    pairs = []
    for which, caption in texts.items():
        shown = [(name, pictures[which]) for name, pictures in folders.items() if which in pictures]
        if len(shown) > 1:
            pairs.append(_Pair(which, caption, shown, any(shape_of(picture) == "long" for _, picture in shown)))
    return pairs
