"""MPI: a large case is cut into strips along the air, one a rank; afterwards it is one case again."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from .case import read_parameters
from .programs import call

__all__ = ["gather", "scatter"]


def scatter(folder: Path) -> tuple[list[str], list[str]]:
    """Cut the case's latest time into as many parts as its parameters ask ranks for.

    Returns the launcher's words and the solver's options; both empty for one rank.
    """
    ranks = _ranks(folder)
    if ranks == 1:
        return [], []
    call(folder, ["decomposePar", "-force", "-latestTime"])
    # Not bound to cores (two runs side by side would share one), idle ranks yield; in a container one is often root
    how = "--allow-run-as-root --oversubscribe --bind-to none --mca mpi_yield_when_idle 1"
    return ["mpirun", "-np", str(ranks), *how.split()], ["-parallel"]


def gather(folder: Path) -> None:
    """Put the times that all ranks wrote together again and remove the parts; nothing without parts."""
    parts = sorted(folder.glob("processor[0-9]*"))
    if not parts:
        return
    written = [{path.name for path in part.iterdir() if _is_time(path.name)} for part in parts]
    new = set.intersection(*written) - {path.name for path in folder.iterdir()}
    if new:
        call(folder, ["reconstructPar", "-time", ",".join(sorted(new, key=float))])
    for part in parts:
        shutil.rmtree(part)


def _is_time(name: str) -> bool:
    return re.fullmatch(r"[0-9.e+-]*[1-9][0-9.e+-]*", name) is not None


def _ranks(folder: Path) -> int:
    return int(read_parameters(folder).get("ranks", 1))
