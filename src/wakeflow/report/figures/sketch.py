"""The sketch of the machine: what was asked, to scale, with its measures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..canvas import save
from ..sketch import draw_sketch
from .figure import Figure, figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..canvas import Paper
    from ..outcome import Outcome


def _draw(paper: Paper, outcome: Outcome) -> Axes:
    figure = draw_sketch(outcome.scene, paper=paper)
    save(figure, paper)
    return figure.axes[0]


figures.add("sketch", Figure("The machine to scale, with its measures.", _draw, always=True))
