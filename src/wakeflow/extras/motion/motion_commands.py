"""The commands for what moves: view, animate."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from ...cli.options import Picture, Quiet, Settings, next_to
from ...core.errors import SceneError
from ...scene.overrides import changes_of
from ...show.screen import has_screen

MAX_SPAN = 3600.0  # s of the machine's time in a film
PLAIN = re.compile(r"[0-9.]+(e-?[0-9]+)?")  # a number alone


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
    from ...answer.result import Result
    from ...scene import Scene
    from .window import look

    run = what if what.is_dir() else None
    scene = Scene.parse(dict(Result.load(what).scene)) if run else Scene.load(what, changes_of(settings))
    path = picture or (None if has_screen() else next_to(what, "-view.png"))
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
    from ...answer.result import Result, key_in
    from ...core import own_files
    from ...core.store import bytes_of
    from .film import show_film

    path = out or run_folder / "figures" / f"film.{format_}"
    if path.suffix != f".{format_}":
        raise SceneError(f"--out {path}: name it *.{format_}, or ask for another --format")
    lasting, bytes_ = 0.0 if span is None else _seconds(span), bytes_of(most)
    film = partial(_film, run_folder, path, lasting, fractions, quiet=quiet, seconds=seconds, size=size, most=bytes_)
    if out is not None:
        film()
    else:
        result, page = Result.load(run_folder), run_folder / "report.html"
        own_files.claim(run_folder, [path], "animate")
        with own_files.writing(run_folder, lambda: [path], "animate"):
            film()
            if key_in(run_folder) != result.key:
                path.unlink()
                raise SceneError(f"{run_folder} holds another answer now; the same command films it")
            if page.name in own_files.listed(run_folder):
                show_film(run_folder, path)
                own_files.note(run_folder, [page])
    if not quiet:
        print(f"{path}, {path.stat().st_size / 1e6:.2g} MB")


def _film(run_folder: Path, path: Path, lasting: float, fractions: tuple[str, ...], *, quiet: bool, **how: Any) -> None:
    """Draw the film of a finished run, ``lasting`` so many seconds of the machine's time, 0: one long flight."""
    from ...runs.progress import live
    from .film import write_film
    from .film_stage import film_of

    with live(enabled=not quiet) as listener:
        scene, air, film = film_of(run_folder, lasting, fractions, listener)
        listener("film", "drawing")
        write_film(path, film, scene, air, **how)
        listener("film", "done")


def _seconds(span: str) -> float:
    """The option --span in s, a plain number or one with its unit."""
    from ...core.quantities import quantity

    try:
        lasting = float(span) if PLAIN.fullmatch(span) else quantity(span, "s", "0.2 s")
    except ValueError as problem:
        raise SceneError(f"--span {span!r}: {problem}") from None
    if not 0.0 < lasting <= MAX_SPAN:
        raise SceneError(f"--span {span!r}: must be positive, and an hour at most")
    return lasting
