"""The wakes figure: every share in each wake that the granules flew in, and the answer's interval."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..canvas import INK, bins_across, new_figure, save
from ..colours import fraction_colours
from .figure import Figure, figures

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ...results.landing_results import LandingResults
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_wakes"]

MARKERS = "<>^vsDPX*"
LEAST = 1e-3  # a share that is smaller in every wake is not drawn
ROW = 0.3  # inches


def draw_wakes(paper: Paper, scene: Scene, landings: LandingResults) -> NDArray[Any]:
    """Draw a panel a fraction and a row a bin: a mark a wake, and the answer with its 95 % interval as a bar."""
    rows = _rows(scene, landings)
    panels = list(dict.fromkeys(name for name, _ in rows))
    wakes = list(dict.fromkeys(wake for _, _, wake in _marks(landings)))
    counts = [sum(name == one for one, _ in rows) for name in panels]
    figure = new_figure(6.4, 1.1 + ROW * sum(counts) + 0.45 * len(panels), paper)
    grid: NDArray[Any] = figure.subplots(
        len(panels), 1, squeeze=False, sharex=True, gridspec_kw={"height_ratios": counts}
    )[:, 0]
    colours = fraction_colours(list(scene.fraction))
    assert landings.bracket is not None
    for axes, name in zip(grid, panels, strict=True):
        places = [place for one, place in rows if one == name]
        for level, place in enumerate(places):
            share = landings.separation.fractions[name][place]
            ends = [100 * (share.high - share.low)], [100 * share.low]
            axes.barh([level], ends[0], left=ends[1], height=0.55, color=colours[name], alpha=0.35)
            axes.plot([100 * share.value] * 2, [level - 0.28, level + 0.28], color=colours[name], linewidth=2.5)
            for marker, wake in zip(MARKERS, wakes, strict=False):
                found = landings.bracket[name][place].get(wake)
                if found is not None:
                    axes.plot([100 * found], [level], marker, ms=5, mfc="white", mec=INK, mew=0.9)
        axes.set_yticks(range(len(places)), places, fontsize=8)
        axes.set_ylim(len(places) - 0.5, -0.5)
        axes.set_title(name, fontsize=9, loc="left")
        axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    for marker, wake in zip(MARKERS, wakes, strict=False):
        grid[0].plot([], [], marker, ms=5, mfc="white", mec=INK, linestyle="none", label=wake)
    grid[0].legend(fontsize=7, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    grid[-1].set_xlim(-1.0, 101.0)
    grid[-1].set_xlabel("share of the fraction's mass (%)")
    save(figure, paper, _columns(landings))
    return grid


def _marks(landings: LandingResults) -> list[tuple[str, str, str]]:
    """Fraction, bin and wake of every share that was flown in another wake."""
    bracket = landings.bracket or {}
    return [
        (name, place, wake) for name, places in bracket.items() for place, found in places.items() for wake in found
    ]


def _rows(scene: Scene, landings: LandingResults) -> list[tuple[str, str]]:
    """Fractions and bins that some of the fraction lands in, bins from left to right."""
    bracket = landings.bracket or {}
    bins = [*bins_across(scene), "elsewhere"]
    return [
        (name, place)
        for name, places in bracket.items()
        for place in bins
        if max([*places.get(place, {}).values(), landings.separation.fractions[name][place].value]) > LEAST
    ]


def _columns(landings: LandingResults) -> dict[str, ArrayLike]:
    marks, bracket = _marks(landings), landings.bracket or {}
    heads = ("fraction", "bin", "wake")
    found: dict[str, ArrayLike] = {head: [mark[i] for mark in marks] for i, head in enumerate(heads)}
    found["share (%)"] = 100.0 * np.array([bracket[name][place][wake] for name, place, wake in marks])
    return found


def _known(outcome: Outcome) -> bool:
    landings = outcome.result.landings
    return landings is not None and bool(landings.bracket)


def _draw(paper: Paper, outcome: Outcome) -> NDArray[Any]:
    assert outcome.result.landings is not None
    return draw_wakes(paper, outcome.scene, outcome.result.landings)


figures.add(
    "wakes",
    Figure(
        "The same granules, each alone, in each wake (marks), and the answer with its 95 % interval (bars).",
        _draw,
        _known,
    ),
)
