"""OpenFOAM's programs: which version is installed, how one is started on one rank or several, and what it cost."""

from __future__ import annotations

import os
import platform
import re
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from ...core.errors import FoamError
from ...core.process import Finished, capture, run_program, tail, unheard
from ...core.user_folder import kernel_root
from .case import INSTALL, read_parameters
from .failure import AirflowFailure, Cause, diagnose, disk_is_full
from .read import every_time

# -- Start one OpenFOAM program in a case ------------------------------------------------------------------------------
SOLVERS = ("simpleFoam", "pimpleFoam")  # only what these compute can be cured by safer settings
SILENCE = 900.0  # s without a line in the log: no iteration of a two-dimensional case takes that long
SUSPICION = 2.0  # s without a line after which the disk is looked at: a full one swallows the log too


def call(
    folder: Path,
    command: Sequence[str],
    on_line: Callable[[str], None] = unheard,
    *,
    launcher: Sequence[str] = (),
) -> Finished:
    """Run ``command`` in the case ``folder``, its output appended to log.PROGRAM there.

    ``launcher``: words before the command (mpirun). Raises AirflowFailure; what ``on_line`` raises goes through.
    """
    program = command[0]
    log = folder / f"log.{program}"
    before = log.stat().st_size if log.exists() else 0
    words = [*launcher, *command]
    mended = digest_library().exists()

    def idle(seconds: float) -> None:
        if seconds > SUSPICION and disk_is_full(folder):
            raise _failure(Cause.DISK_FULL, f"{program} could not go on: {folder} is on a full disk", log)
        if seconds > SILENCE:
            raise _failure(Cause.SILENT, f"{program} logged nothing for {seconds:.0f} s", log)

    try:
        return run_program(
            words, cwd=folder, log=log, env=environment(), append=True, error=FoamError, hint=INSTALL,
            on_line=on_line, on_idle=idle,
        )  # fmt: skip
    except FoamError as problem:
        if not problem.ended:  # raised by on_line: it says why itself
            problem.command = problem.command or " ".join(words)
            raise
        failure = _diagnosed(problem, program, log, before, folder)
        if failure.cause is not Cause.NO_DIGEST or mended or not compile_digest():
            raise failure from None
    os.truncate(log, before)  # it failed before its first step, and is called as if for the first time
    return call(folder, command, on_line, launcher=launcher)


def _diagnosed(problem: FoamError, program: str, log: Path, before: int, folder: Path) -> AirflowFailure:
    """The failure of a program that ended by itself, with its cause; ``before``: where in the log it began (bytes)."""
    if problem.ended == "missing":
        return AirflowFailure(Cause.MISSING, str(problem), command=problem.command)
    cause, why = diagnose(problem.returncode or 0, _since(log, before), folder)
    if cause.numerical and program not in SOLVERS:
        cause = Cause.CRASHED
    return _failure(cause, f"{program} {why}", log, problem.command)


def _failure(cause: Cause, said: str, log: Path, command: str = "") -> AirflowFailure:
    advice = f"; {cause.advice}" if cause.advice else ""
    return AirflowFailure(cause, f"{said}; log: {log}{advice}", command=command, log=log, tail=tail(log))


def _since(log: Path, start: int) -> str:
    """The text logged since byte ``start``, of a long log its last part: causes are at the end."""
    with log.open("rb") as stream:
        stream.seek(max(start, log.stat().st_size - 200_000))
        return stream.read().decode(errors="replace")


# -- What OpenFOAM's programs need around them -------------------------------------------------------------------------
# Releases up to v2112 that gcc 12 or a later one compiled (Debian 13, Ubuntu 24.04) end where they take the checksum of
# a function object's entries: 'error in IOstream "sha1"'. It says which entries were changed while a program runs; in
# this program's cases none are (runTimeModifiable no), so that any constant serves.
DIGEST = """
struct digest { unsigned char bytes[20]; };
struct digest _ZNK4Foam10dictionary6digestEv(const void *dictionary) { struct digest none = {{0}}; return none; }
"""


def environment() -> dict[str, str]:
    """The environment of every OpenFOAM program; nothing is sourced. WM_PROJECT_DIR is that of Debian's package where
    the user has not named another.
    """
    library, preloaded = digest_library(), os.environ.get("LD_PRELOAD", "")
    lacking = {"LD_PRELOAD": f"{library} {preloaded}".strip()} if library.exists() else {}
    fixed = {"OMP_NUM_THREADS": "1", "FOAM_SIGFPE": "true", **lacking}
    return {"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ, **fixed}


def digest_library() -> Path:
    """Where the shared library of ``DIGEST`` is, once a program has needed it on this machine."""
    return kernel_root() / f"openfoam-digest-{platform.machine()}.so"


def compile_digest() -> bool:
    """Make :func:`digest_library`; whether there is a C compiler, without headers. Raises FoamError where it fails."""
    compiler, library = shutil.which("cc"), digest_library()
    if compiler is None:
        return False
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        source, made = Path(folder, "digest.c"), Path(folder, library.name)
        source.write_text(DIGEST)
        command = [compiler, "-shared", "-fPIC", "-nostdlib", "-o", str(made), str(source)]
        code, said = capture(command)
        if code != 0:
            raise FoamError(f"{compiler} cannot compile what OpenFOAM lacks", command=" ".join(command), tail=said)
        made.replace(library)
    return True


# -- MPI ---------------------------------------------------------------------------------------------------------------
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
    written = [{path.name for path in every_time(part)} for part in parts]
    new = set.intersection(*written) - {path.name for path in folder.iterdir()}
    if new:
        call(folder, ["reconstructPar", "-time", ",".join(sorted(new, key=float))])
    for part in parts:
        shutil.rmtree(part)


def _ranks(folder: Path) -> int:
    return int(read_parameters(folder).get("ranks", 1))


# -- Which OpenFOAM is installed ---------------------------------------------------------------------------------------
@cache
def openfoam_version() -> str:
    """Version and patch of the installed OpenFOAM, "1912 patch=200626". Raises FoamError when there is none, or that of
    the Foundation, whose cases are written otherwise.
    """
    command = ["simpleFoam", "-help"]
    code, text = capture(command, env=environment())
    if code != 0:
        raise FoamError(f"OpenFOAM's simpleFoam does not start; {INSTALL}", command=" ".join(command), tail=text[-500:])
    if other := re.search(r"OpenFOAM-(\S+) \(see \S*openfoam\.org\)", text):
        why = (
            f"OpenFOAM {other[1]} of openfoam.org comes first in PATH, and its cases are written otherwise; put one of "
        )
        raise FoamError(f"{why}openfoam.com before it, or {INSTALL}", command=" ".join(command))
    found = re.search(r"OpenFOAM-\s*\(?v?(\w+)\)?.*?\((patch=\w+)\)", text, re.S)
    return f"{found[1]} {found[2]}" if found else " ".join(text.split())[-80:]
