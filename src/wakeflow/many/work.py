"""What a worker does for a sweep: solve an airflow, or finish one scene in its folder. Other processes know it by name.

Nothing is raised for a scene that fails: what is returned says why, nothing where it went well, and the sweep goes on.
"""

from __future__ import annotations

import traceback
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

from ..answer.result import FILE, Request, Result, key_in
from ..core import sums
from ..core.errors import ProgramError, SceneError, WakeflowError
from ..core.files import atomic_write, read_json, write_json
from ..core.record import JsonMapping
from ..planning.plan import Plan
from ..runs import compile_tracker, run_once
from ..scene import Scene

LOCK = ".job.lock"  # held by the process that works on a folder
STAMP = ".point.json"  # written last into a scene's folder: what the numbers beside it were made for
CRASH = "failure.log"  # the traceback of a failure that is nobody's wrong input


@dataclass(frozen=True)
class Job:
    """One scene to compute: plain ``tables``, how it is asked for, its folder, the ``stamp`` of all that it was made
    for, and its ``plan``; on how many ``threads`` it is flown; whether a ``report`` is due.
    """

    tables: JsonMapping
    request: Request
    folder: Path
    stamp: str
    plan: Plan
    threads: int = 1
    report: bool = False

    @property
    def asked(self) -> Request:
        """The request as it can be met: from rest where the airflow to start from has failed."""
        near = self.request.near
        return replace(self.request, near=near if near is not None and (Path(near) / FILE).exists() else None)


def finished(folder: Path, stamp: str) -> Result | None:
    """The result in a folder, where it was made for the same ``stamp``; None where it was not, where another run has
    replaced it, or where none is there.
    """
    try:
        noted = read_json(folder / STAMP)
    except (FileNotFoundError, NotADirectoryError, SceneError):
        return None
    if not isinstance(noted, dict) or noted.get("stamp") != stamp:
        return None
    try:
        found = Result.load(folder)
    except WakeflowError:  # removed by hand, or written by another version
        return None
    return found if noted.get("key") == found.key else None


def solve_airflow_of(job: Job) -> str:
    """Solve the airflow that a scene flies in, the grids beside it and the airflow that it starts from."""
    with _alone(job.folder):
        return _tried(job, until="airflow")


def fly_scene(job: Job) -> str:
    """Compute a scene to its end; the stamp goes last into its folder, so that a killed job is none that was done."""
    with _alone(job.folder):
        if finished(job.folder, job.stamp) is not None:  # by a worker that was thought lost, or of an earlier sweep
            return ""
        problem = _tried(job, until=None)
        if not problem:
            write_json(job.folder / STAMP, {"stamp": job.stamp, "key": key_in(job.folder)})
        return problem


def _alone(folder: Path) -> AbstractContextManager[object]:
    """Wait until no other process works on a job's folder, as one may that a cluster's scheduler has lost sight of."""
    from filelock import FileLock

    folder.mkdir(parents=True, exist_ok=True)
    return FileLock(folder / LOCK)


def _tried(job: Job, until: str | None) -> str:
    try:
        sums.refuse_foreign(job.folder, [job.folder / CRASH], CRASH)
        (job.folder / STAMP).unlink(missing_ok=True)
        if until is None:
            compile_tracker()
        run_once(
            Scene.parse(job.tables), job.folder, replace(job.asked, until=until), workers=job.threads,
            report=job.report, made=job.plan,
        )  # fmt: skip
    except ProgramError as problem:
        _note(job.folder, f"{problem}\n{problem.tail}\n")
        return str(problem)
    except (WakeflowError, OSError) as problem:
        return str(problem)
    except Exception as problem:  # a mistake of the program: the other scenes go on, the traceback is kept and named
        file = _note(job.folder, traceback.format_exc())
        return f"{type(problem).__name__}: {problem} (traceback: {file})"
    (job.folder / CRASH).unlink(missing_ok=True)
    return ""


def _note(folder: Path, text: str) -> Path:
    with sums.writing(folder, lambda: [folder / CRASH], CRASH), atomic_write(folder / CRASH) as stream:
        stream.write(text)
    return folder / CRASH
