"""What a worker does for a sweep: solve an airflow, or finish one scene in its folder. Other processes know it by name.

Nothing is raised for a scene that fails: the outcome says why, and the sweep goes on.
"""

from __future__ import annotations

import json
import traceback
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..core.errors import ProgramError, WakeflowError
from ..core.files import atomic_write, write_json
from ..pipeline.cache import silent
from ..pipeline.compilation import compile_tracker
from ..planning.plan import Plan
from ..progress import unheard
from ..results.result import FILE, Request, Result
from ..runs import help_along, run_once
from ..scene import Scene

__all__ = ["Job", "JobEnd", "finished", "fly_scene", "help_fly", "solve_airflow_of"]

LOCK = ".job.lock"  # held by the process that works on a folder
STAMP = "point.json"  # written last into a scene's folder: what the numbers beside it were made for
CRASH = "failure.log"  # the traceback of a failure that is nobody's wrong input


@dataclass(frozen=True)
class Job:
    """One scene to compute: plain ``tables``, how it is asked for, its folder, the ``stamp`` of all that it was made
    for, and its ``plan``; on how many ``threads``, by how many processes (``crew``) it is flown; whether a ``report``
    is due.
    """

    tables: Mapping[str, Any]
    request: Request
    folder: Path
    stamp: str
    plan: Plan
    threads: int = 1
    report: bool = False
    crew: int = 1

    @property
    def asked(self) -> Request:
        """The request as it can be met: from rest where the airflow to start from has failed."""
        near = self.request.near
        return replace(self.request, near=near if near is not None and (Path(near) / FILE).exists() else None)


@dataclass(frozen=True)
class JobEnd:
    """How a job ended: an empty ``problem`` where it went well."""

    problem: str = ""


def finished(folder: Path, stamp: str) -> Result | None:
    """The result in a folder, where it was made for the same ``stamp``; None where it was not, or is not there."""
    try:
        noted = json.loads((folder / STAMP).read_text())
    except (FileNotFoundError, NotADirectoryError, json.JSONDecodeError):
        return None
    if noted.get("stamp") != stamp:
        return None
    try:
        return Result.load(folder)
    except WakeflowError:  # removed by hand, or written by another version
        return None


def solve_airflow_of(job: Job) -> JobEnd:
    """Solve the airflow that a scene flies in, the grids beside it and the airflow that it starts from."""
    with _alone(job.folder):
        return _tried(job, until="airflow")


def fly_scene(job: Job) -> JobEnd:
    """Compute a scene to its end; the stamp goes last into its folder, so that a killed job is none that was done."""
    with _alone(job.folder):
        if finished(job.folder, job.stamp) is not None:  # by a worker that was thought lost, or of an earlier sweep
            return JobEnd()
        outcome = _tried(job, until=None)
        if not outcome.problem:
            write_json(job.folder / STAMP, {"stamp": job.stamp})
        return outcome


def help_fly(job: Job) -> JobEnd:
    """Fly part of a scene's granules beside the process that computes it to its end."""
    if finished(job.folder, job.stamp) is None:
        compile_tracker()
        help_along(Scene.parse(job.tables), job.asked, job.plan, workers=job.threads, crew=job.crew)
    return JobEnd()


def _alone(folder: Path) -> AbstractContextManager[object]:
    """Wait until no other process works on a job's folder, as one may that a cluster's scheduler has lost sight of."""
    from filelock import FileLock

    folder.mkdir(parents=True, exist_ok=True)
    return FileLock(folder / LOCK)


def _tried(job: Job, until: str | None) -> JobEnd:
    try:
        (job.folder / STAMP).unlink(missing_ok=True)
        if until is None:
            compile_tracker()
        run_once(
            Scene.parse(job.tables), folder=job.folder, request=replace(job.asked, until=until), workers=job.threads,
            listener=silent, planned=unheard, redraw=False, report=job.report, crew=job.crew, made=job.plan,
        )  # fmt: skip
    except ProgramError as problem:
        _note(job.folder, f"{problem}\n{problem.tail}\n")
        return JobEnd(str(problem))
    except (WakeflowError, OSError) as problem:
        return JobEnd(str(problem))
    except Exception as problem:  # a mistake of the program: the other scenes go on, the traceback is kept and named
        file = _note(job.folder, traceback.format_exc())
        return JobEnd(f"{type(problem).__name__}: {problem} (traceback: {file})")
    (job.folder / CRASH).unlink(missing_ok=True)
    return JobEnd()


def _note(folder: Path, text: str) -> Path:
    with atomic_write(folder / CRASH) as stream:
        stream.write(text)
    return folder / CRASH
