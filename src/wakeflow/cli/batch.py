"""The commands for many scenes and for what runs leave: sweep, compare, bins, clean."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ..core.errors import SceneError
from ..core.quantities import duration
from ..core.store import KeptStage, bytes_of, cache_root, kept_stages, oldest_beyond, remove_stages
from ..scene.overrides import share_of
from .options import (
    ACCURACY,
    Accuracy,
    Axes,
    Processes,
    Quiet,
    Scheduler,
)  # fmt: skip
from .screen import print_table

if TYPE_CHECKING:
    pass

NONE = "–"
MAX_ROWS = 50  # of the cache
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
    from .show_result import show_estimate, show_sweep

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
    from .show_result import show_comparison

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
    from .show_result import show_agreement

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
    from ..show.many_figures import draw_dividers, write_dividers

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


def clean(
    *,
    everything: bool = False,
    keep: Annotated[str | None, Parameter(help="Remove what was used longest ago until this is left: 10GB.")] = None,
    dry_run: bool = False,
    yes: Annotated[bool, Parameter(negative="", help="Do not ask; without a terminal nothing is asked.")] = False,
) -> None:
    """Remove unfinished stages from the cache, and say what the others take on disk and would take to make again.

    Nothing else is ever removed: what has not the cache's mark, no folder of a stage, and what a link leads to stays;
    finished stages stay while a run reads them. What goes is listed before, and on a terminal you are asked.

    Parameters
    ----------
    everything
        Remove finished stages as well.
    dry_run
        Remove nothing; only say what is there, and what would be removed.
    """

    most, root = None if keep is None else bytes_of(keep), cache_root()
    stages = kept_stages(root)
    finished = [one for one in stages if one.finished]
    old = finished if everything else [] if most is None else oldest_beyond(finished, most)
    gone = [one for one in stages if not one.finished] + old
    print(f"cache: {root}")
    if gone:
        show_stages(gone, "to be removed")
        if dry_run or not (yes or _agreed()):
            show_removed(gone, done=False)
            gone = []
        else:
            gone = remove_stages(root, gone)
            show_removed(gone, done=True)
    show_stages([one for one in finished if one not in gone])


def _agreed() -> bool:
    """What the user answers on a terminal; without one nobody is there to be asked."""
    return not sys.stdin.isatty() or input("Remove them? [y/N] ").strip().lower() in ("y", "yes")


def show_removed(stages: Sequence[KeptStage], *, done: bool) -> None:
    """Say in one line what was or would be removed from the cache, and what making it again would take."""
    size, spent = sum(one.size for one in stages) / 1e6, sum(one.seconds or 0.0 for one in stages)
    verb, frees = ("removed", "freed") if done else ("would be removed", "would be freed")
    print(f"{len(stages)} stages {verb}, {size:.1f} MB {frees}, {duration(spent)} to make again")


def show_stages(stages: Sequence[KeptStage], title: str = "in the cache") -> None:
    """Print stages of the cache, the one that was used longest ago first: size, time to make it again."""

    def sums(used: str, what: str, part: Sequence[KeptStage]) -> list[str]:
        size, spent = sum(one.size for one in part), sum(one.seconds or 0.0 for one in part)
        return [used, f"{len(part)} {what}", "", f"{size / 1e6:.1f}", duration(spent)]

    rows: list[list[str]] = []
    for one in stages[:MAX_ROWS]:
        used = datetime.fromtimestamp(one.used, UTC).astimezone().strftime("%Y-%m-%d %H:%M")
        again = NONE if one.seconds is None else duration(one.seconds)
        key = one.folder.name[:12] + ("" if one.finished else " unfinished")
        rows.append([used, one.stage, key, f"{one.size / 1e6:.1f}", again])
    if len(stages) > MAX_ROWS:
        rows.append(sums("later", "more", stages[MAX_ROWS:]))
    heads = ("used", "stage", "key", "MB", "to make again")
    print_table(heads, [*rows, [], sums("all", "stages", stages)], title, left=3)


COMMANDS = (sweep, compare, bins, clean)
