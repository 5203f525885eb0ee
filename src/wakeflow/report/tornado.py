"""The tornado plot: what each input alone does to a number of the answer, the largest first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..results.sensitivity import InputMove
from .canvas import INK, new_figure, save
from .colours import BLUE, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from .canvas import Paper

__all__ = ["draw_tornado"]

MOST = 8  # inputs of a panel
ENDS = {"at_low": (BLUE, "input at its lower end"), "at_high": (VERMILION, "at its upper end")}


def draw_tornado(paper: Paper, panels: Mapping[str, Sequence[InputMove]]) -> NDArray[Any]:
    """Draw a panel for each quantity: how far each input alone moves it at either end of what the input was taken to,
    with the errors of these changes. Parts of a whole are in percentage points.
    """
    shown = {name: list(moves)[:MOST] for name, moves in panels.items()}
    rows = [len(moves) for moves in shown.values()]
    figure = new_figure(6.2, 0.9 + sum(0.25 * count + 0.6 for count in rows), paper)
    grid: NDArray[Any] = figure.subplots(len(shown), 1, squeeze=False, gridspec_kw={"height_ratios": rows})
    for axes, (name, moves) in zip(grid[:, 0], shown.items(), strict=True):
        _panel(axes, name, moves)
    _share_range([axes for axes, moves in zip(grid[:, 0], shown.values(), strict=True) if moves[0].is_part])
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=8, frameon=False)
    save(figure, paper)
    return grid[:, 0]


def _panel(axes: Axes, name: str, moves: Sequence[InputMove]) -> None:
    part = moves[0].is_part
    scale, unit = (100.0, "percentage points") if part else (1.0, moves[0].measure)
    heads = [one.key for one in moves]
    for end, (colour, label) in ENDS.items():
        changes = [scale * (getattr(one, end) or 0.0) for one in moves]
        errors = [scale * (one.error or 0.0) if getattr(one, end) is not None else 0.0 for one in moves]
        axes.barh(heads, changes, color=colour, height=0.62, label=label)
        axes.errorbar(changes, heads, xerr=errors, fmt="none", ecolor=INK, elinewidth=0.8, capsize=2)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_title(f"{_said(name)}, {scale * moves[0].value:.3g} {'%' if part else unit}", fontsize=9, loc="left")
    axes.set_xlabel(f"change, {unit}", fontsize=8)
    axes.invert_yaxis()
    axes.tick_params(labelsize=7.5)
    axes.spines[["top", "right"]].set_visible(False)


def _said(name: str) -> str:
    """A quantity's name as a title: share.dust.middle is dust in middle."""
    kind, *parts = name.split(".")
    return " in ".join(parts) if kind == "share" else name


def _share_range(panels: Sequence[Axes]) -> None:
    """Give panels of one unit the same range, even about zero, so that bars compare between them."""
    reach = max((abs(end) for axes in panels for end in axes.get_xlim()), default=0.0)
    for axes in panels:
        axes.set_xlim(-reach, reach)
