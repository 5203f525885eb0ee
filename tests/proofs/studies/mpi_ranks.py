"""From how many cells a second MPI rank pays: the shipped rhombus' steady airflow on finer and finer meshes.

Seconds an iteration of simpleFoam on one rank and on two. A machine with less than two idle cores says nothing about
MPI. docs/validation.md.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from support import shipped
from wakeflow.foam.case import FlowSpec, write_parameters
from wakeflow.foam.programs import call, scatter
from wakeflow.meshing import build_mesh
from wakeflow.pipeline.specs import flow_spec, mesh_spec

from .common import Row, fresh_case, make_plan, show

SCALES = (0.7, 0.5, 0.4, 0.3)  # of every cell edge of the whole channel's draft
ITERATIONS, FIRST = 60, 10  # run, and left out
COLUMNS = {
    "cells": "{cells}", "one rank, s an iteration": "{one:.3f}", "two ranks": "{two:.3f}", "gain": "{gain:.2f}"
}  # fmt: skip


@dataclass
class Clock:
    """Hears a solver's lines and notes when each iteration begins (s)."""

    beats: list[float] = field(default_factory=list)

    def __call__(self, line: str) -> None:
        if line.startswith("Time = "):
            self.beats.append(time.monotonic())


def iteration(spec: FlowSpec, msh: Path, case: Path) -> float:
    """Seconds of one iteration, their mean: single ones are heard only every 50 ms."""
    fresh_case(spec, msh, case)
    write_parameters(case, {"endTime": ITERATIONS, "deltaT": 1, "writeControl": "timeStep", "writeInterval": 1000})
    launcher, options = scatter(case)
    clock = Clock()
    call(case, ["simpleFoam", *options], clock, launcher=launcher)
    return (clock.beats[-1] - clock.beats[FIRST]) / (len(clock.beats) - 1 - FIRST)


def rows(folder: Path, scales: Sequence[float]) -> Iterator[Row]:
    """A row a scale of the mesh; cases are made below ``folder``."""
    plan = make_plan(shipped("rhombus"), rung="draft")
    for scale in scales:
        finer, here = shipped("rhombus", {"numerics.mesh_scale": scale}), folder / f"{scale:g}"
        mesh = replace(mesh_spec(finer, plan), half=False)
        cells, spec = build_mesh(mesh, here).cells, flow_spec(finer, plan, mesh)
        one, two = (iteration(replace(spec, ranks=n), here / "mesh.msh", here / "case") for n in (1, 2))
        yield {"cells": cells, "one": one, "two": two, "gain": one / two}


def main(folder: Path = Path("runs/mpi-ranks"), *, quick: bool = False) -> list[Row]:
    """Seconds an iteration on one MPI rank and on two."""
    return show(COLUMNS, rows(folder, (2.0,) if quick else SCALES))
