"""The command of the search: search."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ...cli.options import Processes, Quiet, Scheduler
from ...scene.overrides import changes_of

Held = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set", negative="", help="Hold a key in all designs at all levels: air.speed='5 m/s'. Repeatable."
    ),
]


def search(
    file: Path,
    *,
    budget: Annotated[str | None, Parameter(help="Time of one core instead of the file's: '20 min'.")] = None,
    settings: Held = (),
    out: Annotated[Path | None, Parameter(help="Folder; default runs/, the file's name and what is held.")] = None,
    workers: Processes = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Find the best design of a scene: goals, limits and bounds in a file, coarse rungs first, within a budget.

    Prints the designs that no other beats in all goals, the recommended one first, and what to measure to be surer. The
    same command goes on where an interrupted one ended.

    Parameters
    ----------
    file
        A TOML file with a [search] table (docs/extras.md).
    """
    from ...runs.progress import live
    from ...scene.changes import run_folder
    from .designs import search as find
    from .show_search import show_search
    from .task import read_search_file

    held = changes_of(settings)
    task = read_search_file(file, held, budget)
    folder = out or Path("runs", run_folder(file.stem, task.scene, held, {}))
    with live(enabled=not quiet) as listener:
        found = find(task, folder, scheduler=scheduler, workers=workers, listener=listener)
    if not quiet:
        show_search(found)
