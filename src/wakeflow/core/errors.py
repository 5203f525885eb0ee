"""The errors of the package. Each class carries the exit code with which the command line ends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

Kind = TypeVar("Kind")


def known(value: Kind | None, what: str = "a number") -> Kind:
    """A value that is there wherever this is asked; a LookupError that names it else, which is an error of ours."""
    if value is None:
        raise LookupError(f"{what} is not known here")
    return value


LONGEST, HEAD = 300, 190  # letters of a message, and of its beginning where its middle is left out


def one_line(text: str) -> str:
    """A message as a screen may show it: control characters as Python writes them, not longer than 300 letters.

    What is left out is in the middle: a message ends in what to do.
    """
    line = "".join(item if item.isprintable() else repr(item)[1:-1] for item in text)
    if len(line) <= LONGEST:
        return line
    mark = f" [... {len(line) - LONGEST + 24} letters ...] "
    return f"{line[:HEAD]}{mark}{line[HEAD + len(mark) - LONGEST :]}"


class WakeflowError(Exception):
    """Base of every error that this package raises on purpose; its message is one line that says what to do."""

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(str(message)))


class SceneError(WakeflowError, ValueError):
    """The input is wrong; the message names the field, its value and what is allowed. ``mistakes``: all of a scene, a
    line each, where there is more than the message has room for.
    """

    exit_code = 2

    def __init__(self, message: str = "", mistakes: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.mistakes = tuple(map(one_line, mistakes))


class ProgramError(WakeflowError):
    """An outside program failed. Carries the command, the path of its log, the log's last lines, and how the program
    ended.

    ``ended``: "missing", "timed out" or "failed" where a program was started and did not end well; then
    ``returncode`` is its exit code, or minus the number of the signal that ended it.
    """

    exit_code = 3

    def __init__(
        self,
        message: str,
        *,
        command: str = "",
        log: Path | None = None,
        tail: str = "",
        ended: str = "",
        returncode: int = 0,
    ) -> None:
        super().__init__(message)
        self.ended = ended
        self.returncode = returncode
        self.command = command
        self.log = log
        self.tail = tail


class MeshError(ProgramError):
    """Gmsh could not build the mesh, or the mesh is not fit to compute on."""


class FoamError(ProgramError):
    """OpenFOAM is missing, failed, or its solution is not usable."""
