"""What the granules' force on the air does, pass by pass, in the steady airflow and in the answer's own.

.venv/bin/python cases/studies/air_loading.py [SCENE.toml] [--both]

Prints the tables of docs/model.md, Air that feels the granules: for every pass the force given to the air, the drag
coefficient, the air's speed on the body's axis one width before it, and for each fraction its share in the bin that the
force moves most; then the same shares in the answer's own airflow, without the force and with it. --both solves the
time-resolved end under the last force as well, which the program does not do, and flies in the wake between both loaded
ends: what the answer misses by taking the change of the steady end for that of both. Some minutes of two cores with the
airflows, --both some more.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from wakeflow.core.boxes import ForceDensity
from wakeflow.core.errors import known
from wakeflow.core.record import load
from wakeflow.field import FlowField, blended_wake
from wakeflow.foam.airflow import solve_airflow
from wakeflow.foam.airflow_result import AirflowResult
from wakeflow.foam.momentum_source import SOURCE, write_source
from wakeflow.foam.prepare import prepare_case
from wakeflow.pipeline.air_loading import AirLoading
from wakeflow.pipeline.case_field import case_field
from wakeflow.pipeline.landings import load_tracked
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.solved_air import TimeResolvedAir
from wakeflow.pipeline.track_stage import Companion
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.plan import COMPARED
from wakeflow.results.air_loading import fly_unloaded
from wakeflow.results.companions import Shares, shares_of

RHOMBUS = Path(__file__).parents[1] / "rhombus.toml"
Row = tuple[Any, ...]


def table(head: Row, rows: Iterator[Row]) -> None:
    """Print rows as Markdown."""
    print(f"| {' | '.join(map(str, head))} |")
    print("|---" * len(head) + "|")
    for row in rows:
        cells = (cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row)
        print(f"| {' | '.join(cells)} |", flush=True)


def axis_speed(scene: wf.Scene, field: FlowField) -> float:
    """Speed (m/s) of the air one body width before the first body, on its axis."""
    outline = next(iter(scene.body.values())).outline()
    assert scene.air is not None
    before = outline[:, 1].max() if scene.air.direction == "down" else outline[:, 1].min()
    place = before + scene.width * (1.0 if scene.air.direction == "down" else -1.0)
    return float(abs(field.sample([[outline[:, 0].mean(), place]])[0][0, 1]))


def most_moved(scene: wf.Scene, loading: AirLoading) -> dict[str, tuple[str, int]]:
    """For each fraction the name and number of the bin whose share all passes together move most."""
    first, last = loading.first.shares, loading.passes[-1].gathered.shares
    moved = {name: np.abs(np.subtract(last[name], first[name])) for name in first}
    names = [*scene.bin, "elsewhere"]
    return {name: (names[int(found.argmax())], int(found.argmax())) for name, found in moved.items()}


def passes(pipeline: Pipeline, bins: Mapping[str, tuple[str, int]]) -> Iterator[Row]:
    """The steady airflow, pass by pass."""
    loading, scene = pipeline.loading, pipeline.scene
    assert loading is not None
    both = 2.0 if loading.steady.half else 1.0

    def shares(found: Mapping[str, list[float]]) -> list[float]:
        return [100 * found[name][number] for name, (_, number) in bins.items()]

    bare = loading.steady.measured
    field = loading.steady.field
    assert field is not None
    yield "0", 0.0, known(bare.cd).value, axis_speed(scene, field[1]), *shares(loading.first.shares)
    for number, one in enumerate(loading.passes, 1):
        measured = load(AirflowResult, one.folder / "case" / "airflow.json")
        given = both * json.loads((one.folder / "case" / SOURCE).read_text())["force"][1]
        speed = axis_speed(scene, loading.field_in(one.folder))
        yield str(number), given, known(measured.cd).value, speed, *shares(one.gathered.shares)


def solved_both(pipeline: Pipeline, force: ForceDensity, folder: Path) -> FlowField:
    """The wake between both ends, each solved under ``force``; the time-resolved one in ``folder``."""
    air, loading = pipeline.kind, pipeline.loading
    assert isinstance(air, TimeResolvedAir)
    assert loading is not None
    spec, case = air.solved_spec, folder / "case"
    case.mkdir(parents=True, exist_ok=True)
    msh = air.mesh[1] / "mesh.msh"
    prepare_case(spec, msh, case)
    write_source(case, force, spec.density)
    last = loading.passes[-1].folder
    solved = solve_airflow(spec, msh, case, start=last / "case")
    loaded = case_field(case, solved.field_time, spec.density, half=False)
    wake = pipeline.plan.airflow.wake
    theta, strength = (1.0, 1.0) if wake is None else (wake.theta.value, wake.strength.value)
    return blended_wake(loaded, loading.field_in(last), theta, strength)


def flown(pipeline: Pipeline, field: FlowField, folder: Path) -> Shares:
    """Shares of the granules of a comparison in ``field``."""
    scene = pipeline.scene
    folder.mkdir(parents=True, exist_ok=True)
    airs = Realisations(field, cycles=pipeline.kind.realisations.cycles)
    flight = Flight(scene, pipeline.plan, airs, scene.numerics.tolerance, replicates=COMPARED)
    flight.fly_all(folder, drawn=False)
    return shares_of(pipeline, load_tracked(folder, scene))


def answers(pipeline: Pipeline, bins: Mapping[str, tuple[str, int]], both: Path | None) -> Iterator[Row]:
    """The shares in the answer's airflow: without the force, with the steady end's change, with both ends solved."""
    same = Companion("tracks of the comparison")  # the granules of a comparison, in the answer's own air
    effect = fly_unloaded(pipeline, pipeline.tracks(same))
    assert effect is not None
    found = {"without": effect.without, "with the steady end's change": effect.loaded}
    if both is not None:
        assert pipeline.loading is not None
        field = solved_both(pipeline, pipeline.loading.passes[-1].force, both)
        found["with both ends solved"] = flown(pipeline, field, both / "tracks")
    for told, shares in found.items():
        yield told, *(100 * float(shares[name][:, number].mean()) for name, (_, number) in bins.items())


def main(scene: wf.Scene, rung: str | None = None, both: Path | None = None, **options: Any) -> None:
    """Print both tables; ``both``: a folder for the time-resolved end under the force; ``options`` of ``wf.plan``."""
    plan = wf.plan(scene, rung=rung, **options)
    pipeline = Pipeline(scene, replace(plan, airflow=replace(plan.airflow, loaded=True)), workers=None)
    assert pipeline.loading is not None
    bins = most_moved(scene, pipeline.loading)
    names = [f"{name} in {place}, %" for name, (place, _) in bins.items()]
    table(("pass", "force, N/m", "Cd", "speed 1 D before the body, m/s", *names), passes(pipeline, bins))
    print()
    table(("airflow", *names), answers(pipeline, bins, both))
    print()
    table(("stage", "s"), ((str(stage), spent.seconds) for stage, spent in pipeline.seconds.items()))


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--both"]
    into = Path("runs", "air-loading") if "--both" in sys.argv else None
    main(wf.Scene.load(words[0] if words else RHOMBUS), both=into)
