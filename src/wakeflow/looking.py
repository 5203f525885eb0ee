"""The commands that look at something and compute nothing: plan, view, materials; and how a picture is opened."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .core.errors import SceneError
from .options import Fidelity, Forced, Settings, Stage, Target
from .scene.overrides import changes_of, switches_of

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["LOOKING", "materials", "plan", "view"]

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # variables that name a screen
Picture = Annotated[Path | None, Parameter(help="Where to draw it: PNG, SVG or PDF.")]


def plan(
    scene: Path,
    *,
    everything: Annotated[bool, Parameter(name="--all", negative="")] = False,
    picture: Picture = None,
    show: Annotated[bool, Parameter(name="--open", negative="")] = False,
    out: Path | None = None,
    until: Stage | None = None,
    workers: int | None = None,
    rung: Fidelity = None,
    settings: Settings = [],  # noqa: B006
    force: Forced = [],  # noqa: B006
    target_error: Target = None,
    as_json: Annotated[bool, Parameter(name="--json")] = False,
) -> None:
    """Say in ten lines what is flown, left out and doubtful and what it costs, and draw the machine with its measures.

    Starts nothing heavy. The drawing goes to runs/NAME-plan.png, beside the folder of the results, or to --picture.

    Parameters
    ----------
    scene
        A scene file (TOML).
    everything
        Print all that is used, each bound, what is left out and why, every stage and every warning.
    show
        Open the drawing.
    out, until, workers
        Taken as by run, so that its command line can be reused; a plan does not depend on them.
    as_json
        Print JSON, and draw only with --picture.
    """
    del until, workers
    from .planning.make import make_plan
    from .scene import Scene, units_written
    from .scene.changes import run_folder
    from .terminal import show_plan, show_whole_plan

    changes, switches = changes_of(settings), switches_of(force)
    asked = Scene.load(scene, changes)
    made = make_plan(asked, rung=rung, force=switches, target_error=target_error)
    if as_json:
        print(json.dumps(made.summary(), indent=2))
    elif everything:
        show_whole_plan(made)
    else:
        show_plan(made, asked, units_written(scene))
    if as_json and picture is None:
        return
    options = {"rung": rung, **switches, "target-error": target_error}
    folder = out or Path("runs", run_folder(scene.stem, asked, changes, options))
    path = picture or folder.with_name(f"{folder.name}-plan.png")
    _draw(path, asked, scene)
    if not as_json:
        print(f"drawing: {path}")
    if show:
        _open(path)


def view(what: Path, *, picture: Picture = None, settings: Settings = []) -> None:  # noqa: B006
    """Look at a machine in a window: its bodies and bins, and of a finished run the air and its granules in time.

    Drag turns, the wheel zooms, the slider sets the time since a granule's release, q ends. Where there is no screen
    the same picture is written to NAME-view.png, or to --picture.

    Parameters
    ----------
    what
        A scene file, or the folder of a finished run.
    picture
        Draw it there, as PNG, and open no window.
    """
    from .report.window import look
    from .results.result import Result
    from .scene import Scene

    run = what if what.is_dir() else None
    scene = Scene.parse(dict(Result.load(what).scene)) if run else Scene.load(what, changes_of(settings))
    screen = any(os.environ.get(name) for name in DISPLAYS)
    path = picture or (None if screen else what.with_name(f"{what.stem}-view.png"))
    if path is not None and picture is None:
        print(f"no screen for a window (neither DISPLAY nor WAYLAND_DISPLAY is set): {path}")
    look(scene, run, path)


def materials(name: str | None = None, *, file: Path | None = None) -> None:
    """List the materials of granules; of one NAME every value with its range, source and how far to trust it.

    A file of your own, written alike, is named in a scene: materials = "mine.toml".

    Parameters
    ----------
    name
        A material; default all.
    file
        List those of your own in this file.
    """
    from .core.registry import did_you_mean
    from .laws.material import materials as shipped
    from .scene.own_materials import read_materials
    from .terminal.materials import show_material, show_materials

    known = {one: shipped[one] for one in shipped} if file is None else read_materials(file)
    if name is None:
        show_materials(known)
    elif name in known:
        show_material(name, known[name])
    else:
        raise SceneError(f"unknown material {name!r}{did_you_mean(name, list(known))} (known: {', '.join(known)})")


def _draw(path: Path, asked: Scene, scene: Path) -> None:
    """Draw what a scene file asks for, in the units that it writes."""
    from .report.sketch import write_sketch
    from .scene import units_written

    write_sketch(path, asked, units_written(scene))


def _open(path: Path) -> None:
    """Show a file in the program that the desktop has for it; where there is no screen, say so."""
    import webbrowser

    if not any(os.environ.get(name) for name in DISPLAYS) or not webbrowser.open(path.absolute().as_uri()):
        print(f"no screen to open it on: {path}")


LOOKING = (plan, view, materials)
