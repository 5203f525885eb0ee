"""The forces figure: lift and drag as the solver recorded them, what was dropped of them and what was averaged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..canvas import INK, new_figure, save
from ..colours import COLOURS
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from ...results.solved_case import ForceHistory
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_forces"]

DROPPED, KEPT = "#d9dde2", "#f7c873"
SETTLED = 0.25  # of a record without a start-up: what the picture's height does not follow before that
LEAST, LEAST_PART = 0.01, 0.02  # an axis spans at least that much, or that part of the mean: what settled looks it
ROOM = 0.12  # of the range of what counts, above and below it: a kick at the start may leave the picture


def draw_forces(paper: Paper, history: ForceHistory) -> NDArray[Any]:
    """Draw the lift and the drag coefficient over time (iterations of a steady airflow), the start-up that was dropped
    grey, the stretch whose air is kept as a loop marked, and the mean of what is averaged.
    """
    figure = new_figure(6.4, 4.2, paper)
    panels: NDArray[Any] = figure.subplots(2, 1, sharex=True)
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
    least = max(LEAST, LEAST_PART * abs(float(values.mean())))
    room = max(ROOM * (high - low), 0.5 * (least - (high - low)))
    axes.set_ylim(low - room, high + room)


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    assert outcome.history is not None
    return draw_forces(paper, outcome.history)


figures.add(
    "forces",
    Figure(
        "Lift and drag as the solver recorded them: what was dropped, what is averaged, what is kept.",
        _draw,
        lambda outcome: outcome.history is not None,
    ),
)
