"""The command of dividers: bins. What it prints, its figure and its table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...core import own_files
from ...core.errors import SceneError
from ...scene.overrides import share_of
from ...show.screen import print_lines, print_table

if TYPE_CHECKING:
    from ...core.number import Number
    from .dividers import Dividers

HEADS = (
    "purity asked (%)", "purity (%)", "purity low (%)", "purity high (%)", "recovery (%)", "recovery low (%)",
    "recovery high (%)", "from, to along the line (m)",
)  # fmt: skip


def bins(
    run_folder: Path,
    *,
    purity: Annotated[
        str,
        Parameter(help="The wanted fraction and its part of the product: wheat=0.99; wheat alone: every purity."),
    ],
    stretches: int = 1,
    on: str = "floor",
) -> None:
    """Place the dividers that give the most recovery at a purity, from the landings of a finished run; flies nothing.

    Parameters
    ----------
    run_folder
        A folder that ``wakeflow run`` wrote.
    stretches
        Of the line that the product may be made of; two dividers each.
    on
        The line: floor, top, left, right, or a bin of the scene.
    """
    from ...show.canvas import saved
    from .dividers import dividers, purities, trade_off

    fraction, sign, least = purity.partition("=")
    if sign:
        show_dividers([dividers(run_folder, fraction, _portion(purity, least), stretches=stretches, on=on)], on)
        return
    curve = trade_off(run_folder, fraction, purities(run_folder, fraction, on), stretches=stretches, on=on)
    show_dividers(curve, on)
    figure, table = run_folder / "figures" / f"bins-{fraction}-{on}.png", run_folder / f"bins-{fraction}-{on}.csv"
    files = [*saved(figure), table]
    own_files.claim(run_folder, files, table.stem)
    with own_files.writing(run_folder, lambda: files, table.stem):
        draw_dividers(figure, curve)
        write_dividers(table, curve)
    print(f"{figure}\n{table}")


def _portion(option: str, text: str) -> float:
    try:
        return share_of(text)
    except ValueError:
        raise SceneError(f"--purity {option!r}: write it as FRACTION=0.99, or FRACTION for every purity") from None


def show_dividers(curve: Sequence[Dividers], on: str) -> None:
    """Print what dividers give at each purity asked; of a single one also the tables for a scene file."""
    from ...show.words import NO_VALUE, percent
    from .dividers import LEVEL

    first, level = curve[0], on in LEVEL  # places are the machine's own x there
    start, rows = first.line[0, 0] if level else 0.0, []
    for best in curve:
        places = ", ".join(f"{1e3 * (start + low):.1f} to {1e3 * (start + high):.1f}" for low, high in best.stretches)
        numbers = [percent(number) if best.possible else NO_VALUE for number in (best.purity, best.recovery)]
        rows.append([f"{100 * best.asked:.4g}", *numbers, places or "no stretch reaches it"])
    title = f"{first.fraction} on {on}, percent; judged on granules that had no part in the choice; "
    heads = ("purity asked", "purity", "recovery", f"stretches ({'x in mm' if level else 'mm along the line'})")
    print_table(heads, rows, f"{title}interval: of their number", left=0)
    if len(curve) > 1 or not first.possible:
        return
    stretches = enumerate(first.stretches, 1)
    print_lines(f"[bin.{first.fraction}-{number}]\n{_as_bin(first, stretch, on)}" for number, stretch in stretches)
    if (first.purity.high or 1.0) < first.asked:
        wanted = f"the {100 * first.asked:.4g} % asked for: ask for more, or keep more granules to choose by"
        print_lines([f"! judged on other granules the product is less pure than {wanted} with numerics.keep"], "yellow")


def _as_bin(best: Dividers, stretch: tuple[float, float], on: str) -> str:
    """The keys of a bin over a stretch: from and to on the floor, else the points of its line."""
    from .dividers import cut

    points = cut(best.line, *stretch)
    if on == "floor":
        return "\n".join(f'{key} = "{1e3 * x:.5g} mm"' for key, (x, _) in zip(("from", "to"), points, strict=True))
    ends = ", ".join(f'["{1e3 * x:.5g} mm", "{1e3 * y:.5g} mm"]' for x, y in points)
    return f"points = [{ends}]"


def draw_dividers(path: Path, curve: Sequence[Dividers]) -> None:
    """Draw what dividers give at every purity asked: recovery over purity, both on granules that did not choose."""
    import numpy as np

    from ...show.canvas import COLOURS, new_figure, save

    axes = new_figure(5.6, 4.0).add_subplot(xlabel="purity (%)", ylabel=f"recovery of {curve[0].fraction} (%)")
    able = [best for best in curve if best.possible]
    pure, got = (np.array([_percent(getattr(best, side)) for best in able]).T for side in ("purity", "recovery"))
    axes.fill_between(pure[0], got[1], got[2], color=COLOURS[0], alpha=0.18, linewidth=0)
    axes.fill_betweenx(got[0], pure[1], pure[2], color=COLOURS[0], alpha=0.18, linewidth=0)
    axes.plot(pure[0], got[0], "o-", ms=3, color=COLOURS[0])
    save(axes.figure, path)


def write_dividers(path: Path, curve: Sequence[Dividers]) -> None:
    """Write what :func:`draw_dividers` draws as CSV, with the stretches at each purity; empty where none reaches it."""
    from ...core.tables import Cell, CellTable

    rows: list[list[Cell]] = []
    for best in curve:
        numbers = [*_percent(best.purity), *_percent(best.recovery)] if best.possible else [math.nan] * 6
        cells = [None if math.isnan(number) else number for number in numbers]
        rows.append([100 * best.asked, *cells, "; ".join(f"{low:.6g} {high:.6g}" for low, high in best.stretches)])
    CellTable(HEADS, rows).write_csv(path, 6)


def _percent(number: Number) -> tuple[float, ...]:
    """Value and ends in percent, nan where unknown."""
    return tuple(100.0 * part if math.isfinite(part) else math.nan for part in number)
