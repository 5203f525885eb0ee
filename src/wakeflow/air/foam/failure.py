"""Why an airflow failed, derived from how a program ended, from its log and from the disk it wrote to.

A numerical failure may be cured by safer settings (:mod:`wakeflow.air.foam.airflow`); the others may not.
"""

from __future__ import annotations

import errno
import os
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path

from ...core.errors import FoamError

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
