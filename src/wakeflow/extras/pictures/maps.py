"""Maps: kind = "streamlines" (the paper's Fig. 7) and kind = "density", the fractional flows and the suction zone."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.record import to_json
from ...scene.pictures import Density
from ...show import canvas
from ...show.air_pictures import SUCTION_LEVEL, as_flown, pressure_coefficient
from ...show.asked_pictures import PictureFiles, View
from ...show.canvas import INK, MM, PlotGrid, Window, save
from ...show.figures.air_figures import air_with_pressure, draw_pressure
from ...show.moving import Path2D

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
CELL, ACROSS = 0.125, 60  # cells of a map: at most so many widths of the first body, and so many over the channel
SIDE_MARGIN = 0.06  # of the channel's height: beside what flows
DECADES = 3.0  # of mass flux below its highest that are shaded
GRID = 120  # points along the longer side of the airflow's data


def draw_streamlines(view: View) -> PictureFiles:
    """Pressure coefficient and streamlines, zones numbered as in the paper's Fig. 7; data on a regular grid."""
    outcome, scene = view.outcome, view.scene
    if outcome.field is None or not outcome.field.has("pressure") or outcome.airflow is None:
        raise SceneError(f"picture.{view.name}: streamlines need an airflow with pressure")
    draw_pressure(view.file(".png"), outcome.field, scene, outcome.airflow, numbered=True)
    mean = as_flown(outcome.field.mean(), scene)
    cp = pressure_coefficient(mean, scene, outcome.airflow)
    grid = PlotGrid.sample(canvas.triangulation(mean), _channel(view), [*mean.velocity.T, cp], GRID)
    columns = grid.columns(("air vx (m/s)", "air vy (m/s)", "Cp"))
    data = view.write_csv(tuple(columns), zip(*columns.values(), strict=True))
    suction = outcome.airflow.suction
    size = [MM * (length or 0.0) for length in (suction.length, suction.width)]
    text = (
        "1 direction of the air, 2 pressing zone, 3 body, 4 suction zone "
        f"(Cp < {SUCTION_LEVEL:g}: lowest {suction.cp_min:.2f}, {size[0]:.0f} mm long, {size[1]:.0f} mm wide)."
    )
    return PictureFiles([view.file(".png"), data], text, {"suction": to_json(suction)})


def _channel(view: View) -> Window:
    channel = view.scene.channel
    return (-channel.width / 2, channel.width / 2, channel.bottom, channel.top)


def _flowing(view: View) -> Window:
    """The channel's whole height, as wide as what flows and is in it."""
    left, right, low, high = _channel(view)
    parts = [path.position for paths in view.paths.values() for path in paths]
    x = np.concatenate([*parts, *(body.outline() for body in view.scene.body.values())])[:, 0]
    room = SIDE_MARGIN * (high - low)
    return max(left, float(x.min()) - room), min(right, float(x.max()) + room), low, high


def mass_flux(paths: list[Path2D], rate: float, depth: float, x: Array, y: Array) -> Array:
    """Mass flux (ny, nx) kg/(m2 s) of a stream of ``rate`` (kg/s) over ``depth`` (m) in cells with edges x, y (m).

    Every granule represents the same mass flow; what a cell sees is the length of its tracks in it over the cell's
    volume: the track-length estimate of the flux through it, direction left aside (Spanier & Gelbard 1969, Monte
    Carlo Principles and Neutron Transport Problems, ch. 2).
    """
    total = np.zeros((len(y) - 1, len(x) - 1))
    step = 0.5 * min(float(np.diff(x).min()), float(np.diff(y).min()))
    for path in paths:
        middle, length = _cut(path.at(path.moments(step))[0], x, y)
        total += np.histogram2d(middle[:, 1], middle[:, 0], bins=(y, x), weights=length)[0]
    volume = np.diff(y)[:, None] * np.diff(x) * depth
    return rate / max(len(paths), 1) * total / volume


def _cut(points: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """The segments of a polyline (n, 2), shorter than a cell, cut where they cross a line of the grid: middles (m, 2)
    and lengths (m,) of the parts.
    """
    start, along = points[:-1], np.diff(points, axis=0)
    cuts = []
    for axis, lines in enumerate((x, y)):
        before, after = (np.searchsorted(lines, part[:, axis]) for part in (start, points[1:]))
        line = lines[np.clip(np.maximum(before, after) - 1, 0, len(lines) - 1)]
        whole = np.ones(len(start))
        cuts.append(np.divide(line - start[:, axis], along[:, axis], out=whole, where=before != after))
    first, second = np.minimum(*cuts), np.maximum(*cuts)
    bounds = (np.zeros_like(first), first, second, np.ones_like(first))
    middles = [start + 0.5 * (a + b)[:, None] * along for a, b in itertools.pairwise(bounds)]
    size = np.linalg.norm(along, axis=1)
    return np.concatenate(middles), np.concatenate([(b - a) * size for a, b in itertools.pairwise(bounds)])


def draw_density(view: View) -> PictureFiles:
    """A panel a fraction: its mass flux in the channel, bodies, bins, and the outline of the suction zone."""
    picture, scene = view.picture, view.scene
    assert isinstance(picture, Density)
    window, shares = _flowing(view), scene.mass_shares()
    cell = picture.cell or min(CELL * scene.width, scene.channel.width / ACROSS)
    x, y = (np.linspace(a, b, max(2, round((b - a) / cell)) + 1) for a, b in (window[:2], window[2:]))
    flux = {
        name: mass_flux(paths, scene.feed.mass_flow * shares[name], scene.feed.depth, x, y)
        for name, paths in view.paths.items()
    }
    tall = 4.6
    wide = max(1.6, tall * (window[1] - window[0]) / (window[3] - window[2]))
    figure = canvas.new_figure((wide + 1.3) * len(flux), tall + 0.9)
    panels = figure.subplots(1, len(flux), squeeze=False, sharey=True)[0]
    colours = canvas.fraction_colours(list(scene.fraction))
    for axes, (name, values) in zip(panels, flux.items(), strict=True):
        _panel(axes, view, x, y, values, colours[name], name)
        canvas.frame(axes, window)
        canvas.solids(axes, scene)
        canvas.air_arrow(axes, scene, window)
        canvas.streams(axes, scene)
    figure.suptitle("Mass flux of each fraction; dashed: suction zone, dotted: reversed flow", fontsize=9)
    save(figure, view.file(".png"))
    columns = ("x (m)", "y (m)", *(f"{name} (kg/(m^2 s))" for name in flux))
    data = view.write_csv(columns, _flux_rows(x, y, list(flux.values())))
    numbers = _through(view)
    entered = [f"{name} {100 * row['suction']:.0f} and {100 * row['reversal']:.0f} %" for name, row in numbers.items()]
    text = f"Of each fraction enter the suction zone and the reversed flow of the mean air: {', '.join(entered)}."
    return PictureFiles([view.file(".png"), data], text if entered else "", {"through": numbers})


def _panel(axes: Axes, view: View, x: Array, y: Array, flux: Array, colour: str, name: str) -> None:
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    scale = LinearSegmentedColormap.from_list("flux", ["#ffffff", colour, INK])
    top = float(flux.max()) or 1.0
    shown = np.ma.masked_less(flux, top * 10**-DECADES)
    drawn = axes.pcolormesh(MM * x, MM * y, shown, cmap=scale, norm=LogNorm(top * 10**-DECADES, top), rasterized=True)
    bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.6, pad=0.02)
    bar.set_label(f"{name}: kg/(m² s)", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    axes.set_title(name, fontsize=9, loc="left")
    axes.set_aspect("equal")
    if air := air_with_pressure(view.outcome):
        field, _, airflow = air
        mean, mesh = as_flown(field.mean(), view.scene), canvas.triangulation(field)
        cp = pressure_coefficient(mean, view.scene, airflow)
        axes.tricontour(mesh, cp, levels=[SUCTION_LEVEL], colors=INK, linewidths=1.1, linestyles="--", zorder=5)
        axes.tricontour(mesh, mean.velocity[:, 1], levels=[0.0], colors=INK, linewidths=0.9, linestyles=":", zorder=5)


def _flux_rows(x: Array, y: Array, values: list[Array]) -> Iterator[tuple[object, ...]]:
    for i, up in enumerate(0.5 * (y[1:] + y[:-1])):
        for j, along in enumerate(0.5 * (x[1:] + x[:-1])):
            yield float(along), float(up), *(float(value[i, j]) for value in values)


def _through(view: View) -> dict[str, dict[str, float]]:
    """Share of granules, by fraction, whose track enters the suction zone, and the reversed flow, of the mean air."""
    from matplotlib.tri import LinearTriInterpolator

    if not (air := air_with_pressure(view.outcome)):
        return {}
    field, _, airflow = air
    mean, mesh = as_flown(field.mean(), view.scene), canvas.triangulation(field)
    zones = {
        "suction": pressure_coefficient(mean, view.scene, airflow) - SUCTION_LEVEL,
        "reversal": _downstream(view) * mean.velocity[:, 1],
    }
    inside = {zone: LinearTriInterpolator(mesh, values) for zone, values in zones.items()}
    entered: dict[str, dict[str, float]] = {}
    for name, paths in view.paths.items():
        points = [path.at(np.linspace(path.time[0], path.time[-1], 400))[0] for path in paths]
        entered[name] = {
            zone: float(np.mean([np.any(np.ma.filled(level(*(MM * p.T)), np.inf) < 0.0) for p in points]))
            for zone, level in inside.items()
        }
    return entered


def _downstream(view: View) -> float:
    """+1 where the air rises, -1 where it goes down."""
    return 1.0 if view.scene.air is not None and view.scene.air.direction == "up" else -1.0
