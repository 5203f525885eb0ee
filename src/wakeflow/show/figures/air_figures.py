"""The standard figures of the mean air round the first body: pressure and streamlines, its surface, vorticity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...air.field.flow import still, vorticity
from ...air.kinds.airflow_table import momentum_of
from ...core.geometry import along
from .. import air_pictures, canvas
from ..air_pictures import SUCTION_LEVEL, TOUCHING, as_flown, pressure_coefficient, trace_streamlines
from ..canvas import COLOURS, INK, MM, TALLEST, PlotGrid, Window, save
from ..outcome import add_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...air.field import FlowField
    from ...air.kinds.airflow_table import Airflow
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import AirAndTracks

    Air = tuple[FlowField, Scene, Airflow] | tuple[()]

Array = NDArray[np.float64]

PRESSING_LEVEL = 0.3  # a pressing zone is named where Cp rises above this
PALER = 1.3  # stretch of the colour scale: streamlines stay visible on its darkest used colour
ZONES = {"air": "1  ", "pressing zone": "2  ", "body": "3", "suction zone": "4  "}  # as in the paper's Fig. 7


def draw_pressure(paper: Paper, field: FlowField, scene: Scene, airflow: Airflow, *, numbered: bool = False) -> Axes:
    """Filled contours of Cp = (p - p_inlet) / (0.5 rho U^2) with streamlines round the first body.

    ``field``, steady or in time (its mean is drawn), must carry pressure (Pa); rho is its density, U the scene's air
    speed, p_inlet ``airflow.p_inlet`` (Pa) or else the mean along the field's inlet end. The line
    Cp = -0.5 bounds the suction zone; ``numbered`` puts the numbers of the paper's Fig. 7 before the zones' names.
    Raises ValueError without pressure or air.
    """
    if not field.has("pressure") or scene.air is None:
        raise ValueError("the pressure picture needs a field with pressure and a scene with air")
    mean = as_flown(field.mean(), scene)
    cp = pressure_coefficient(mean, scene, airflow)
    window = air_pictures.window_round_body(scene, airflow)
    figure, axes, _ = canvas.canvas(window, paper)
    mesh = canvas.triangulation(mean)
    levels, limit = _cp_levels(cp[canvas.inside_window(mean.points, window)])
    filled = axes.tricontourf(
        mesh, cp, levels=levels, cmap=_scale(levels, limit), vmin=-limit, vmax=limit, extend="both"
    )
    filled.set_rasterized(True)
    axes.tricontour(mesh, cp, levels=[SUCTION_LEVEL], colors=INK, linewidths=1.3, linestyles="--")
    grid = PlotGrid.sample(mesh, window, [*mean.velocity.T, cp])
    trace_streamlines(axes, mean, window, grid)
    canvas.solids(axes, scene)
    canvas.frame(axes, window)
    _zones(axes, grid, scene, window, ZONES if numbered else {})
    canvas.air_arrow(axes, scene, window, ZONES["air"] if numbered else "")
    canvas.streams(axes, scene)
    bar = figure.colorbar(filled, cax=axes.inset_axes((1.04, 0.1, 0.035, 0.8)))
    bar.set_label(r"$C_p = (p - p_\mathrm{inlet})\;/\;\frac{1}{2}\rho U^2$")
    bar.ax.axhline(SUCTION_LEVEL, color=INK, linewidth=1.3, linestyle="--")
    bar.set_ticks([t for t in np.arange(-3.0, 2.0, 0.5) if levels[0] <= t <= levels[-1]])
    bar.ax.tick_params(labelsize=8)
    axes.set_title(_airflow_title(airflow, in_time=np.ndim(field.velocity) == 3), fontsize=9, loc="left")
    save(figure, paper, grid.arrays(("air vx (m/s)", "air vy (m/s)", "Cp")))
    return axes


def _airflow_title(airflow: Airflow, *, in_time: bool) -> str:
    cd, reynolds = airflow.cd, airflow.reynolds
    number = f"{reynolds:.0f}" if reynolds >= 100 else f"{reynolds:.3g}"
    interval = f" ({cd.low:.3f} to {cd.high:.3f})" if cd.known else ""  # none of a given case
    what = "Mean pressure and streamlines" if in_time else "Pressure and streamlines"
    return f"{what}\n{airflow.rung}, {airflow.verdict};  Re = {number};  $C_D$ = {cd.value:.3f}{interval}"


def _cp_levels(cp: Array) -> tuple[Array, float]:
    """Contour levels that leave out the peaks at sharp corners, and the limit of a colour scale centred on 0."""
    low, high = np.percentile(cp, [2.0, 99.8])
    low = float(np.clip(np.floor(4 * low) / 4, -3.0, -0.75))
    high = float(np.clip(np.ceil(4 * high) / 4, 0.5, 1.5))
    return np.arange(low, high + 1e-9, 0.125), PALER * max(-low, high)


def _scale(levels: Array, limit: float) -> object:
    """Blue to white (0) to red up to +-limit; beyond the levels the shade one level further on."""
    from matplotlib import colormaps

    scale, step = colormaps["RdBu_r"], levels[1] - levels[0]
    under, over = (scale(0.5 + 0.5 * cp / limit) for cp in (levels[0] - step, levels[-1] + step))
    return scale.with_extremes(under=under, over=over)


def _zones(axes: Axes, grid: PlotGrid, scene: Scene, window: Window, numbers: Mapping[str, str]) -> None:
    """Name the pressing and the suction zone at the side, with a line to each, ``numbers`` before the names."""
    outline, width = scene.outline, scene.width
    upstream = 1.0 if scene.airstream.direction == "down" else -1.0
    cp = np.ma.filled(grid.values[2], np.nan)
    x, y = np.meshgrid(grid.x - outline[:, 0].mean(), upstream * grid.y)
    if "body" in numbers:
        across, up = MM * outline.mean(axis=0)
        axes.text(across, up, numbers["body"], ha="center", va="center", fontweight="bold", color="white", zorder=10)
    ahead = y > np.mean(upstream * outline[:, 1])
    shade = (y < np.min(upstream * outline[:, 1])) & (np.abs(x) < width / 2)  # right behind the body
    pressed = np.where(ahead & (np.abs(x) < width) & (cp > PRESSING_LEVEL), cp, -np.inf)
    places: dict[str, tuple[Any, float]] = {}  # the cell that a name points to, and which way the name is moved
    if np.isfinite(pressed).any():
        places["pressing zone"] = np.unravel_index(np.argmax(pressed), pressed.shape), upstream
    low = shade & (cp < SUCTION_LEVEL)
    if not low.any():
        low = ~ahead & (cp < SUCTION_LEVEL)
    if low.any():  # its deeper half: in a narrow channel the zone itself may reach far downstream
        sucked = np.argwhere(low & (cp <= 0.5 * (SUCTION_LEVEL + cp[low].min())))
        places["suction zone"] = sucked[np.argmin(np.sum((sucked - np.median(sucked, axis=0)) ** 2, axis=1))], -upstream
    for name, ((i, j), way) in places.items():
        _callout(axes, numbers.get(name, "") + name, (grid.x[j], grid.y[i]), 0.7 * way * width, window)


def _callout(axes: Axes, text: str, place: tuple[float, float], lift: float, window: Window) -> None:
    """A name near the right-hand border, ``lift`` m above the place it belongs to."""
    level = min(max(place[1] + lift, window[2] + 0.05 * abs(lift)), window[3] - 0.05 * abs(lift))
    axes.annotate(
        text, xy=(MM * place[0], MM * place[1]), xytext=(MM * (0.97 * window[1] + 0.03 * window[0]), MM * level),
        fontsize=9, fontweight="bold", ha="right", va="center",
        bbox={"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": INK, "linewidth": 0.6, "alpha": 0.9},
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}, zorder=10,
    )  # fmt: skip


def pressure_along(field: FlowField, outline: Array, cp: Array) -> tuple[Array, Array]:
    """Arc length (m) from the first corner of an ``outline`` (k, 2), counter-clockwise, and Cp, at the nodes on it."""
    arc, gap = along(np.concatenate([outline, outline[:1]]), field.points[field.boundary])
    on = np.flatnonzero(gap < TOUCHING * float(np.ptp(outline[:, 0])))
    on = on[np.argsort(arc[on])]
    return arc[on], cp[field.boundary][on]


def draw_surface(paper: Paper, field: FlowField, scene: Scene, airflow: Airflow) -> Axes:
    """Draw Cp of the mean air along the first body, its corners, and the momentum model on the edges that air meets.

    Among several bodies the title names it: the others are not drawn.
    """
    mean, outline = as_flown(field.mean(), scene), scene.outline
    arc, cp = pressure_along(mean, outline, pressure_coefficient(mean, scene, airflow))
    edges = np.concatenate([[0.0], np.cumsum(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T))])
    model = momentum_of(scene)
    axes = canvas.new_axes(6.4, 3.6, paper)
    axes.plot(MM * arc, cp, ".-", ms=3, lw=1.2, color=COLOURS[0], label="computed, mean")
    for i, (value, lit) in enumerate(zip(model.cp, model.lit, strict=True)):
        if lit > 0:
            label = "the paper's momentum model" if i == int(np.argmax(model.lit > 0)) else None
            axes.plot(MM * edges[i : i + 2], [value] * 2, "--", color=COLOURS[1], linewidth=1.6, label=label)
    for edge in edges:
        axes.axvline(MM * edge, color="#9aa3ad", linewidth=0.5, zorder=0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_xlabel("along the body, counter-clockwise (mm); lines: its corners")
    axes.set_ylabel("pressure coefficient")
    axes.legend(fontsize=8, frameon=False)
    if len(scene.body) > 1:
        axes.set_title(f"{next(iter(scene.body))}, the first of {len(scene.body)} bodies", fontsize=9, loc="left")
    axes.grid(axis="y", color="#dddddd", linewidth=0.5)
    save(axes.figure, paper, {"along the body (m)": arc, "Cp": cp})
    return axes


FULL = 0.985  # of the window's area has no more than what the colour is full at: thin layers at walls have far more
SHADES = 24  # even: none is zero, and air that does not turn is white


def draw_vorticity(paper: Paper, field: FlowField, scene: Scene, airflow: Airflow) -> NDArray[np.object_]:
    """Draw the vorticity times D / U round the first body: of a field in time at its first moment and in the mean."""
    from matplotlib.ticker import MaxNLocator

    window = air_pictures.window_round_body(scene, airflow)
    first = field.times[:1].tolist()  # none of a steady one
    shown = {f"at {1e3 * time:.3g} ms of the loop": still(field, field.weights(time)) for time in first}
    shown["mean"] = as_flown(field.mean(), scene)
    scaled = {name: vorticity(flow) * scene.width / scene.airstream.speed for name, flow in shown.items()}
    here = canvas.inside_window(field.points, window)
    most = max(_strong(np.abs(values[here]), field.node_area[here]) for values in scaled.values())
    across = TALLEST * 0.75 * (window[1] - window[0]) / (window[3] - window[2])
    figure = canvas.new_figure(1.4 + (across + 0.5) * len(scaled), TALLEST * 0.75 + 0.9, paper)
    panels: NDArray[np.object_] = figure.subplots(1, len(scaled), squeeze=False, sharey=True)[0]
    mesh, levels = canvas.triangulation(field), np.linspace(-most, most, SHADES)
    for axes, (name, values) in zip(panels, scaled.items(), strict=True):
        filled = axes.tricontourf(mesh, values, levels=levels, cmap="RdBu_r", extend="both")
        filled.set_rasterized(True)
        axes.set_aspect("equal")
        canvas.frame(axes, window)
        canvas.solids(axes, scene)
        axes.set_title(name, fontsize=9, loc="left")
    bar = figure.colorbar(filled, ax=list(panels), shrink=0.7)
    bar.set_label(r"vorticity, $\omega D / U$ (counter-clockwise positive)", fontsize=8)
    bar.set_ticks([tick for tick in MaxNLocator(8, symmetric=True).tick_values(-most, most) if abs(tick) <= most])
    nodes = {"x (m)": field.points[:, 0], "y (m)": field.points[:, 1]}
    save(figure, paper, {**nodes, "triangles": field.triangles, **{f"{k}, times D / U": v for k, v in scaled.items()}})
    return panels


def _strong(size: Array, area: Array) -> float:
    """The size (n,) that FULL of the area of all nodes, ``area`` (n,), does not exceed."""
    order = np.argsort(size)
    reached = np.cumsum(area[order])
    return float(size[order][np.searchsorted(reached, FULL * reached[-1])])


def air_of(outcome: AirAndTracks) -> Air:
    """The air round the bodies; empty of a run without one that sees them."""
    field, airflow = outcome.field, outcome.airflow
    if field is None or airflow is None or not airflow.cd or not outcome.scene.body:
        return ()
    return field, outcome.scene, airflow


def air_with_pressure(outcome: AirAndTracks) -> Air:
    """Air as of :func:`air_of`; empty without pressure too."""
    air = air_of(outcome)
    return air if air and air[0].has("pressure") else ()


def _air_at_the_surface(outcome: AirAndTracks) -> Air:
    air = air_with_pressure(outcome)
    if not air:
        return ()
    arc, _ = pressure_along(air[0], outcome.scene.outline, np.zeros(len(air[0].points)))
    return air if len(arc) > 2 else ()


add_figure(
    "pressure", "Pressure coefficient and streamlines. Dashed: the suction zone's border, Cp = −0.5.",
    draw_pressure, air_with_pressure, of_answer=False,
)  # fmt: skip
add_figure(
    "surface", "Pressure along the first body and the paper's momentum model, which knows the front only.",
    draw_surface, _air_at_the_surface, of_answer=False,
)  # fmt: skip
add_figure(
    "vorticity", "Mean vorticity over air speed and body width; of a wake in time also that of one moment.",
    draw_vorticity, air_of, of_answer=False,
)  # fmt: skip
