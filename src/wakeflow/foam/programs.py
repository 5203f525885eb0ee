"""Start one OpenFOAM program in a case; its failure becomes one line with a cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..core.errors import FoamError
from ..core.process import Finished, run_program, tail
from .case import INSTALL, environment
from .failure import AirflowFailure, Cause, diagnose, disk_is_full

__all__ = ["SOLVERS", "call"]

SOLVERS = ("simpleFoam", "pimpleFoam")  # only what these compute can be cured by safer settings
SILENCE = 900.0  # s without a line in the log: no iteration of a two-dimensional case takes that long
SUSPICION = 2.0  # s without a line after which the disk is looked at: a full one swallows the log too


def call(
    folder: Path,
    command: Sequence[str],
    on_line: Callable[[str], None] | None = None,
    *,
    launcher: Sequence[str] = (),
    timeout: float | None = None,
) -> Finished:
    """Run ``command`` in the case ``folder``, its output appended to log.PROGRAM there.

    ``launcher``: words before the command (mpirun). Raises AirflowFailure; what ``on_line`` raises goes through.
    """
    program = command[0]
    log = folder / f"log.{program}"
    before = log.stat().st_size if log.exists() else 0
    words = [*launcher, *command]

    def idle(seconds: float) -> None:
        if seconds > SUSPICION and disk_is_full(folder):
            raise _failure(Cause.DISK_FULL, f"{program} could not go on: {folder} is on a full disk", log)
        if seconds > SILENCE:
            raise _failure(Cause.SILENT, f"{program} logged nothing for {seconds:.0f} s", log)

    try:
        return run_program(
            words, cwd=folder, log=log, env=environment(), append=True, error=FoamError, hint=INSTALL,
            on_line=on_line, on_idle=idle, timeout=timeout,
        )  # fmt: skip
    except FoamError as problem:
        if not problem.ended:  # raised by on_line: it says why itself
            problem.command = problem.command or " ".join(words)
            raise
        raise _diagnosed(problem, program, log, before, folder) from None


def _diagnosed(problem: FoamError, program: str, log: Path, before: int, folder: Path) -> AirflowFailure:
    """The failure of a program that ended by itself, with its cause; ``before``: where in the log it began (bytes)."""
    if problem.ended == "missing":
        return AirflowFailure(Cause.MISSING, str(problem), command=problem.command)
    if problem.ended == "timed out":
        cause, why = Cause.TIMED_OUT, str(problem).split("; log:")[0].split(" ", 1)[1]
    else:
        cause, why = diagnose(problem.returncode or 0, _since(log, before), folder)
    if cause.numerical and program not in SOLVERS:
        cause = Cause.CRASHED
    return _failure(cause, f"{program} {why}", log, problem.command)


def _failure(cause: Cause, said: str, log: Path, command: str = "") -> AirflowFailure:
    advice = f"; {cause.advice}" if cause.advice else ""
    return AirflowFailure(cause, f"{said}; log: {log}{advice}", command=command, log=log, tail=tail(log))


def _since(log: Path, start: int) -> str:
    """The text logged since byte ``start``, of a long log its last part: causes stand at the end."""
    with log.open("rb") as stream:
        stream.seek(max(start, log.stat().st_size - 200_000))
        return stream.read().decode(errors="replace")
