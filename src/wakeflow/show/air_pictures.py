"""The air as pictures show it: its mean as the granules flew in it, pressure coefficient, streamlines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..air.field import AT_REST, EMPTY
from ..air.field.flow import still, stream_function
from ..core.geometry import distance_to
from .canvas import MM, PlotGrid, Window, inside_window, triangulation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..air.field import FlowField
    from ..air.kinds.airflow_table import Airflow
    from ..scene import Scene
    from .canvas import Window

Array = NDArray[np.float64]

SUCTION_LEVEL = -0.5  # Cp that bounds the suction zone
UPSTREAM, DOWNSTREAM, ASIDE = 2.2, 5.0, 3.0  # the window from the body's middle, in body widths
BESIDE = 0.5  # of the first body's width, round every other body
LINES = 26  # streamlines across the window, with as much air between any two
SLOW = (0.5, 0.25, 0.12, 0.06, 0.03)  # of that: further ones on either side of a body's own, for the eddies behind it
TOUCHING = 1e-6  # of the first body's width: how far off its outline a node of the mesh still lies on it
INK_OF_LINES = "#333333"


def as_flown(mean: FlowField, scene: Scene) -> FlowField:
    """A steady field, in a machine that is its own mirror image the mean of the field and its image.

    A few shedding cycles are a small sample and their mean leans to one side; granules fly in both images, so that what
    they met does not. Where a mesh that is not quite its own image has no point opposite, the field itself stands.
    """
    if not scene.symmetric:
        return mean
    velocity, pressure, _ = mean.image.sample(mean.points)
    there = np.isfinite(velocity[:, 0])
    both = np.where(there[:, None], 0.5 * (mean.velocity + velocity), mean.velocity)
    level = np.where(there, 0.5 * (mean.pressure + pressure), mean.pressure) if mean.has("pressure") else EMPTY
    return replace(mean, velocity=both, pressure=level, given_gradient=EMPTY)


def moments_of(field: FlowField, count: int) -> Array:
    """``count`` times (s) evenly over the loop of a field in time, its end left out; without a loop over its record."""
    times, period = field.time_axis.times, field.time_axis.period
    if not field.time_axis.repeats:
        return np.linspace(times[0], times[-1], count)
    return np.asarray(times[0] + np.arange(count) / count * period)


def at_moments(field: FlowField, count: int) -> tuple[Array, Iterator[FlowField]]:
    """``count`` times (s) evenly over a field in time, and the steady field that it is at each, on its mesh where that
    then is.
    """
    times = moments_of(field, count)
    return times, (_at_time(field, float(time)) for time in times)


def _at_time(field: FlowField, time: float) -> FlowField:
    state = still(field, field.weights(time))
    k = np.maximum(state.k, 0.0)  # the modes left out may be more than all of it
    return replace(state, points=field.points + field.motion.displacement(time), k=k, motion=AT_REST)


def trace_streamlines(axes: Axes, mean: FlowField, window: Window, grid: PlotGrid) -> None:
    """Lines of the stream function, closer where the air is faster and without an end in it, with arrows along them.

    ``grid`` (of the window): velocities in its first two values.
    """
    psi = stream_function(mean)
    here = psi[inside_window(mean.points, window)]
    step = float(np.ptp(here)) / LINES
    if step <= 0.0:
        return
    outline = inside_window(mean.points, window) & _on_solids(mean)
    walls = _levels_of_bodies(psi[outline], step) if outline.any() else [float(np.median(here))]
    whole = (
        np.arange(np.ceil((here.min() - walls[0]) / step), np.floor((here.max() - walls[0]) / step) + 1) * step
        + walls[0]
    )
    slow = [level + sign * part * step for level in walls for part in (0.0, *SLOW) for sign in (1.0, -1.0)]
    levels = np.unique(np.concatenate([whole, slow]))
    lines = axes.tricontour(
        triangulation(mean), psi, levels=levels, colors=INK_OF_LINES, linewidths=0.45, linestyles="solid"
    )
    parts = [np.asarray(part) for path in lines.get_paths() for part in path.to_polygons(closed_only=False)]
    _arrows(axes, parts, grid, window)


def _levels_of_bodies(psi: Array, step: float) -> list[float]:
    """Each body's stream function, of that at nodes of all, ``psi`` (k,): half a ``step`` or more tells two apart."""
    ordered = np.sort(psi)
    parts = np.split(ordered, np.flatnonzero(np.diff(ordered) > 0.5 * step) + 1)
    return [float(np.median(part)) for part in parts]


def _on_solids(mean: FlowField) -> NDArray[np.bool_]:
    """Nodes (N,) on a boundary at which the air stands still, the channel's walls left out."""
    on_boundary = np.zeros(len(mean.points), dtype=bool)
    on_boundary[mean.boundary] = True
    x = mean.points[:, 0]
    inside = (x > x.min() + 1e-3 * np.ptp(x)) & (x < x.max() - 1e-3 * np.ptp(x))
    y = mean.points[:, 1]
    within = (y > y.min() + 1e-3 * np.ptp(y)) & (y < y.max() - 1e-3 * np.ptp(y))
    return np.asarray(on_boundary & inside & within)


def _arrows(axes: Axes, lines: list[Array], grid: PlotGrid, window: Window) -> None:
    """An arrow on every longer line, where it runs half-way through the window."""
    left, right, low, high = (MM * end for end in window)
    places = []
    for line in lines:
        inside = (line[:, 0] > left) & (line[:, 0] < right) & (line[:, 1] > low) & (line[:, 1] < high)
        if inside.sum() > 3 and np.ptp(line[inside], axis=0).max() > 0.08 * (high - low):
            places.append(line[inside][np.argmin(np.abs(line[inside, 1] - 0.5 * (low + high)))])
    if not places:
        return
    x, y = np.array(places).T
    at = [np.clip(np.searchsorted(MM * line, where), 0, len(line) - 1) for line, where in ((grid.y, y), (grid.x, x))]
    u, v = (np.ma.filled(values, 0.0)[at[0], at[1]] for values in grid.values[:2])
    speed = np.hypot(u, v)
    moving = speed > 1e-6 * float(speed.max(initial=0.0))
    u, v = (part[moving] / speed[moving] for part in (u, v))
    axes.quiver(
        x[moving], y[moving], u, v, color=INK_OF_LINES, angles="xy", pivot="tip", units="dots", scale_units="dots",
        scale=0.1, width=1.6, headwidth=7, headlength=9, headaxislength=8, zorder=3,
    )  # fmt: skip


def pressure_coefficient(mean: FlowField, scene: Scene, airflow: Airflow) -> Array:
    """Cp = (p - p_inlet) / (0.5 rho U^2) at the nodes (n,) of a steady field with pressure."""
    return (mean.pressure - inlet_pressure(mean, scene, airflow)) / dynamic_pressure(mean, scene)


def dynamic_pressure(field: FlowField, scene: Scene) -> float:
    """0.5 rho U^2 of the air ahead of the bodies, Pa."""
    return 0.5 * field.density * scene.airstream.speed**2


def suction_nodes(mean: FlowField, cp: Array, scene: Scene) -> NDArray[np.bool_]:
    """Nodes (N,) of the suction zone: ``cp`` (N,) below its border, downstream of the first body's widest place, and
    joined to the body by such nodes (as ``air.foam.measure`` measures it).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    outline = scene.outline
    along = 1.0 if scene.airstream.direction == "down" else -1.0
    ends = outline[np.isin(outline[:, 0], (outline[:, 0].min(), outline[:, 0].max()))]
    widest = float((along * ends[:, 1]).min())
    low = (cp < SUCTION_LEVEL) & (along * mean.points[:, 1] <= widest + 1e-6 * scene.width)
    pairs = np.concatenate([mean.triangles[:, [0, 1]], mean.triangles[:, [1, 2]], mean.triangles[:, [2, 0]]])
    pairs = pairs[low[pairs].all(axis=1)]
    count = len(mean.points)
    _, label = connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count)), directed=False)
    body = low & (distance_to(mean.points, outline) < TOUCHING * scene.width)
    return np.asarray(low & np.isin(label, label[body]))


def inlet_pressure(field: FlowField, scene: Scene, airflow: Airflow) -> float:
    """``p_inlet`` (Pa) where it was measured, else the mean along the field's own inlet: its upper or lower end."""
    if math.isfinite(airflow.p_inlet):
        return airflow.p_inlet
    y = field.points[:, 1]
    end = y.max() if scene.airstream.direction == "down" else y.min()
    there = np.flatnonzero(np.abs(y - end) <= 1e-9 * np.ptp(y))
    there = there[np.argsort(field.points[there, 0])]
    x, p = field.points[there, 0], field.pressure[there]
    return float(np.trapezoid(p, x) / np.ptp(x)) if len(there) > 1 else float(p.mean())


def window_round_body(scene: Scene, airflow: Airflow) -> Window:
    """Round the first body, far enough downstream for the whole suction zone and wide enough for every other body,
    clipped to the channel.
    """
    channel, width = scene.channel, scene.width
    middle = scene.outline.mean(axis=0)
    longest = float(np.nanmax([0.0, airflow.suction.length, airflow.suction.reversal_length]))  # nan: none was measured
    behind = max(DOWNSTREAM * width, 1.5 * width + longest)
    above, below = (UPSTREAM * width, behind) if scene.airstream.direction == "down" else (behind, UPSTREAM * width)
    corners = np.concatenate([body.outline() for body in scene.body.values()])
    (left, low), (right, high) = corners.min(axis=0) - BESIDE * width, corners.max(axis=0) + BESIDE * width
    return (
        max(-channel.width / 2, min(float(middle[0]) - ASIDE * width, float(left))),
        min(channel.width / 2, max(float(middle[0]) + ASIDE * width, float(right))),
        max(channel.bottom, min(float(middle[1]) - below, float(low))),
        min(channel.top, max(float(middle[1]) + above, float(high))),
    )
