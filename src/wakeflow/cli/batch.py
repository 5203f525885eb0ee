"""The commands for many scenes and for what runs leave: sweep, compare, clean."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ..core.quantities import duration
from ..core.store import KeptStage, bytes_of, cache_root, kept_stages, oldest_beyond, remove_stages
from ..show.screen import counted, print_lines, print_table
from .options import ACCURACY, Accuracy, Axes, Processes, Quiet, Scheduler

if TYPE_CHECKING:
    from ..many.compute import SweepEstimate

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
    from ..many.variant import read_scenes
    from ..runs.progress import live
    from ..show.terminal import show_sweep

    how = {**gate.how, "neighbours": neighbours}
    with live(enabled=not quiet) as listener:
        scenes, name = read_scenes(scene, settings, design, count, seed, listener)
        folder = out or Path("runs", name)
        if not dry_run:
            how |= {"scheduler": scheduler, "workers": workers, "report": report}
        made = (look_ahead if dry_run else compute)(scenes, folder, listener=listener, **how)
    if isinstance(made, SweepEstimate):
        print_lines(_estimate_lines(made, workers or cores()))
    elif not quiet:
        show_sweep(made.table, made.folder)
    return SOME_FAILED if made.failed else 0


def _estimate_lines(estimate: SweepEstimate, workers: int) -> list[str]:
    """How many scenes there are, what they share, and the cost."""
    before = f", {estimate.finished} finished before" if estimate.finished else ""
    spent, alone = duration(estimate.seconds / workers), duration(estimate.seconds)
    return [
        f"{counted(estimate.scenes, 'scene')}{before}: {counted(estimate.airflows, 'airflow')} and "
        f"{counted(estimate.flights, 'flight')} to compute",
        f"about {spent} on {counted(workers, 'core')} ({alone} of one), {estimate.disk / 1e6:.0f} MB of disk",
        *(f"! {name}: {reason}" for name, reason in estimate.failed.items()),
    ]


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
    from ..many.comparison import beside_trays, write_agreement
    from ..many.comparison import compare as side_by_side
    from ..show.terminal import show_agreement, show_comparison

    if len(run_folders) == 2 and (run_folders[1].suffix.lower() == ".csv" or run_folders[1].is_file()):
        agreement = beside_trays(*run_folders)
        show_agreement(agreement)
        if out is not None:
            print(*write_agreement(agreement, out), sep="\n")
        return
    runs = side_by_side(run_folders)
    show_comparison(runs.table, [run.key for run in runs.runs], runs.by_quantity)
    if out is not None:
        runs.write(out)
        print(f"{out / 'compare.html'}, its tables and figures beside it")


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
    finished = [stage for stage in stages if stage.finished]
    old = finished if everything else [] if most is None else oldest_beyond(finished, most)
    gone = [stage for stage in stages if not stage.finished] + old
    print(f"cache: {root}")
    if gone:
        show_stages(gone, "to be removed")
        if dry_run or not (yes or _agreed()):
            show_removed(gone, done=False)
            gone = []
        else:
            gone = remove_stages(root, gone)
            show_removed(gone, done=True)
    show_stages([stage for stage in finished if stage not in gone])


def _agreed() -> bool:
    """What the user answers on a terminal; without one nobody is there to be asked."""
    return not sys.stdin.isatty() or input("Remove them? [y/N] ").strip().lower() in ("y", "yes")


def show_removed(stages: Sequence[KeptStage], *, done: bool) -> None:
    """Say in one line what was or would be removed from the cache, and what making it again would take."""
    size, spent = sum(stage.size for stage in stages) / 1e6, sum(stage.seconds or 0.0 for stage in stages)
    verb, frees = ("removed", "freed") if done else ("would be removed", "would be freed")
    print(f"{len(stages)} stages {verb}, {size:.1f} MB {frees}, {duration(spent)} to make again")


def show_stages(stages: Sequence[KeptStage], title: str = "in the cache") -> None:
    """Print stages of the cache, the one that was used longest ago first: size, time to make it again."""

    def sums(used: str, what: str, part: Sequence[KeptStage]) -> list[str]:
        size, spent = sum(stage.size for stage in part), sum(stage.seconds or 0.0 for stage in part)
        return [used, f"{len(part)} {what}", "", f"{size / 1e6:.1f}", duration(spent)]

    rows: list[list[str]] = []
    for stage in stages[:MAX_ROWS]:
        used = datetime.fromtimestamp(stage.used, UTC).astimezone().strftime("%Y-%m-%d %H:%M")
        again = NONE if stage.seconds is None else duration(stage.seconds)
        key = stage.folder.name[:12] + ("" if stage.finished else " unfinished")
        rows.append([used, stage.stage, key, f"{stage.size / 1e6:.1f}", again])
    if len(stages) > MAX_ROWS:
        rows.append(sums("later", "more", stages[MAX_ROWS:]))
    heads = ("used", "stage", "key", "MB", "to make again")
    print_table(heads, [*rows, [], sums("all", "stages", stages)], title, left=3)


COMMANDS = (sweep, compare, clean)
