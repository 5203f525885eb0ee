"""Run a solver once, on one rank or several, and see that it left its times whole.

Every segment is a program of its own and starts from the state that the one before wrote at its end. A run that is
killed and started again repeats the segment it was in from that state, so that it passes the very states of an
undisturbed run, whatever else the machine does meanwhile. ``segments.json`` lists the states that were reached. What a
case holds beyond the last of them (times, histories, parts of ranks) comes from a segment that did not end well: it is
dropped before the next one begins.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

from ...core.files import write_json
from ...core.record import JsonTable
from ...laws.turbulence import USUAL, turbulence_models
from .case import read_parameters, write_parameters
from .programs import AirflowFailure, Cause, call, disk_is_full, gather, scatter
from .read import NUMBER, every_time, time_folders
from .watch import Watch

PHASE = "phase.json"  # in the case: which part of its run is done
DIGITS = 15  # timePrecision in the template


def run_solver(folder: Path, program: str, watch: Watch) -> None:
    """Run a solver from the time and to the end that system/parameters says, on as many ranks; ``watch`` follows it.

    Raises AirflowFailure, also when it ended well but left a time cut short: then the disk was full.
    """
    launcher, options = scatter(folder)
    call(folder, [program, *options], watch, launcher=launcher)
    gather(folder)
    for path in every_time(folder):
        if not holds_a_state(folder, path):
            why = "the disk is full or its quota used up" if disk_is_full(folder) else "the disk was full for a while"
            raise AirflowFailure(
                Cause.DISK_FULL, f"{program} left {path} cut short: {why}; {Cause.DISK_FULL.advice}", command=program
            )
    _name_plainly(folder)


def _name_plainly(folder: Path) -> None:
    """Give time folders the names that a restart looks for: OpenFOAM adds digits where two times nearly coincide."""
    for path in every_time(folder):
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


# -- A solver's run in segments ----------------------------------------------------------------------------------------
LEDGER = "segments.json"  # in the case: {"ends": names of the time folders in which segments ended, "early": settings}
TIME_ROUNDING = 1e-9  # times that differ by less, relative, are the same: OpenFOAM rounds their names


def segment_ends(folder: Path) -> list[float]:
    """The times (s, or iterations) at which segments of the case ended, in order; also those no longer stored."""
    return [float(name) for name in _ledger(folder)["ends"]]


def states(folder: Path) -> list[Path]:
    """The time folders of :func:`segment_ends` that are still there, whole: a run may go on from each."""
    return [
        path
        for path in (folder / name for name in _ledger(folder)["ends"])
        if path.is_dir() and holds_a_state(folder, path)
    ]


def last_state(folder: Path) -> float:
    """Where the next segment begins: the end of the last one, 0 before the first."""
    return max(segment_ends(folder), default=0.0)


def ended_early(folder: Path) -> bool:
    """Whether the last segment ended before the time it was asked for, with the settings that the case has now: a
    steady solver found itself converged.
    """
    early = _ledger(folder)["early"]
    return early is not None and early == read_parameters(folder).get("settings", "")


def drop_after(folder: Path, time: float) -> None:
    """Remove all that a case holds beyond ``time`` (s, or iterations), the end of a segment or 0: time folders, what
    the functions of system/controlDict recorded, the parts of ranks; and older times that are not whole, since their
    removal was interrupted.

    Can be repeated after an interruption.
    """
    known = _ledger(folder)["ends"]
    kept = [name for name in known if not _later(float(name), time)]
    if kept != known:
        write_json(folder / LEDGER, {"ends": kept, "early": None})
    for part in folder.glob("processor[0-9]*"):
        shutil.rmtree(part)
    for path in every_time(folder):
        if _later(float(path.name), time) or not holds_a_state(folder, path):
            shutil.rmtree(path)
    for path in folder.glob("postProcessing/*/*"):  # named by the time at which the program began
        if NUMBER.fullmatch(path.name) and not _later(time, float(path.name)):
            shutil.rmtree(path)


def run_segment(
    folder: Path,
    program: str,
    end: float,
    parameters: Mapping[str, str | float | int],
    watch: Watch,
) -> float:
    """Run ``program`` from the last whole state of the case to ``end`` (s, or iterations), which it writes. Returns
    where it ended: earlier than ``end`` only where a steady solver found itself converged.

    ``parameters``: further ones of system/parameters; ``writeInterval`` (s, or iterations, from the segment's begin;
    ``end`` must be on that beat) for states in between, which stay beside those at the ends until :func:`purge`. A
    segment that fails or is killed leaves no trace in what follows: the next call begins where this one began. Raises
    AirflowFailure; which one depends on the case alone as long as its cause is numerical.
    """
    begin = last_state(folder)
    drop_after(folder, begin)
    if not _later(end, begin):
        return begin
    write_parameters(folder, {
        "startFrom": "latestTime", "endTime": end, "writeControl": "adjustableRunTime", "writeInterval": end - begin,
        "purgeWrite": 0, **parameters,
    })  # fmt: skip
    watch.begin()
    try:
        run_solver(folder, program, watch)
    except AirflowFailure:
        watch.end()  # an impossible drag that came before goes before
        raise
    watch.end()
    stored = time_folders(folder)
    if not stored or not _later(float(stored[-1].name), begin):
        raise AirflowFailure(Cause.STOPPED, f"{program} ended at {begin:g} without a step; log: {folder}/log.{program}")
    reached = float(stored[-1].name)
    early = read_parameters(folder).get("settings", "") if _later(end, reached) else None
    write_json(folder / LEDGER, {"ends": [*_ledger(folder)["ends"], stored[-1].name], "early": early})
    return reached


def purge(folder: Path, kept: int = 0) -> None:
    """Remove all stored times but the last ``kept`` and the last two ends of segments, from which a run can go on (the
    last one may hold the beginning of a failure). Before every decision, so that an interrupted one is finished.
    """
    stored = time_folders(folder)
    spared = {path.name for path in [*stored[max(len(stored) - kept, 0) :], *states(folder)[-2:]]}
    for path in every_time(folder):
        if path.name not in spared:
            shutil.rmtree(path)


def _ledger(folder: Path) -> JsonTable:
    path = folder / LEDGER
    return dict(json.loads(path.read_text())) if path.exists() else {"ends": [], "early": None}


def _later(time: float, than: float) -> bool:
    return time > than + TIME_ROUNDING * abs(than)
