"""What the pictures of a run share: colours, figures without a screen, maps on triangles, the body and the air.

Drawn through matplotlib's object interface, into files by Agg: no screen, no OpenGL, no global state. Where a drawing
goes is its ``paper``: a PNG to write, an empty figure, or axes. Lengths are in mm, y up, as the scene has them.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError
from ..core.files import atomic_write
from ..core.tables import AnyArray, CellTable, write_arrays

# -- What the pictures of a run share ----------------------------------------------------------------------------------
if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.patches import Polygon
    from matplotlib.tri import Triangulation

    from ..air.field import FlowField
    from ..scene import Scene

    AnyFigure = Figure | SubFigure
    Paper = Path | str | Axes | AnyFigure

Array = NDArray[np.float64]
Window = tuple[float, float, float, float]  # left, right, low, high (m)

BODY, INK, STREAM = "#8a8a8a", "#1a1a1a", "#0b7285"
BARS = (INK, "#7d7d7d")  # bins, in turn along a wall
MM = 1000.0
DPI = 160
MARGIN = 0.08  # inches around what is drawn
SUFFIXES = (".png", ".svg", ".pdf", ".csv", ".npz")  # of a figure and its data
LETTER = 0.6  # mean width of a letter over the font size
TALLEST, WIDEST = 6.6, 5.6  # inches of a map
LETTERS = 9.0  # points
_pdf_too: ContextVar[bool] = ContextVar("pdf_too", default=False)
TICKS = 9  # along x, where the map is as wide as it is high


def bins_across(scene: Scene) -> list[str]:
    """The bins from left to right by their middles; those beside each other on a wall from the top down."""
    middles = {name: bin_.line(scene).mean(axis=0) for name, bin_ in scene.bin.items()}
    return sorted(middles, key=lambda name: (round(float(middles[name][0]), 9), -float(middles[name][1])))


def text_width(text: str, size: float) -> float:
    """Estimate of a text's width (inches) at a font size (points)."""
    return LETTER * size * len(text) / 72


def new_figure(width: float, height: float, paper: Paper = "") -> AnyFigure:
    """An empty figure (inches) with its own Agg canvas for a file; where the ``paper`` is a figure, that one in this
    size; where it is axes, a part of their figure in their place.

    Raises SceneError for axes that are in no grid of a figure.
    """
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure, SubFigure

    if isinstance(paper, Axes):
        spec = paper.get_subplotspec()
        if spec is None:
            raise SceneError("these axes are in no grid: make them with pyplot.subplots, or hand over a figure")
        parent = paper.figure
        paper.remove()
        return parent.add_subfigure(spec)
    if isinstance(paper, SubFigure):
        return paper
    if isinstance(paper, Figure):
        paper.set_size_inches(width, height)
        return paper
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_axes(width: float, height: float, paper: Paper = "") -> Axes:
    """Axes that are the ``paper``, else those of a :func:`new_figure` with one panel."""
    from matplotlib.axes import Axes

    return paper if isinstance(paper, Axes) else new_figure(width, height, paper).add_subplot()


def canvas(window: Window, paper: Paper = "") -> tuple[AnyFigure, Axes, float]:
    """Figure and axes for a map of a window, and its scale (inches per m)."""
    across, up = window[1] - window[0], window[3] - window[2]
    scale = min(TALLEST / up, WIDEST / across)
    axes = new_axes(max(scale * across, 2.0) + 2.4, scale * up + 1.1, paper)
    if axes is paper:
        room = axes.get_window_extent()
        scale = min(room.height / up, room.width / across) / axes.figure.dpi
    axes.set_aspect("equal")
    return axes.figure, axes, scale


def frame(axes: Axes, window: Window, margin: Mapping[str, float] = {}) -> None:
    """Limits: the window, and room (m) beside it for the names of bins, which stand outside of its frame."""
    from matplotlib.ticker import MaxNLocator

    axes.set_xlim(MM * (window[0] - margin.get("left", 0.0)), MM * (window[1] + margin.get("right", 0.0)))
    axes.set_ylim(MM * (window[2] - margin.get("floor", 0.0)), MM * (window[3] + margin.get("top", 0.0)))
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")
    axes.tick_params(labelsize=8)
    count = max(2, round(TICKS * (window[1] - window[0]) / (window[3] - window[2])))
    axes.xaxis.set_major_locator(MaxNLocator(count, steps=[1, 2, 2.5, 5, 10]))
    if margin:
        axes.spines[:].set_visible(False)
        for ticks, set_ticks, (low, high) in (
            (axes.get_xticks(), axes.set_xticks, window[:2]),
            (axes.get_yticks(), axes.set_yticks, window[2:]),
        ):
            set_ticks([t for t in ticks if MM * low - 1e-6 <= t <= MM * high + 1e-6])


def solids(axes: Axes, scene: Scene, level: float = 4.0) -> list[Polygon]:
    """The bodies, at the middle of their motion, on a ``level`` of the picture."""
    return [
        axes.fill(*(MM * body.outline()).T, facecolor=BODY, edgecolor=INK, linewidth=0.9, zorder=level)[0]
        for body in scene.body.values()
    ]


def air_arrow(axes: Axes, scene: Scene, window: Window, number: str = "") -> None:
    """Where the air goes, in the upper left corner of the window, ``number`` before its speed; nothing at rest."""
    if scene.air is None or scene.air.still:
        return
    across, up = window[1] - window[0], window[3] - window[2]
    x, ends = MM * (window[0] + 0.06 * across), [MM * (window[3] - part * up) for part in (0.02, 0.1)]
    tail, head = ends if scene.air.direction == "down" else ends[::-1]
    style = {"arrowstyle": "-|>", "color": INK, "linewidth": 2.0, "mutation_scale": 16}
    axes.annotate("", xy=(x, head), xytext=(x, tail), zorder=10, arrowprops=style)
    box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    axes.annotate(
        f"{number}air {scene.air.speed:g} m/s", xy=(x, sum(ends) / 2), xytext=(12, 0), textcoords="offset points",
        fontsize=8, va="center", zorder=10, bbox=box,
    )  # fmt: skip


def streams(axes: Axes, scene: Scene) -> None:
    """The openings of the secondary air streams, each with an arrow into the channel, its name and its speed.

    Where the picture ends before the wall the arrow is at its border, without the opening. One above or below the
    picture is not drawn.
    """
    style = {"arrowstyle": "-|>", "color": STREAM, "linewidth": 2.0, "mutation_scale": 14}
    box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    half = MM * scene.channel.width / 2
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for name, inlet in scene.channel.inlet.items():
        inward = 1.0 if inlet.side == "left" else -1.0
        wall, ends = -inward * half, [MM * y for y in inlet.span]
        if ends[1] < low or ends[0] > high:
            continue
        if left <= wall <= right:
            axes.plot([wall, wall], ends, color=STREAM, linewidth=5, solid_capstyle="butt", zorder=6)
        wall, y, size = min(max(wall, left), right), MM * inlet.position, 0.12 * (right - left)
        axes.annotate("", xy=(wall + inward * size, y), xytext=(wall, y), zorder=10, arrowprops=style)
        axes.annotate(
            f"{name} {inlet.velocity:g} m/s", (wall, ends[1]), xytext=(4 * inward, 4), textcoords="offset points",
            fontsize=8, ha="left" if inward > 0 else "right", va="bottom", zorder=10, bbox=box,
        )  # fmt: skip


def draw_bins(axes: Axes, scene: Scene, scale: float) -> dict[str, float]:
    """Bins as bars on their lines with their names outside the channel; the room (m) the names need on each side."""
    outward = {"floor": (0, -1), "top": (0, 1), "left": (-1, 0), "right": (1, 0)}
    align = {"floor": ("center", "top"), "top": ("center", "bottom"), "left": ("right", "center"),
             "right": ("left", "center")}  # fmt: skip
    margin = dict.fromkeys(outward, 0.0)
    for on in outward:
        placed = {name: bin_.line(scene) for name, bin_ in scene.on_sides(on).items()}
        placed = dict(sorted(placed.items(), key=lambda item: float(item[1].sum())))
        room = {name: scale * float(np.ptp(line, axis=0).max()) for name, line in placed.items()}
        level = all(text_width(name, 8) < room[name] for name in placed) and on in ("floor", "top")
        for i, (name, line) in enumerate(placed.items()):
            axes.plot(*(MM * line).T, color=BARS[i % 2], linewidth=5, solid_capstyle="butt", zorder=5)
            axes.annotate(
                name, MM * line.mean(axis=0), xytext=(5 * outward[on][0], 5 * outward[on][1]), fontsize=8,
                textcoords="offset points", ha=align[on][0], va=align[on][1],
                rotation=0 if level else 90, annotation_clip=False,
            )  # fmt: skip
        if placed:
            upright = not level and on in ("floor", "top")
            margin[on] = ((max(text_width(n, 8) for n in placed) + 0.1) if upright else 0.27) / scale
    for name, bin_ in scene.bin.items():
        if name not in scene.on_sides():
            line = bin_.line(scene)
            axes.plot(*(MM * line).T, color=BARS[0], linewidth=4, solid_capstyle="butt", zorder=5)
            box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": INK, "linewidth": 0.5}
            axes.annotate(name, MM * line.mean(axis=0), fontsize=8, ha="center", va="center", zorder=6, bbox=box)
    return margin


def triangulation(field: FlowField) -> Triangulation:
    """The field's mesh in mm."""
    from matplotlib.tri import Triangulation

    return Triangulation(MM * field.points[:, 0], MM * field.points[:, 1], field.triangles)


def inside_window(points: Array, window: Window) -> NDArray[np.bool_]:
    """Which points (n, 2) m lie in a window."""
    x, y = points.T
    return np.asarray((x >= window[0]) & (x <= window[1]) & (y >= window[2]) & (y <= window[3]))


@dataclass(frozen=True)
class PlotGrid:
    """Nodal values on a regular grid: x (nx,) and y (ny,) in m, values (ny, nx) masked outside the mesh."""

    x: Array
    y: Array
    values: list[Any]

    @classmethod
    def sample(cls, mesh: Triangulation, window: Window, nodal: Sequence[Array], count: int = 240) -> PlotGrid:
        """``count`` points along the longer side of the window; linear on each triangle of ``mesh`` (mm)."""
        from matplotlib.tri import LinearTriInterpolator

        step = max(window[1] - window[0], window[3] - window[2]) / count
        x = np.linspace(window[0], window[1], max(8, round((window[1] - window[0]) / step)))
        y = np.linspace(window[2], window[3], max(8, round((window[3] - window[2]) / step)))
        at = np.meshgrid(MM * x, MM * y)
        return cls(x, y, [LinearTriInterpolator(mesh, value)(*at) for value in nodal])

    def arrays(self, names: Sequence[str]) -> dict[str, Array]:
        """The grid's lines and its values (ny, nx) under ``names``, NaN outside the mesh."""
        values = (np.ma.filled(value.astype(np.float32), np.nan) for value in self.values)
        return {"x (m)": self.x, "y (m)": self.y, **dict(zip(names, values, strict=True))}

    def columns(self, names: Sequence[str]) -> dict[str, Array]:
        """The grid's points inside the mesh and the values there under ``names``, as columns of one table."""
        inside = ~np.any([np.ma.getmaskarray(value) for value in self.values], axis=0)
        x, y = np.meshgrid(self.x, self.y)
        columns = zip(names, self.values, strict=True)
        return {"x (m)": x[inside], "y (m)": y[inside], **{name: np.asarray(v[inside]) for name, v in columns}}


@contextmanager
def pdf_too(wanted: bool = True) -> Iterator[None]:
    """Have every figure that is saved within it written as PDF as well, where that is ``wanted``."""
    token = _pdf_too.set(wanted)
    try:
        yield
    finally:
        _pdf_too.reset(token)


def save(figure: AnyFigure, paper: Paper, data: Mapping[str, ArrayLike] = {}) -> None:
    """Write a figure to ``paper`` (.png) and as SVG next to it, cut to what is drawn, and the ``data`` that it shows:
    CSV where they are columns of one table, else NPZ. Names of data carry their units. Every file is whole or absent.
    As PDF too within :func:`pdf_too`. Writes nothing where the drawing is on axes or a figure that were handed
    over.
    """
    from matplotlib import rc_context

    if not isinstance(paper, Path | str):
        return
    path, root = Path(paper), figure.figure
    _unify(root)
    root.draw_without_rendering()  # laid out once, not again for every format
    root.set_layout_engine(None)
    drawn = root.get_tightbbox().padded(MARGIN)
    undated: dict[str, dict[str, object]] = {".png": {}, ".svg": {"Date": None}}
    if _pdf_too.get():
        undated[".pdf"] = {"CreationDate": None}
    # text stays text; a figure is alike whenever it is drawn
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": path.stem, "pdf.fonttype": 42}):
        for suffix, metadata in undated.items():
            with atomic_write(path.with_suffix(suffix), "wb") as stream:
                root.savefig(stream, format=suffix[1:], bbox_inches=drawn, metadata=metadata)
    if data:
        _save_data(path, {name: np.asarray(values) for name, values in data.items()})


def _unify(figure: Figure) -> None:
    """One size of letters for the axes of every picture, the colour bars' too."""
    for axes in figure.axes:
        axes.tick_params(labelsize=LETTERS)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_fontsize(LETTERS)


def _save_data(path: Path, data: Mapping[str, AnyArray]) -> None:
    if len({values.shape for values in data.values()}) == 1 and next(iter(data.values())).ndim == 1:
        rows = list(zip(*(column.tolist() for column in data.values()), strict=True))
        CellTable(list(data), rows).write_csv(path.with_suffix(".csv"), 7)
        return
    with atomic_write(path.with_suffix(".npz"), "wb") as stream:
        write_arrays(stream, data, compressed=True)


def saved(path: Path) -> list[Path]:
    """What :func:`save` may leave for ``path`` (.png)."""
    return [path.with_suffix(suffix) for suffix in SUFFIXES]


# -- The colours of fractions ------------------------------------------------------------------------------------------
# Okabe & Ito (2008), "Color Universal Design", without its yellow, too pale for a line, and with a grey and a brown.
# tests/unit/show/test_figures.py measures how far apart they are seen, with any kind of colour vision.
AMBER, BLUE, VERMILION, GREY = "#E69F00", "#0072B2", "#D55E00", "#555555"
GREEN, SKY, PINK, BROWN, BLACK = "#009E73", "#56B4E9", "#CC79A7", "#6B3D00", "#000000"
COLOURS = (BLUE, VERMILION, GREEN, AMBER, GREY, PINK, SKY, BROWN, BLACK)
KNOWN = {  # what a cleaner meets: the four that are fed together most often are the farthest apart
    "wheat": AMBER,
    "chaff": BLUE,
    "straw": VERMILION,
    "dust": GREY,
    "barley": GREEN,
    "rapeseed": PINK,
    "glass-beads": SKY,
}


FOREMOST = 16  # fractions that a figure shows: more have no room in it, nor a colour of their own


def foremost(scene: Scene, names: Sequence[str]) -> list[str]:
    """Names that a figure has room for, of ``names`` in their order: the fractions with most mass, of those with the
    same mass some from first to last.
    """
    if len(names) <= FOREMOST:
        return list(names)
    shares = scene.mass_shares()
    least = sorted((shares[name] for name in names), reverse=True)[FOREMOST - 1]
    above = {name for name in names if shares[name] > least}
    alike = [name for name in names if shares[name] == least]
    picked = np.linspace(0, len(alike) - 1, FOREMOST - len(above)).round().astype(int)
    return [name for name in names if name in above | {alike[i] for i in picked}]


def of_all(shown: Sized, whole: Sized) -> str:
    """What a title adds where a figure shows some of the fractions only."""
    return "" if len(shown) == len(whole) else f" ({len(shown)} of {len(whole)} fractions)"


def fraction_colours(names: Sequence[str]) -> dict[str, str]:
    """One colour a fraction, by its name: that of :data:`KNOWN`, else one that the name alone decides, or the next that
    no other of ``names`` has. Beyond nine fractions colours come again.
    """
    chosen = {name: KNOWN[name] for name in names if name in KNOWN}
    for name in sorted(set(names) - set(chosen)):
        first = zlib.crc32(name.encode()) % len(COLOURS)
        turns = [COLOURS[(first + i) % len(COLOURS)] for i in range(len(COLOURS))]
        chosen[name] = next((colour for colour in turns if colour not in chosen.values()), turns[0])
    return {name: chosen[name] for name in names}
