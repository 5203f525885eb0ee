"""What a run leaves in its folder next to result.json: the report, the field's files, a sample of granules."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..answer.result import FILE, GRANULES, JOINT, Request, Result, key_in
from ..core import own_files
from ..core.code_key import package_key
from ..core.record import to_json
from ..core.store import content_key
from ..core.tables import Columns
from ..flight.stages.pipeline import Pipeline
from ..flight.stages.solved_case import cells_of, forces_of
from ..planning.stage_cache import code_of, version_of
from ..scene import Scene

if TYPE_CHECKING:
    from ..flight.stages.landings import Landings, Tracked
    from ..show import AirAndTracks


# -- What answers are made for -----------------------------------------------------------------------------------------
PACKAGES = ("numpy", "scipy", "numba", "gmsh", "meshio", "foamlib", "pyvista")


@cache
def versions() -> dict[str, str]:
    """Versions of python and of the packages that answers rest on."""
    from importlib.metadata import PackageNotFoundError, version

    from .. import __version__

    installed = {"python": sys.version.split()[0], "wakeflow": __version__}
    for package in PACKAGES:
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "missing"
    return installed


def answer_key(scene: Scene, request: Request, *more: object) -> str:
    """What an answer is made for: the scene, the order of its tables, the request, whatever ``more`` there is, and all
    versions and sources.
    """
    order = [list(keyed) for keyed in (scene.body, scene.fraction, scene.bin)]
    return content_key(scene.tables(), order, to_json(request), *more, versions(), package_key())


# -- What a run leaves in its folder next to result.json ---------------------------------------------------------------
LOCK = ".lock"  # held by the run that writes
COMMAND = "run"
OF_EACH = "position", "bin", "diameter", "fate", "time", "impacts"  # of a granule that is kept


def refuse_foreign(folder: Path) -> None:
    """Raise SceneError where a run in ``folder`` would replace files that no run wrote; a result of an earlier version
    has no list of them.
    """
    if (folder / own_files.SUMS).exists() or key_in(folder) is None:
        own_files.refuse_foreign(folder, written_files(folder), COMMAND)


def written_files(folder: Path) -> list[Path]:
    """What is in ``folder`` of all that a run leaves or removes there."""
    from ..show import added_files, pictures_of, report_files

    drawn = (folder / "figures" / file for picture in pictures_of(folder).values() for file in picture.files)
    named = (folder / name for name in (FILE, GRANULES, JOINT, "figures/pictures.json"))
    return [*report_files(folder), *(path for path in (*named, *drawn, *added_files(folder)) if path.exists())]


def seen_of(pipeline: Pipeline, tracked: Tracked) -> AirAndTracks:
    """What the report shows of the air and the tracks, as soon as they are there."""
    from ..show import AirAndTracks

    if pipeline.scene.air is None:
        return AirAndTracks(pipeline.scene, None, None, tracked.drawn, None, None)
    air, (_, flow) = pipeline.airflow, pipeline.field
    return AirAndTracks(pipeline.scene, flow, air, tracked.drawn, cells_of(pipeline), forces_of(pipeline, air))


def drawn_ahead(pipeline: Pipeline, seen: AirAndTracks, *, pdf: bool) -> list[Path]:
    """Folders in the cache with what the report shows of the air and of these tracks: the field's files for ParaView,
    which all runs in this airflow share, and what all runs with these tracks do. ``pdf``: every figure as PDF too.
    """
    from ..show import draw_ahead
    from ..show.vtk import write_field

    scene, folders = pipeline.scene, list[Path]()
    if seen.field is not None:
        settings = scene.numerics.snapshots, scene.symmetric, version_of("pyvista")
        key = content_key("vtk", pipeline.field[0], *settings, code_of("show.vtk"))
        work = partial(write_field, field=seen.field, scene=scene, airflow=seen.airflow)
        folders.append(pipeline.cache.make("vtk", key, work))
    drawn_by = code_of("show.figures", "show.vtk"), version_of("pyvista"), version_of("matplotlib")
    key = content_key("drawings", pipeline.tracks_key, scene.tables(), pdf, *drawn_by)
    return [*folders, pipeline.cache.make("drawings", key, partial(draw_ahead, seen=seen, pdf=pdf))]


def report_into(
    pipeline: Pipeline,
    seen: AirAndTracks,
    answer: Mapping[str, Landings],
    granules: Columns,
    result: Result,
    *,
    pdf: bool,
) -> None:
    """Draw the report of a run into its folder; ``seen``: the air and the tracks, ``answer``: all landings,
    ``granules``: the sample of them that is kept; ``pdf``: every figure as PDF too.
    """
    from ..show import Landed, Outcome, write_report

    ahead = drawn_ahead(pipeline, seen, pdf=pdf)
    pipeline.listener("report", "drawing")
    landings = {
        name: Landed(landed.position[:, 0], landed.position[:, 1], landed.mass_shares, landed.bin)
        for name, landed in answer.items()
    }
    shown = {name: pipeline.shown(picture) for name, picture in pipeline.scene.picture.items()}
    outcome = Outcome(**vars(seen), landings=landings, result=result, shown=shown, granules=granules)
    write_report(result.folder, outcome, ahead, pdf=pdf)
    pipeline.listener("report", "done")


def some_granules(scene: Scene, landings: Mapping[str, Landings]) -> Columns:
    """A fixed subsample of at most numerics.keep granules a fraction, as columns; shares use all of them."""
    rows: dict[str, list[np.ndarray]] = {}
    mass = scene.mass_shares()
    for index, (name, landing) in enumerate(landings.items()):
        count = len(landing.bin)
        kept = np.unique(np.linspace(0, count - 1, min(count, scene.numerics.keep)).astype(int))
        columns = {
            "fraction": np.full(len(kept), index),
            "weight": mass[name] * landing.mass_shares[kept] / landing.mass_shares[kept].sum(),
            **{field: getattr(landing, field)[kept] for field in OF_EACH},
        }
        for field, values in columns.items():
            rows.setdefault(field, []).append(values)
    return {name: np.concatenate(parts) for name, parts in rows.items()}
