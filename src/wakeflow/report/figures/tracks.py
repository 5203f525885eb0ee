"""The tracks figure: tracks of every fraction in the whole channel, with body, walls and bins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..air import as_flown
from ..canvas import (
    INK,
    MM,
    air_arrow,
    canvas,
    draw_bins,
    frame,
    save,
    solids,
    streams,
    triangulation,
)
from ..colours import fraction_colours
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...field import FlowField
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_tracks"]

Array = NDArray[np.float64]

DRAWN = 48  # tracks drawn of the fraction with most mass; more only blacken the picture
LEAST = 4  # of any other: those of a fraction that has less mass than so many lines are thinner
WIDTH = 0.75  # points: of a line that stands for as much mass as every other


def draw_tracks(paper: Paper, field: FlowField | None, scene: Scene, tracks: Mapping[str, Sequence[Array]]) -> Axes:
    """Tracks of every fraction in the whole channel over a pale map of the air's mean speed, with body, walls and bins.

    ``tracks``: fraction name to (m, 2) arrays of positions (m). What is drawn of a fraction, number of lines times
    their width, is in proportion to its share of the feed's mass.
    """
    channel = scene.channel
    window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
    figure, axes, scale = canvas(window, paper)
    if field is not None:
        _speed_map(axes, as_flown(field.mean(), scene))
    shares, colours = scene.mass_shares(), fraction_colours(list(scene.fraction))
    most, chosen = max(shares.values()), {}
    for name in sorted(tracks, key=lambda name: -shares[name]):  # the lightest on top
        chosen[name], width = _chosen(tracks[name], shares[name] / most)
        _draw_fraction(axes, chosen[name], f"{name}, {100 * shares[name]:.3g} %", colours[name], width)
    solids(axes, scene)
    for wall in window[:2]:
        axes.plot([MM * wall] * 2, [MM * channel.bottom, MM * channel.top], color=INK, linewidth=1.3, zorder=4)
    for end in window[2:]:
        axes.plot([MM * window[0], MM * window[1]], [MM * end] * 2, color=INK, linewidth=0.5, linestyle=":", zorder=4)
    frame(axes, window, draw_bins(axes, scene, scale))
    air_arrow(axes, scene, window)
    streams(axes, scene)
    if tracks:
        legend = axes.legend(
            title="of the feed", loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, fontsize=9
        )
        for line in legend.get_lines():
            line.set(linewidth=2.5, alpha=1.0)
    axes.set_title("Tracks: as much ink as mass. Blue: the mean air's speed", fontsize=9, loc="left")
    save(figure, paper, _rows(chosen))
    return axes


def _speed_map(axes: Axes, mean: FlowField) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    speed = np.hypot(*mean.velocity.T)
    if np.ptp(speed) <= 1e-9 * speed.max():
        return  # uniform air: the arrow beside says all
    pale = LinearSegmentedColormap.from_list("pale", ["#ffffff", "#dbe7f1", "#a9c3d9"])
    levels = MaxNLocator(10).tick_values(0.0, max(float(np.percentile(speed, 99.0)), 1e-12))
    filled = axes.tricontourf(triangulation(mean), speed, levels=levels, cmap=pale, extend="max")
    filled.set_rasterized(True)
    bar = axes.figure.colorbar(filled, cax=axes.inset_axes((1.05, 0.12, 0.05, 0.4)))
    bar.set_label("air speed (m/s)", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _chosen(tracks: Sequence[Array], part: float) -> tuple[list[Array], float]:
    """Tracks of a fraction with ``part`` of the mass that the largest has, and their width (points).

    They are evenly chosen in the order of where they end, so that the few of a small fraction lie as all of it does and
    not on one side by chance.
    """
    count = min(len(tracks), max(LEAST, round(DRAWN * part)), DRAWN)
    across = sorted((np.asarray(track, dtype=float) for track in tracks), key=lambda track: tuple(track[-1]))
    picked = ((np.arange(count) + 0.5) * len(tracks) / max(count, 1)).astype(int)
    return [across[i] for i in picked], WIDTH * DRAWN * part / max(count, 1)


def _draw_fraction(axes: Axes, tracks: Sequence[Array], name: str, colour: str, width: float) -> None:
    """Tracks of a fraction as one line with gaps, so that the legend has one entry."""
    gap = np.full((1, 2), np.nan)
    parts = [part for track in tracks for part in (track, gap)]
    x, y = (MM * np.concatenate(parts) if parts else gap).T
    axes.plot(x, y, color=colour, linewidth=width, alpha=0.75, label=name, zorder=3)


def _rows(tracks: Mapping[str, Sequence[Array]]) -> dict[str, NDArray[np.generic]]:
    """The tracks that are drawn as columns of one table."""
    labelled = [(name, i, track) for name, part in tracks.items() for i, track in enumerate(part)]
    points = np.concatenate([np.zeros((0, 2)), *(track for _, _, track in labelled)])
    sizes = [len(track) for _, _, track in labelled]
    names, numbers = ([row[k] for row in labelled] for k in (0, 1))
    return {
        "fraction": np.repeat(np.array(names, dtype=str), sizes),
        "track": np.repeat(np.array(numbers, dtype=int), sizes),
        "x (m)": points[:, 0],
        "y (m)": points[:, 1],
    }


def _draw(paper: Paper, outcome: Outcome) -> Axes:
    positions = {name: [track["position"] for track in part] for name, part in outcome.tracks.items()}
    return draw_tracks(paper, outcome.field, outcome.scene, positions)


figures.add("tracks", Figure("Tracks through the channel, as much ink as mass; bins are the bars.", _draw, always=True))
