"""Figures of many results at once: lines with whiskers over an input, maps over two, purity against recovery;
those that suit a table, drawn into its folder.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..answer.result import VOID
from ..answer.result_table import OPEN, Entry, ResultTable, TableQuantity
from ..core import own_files
from ..core.errors import SceneError
from ..core.number import NO_VALUE, UNKNOWN_ERROR, UNKNOWN_SPAN
from .canvas import INK, fraction_colours, new_figure, save, saved, text_width
from .plan_words import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import LineStyleType

Array = NDArray[np.float64]
_Lines = Mapping[str, list[tuple[float, TableQuantity]]]  # by what else varies: values of an input, quantities there
STYLES: Sequence[LineStyleType] = ("-", "--", ":", "-.")
MAX_LINES = len(STYLES)  # values of the other inputs that are told apart by the style of a line; else points
MAX_LABEL = 60  # letters of what tells a line from the others
PANEL, HIGH = 4.4, 3.8  # inches, of a panel with lines
NOTE_SIZE = 5.5  # points: of what is below a number
LETTERS, ROW, SAMPLE = 7.0, 0.16, 0.45  # legends: points, inches a row, inches a line's sample takes
UNKNOWN_COLOUR = "#dddddd"  # of a cell whose interval says too little for a colour
GREY = f"grey: no answer, or an interval of {100 * UNKNOWN_SPAN:.0f} points or more"
CELLS_WITH_TEXT = 64  # a map of more cells has no numbers in them
MAX_TICKS = 10  # of a map's axis with a tick at each value
MAPS_ACROSS = 3  # in a row of a figure
MARKERS = "osD^vP*X"
MAX_NUMBERED_SCENES = 8  # scenes whose points have their numbers
SHORT = 40  # letters of what such a scene is
CLOSE = 0.035  # of an axis: numbers at points that are no further from each other are written as one
SPREAD = 0.3  # of the least distance between two values of an input: over it stand the whiskers that belong to one,
NOTHING, ABSENT = TableQuantity(math.nan, name="", unit=""), Entry("", {}, OPEN)  # of a grid's empty place
WIDE = 0.15  # but over no more of the whole range: whiskers must be seen to belong together


def main_quantities(table: ResultTable) -> list[str]:
    """What a table is made for: what a scene with prices earns, recovery, purity, loss and dirt of fractions with a
    target and of their bins; without a target all shares in bins.
    """
    wanted = [f"recovery.{fraction}" for fraction in table.targets]
    wanted += [f"purity.{place}.{fraction}" for fraction, places in table.targets.items() for place in places]
    wanted += [f"loss.{fraction}" for fraction in table.targets]
    wanted += dict.fromkeys(f"dirt.{place}" for places in table.targets.values() for place in places)
    there = [name for name in ("money.total", *wanted) if name in table.names]
    return there or [name for name in table.names if name.startswith("share.") and not name.endswith(".elsewhere")]


def numeric_inputs(table: ResultTable) -> list[str]:
    """The inputs that are numbers and take more than one value among the scenes that are done."""
    values = {key: {_number(entry, key) for entry in table.done} - {math.nan} for key in table.inputs}
    return [key for key in table.inputs if len(values[key]) > 1]


def draw_lines(path: Path, table: ResultTable, names: Sequence[str], key: str) -> None:
    """Draw quantities over the input ``key``, with whiskers for their 95 % intervals: a panel each kind of quantity, a
    line each combination of the other inputs, or points alone where these are many. The lines of a panel are moved a
    little along x, so that the whiskers of one value are next to each other.

    Raises SceneError where a quantity or the input is not in the table.
    """
    table, names = table.read_in(UNITS), [table.quantity(name) for name in names]
    if key not in numeric_inputs(table):
        raise SceneError(f"{key}: takes no two numbers in this table (inputs: {', '.join(numeric_inputs(table))})")
    groups = {name: _groups(table, name, key) for name in names}
    rests = list(dict.fromkeys(itertools.chain(*groups.values())))
    styles = dict(zip(rests, STYLES, strict=False)) if len(rests) <= MAX_LINES else {}
    panels = _panels(names)
    legends = [_Legend.of(_looks(members), styles) for members in panels.values()]
    figure = new_figure(1.2 + PANEL * len(panels), HIGH + ROW * max(legend.rows for legend in legends))
    heads, grid = dict(zip(table.inputs, table.headings, strict=True)), figure.subplots(1, len(panels), squeeze=False)
    for axes, legend, (kind, members) in zip(grid[0], legends, panels.items(), strict=True):
        shifts = _shifts({name: groups[name] for name in members})
        for name in members:
            _lines(axes, groups[name], styles, legend.looks[name], shifts[name])
        axes.set_xlabel(heads[key])
        axes.set_ylabel(_label(kind, table.names[members[0]]))
        legend.draw(axes)
    save(figure, path)


class _Legend(NamedTuple):
    """What is above a panel: its quantities by colour and marker, what else varies by the style of the line."""

    looks: Mapping[str, _LineColour]
    styles: Mapping[str, LineStyleType]
    columns: int

    @classmethod
    def of(cls, looks: Mapping[str, _LineColour], styles: Mapping[str, LineStyleType]) -> _Legend:
        labels = {shorten(rest, MAX_LABEL, placeholder=" ..."): style for rest, style in styles.items() if rest}
        widest = max(text_width(text, LETTERS) for text in (*looks, *labels))
        return cls(looks, labels, max(1, int(PANEL / (widest + SAMPLE))))

    @property
    def rows(self) -> int:
        return -(-(len(self.looks) + len(self.styles)) // self.columns)

    def draw(self, axes: Axes) -> None:
        from matplotlib.lines import Line2D

        lines = [Line2D([], [], color=look.colour, marker=look.marker, label=n) for n, look in self.looks.items()]
        lines += [Line2D([], [], color=INK, linestyle=style, label=rest) for rest, style in self.styles.items()]
        axes.legend(
            handles=lines, ncols=self.columns, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2,
            fontsize=LETTERS, markerscale=0.6, frameon=False,
        )  # fmt: skip


class _LineColour(NamedTuple):
    colour: str
    marker: str


def _looks(quantities: Sequence[str]) -> dict[str, _LineColour]:
    """Each quantity in the colour of its fraction, recovery.FRACTION, share.FRACTION.BIN or purity.BIN.FRACTION, the
    dirt of a bin in one of its own, and with a marker that tells it from the others of that fraction.
    """
    parts = {name: name.split(".") for name in quantities}
    fractions = {name: part[-1] if part[0] == "purity" else part[min(1, len(part) - 1)] for name, part in parts.items()}
    colours = fraction_colours(list(fractions.values()))
    markers = {fraction: itertools.cycle(MARKERS) for fraction in colours}
    return {name: _LineColour(colours[fraction], next(markers[fraction])) for name, fraction in fractions.items()}


def _shifts(panel: Mapping[str, _Lines]) -> dict[str, dict[str, float]]:
    """How far each line of a panel moves along x, by quantity and what else varies: whole intervals that lie on top of
    each other cannot be told apart.
    """
    lines = [(name, rest) for name, groups in panel.items() for rest in groups]
    values = np.unique([x for groups in panel.values() for points in groups.values() for x, _ in points])
    room = 0.0
    if len(values) > 1 and len(lines) > 1:
        room = float(min(SPREAD * np.diff(values).min(), WIDE * np.ptp(values)))
    shifts: dict[str, dict[str, float]] = {name: {} for name in panel}
    for (name, rest), shift in zip(lines, np.linspace(-0.5 * room, 0.5 * room, len(lines)), strict=True):
        shifts[name][rest] = float(shift)
    return shifts


def _lines(
    axes: Axes, groups: _Lines, styles: Mapping[str, LineStyleType], look: _LineColour, shifts: Mapping[str, float]
) -> None:
    """A quantity's lines in their styles with whiskers; points alone where there are no styles, for they are many."""
    for rest, points in groups.items():
        points = sorted(points, key=lambda point: (point[0], point[1].value))
        spots = spots_of([quantity for _, quantity in points], _scale(points[0][1].name, points[0][1].unit))
        axes.errorbar(
            [x + shifts[rest] for x, _ in points], spots[0], spots[1:], linestyle=styles.get(rest, "none"),
            marker=look.marker, ms=3, lw=1.2, elinewidth=0.8, capsize=1.5, color=look.colour,
        )  # fmt: skip


def _groups(table: ResultTable, name: str, key: str) -> _Lines:
    """The quantities of a ``name`` at values of ``key``, by the text of what the other inputs are that vary."""
    others = [k for k in _varied(table) if k != key]
    groups: dict[str, list[tuple[float, TableQuantity]]] = {}
    for entry in table.done:
        quantity, x = entry.by_name.get(name), _number(entry, key)
        if quantity is not None and not math.isnan(x):
            groups.setdefault(_varied_words(entry, others), []).append((x, quantity))
    return groups


def _varied(table: ResultTable) -> list[str]:
    """The inputs that differ among the scenes that are done."""
    return [key for key in table.inputs if len({str(entry.inputs.get(key)) for entry in table.done}) > 1]


def input_words(value: object) -> str:
    """An input as it is written in tables and legends; a dash where a scene has none."""
    return NO_VALUE if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _varied_words(entry: Entry, keys: Sequence[str]) -> str:
    """What a scene's inputs of these ``keys`` are, by the last part of each key."""
    given = [key for key in keys if entry.inputs.get(key) is not None]
    return ", ".join(f"{key.rpartition('.')[2]} {input_words(entry.inputs[key])}" for key in given)


def draw_map(path: Path, table: ResultTable, names: Sequence[str], x: str, y: str) -> None:
    """Draw quantities as colours over two inputs that form a grid, with the numbers and their 95 % intervals where
    there is room; grey where the interval spans half of a whole. A quantity that no scene has a value of, such as the
    purity of a bin that stays empty, has no panel; those of two mirrored bins, which are the same, have one.

    Raises SceneError where the inputs form no grid, a value of each for every scene and no two scenes at one place,
    and where no quantity has a value.
    """
    table = table.read_in(UNITS)
    grid = grid_of(table, x, y)
    if not grid.rows:
        raise SceneError(f"{x} and {y} form no grid in this table; draw lines instead")
    panels_of = _alike(table, [name for name in names if _has_values(table, table.quantity(name))])
    if not panels_of:
        raise SceneError("nothing landed in the bins of these quantities, so that there is nothing to draw")
    heads, across = dict(zip(table.inputs, table.headings, strict=True)), min(len(panels_of), MAPS_ACROSS)
    down = -(-len(panels_of) // across)
    figure = new_figure(0.8 + 3.4 * across, 3.2 * down)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for axes in panels[len(panels_of) :]:
        axes.set_visible(False)
    for axes, (name, *others) in zip(panels, panels_of, strict=False):
        drawn = _cells(axes, grid, name, table.names[name])
        figure.colorbar(drawn, ax=axes, label="\n".join([_label(name, table.names[name]), *others]))
        axes.set(xlabel=heads[x], ylabel=heads[y])
        if max(len(grid.x), len(grid.y)) <= MAX_TICKS:
            axes.set(xticks=grid.x, yticks=grid.y)
        if np.ma.is_masked(drawn.get_array()):
            figure.supxlabel(GREY, fontsize=LETTERS)
    save(figure, path)


def _alike(table: ResultTable, names: Sequence[str]) -> list[list[str]]:
    """The quantities, those that have the same values in all scenes together."""
    groups: dict[object, list[str]] = {}
    for name in names:
        values = [entry.by_name.get(name) for entry in table.done]
        kind = name.partition(".")[0]
        groups.setdefault(tuple(value and (*value, kind) for value in values), []).append(name)
    return list(groups.values())


def _cells(axes: Axes, grid: _Grid, name: str, unit: str) -> Any:
    """A quantity as colours, which :func:`_colour_range` spreads; returns what a colour bar is made from."""
    scale = _scale(name, unit)
    cells = [entry.by_name.get(name, NOTHING) for row in grid.rows for entry in row]
    values, *arms = spots_of(cells, scale).reshape(3, len(grid.y), len(grid.x))
    widths = arms[0] + arms[1]
    low, high = _colour_range(values, widths, percent=scale != 1.0)
    unknown = (widths >= 100.0 * UNKNOWN_SPAN) & (scale != 1.0)
    shown = np.ma.masked_array(values, unknown | np.isnan(values))
    drawn = axes.pcolormesh(grid.x, grid.y, shown, shading="nearest", cmap="viridis", vmin=low, vmax=high)
    axes.set_facecolor(UNKNOWN_COLOUR)
    if values.size > CELLS_WITH_TEXT:
        return drawn
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            continue
        dark = value <= 0.5 * (low + high) and not unknown[row, column]
        at, ink, known = (grid.x[column], grid.y[row]), "white" if dark else INK, widths[row, column] > 0.0
        text = UNKNOWN_ERROR if unknown[row, column] else f"{value:.3g}"
        axes.text(*at, text, ha="center", va="bottom" if known else "center", fontsize=LETTERS, color=ink)
        if known:
            ends = f"{value - arms[0][row, column]:.3g} to {value + arms[1][row, column]:.3g}"
            axes.text(*at, ends, ha="center", va="top", fontsize=NOTE_SIZE, color=ink)
    return drawn


def _has_values(table: ResultTable, name: str) -> bool:
    return any(name in entry.by_name and math.isfinite(entry.by_name[name].value) for entry in table.done)


def _colour_range(values: Array, widths: Array, *, percent: bool) -> tuple[float, float]:
    """The ends of a map's colours: of its ``values``, but no closer than the median width of their intervals, since
    what the intervals hide is no difference to be seen; shares in percent end at 0 and 100.
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    wider = 0.5 * max(0.0, float(np.nanmedian(widths)) - (high - low))
    if not percent:
        return low - wider, high + wider
    return max(min(low, 0.0), low - wider), min(max(high, 100.0), high + wider)


class _Grid(NamedTuple):
    """Values of two inputs, and by lines of ``y`` the scene at each ``x``; no rows where they form no grid."""

    x: Sequence[float] = ()
    y: Sequence[float] = ()
    rows: Sequence[Sequence[Entry]] = ()


def grid_of(table: ResultTable, x: str, y: str) -> _Grid:
    """The scenes by their places in two inputs, which two scenes at one place, or half of it empty, form none of."""
    places: dict[tuple[float, float], Entry] = {}
    for entry in table.done:
        at = (_number(entry, x), _number(entry, y))
        if math.isnan(sum(at)) or at in places:
            return _Grid()
        places[at] = entry
    columns, lines = sorted({at[0] for at in places}), sorted({at[1] for at in places})
    if min(len(columns), len(lines)) < 2 or 2 * len(places) <= len(columns) * len(lines):
        return _Grid()
    return _Grid(columns, lines, [[places.get((column, line), ABSENT) for column in columns] for line in lines])


def draw_trade_off(path: Path, table: ResultTable) -> None:
    """Draw purity against recovery of every fraction and target, a point a scene, and the front: scenes of which none
    other is better in both. A few scenes have numbers at their points, and what they are beside the picture.
    """
    table, pairs = table.read_in(UNITS), pairs_of(table)
    if not pairs:
        raise SceneError("no fraction of these scenes has a target; there is no purity against recovery to draw")
    named = _scene_texts(table)
    figure = new_figure(5.6 + max(text_width(text, LETTERS) for text in (f"{'M' * 20}", *named)), 4.2)
    axes, colours = figure.add_subplot(), fraction_colours(sorted({fraction for fraction, _ in pairs}))
    places: list[tuple[int, float, float]] = []  # scene, recovery and purity in percent
    for marker, (fraction, place) in zip(itertools.cycle(MARKERS), pairs, strict=False):
        wanted = (f"recovery.{fraction}", f"purity.{place}.{fraction}")
        points = {
            number: tuple(entry.by_name[name] for name in wanted)
            for number, entry in enumerate(table.done, start=1)
            if set(wanted) <= set(entry.by_name)
        }
        if not points:
            continue
        (x, *xerr), (y, *yerr) = (spots_of(side, 100.0) for side in zip(*points.values(), strict=True))
        axes.errorbar(
            x, y, xerr=np.array(xerr), yerr=np.array(yerr), fmt=marker, ms=4, lw=0.7, color=colours[fraction],
            label=f"{fraction} in {place}",
        )  # fmt: skip
        spots = np.column_stack([x, y])
        front = spots[on_front(spots)]
        axes.plot(*front[np.argsort(front[:, 0])].T, color=colours[fraction], lw=1.2, alpha=0.6)
        places += zip(points, x.tolist(), y.tolist(), strict=True)
    axes.set(xlabel="recovery (%)", ylabel="purity (%)")
    _name_scenes(axes, named, places)
    handles = sorted(zip(*axes.get_legend_handles_labels(), strict=True), key=lambda handle: handle[1] in named)
    axes.legend(*zip(*handles, strict=True), fontsize=LETTERS, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    save(figure, path)


def _scene_texts(table: ResultTable) -> list[str]:
    """What each of a few scenes is, in the order of the table: what varies, or its name where that tells too little;
    empty where the scenes are many.
    """
    if len(table.done) > MAX_NUMBERED_SCENES:
        return []
    keys = _varied(table)
    texts = [_varied_words(entry, keys) for entry in table.done]
    if "" in texts or len(set(texts)) < len(texts):
        texts = [entry.name for entry in table.done]
    return [shorten(text, SHORT, placeholder=" ...") for text in texts]


def _name_scenes(axes: Axes, named: Sequence[str], places: Sequence[tuple[int, float, float]]) -> None:
    """The numbers of scenes at their points, together where points lie so close that numbers would hide each other,
    and a line of the legend for each.
    """
    if not named:
        return
    reach = CLOSE * np.array([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())])
    groups: list[tuple[Array, set[int]]] = []
    for number, *spot in places:
        here = next((members for at, members in groups if np.all(np.abs(at - spot) < reach)), None)
        if here is None:
            groups.append((np.array(spot), {number}))
        else:
            here.add(number)
    box = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
    for at, numbers in groups:
        text = ",".join(map(str, sorted(numbers))) if len(numbers) < len(named) else "all"
        axes.annotate(text, tuple(at), (3, 3), textcoords="offset points", fontsize=6.5, color=INK, bbox=box, zorder=5)
    for number, text in enumerate(named, start=1):
        axes.plot([], [], linestyle="none", marker=f"${number}$", mew=0, color=INK, label=text)


def on_front(spots: Array) -> NDArray[np.bool_]:
    """Which of ``spots`` (n, 2), both better the larger, no other beats in one without losing in the other."""
    no_worse = np.all(spots[None] >= spots[:, None], axis=2)
    better = np.any(spots[None] > spots[:, None], axis=2)
    return np.asarray(~np.any(no_worse & better, axis=1))


def pairs_of(table: ResultTable) -> list[tuple[str, str]]:
    """Fractions and their target bins of which recovery and purity are known."""
    names: Mapping[str, str] = table.names
    wanted = [(fraction, place) for fraction, places in table.targets.items() for place in places]
    return [(f, place) for f, place in wanted if f"recovery.{f}" in names and f"purity.{place}.{f}" in names]


def _panels(names: Sequence[str]) -> dict[str, list[str]]:
    """Quantities by what they are: the first part of the name, of the airflow's and the funnel's numbers the whole."""
    panels: dict[str, list[str]] = {}
    for name in names:
        kind = name.partition(".")[0]
        panels.setdefault(name if kind in ("airflow", "funnel") else kind, []).append(name)
    return panels


def _scale(name: str, unit: str) -> float:
    """Parts of a whole are drawn in percent."""
    return 100.0 if unit == "1" and not name.startswith(("airflow.", "funnel.")) else 1.0


def _label(name: str, unit: str) -> str:
    if unit == "1":
        return name if _scale(f"{name}.", unit) == 1.0 else f"{name} (%)"
    return f"{name} ({unit})"


def _number(entry: Entry, key: str) -> float:
    """An input; nan where it is no number."""
    value = entry.inputs.get(key)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def spots_of(quantities: Iterable[TableQuantity], scale: float) -> Array:
    """Values of quantities and how far their intervals reach below and above (3, n); nan of :data:`NOTHING`, zero where
    no interval is known.
    """
    value, *ends = np.array([(*quantity,) for quantity in quantities], dtype=float).reshape(-1, 3).T
    gaps = (value - ends[0], ends[1] - value)
    below, above = (np.where(np.isfinite(gap), np.maximum(gap, 0.0), value - value) for gap in gaps)
    return scale * np.stack([value, below, above])


COMMAND = "figures"  # whose files they are in a folder
OF_TABLE = re.compile(r"figures/((lines|map)-.*|trade-off)\.[a-z]+")  # the figures that a table had


def draw_table_figures(folder: Path, table: ResultTable) -> list[Path]:
    """Draw what suits the inputs of a table into figures/ of its ``folder``: a figure of lines for each, a map for each
    two that form a grid, and purity against recovery. Returns the files; those of an earlier table are removed, and
    nothing else: SHA256SUMS says which they are. Raises SceneError where one of others would be replaced.
    """
    drawn = _figures(folder / "figures", of_worth(table))
    files = [file for png in drawn for file in saved(png)]
    own_files.refuse_foreign(folder, files, COMMAND)
    for name in own_files.listed(folder):
        if OF_TABLE.fullmatch(name):
            (folder / name).unlink(missing_ok=True)
    with own_files.writing(folder, lambda: files, COMMAND):
        for png, draw in drawn.items():
            draw(png)
    return list(drawn)


def _figures(folder: Path, table: ResultTable) -> dict[Path, Callable[[Path], None]]:
    """What draws each figure, by its file."""
    names, keys = main_quantities(table), numeric_inputs(table)
    if not names or not table.done:
        return {}
    drawn: dict[Path, Callable[[Path], None]] = {
        folder / f"lines-{key}.png": partial(draw_lines, table=table, names=names, key=key) for key in keys
    }
    for x, y in itertools.combinations(keys, 2):
        if grid_of(table, x, y).rows:
            drawn[folder / f"map-{x}-{y}.png"] = partial(draw_map, table=table, names=names, x=x, y=y)
    if any(pairs_of(table)):
        drawn[folder / "trade-off.png"] = partial(draw_trade_off, table=table)
    return drawn


def of_worth(table: ResultTable) -> ResultTable:
    """The table without void answers, which say nothing."""
    return ResultTable([entry for entry in table.entries if entry.reason != VOID], table.targets)
