"""The command line. Parses, shows progress, prints; everything else is a call into the package.

Comes in: words that a person typed. Goes out: lines on a screen, an exit code. It finds the commands of extras by
registration.
May call it: a shell (``wakeflow``); extras take its options and tables.
"""

from __future__ import annotations

import atexit
import errno
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from pkgutil import resolve_name
from types import FrameType, TracebackType
from typing import ClassVar, NoReturn

from cyclopts import App, CycloptsError, UnusedCliTokensError

from ..core.errors import ProgramError, SceneError, WakeflowError, one_line
from ..core.files import FULL
from ..core.registry import extras
from ..scene.overrides import unquoted
from . import batch, run

__all__ = ["app", "main"]


AGAIN = 0.1  # s after which an interrupt that was lost comes again
LOADS = "llvmlite.binding.executionengine"  # LLVM calls back here for a kernel; without an answer, its code is nowhere
HEARD = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)


class _Ended(KeyboardInterrupt):
    """A signal asked the program to end. Lost before it came to :func:`main`, as in what C code calls back, it comes
    again, until the program is at its end.
    """

    number: ClassVar[int] = 0  # the signal, once one came
    awaited: ClassVar[bool] = True

    def __del__(self) -> None:
        if self.awaited:
            signal.setitimer(signal.ITIMER_REAL, AGAIN)


def _end(number: int, frame: FrameType | None) -> None:
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_IGN)  # once: what is told to end has its time to
    signal.signal(signal.SIGALRM, _again)
    sys.unraisablehook, sys.excepthook = _unraised, _uncaught
    _Ended.number = number
    _again(number, frame)


def _again(_: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_globals.get("__name__") == LOADS:
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        frame = frame.f_back
    raise _Ended


def _deafen() -> None:
    """Let no signal interrupt the program's end: while Python takes itself apart none has a handler, and the timer of
    one that was lost would kill it.
    """
    for number in (*HEARD, signal.SIGALRM):
        signal.signal(number, signal.SIG_IGN)
    _Ended.awaited = False


def _unraised(lost: sys.UnraisableHookArgs) -> None:
    if not isinstance(lost.exc_value, _Ended):
        sys.__unraisablehook__(lost)


def _uncaught(kind: type[BaseException], lost: BaseException, trace: TracebackType | None) -> None:
    """Cython prints what it loses as uncaught, too."""
    if not isinstance(lost, _Ended):
        sys.__excepthook__(kind, lost, trace)


app = App(
    name="wakeflow",
    help="Where each granule fraction lands behind a vibrating rhombus or prism in a vertical airflow.",
    version_flags=["--version"],
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
for _command in (*run.COMMANDS, *batch.COMMANDS):
    app.command(_command)
for _extra in extras():
    for _name in getattr(_extra, "COMMANDS", ()):
        app.command(resolve_name(_name))


def _version() -> str:
    from .. import __version__

    return str(__version__)


app.version = _version
app.register_install_completion_command(help="Install completion of commands and options for your shell.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, by default with the process's own arguments.

    Returns the exit code: 0 done, 2 wrong input, 3 an outside program failed, 130 interrupted.
    """
    try:
        if arguments is not None:
            return _answer(arguments)
        _prepare()
        code = _answer(sys.argv[1:])
        _deafen()
        return code
    except BaseException as problem:
        if not isinstance(problem, KeyboardInterrupt) and not _Ended.number:
            raise
    if arguments is None:
        _deafen()
    _complain("interrupted; what is finished is kept, the same command goes on")
    code = 128 + (_Ended.number or signal.SIGINT)  # as a shell gives it
    return code if arguments is not None else _leave(code)


def _answer(words: Sequence[str]) -> int:
    """Do what a command line of these ``words`` asks; the exit code. Raises what is no answer to it."""
    try:
        code = app(words, exit_on_error=False, print_error=False)
    except BrokenPipeError:
        sys.stderr.close()  # the reader left; nothing more can be said
        return 0
    except (CycloptsError, WakeflowError, OSError, MemoryError, ImportError, RecursionError) as problem:
        if _Ended.number:  # a library's words for what came of it
            raise
        return _explained(problem, words)
    return code if isinstance(code, int) else 0


def _leave(code: int) -> NoReturn:
    """End the process at once. Python would first take apart what was interrupted half-made, such as LLVM's parts, and
    has crashed in it.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the reader left
            stream.flush()
    os._exit(code)


def _explained(problem: Exception, words: Sequence[str]) -> int:
    """Say in one line what a command line of these ``words`` ended with; the exit code. Raises what is nobody's input
    and no program's failure.
    """
    if isinstance(problem, CycloptsError):
        parted = unquoted(words) if isinstance(problem, UnusedCliTokensError) else None
        _complain(parted or str(problem).strip().splitlines()[-1])
    elif isinstance(problem, WakeflowError):
        for line in getattr(problem, "mistakes", ()) or [str(problem)]:
            _complain(line)
        if isinstance(problem, ProgramError):
            _details(problem)
        return problem.exit_code
    elif isinstance(problem, OSError):
        return _of_the_system(problem)
    elif isinstance(problem, MemoryError) or "failed to map segment" in str(problem):  # of a library, as it is loaded
        _complain("the memory is full; what is finished is kept: close other programs or lower feed.count")
        return ProgramError.exit_code
    elif any(word.startswith(("[", "{")) for word in words):
        _complain("lists in each other deeper than the command line takes them; name plain files and values")
    else:
        raise problem
    return SceneError.exit_code


def _prepare() -> None:
    """Set up a process of its own: letters that the terminal has not are shown as ?, and who ends it is heard."""
    if not re.fullmatch("[1-9][0-9]+", os.environ.get("COLUMNS", "80")):
        del os.environ["COLUMNS"]  # narrower than 10 nothing is read, and of no width nothing is shown
    os.environ.pop("MPLBACKEND", None)  # no window is opened, and matplotlib fails at a name that it does not know
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    for number in HEARD:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):  # nohup ignores the second
            signal.signal(number, _end)


def _of_the_system(problem: OSError) -> int:
    """Say what the operating system refused, and what to do about it; the exit code."""
    place, said = f"{problem.filename}: " if problem.filename else "", problem.strerror or str(problem)
    if problem.errno in FULL:
        _complain(f"{place}{said}; free some space, what is finished is kept, the same command goes on")
    elif problem.errno in (errno.EMFILE, errno.ENFILE):
        _complain(f"{place}{said}; allow more with: ulimit -n 1024")
    elif problem.errno == errno.ENAMETOOLONG:
        _complain(f"{place}{said}; choose a shorter one, mostly 255 bytes are allowed")
        return SceneError.exit_code
    else:
        _complain(f"{place}{said}; choose another --out and WAKEFLOW_CACHE")
        return SceneError.exit_code
    return ProgramError.exit_code


def _complain(text: str) -> None:
    print(f"wakeflow: {one_line(text)}", file=sys.stderr)


def _details(problem: ProgramError) -> None:
    for label, text in (("command", problem.command), ("log", problem.log), ("last lines", problem.tail)):
        if text:
            body = str(text)
            print(f"  {label}: {body}" if "\n" not in body else f"  {label}:\n{body}", file=sys.stderr)
