"""The tracks figure: tracks of every fraction in the whole channel, with body, walls and bins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..canvas import (
    INK,
    MM,
    air_arrow,
    canvas,
    fraction_colours,
    frame,
    save,
    solids,
    streams,
    text_width,
    triangulation,
)
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...field import FlowField
    from ...scene import Scene
    from ..outcome import Outcome

__all__ = ["draw_tracks"]

Array = NDArray[np.float64]

DRAWN = 48  # tracks drawn of a fraction; more only blacken the picture
BARS = (INK, "#7d7d7d")  # bins, in turn along a wall


def draw_tracks(path: Path | str, field: FlowField | None, scene: Scene, tracks: Mapping[str, Sequence[Array]]) -> None:
    """Tracks of every fraction in the whole channel over a pale map of the air's speed, with body, walls and bins; PNG.

    ``tracks``: fraction name to (m, 2) arrays of positions (m); at most 48 evenly chosen ones a fraction are drawn.
    """
    channel = scene.channel
    window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
    figure, axes, scale = canvas(window)
    if field is not None:
        _speed_map(axes, field)
    for name, colour in fraction_colours(list(tracks)).items():
        _draw_fraction(axes, tracks[name], name, colour)
    solids(axes, scene)
    for wall in window[:2]:
        axes.plot([MM * wall] * 2, [MM * channel.bottom, MM * channel.top], color=INK, linewidth=1.3, zorder=4)
    for end in window[2:]:
        axes.plot([MM * window[0], MM * window[1]], [MM * end] * 2, color=INK, linewidth=0.5, linestyle=":", zorder=4)
    frame(axes, window, _draw_bins(axes, scene, scale))
    air_arrow(axes, scene, window)
    streams(axes, scene)
    if tracks:
        legend = axes.legend(title="fraction", loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, fontsize=9)
        for line in legend.get_lines():
            line.set(linewidth=2.5, alpha=1.0)
    axes.set_title(f"Tracks, at most {DRAWN} of each fraction", fontsize=9, loc="left")
    save(figure, path)


def _speed_map(axes: Axes, field: FlowField) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    mean = field.mean()
    speed = np.hypot(*mean.velocity.T)
    if np.ptp(speed) <= 1e-9 * speed.max():
        return  # uniform air: the arrow beside says all
    pale = LinearSegmentedColormap.from_list("pale", ["#ffffff", "#dbe7f1", "#a9c3d9"])
    levels = MaxNLocator(10).tick_values(0.0, max(float(np.percentile(speed, 99.0)), 1e-12))
    filled = axes.tricontourf(triangulation(mean), speed, levels=levels, cmap=pale, extend="max")
    bar = axes.figure.colorbar(filled, cax=axes.inset_axes((1.05, 0.12, 0.05, 0.4)))
    bar.set_label("air speed (m/s)", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _draw_fraction(axes: Axes, tracks: Sequence[Array], name: str, colour: str) -> None:
    """All tracks of a fraction as one line with gaps, so that the legend has one entry."""
    chosen = np.unique(np.linspace(0, max(len(tracks) - 1, 0), min(DRAWN, len(tracks))).astype(int))
    gap = np.full((1, 2), np.nan)
    parts = [part for i in chosen for part in (np.asarray(tracks[i], dtype=float), gap)]
    x, y = (MM * np.concatenate(parts) if parts else gap).T
    axes.plot(x, y, color=colour, linewidth=0.75, alpha=0.75, label=name, zorder=3)


def _draw_bins(axes: Axes, scene: Scene, scale: float) -> dict[str, float]:
    """Bins as bars on their lines with their names outside the channel; the room (m) the names need on each side."""
    outward = {"floor": (0, -1), "top": (0, 1), "left": (-1, 0), "right": (1, 0)}
    align = {"floor": ("center", "top"), "top": ("center", "bottom"), "left": ("right", "center"),
             "right": ("left", "center")}  # fmt: skip
    margin = dict.fromkeys(outward, 0.0)
    for on in outward:
        placed = {n: b.line(scene.channel) for n, b in scene.bin.items() if b.points is None and b.on == on}
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
        if bin_.points is not None:
            line = bin_.line(scene.channel)
            axes.plot(*(MM * line).T, color=BARS[0], linewidth=4, solid_capstyle="butt", zorder=5)
            box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": INK, "linewidth": 0.5}
            axes.annotate(name, MM * line.mean(axis=0), fontsize=8, ha="center", va="center", zorder=6, bbox=box)
    return margin


def _draw(path: Path, outcome: Outcome) -> None:
    positions = {name: [track["position"] for track in part] for name, part in outcome.tracks.items()}
    draw_tracks(path, outcome.field, outcome.scene, positions)


figures.add("tracks", Figure("Tracks through the channel; bins are the bars.", _draw, always=True))
