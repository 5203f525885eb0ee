"""run(): the pipeline, its budget and the report of one scene, in one folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .core.errors import SceneError
from .core.files import atomic_write, write_json
from .core.store import content_key, digest_files
from .injection.impact_loads import impact_loads
from .laws.momentum import momentum_pressure
from .pipeline.pipeline import Listener, Pipeline, silent
from .planning.make import make_plan
from .results.budget import fly_companions, make_budget, together
from .results.companions import airflow_on_grids
from .results.notices import _notices
from .results.separation import separate
from .scene import Scene

if TYPE_CHECKING:
    from .pipeline.landings import Tracked

__all__ = ["Result", "report_again", "run"]

SCHEMA = 1
PACKAGES = ("wakeflow", "numpy", "scipy", "numba", "gmsh", "meshio", "foamlib", "pyvista")


@dataclass(frozen=True)
class Result:
    """A finished run: its folder and what result.json holds."""

    folder: Path
    table: dict[str, Any]

    @property
    def separation(self) -> dict[str, Any]:
        """Bins, shares, purity, recovery and throughput."""
        return self.table["separation"]

    def share(self, fraction: str, place: str) -> tuple[float, float, float]:
        """Share of a fraction in a bin, by mass, with its 95 % interval: (value, low, high)."""
        row = self.separation["fractions"][fraction][place]
        return row["share"], row["low"], row["high"]


@dataclass(frozen=True)
class _Outcome:
    """What the report draws."""

    scene: Scene
    field: Any
    airflow: dict[str, Any] | None
    tracks: dict[str, list[dict[str, Any]]]
    landings: dict[str, dict[str, Any]]
    result: dict[str, Any]
    shown: dict[str, dict[str, list[dict[str, Any]]]]


def run(
    scene: Scene,
    out: Path | str = Path("runs", "scene"),
    *,
    until: str | None = None,
    rung: str | None = None,
    force: Mapping[str, bool] | None = None,
    target_error: float | None = None,
    workers: int | None = None,
    listener: Listener = silent,
    redraw: bool = False,
) -> Result:
    """Compute ``scene`` and write results to the folder ``out``; finished stages come from the cache.

    ``until`` stops after "funnel", "mesh", "airflow" or "tracks" (no separation then); ``rung``, ``force`` and
    ``target_error`` override the plan (``planning.make_plan``); ``workers`` threads track. ``listener(stage, text)``
    hears of progress; ``redraw`` draws a finished report anew.
    Raises SceneError for wrong input, ProgramError when Gmsh or OpenFOAM fails.
    """
    from filelock import FileLock, Timeout

    if until not in (None, "funnel", "mesh", "airflow", "tracks"):
        raise SceneError(f"until = {until!r}: choose funnel, mesh, airflow or tracks")
    if until == "funnel" and scene.funnel is None:
        raise SceneError("until = 'funnel': the scene has no [funnel] table")
    if workers is not None and workers < 1:
        raise SceneError(f"workers = {workers}: at least 1")
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"--out {folder}: is a file; name a folder")
    make = partial(make_plan, rung=rung, force=force, target_error=target_error)
    plan = make(scene)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", timeout=0):
            options = {"until": until, "rung": rung, "force": dict(force or {}), "target_error": target_error}
            pipeline = Pipeline(scene.flown(plan.rung), plan, listener, workers)
            poured = pipeline.funnel
            if poured is not None and until != "funnel":
                fed = _fed(scene, poured)
                plan = make(fed)  # its bounds on loading follow the rate
                pipeline = replace(pipeline, scene=fed.flown(plan.rung), plan=plan)
            return _run(scene, pipeline, poured, folder, options, redraw)
    except Timeout:
        raise SceneError(f"another run is writing to {folder}; wait for it or choose another --out") from None


def _fed(scene: Scene, poured: dict[str, Any]) -> Scene:
    """The scene with the funnel's rate as its feed's. Raises SceneError where it needs one and the flow stopped."""
    if poured["rate"] is None and scene.feed.rate is None:
        raise SceneError(
            f"funnel: the flow stops with {poured['left']} of {poured['beads']} beads inside; widen "
            "funnel.orifice, shake it harder (funnel.gamma) or give feed.rate"
        )
    return scene.fed(None if poured["rate"] is None else poured["rate"]["value"])


def _run(
    scene: Scene, pipeline: Pipeline, poured: dict[str, Any] | None, folder: Path, options: dict[str, Any], redraw: bool
) -> Result:
    """Make the stages that ``options`` ask for, then the report where it is not the one that stands there."""
    from . import report

    plan, target, until = pipeline.plan, folder / "result.json", options["until"]
    asked, scene = scene, pipeline.scene  # flown without its air at rung none, fed by its funnel
    order = [list(keyed) for keyed in (scene.body, scene.fraction, scene.bin)]
    table: dict[str, Any] = {
        "schema": SCHEMA,
        "scene": asked.tables(),
        "options": options,
        "plan": plan.summary(),
        "funnel": poured,
        "airflow": None,
    }
    tracked: Tracked | None = None
    if scene.air is not None and until != "funnel":
        if until not in ("mesh", "airflow") and plan.rung != "analytic":
            pipeline.compile_beside()
        table["mesh"] = pipeline.mesh_quality
        if until != "mesh":
            table["airflow"] = pipeline.airflow
            table["airflow"]["grids"] = airflow_on_grids(pipeline)
            table["airflow"]["momentum"] = _momentum(scene, table["airflow"]) if scene.body else None
    if until not in ("funnel", "mesh", "airflow"):
        tracked = pipeline.tracks()
        if table["airflow"] is not None:
            table["airflow"]["divergence"] = pipeline.divergence
            table["airflow"]["truncation"] = pipeline.truncation
        table["fates"] = tracked.fates
        table["met_by_law"] = tracked.injected
        table["impact"] = impact_loads(scene, plan)
    if tracked is not None and until is None:
        table["separation"] = separate(scene, tracked.landings)
        others = fly_companions(pipeline, tracked)
        table["bracket"] = None if others.airflows is None else others.airflows.table(list(scene.bin))
        table["budget"] = make_budget(pipeline, tracked, table["separation"], others)
    table["warnings"] = [*plan.warnings, *_notices(scene, pipeline, table, tracked)]
    table["warnings"] += together(table.get("budget", []), plan.target_error)
    table["seconds"] = pipeline.seconds
    table["versions"] = _versions()
    code = digest_files([Path(__file__).parent])
    made_for = (asked.tables(), order, plan.summary(), options)
    table["key"] = content_key(*made_for, pipeline.tracks_key if tracked else None, _versions(), code)
    stands = _key_of(target) == table["key"]
    if not stands:  # the new answer is there: the older one goes whole, so that no mixture is left
        target.unlink(missing_ok=True)
        report.clear(folder)
        (folder / "granules.npz").unlink(missing_ok=True)
    if tracked is not None:
        _save_granules(folder / "granules.npz", scene, tracked)
        if until is None and (redraw or not stands or not report.is_whole(folder, scene.picture)):
            _report(scene, pipeline, tracked, table, folder)
        table["pictures"] = report.pictures_of(folder)
    elif until == "funnel" and poured is not None:
        report.draw_discharge(folder / "figures" / "discharge.png", poured)
    write_json(target, table)
    return Result(folder, table)


def _report(scene: Scene, pipeline: Pipeline, tracked: Tracked, table: dict[str, Any], folder: Path) -> None:
    from .report import write_report

    pipeline.listener("report", "drawing")
    landings = {
        name: {
            "x": landing.position[:, 0],
            "y": landing.position[:, 1],
            "weight": np.broadcast_to(1.0 / len(landing.bin), landing.bin.shape),
            "bin": landing.bin,
        }
        for name, landing in tracked.landings.items()
    }
    flow = None if scene.air is None else pipeline.field[1]
    shown = {name: pipeline.shown(picture) for name, picture in scene.picture.items()}
    write_report(folder, _Outcome(scene, flow, table["airflow"], tracked.drawn, landings, table, shown))
    pipeline.listener("report", "done")


def report_again(folder: Path | str) -> Path:
    """Draw the report of a finished run anew, from its result.json and the cache. Returns the path of report.html."""
    source = Path(folder) / "result.json"
    try:
        table = json.loads(source.read_text())
        options, scene, _ = table["options"], table["scene"], table["separation"]
    except (FileNotFoundError, NotADirectoryError, json.JSONDecodeError, KeyError, TypeError):
        raise SceneError(f"{folder} holds no finished run; make one with: wakeflow run SCENE --out {folder}") from None
    target = options.get("target_error")
    run(Scene.parse(scene), folder, rung=options["rung"], force=options["force"], target_error=target, redraw=True)
    return Path(folder) / "report.html"


def _key_of(path: Path) -> str | None:
    """What the answer in ``path`` was made for; None when there is none."""
    try:
        key = json.loads(path.read_text())["key"]
    except (FileNotFoundError, json.JSONDecodeError, KeyError, TypeError):
        return None
    return key if isinstance(key, str) else None


def _versions() -> dict[str, str]:
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": sys.version.split()[0]}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def _momentum(scene: Scene, airflow: dict[str, Any]) -> dict[str, float]:
    """The paper's momentum model of the first body, for comparison: pressure on its front, and Cd with the computed
    base pressure.
    """
    assert scene.air is not None
    model = momentum_pressure(next(iter(scene.body.values())).outline(), scene.air.direction)
    return {"cp_front": model.front, "cd": model.drag(airflow["cp_base"]["value"])}


def _save_granules(path: Path, scene: Scene, tracked: Tracked) -> None:
    """A fixed subsample of at most numerics.keep granules a fraction; shares use all of them."""
    rows: dict[str, list[np.ndarray]] = {}
    mass = scene.mass_shares()
    for index, (name, landing) in enumerate(tracked.landings.items()):
        count = len(landing.bin)
        kept = np.unique(np.linspace(0, count - 1, min(count, scene.numerics.keep)).astype(int))
        columns = {
            "fraction": np.full(len(kept), index),
            "weight": np.full(len(kept), mass[name] / max(len(kept), 1)),
            **{
                field: getattr(landing, field)[kept]
                for field in ("position", "bin", "diameter", "fate", "time", "impacts")
            },
        }
        for field, values in columns.items():
            rows.setdefault(field, []).append(values)
    with atomic_write(path, "wb") as stream:
        columns = {name: np.concatenate(parts) for name, parts in rows.items()}
        np.savez(stream, names=np.array(list(tracked.landings)), **columns)
