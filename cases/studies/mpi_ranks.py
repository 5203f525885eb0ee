"""Measure from how many cells a second MPI rank pays: the shipped rhombus' steady airflow on finer and finer meshes.

.venv/bin/python cases/studies/mpi_ranks.py runs/mpi-ranks [--quick]

Prints the table of docs/validation.md: seconds an iteration of simpleFoam on one rank and on two. A machine with
less than two idle cores says nothing about MPI.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from wakeflow.foam.case import FlowSpec, write_parameters
from wakeflow.foam.parallel import scatter
from wakeflow.foam.prepare import prepare_case
from wakeflow.foam.programs import call
from wakeflow.meshing import build_mesh
from wakeflow.pipeline.specs import flow_spec, mesh_spec
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene

SCALES = (0.7, 0.5, 0.4, 0.3)  # of every cell edge of the whole channel's draft
ITERATIONS, FIRST = 60, 10  # run, and left out
CASES = Path(__file__).parents[1]


@dataclass
class Clock:
    """Hears a solver's lines and notes when each iteration begins (s)."""

    beats: list[float] = field(default_factory=list)

    def __call__(self, line: str) -> None:
        if line.startswith("Time = "):
            self.beats.append(time.monotonic())

    @property
    def seconds(self) -> float:
        """Mean of an iteration: single ones are heard only every 50 ms."""
        return (self.beats[-1] - self.beats[FIRST]) / (len(self.beats) - 1 - FIRST)


def iteration(spec: FlowSpec, msh: Path, folder: Path) -> float:
    """Seconds of one iteration."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    prepare_case(spec, msh, folder)
    write_parameters(folder, {"endTime": ITERATIONS, "deltaT": 1, "writeControl": "timeStep", "writeInterval": 1000})
    launcher, options = scatter(folder)
    clock = Clock()
    call(folder, ["simpleFoam", *options], clock, launcher=launcher)
    return clock.seconds


def main(folder: Path, tell: Callable[[str], None] = print, scales: Sequence[float] = SCALES) -> None:
    """Tell the table's lines, a line a scale of the mesh; cases are made below ``folder``."""
    scene = Scene.load(CASES / "rhombus.toml")
    plan = make_plan(scene, rung="draft")
    tell("| cells | one rank, s an iteration | two ranks | gain |\n|---|---|---|---|")
    for scale in scales:
        finer = scene.replace({"numerics.mesh_scale": scale})
        mesh = replace(mesh_spec(finer, plan), half=False)
        here = folder / f"{scale:g}"
        cells = build_mesh(mesh, here).cells
        spec = flow_spec(finer, plan, mesh)
        one, two = (iteration(replace(spec, ranks=ranks), here / "mesh.msh", here / "case") for ranks in (1, 2))
        tell(f"| {cells} | {one:.3f} | {two:.3f} | {one / two:.2f} |")


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--quick"]
    main(Path((given or ["runs/mpi-ranks"])[0]), scales=(2.0,) if "--quick" in sys.argv else SCALES)
