"""Measure what the shipped rhombus' time-resolved airflow costs, and its error, with other steps, cells and solvers:

.venv/bin/python cases/studies/time_resolved_cost.py runs/time-resolved-cost [VARIANT ...] [--quick]

Prints the table of docs/validation.md. Every variant runs the same flow time from the same shedding wake, the program's
own, and is averaged over the same whole periods at its end; +- is the standard error over them. Cost is the solver's
processor time (user), not the wall's: what else the machine does hardly counts.
"""

from __future__ import annotations

import resource
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import wakeflow as wf
from wakeflow.foam.case import FlowSpec, write_parameters
from wakeflow.foam.history import Tail
from wakeflow.foam.prepare import prepare_case
from wakeflow.foam.programs import call
from wakeflow.foam.start import first_step, start_from
from wakeflow.foam.statistics import cycles
from wakeflow.meshing import build_mesh
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.pipeline.specs import flow_spec, mesh_spec
from wakeflow.planning.make import make_plan

CASES = Path(__file__).parents[1]
SOLUTION = Path("system", "time-resolved", "fvSolution")
SETTLE, PERIODS = 2.0, 9.0  # shedding periods: left out, and run in all
PERIOD = 5.4  # convective times of one
QUICK = {"numerics.mesh_scale": 4.0}
HEAD = "| variant | cells | steps | core-s | Cd | Cl rms | Cp base | periods |\n" + "|---" * 8 + "|"


@dataclass(frozen=True)
class Variant:
    """What differs from the program's own: Courant number, outer correctors, every cell's edge, words of fvSolution."""

    courant: float = 4.0
    correctors: int = 1
    scale: float = 1.0
    corner: float = 1.0  # of the edge at sharp corners
    words: tuple[tuple[str, str], ...] = ()


VARIANTS = {
    "the program's own": Variant(),
    "Courant number 8": Variant(courant=8.0),
    "Courant number 8, two outer correctors": Variant(courant=8.0, correctors=2),
    "Courant number 2": Variant(courant=2.0),
    "cells 0.7 times as long": Variant(scale=0.7),
    "corner cells 1.6 times as long": Variant(corner=1.6),
    "pressure: one level of cells at a time": Variant(words=(("mergeLevels     2", "mergeLevels     1"),)),
    "one pressure correction": Variant(words=(("nCorrectors         2", "nCorrectors         1"),)),
}


def run(scene: wf.Scene, variant: Variant, start: Path, folder: Path) -> tuple[FlowSpec, int, float]:
    """Run one variant from the solved case ``start``: its airflow, number of cells, processor seconds."""
    finer = scene.replace({"numerics.mesh_scale": variant.scale * scene.numerics.mesh_scale})
    plan = make_plan(finer, rung="standard")
    mesh = mesh_spec(finer, plan)
    mesh = replace(mesh, h_corner=variant.corner * mesh.h_corner)
    spec = replace(flow_spec(finer, plan, mesh), max_courant=variant.courant)
    shutil.rmtree(folder, ignore_errors=True)
    cells, case = build_mesh(mesh, folder).cells, folder / "case"
    case.mkdir()
    prepare_case(spec, folder / "mesh.msh", case)
    start_from(spec, case, start)
    write_parameters(case, {
        "endTime": PERIODS * PERIOD * spec.convective_time, "deltaT": first_step(spec), "writeControl": "timeStep",
        "writeInterval": 10**8, "correctors": variant.correctors,
    })  # fmt: skip
    text = (case / SOLUTION).read_text()
    for here, instead in variant.words:
        assert here in text
        text = text.replace(here, instead)
    (case / SOLUTION).write_text(text)
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    call(case, ["pimpleFoam"])
    return spec, cells, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def row(name: str, spec: FlowSpec, cells: int, seconds: float, rows: NDArray[np.float64]) -> str:
    """The line of a variant whose history is ``rows``."""
    table = cycles(rows[rows[:, 0] > SETTLE * PERIOD * spec.convective_time])
    lift = np.sqrt(np.maximum(table[:, 4] - np.average(table[:, 3], weights=table[:, 1]) ** 2, 0.0))
    cells_of = [
        f"{np.average(values, weights=table[:, 1]):.3f} ± {values.std(ddof=1) / np.sqrt(len(values)):.3f}"
        for values in (table[:, 2], lift, table[:, 5])
    ]
    return f"| {name} | {cells} | {len(rows)} | {seconds:.0f} | {' | '.join(cells_of)} | {len(table)} |"


def main(
    folder: Path,
    names: Sequence[str] = (),
    tell: Callable[[str], None] = print,
    changes: dict[str, float] | None = None,
) -> None:
    """Tell the table's lines, one a variant; cases are made below ``folder``."""
    scene = wf.Scene.load(CASES / "rhombus.toml").replace(changes or {})
    start = Pipeline(scene, make_plan(scene, rung="standard")).solution[1] / "case"
    tell(HEAD)
    for number, name in enumerate(names or VARIANTS):
        here = folder / f"{number}"
        spec, cells, seconds = run(scene, VARIANTS[name], start, here)
        tell(row(name, spec, cells, seconds, Tail(here / "case").update()))


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--quick"]
    place = Path((given or ["runs/time-resolved-cost"])[0])
    main(place, given[1:], changes=QUICK if "--quick" in sys.argv else None)
