"""The vorticity figure: the air's turning in its mean, and of a wake in time also at one moment of the shedding."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...field.derived import vorticity
from ..air import as_flown, window_round_body
from ..canvas import TALLEST, frame, inside_window, new_figure, save, solids, triangulation
from .figure import Figure, figures

if TYPE_CHECKING:
    from ...field import FlowField
    from ...results.airflow_summary import Airflow
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_vorticity"]

Array = NDArray[np.float64]

FULL = 0.985  # of the window's area has no more than what the colour is full at: thin layers at walls have far more
LEVELS = 24  # even: none is zero, and air that does not turn is white


def draw_vorticity(paper: Paper, field: FlowField, scene: Scene, airflow: Airflow) -> NDArray[Any]:
    """Draw the vorticity times D / U round the first body: of a field in time at its first moment and in the mean."""
    from matplotlib.ticker import MaxNLocator

    assert scene.air is not None
    window = window_round_body(scene, airflow)
    now = {} if field.times is None else {f"at {1e3 * float(field.times[0]):.3g} ms of the loop": _first(field)}
    shown = {**now, "mean": as_flown(field.mean(), scene)}
    scaled = {name: vorticity(one) * scene.width / scene.air.speed for name, one in shown.items()}
    here = inside_window(field.points, window)
    most = max(_strong(np.abs(values[here]), field.node_area[here]) for values in scaled.values())
    across = TALLEST * 0.75 * (window[1] - window[0]) / (window[3] - window[2])
    figure = new_figure(1.4 + (across + 0.5) * len(scaled), TALLEST * 0.75 + 0.9, paper)
    panels: NDArray[Any] = figure.subplots(1, len(scaled), squeeze=False, sharey=True)[0]
    mesh, levels = triangulation(field), np.linspace(-most, most, LEVELS)
    for axes, (name, values) in zip(panels, scaled.items(), strict=True):
        filled = axes.tricontourf(mesh, values, levels=levels, cmap="RdBu_r", extend="both")
        filled.set_rasterized(True)
        axes.set_aspect("equal")
        frame(axes, window)
        solids(axes, scene)
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


def _first(field: FlowField) -> FlowField:
    """A field in time as it is at its first moment."""
    from dataclasses import replace

    assert field.times is not None
    weights = field.weights(float(field.times[0]))
    still = field.mapped(lambda nodal: np.tensordot(weights, nodal, axes=1))
    return replace(still, times=None, period=None, coefficients=None, truncation=None)


def _needs(outcome: Outcome) -> bool:
    airflow = outcome.airflow
    return bool(outcome.scene.body) and outcome.field is not None and airflow is not None and airflow.cd is not None


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    assert outcome.field is not None
    assert outcome.airflow is not None
    return draw_vorticity(paper, outcome.field, outcome.scene, outcome.airflow)


figures.add(
    "vorticity",
    Figure("Mean vorticity over air speed and body width; of a wake in time also that of one moment.", _draw, _needs),
)
