"""What the granules' force on the air does, pass by pass, in the steady airflow and in the answer's own.

For every pass the force given to the air, the drag coefficient, the air's speed on the body's axis one width before it,
and for each fraction its share in the bin that the force moves most; then these shares in the answer's own airflow,
without the force and with it. --both solves the time-resolved end under the last force as well, which the program does
not do, and flies in the wake between both loaded ends: what the answer misses by taking the change of the steady end
for that of both. Some minutes of two cores with the airflows, --both some more; docs/model.md.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from support import CASES
from wakeflow.budget.air_loading import UNLOADED
from wakeflow.budget.comparison import Shares, shares_of
from wakeflow.core.geometry import ForceDensity
from wakeflow.core.record import load
from wakeflow.field import FlowField, blended_wake
from wakeflow.foam.airflow import solve_airflow
from wakeflow.foam.airflow_result import AirflowResult
from wakeflow.foam.momentum_source import SOURCE, write_source
from wakeflow.foam.prepare import prepare_case
from wakeflow.pipeline.air_loading import AirLoading
from wakeflow.pipeline.case_field import case_field
from wakeflow.pipeline.landings import load_tracked
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.track_stage import Companion
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.plan import COMPARED

from .common import Pipeline, Row, show

PASSES = {
    "pass": "{number}", "force, N/m": "{force:.4g}", "Cd": "{cd:.4g}", "speed 1 D before the body, m/s": "{speed:.4g}",
}  # fmt: skip
Moved = Mapping[str, tuple[str, int]]  # by fraction: a bin and its number


def axis_speed(scene: wf.Scene, field: FlowField) -> float:
    """Speed (m/s) of the air one body width before the first body, on its axis."""
    outline, down = next(iter(scene.body.values())).outline(), scene.air.direction == "down"
    place = outline[:, 1].max() + scene.width if down else outline[:, 1].min() - scene.width
    return float(abs(field.sample([[outline[:, 0].mean(), place]])[0][0, 1]))


def most_moved(scene: wf.Scene, loading: AirLoading) -> Moved:
    """For each fraction the name and number of the bin whose share all passes together move most."""
    first, last = loading.first.shares, loading.passes[-1].gathered.shares
    numbers = {name: int(np.abs(np.subtract(last[name], first[name])).argmax()) for name in first}
    return {name: ([*scene.bin, "elsewhere"][number], number) for name, number in numbers.items()}


def passes(pipeline: Pipeline, bins: Moved) -> Iterator[Row]:
    """The steady airflow, pass by pass."""
    loading, scene = pipeline.loading, pipeline.scene
    both = 2.0 if loading.steady.half else 1.0

    def row(number: int, force: float, cd: float, field: FlowField, found: Mapping[str, list[float]]) -> Row:
        shares = {name: 100 * found[name][place] for name, (_, place) in bins.items()}
        return {"number": number, "force": force, "cd": cd, "speed": axis_speed(scene, field), **shares}

    steady = loading.steady
    yield row(0, 0.0, steady.measured.cd.value, steady.field[1], loading.first.shares)
    for number, one in enumerate(loading.passes, 1):
        cd = load(AirflowResult, one.folder / "case" / "airflow.json").cd.value
        given = both * json.loads((one.folder / "case" / SOURCE).read_text())["force"][1]
        yield row(number, given, cd, loading.field_in(one.folder), one.gathered.shares)


def solved_both(pipeline: Pipeline, force: ForceDensity, folder: Path) -> FlowField:
    """The wake between both ends, each solved under ``force``; the time-resolved one in ``folder``."""
    air, loading = pipeline.kind, pipeline.loading
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
    scene, airs = pipeline.scene, Realisations(field, cycles=pipeline.kind.realisations.cycles)
    folder.mkdir(parents=True, exist_ok=True)
    Flight(scene, pipeline.plan, airs, scene.numerics.tolerance, replicates=COMPARED).fly_all(folder, drawn=False)
    return shares_of(pipeline, load_tracked(folder, scene))


def answers(pipeline: Pipeline, bins: Moved, both: Path | None) -> Iterator[Row]:
    """The shares in the answer's airflow: without the force, with the steady end's change, with both ends solved."""
    effect = UNLOADED.fly(pipeline, pipeline.tracks(Companion("tracks of the comparison")))
    found = {"without": effect.without, "with the steady end's change": effect.loaded}
    if both is not None:
        field = solved_both(pipeline, pipeline.loading.passes[-1].force, both)
        found["with both ends solved"] = flown(pipeline, field, both / "tracks")
    for title, shares in found.items():
        means = {name: 100 * float(shares[name][:, number].mean()) for name, (_, number) in bins.items()}
        yield {"airflow": title, **means}


def tables(scene: wf.Scene, both: Path | None = None, **options: Any) -> tuple[list[Row], list[Row]]:
    """Print both tables; ``both``: a folder for the time-resolved end under the force; ``options`` of ``wf.plan``."""
    plan = wf.plan(scene, **options)
    pipeline = Pipeline(scene, replace(plan, airflow=replace(plan.airflow, loaded=True)), workers=None)
    bins = most_moved(scene, pipeline.loading)
    shares = {f"{name} in {place}, %": f"{{{name}:.4g}}" for name, (place, _) in bins.items()}
    first = show({**PASSES, **shares}, passes(pipeline, bins))
    print()
    second = show({"airflow": "{airflow}", **shares}, answers(pipeline, bins, both))
    print()
    spent = ({"stage": stage, "seconds": took.seconds} for stage, took in pipeline.seconds.items())
    show({"stage": "{stage}", "s": "{seconds:.4g}"}, spent)
    return first, second


def main(scene: Path = CASES / "rhombus.toml", *, both: bool = False) -> None:
    """What the granules' force on the air does."""
    tables(wf.Scene.load(scene), both=Path("runs", "air-loading") if both else None)
