"""The options that commands have, each with its help, said once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from .scene.overrides import share_of
from .scene.rungs import rungs

__all__ = [
    "Axes", "BothEnds", "Fidelity", "Folder", "Forced", "Held", "Processes", "Quiet", "Settings", "Shown", "Stage",
    "Target", "Threads",
]  # fmt: skip

if TYPE_CHECKING:
    RungName = str
else:
    RungName = Literal[tuple(rungs)]
Stage = Literal["funnel", "mesh", "airflow", "tracks"]  # after which a run can stop
Folder = Annotated[Path | None, Parameter(help="Folder for the results; default runs/, the scene's name, its changes.")]
Fidelity = Annotated[RungName | None, Parameter(help="Fidelity of the airflow instead of the scene's own.")]
Settings = Annotated[
    list[str], Parameter(name="--set", negative="", help="Change a key of the scene: air.speed='7 m/s'. Repeatable.")
]
Forced = Annotated[
    list[str],
    Parameter(name="--force", negative="", help="Switch a term: lift=on, chaff.basset-history=off. Repeatable."),
]
Target = Annotated[
    float | None,
    Parameter(
        help="Error of a bin's share that is asked for, instead of the scene's own: 0.01 or 1%. The plan leaves out "
        "terms that could not move so much; run also chooses its settings by it.",
        converter=lambda _, tokens: share_of(tokens[0].value),
    ),
]


def _at_least_one(_: object, count: int | None) -> None:
    if count is not None and count < 1:
        raise ValueError("Must be at least 1.")


Threads = Annotated[int | None, Parameter(validator=_at_least_one, help="Threads of the tracker; default all cores.")]
Processes = Annotated[
    int | None, Parameter(validator=_at_least_one, help="Processes on this machine; default one a core.")
]
Quiet = Annotated[bool, Parameter(help="Print nothing but errors, and no progress; where there is --json, that alone.")]

Axes = Annotated[
    list[str],
    Parameter(
        name="--set",
        negative="",
        help="Values of a key of the scene: air.speed=3,4,5, or start:stop:count as in air.speed='3:5:3 m/s'. "
        "Repeatable; a single value is the same for all.",
    ),
]
Held = Annotated[
    list[str],
    Parameter(
        name="--set", negative="", help="Hold a key in all designs at all levels: air.speed='5 m/s'. Repeatable."
    ),
]
BothEnds = Annotated[
    list[str],
    Parameter(
        negative="",
        help="Fly the scene again with a key at both ends: air.speed='4 m/s,6 m/s', or the key alone for the ends of "
        "its own interval. Repeatable.",
    ),
]
Shown = Annotated[
    list[str], Parameter(negative="", help="Quantities to show: recovery.wheat, share.dust.middle. Repeatable.")
]
