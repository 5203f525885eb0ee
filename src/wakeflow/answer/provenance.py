"""Where an answer comes from, and what a run with a target error refined, round by round."""

from __future__ import annotations

import platform
import shlex
import sys
from dataclasses import dataclass
from datetime import datetime
from math import nan
from pathlib import Path
from typing import Annotated

from ..core.process import capture, cores
from ..core.record import Null, column
from ..scene import Scene


# -- Where an answer comes from ----------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Provenance:
    """When, where, by which command and with which programs an answer was made first."""

    date: str = column("", "when, by the clock of the machine, with its distance from UTC")
    command: str = column("", "what was typed; of a Python session, its program")
    folder: str = column("", "where it was typed")
    host: str = column("", "name of the machine")
    system: str = column("", "its operating system and processor")
    cores: int = column("1", "processors that the run could use")
    seed: int = column("1", "seed of the granules' random numbers")
    openfoam: Annotated[str, Null("")] = column("", "version of the OpenFOAM that solved the air; null where none did")
    commit: Annotated[str, Null("")] = column(
        "", "git commit of the program, + where its files differ; null outside a repository"
    )


def provenance_of(scene: Scene, solver: str) -> Provenance:
    """Provenance of a run made now; ``solver``: version of the OpenFOAM that solved its air, empty where none did."""
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


def commit_of(folder: Path) -> str:
    """The commit of the repository whose top is ``folder``, with a + where files differ from it; empty without one, or
    without git.
    """
    if not (folder / ".git").exists():
        return ""
    code, text = capture(["git", "-C", str(folder), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+"])
    return text.strip() if code == 0 else ""


# -- What a run with a target error bought, round by round -------------------------------------------------------------
@dataclass(frozen=True)
class RefinedSettings:
    """The numbers of a scene that time is spent on."""

    granules: int = column("1", "granules tracked per fraction: feed.count")
    tolerance: float = column("body widths", "landing error of the tracker: numerics.tolerance")
    mesh_scale: float | None = column("1", "factor on every cell edge: numerics.mesh_scale; null without a mesh")
    averaging: float | None = column(
        "1", "relative half width at which the wake's averages may end: numerics.averaging; null where nothing sheds"
    )
    slab: int | None = column("1", "granules counted in the slab: collisions.count; null where granules do not meet")


@dataclass(frozen=True)
class RefinementRound:
    """One run on the way to a target error: what it was spent on, and the error that was expected and found."""

    settings: RefinedSettings = column("", "what was computed with")
    bought: str = column("", "what is finer than in the round before, in words")
    expected: Annotated[float, Null(nan)] = column(
        "1", "largest error by computing that was expected; null of the first round"
    )
    found: float = column("1", "largest one found, of the bin shares that computing can bring to the target")
    expected_seconds: Annotated[float, Null(nan)] = column("s", "run time that was expected; null of the first round")
    seconds: float = column("s", "run time of the stages that no round before had made")


@dataclass(frozen=True)
class Refinement:
    """How a target error was met, or why it could not be."""

    target: float = column("1", "half width asked for every bin share, by computing alone")
    met: bool = column("", "whether every bin share meets it by computing alone, with no part unknown")
    numerical: float = column("1", "largest half width of a bin share by computing alone")
    total: float | None = column("1", "largest half width with the inputs; null where a part is unknown")
    rounds: tuple[RefinementRound, ...] = column("", "every run on the way, the last one is the answer's")
    unmet: tuple[str, ...] = column(
        "", "parts and bounds that no setting brings to the target, and what to give or run instead"
    )
    measure: tuple[str, ...] = column("", "what to measure, how well, for totals that meet the target too")
