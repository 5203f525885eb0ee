"""The standard figures of the solver: its recorded forces, and the mesh it solved in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..air_pictures import window_round_body
from ..canvas import COLOURS, INK, MM, Window, frame, new_figure, save, solids
from ..outcome import add_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from ...air.kinds.airflow_table import Airflow
    from ...flight.stages.solved_case import ForceHistory, PlaneCells
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import AirAndTracks

DROPPED, KEPT = "#d9dde2", "#f7c873"
SETTLED = 0.25  # of a record without a start-up: what the picture's height does not follow before that
MIN_AXIS_SPAN, MIN_AXIS_PART = 0.01, 0.02  # an axis spans at least so much, or so much of the mean: settled looks it
MARGIN = 0.12  # of the range of what counts, above and below it: a kick at the start may leave the picture


def draw_forces(paper: Paper, history: ForceHistory) -> NDArray[np.object_]:
    """Draw the lift and the drag coefficient over time (iterations of a steady airflow), the start-up that was dropped
    grey, the stretch whose air is kept as a loop marked, and the mean of what is averaged.
    """
    figure = new_figure(6.4, 4.2, paper)
    panels: NDArray[np.object_] = figure.subplots(2, 1, sharex=True)
    first = SETTLED * history.time[-1] if history.start_up is None else history.start_up
    counted = history.time >= first
    for axes, values, colour, name in (
        (panels[0], history.cl, COLOURS[0], "lift coefficient"),
        (panels[1], history.cd, COLOURS[1], "drag coefficient"),
    ):
        axes.plot(history.time, values, color=colour, linewidth=1.0, zorder=3)
        axes.set_ylabel(name)
        axes.grid(axis="y", color="#dddddd", linewidth=0.5)
        _mark(axes, history)
        _limits(axes, values[counted])
        if history.start_up is not None:
            mean = float(np.trapezoid(values[counted], history.time[counted]) / np.ptp(history.time[counted]))
            axes.plot([history.start_up, history.time[-1]], [mean] * 2, "--", color=INK, linewidth=1.0, zorder=4)
    panels[0].set_xlim(history.time[0], history.time[-1])
    panels[1].set_xlabel("time (s)" if history.in_time else "iteration")
    if history.start_up is not None:
        panels[0].plot([], [], "--", color=INK, linewidth=1.0, label="mean of what is averaged")
    if panels[0].get_legend_handles_labels()[1]:
        panels[0].legend(fontsize=7.5, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    clock = "time (s)" if history.in_time else "iteration"
    save(figure, paper, {clock: history.time, "lift coefficient": history.cl, "drag coefficient": history.cd})
    return panels


def _mark(axes: Axes, history: ForceHistory) -> None:
    if history.start_up is not None:
        axes.axvspan(history.time[0], history.start_up, color=DROPPED, zorder=0, label="dropped: start-up")
    if history.loop is not None:
        axes.axvspan(*history.loop, color=KEPT, alpha=0.5, linewidth=0, zorder=1, label="kept as a loop")


def _limits(axes: Axes, values: NDArray[np.float64]) -> None:
    low, high = float(values.min()), float(values.max())
    least = max(MIN_AXIS_SPAN, MIN_AXIS_PART * abs(float(values.mean())))
    room = max(MARGIN * (high - low), 0.5 * (least - (high - low)))
    axes.set_ylim(low - room, high + room)


TALL = 5.2  # inches of the panels
CLOSE_UP_WIDTHS = 0.9  # of the body's width: what the closer panel shows to every side of its middle
EDGE = "#33526b"


def draw_mesh(paper: Paper, cells: PlaneCells, scene: Scene, airflow: Airflow) -> NDArray[np.object_]:
    """Draw the cells in the window of the other pictures of the air, and close to the first body's wall."""
    x, y = scene.outline.mean(axis=0)
    reach = CLOSE_UP_WIDTHS * scene.width
    windows = [window_round_body(scene, airflow), (x - reach, x + reach, y - reach, y + reach)]
    shapes = [(w[1] - w[0]) / (w[3] - w[2]) for w in windows]
    figure = new_figure(TALL * sum(shapes) + 1.6, TALL + 0.7, paper)
    panels: NDArray[np.object_] = figure.subplots(1, 2, gridspec_kw={"width_ratios": shapes})
    for axes, window, line in zip(panels, windows, (0.25, 0.45), strict=True):
        _draw_cells(axes, cells, window, line)
        solids(axes, scene, 1.0)
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


def _cells(outcome: AirAndTracks) -> tuple[object, ...]:
    if outcome.cells is None or outcome.airflow is None or not outcome.scene.body:
        return ()
    return outcome.cells, outcome.scene, outcome.airflow


add_figure(
    "forces", "Lift and drag as the solver recorded them: what was dropped, what is averaged, what is kept.",
    draw_forces, lambda outcome: () if outcome.history is None else (outcome.history,), of_answer=False,
)  # fmt: skip
add_figure(
    "mesh", "The cells that the air was solved in; right: at the body's wall.", draw_mesh, _cells, of_answer=False
)
