"""OpenFOAM's programs: which version is installed, how one is started on one rank or several, why one failed.

A cause follows from how a program ended, from its log and from the disk it wrote to. A numerical failure may be cured
by safer settings (:mod:`wakeflow.air.foam.airflow`); the others may not.
"""

from __future__ import annotations

import errno
import os
import platform
import re
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from functools import cache
from pathlib import Path

from ...core.errors import FoamError
from ...core.files import kernel_root
from ...core.process import Finished, capture, run_program, tail, unheard
from .case import INSTALL, read_parameters
from .read import every_time

# -- Why an airflow failed ---------------------------------------------------------------------------------------------
FULL = 2**20  # bytes free: less than any time folder needs
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
WORDS_OF_A_FULL_DISK = ("No space left on device", "Disk quota exceeded", "File too large")
NUMERICAL_FATALS = r"\b(nan|-?inf)\b|Maximum number of iterations exceeded|Continuity error cannot be removed"


class Cause(Enum):
    """What ended an airflow: the word for it, whether safer settings may help, what the user can do."""

    FLOATING_POINT = ("floating point exception", True, "")
    DIVERGED = ("diverged", True, "")
    COLLAPSED = ("time step collapsed", True, "")
    STALLED = ("stalled", True, "")
    NOT_FINITE = ("not finite", True, "")
    NONSENSE = ("implausible", True, "")
    SILENT = ("silent", False, "look whether the machine or its disk hangs, then start the same command again")
    DISK_FULL = ("disk full", False, "free some space or set WAKEFLOW_CACHE to another disk; the same command goes on")
    KILLED = ("killed", False, "by hand, or by the system when memory ran out; the same command goes on from there")
    CRASHED = ("crashed", False, "")
    STOPPED = ("stopped", False, "")
    NO_DIGEST = ("no digest", False, "this OpenFOAM needs a C compiler: apt-get install tcc")
    MISSING = ("missing", False, "")

    def __init__(self, word: str, numerical: bool, advice: str) -> None:
        self.word = word
        self.numerical = numerical
        self.advice = advice


class AirflowFailure(FoamError):
    """A FoamError that knows its :class:`Cause`."""

    def __init__(self, cause: Cause, message: str, *, command: str = "", log: Path | None = None, tail: str = ""):
        super().__init__(message, command=command, log=log, tail=tail)
        self.cause = cause


def diagnose(code: int, text: str, folder: Path) -> tuple[Cause, str]:
    """The cause of a program's failure and a clause that says so.

    ``code``: how it ended, minus the signal's number where one ended it (mpirun: 128 plus that number); ``text``: what
    it logged; ``folder``: where it wrote.
    """
    ended = -code if code < 0 else code - 128 if 128 < code < 160 else 0
    fatal = re.search(r"FOAM FATAL (?:IO )?ERROR\s*:?\s*\n?(.*?)\n(?:\[\d+\]\s*)?\s*\n", text, re.S)
    said = " ".join(re.sub(r"\[\d+\]", " ", fatal[1]).split())[:300] if fatal else ""
    if ended == signal.SIGXFSZ or any(words in text for words in WORDS_OF_A_FULL_DISK) or disk_is_full(folder):
        return Cause.DISK_FULL, f"could not write: {folder} is full or its quota used up"
    if ended == signal.SIGFPE or "sigFpe::sigHandler" in text:
        return Cause.FLOATING_POINT, "diverged (floating point exception): the solution grew without bound"
    if said and re.search(NUMERICAL_FATALS, said, re.I):
        return Cause.DIVERGED, f"diverged: {said}"
    if said:
        return Cause.NO_DIGEST if '"sha1"' in said else Cause.STOPPED, f"stopped: {said}"
    if ended in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        return Cause.KILLED, f"was killed (signal {ended})"
    if ended:
        return Cause.CRASHED, f"crashed (signal {ended})"
    return Cause.STOPPED, f"failed with exit code {code}"


def disk_is_full(folder: Path) -> bool:
    """Whether the disk that holds ``folder`` has less than 1 MiB left for this user."""
    while not folder.exists():
        folder = folder.parent
    room = os.statvfs(folder)
    return room.f_bavail * room.f_frsize < FULL


@contextmanager
def disk_trouble_named(folder: Path) -> Iterator[None]:
    """Turn this process's own failing writes for want of room into an AirflowFailure."""
    try:
        yield
    except OSError as problem:
        if problem.errno not in NO_ROOM:
            raise
        raise AirflowFailure(
            Cause.DISK_FULL, f"could not write below {folder}: {problem.strerror}; {Cause.DISK_FULL.advice}"
        ) from None


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
    cause, why = diagnose(problem.returncode, _since(log, before), folder)
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
    match = re.search(r"OpenFOAM-\s*\(?v?(\w+)\)?.*?\((patch=\w+)\)", text, re.S)
    return f"{match[1]} {match[2]}" if match else " ".join(text.split())[-80:]
