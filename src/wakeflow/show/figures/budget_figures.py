"""The standard figures of how sure an answer is: beside measured shares, what moves it, what each source costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...answer.budget.agreement import Agreement, agreement_in, measured_in
from ...answer.measurements import InputMove, drawn_moves, grouped, least_sure
from ...answer.shares import SHARE_UNIT
from ...core.number import Number
from ..canvas import BLUE, COLOURS, INK, VERMILION, foremost, new_figure, save
from ..outcome import Outcome, add_figure
from ..words import condensed, source_seconds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    from ...answer.shares import BudgetRow
    from ..canvas import Paper


BEFORE, MEASURED, AFTER = "#4878a8", INK, "#c8622e"
TRAY_ROW = 0.42  # inches a tray
APART = 0.2  # rows between the intervals of one tray
NOTHING = 0.02  # of a share: trays that neither hold more than that of it are not drawn, if others are


def draw_measured(paper: Paper, agreement: Agreement, after: Sequence[Number] = ()) -> Axes:
    """Draw a row a tray: the computed share and the measured one, and where there was a calibration the share
    ``after`` it, each with its 95 % interval.
    """
    shown = [i for i, tray in enumerate(agreement.trays) if max(tray.measured.high, tray.computed.high) > NOTHING]
    shown = shown or list(range(len(agreement.trays)))
    trays = [agreement.trays[i] for i in shown]
    figure = new_figure(6.4, 1.5 + TRAY_ROW * len(trays), paper)
    axes: Axes = figure.add_subplot()
    lines = [("computed", BEFORE, "s", [tray.computed for tray in trays]),
             ("measured", MEASURED, "o", [tray.measured for tray in trays])]  # fmt: skip
    if after:
        lines.append(("computed, after the calibration", AFTER, "D", [after[i] for i in shown]))
    for place, (label, colour, mark, numbers) in enumerate(lines):
        level = np.arange(len(numbers)) + APART * (place - 0.5 * (len(lines) - 1))
        value, low, high = (100.0 * np.array(part) for part in zip(*map(tuple, numbers), strict=True))
        ends = np.array([value - low, high - value])
        axes.errorbar(value, level, xerr=ends, fmt=mark, ms=4, lw=1.6, capsize=2, color=colour, label=label)
    axes.set_yticks(range(len(trays)), [tray.about for tray in trays], fontsize=8)
    axes.set_ylim(len(trays) - 0.5, -0.5)
    axes.set_xlim(-2.0, 102.0)
    axes.set_xlabel("share (%) with its 95 % interval")
    axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    axes.legend(fontsize=7, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    save(figure, paper, _columns(agreement))
    return axes


def _columns(agreement: Agreement) -> dict[str, ArrayLike]:
    table: dict[str, ArrayLike] = {"tray": [tray.about for tray in agreement.trays]}
    for head, cells in agreement.cells().columns().items():
        if head not in ("fraction", "bin"):
            table[head] = cells
    return table


def _beside(outcome: Outcome) -> tuple[object, ...]:
    measured = measured_in(outcome.result)
    return () if measured is None or outcome.result.landings is None else (agreement_in(outcome.result, measured),)


add_figure("measured", "Measured shares and computed ones, each with its 95 % interval.", draw_measured, _beside)


MAX_INPUTS = 8  # inputs of a panel
FAINT, FAINT_INK = "#d5d5d5", "#9a9a9a"  # of a change that is no larger than its error: it may be none
ENDS = {"at_low": (BLUE, "input at its lower end"), "at_high": (VERMILION, "at its upper end")}


def draw_tornado(paper: Paper, panels: Mapping[str, Sequence[InputMove]]) -> NDArray[np.object_]:
    """Draw a panel for each quantity: how far each input alone moves it at either end of what the input was taken to,
    with the errors of these changes, grey where the error is as large. Parts of a whole are in percentage points.
    """
    from matplotlib.patches import Patch

    shown = {name: list(moves)[:MAX_INPUTS] for name, moves in panels.items()}
    rows = [len(moves) for moves in shown.values()]
    figure = new_figure(6.2, 0.9 + sum(0.25 * count + 0.6 for count in rows), paper)
    grid: NDArray[np.object_] = figure.subplots(len(shown), 1, squeeze=False, gridspec_kw={"height_ratios": rows})
    for axes, (name, moves) in zip(grid[:, 0], shown.items(), strict=True):
        _panel(axes, name, moves)
    _share_range([axes for axes, moves in zip(grid[:, 0], shown.values(), strict=True) if moves[0].is_part])
    handles = [Patch(color=colour, label=label) for colour, label in ENDS.values()]
    figure.legend(handles=handles, loc="outside upper center", ncols=2, fontsize=8, frameon=False)
    save(figure, paper)
    return grid[:, 0]


def _panel(axes: Axes, name: str, moves: Sequence[InputMove]) -> None:
    part = moves[0].is_part
    scale, unit = (100.0, "percentage points") if part else (1.0, moves[0].measure)
    heads = [move.key for move in moves]
    for end, (colour, _) in ENDS.items():
        changes = [scale * (getattr(move, end) or 0.0) for move in moves]
        errors = [scale * (move.error or 0.0) if getattr(move, end) is not None else 0.0 for move in moves]
        shades = [FAINT if error >= abs(change) else colour for change, error in zip(changes, errors, strict=True)]
        axes.barh(heads, changes, color=shades, height=0.62)
        for head, change, error, shade in zip(heads, changes, errors, shades, strict=True):
            ink = FAINT_INK if shade == FAINT else INK
            axes.errorbar(change, head, xerr=error, fmt="none", ecolor=ink, elinewidth=0.8, capsize=2)
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


ROW = 0.27  # inches
MIN_ERROR = 1e-5  # of a share: an error that is zero in every bin is no bar


def draw_cost(paper: Paper, budget: Sequence[BudgetRow]) -> NDArray[np.object_]:
    """Draw a row a source of error, the largest on top: its largest part in any share, a mark for the median over the
    shares, and beside it the run time (s) that knowing it took.
    """
    errors, spent = _errors(budget), source_seconds(condensed(budget))
    names = sorted(errors, key=lambda name: errors[name].max())
    largest = [100.0 * errors[name].max() for name in names]
    typical = [100.0 * float(np.median(errors[name])) for name in names]
    seconds = [spent[name] for name in names]
    figure = new_figure(6.8, 0.9 + ROW * len(names), paper)
    panels: NDArray[np.object_] = figure.subplots(1, 2, sharey=True)
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
    errors: dict[str, list[float]] = {}
    for row in condensed(budget):
        if row.measure == SHARE_UNIT:
            for part in row.parts:
                if part.error is not None:
                    errors.setdefault(part.source, []).append(part.error)
    return {name: np.array(values) for name, values in errors.items() if max(values) > MIN_ERROR}


def _moves(outcome: Outcome) -> tuple[object, ...]:
    moves = grouped(drawn_moves(outcome.result.landings))
    panels = {name.split(".")[1]: name for name in least_sure(moves)}
    names = [panels[fraction] for fraction in foremost(outcome.scene, list(panels))]
    return ({name: moves[name] for name in names},) if moves else ()


def _budget(outcome: Outcome) -> tuple[object, ...]:
    budget = outcome.result.budget
    return (budget,) if len(_errors(budget)) > 1 else ()


add_figure(
    "inputs", "What to measure next: what each number that is not known exactly moves a share by.",
    draw_tornado, _moves,
)  # fmt: skip
add_figure(
    "cost", "What each source adds to the error of a share, and the run time that knowing it took.",
    draw_cost, _budget,
)  # fmt: skip
