"""The commands that look at something: plan, view, animate, materials; and how a picture is opened."""

from __future__ import annotations

import json
import os
import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from ..core.errors import SceneError
from ..scene.overrides import changes_of
from .options import PACE, AsJson, Pace, Quiet, Settings, Stage, Threads, scene_and_folder

if TYPE_CHECKING:
    from ..scene import Scene

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # variables that name a screen
MAX_SPAN = 3600.0  # s of the machine's time in a film
PLAIN = re.compile(r"[0-9.]+(e-?[0-9]+)?")  # a number alone
Picture = Annotated[Path | None, Parameter(help="Where to draw it: PNG, SVG or PDF.")]


def plan(
    scene: Path,
    *,
    everything: Annotated[bool, Parameter(name="--all", negative="")] = False,
    picture: Picture = None,
    show: Annotated[bool, Parameter(name="--open", negative="")] = False,
    out: Path | None = None,
    until: Stage | None = None,
    workers: Threads = None,
    settings: Settings = (),
    gate: Pace = PACE,
    as_json: AsJson = False,
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
    from ..runs.planned import make_plan
    from ..scene import units_written
    from .show_plan import show_plan, show_whole_plan

    asked, folder = scene_and_folder(scene, settings, gate, out)
    how = gate.how
    if gate.quick:
        from ..runs.effort import quick_settings

        asked, how = quick_settings(asked, how)
    made = make_plan(asked, **how)
    if as_json:
        print(json.dumps(made.summary(), indent=2))
    elif everything:
        show_whole_plan(made)
    else:
        show_plan(made, asked, units_written(scene))
    if picture is not None or not as_json:
        _draw(picture or _next_to(folder, "-plan.png"), asked, scene, told=not as_json, show=show)


def _next_to(path: Path, ending: str) -> Path:
    """A file beside a scene or a folder, named after it."""
    named = path.resolve() if path.name in ("", "..") else path
    name = named.stem if named.suffix == ".toml" else named.name
    return named.parent / f"{name or 'scene'}{ending}"


def view(what: Path, *, picture: Picture = None, settings: Settings = ()) -> None:
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
    from ..answer.result import Result
    from ..scene import Scene
    from ..show.window import look

    run = what if what.is_dir() else None
    scene = Scene.parse(dict(Result.load(what).scene)) if run else Scene.load(what, changes_of(settings))
    screen = any(os.environ.get(name) for name in DISPLAYS)
    path = picture or (None if screen else _next_to(what, "-view.png"))
    if path is not None and picture is None:
        print(f"no screen for a window (neither DISPLAY nor WAYLAND_DISPLAY is set); drawn instead: {path}")
    look(scene, run, path)


def animate(
    run_folder: Path,
    *,
    out: Annotated[Path | None, Parameter(help="The film; default figures/film.gif in the run's folder.")] = None,
    format_: Annotated[Literal["gif", "mp4"], Parameter(name="--format")] = "gif",
    fractions: Annotated[tuple[str, ...], Parameter(name="--fraction", negative="")] = (),
    seconds: Annotated[float, Parameter(validator=Number(gt=0, lte=120))] = 8.0,
    span: Annotated[str | None, Parameter(help="Of the machine's time: '0.2 s'; default one long flight.")] = None,
    size: Annotated[int, Parameter(validator=Number(gte=200, lte=4000))] = 640,
    most: Annotated[str, Parameter(help="Bytes that a film may have; one that has more is drawn smaller.")] = "5MB",
    quiet: Quiet = False,
) -> None:
    """Make a film of a finished run: its granules through the moving wake past the vibrating body, as they come.

    Where granules meet each other, a thin slab is flown for it at the true feed rate, once. A film in the run's folder
    is on the page of the report too.

    Parameters
    ----------
    run_folder
        A folder that ``wakeflow run`` wrote.
    format_
        gif, or mp4: smaller and smoother, with imageio-ffmpeg installed.
    fractions
        Show this one alone; repeatable.
    seconds
        That the film plays.
    size
        Dots of its longer side.
    """
    from ..answer.result import Result, key_in
    from ..core import sums
    from ..core.store import bytes_of
    from ..show.film import show_film

    path = out or run_folder / "figures" / f"film.{format_}"
    if path.suffix != f".{format_}":
        raise SceneError(f"--out {path}: name it *.{format_}, or ask for another --format")
    lasting, bytes_ = None if span is None else _seconds(span), bytes_of(most)
    film = partial(_film, run_folder, path, lasting, fractions, quiet=quiet, seconds=seconds, size=size, most=bytes_)
    if out is not None:
        film()
    else:
        result, page = Result.load(run_folder), run_folder / "report.html"
        sums.claim(run_folder, [path], "animate")
        with sums.writing(run_folder, lambda: [path], "animate"):
            film()
            if key_in(run_folder) != result.key:
                path.unlink()
                raise SceneError(f"{run_folder} holds another answer now; the same command films it")
            if page.name in sums.listed(run_folder):
                show_film(run_folder, path)
                sums.note(run_folder, [page])
    if not quiet:
        print(f"{path}, {path.stat().st_size / 1e6:.2g} MB")


def _film(
    run_folder: Path, path: Path, lasting: float | None, fractions: tuple[str, ...], *, quiet: bool, **how: Any
) -> None:
    """Draw the film of a finished run, ``lasting`` so many seconds of the machine's time."""
    from ..runs import film_of
    from ..runs.progress import live
    from ..show.film import write_film

    with live(enabled=not quiet) as listener:
        scene, air, film = film_of(run_folder, lasting, fractions, listener)
        listener("film", "drawing")
        write_film(path, film, scene, air, **how)
        listener("film", "done")


def materials(name: str | None = None, *, file: Path | None = None, new: Path | None = None) -> None:
    """List the materials of granules; of one NAME every value with its range, source and how far to trust it.

    A file of your own, written alike, is named in a scene: materials = "mine.toml".

    Parameters
    ----------
    name
        A material; default all.
    file
        List those of your own in this file.
    new
        Write a commented file with a material of your own there, to fill in.
    """
    from ..laws.material import materials as shipped
    from ..laws.material import near_material, write_own_material
    from ..scene.own_files import read_materials
    from .show_stored import show_material, show_materials

    if new is not None:
        write_own_material(new)
        print(f'{new} written; fill it in, and name it in a scene: materials = "{new.name}"')
        return
    known = {one: shipped[one] for one in shipped} if file is None else read_materials(file)
    if name is None:
        show_materials(known)
    elif name in known:
        show_material(name, known[name])
    else:
        raise SceneError(f"unknown material {name!r}{near_material(name, list(known))} (known: {', '.join(known)})")


def _seconds(span: str) -> float:
    """The option --span in s, a plain number or one with its unit."""
    from ..core.quantities import quantity

    try:
        found = float(span) if PLAIN.fullmatch(span) else quantity(span, "s", "0.2 s")
    except ValueError as problem:
        raise SceneError(f"--span {span!r}: {problem}") from None
    if not 0.0 < found <= MAX_SPAN:
        raise SceneError(f"--span {span!r}: must be positive, and an hour at most")
    return found


def _draw(path: Path, asked: Scene, scene: Path, *, told: bool, show: bool) -> None:
    """Draw what a scene file asks for, in the units that it writes; print the picture's path, and open it."""
    from ..scene import units_written
    from ..show.sketch import write_sketch

    write_sketch(path, asked, units_written(scene))
    if told:
        print(f"drawing: {path}")
    if show:
        _open(path)


def _open(path: Path) -> None:
    """Show a file in the program that the desktop has for it; where there is no screen, say so."""
    import webbrowser

    if not any(os.environ.get(name) for name in DISPLAYS) or not webbrowser.open(path.absolute().as_uri()):
        print(f"no screen to open it on: {path}")


COMMANDS = (plan, view, animate, materials)
