"""The landing figure: mass-weighted histograms of each fraction along every wall that has bins."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..canvas import MM, new_figure, save, text_width
from ..colours import fraction_colours
from ..words import percent
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...results.landing_results import Separation
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Landed, Outcome

__all__ = ["draw_landing"]

Array = NDArray[np.float64]
CELLS = 60  # of a histogram along one wall
SHADES = ("#e6ebf1", "#f6f7f9")
HEADROOM = 1.4  # above the highest cell, for the shares


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
    paper: Paper, scene: Scene, landings: Mapping[str, Landed], separation: Separation | None = None
) -> NDArray[Any]:
    """Histograms of where each fraction lands, one row a fraction, one column a wall that has bins.

    ``landings``: of every fraction by name. ``separation`` brings the shares and intervals that are
    written; without it shares are those of ``landings``, without interval.
    """
    names, walls = list(landings), list(_walls_with_bins(scene))
    wide = 6.2 if len(walls) == 1 else 4.2
    figure = new_figure(1.0 + wide * len(walls), 0.9 + 1.65 * max(len(names), 1), paper)
    panels = figure.subplots(max(len(names), 1), len(walls), squeeze=False, sharex="col", sharey="row")
    colours = fraction_colours(names)
    table = _Table()
    for row, name in enumerate(names):
        shares = _shares(scene, name, landings[name], separation)
        peak = 0.0
        for axes, wall in zip(panels[row], walls, strict=True):
            edges, share = _histogram(wall, scene, landings[name])
            peak = max(peak, _draw_histogram(axes, wall, edges, share, colours[name]))
            table.add(name, wall.title, edges, share)
            _write_shares(axes, wall, scene, shares, wide)
        axes = panels[row][0]
        axes.set_ylim(0.0, HEADROOM * peak if peak > 0 else 1.0)
        axes.set_ylabel(f"{name}\nmass per cm (%)", fontsize=9)
        panels[row][-1].annotate(
            f"elsewhere\n{shares['elsewhere']}", (1.0, 0.5), xytext=(6, 0), xycoords="axes fraction",
            textcoords="offset points", fontsize=7.5, va="center",
        )  # fmt: skip
    for axes, wall in zip(panels[0], walls, strict=True):
        _name_bins(axes, wall, scene, wide)
    for axes, wall in zip(panels[-1], walls, strict=True):
        axes.set_xlabel(wall.title)
    figure.suptitle("Where each fraction lands, in percent of its mass", fontsize=9)
    save(figure, paper, table.columns())
    return panels


def _walls_with_bins(scene: Scene) -> Iterator[_Wall]:
    channel, half = scene.channel, scene.channel.width / 2
    for on, title in (
        ("floor", "x on the floor (mm)"),
        ("top", "x on the top (mm)"),
        ("left", "y on the left wall (mm)"),
        ("right", "y on the right wall (mm)"),
    ):
        axis = 0 if on in ("floor", "top") else 1
        placed = {
            i: b.line(channel)[:, axis] for i, b in enumerate(scene.bin.values()) if b.points is None and b.on == on
        }
        bins = {i: (float(a), float(b)) for i, (a, b) in sorted(placed.items(), key=lambda item: float(item[1][0]))}
        if bins:
            yield _Wall(title, (-half, half) if axis == 0 else (channel.bottom, channel.top), bins)
    for i, (name, bin_) in enumerate(scene.bin.items()):
        if bin_.points is not None:
            length = float(np.sum(np.hypot(*np.diff(bin_.line(channel), axis=0).T)))
            yield _Wall(f"along {name} (mm)", (0.0, length), {i: (0.0, length)})


def _along(wall: _Wall, scene: Scene, landing: Landed) -> tuple[Array, Array]:
    """Coordinate along the wall (m) and weight of the granules that ended in its bins."""
    here = np.isin(landing.bin, list(wall.bins))
    points = np.stack([np.asarray(landing.x)[here], np.asarray(landing.y)[here]], axis=1)
    bin_ = list(scene.bin.values())[next(iter(wall.bins))]
    if bin_.points is None:
        where = points[:, 0 if bin_.on in ("floor", "top") else 1]
    else:
        where = _arc_length(bin_.line(scene.channel), points)
    return np.clip(where, *wall.span), np.asarray(landing.weight, dtype=float)[here]


def _arc_length(line: Array, points: Array) -> Array:
    """Arc length (m) of the place on a polyline (k, 2) that is nearest to each of the points (n, 2)."""
    start, step = line[:-1], np.diff(line, axis=0)
    size = np.hypot(*step.T)
    part = np.clip(np.einsum("nkc,kc->nk", points[:, None] - start, step) / size**2, 0.0, 1.0)
    gap = np.linalg.norm(points[:, None] - start - part[..., None] * step, axis=2)
    best = np.argmin(gap, axis=1)
    before = np.concatenate([[0.0], np.cumsum(size)[:-1]])
    return np.asarray(before[best] + part[np.arange(len(points)), best] * size[best])


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
    axes.tick_params(labelsize=8)
    return float(height.max(initial=0.0))


class _Table:
    """The cells of all panels, one below the other."""

    def __init__(self) -> None:
        self.parts: list[tuple[list[str], list[str], Array, Array, Array]] = []

    def add(self, fraction: str, wall: str, edges: Array, share: Array) -> None:
        names = [fraction] * len(share), [wall.replace("(mm)", "").strip()] * len(share)
        self.parts.append((*names, edges[:-1], edges[1:], share))

    def columns(self) -> dict[str, Array]:
        heads = ("fraction", "wall", "from (m)", "to (m)", "share of its mass (%)")
        return {head: np.concatenate(column) for head, column in zip(heads, zip(*self.parts, strict=True), strict=True)}


def _shares(scene: Scene, name: str, landing: Landed, separation: Separation | None) -> dict[str, str]:
    """What is written over every bin: its share in percent, with half its interval where known."""
    if separation is not None:
        rows = separation.fractions[name]
        return {place: percent(row).replace(" ", "\n", 1) + " %" for place, row in rows.items()}
    weight, places = np.asarray(landing.weight, dtype=float), np.asarray(landing.bin)
    total = float(weight.sum())
    names = {**dict(enumerate(scene.bin)), -1: "elsewhere"}
    return {n: f"{100 * weight[places == i].sum() / total:.1f} %" if total > 0 else "–" for i, n in names.items()}


def _write_shares(axes: Axes, wall: _Wall, scene: Scene, shares: Mapping[str, str], wide: float) -> None:
    names, scale = list(scene.bin), wide / (wall.span[1] - wall.span[0])
    for i, ends in wall.bins.items():
        text = shares[names[i]]
        upright = text_width(max(text.split("\n"), key=len), 7.5) > scale * (ends[1] - ends[0])
        axes.annotate(
            text, (MM * sum(ends) / 2, 0.96), xycoords=("data", "axes fraction"), fontsize=6 if upright else 7.5,
            ha="center", va="top", rotation=90 if upright else 0, zorder=4,
        )  # fmt: skip


def _name_bins(axes: Axes, wall: _Wall, scene: Scene, wide: float) -> None:
    names, scale = list(scene.bin), wide / (wall.span[1] - wall.span[0])
    upright = any(text_width(names[i], 8) > scale * (ends[1] - ends[0]) for i, ends in wall.bins.items())
    for i, ends in wall.bins.items():
        axes.annotate(
            names[i], (MM * sum(ends) / 2, 1.0), xytext=(0, 3), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=8, ha="center", va="bottom", rotation=90 if upright else 0,
        )  # fmt: skip


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    landings = outcome.result.landings
    return draw_landing(paper, outcome.scene, outcome.landings, None if landings is None else landings.separation)


figures.add("landing", Figure("Where the mass of each fraction lands; percent with 95 % interval.", _draw, always=True))
