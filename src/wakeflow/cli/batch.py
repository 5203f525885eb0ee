"""The commands for many scenes and finished runs: sweep, compare, bins."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ..core.errors import SceneError
from ..scene.overrides import share_of
from .options import (
    ACCURACY,
    Accuracy,
    Axes,
    Processes,
    Quiet,
    Scheduler,
)  # fmt: skip

if TYPE_CHECKING:
    pass

SOME_FAILED = 1  # exit code of a sweep with scenes that failed


def sweep(
    scene: Path,
    *,
    out: Annotated[Path | None, Parameter(help="Folder; default runs/, the file's name and the changed keys.")] = None,
    settings: Axes = (),
    design: Literal["grid", "list", "one-at-a-time", "latin-hypercube", "sobol"] = "grid",
    count: int | None = None,
    seed: int = 0,
    gate: Accuracy = ACCURACY,
    workers: Processes = None,
    scheduler: Scheduler = None,
    neighbours: bool = False,
    report: bool = False,
    dry_run: bool = False,
    quiet: Quiet = False,
) -> int:
    """Compute many scenes, each stage once, into one table: sweep.csv, scenes.csv and figures in one folder.

    The same command goes on where an interrupted one ended. Exit code 1 where scenes failed, or of a dry run cannot be
    planned; the table says why.

    Parameters
    ----------
    scene
        A scene file with --set KEY=VALUES, or a sweep file with a [sweep] table.
    design
        grid: every combination; list: the first values together, then the second; one-at-a-time: the scene as it is,
        then each key alone at its values; latin-hypercube, sobol: drawn.
    count
        How many scenes latin-hypercube and sobol draw.
    seed
        Of what is drawn.
    neighbours
        Solve each steady airflow on from the nearest that is there, instead of from rest.
    report
        Draw the report of every scene too.
    dry_run
        Only say how many scenes there are, what they share, and what they will cost.
    """
    from ..core.process import cores
    from ..many.compute import SweepEstimate, look_ahead
    from ..many.compute import sweep as compute
    from ..many.variant import asked_for
    from ..runs.progress import live
    from .show_many import show_estimate, show_sweep

    how = {**gate.how, "neighbours": neighbours}
    with live(enabled=not quiet) as listener:
        found, name = asked_for(scene, settings, design, count, seed, listener)
        folder = out or Path("runs", name)
        if not dry_run:
            how |= {"scheduler": scheduler, "workers": workers, "report": report}
        made = (look_ahead if dry_run else compute)(found, folder, listener=listener, **how)
    if isinstance(made, SweepEstimate):
        show_estimate(made, workers or cores())
    elif not quiet:
        show_sweep(made)
    return SOME_FAILED if made.failed else 0


def compare(
    run_folders: Annotated[list[Path], Parameter(negative="")],
    /,
    *,
    out: Annotated[Path | None, Parameter(help="Write compare.html, the tables and figures there.")] = None,
) -> None:
    """Set finished runs side by side: what differs in their scenes, their answers, and by how much these differ.

    Parameters
    ----------
    run_folders
        Folders that ``wakeflow run`` or ``wakeflow sweep`` wrote; the first is what the others are compared with. Or
        one folder and a CSV file of measured shares (fraction,bin,share,uncertainty).
    """
    if len(run_folders) == 2 and (run_folders[1].suffix.lower() == ".csv" or run_folders[1].is_file()):
        _beside_trays(run_folders[0], run_folders[1], out)
        return
    from ..many.comparison import compare as side_by_side
    from .show_many import show_comparison

    found = side_by_side(run_folders)
    show_comparison(found)
    if out is not None:
        found.write(out)
        print(f"{out / 'compare.html'}, its tables and figures beside it")


def _beside_trays(run_folder: Path, file: Path, out: Path | None) -> None:
    """Print a finished run beside the measured shares of a CSV file; ``out``: folder for the table and the picture."""
    from ..answer.budget.agreement import agreement_in
    from ..answer.result import Result
    from ..scene.measured import Measured, read_trays
    from .show_many import show_agreement

    found = agreement_in(Result.load(run_folder), Measured.of(read_trays(file)))
    show_agreement(found)
    if out is not None:
        from ..core import sums
        from ..core.files import made_folder
        from ..show.canvas import saved
        from ..show.figures.budget_figures import draw_measured

        table, figure = out / "agreement.csv", out / "measured.png"
        files = [table, *saved(figure)]
        sums.refuse_foreign(made_folder(out), files, "trays")
        with sums.writing(out, lambda: files, "trays"):
            found.cells().write_csv(table)
            draw_measured(figure, found)
        print(f"{table}\n{figure}")


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
    from ..answer.dividers import dividers, purities, trade_off
    from ..core import sums
    from .show_result import show_dividers

    fraction, sign, asked = purity.partition("=")
    if sign:
        show_dividers([dividers(run_folder, fraction, _portion(purity, asked), stretches=stretches, on=on)], on)
        return
    from ..show.canvas import saved
    from ..show.table_figures import draw_dividers, write_dividers

    levels = purities(run_folder, fraction, on)
    curve = trade_off(run_folder, fraction, levels, stretches=stretches, on=on)
    show_dividers(curve, on)
    figure, table = run_folder / "figures" / f"bins-{fraction}-{on}.png", run_folder / f"bins-{fraction}-{on}.csv"
    files = [*saved(figure), table]
    sums.claim(run_folder, files, table.stem)
    with sums.writing(run_folder, lambda: files, table.stem):
        draw_dividers(figure, curve)
        write_dividers(table, curve)
    print(f"{figure}\n{table}")


def _portion(option: str, text: str) -> float:
    try:
        return share_of(text)
    except ValueError:
        raise SceneError(f"--purity {option!r}: write it as FRACTION=0.99, or FRACTION for every purity") from None


COMMANDS = (sweep, compare, bins)
