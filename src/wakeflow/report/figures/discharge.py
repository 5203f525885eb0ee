"""The discharge figure: the mass that is left in a feed funnel over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..canvas import INK, new_axes, save
from ..colours import COLOURS
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...funnel.delivered import FunnelSummary
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_discharge"]

MIDDLE = 0.575  # of the mass still inside half-way through the steady stretch, which runs from 10 to 75 % gone


def draw_discharge(paper: Paper, poured: FunnelSummary) -> Axes:
    """Mass left (g) against time since the outlet opened (s), the fitted rate and Beverloo's law."""
    time, mass = (np.asarray(column) for column in (poured.curve.time, poured.curve.mass))
    axes = new_axes(6.4, 4.0, paper)
    axes.plot(time, 1e3 * mass, color=COLOURS[0], linewidth=1.8, label="computed bead by bead")
    end = poured.time_to_empty or float(time[-1])
    half = float(np.interp(-MIDDLE * poured.mass, -mass, time))
    for value, style, name in (
        (poured.rate and poured.rate.value, "-", "its rate"),
        (poured.beverloo, "--", "Beverloo, at rest"),
        (poured.beverloo_cone, ":", "Beverloo with cone factor, at rest"),
    ):
        if value:
            line = 1e3 * (MIDDLE * poured.mass - value * (np.array([0.0, 1.2 * end]) - half))
            label = f"{name}: {1e3 * value:.3g} g/s"
            axes.plot([0.0, 1.2 * end], line, style, color=INK, linewidth=0.9, label=label)
    axes.set_xlim(0.0, 1.15 * end)
    axes.set_ylim(0.0, 1.05e3 * poured.mass)
    axes.set_xlabel("time since the outlet was opened (s)")
    axes.set_ylabel("mass in the funnel (g)")
    shaken = "at rest" if not poured.gamma else f"{poured.frequency:g} Hz, Gamma {poured.gamma:g}"
    axes.set_title(f"{poured.beads} beads, {shaken}", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    save(axes.figure, paper)
    return axes


def _draw(paper: Paper, outcome: Outcome) -> Axes:
    assert outcome.result.funnel is not None
    return draw_discharge(paper, outcome.result.funnel)


figures.add(
    "discharge",
    Figure(
        "The feed funnel: mass left inside over time; dashed: Beverloo's law for a funnel at rest.",
        _draw,
        lambda outcome: outcome.result.funnel is not None,
    ),
)
