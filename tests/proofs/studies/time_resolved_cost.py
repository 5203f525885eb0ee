"""What the shipped rhombus' time-resolved airflow costs, and its error, with other steps, cells and solvers.

Every variant runs for one flow time from one shedding wake, the program's own, and is averaged over the whole periods
at its end; +- is the standard error over them. Cost is the solver's processor time (user), not the wall's: what else
the machine does hardly counts. docs/validation.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.foam.case import FlowSpec, write_parameters
from wakeflow.foam.history import Tail
from wakeflow.foam.programs import call
from wakeflow.foam.start import first_step, start_from
from wakeflow.foam.statistics import cycles
from wakeflow.meshing import build_mesh
from wakeflow.pipeline.specs import flow_spec, mesh_spec

from .common import Row, fresh_case, make_plan, piped, show, solver_seconds

SOLUTION = Path("system", "time-resolved", "fvSolution")
SETTLE, PERIODS = 2.0, 9.0  # shedding periods: left out, and run in all
PERIOD = 5.4  # convective times of one
COLUMNS = {
    "variant": "{variant}", "cells": "{cells}", "steps": "{steps}", "core-s": "{seconds:.0f}", "Cd": "{cd}",
    "Cl rms": "{lift}", "Cp base": "{base}", "periods": "{periods}",
}  # fmt: skip


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
    cells = build_mesh(mesh, folder).cells
    case = fresh_case(spec, folder / "mesh.msh", folder / "case")
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
    before = solver_seconds()
    call(case, ["pimpleFoam"])
    return spec, cells, solver_seconds() - before


def mean(values: np.ndarray, weights: np.ndarray) -> str:
    """Weighted mean and standard error."""
    return f"{np.average(values, weights=weights):.3f} ± {values.std(ddof=1) / np.sqrt(len(values)):.3f}"


def rows(scene: wf.Scene, names: Sequence[str], folder: Path) -> Iterator[Row]:
    """A row a variant; cases are made below ``folder``."""
    start = piped(scene, "standard").solution[1] / "case"
    for name in names:
        here = folder / f"{list(VARIANTS).index(name)}"
        spec, cells, seconds = run(scene, VARIANTS[name], start, here)
        history = Tail(here / "case").update()
        table = cycles(history[history[:, 0] > SETTLE * PERIOD * spec.convective_time])
        lengths = table[:, 1]
        lift = np.sqrt(np.maximum(table[:, 4] - np.average(table[:, 3], weights=lengths) ** 2, 0.0))
        found = (mean(values, lengths) for values in (table[:, 2], lift, table[:, 5]))
        yield {
            "variant": name, "cells": cells, "steps": len(history), "seconds": seconds, "periods": len(table),
            **dict(zip(("cd", "lift", "base"), found, strict=True)),
        }  # fmt: skip


def main(folder: Path = Path("runs/time-resolved-cost"), *variants: str, quick: bool = False) -> list[Row]:
    """Cost of a time-resolved airflow with other steps, cells and solvers."""
    scene = shipped("rhombus", {"numerics.mesh_scale": 4.0} if quick else {})
    return show(COLUMNS, rows(scene, variants or tuple(VARIANTS), folder))
