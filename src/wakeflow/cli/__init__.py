"""The command line. Parses, shows progress, prints; everything else is a call into the package."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, UnusedCliTokensError

from ..core.errors import ProgramError, SceneError, WakeflowError
from ..scene.overrides import unquoted
from . import batch, run, trays, view

__all__ = ["app", "main"]

INTERRUPTED = 130  # exit code, as a shell gives it for Ctrl-C

app = App(
    name="wakeflow",
    help="Where each granule fraction lands behind a vibrating rhombus or prism in a vertical airflow.",
    version_flags=["--version"],
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
for _command in (*run.COMMANDS, *view.COMMANDS, *batch.COMMANDS, *trays.COMMANDS):
    app.command(_command)


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
        code = app(arguments, exit_on_error=False, print_error=False)
    except CycloptsError as problem:
        words = sys.argv[1:] if arguments is None else arguments
        parted = unquoted(words) if isinstance(problem, UnusedCliTokensError) else None
        _complain(parted or str(problem).strip().splitlines()[-1])
        return SceneError.exit_code
    except WakeflowError as problem:
        _complain(str(problem))
        if isinstance(problem, ProgramError):
            _details(problem)
        return problem.exit_code
    except BrokenPipeError:
        sys.stderr.close()  # the reader left; nothing more can be said
        return 0
    except OSError as problem:
        full = problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        place = f"{problem.filename}: " if problem.filename else ""
        _complain(
            f"{place}{problem.strerror}; {'free some space or ' if full else ''}choose another --out and WAKEFLOW_CACHE"
        )
        return ProgramError.exit_code if full else SceneError.exit_code
    except KeyboardInterrupt:
        _complain("interrupted; what is finished is kept, the same command goes on")
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def _complain(text: str) -> None:
    print(f"wakeflow: {text}", file=sys.stderr)


def _details(problem: ProgramError) -> None:
    for label, text in (("command", problem.command), ("log", problem.log), ("last lines", problem.tail)):
        if text:
            body = str(text)
            print(f"  {label}: {body}" if "\n" not in body else f"  {label}:\n{body}", file=sys.stderr)
