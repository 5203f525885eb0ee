"""The options that commands have, each with its help, and those that several commands share."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from ..scene.overrides import changes_of, share_of, switches_of
from ..scene.rungs import rungs

if TYPE_CHECKING:
    from ..scene import Scene

if TYPE_CHECKING:
    RungName = str
else:
    RungName = Literal[tuple(rungs)]
Folder = Annotated[Path | None, Parameter(help="Folder for the results; default runs/, the scene's name, its changes.")]
Fidelity = Annotated[RungName | None, Parameter(help="Fidelity of the airflow instead of the scene's own.")]
Settings = Annotated[
    tuple[str, ...],
    Parameter(name="--set", negative="", help="Change a key of the scene: air.speed='7 m/s'. Repeatable."),
]
Forced = Annotated[
    tuple[str, ...],
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


Budget = Annotated[
    str | None,
    Parameter(help="Run time that may be spent, '3 min': the finest settings that are expected to fit are chosen."),
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
    tuple[str, ...],
    Parameter(
        name="--set",
        negative="",
        help="Values of a key of the scene: air.speed=3,4,5, or start:stop:count as in air.speed='3:5:3 m/s'. "
        "Repeatable; a single value is the same for all.",
    ),
]
Scheduler = Annotated[str | None, Parameter(help="A Dask cluster to work on instead: tcp://host:8786.")]
Picture = Annotated[Path | None, Parameter(help="Where to draw it: PNG, SVG or PDF.")]
AsJson = Annotated[bool, Parameter(name="--json")]


@Parameter(name="*")
@dataclass(frozen=True)
class Gate:
    """What overrides a scene's own choice of rung and terms."""

    rung: Fidelity = None
    force: Forced = ()

    @property
    def how(self) -> dict[str, Any]:
        """The options as ``wakeflow.plan``, ``run``, ``sweep`` and ``sensitivity`` take them."""
        return {"rung": self.rung, "force": switches_of(self.force)}


@Parameter(name="*")
@dataclass(frozen=True)
class Accuracy(Gate):
    """What overrides a scene's own choice of rung, terms and accuracy."""

    target_error: Target = None

    @property
    def how(self) -> dict[str, Any]:
        """The options as ``wakeflow.plan``, ``run`` and ``sweep`` take them."""
        return {**super().how, "target_error": self.target_error}


@Parameter(name="*")
@dataclass(frozen=True)
class Pace(Accuracy):
    """What overrides a scene's own choices, and how long it may take."""

    quick: Annotated[
        bool,
        Parameter(negative="", help="Answer in half a minute: coarse settings, no time-resolved wake, wide intervals."),
    ] = False


GATE, ACCURACY, PACE = Gate(), Accuracy(), Pace()


def scene_and_folder(file: Path, settings: tuple[str, ...], gate: Gate, out: Path | None) -> tuple[Scene, Path]:
    """The scene of a file with its ``settings``, and the folder for its results, by default below runs/; says on
    stderr which of the settings nothing feels.
    """
    from ..runs.planned import deaf_line
    from ..scene import Scene
    from ..scene.changes import run_folder

    changes, how = changes_of(settings), gate.how
    scene = Scene.load(file, changes)
    if line := deaf_line(changes, scene, how["rung"]):
        print(f"! {line}", file=sys.stderr)
    quick = isinstance(gate, Pace) and gate.quick
    named = {"rung": how["rung"], **how["force"], "target-error": how.get("target_error"), "quick": quick or None}
    return scene, out or Path("runs", run_folder(file.stem, scene, changes, named))


def next_to(path: Path, ending: str) -> Path:
    """A file beside a scene or a folder, named after it."""
    named = path.resolve() if path.name in ("", "..") else path
    name = named.stem if named.suffix == ".toml" else named.name
    return named.parent / f"{name or 'scene'}{ending}"
