"""Where an answer comes from: when, where, by which command and with which programs it was made."""

from __future__ import annotations

import platform
import shlex
import sys
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from ..core.process import capture, cores
from ..core.record import column
from ..scene import Scene

__all__ = ["Provenance", "commit_of", "provenance_of"]


@dataclass(frozen=True)
class Provenance:
    """When, where, by which command and with which programs an answer was made first."""

    date: str = column("", "when, by the clock of the machine, with its distance from UTC")
    command: str = column("", "what was typed; of a Python session, its program")
    folder: str = column("", "where it was typed")
    host: str = column("", "name of the machine")
    system: str = column("", "its operating system and processor")
    cores: int = column("1", "processors that the run could use")
    seed: int = column("1", "of the granules' random numbers")
    openfoam: str | None = column("", "version of the OpenFOAM that solved the air; null where none did")
    commit: str | None = column("", "git commit of the program, + where its files differ; null outside a repository")


def provenance_of(scene: Scene, solver: str | None) -> Provenance:
    """Of a run that is made now; ``solver``: the version of the OpenFOAM that solved its air, None where none did."""
    return Provenance(
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        command=shlex.join([Path(sys.argv[0]).name or "python", *sys.argv[1:]]),
        folder=str(Path.cwd()),
        host=platform.node(),
        system=f"{platform.system()} {platform.release()}, {platform.machine()}",
        cores=cores(),
        seed=scene.feed.seed,
        openfoam=solver,
        commit=commit_of(Path(__file__).parents[3]),
    )


def commit_of(folder: Path) -> str | None:
    """The commit of the repository whose top is ``folder``, with a + where files differ from it; None without one, or
    without git.
    """
    if not (folder / ".git").exists():
        return None
    code, text = capture(["git", "-C", str(folder), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+"])
    return text.strip() if code == 0 else None
