"""Run a solver once, on one rank or several, and see that it left its times whole."""

from __future__ import annotations

import re
from pathlib import Path

from ..laws.turbulence_models import USUAL, turbulence_models
from .case import read_parameters
from .failure import AirflowFailure, Cause, disk_is_full
from .parallel import gather, scatter
from .programs import call
from .watch import Watch

__all__ = ["PHASE", "holds_a_state", "run_solver"]

PHASE = "phase.json"  # in the case: which part of its run is done
DIGITS = 15  # timePrecision in the template


def run_solver(folder: Path, program: str, watch: Watch, timeout: float | None) -> None:
    """Run a solver from the time and to the end that system/parameters says, on as many ranks; ``watch`` follows it.

    Raises AirflowFailure, also when it ended well but left a time cut short: then the disk was full.
    """
    launcher, options = scatter(folder)
    call(folder, [program, *options], watch, launcher=launcher, timeout=timeout)
    gather(folder)
    for path in _times(folder):
        if not holds_a_state(folder, path):
            why = "the disk is full or its quota used up" if disk_is_full(folder) else "the disk was full for a while"
            raise AirflowFailure(
                Cause.DISK_FULL, f"{program} left {path} cut short: {why}; {Cause.DISK_FULL.advice}", command=program
            )
    _name_plainly(folder)


def _times(folder: Path) -> list[Path]:
    """Time folders, whole or not; 0 is left out."""
    return [p for p in folder.iterdir() if re.fullmatch(r"[0-9.e+-]*[1-9][0-9.e+-]*", p.name) and p.is_dir()]


def _name_plainly(folder: Path) -> None:
    """Give time folders the names that a restart looks for: OpenFOAM adds digits where two times nearly coincide."""
    for path in _times(folder):
        plain = path.with_name(f"{float(path.name):.{DIGITS}g}")
        if not plain.exists():
            path.rename(plain)


def holds_a_state(folder: Path, path: Path) -> bool:
    """Whether the time folder ``path`` of the case ``folder`` holds all that a run needs, each file to its end."""
    parameters = read_parameters(folder)
    name = parameters.get("turbulence", USUAL)
    model = turbulence_models[name if name in turbulence_models else USUAL]
    needed = {"U", "p", "phi", *(field.name for field in model.fields)}
    files = [member for member in path.iterdir() if member.is_file()]
    if parameters.get("bodyWall") == "movingWallVelocity":  # the mesh goes on from where it stands
        files.append(path / "polyMesh" / "points")
    ended = all(member.is_file() and _ends_well(member) for member in files)
    return ended and needed <= {member.name for member in files} and (path / "uniform" / "time").exists()


def _ends_well(file: Path) -> bool:
    """Whether OpenFOAM came to the closing comment of a file."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 100))
        return stream.read().rstrip().endswith(b"* //")
