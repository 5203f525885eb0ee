"""What a run leaves in its folder next to result.json: the report, the field's files, a sample of granules."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..air.kinds.airflow_table import Airflow
from ..answer.result import FILE, GRANULES, JOINT, Request, Result, key_in
from ..core import sums
from ..core.record import to_json
from ..core.sources import PACKAGE, code_key
from ..core.store import content_key, digest_files
from ..core.tables import Columns
from ..flight.stages.pipeline import Pipeline
from ..flight.stages.solved_case import cells_of, forces_of
from ..scene import Scene

if TYPE_CHECKING:
    from ..flight.stages.landings import Landings
    from ..show import Landed


# -- What answers are made for -----------------------------------------------------------------------------------------
PACKAGES = ("numpy", "scipy", "numba", "gmsh", "meshio", "foamlib", "pyvista")


@cache
def versions() -> dict[str, str]:
    """Of python and of the packages that answers rest on."""
    from importlib.metadata import PackageNotFoundError, version

    from .. import __version__

    found = {"python": sys.version.split()[0], "wakeflow": __version__}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def answer_key(scene: Scene, request: Request, *more: object) -> str:
    """What an answer is made for: the scene, the order of its tables, the request, whatever ``more`` there is, and all
    versions and sources.
    """
    order = [list(keyed) for keyed in (scene.body, scene.fraction, scene.bin)]
    return content_key(scene.tables(), order, to_json(request), *more, versions(), _sources())


@cache
def _sources() -> str:
    return digest_files([PACKAGE])


# -- What a run leaves in its folder next to result.json ---------------------------------------------------------------
LOCK = ".lock"  # held by the run that writes
COMMAND = "run"


def refuse_foreign(folder: Path) -> None:
    """Raise SceneError where a run in ``folder`` would replace files that no run wrote; a result of an earlier version
    has no list of them.
    """
    if (folder / sums.SUMS).exists() or key_in(folder) is None:
        sums.refuse_foreign(folder, written_files(folder), COMMAND)


def written_files(folder: Path) -> list[Path]:
    """What is in ``folder`` of all that a run leaves or removes there."""
    from ..show import films, pictures_of, report_files

    drawn = (folder / "figures" / file for picture in pictures_of(folder).values() for file in picture.files)
    own = [
        folder / FILE,
        folder / GRANULES,
        folder / JOINT,
        folder / "figures" / "pictures.json",
        *drawn,
        *films(folder),
    ]
    return [*report_files(folder), *(path for path in own if path.exists())]


def report_into(
    pipeline: Pipeline,
    drawn: Mapping[str, Sequence[Columns]],
    answer: Mapping[str, Landings],
    granules: Columns,
    result: Result,
    *,
    pdf: bool,
) -> None:
    """Draw the report of a run into its folder; ``drawn``: recorded tracks by fraction, ``answer``: all landings,
    ``granules``: the sample of them that is kept; ``pdf``: every figure as PDF too.
    """
    from ..show import Outcome, write_report

    pipeline.listener("report", "drawing")
    scene = pipeline.scene
    landings = {name: _landed(landing) for name, landing in answer.items()}
    flow = None if scene.air is None else pipeline.field[1]
    shown = {name: pipeline.shown(picture) for name, picture in scene.picture.items()}
    air = result.airflow
    cells, history = (None, None) if air is None else (cells_of(pipeline), forces_of(pipeline, air))
    outcome = Outcome(scene, flow, drawn, landings, result, shown, granules, cells, history)
    write_report(result.folder, outcome, field_files(pipeline, air), pdf=pdf)
    pipeline.listener("report", "done")


def field_files(pipeline: Pipeline, airflow: Airflow | None) -> Path | None:
    """The folder in the cache with the field's files for ParaView, which all runs in this airflow share; None without
    air.
    """
    from ..show.vtk import write_field

    scene = pipeline.scene
    if scene.air is None:
        return None
    upstream, flow = pipeline.field
    asked = scene.numerics.snapshots, scene.symmetric
    key = content_key("vtk", upstream, *asked, code_key("wakeflow.show.vtk.vtk_files"), versions()["pyvista"])

    def work(part: Path) -> None:
        write_field(part, flow, scene, airflow)

    return pipeline.cache.make("vtk", key, work)


def _landed(landing: Landings) -> Landed:
    from ..show import Landed

    return Landed(landing.position[:, 0], landing.position[:, 1], landing.mass_shares, landing.bin)


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
            **{
                field: getattr(landing, field)[kept]
                for field in ("position", "bin", "diameter", "fate", "time", "impacts")
            },
        }
        for field, values in columns.items():
            rows.setdefault(field, []).append(values)
    return {name: np.concatenate(parts) for name, parts in rows.items()}
