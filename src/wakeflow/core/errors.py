"""The one error family. Each class carries the exit code the command line ends with."""

from __future__ import annotations

from pathlib import Path

__all__ = ["FoamError", "MeshError", "ProgramError", "SceneError", "WakeflowError"]


class WakeflowError(Exception):
    """Base of every error this package raises on purpose; its message is one line that tells what to do."""

    exit_code = 1


class SceneError(WakeflowError, ValueError):
    """The input is wrong: names the field, its value and what is allowed."""

    exit_code = 2


class ProgramError(WakeflowError):
    """An outside program failed: carries the command, where its log is, the log's last lines, and how it ended.

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
        returncode: int | None = None,
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
