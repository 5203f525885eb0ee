"""The standard figures of granules on their way: tracks, time in the suction zone, discharge of the funnel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .. import canvas
from ..air_pictures import SUCTION_LEVEL, as_flown, pressure_coefficient, suction_nodes
from ..canvas import COLOURS, INK, MM, save
from ..moving import Path2D
from ..outcome import add_figure
from .air_figures import air_with_pressure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...air.field import FlowField
    from ...air.kinds.airflow_table import Airflow
    from ...planning.feed_funnel import FunnelSummary
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import AirAndTracks, Track

Array = NDArray[np.float64]

MAX_TRACKS = 48  # tracks drawn of the fraction with most mass; more only blacken the picture
MIN_DRAWN = 4  # of any other: those of a fraction that has less mass than so many lines are thinner
DRAWN = 200  # straight pieces of a line from top to bottom
WIDTH = 0.75  # points: of a line that represents as much mass as every other


def draw_tracks(paper: Paper, field: FlowField | None, scene: Scene, tracks: Mapping[str, Sequence[Array]]) -> Axes:
    """Tracks of every fraction in the whole channel over a pale map of the air's mean speed, with body, walls and bins.

    ``tracks``: fraction name to (m, 2) arrays of positions (m). What is drawn of a fraction, number of lines times
    their width, is in proportion to its share of the feed's mass. Of very many fractions the :func:`..canvas.foremost`.
    """
    channel = scene.channel
    window = (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)
    figure, axes, scale = canvas.canvas(window, paper)
    mapped = field is not None and _speed_map(axes, as_flown(field.mean(), scene))
    shares, colours = scene.mass_shares(), canvas.fraction_colours(list(scene.fraction))
    most, chosen = max(shares.values()), {}
    shown = canvas.foremost(scene, list(tracks))
    for name in sorted(shown, key=lambda name: -shares[name]):  # the lightest on top
        chosen[name], width = _chosen(tracks[name], shares[name] / most)
        _draw_fraction(axes, chosen[name], f"{name}, {100 * shares[name]:.3g} %", colours[name], width)
    canvas.solids(axes, scene)
    for wall in window[:2]:
        axes.plot([MM * wall] * 2, [MM * channel.bottom, MM * channel.top], color=INK, linewidth=1.3, zorder=4)
    for end in window[2:]:
        axes.plot([MM * window[0], MM * window[1]], [MM * end] * 2, color=INK, linewidth=0.5, linestyle=":", zorder=4)
    canvas.frame(axes, window, canvas.draw_bins(axes, scene, scale))
    canvas.air_arrow(axes, scene, window)
    canvas.streams(axes, scene)
    if tracks:
        legend = axes.legend(
            title=f"of the feed{canvas.of_all(shown, tracks)}", loc="upper left", bbox_to_anchor=(1.02, 1.0),
            frameon=False, fontsize=9,
        )  # fmt: skip
        for line in legend.get_lines():
            line.set(linewidth=2.5, alpha=1.0)
    blue = " Blue: the mean air's speed" if mapped else ""
    axes.set_title(f"Tracks: as much ink as mass.{blue}", fontsize=9, loc="left")
    save(figure, paper, _track_rows(chosen))
    return axes


def _speed_map(axes: Axes, mean: FlowField) -> bool:
    """Draw the air's speed where it differs from place to place; whether it does."""
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    speed = np.hypot(*mean.velocity.T)
    if np.ptp(speed) <= 1e-9 * speed.max():
        return False  # uniform air: the arrow beside says all
    pale = LinearSegmentedColormap.from_list("pale", ["#ffffff", "#dbe7f1", "#a9c3d9"])
    levels = MaxNLocator(10).tick_values(0.0, max(float(np.percentile(speed, 99.0)), 1e-12))
    filled = axes.tricontourf(canvas.triangulation(mean), speed, levels=levels, cmap=pale, extend="max")
    filled.set_rasterized(True)
    bar = axes.figure.colorbar(filled, cax=axes.inset_axes((1.05, 0.12, 0.05, 0.4)))
    bar.set_label("air speed (m/s)", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return True


def _chosen(tracks: Sequence[Array], part: float) -> tuple[list[Array], float]:
    """Tracks of a fraction with ``part`` of the mass that the largest has, and their width (points).

    They are evenly chosen in the order of where they end, so that the few of a small fraction lie as all of it does and
    not on one side by chance.
    """
    count = min(len(tracks), max(MIN_DRAWN, round(MAX_TRACKS * part)), MAX_TRACKS)
    across = sorted((np.asarray(track, dtype=float) for track in tracks), key=lambda track: tuple(track[-1]))
    picked = ((np.arange(count) + 0.5) * len(tracks) / max(count, 1)).astype(int)
    return [across[i] for i in picked], WIDTH * MAX_TRACKS * part / max(count, 1)


def _draw_fraction(axes: Axes, tracks: Sequence[Array], name: str, colour: str, width: float) -> None:
    """Tracks of a fraction as one line with gaps, so that the legend has one entry."""
    gap = np.full((1, 2), np.nan)
    parts = [part for track in tracks for part in (track, gap)]
    x, y = (MM * np.concatenate(parts) if parts else gap).T
    axes.plot(x, y, color=colour, linewidth=width, alpha=0.75, label=name, zorder=3)


def _track_rows(tracks: Mapping[str, Sequence[Array]]) -> dict[str, NDArray[np.generic]]:
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


SURE = 0.95
LOOK_STEP = 0.02  # of the first body's width, between two looks whether a granule is in the zone
SPANS = "the zone spans the channel: this is the time of passing through it, not behind the body alone"


def times_in_zone(mean: FlowField, cp: Array, zone: NDArray[np.bool_], tracks: Sequence[Track], step: float) -> Array:
    """How long (s) each of the tracks is in the suction zone: where ``cp`` (N,), the pressure coefficient at the nodes,
    is below its border in a triangle that has a node of the ``zone`` (N,), looked up every ``step`` (m).
    """
    seconds = np.zeros(len(tracks))
    for number, path in enumerate(map(Path2D.of, tracks)):
        moments = path.moments(step)
        middle, _ = path.at(0.5 * (moments[1:] + moments[:-1]))
        triangle = mean.locate(middle)
        corner = mean.triangles[triangle]
        inside = np.zeros(len(middle), dtype=bool)
        met = triangle >= 0
        level = np.einsum("nk,nk->n", mean.barycentric(triangle[met], middle[met]), cp[corner[met]])
        inside[met] = (level < SUCTION_LEVEL) & zone[corner[met]].any(axis=1)
        seconds[number] = float(np.diff(moments)[inside].sum())
    return seconds


def draw_residence(
    paper: Paper, field: FlowField, scene: Scene, airflow: Airflow, tracks: Mapping[str, Sequence[Track]]
) -> Axes:
    """Draw of each fraction the share of its drawn tracks that stay longer in the suction zone than the time along the
    axis; in words the share that comes through it, and their median time with its 95 % interval. A zone from wall to
    wall is reported: every granule crosses it, so that a long time may be a slow fall and no stay behind the body.
    """
    mean = as_flown(field.mean(), scene)
    cp = pressure_coefficient(mean, scene, airflow)
    zone = suction_nodes(mean, cp, scene)
    with_tracks = canvas.foremost(scene, [name for name, part in tracks.items() if part])
    times = {name: times_in_zone(mean, cp, zone, tracks[name], LOOK_STEP * scene.width) for name in with_tracks}
    axes, colours = canvas.new_axes(6.4, 3.9, paper), canvas.fraction_colours(list(scene.fraction))
    for name, stay in times.items():
        stays = np.sort(stay)
        share = 100.0 * (1.0 - np.arange(len(stays) + 1) / len(stays))
        axes.stairs(share, 1e3 * np.concatenate([[0.0], stays, [stays[-1]]]), baseline=None, color=colours[name],
                    linewidth=1.6, label=f"{name}: {_stay_words(stay)}")  # fmt: skip
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 102.0)
    axes.set_xlabel("time in the suction zone (ms)")
    axes.set_ylabel("share of the tracks that stay longer (%)")
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.legend(
        title=SPANS if airflow.suction.spans(scene.channel.width) else None, title_fontsize=7.5, alignment="left",
        fontsize=7.5, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0),
    )  # fmt: skip
    sizes = [len(stay) for stay in times.values()]
    save(axes.figure, paper, {
        "fraction": np.repeat(list(times), sizes),
        "track": np.concatenate([np.arange(size) for size in sizes]),
        "time in the suction zone (s)": np.concatenate(list(times.values())),
    })  # fmt: skip
    return axes


def _stay_words(times: Array) -> str:
    """``"94 % of 48 tracks, median 23 (21 to 26) ms"``: order statistics bound the median without any law of times."""
    from scipy.stats import binom

    inside = np.sort(1e3 * times[times > 0.0])
    share = f"{100 * len(inside) / len(times):.0f} % of {len(times)} tracks"
    if not len(inside):
        return share
    last = len(inside) - 1
    lowest = int(binom.ppf(0.5 * (1.0 - SURE), len(inside), 0.5))
    low, high = inside[max(lowest - 1, 0)], inside[min(last - lowest + 1, last)]
    return f"{share}, median {np.median(inside):.3g} ({low:.3g} to {high:.3g}) ms"


MIDDLE = 0.575  # of the mass still inside half-way through the steady stretch, which runs from 10 to 75 % gone


def draw_discharge(paper: Paper, poured: FunnelSummary) -> Axes:
    """Mass left (g) against time since the outlet opened (s), the fitted rate and Beverloo's law."""
    time, mass = (np.asarray(column) for column in (poured.curve.time, poured.curve.mass))
    axes = canvas.new_axes(6.4, 4.0, paper)
    axes.plot(time, 1e3 * mass, color=COLOURS[0], linewidth=1.8, label="computed bead by bead")
    end = float(time[-1]) if math.isnan(poured.time_to_empty) else poured.time_to_empty
    half = float(np.interp(-MIDDLE * poured.mass, -mass, time))
    for value, style, name in (
        (poured.rate.value, "-", "its rate"),
        (poured.beverloo, "--", "Beverloo, at rest"),
        (poured.beverloo_cone, ":", "Beverloo with cone factor, at rest"),
    ):
        if value > 0.0:
            line = 1e3 * (MIDDLE * poured.mass - value * (np.array([0.0, 1.2 * end]) - half))
            label = f"{name}: {1e3 * value:.3g} g/s"
            axes.plot([0.0, 1.2 * end], line, style, color=INK, linewidth=0.9, label=label)
    axes.set_xlim(0.0, 1.15 * end)
    axes.set_ylim(0.0, 1.05e3 * poured.mass)
    axes.set_xlabel("time since the outlet was opened (s)")
    axes.set_ylabel("mass in the funnel (g)")
    shaken = "at rest" if not poured.gamma else f"{poured.frequency:g} Hz, Gamma {poured.gamma:g}"
    axes.set_title(f"{poured.beads} beads, {shaken}", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    save(axes.figure, paper)
    return axes


def _tracks(outcome: AirAndTracks) -> tuple[FlowField | None, Scene, dict[str, list[Array]]]:
    channel = outcome.scene.channel
    step = (channel.top - channel.bottom) / DRAWN
    paths = {name: [Path2D.of(track) for track in part] for name, part in outcome.tracks.items()}
    positions = {name: [path.at(path.moments(step))[0] for path in part] for name, part in paths.items()}
    return outcome.field, outcome.scene, positions


def _air_and_tracks(outcome: AirAndTracks) -> tuple[object, ...]:
    air = air_with_pressure(outcome)
    return (*air, outcome.tracks) if air and any(map(len, outcome.tracks.values())) else ()


add_figure(
    "tracks", "Tracks through the channel, as much ink as mass; bins are the bars.",
    draw_tracks, _tracks, always=True, of_answer=False,
)  # fmt: skip
add_figure(
    "residence",
    "Residence time in the suction zone (Cp < −0.5 in the mean, from the first body on), of the drawn tracks.",
    draw_residence, _air_and_tracks, of_answer=False,
)  # fmt: skip
add_figure(
    "discharge", "The feed funnel: mass left inside over time; dashed: Beverloo's law for a funnel at rest.",
    draw_discharge, lambda outcome: () if outcome.result.funnel is None else (outcome.result.funnel,),
)  # fmt: skip
