"""What studies share: scenes on coarse meshes, pipelines, tables that print as they grow, caches, cases, pictures."""

from __future__ import annotations

import json
import resource
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from proofs.report import Column, Row, cell
from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.foam.start import prepare_case
from wakeflow.answer.separation import separate
from wakeflow.core.files import write_json
from wakeflow.flight.stages.compilation import compile_slab, compile_tracker
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.terms import COLLISIONS
from wakeflow.runs.planned import make_plan

__all__ = ["Pipeline", "Row", "compile_slab", "compile_tracker", "make_plan"]  # handed on

HOUR = 3600.0  # s; feed rates are printed in kg/h
COARSE: dict[str, dict[str, Any]] = {  # changes of shipped scenes whose airflow takes minutes, not hours
    "rhombus": {"numerics.rung": "draft", "numerics.mesh_scale": 2.0},
    "prism": {"numerics.mesh_scale": 2.0},
    "labyrinth": {"numerics.mesh_scale": 2.5},
    "aspirator": {},
    "vacuum": {},
}
BARE = {"air-loading": False}  # the same air, whatever flies in it
ALONE = {COLLISIONS: False, "basset-history": False, **BARE}  # in air that does not feel the granules
MEET = {COLLISIONS: True, "basset-history": False, **BARE}


def piped(scene: wf.Scene, rung: str | None = None, force: Mapping[str, Any] | None = None) -> Pipeline:
    """The pipeline of a scene by its plan."""
    return Pipeline(scene, make_plan(scene, rung=rung, force=force))


def separation(pipeline: Pipeline) -> Any:
    """Shares of granules that fly alone."""
    return separate(pipeline.scene, pipeline.tracks().landings)


def with_one_fraction(scene: wf.Scene, name: str, **feed: Any) -> wf.Scene:
    """The scene with one of its fractions; keys of ``feed`` that are None are left out."""
    tables = scene.tables()
    fed = {key: value for key, value in {**tables["feed"], **feed}.items() if value is not None}
    return wf.Scene.parse({**tables, "feed": fed, "fraction": {name: {**tables["fraction"][name], "mass_share": 1.0}}})


def collisions_of(landing: Any) -> float:
    """Collisions of a granule, the mean over the fraction's mass."""
    return float(landing.meetings @ landing.mass_shares)


# -- tables ------------------------------------------------------------------------------------------------------------


def show(columns: Mapping[str, Column] | Sequence[str], rows: Iterable[Row], title: str = "") -> list[Row]:
    """Print rows in Markdown, each as soon as it is there; returns them. ``columns`` as of ``proofs.report.Table``, or
    heads alone, under which rows hold their cells.
    """
    made = columns if isinstance(columns, Mapping) else {head: itemgetter(head) for head in columns}
    if title:
        print(f"\n{title}\n")
    print(f"| {' | '.join(made)} |\n|{'---|' * len(made)}", flush=True)
    found = []
    for row in rows:
        found.append(row)
        print(f"| {' | '.join(cell(column, row) for column in made.values())} |", flush=True)
    return found


def mean_and_error(values: Any, digits: int = 3, sign: str = "") -> str:
    """Mean and standard error of values, as text."""
    found = np.asarray(values, dtype=float)
    return f"{found.mean():{sign}.{digits}f} ± {found.std(ddof=1) / np.sqrt(len(found)):.{digits}f}"


# -- files, caches, cases ----------------------------------------------------------------------------------------------


def kept(path: Path, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What ``make`` returns, from the file ``path`` where it has been made: an interrupted study goes on."""
    if not path.exists():
        write_json(path, make())
    return dict(json.loads(path.read_text()))


def fresh_case(spec: FlowSpec, msh: Path, case: Path) -> Path:
    """An OpenFOAM case that is ready to run, whatever was in its folder."""
    shutil.rmtree(case, ignore_errors=True)
    case.mkdir(parents=True)
    prepare_case(spec, msh, case)
    return case


def solver_seconds() -> float:
    """Processor time (s, user) of all programs that have ended."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


@contextmanager
def picture(path: Path, panels: int, width: float, height: float) -> Iterator[Any]:
    """Axes side by side, saved at the end."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, panels, figsize=(width * panels, height), squeeze=False, sharey=True)
    yield axes[0]
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    pyplot.close(figure)
