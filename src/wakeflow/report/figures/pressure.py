"""The pressure figure: pressure coefficient and streamlines round the first body, of the mean air."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..air import SUCTION_LEVEL, as_flown, pressure_coefficient, trace_streamlines, window_round_body
from ..canvas import (
    INK,
    MM,
    PlotGrid,
    Window,
    air_arrow,
    canvas,
    first_outline,
    frame,
    inside_window,
    save,
    solids,
    streams,
    triangulation,
)
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...field import FlowField
    from ...results.airflow_summary import Airflow
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_pressure"]

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
    if field.pressure is None or scene.air is None:
        raise ValueError("the pressure picture needs a field with pressure and a scene with air")
    mean = as_flown(field.mean(), scene)
    cp = pressure_coefficient(mean, scene, airflow)
    window = window_round_body(scene, airflow)
    figure, axes, _ = canvas(window, paper)
    mesh = triangulation(mean)
    levels, limit = _cp_levels(cp[inside_window(mean.points, window)])
    filled = axes.tricontourf(
        mesh, cp, levels=levels, cmap=_scale(levels, limit), vmin=-limit, vmax=limit, extend="both"
    )
    filled.set_rasterized(True)
    axes.tricontour(mesh, cp, levels=[SUCTION_LEVEL], colors=INK, linewidths=1.3, linestyles="--")
    grid = PlotGrid.sample(mesh, window, [*mean.velocity.T, cp])
    trace_streamlines(axes, mean, window, grid)
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
    save(figure, paper, grid.arrays(("air vx (m/s)", "air vy (m/s)", "Cp")))
    return axes


def _airflow_title(airflow: Airflow, *, in_time: bool) -> str:
    cd, reynolds = airflow.cd, airflow.reynolds
    assert cd is not None
    assert reynolds is not None
    number = f"{reynolds:.0f}" if reynolds >= 100 else f"{reynolds:.3g}"
    interval = f" [{cd.low:.3f}, {cd.high:.3f}]" if cd.known else ""
    what = "Mean pressure and streamlines" if in_time else "Pressure and streamlines"
    return f"{what}\n{airflow.rung}, {airflow.verdict};  Re = {number};  $C_D$ = {cd.value:.3f}{interval}"


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


def _zones(axes: Axes, grid: PlotGrid, scene: Scene, window: Window, numbers: Mapping[str, str]) -> None:
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


def _draw(paper: Paper, outcome: Outcome) -> Axes:
    assert outcome.field is not None
    assert outcome.airflow is not None
    return draw_pressure(paper, outcome.field, outcome.scene, outcome.airflow)


def _needs(outcome: Outcome) -> bool:
    field, airflow = outcome.field, outcome.airflow
    measured = airflow is not None and airflow.cd is not None  # an airflow that sees the bodies
    return bool(outcome.scene.body) and field is not None and field.pressure is not None and measured


figures.add(
    "pressure",
    Figure("Pressure coefficient and streamlines. Dashed: the suction zone's border, Cp = −0.5.", _draw, _needs),
)
