"""The cost figure: how large each source of error is, and the run time that knowing it took."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...results.landing_results import SHARE_UNIT
from ..canvas import INK, new_figure, save
from ..colours import COLOURS
from ..words import condensed, source_seconds
from .figure import Figure, figures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ...results.landing_results import BudgetRow
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_cost"]

ROW = 0.27  # inches
LEAST = 1e-5  # of a share: an error that is zero in every bin is no bar


def draw_cost(paper: Paper, budget: Sequence[BudgetRow]) -> NDArray[Any]:
    """Draw a row a source of error, the largest on top: its largest part in any share, a mark for the median over the
    shares, and beside it the run time (s) that knowing it took.
    """
    errors, spent = _errors(budget), source_seconds(condensed(budget))
    names = sorted(errors, key=lambda name: errors[name].max())
    largest = [100.0 * errors[name].max() for name in names]
    typical = [100.0 * float(np.median(errors[name])) for name in names]
    seconds = [spent[name] for name in names]
    figure = new_figure(6.8, 0.9 + ROW * len(names), paper)
    panels: NDArray[Any] = figure.subplots(1, 2, sharey=True)
    left, right = panels
    left.barh(names, largest, color=COLOURS[0], height=0.62, label="in the share that it moves most")
    left.plot(typical, names, "|", ms=9, mew=1.8, color=INK, label="median over the shares")
    left.set_xlabel("error of a share, percentage points")
    left.legend(fontsize=7.5, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    right.barh(names, seconds, color=COLOURS[4], height=0.62)
    for level, value in enumerate(seconds):
        right.annotate(f"{value:.3g} s" if value else "nothing", (value, level), xytext=(3, 0), fontsize=7,
                       textcoords="offset points", va="center")  # fmt: skip
    right.set_xlim(0.0, 1.22 * max([*seconds, 1.0]))
    right.set_xlabel("run time that knowing it took (s)")
    for axes in (left, right):
        axes.grid(axis="x", color="#dddddd", linewidth=0.5)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    heads = ("largest error of a share (points)", "median error of a share (points)", "run time (s)")
    columns = dict(zip(heads, (largest[::-1], typical[::-1], seconds[::-1]), strict=True))
    save(figure, paper, {"source": names[::-1], **columns})
    return panels


def _errors(budget: Sequence[BudgetRow]) -> dict[str, np.ndarray]:
    """The errors of all shares by source, those that are zero in every one left out."""
    found: dict[str, list[float]] = {}
    for row in condensed(budget):
        if row.measure == SHARE_UNIT:
            for part in row.parts:
                if part.error is not None:
                    found.setdefault(part.source, []).append(part.error)
    return {name: np.array(values) for name, values in found.items() if max(values) > LEAST}


def _budget(outcome: Outcome) -> Sequence[BudgetRow]:
    landings = outcome.result.landings
    return () if landings is None else landings.budget


figures.add(
    "cost",
    Figure(
        "What each source adds to the error of a share, and the run time that knowing it took.",
        lambda paper, outcome: draw_cost(paper, _budget(outcome)),
        lambda outcome: len(_errors(_budget(outcome))) > 1,
    ),
)
