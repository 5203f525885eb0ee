"""From a finished run: its report drawn anew, its film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..answer.result import Result, asked_in, refinement_in
from ..core.errors import SceneError
from ..core.registry import did_you_mean
from ..core.store import cache_in_use, cache_root
from ..planning.stage_cache import Listener, null_listener
from ..scene import Scene
from .one_run import run_once
from .run_stages import one_thread_of_blas, stages_of

if TYPE_CHECKING:
    from ..air.field import FlowField
    from ..flight.stages.film_stage import Film


def report_again(folder: Path | str, *, pdf: bool = False) -> Path:
    """Draw the report of a finished run anew, from its result.json and the cache, with ``pdf`` every figure as PDF too.
    Returns the path of report.html.

    Raises SceneError where the folder holds no finished run.
    """
    scene, asked = asked_in(folder)
    if (told := Result.load(folder).calibration) is not None:
        raise SceneError(
            f"{folder} holds an answer that was calibrated with {told.source}; wakeflow calibrate draws it anew"
        )
    run_once(Scene.parse(scene), Path(folder), asked, redraw=True, refinement=refinement_in(folder), pdf=pdf)
    return Path(folder) / "report.html"


def film_of(
    folder: Path | str,
    span: float | None = None,
    fractions: Sequence[str] = (),
    listener: Listener = null_listener,
) -> tuple[Scene, FlowField | None, Film]:
    """The scene of a finished run as it was flown, its air, and its granules over ``span`` (s), flown for a film; of
    all ``fractions``, or of those alone.

    What the run's own cache still holds is not computed again. Raises SceneError where the folder holds no such run,
    and for a fraction that it has not.
    """
    tables, asked = asked_in(folder)
    for name in fractions:
        if name not in tables["fraction"]:
            known = list(tables["fraction"])
            raise SceneError(f"unknown fraction {name!r}{did_you_mean(name, known)} (known: {', '.join(known)})")
    with cache_in_use(cache_root()), one_thread_of_blas():
        pipeline, _ = stages_of(Scene.parse(tables), asked, None, listener)
        air = None if pipeline.scene.air is None else pipeline.field[1]
        film = pipeline.film(span)
    return pipeline.scene, air, replace(film, paths={name: film.paths[name] for name in fractions or film.paths})
