"""The standard figures of where granules land: histograms along walls, partition curves, shares in each wake."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..canvas import COLOURS, INK, MM, bins_across, foremost, fraction_colours, new_figure, of_all, save, text_width
from ..outcome import add_figure
from ..words import UNKNOWN_ERROR, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from ...answer.shares import PartitionCurve, Separation
    from ...core.number import Number
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Landed, Outcome

Array = NDArray[np.float64]
CELLS = 60  # of a histogram along one wall
SHADES = ("#e6ebf1", "#f6f7f9")
HEADROOM = 1.5  # above the highest cell, for the shares
TEXT_SIZE = 9.0  # points: the figure stands on paper in the size that it is drawn in
ACROSS, ALL_ROWS = 5.8, 2.4  # inches of all columns and, where they have room for their writing, of all rows
LEAST_ROW, UPRIGHT_ROW = 0.55, 0.8  # inches of a row whose shares lie, and stand
SHARE = "99.99 %"


@dataclass(frozen=True)
class _Wall:
    """One column: a coordinate (m) along a wall or a bin's own line, and where on it each bin (by its index) stands."""

    title: str
    span: tuple[float, float]
    bins: dict[int, tuple[float, float]]

    def edges(self) -> Array:
        """Histogram edges (m): about CELLS cells, with an edge wherever a bin begins or ends."""
        marks = np.unique([*self.span, *(x for ends in self.bins.values() for x in ends)])
        cell = (self.span[1] - self.span[0]) / CELLS
        pieces = [
            np.linspace(a, b, max(1, round((b - a) / cell)), endpoint=False) for a, b in itertools.pairwise(marks)
        ]
        return np.append(np.concatenate(pieces), marks[-1])


def draw_landing(
    paper: Paper, scene: Scene, landings: Mapping[str, Landed], separation: Separation
) -> NDArray[np.object_]:
    """Histograms of where each fraction lands, one row a fraction, one column a wall
    that has bins; of very many fractions the :func:`foremost`.

    ``landings``: of every fraction by name. ``separation`` brings the shares that are written.
    """
    names, walls = foremost(scene, list(landings)), list(_walls_with_bins(scene))
    wide = ACROSS / len(walls)
    least = UPRIGHT_ROW if any(_upright(wall, wide, SHARE) for wall in walls) else LEAST_ROW
    row_height = max(least, ALL_ROWS / max(len(names), 1))
    figure = new_figure(1.2 + ACROSS, 0.8 + row_height * max(len(names), 1), paper)
    panels = figure.subplots(max(len(names), 1), len(walls), squeeze=False, sharex="col", sharey="row")
    colours = fraction_colours(names)
    cells: list[tuple[object, ...]] = []  # of all panels, one below the other
    for row, name in enumerate(names):
        landed = separation.fractions[name]
        shares = {place: f"{percent(row).partition(' ')[0]} %".replace(f"{UNKNOWN_ERROR} %", UNKNOWN_ERROR)
                  for place, row in landed.items()}  # fmt: skip
        peak = 0.0
        for axes, wall in zip(panels[row], walls, strict=True):
            edges, share = _histogram(wall, scene, landings[name])
            peak = max(peak, _draw_histogram(axes, wall, edges, share, colours[name]))
            names_of = [name] * len(share), [wall.title.replace("(mm)", "").strip()] * len(share)
            cells.append((*names_of, edges[:-1], edges[1:], share))
            _write_shares(axes, wall, scene, shares, wide)
        axes = panels[row][0]
        axes.set_ylim(0.0, HEADROOM * peak if peak > 0 else 1.0)
        axes.set_ylabel(name)
        panels[row][-1].annotate(
            f"elsewhere\n{shares['elsewhere']}", (1.0, 0.5), xytext=(6, 0), xycoords="axes fraction",
            textcoords="offset points", fontsize=TEXT_SIZE, va="center",
        )  # fmt: skip
    for axes, wall in zip(panels[0], walls, strict=True):
        _name_bins(axes, wall, scene, wide)
    for axes, wall in zip(panels[-1], walls, strict=True):
        axes.set_xlabel(wall.title)
    some = of_all(names, landings)
    figure.suptitle(f"Where each fraction lands: percent of its mass{some}; curves: percent per cm", fontsize=TEXT_SIZE)
    heads = ("fraction", "wall", "from (m)", "to (m)", "share of its mass (%)")
    columns = (np.concatenate(column) for column in zip(*cells, strict=True))
    save(figure, paper, dict(zip(heads, columns, strict=True)))
    return panels


def _walls_with_bins(scene: Scene) -> Iterator[_Wall]:
    places = list(scene.bin)
    for on, title in (
        ("floor", "x on the floor (mm)"),
        ("top", "x on the top (mm)"),
        ("left", "y on the left wall (mm)"),
        ("right", "y on the right wall (mm)"),
    ):
        if placed := {places.index(name): bin_.ends for name, bin_ in scene.on_sides(on).items()}:
            bins = dict(sorted(placed.items(), key=lambda item: item[1]))
            yield _Wall(title, scene.channel.span(on), bins)
    for i, (name, bin_) in enumerate(scene.bin.items()):
        if name not in scene.on_sides():
            length = float(np.sum(np.hypot(*np.diff(bin_.line(scene), axis=0).T)))
            yield _Wall(f"along {name} (mm)", (0.0, length), {i: (0.0, length)})


def _along(wall: _Wall, scene: Scene, landing: Landed) -> tuple[Array, Array]:
    """Coordinate along the wall (m) and weight of the granules that ended in its bins."""
    here = np.isin(landing.bin, list(wall.bins))
    points = np.stack([np.asarray(landing.x)[here], np.asarray(landing.y)[here]], axis=1)
    bin_ = list(scene.bin.values())[next(iter(wall.bins))]
    return np.clip(bin_.along(scene, points), *wall.span), np.asarray(landing.weight, dtype=float)[here]


def _histogram(wall: _Wall, scene: Scene, landing: Landed) -> tuple[Array, Array]:
    """Edges (k + 1,) m of the cells along a wall, and the share (k,) % of the fraction's mass that landed in each."""
    edges = wall.edges()
    where, weight = _along(wall, scene, landing)
    total = float(np.sum(landing.weight))
    mass, _ = np.histogram(where, bins=edges, weights=weight)
    return edges, 100.0 * mass / total if total > 0 else np.zeros(len(mass))


def _draw_histogram(axes: Axes, wall: _Wall, edges: Array, share: Array, colour: str) -> float:
    """Draw one panel; its highest value (% of the fraction's mass per cm)."""
    height = share / (100.0 * np.diff(edges))
    axes.stairs(height, MM * edges, fill=True, color=colour, alpha=0.85, zorder=2)
    for place, ends in enumerate(wall.bins.values()):
        axes.axvspan(MM * ends[0], MM * ends[1], color=SHADES[place % 2], zorder=0)
        for end in ends:
            axes.axvline(MM * end, color="#9aa3ad", linewidth=0.6, zorder=1)
    axes.set_xlim(MM * wall.span[0], MM * wall.span[1])
    axes.locator_params(axis="y", nbins=3)
    return float(height.max(initial=0.0))


def _write_shares(axes: Axes, wall: _Wall, scene: Scene, shares: Mapping[str, str], wide: float) -> None:
    names = list(scene.bin)
    upright = _upright(wall, wide, max((shares[names[i]] for i in wall.bins), key=len))
    for i, ends in wall.bins.items():
        axes.annotate(
            shares[names[i]], (MM * sum(ends) / 2, 0.96), xycoords=("data", "axes fraction"), fontsize=TEXT_SIZE,
            ha="center", va="top", rotation=90 if upright else 0, zorder=4,
        )  # fmt: skip


def _upright(wall: _Wall, wide: float, *texts: str) -> bool:
    """Whether any of the texts finds no room across the narrowest bin of a wall that is ``wide`` (inches) drawn."""
    narrowest = min(ends[1] - ends[0] for ends in wall.bins.values()) * wide / (wall.span[1] - wall.span[0])
    return any(text_width(text, TEXT_SIZE) > narrowest for text in texts)


def _name_bins(axes: Axes, wall: _Wall, scene: Scene, wide: float) -> None:
    names = list(scene.bin)
    upright = _upright(wall, wide, *(names[i] for i in wall.bins))
    for i, ends in wall.bins.items():
        axes.annotate(
            names[i], (MM * sum(ends) / 2, 1.0), xytext=(0, 3), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=TEXT_SIZE, ha="center", va="bottom", rotation=90 if upright else 0,
        )  # fmt: skip


EMPTY = 0.3  # decades without granules: across them a curve is dotted and has no band
AXES = {"size": (MM, "diameter", "mm"), "terminal velocity": (1.0, "terminal velocity", "m/s")}


def draw_partition(paper: Paper, scene: Scene, curves: Sequence[PartitionCurve]) -> NDArray[np.object_]:
    """Draw a panel a property and a line a product, with its 95 % band and its cut."""
    kinds = list(dict.fromkeys(curve.by for curve in curves))
    figure = new_figure(0.6 + 4.6 * len(kinds), 3.9, paper)
    panels: NDArray[np.object_] = figure.subplots(1, len(kinds), squeeze=False, sharey=True)[0]
    colours = _product_colours(scene, curves)
    for axes, kind in zip(panels, kinds, strict=True):
        scale, label, unit = AXES[kind]
        for curve in (curve for curve in curves if curve.by == kind):
            at, colour = scale * np.array(curve.at), colours[curve.product]
            share, low, high = (100 * np.array(ends) for ends in (curve.share, curve.low, curve.high))
            for part in np.split(np.arange(len(at)), np.flatnonzero(np.diff(np.log10(at)) > EMPTY) + 1):
                axes.fill_between(at[part], low[part], high[part], color=colour, alpha=0.2, linewidth=0)
                axes.plot(at[part], share[part], "o-", ms=3, lw=1.2, color=colour)
            reach = np.array([share - low, high - share])
            axes.errorbar(at, share, reach, fmt="none", ecolor=colour, elinewidth=0.7, alpha=0.5)
            axes.plot(at, share, ":", lw=0.9, color=colour, zorder=1)
            axes.plot([], [], "o-", ms=3, lw=1.2, color=colour, label=_cut_words(curve, scale, unit))
            if curve.cut is not None:
                axes.plot([scale * curve.cut.value] * 2, [0.0, 50.0], ":", color=colour, linewidth=1.0)
        for level in (25.0, 50.0, 75.0):
            axes.axhline(level, color="#9aa3ad", linewidth=0.5, zorder=0)
        axes.set_xscale("log")
        axes.set_ylim(-2.0, 102.0)
        axes.set_xlabel(f"{label} ({unit})")
        axes.legend(fontsize=7, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    panels[0].set_ylabel("share of its mass in the product (%)")
    save(figure, paper, _curve_columns(curves))
    return panels


def _product_colours(scene: Scene, curves: Sequence[PartitionCurve]) -> dict[tuple[str, ...], str]:
    """Colour of the fraction that should land in a product; of a bin that is nobody's target one of its own."""
    colours = fraction_colours(list(scene.fraction))
    wanted = {fraction.targets: colours[name] for name, fraction in scene.fraction.items()}
    products = list(dict.fromkeys(curve.product for curve in curves))
    return {product: wanted.get(product, COLOURS[i % len(COLOURS)]) for i, product in enumerate(products)}


def _cut_words(curve: PartitionCurve, scale: float, unit: str) -> str:
    name = " or ".join(curve.product)
    if curve.cut is None:
        return f"{name}: {curve.why}"
    sharp = "" if curve.ep is None else f", Ep {scale * curve.ep:.3g} {unit}, I {curve.imperfection:.2g}"
    return f"{name}: cut {scale * curve.cut.value:.3g} {unit}{sharp}"


def _curve_columns(curves: Sequence[PartitionCurve]) -> dict[str, ArrayLike]:
    sizes = [len(curve.at) for curve in curves]
    names = (" or ".join(curve.product) for curve in curves)
    table: dict[str, ArrayLike] = {
        "product": np.repeat(list(names), sizes),
        "by": np.repeat([curve.by for curve in curves], sizes),
        "unit": np.repeat([curve.unit for curve in curves], sizes),
    }
    for head, key in (
        ("value", "at"), ("mass of the feed (1)", "mass"), ("share (1)", "share"), ("low (1)", "low"),
        ("high (1)", "high"),
    ):  # fmt: skip
        table[head] = np.concatenate([np.array(getattr(curve, key)) for curve in curves])
    return table


MARKERS = "<>^vsDPX*"
MIN_SHARE = 1e-3  # a share that is smaller in every wake is not drawn
ROW = 0.3  # inches
Bracket = Mapping[str, Mapping[str, Mapping[str, float]]]  # shares by fraction, bin and wake


def draw_wakes(
    paper: Paper, scene: Scene, bracket: Bracket, shares: Mapping[str, Mapping[str, Number]]
) -> NDArray[np.object_]:
    """Draw a panel a fraction and a row a bin: a mark a wake, and the answer with its 95 % interval as a bar.

    ``bracket``: the shares in each wake; ``shares``: the answer's, by fraction and bin.
    """
    rows = _wake_rows(scene, bracket, shares)
    panels = foremost(scene, list(dict.fromkeys(name for name, _ in rows)))
    wakes = list(dict.fromkeys(wake for _, _, wake in _marks(bracket)))
    counts = [sum(name == fraction for fraction, _ in rows) for name in panels]
    figure = new_figure(6.4, 1.1 + ROW * sum(counts) + 0.45 * len(panels), paper)
    grid: NDArray[np.object_] = figure.subplots(
        len(panels), 1, squeeze=False, sharex=True, gridspec_kw={"height_ratios": counts}
    )[:, 0]
    colours = fraction_colours(list(scene.fraction))
    for axes, name in zip(grid, panels, strict=True):
        places = [place for fraction, place in rows if fraction == name]
        for level, place in enumerate(places):
            share = shares[name][place]
            ends = [100 * (share.high - share.low)], [100 * share.low]
            axes.barh([level], ends[0], left=ends[1], height=0.55, color=colours[name], alpha=0.35)
            axes.plot([100 * share.value] * 2, [level - 0.28, level + 0.28], color=colours[name], linewidth=2.5)
            for marker, wake in zip(MARKERS, wakes, strict=False):
                if wake in bracket[name][place]:
                    axes.plot([100 * bracket[name][place][wake]], [level], marker, ms=5, mfc="white", mec=INK, mew=0.9)
        axes.set_yticks(range(len(places)), places, fontsize=8)
        axes.set_ylim(len(places) - 0.5, -0.5)
        axes.set_title(name, fontsize=9, loc="left")
        axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    for marker, wake in zip(MARKERS, wakes, strict=False):
        grid[0].plot([], [], marker, ms=5, mfc="white", mec=INK, linestyle="none", label=wake)
    grid[0].legend(fontsize=7, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    grid[-1].set_xlim(-1.0, 101.0)
    grid[-1].set_xlabel("share of the fraction's mass (%)")
    save(figure, paper, _wake_columns(bracket))
    return grid


def _marks(bracket: Bracket) -> list[tuple[str, str, str]]:
    """Fraction, bin and wake of every share that was flown in another wake."""
    return [
        (name, place, wake) for name, places in bracket.items() for place, shares in places.items() for wake in shares
    ]


def _wake_rows(scene: Scene, bracket: Bracket, shares: Mapping[str, Mapping[str, Number]]) -> list[tuple[str, str]]:
    """Fractions and bins that some of the fraction lands in, bins from left to right."""
    bins = [*bins_across(scene), "elsewhere"]
    return [
        (name, place)
        for name, places in bracket.items()
        for place in bins
        if max([*places.get(place, {}).values(), shares[name][place].value]) > MIN_SHARE
    ]


def _wake_columns(bracket: Bracket) -> dict[str, ArrayLike]:
    marks = _marks(bracket)
    heads = ("fraction", "bin", "wake")
    table: dict[str, ArrayLike] = {head: [mark[i] for mark in marks] for i, head in enumerate(heads)}
    table["share (%)"] = 100.0 * np.array([bracket[name][place][wake] for name, place, wake in marks])
    return table


def _landings(outcome: Outcome) -> tuple[object, ...]:
    landings = outcome.result.landings
    return () if landings is None else (outcome.scene, outcome.landings, landings.separation)


def _curves(outcome: Outcome) -> tuple[object, ...]:
    landings = outcome.result.landings
    curves = () if landings is None else tuple(curve for curve in landings.separation.cut if curve.overlaps)
    return (outcome.scene, curves) if curves else ()


def _in_wakes(outcome: Outcome) -> tuple[object, ...]:
    landings = outcome.result.landings
    if landings is None or not landings.bracket:
        return ()
    return outcome.scene, landings.bracket, landings.separation.fractions


add_figure("landing", "Where the mass of each fraction lands.", draw_landing, _landings, always=True)
add_figure(
    "partition", "Partition curves: of granules alike in size or terminal velocity, the share in each product; bands: "
    "95 %, of all that is not known; dotted where nothing is fed.",
    draw_partition, _curves,
)  # fmt: skip
add_figure(
    "wakes", "The same granules, each alone, in each wake (marks), and the answer with its 95 % interval (bars).",
    draw_wakes, _in_wakes,
)  # fmt: skip
