"""The standard figure of what to measure next: a tornado for each fraction's least certain share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...results.landing_results import InputPart, LandingResults, least_certain
from ..canvas import new_figure, save
from ..colours import COLOURS
from .figure import Figure, figures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_inputs"]

MOST = 6  # numbers of a panel


def draw_inputs(paper: Paper, landings: LandingResults) -> NDArray[Any]:
    """Draw for each fraction how far each number that is not known exactly moves its least certain share, alone: bars
    to half of the 95 % range on either side, with the error of the bar's end by the finite number of draws.
    """
    panels = least_certain(landings)
    rows = [min(MOST, len(parts)) for _, parts in panels.values()]
    figure = new_figure(5.8, 0.7 + sum(0.24 * count + 0.55 for count in rows), paper)
    grid: NDArray[Any] = figure.subplots(
        len(panels), 1, squeeze=False, gridspec_kw={"height_ratios": rows}, sharex=True
    )
    reach = 0.0
    for axes, (name, (place, parts)) in zip(grid[:, 0], panels.items(), strict=True):
        keys = list(parts)[:MOST]
        halves = [100.0 * parts[key].half for key in keys]
        ends = [_end_error(parts[key]) for key in keys]
        axes.barh(keys, [2.0 * half for half in halves], left=[-half for half in halves], color=COLOURS[0], height=0.6)
        axes.errorbar(halves, keys, xerr=ends, fmt="none", ecolor="#1a1a1a", elinewidth=0.8, capsize=2)
        axes.axvline(0.0, color="#1a1a1a", linewidth=0.8)
        share = landings.separation.fractions[name][place].value
        axes.set_title(f"{name} in {place}, {100.0 * share:.1f} %", fontsize=9)
        axes.invert_yaxis()
        axes.tick_params(labelsize=7.5)
        axes.spines[["top", "right"]].set_visible(False)
        reach = max(reach, *(half + end for half, end in zip(halves, ends, strict=True)))
    grid[-1, 0].set_xlim(-1.05 * reach, 1.05 * reach)
    grid[-1, 0].set_xlabel("what the number alone moves the share by, percentage points", fontsize=8)
    save(figure, paper)
    return grid[:, 0]


def _end_error(part: InputPart) -> float:
    """How far the end of a bar may be off (points): half of the relative error of the variance's part."""
    return 100.0 * part.half * 0.5 * min(1.0, part.error / part.variance) if part.variance > 0.0 else 0.0


def _known(outcome: Outcome) -> bool:
    landings = outcome.result.landings
    return landings is not None and bool(least_certain(landings))


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    assert outcome.result.landings is not None
    return draw_inputs(paper, outcome.result.landings)


figures.add(
    "inputs",
    Figure("What to measure next: what each number that is not known exactly moves a share by.", _draw, _known),
)
