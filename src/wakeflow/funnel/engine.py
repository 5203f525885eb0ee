"""LIGGGHTS, the granular engine: the installed version, its input and output files, one run of it."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import ProgramError
from ..core.files import atomic_write
from ..core.process import capture, run_program, tail

__all__ = [
    "INSTALL",
    "PROGRAM",
    "SCRIPTS",
    "liggghts_version",
    "read_dump",
    "run_script",
    "write_beads",
    "write_settings",
]

Array = NDArray[np.float64]
PROGRAM = "liggghts"
INSTALL = "apt-get install --no-install-recommends liggghts    # or: sh cases/setup.sh funnel"
SCRIPTS = Path(__file__).parent


@cache
def liggghts_version() -> str:
    """Version of the installed LIGGGHTS, "3.8.0". Raises ProgramError when there is none."""
    where = shutil.which(PROGRAM)
    if where is None:
        raise ProgramError(f"LIGGGHTS is needed: {INSTALL}", command=PROGRAM, ended="missing")
    _, text = capture([where, "-log", "none", "-help"])  # ends with code 1 after its help
    found = re.search(r"Version LIGGGHTS-PUBLIC ([\d.]+)", text)
    if found is None:
        raise ProgramError(f"{PROGRAM} does not start; {INSTALL}", command=f"{PROGRAM} -help", tail=text[-500:])
    return found[1]


def write_settings(folder: Path, values: Mapping[str, float | int | str]) -> None:
    """Write the variables of a script, ``settings.liggghts``."""
    with atomic_write(folder / "settings.liggghts") as stream:
        for name, value in values.items():
            text = f"{value:.12g}" if isinstance(value, float) else value
            stream.write(f"variable {name} string {text}\n")


def write_beads(folder: Path, centres: Array, diameters: Array, velocities: Array, density: float, box: Array) -> None:
    """Write ``beads.data``: centres (n, 3) m, diameters (n,) m, velocities (n, 3) m/s, in a ``box`` (3, 2) m."""
    with atomic_write(folder / "beads.data") as stream:
        stream.write(f"beads at rest or poured\n\n{len(centres)} atoms\n2 atom types\n\n")
        for axis, (low, high) in zip("xyz", box, strict=True):
            stream.write(f"{low:.9g} {high:.9g} {axis}lo {axis}hi\n")
        stream.write("\nAtoms\n\n")
        for i, (diameter, (x, y, z)) in enumerate(zip(diameters, centres, strict=True), 1):
            stream.write(f"{i} 1 {diameter:.12g} {density:.12g} {x:.12g} {y:.12g} {z:.12g}\n")
        stream.write("\nVelocities\n\n")
        for i, (u, v, w) in enumerate(velocities, 1):
            stream.write(f"{i} {u:.9g} {v:.9g} {w:.9g} 0 0 0\n")


def run_script(folder: Path, script: Path, on_line: Callable[[str], None] | None = None) -> None:
    """Run ``script`` in ``folder``, beside its settings, beads and walls; log.NAME there holds what it says.

    The scripts are copied, so that the folder can be run again by hand. Raises ProgramError, with LIGGGHTS' own words.
    """
    for file in (script, SCRIPTS / "beads.liggghts"):
        shutil.copyfile(file, folder / file.name)
    name = script.stem
    log = folder / f"log.{name}"
    # line by line: where MPI aborts it the text in its buffer is lost, and that holds the reason
    command = ["stdbuf", "-oL", PROGRAM, "-in", f"{name}.liggghts", "-log", "none", "-echo", "none"]
    try:
        run_program(command, cwd=folder, log=log, on_line=on_line, hint=INSTALL)
    except ProgramError as problem:
        said = re.findall(r"\bERROR\b.*", tail(log, 40))
        if problem.ended == "failed" and said:
            raise ProgramError(
                f"{PROGRAM}: {said[-1]}; log: {log}", command=" ".join(command), log=log, tail=tail(log), ended="failed"
            ) from None
        raise


def read_dump(path: Path) -> list[tuple[int, Array]]:
    """Snapshots of five columns, id first: step and rows (n, 5), sorted by id; an unfinished last one is left out.

    Those of the funnel are id, radius, x, y, z (m).
    """
    lines = path.read_text().splitlines()
    found, at = [], 0
    while at + 9 <= len(lines):
        step, count = int(lines[at + 1]), int(lines[at + 3])
        rows = lines[at + 9 : at + 9 + count]
        if len(rows) < count:
            break
        table = np.array([row.split() for row in rows], dtype=float).reshape(count, 5)
        found.append((step, table[np.argsort(table[:, 0])]))
        at += 9 + count
    return found
