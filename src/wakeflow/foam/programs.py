"""Start one OpenFOAM program in a case; its failure becomes one line with a cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import FoamError
from ..process import Finished, run, tail
from .case import INSTALL, environment
from .failure import AirflowFailure, Cause, diagnose

__all__ = ["SOLVERS", "call"]

SOLVERS = ("simpleFoam", "pimpleFoam")  # only what these compute can be cured by safer settings
CAUSES = {"missing": Cause.MISSING, "timed out": Cause.TIMED_OUT, "silent": Cause.SILENT}


def call(
    folder: Path,
    command: Sequence[str],
    on_line: Callable[[str], None] | None = None,
    *,
    launcher: Sequence[str] = (),
    timeout: float | None = None,
    silence: float | None = None,
) -> Finished:
    """Run ``command`` in the case ``folder``, its output appended to log.PROGRAM there.

    ``launcher``: words before the command (mpirun). Raises AirflowFailure; what ``on_line`` raises goes through.
    """
    program = command[0]
    log = folder / f"log.{program}"
    before = log.stat().st_size if log.exists() else 0
    words = [*launcher, *command]
    try:
        return run(
            words, cwd=folder, log=log, env=environment(), on_line=on_line, append=True, error=FoamError,
            hint=INSTALL, timeout=timeout, silence=silence,
        )  # fmt: skip
    except FoamError as problem:
        if not problem.ended:  # raised by on_line: it says why itself
            problem.command = problem.command or " ".join(words)
            raise
        cause, message = CAUSES.get(problem.ended), str(problem)
        if cause is None:
            cause, why = diagnose(problem.returncode or 0, _since(log, before), folder)
            if cause.numerical and program not in SOLVERS:
                cause = Cause.CRASHED
            message = f"{program} {why}; log: {log}"
        if cause.advice:
            message += f"; {cause.advice}"
        raise AirflowFailure(cause, message, command=problem.command, log=problem.log, tail=tail(log)) from None


def _since(log: Path, start: int) -> str:
    """The text logged since byte ``start``, of a long log its last part: causes stand at the end."""
    with log.open("rb") as stream:
        stream.seek(max(start, log.stat().st_size - 200_000))
        return stream.read().decode(errors="replace")
