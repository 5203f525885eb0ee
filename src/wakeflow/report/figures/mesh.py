"""The mesh figure: the cells that the airflow was solved in, all of them and those round the first body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..air import window_round_body
from ..canvas import BODY, INK, MM, Window, first_outline, frame, new_figure, save
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from ...results.airflow_summary import Airflow
    from ...results.solved_case import PlaneCells
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_mesh"]

TALL = 5.2  # inches of the panels
NEAR = 0.9  # of the body's width: what the closer panel shows to every side of its middle
EDGE = "#33526b"


def draw_mesh(paper: Paper, cells: PlaneCells, scene: Scene, airflow: Airflow) -> NDArray[Any]:
    """Draw the cells in the window of the other pictures of the air, and close to the first body's wall."""
    x, y = first_outline(scene).mean(axis=0)
    reach = NEAR * scene.width
    windows = [window_round_body(scene, airflow), (x - reach, x + reach, y - reach, y + reach)]
    shapes = [(w[1] - w[0]) / (w[3] - w[2]) for w in windows]
    figure = new_figure(TALL * sum(shapes) + 1.6, TALL + 0.7, paper)
    panels: NDArray[Any] = figure.subplots(1, 2, gridspec_kw={"width_ratios": shapes})
    for axes, window, line in zip(panels, windows, (0.25, 0.45), strict=True):
        _draw_cells(axes, cells, window, line)
        for body in scene.body.values():
            axes.fill(*(MM * body.outline()).T, facecolor=BODY, edgecolor=INK, linewidth=0.9, zorder=1)
        axes.set_aspect("equal")
        frame(axes, window)
    panels[0].set_title(f"{len(cells.cells)} cells, those beyond the channel's ends counted", fontsize=9, loc="left")
    panels[1].set_title("at the body", fontsize=9, loc="left")
    panels[1].set_ylabel("")
    size = [len(cell) for cell in cells.cells]
    ends = {"cell ends": np.cumsum(size), "cell corners": np.concatenate([np.asarray(cell) for cell in cells.cells])}
    save(figure, paper, {"x (m)": cells.points[:, 0], "y (m)": cells.points[:, 1], **ends})
    return panels


def _draw_cells(axes: Axes, cells: PlaneCells, window: Window, line: float) -> None:
    from matplotlib.collections import PolyCollection

    corners = [MM * cells.points[cell] for cell in cells.cells]
    left, right, low, high = (MM * end for end in window)
    shown = [c for c in corners if left < c[:, 0].max() and c[:, 0].min() < right
             and low < c[:, 1].max() and c[:, 1].min() < high]  # fmt: skip
    drawn = PolyCollection(shown, facecolors="none", edgecolors=EDGE, linewidths=line)
    drawn.set_rasterized(len(shown) > 2000)
    axes.add_collection(drawn)


def _needs(outcome: Outcome) -> bool:
    return outcome.cells is not None and outcome.airflow is not None and bool(outcome.scene.body)


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    assert outcome.cells is not None
    assert outcome.airflow is not None
    return draw_mesh(paper, outcome.cells, outcome.scene, outcome.airflow)


figures.add("mesh", Figure("The cells that the air was solved in; right: at the body's wall.", _draw, _needs))
