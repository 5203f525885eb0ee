"""The surface figure: pressure along the first body beside the paper's momentum model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...laws.momentum import momentum_pressure
from ..air import TOUCHING, as_flown, pressure_coefficient
from ..canvas import INK, MM, first_outline, new_axes, save
from ..colours import COLOURS
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...field import FlowField
    from ...results.airflow_summary import Airflow
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_surface", "pressure_along"]

Array = NDArray[np.float64]


def pressure_along(field: FlowField, outline: Array, cp: Array) -> tuple[Array, Array]:
    """Arc length (m) from the first corner of an ``outline`` (k, 2), counter-clockwise, and Cp, at the nodes on it."""
    width = float(np.ptp(outline[:, 0]))
    points = field.points[field.boundary]
    start, step = outline, np.roll(outline, -1, axis=0) - outline
    size = np.hypot(*step.T)
    part = np.clip(np.einsum("nkc,kc->nk", points[:, None] - start, step) / size**2, 0.0, 1.0)
    gap = np.linalg.norm(points[:, None] - start - part[..., None] * step, axis=2)
    edge = np.argmin(gap, axis=1)
    on = gap[np.arange(len(points)), edge] < TOUCHING * width
    before = np.concatenate([[0.0], np.cumsum(size)[:-1]])
    arc = (before[edge] + part[np.arange(len(points)), edge] * size[edge])[on]
    order = np.argsort(arc)
    return arc[order], cp[field.boundary][on][order]


def draw_surface(paper: Paper, field: FlowField, scene: Scene, airflow: Airflow) -> Axes:
    """Draw Cp of the mean air along the first body, its corners, and the momentum model on the edges that air meets.

    Among several bodies the title names it: the others are not drawn.
    """
    assert scene.air is not None
    mean, outline = as_flown(field.mean(), scene), first_outline(scene)
    arc, cp = pressure_along(mean, outline, pressure_coefficient(mean, scene, airflow))
    edges = np.concatenate([[0.0], np.cumsum(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T))])
    model = momentum_pressure(outline, scene.air.direction)
    axes = new_axes(6.4, 3.6, paper)
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


def _needs(outcome: Outcome) -> bool:
    field, airflow = outcome.field, outcome.airflow
    known = field is not None and field.pressure is not None and airflow is not None and airflow.cd is not None
    if not known or not outcome.scene.body:
        return False
    assert field is not None
    return len(pressure_along(field, first_outline(outcome.scene), np.zeros(len(field.points)))[0]) > 2


def _draw(paper: Paper, outcome: Outcome) -> Axes:
    assert outcome.field is not None
    assert outcome.airflow is not None
    return draw_surface(paper, outcome.field, outcome.scene, outcome.airflow)


figures.add(
    "surface",
    Figure(
        "Pressure along the first body and the paper's momentum model, which knows the front only.",
        _draw,
        _needs,
    ),
)
