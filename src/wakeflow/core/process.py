"""The only module that starts outside programs.

Every child runs in a process group of its own, writes to a log file, and dies with the thread that started it:
``setpriv --pdeathsig`` ends it when the parent is killed, the ``finally`` below in every other case.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from operator import attrgetter
from pathlib import Path
from typing import IO

from . import errors
from .errors import ProgramError, SceneError, WakeflowError

# -- Work in a second thread, on a core that would be idle -------------------------------------------------------------
_thread = threading.local()
_NEVER = threading.Event()  # of a thread beside which nothing runs: it is not set


class _Over(BaseException):
    """The other thread has failed. No Exception: nobody may take it for a failure of the program that it ends."""


def check_cancelled() -> None:
    """End this thread's work where the other's has failed; called several times a second by what takes long."""
    if getattr(_thread, "over", _NEVER).is_set():
        raise _Over


@contextlib.contextmanager
def background(jobs: Sequence[Callable[[], object]]) -> Iterator[None]:
    """Do ``jobs`` one after the other in a thread of their own while the block of the ``with`` runs; wait for both.

    Where a job raises, the block is ended at its next :func:`check_cancelled`, outside programs at once, and the job's
    exception is raised; where the block raises, Ctrl-C included, the job is ended likewise.
    """
    failed: list[BaseException] = []
    job_failed, block_failed = threading.Event(), threading.Event()

    def work() -> None:
        try:
            with _ends_with(block_failed):
                for job in jobs:
                    check_cancelled()
                    job()
        except _Over:
            pass
        except BaseException as problem:  # raised again by the caller's thread
            failed.append(problem)
            job_failed.set()

    thread = threading.Thread(target=work, name="beside", daemon=True)
    thread.start()
    try:
        with _ends_with(job_failed):
            yield
    except _Over:
        pass  # the job's own exception says why, below
    except BaseException:
        block_failed.set()
        raise
    finally:
        thread.join()
    if failed:
        raise failed[0]


@contextlib.contextmanager
def _ends_with(event: threading.Event) -> Iterator[None]:
    before, _thread.over = getattr(_thread, "over", _NEVER), event
    try:
        yield
    finally:
        _thread.over = before


# -- The only module that starts outside programs ----------------------------------------------------------------------
POLL = 0.05  # s between looks at the log
INNER = 2  # folders that a stage's programs work in below its own: part/case/span
ORPHANED = 60.0  # s that a program may take to end after the run that started it was killed
STARTED = 'test "$PPID" = "$0" && exec "$@"'  # unless the run ended before it could be noted whose end to follow
MAX_LINE = 1 << 20  # bytes of a line of a log; what is longer is none, and only its end is kept
GRACE = 3.0  # s between asking a group to end and killing it


@dataclass(frozen=True)
class Finished:
    """How a program ended: its exit code, wall seconds and log."""

    returncode: int
    seconds: float
    log: Path


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def check_workers(workers: object) -> None:
    """Raise SceneError for what is no number of threads or processes; None is one a core."""
    if workers is None:
        return
    if isinstance(workers, bool) or not isinstance(workers, Integral):
        raise SceneError(f"workers = {workers!r}: a whole number, or None for one a core")
    if workers < 1:
        raise SceneError(f"workers = {workers}: at least 1")


def tail(log: Path, lines: int = 12) -> str:
    """The last lines of a log, empty when there is none."""
    try:
        with log.open("rb") as stream:
            stream.seek(0, os.SEEK_END)
            stream.seek(max(0, stream.tell() - 400 * lines))
            text = stream.read().decode(errors="replace")
    except FileNotFoundError:
        return ""
    return "\n".join(text.splitlines()[-lines:])


def unheard(_: object) -> None:
    """What hears of a program that nobody listens to."""


def run_program(
    command: Sequence[str],
    *,
    cwd: Path,
    log: Path,
    env: Mapping[str, str] = os.environ,
    on_line: Callable[[str], None] = unheard,
    timeout: float = math.inf,
    on_idle: Callable[[float], None] = unheard,
    append: bool = False,
    error: type[ProgramError] = ProgramError,
    hint: str = "",
) -> Finished:
    """Run ``command`` to its end; its output goes to ``log``, each finished line of it to ``on_line``.

    While the log does not grow, ``on_idle`` is called with the time (s) since it last grew. An exception that either
    raises ends the program, as does a failure of what runs beside (:mod:`wakeflow.core.process`). Raises ``error`` (a
    ProgramError) when the program is missing or ends with another code than 0, and when ``timeout`` (s) passes.
    ``hint`` is appended to the message when the program is missing.
    """
    words = [str(word) for word in command]
    if shutil.which(words[0], path=env.get("PATH")) is None:
        missing = f"program {words[0]!r} is not installed{'; ' + hint if hint else ''}"
        raise error(missing, command=" ".join(words), ended="missing")
    log.parent.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    with log.open("ab" if append else "wb") as sink, log.open("rb") as source:
        source.seek(0, os.SEEK_END)
        death = "TERM" if words[0] == "mpirun" else "KILL"  # mpirun has ranks to end; nobody else has
        child = start_in_group(words, cwd, env, sink, death=death)
        try:
            _follow(child, source, on_line, on_idle, started + timeout)
        except subprocess.TimeoutExpired:
            said = f"{words[0]} did not end within {timeout:.0f} s; log: {log}"
            raise error(said, command=" ".join(words), log=log, tail=tail(log), ended="timed out") from None
        finally:
            end_group(child)
    if child.returncode != 0:
        said, code = f"{words[0]} failed with exit code {child.returncode}; log: {log}", child.returncode
        raise error(said, command=" ".join(words), log=log, tail=tail(log), ended="failed", returncode=code)
    return Finished(child.returncode, time.monotonic() - started, log)


def start_in_group(
    words: Sequence[str],
    cwd: Path,
    env: Mapping[str, str],
    sink: IO[bytes],
    *,
    stdin: int = subprocess.DEVNULL,
    pass_fds: Sequence[int] = (),
    death: str = "TERM",
) -> subprocess.Popen[bytes]:
    """The program in a process group of its own, which gets the signal ``death`` when the thread that started it ends;
    it prints to ``sink``. As long as it lives it holds a lock on its folder ``cwd``: :func:`wait_for_orphans`.
    """
    guard = ["setpriv", "--pdeathsig", death, "--", "sh", "-c", STARTED, str(os.getpid())]
    held = os.open(cwd, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(held, fcntl.LOCK_SH)
        return subprocess.Popen(
            [*guard, *words] if shutil.which("setpriv") else list(words),
            cwd=cwd,
            env={**env, "PWD": str(cwd)},  # some programs believe PWD, not the folder
            stdin=stdin,
            stdout=sink,
            stderr=subprocess.STDOUT,
            pass_fds=(*pass_fds, held),
            start_new_session=True,
        )
    finally:
        os.close(held)


def wait_for_orphans(folder: Path) -> None:
    """Wait until no program works in ``folder`` that a killed run started: on a busy machine it writes on for a moment
    after the run. Raises ProgramError where one lives on.
    """
    deadline = time.monotonic() + ORPHANED
    while is_worked_in(folder):
        check_cancelled()
        if time.monotonic() > deadline:
            raise ProgramError(f"a program of a killed run still works in {folder}; end it and start again")
        time.sleep(POLL)


def is_worked_in(folder: Path) -> bool:
    """Whether a program that :func:`start_in_group` started works in ``folder``, or in one in it up to ``INNER`` deep;
    links are not followed. False on a file system without locks.
    """
    for place, inner, _ in os.walk(folder):  # passes over what is removed meanwhile
        if len(Path(place).relative_to(folder).parts) == INNER:
            inner.clear()
        if _is_locked(place):
            return True
    return False


def _is_locked(place: str) -> bool:
    """Whether the folder cannot be locked alone, for a moment."""
    try:
        held = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:  # removed meanwhile
        return False
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.flock(held, fcntl.LOCK_UN)
    except OSError as problem:  # any other: a file system without locks
        return isinstance(problem, BlockingIOError)
    finally:
        os.close(held)
    return False


def _follow(
    child: subprocess.Popen[bytes],
    source: IO[bytes],
    on_line: Callable[[str], None],
    on_idle: Callable[[float], None],
    deadline: float,
) -> None:
    """Hand every finished line of the log to ``on_line`` until the child has ended."""
    rest, heard = b"", time.monotonic()
    while True:
        check_cancelled()
        ended = child.poll() is not None  # asked before reading, so that nothing that is written at the end is missed
        new = source.read()
        if new:
            heard = time.monotonic()
        *lines, rest = (rest[-MAX_LINE:] + new).split(b"\n")
        for line in lines:
            on_line(line.decode(errors="replace"))
        if ended:
            return
        if time.monotonic() - heard > POLL:
            on_idle(time.monotonic() - heard)
        if time.monotonic() > deadline:
            raise subprocess.TimeoutExpired(child.args, 0.0)
        try:
            child.wait(POLL)
        except subprocess.TimeoutExpired:
            continue


def end_group(child: subprocess.Popen[bytes]) -> None:
    """End whatever is left of the child's process group: first asked, then killed."""
    for number, patience in ((signal.SIGTERM, GRACE), (signal.SIGKILL, None)):
        try:
            os.killpg(child.pid, number)
        except ProcessLookupError:
            break
        try:
            child.wait(patience)
        except subprocess.TimeoutExpired:
            continue
        if not _group_lives(child.pid):
            break
    child.wait()


def _group_lives(group: int) -> bool:
    deadline = time.monotonic() + GRACE
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(POLL)
    return True


def capture(command: Sequence[str], *, env: Mapping[str, str] = os.environ, timeout: float = 20.0) -> tuple[int, str]:
    """Exit code and output of a short probe; -1 and the reason when it cannot be started or does not end."""
    try:
        done = subprocess.run(
            list(command),
            env=env,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired) as problem:
        return -1, str(problem)
    return done.returncode, done.stdout + done.stderr


def call_in_child(
    target: str,
    argument: object,
    *,
    log: Path,
    timeout: float = math.inf,
    error: type[ProgramError] = ProgramError,
) -> object:
    """Call ``module:function`` with one JSON-able ``argument`` in a Python process of its own; return its result.

    It is for libraries that have global state, are not thread-safe or may crash the interpreter (Gmsh, VTK without GL).
    A WakeflowError raised in the child is raised again here; anything else, a crash included, becomes ``error``. It is
    a fresh interpreter and not ``multiprocessing``, so that the caller's script needs no ``__main__`` guard.
    """
    with tempfile.TemporaryDirectory(prefix="wakeflow-") as folder:
        ask, answer = Path(folder, "ask.json"), Path(folder, "answer.json")
        ask.write_text(json.dumps({"target": target, "argument": argument}))
        # -P: a file in the current folder that is called like a library must not replace it
        command = [sys.executable, "-P", "-m", "wakeflow.core.process", str(ask), str(answer)]
        try:
            run_program(command, cwd=Path.cwd(), log=log, timeout=timeout, error=error)
        except ProgramError as problem:
            problem.command = f"python: {target}"
            raise
        reply = json.loads(answer.read_text())
    if "error" in reply:
        kind = getattr(errors, reply["error"])
        raise kind(reply["message"], log=log) if issubclass(kind, ProgramError) else kind(reply["message"])
    return reply["result"]


def _child(ask: Path, answer: Path) -> None:
    question = json.loads(ask.read_text())
    module, _, function = question["target"].partition(":")
    try:
        call = attrgetter(function)(importlib.import_module(module))
        reply = {"result": call(question["argument"])}
    except WakeflowError as problem:
        reply = {"error": type(problem).__name__, "message": str(problem)}
    answer.write_text(json.dumps(reply))


if __name__ == "__main__":
    _child(Path(sys.argv[1]), Path(sys.argv[2]))
