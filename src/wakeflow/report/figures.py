"""Pictures of a run: pressure with streamlines, tracks with bins, landing histograms. PNG, drawn without a screen.

Nothing is computed here but means, clippings and histograms of what is handed in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .canvas import (
    INK,
    MM,
    Grid,
    Window,
    air_arrow,
    canvas,
    first_outline,
    fraction_colours,
    frame,
    inside,
    save,
    solids,
    streams,
    text_width,
    triangulation,
)
from .landing import draw_landing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..field import FlowField
    from ..scene import Scene

__all__ = ["SUCTION_LEVEL", "draw_landing", "draw_pressure", "draw_tracks", "fraction_colours", "pressure_coefficient"]

Array = NDArray[np.float64]

SUCTION_LEVEL = -0.5  # Cp that bounds the suction zone
PRESSING_LEVEL = 0.3  # a pressing zone is named where Cp rises above this
UPSTREAM, DOWNSTREAM, ASIDE = 2.2, 5.0, 3.0  # the pressure picture's window from the body's middle, in body widths
DRAWN = 48  # tracks drawn of a fraction; more only blacken the picture
PALER = 1.3  # stretch of the colour scale: streamlines stay visible on its darkest used colour
ZONES = {"air": "1  ", "pressing zone": "2  ", "body": "3", "suction zone": "4  "}  # as in the paper's Fig. 7
BARS = (INK, "#7d7d7d")  # bins, in turn along a wall


# -- pressure ----------------------------------------------------------------------------------------------------------


def draw_pressure(
    path: Path | str, field: FlowField, scene: Scene, airflow: Mapping[str, Any], *, numbered: bool = False
) -> None:
    """Filled contours of Cp = (p - p_inlet) / (0.5 rho U^2) with streamlines round the first body; PNG.

    ``field``, steady or in time (its mean is drawn), must carry pressure (Pa); rho is its density, U the scene's air
    speed, p_inlet ``airflow["p_inlet"]`` (Pa) or else the mean along the field's inlet end. The line
    Cp = -0.5 bounds the suction zone; ``numbered`` puts the numbers of the paper's Fig. 7 before the zones' names.
    Raises ValueError without pressure or air.
    """
    if field.pressure is None or scene.air is None:
        raise ValueError("the pressure picture needs a field with pressure and a scene with air")
    mean = field.mean()
    cp = pressure_coefficient(mean, scene, airflow)
    window = _pressure_window(scene, airflow)
    figure, axes, _ = canvas(window)
    mesh = triangulation(mean)
    levels, limit = _cp_levels(cp[inside(mean.points, window)])
    filled = axes.tricontourf(
        mesh, cp, levels=levels, cmap=_scale(levels, limit), vmin=-limit, vmax=limit, extend="both"
    )
    axes.tricontour(mesh, cp, levels=[SUCTION_LEVEL], colors=INK, linewidths=1.3, linestyles="--")
    grid = Grid.sample(mesh, window, [*mean.velocity.T, cp])
    density = (2.0 * (window[1] - window[0]) / (window[3] - window[2]), 2.0)
    axes.streamplot(
        MM * grid.x,
        MM * grid.y,
        grid.values[0],
        grid.values[1],
        color="#333333",
        linewidth=0.45,
        arrowsize=0.55,
        density=density,
    )
    solids(axes, scene)
    frame(axes, window)
    _zones(axes, grid, scene, window, ZONES if numbered else {})
    air_arrow(axes, scene, window, ZONES["air"] if numbered else "")
    streams(axes, scene)
    bar = figure.colorbar(filled, cax=axes.inset_axes((1.04, 0.1, 0.035, 0.8)))
    bar.set_label(r"$C_p = (p - p_\mathrm{inlet})\;/\;\frac{1}{2}\rho U^2$")
    bar.ax.axhline(SUCTION_LEVEL, color=INK, linewidth=1.3, linestyle="--")
    bar.set_ticks([t for t in np.arange(-3.0, 2.0, 0.5) if levels[0] <= t <= levels[-1]])
    bar.ax.tick_params(labelsize=8)
    axes.set_title(_airflow_title(airflow, in_time=np.ndim(field.velocity) == 3), fontsize=9, loc="left")
    save(figure, path)


def pressure_coefficient(mean: FlowField, scene: Scene, airflow: Mapping[str, Any]) -> Array:
    """Cp = (p - p_inlet) / (0.5 rho U^2) at the nodes (n,) of a steady field with pressure."""
    assert scene.air is not None
    return (np.asarray(mean.pressure) - _inlet_pressure(mean, scene, airflow)) / (
        0.5 * mean.density * scene.air.speed**2
    )


def _inlet_pressure(field: FlowField, scene: Scene, airflow: Mapping[str, Any]) -> float:
    """``p_inlet`` (Pa) where it was measured, else the mean along the field's own inlet: its upper or lower end."""
    if airflow.get("p_inlet") is not None:
        return float(airflow["p_inlet"])
    assert scene.air is not None
    assert field.pressure is not None
    y = field.points[:, 1]
    end = y.max() if scene.air.direction == "down" else y.min()
    there = np.flatnonzero(np.abs(y - end) <= 1e-9 * np.ptp(y))
    there = there[np.argsort(field.points[there, 0])]
    x, p = field.points[there, 0], field.pressure[there]
    return float(np.trapezoid(p, x) / np.ptp(x)) if len(there) > 1 else float(p.mean())


def _airflow_title(airflow: Mapping[str, Any], *, in_time: bool) -> str:
    cd, reynolds = airflow["cd"], airflow["reynolds"]
    number = f"{reynolds:.0f}" if reynolds >= 100 else f"{reynolds:.3g}"
    interval = "" if cd["low"] is None else f" [{cd['low']:.3f}, {cd['high']:.3f}]"
    what = "Mean pressure and streamlines" if in_time else "Pressure and streamlines"
    return f"{what}\n{airflow['rung']}, {airflow['verdict']};  Re = {number};  $C_D$ = {cd['value']:.3f}{interval}"


def _pressure_window(scene: Scene, airflow: Mapping[str, Any]) -> Window:
    """Round the body, far enough downstream for the whole suction zone, clipped to the channel."""
    assert scene.air is not None
    channel, width = scene.channel, scene.width
    middle = first_outline(scene).mean(axis=0)
    zone = airflow.get("suction") or {}
    behind = max(DOWNSTREAM * width, 1.5 * width + max(zone.get("length") or 0.0, zone.get("reversal_length") or 0.0))
    above, below = (UPSTREAM * width, behind) if scene.air.direction == "down" else (behind, UPSTREAM * width)
    return (
        max(-channel.width / 2, float(middle[0]) - ASIDE * width),
        min(channel.width / 2, float(middle[0]) + ASIDE * width),
        max(channel.bottom, float(middle[1]) - below),
        min(channel.top, float(middle[1]) + above),
    )


def _cp_levels(cp: Array) -> tuple[Array, float]:
    """Contour levels that leave out the peaks at sharp corners, and the limit of a colour scale centred on 0."""
    low, high = np.percentile(cp, [2.0, 99.8])
    low = float(np.clip(np.floor(4 * low) / 4, -3.0, -0.75))
    high = float(np.clip(np.ceil(4 * high) / 4, 0.5, 1.5))
    return np.arange(low, high + 1e-9, 0.125), PALER * max(-low, high)


def _scale(levels: Array, limit: float) -> Any:
    """Blue to white (0) to red up to +-limit; beyond the levels the shade one level further on."""
    from matplotlib import colormaps

    scale, step = colormaps["RdBu_r"], levels[1] - levels[0]
    under, over = (scale(0.5 + 0.5 * cp / limit) for cp in (levels[0] - step, levels[-1] + step))
    return scale.with_extremes(under=under, over=over)


def _zones(axes: Axes, grid: Grid, scene: Scene, window: Window, numbers: Mapping[str, str]) -> None:
    """Name the pressing and the suction zone at the side, with a line to each, ``numbers`` before the names."""
    assert scene.air is not None
    outline, width = first_outline(scene), scene.width
    upstream = 1.0 if scene.air.direction == "down" else -1.0
    cp = np.ma.filled(grid.values[2], np.nan)
    x, y = np.meshgrid(grid.x - outline[:, 0].mean(), upstream * grid.y)
    if "body" in numbers:
        across, up = MM * outline.mean(axis=0)
        axes.text(across, up, numbers["body"], ha="center", va="center", fontweight="bold", color="white", zorder=10)
    ahead = y > np.mean(upstream * outline[:, 1])
    shade = (y < np.min(upstream * outline[:, 1])) & (np.abs(x) < width / 2)  # right behind the body
    pressed = np.where(ahead & (np.abs(x) < width) & (cp > PRESSING_LEVEL), cp, -np.inf)
    if np.isfinite(pressed).any():
        i, j = np.unravel_index(np.argmax(pressed), pressed.shape)
        _callout(
            axes,
            numbers.get("pressing zone", "") + "pressing zone",
            (grid.x[j], grid.y[i]),
            0.7 * upstream * width,
            window,
        )
    low = shade & (cp < SUCTION_LEVEL)
    if not low.any():
        low = ~ahead & (cp < SUCTION_LEVEL)
    if low.any():  # its deeper half: in a narrow channel the zone itself may reach far downstream
        sucked = np.argwhere(low & (cp <= 0.5 * (SUCTION_LEVEL + cp[low].min())))
        i, j = sucked[np.argmin(np.sum((sucked - np.median(sucked, axis=0)) ** 2, axis=1))]
        _callout(
            axes,
            numbers.get("suction zone", "") + "suction zone",
            (grid.x[j], grid.y[i]),
            -0.7 * upstream * width,
            window,
        )


def _callout(axes: Axes, text: str, place: tuple[float, float], lift: float, window: Window) -> None:
    """A name near the right-hand border, ``lift`` m above the place it belongs to."""
    level = min(max(place[1] + lift, window[2] + 0.05 * abs(lift)), window[3] - 0.05 * abs(lift))
    axes.annotate(
        text,
        xy=(MM * place[0], MM * place[1]),
        xytext=(MM * (0.97 * window[1] + 0.03 * window[0]), MM * level),
        fontsize=9,
        fontweight="bold",
        ha="right",
        va="center",
        bbox={"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": INK, "linewidth": 0.6, "alpha": 0.9},
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0},
        zorder=10,
    )


# -- tracks ------------------------------------------------------------------------------------------------------------


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
