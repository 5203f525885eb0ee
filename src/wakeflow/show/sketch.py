"""The sketch of a machine: what a scene asks for, drawn to scale with its measures, before or after it is computed."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.files import atomic_write
from ..core.quantities import metres, say, speaking
from .canvas import BARS, INK, MM, new_figure, save, solids, text_width
from .outcome import add_figure
from .plan_words import UNITS, body_words, feed_corners, feed_words, tilt_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..scene import Scene
    from .canvas import AnyFigure, Paper

Array = NDArray[np.float64]
FILES = ("png", "svg", "pdf")
AIR, FEED = "#0b7285", "#c98500"
LARGEST, ON_A_PAGE = 5.4, 1.9  # inches of the machine itself; beside an answer on the first page of paper
PAGE, LEAST = 7.1, 0.3  # inches: width of that page; of a machine between long notes on it
TEXT_SIZE, LINE = 9.0, 0.172  # points of the measures; inches of a line of them
BESIDE = 0.35  # inches between the machine and what is written beside it
MIN_SCALE = 0.5  # inches per m of a machine in a part of a figure that has no room for its notes
OUTSIDE = 0.22  # inches between the machine and a line of measures along it
POINTS_PER_INCH = 72.0  # an inch: the unit of an SVG's viewBox
HEIGHT = 0.75  # inches on the left that the channel's height takes


@dataclass(frozen=True)
class _Note:
    """A text beside the machine and the place (m) of what it is about; ``left``: on which side it is written."""

    at: tuple[float, float]
    text: str
    left: bool = False


@dataclass(frozen=True)
class _Sheet:
    """Axes in mm, and where on them the machine ends: left, right, low, high (m); ``scale``: inches per m."""

    axes: Axes
    window: tuple[float, float, float, float]
    scale: float

    def away(self, inches: float) -> float:
        """A distance on paper as one on the axes (mm)."""
        return MM * inches / self.scale


def draw_sketch(
    scene: Scene, units: Mapping[str, str] = UNITS, paper: Paper = "", largest: float = LARGEST, page: float = math.inf,
) -> AnyFigure:  # fmt: skip
    """The machine to scale: bodies, channel, air, feed, secondary streams, bins with their names and limits; measures.

    ``units``: what measures are said in, of units of the SI, as :func:`wakeflow.scene.units_written` finds them in a
    scene file; by default mm, degrees and kg/h. Coordinates are the scene's. ``paper``: a figure to draw in, or axes to
    take the place of, instead of a figure with its own Agg canvas. ``largest``: inches of the machine's longer side,
    less where the whole is wider than a ``page``. Returns the figure; everything lies within it.
    """
    with speaking({**UNITS, **units}):
        notes = list(_notes(scene))
        bounds = _window(scene)
        figure, sheet = _sheet(bounds, notes, scene, paper, (largest, page))
        _draw_channel(sheet, scene)
        _draw_feed(sheet.axes, scene)
        _draw_air(sheet, scene)
        _draw_gravity(sheet, scene)
        solids(sheet.axes, scene, 5.0)
        _draw_vibration(sheet, scene)
        _draw_bins(sheet, scene)
        _write(sheet, notes)
    return figure


def write_sketch(path: Path, scene: Scene, units: Mapping[str, str] = UNITS) -> None:
    """Write :func:`draw_sketch` to a PNG, SVG or PDF file that is whole or absent. Raises SceneError for another."""
    kind = path.suffix.removeprefix(".").lower()
    if kind not in FILES:
        raise SceneError(f"{path}: a picture's name ends in {', '.join(f'.{suffix}' for suffix in FILES)}")
    figure = draw_sketch(scene, units).figure
    with atomic_write(path, "wb") as stream:
        figure.savefig(stream, format=kind)


@dataclass(frozen=True)
class DrawnSketch:
    """A sketch as the text of an SVG, and where in the units of its viewBox the point x = y = 0 of the scene is, with
    how many of these units are a metre; y points down there.
    """

    svg: str
    origin: tuple[float, float]
    scale: float


def sketch_svg(scene: Scene, units: Mapping[str, str] = UNITS) -> DrawnSketch:
    """:func:`draw_sketch` for a page on which it is not the last layer; its writing stays writing."""
    import matplotlib

    figure = draw_sketch(scene, units).figure
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text, (x, y) = stream.getvalue(), figure.axes[0].transData.transform((0.0, 0.0))
    dots = POINTS_PER_INCH / figure.dpi
    across = figure.axes[0].transData.transform((MM, 0.0))[0] - x
    tall = POINTS_PER_INCH * figure.get_size_inches()[1]
    return DrawnSketch(text[text.index("<svg") :], (float(dots * x), float(tall - dots * y)), float(dots * across))


def _window(scene: Scene) -> tuple[float, float, float, float]:
    """Left, right, low and high end (m) of the channel, with the feed above it."""
    half, channel = scene.channel.width / 2, scene.channel
    return -half, half, channel.bottom, max(channel.top, float(feed_corners(scene)[:, 1].max()))


def _sheet(
    window: tuple[float, float, float, float], notes: list[_Note], scene: Scene, paper: Paper,
    room: tuple[float, float],
) -> tuple[AnyFigure, _Sheet]:  # fmt: skip
    """Paper that holds the machine, the measures along it and the notes beside it."""
    left, right, low, high = window
    before, after = HEIGHT + _longest(notes, left=True), BESIDE + _longest(notes, left=False)
    widest = min(room[0], max(LEAST, room[1] - before - after))
    scale = min(room[0] / (high - low), widest / (right - left))
    below, above = (_names_room(scene, on, scale) for on in ("floor", "top"))
    above += OUTSIDE + LINE
    wide, tall = before + scale * (right - left) + after, below + scale * (high - low) + above
    figure = new_figure(wide, tall, paper)
    if figure.figure is figure:
        figure.figure.set_layout_engine("none")
    else:  # a part of another figure has the size that it has there
        wide, tall = figure.bbox.width / figure.dpi, figure.bbox.height / figure.dpi
        scale = max(MIN_SCALE, min((wide - before - after) / (right - left), (tall - below - above) / (high - low)))
    size = (scale * (right - left) / wide, scale * (high - low) / tall)
    axes = figure.add_axes((before / wide, (tall - above - scale * (high - low)) / tall, *size))
    axes.set_xlim(MM * left, MM * right)
    axes.set_ylim(MM * low, MM * high)
    axes.set_axis_off()
    axes.set_aspect("equal")
    return figure, _Sheet(axes, window, scale)


def _longest(notes: list[_Note], *, left: bool) -> float:
    """Inches that the notes on a side take."""
    lines = [line for note in notes if note.left == left for line in note.text.split("\n")]
    return max((text_width(line, TEXT_SIZE) for line in lines), default=0.0) + 0.1


def _names_room(scene: Scene, on: str, scale: float) -> float:
    """Inches that names and limits of the bins on a side of the channel take."""
    placed = _bins_on(scene, on)
    if not placed:
        return 0.1
    upright = not _level(placed, scale)
    longest = max(text_width(name, TEXT_SIZE) for name in placed) if upright else LINE
    return longest + (max(text_width(text, TEXT_SIZE) for text in _limits(placed).values()) if upright else LINE) + 0.15


def _bins_on(scene: Scene, on: str) -> dict[str, tuple[float, float]]:
    """The bins on a side of the channel, in order of place, with their ends (m) along it."""
    return dict(sorted(((n, b.ends) for n, b in scene.on_sides(on).items()), key=lambda item: item[1]))


def _limits(placed: Mapping[str, tuple[float, float]]) -> dict[float, str]:
    """The ends of bins in words, without the unit, which the channel's measures have."""
    return {end: metres(end).split(" ")[0] for ends in placed.values() for end in ends}


def _level(placed: Mapping[str, tuple[float, float]], scale: float) -> bool:
    """Whether the names of bins, and their limits, find room side by side."""
    limits = max(text_width(text, TEXT_SIZE) for text in _limits(placed).values()) + 0.05
    return all(max(text_width(n, TEXT_SIZE), limits) < scale * (end - start) for n, (start, end) in placed.items())


def _draw_channel(sheet: _Sheet, scene: Scene) -> None:
    """Walls, open ends, its width above and its height on the left."""
    channel, axes = scene.channel, sheet.axes
    left, right = -MM * channel.width / 2, MM * channel.width / 2
    low, high = MM * channel.bottom, MM * channel.top
    for x in (left, right):
        axes.plot([x, x], [low, high], color=INK, linewidth=1.4, clip_on=False, zorder=4)
    for y in (low, high):
        axes.plot([left, right], [y, y], color=INK, linewidth=0.5, linestyle=":", clip_on=False, zorder=2)
    over = sheet.away(OUTSIDE + _names_room(scene, "top", sheet.scale))
    top = max(high, MM * sheet.window[3]) + over
    _measure(axes, (left, top), (right, top), metres(channel.width))
    beside = left - sheet.away(1.8 * OUTSIDE)
    _measure(axes, (beside, low), (beside, high), metres(channel.top - channel.bottom))
    for y in (low, high):
        place = (left - sheet.away(0.06), y)
        label = metres(y / MM).split(" ")[0]
        axes.annotate(label, place, ha="right", va="center", fontsize=TEXT_SIZE, color=AIR, annotation_clip=False)
    axes.plot([0.0, 0.0], [low, high], color="#9aa3ad", linewidth=0.6, linestyle="-.", zorder=0)


def _measure(axes: Axes, start: tuple[float, float], end: tuple[float, float], text: str) -> None:
    """A line of measure with its text in the middle, along x or y."""
    style = {"arrowstyle": "<|-|>", "color": INK, "linewidth": 0.7, "mutation_scale": 8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=end, xytext=start, arrowprops=style, annotation_clip=False, zorder=8)
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "linewidth": 0}
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    axes.annotate(
        text, middle, ha="center", va="center", fontsize=TEXT_SIZE, rotation=90 if start[0] == end[0] else 0, bbox=box,
        annotation_clip=False, zorder=9,
    )  # fmt: skip


def _draw_feed(axes: Axes, scene: Scene) -> None:
    """The curtain from where it is released down to the body, or the arrow of its entry."""
    feed, (height, _) = scene.feed, scene.release
    corners = MM * feed_corners(scene)
    x, half, level = MM * feed.position, MM * feed.width / 2, MM * scene.level
    style = {"arrowstyle": "-|>", "color": FEED, "linewidth": 1.3, "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0}
    axes.plot(*corners[:2].T, color=FEED, linewidth=3, solid_capstyle="butt", zorder=3)
    if height > 0.0:
        axes.fill(*corners.T, color=FEED, alpha=0.18, linewidth=0, clip_on=False, zorder=1)
        top = tuple(corners[:2].mean(axis=0).tolist())
        axes.annotate("", (x, level), xytext=top, arrowprops=style, annotation_clip=False, zorder=3)
    elif feed.start == "falling":
        entry = scene.entry / max(float(np.linalg.norm(scene.entry)), 1e-12)
        tip = np.array([x, level]) + 2 * half * 0.4 * entry
        axes.annotate("", tuple(tip), xytext=(x, level), arrowprops=style, annotation_clip=False, zorder=3)


def _draw_air(sheet: _Sheet, scene: Scene) -> None:
    """Arrows where the air comes in, and at each secondary stream its opening with an arrow."""
    channel, axes = scene.channel, sheet.axes
    style = {"arrowstyle": "-|>", "color": AIR, "linewidth": 1.3, "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0}
    if scene.air is not None and not scene.air.still:
        down = scene.air.direction == "down"
        tail = MM * (channel.top if down else channel.bottom)
        head = tail + (-1 if down else 1) * min(0.08 * MM * (channel.top - channel.bottom), sheet.away(0.35))
        for part in (-0.42, -0.25, 0.25, 0.42):
            x = MM * part * channel.width
            axes.annotate("", (x, head), xytext=(x, tail), arrowprops=style, annotation_clip=False, zorder=3)
    for inlet in channel.inlet.values():
        inward = 1.0 if inlet.side == "left" else -1.0
        wall = -inward * MM * channel.width / 2
        axes.plot([wall] * 2, [MM * y for y in inlet.span], color=AIR, linewidth=5, solid_capstyle="butt", zorder=6)
        tip, y = wall + inward * sheet.away(0.35), MM * inlet.position
        axes.annotate("", (tip, y), xytext=(wall, y), arrowprops=style, annotation_clip=False, zorder=7)


def _draw_gravity(sheet: _Sheet, scene: Scene) -> None:
    """Where it is at an angle to the channel an arrow along it, in the corner that the air leaves by."""
    if scene.plumb.upright:
        return
    left, _, low, _ = sheet.window
    arm, down = sheet.away(0.35), scene.plumb.down
    middle = np.array([MM * left, MM * low]) + 1.6 * arm
    tail, head = middle - 0.5 * arm * down, middle + 0.5 * arm * down
    style = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.3, "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0}
    sheet.axes.annotate("", tuple(head), xytext=tuple(tail), arrowprops=style, annotation_clip=False, zorder=8)
    label = tuple(tail - 0.25 * arm * down)
    sheet.axes.annotate("g", label, ha="center", va="center", fontsize=TEXT_SIZE, color=INK, zorder=8)


def _draw_vibration(sheet: _Sheet, scene: Scene) -> None:
    """An arrow on each body along its vibration; of bodies that rock across the way to the pivot, a cross there."""
    if scene.vibration is None:
        return
    for body in scene.body.values():
        outline = MM * body.outline()
        middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
        along, pivot = scene.vibration.along, scene.vibration.pivot
        if pivot is not None:
            off = middle - MM * np.asarray(pivot)
            along = (
                np.array([-off[1], off[0]]) / max(float(np.hypot(*off)), 1e-9) if off.any() else np.array([0.0, 1.0])
            )
            sheet.axes.plot(*(MM * np.asarray(pivot)), "+", color=INK, markersize=7, markeredgewidth=1.2, zorder=7)
        arm = 0.35 * min(np.ptp(outline, axis=0).min(), sheet.away(0.6)) * along
        style = {"arrowstyle": "<|-|>", "color": "white", "linewidth": 1.1, "mutation_scale": 8}
        sheet.axes.annotate("", tuple(middle + arm), xytext=tuple(middle - arm), arrowprops=style, zorder=6)


def _draw_bins(sheet: _Sheet, scene: Scene) -> None:
    """Bins as bars on their lines; those on the floor and the top with their names and limits along it."""
    for i, bin_ in enumerate(sorted(scene.bin.values(), key=lambda bin_: (bin_.on, float(bin_.line(scene).sum())))):
        bar = MM * bin_.line(scene)
        sheet.axes.plot(*bar.T, color=BARS[i % 2], linewidth=5, solid_capstyle="butt", clip_on=False, zorder=5)
    for on, y, away in (("floor", scene.channel.bottom, -1), ("top", scene.channel.top, 1)):
        placed = _bins_on(scene, on)
        if not placed:
            continue
        level = _level(placed, sheet.scale)
        side, turned = "top" if away < 0 else "bottom", 0 if level else 90
        limits = _limits(placed)
        beyond = LINE if level else max(text_width(text, TEXT_SIZE) for text in limits.values()) + 0.05
        rows = [(x, text, 0.08, AIR) for x, text in limits.items()]
        rows += [(sum(ends) / 2, name, 0.08 + beyond, INK) for name, ends in placed.items()]
        for x, text, inches, colour in rows:
            place = (MM * x, MM * y + away * sheet.away(inches))
            sheet.axes.annotate(
                text, place, fontsize=TEXT_SIZE, color=colour, ha="center", va=side, rotation=turned,
                annotation_clip=False,
            )  # fmt: skip


def _notes(scene: Scene) -> Iterator[_Note]:
    """What is said beside the machine, of the feed, the air, each body, and the bins that are not on floor or top."""
    channel, half = scene.channel, scene.channel.width / 2
    yield _Note(tuple(feed_corners(scene)[1].tolist()), feed_words(scene))
    if not scene.plumb.upright:
        words = tilt_words(scene).replace(", ", "\n")
        yield _Note((-half, channel.bottom + 0.1 * (channel.top - channel.bottom)), words, True)
    if scene.air is not None:
        end = channel.top if scene.air.direction == "down" else channel.bottom
        inner = end + (-0.04 if scene.air.direction == "down" else 0.04) * (channel.top - channel.bottom)
        case = " (a solved case)" if scene.air.case else ""
        yield _Note((0.42 * channel.width, inner), f"air {scene.air.blows}{case}")
    for name, inlet in channel.inlet.items():
        wall = -half if inlet.side == "left" else half
        words = f"stream {name}: {say(inlet.velocity, 'm/s')}\nfrom an opening of {metres(inlet.width)}"
        yield _Note((wall, inlet.position), words, inlet.side == "left")
    for i, (name, body) in enumerate(scene.body.items()):
        outline = body.outline()
        left = float(outline[:, 0].min() + outline[:, 0].max()) < -0.02 * channel.width
        corner = outline[np.argmin(outline[:, 0]) if left else np.argmax(outline[:, 0])]
        yield _Note((float(corner[0]), float(corner[1])), body_words(name, body, scene if i == 0 else None), left)
    for name, bin_ in scene.bin.items():
        if (note := bin_.note(name, scene)) is not None:
            (x, y), words, left = note
            yield _Note((float(x), float(y)), words, left)


def _write(sheet: _Sheet, notes: list[_Note]) -> None:
    """Notes in a column on either side, as near to the height of what they are about as there is room, with lines."""
    left, right, *_ = sheet.window
    for on_left, x in ((True, MM * left - sheet.away(HEIGHT)), (False, MM * right + sheet.away(BESIDE))):
        column = sorted((note for note in notes if note.left == on_left), key=lambda note: -note.at[1])
        line = {"arrowstyle": "-", "color": "#9aa3ad", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 2}
        for note, y in zip(column, _places(sheet, column), strict=True):
            sheet.axes.annotate(
                note.text, (MM * note.at[0], MM * note.at[1]), xytext=(x, y), ha="right" if on_left else "left",
                va="center", fontsize=TEXT_SIZE, arrowprops={**line, "relpos": (float(on_left), 0.5)},
                annotation_clip=False, zorder=7,
            )  # fmt: skip


def _places(sheet: _Sheet, column: list[_Note]) -> Array:
    """Heights (mm) of notes from the top down, together as near to those of their objects as keeps them apart."""
    if not column:
        return np.zeros(0)
    tall = np.array([sheet.away(LINE * (note.text.count("\n") + 1.6)) for note in column])
    below = np.concatenate([[0.0], np.cumsum((tall[1:] + tall[:-1]) / 2)])  # of the first one's middle, at the least
    wanted = np.array([MM * note.at[1] for note in column])
    return np.asarray(_falling(wanted + below) - below)


def _falling(wanted: Array) -> Array:
    """The falling sequence that is nearest to ``wanted`` (n,): neighbours that rise are pooled (Ayer, M. et al. 1955,
    Ann. Math. Stat. 26, 641). SciPy's own takes longer to import than a plan to draw.
    """
    pools: list[tuple[float, int]] = []  # mean and number
    for value in wanted:
        mean, count = float(value), 1
        while pools and pools[-1][0] < mean:
            pooled, more = pools.pop()
            mean, count = (pooled * more + mean * count) / (more + count), more + count
        pools.append((mean, count))
    return np.repeat([mean for mean, _ in pools], [count for _, count in pools])


def _draw(paper: Paper, scene: Scene) -> Axes:
    figure = draw_sketch(scene, paper=paper, largest=ON_A_PAGE, page=PAGE)
    save(figure, paper)
    return figure.axes[0]


add_figure(
    "sketch", "The machine to scale, with its measures.", _draw, lambda outcome: (outcome.scene,),
    always=True, of_answer=False,
)  # fmt: skip
