"""The reference of the benchmark: the same equation of motion on the same interpolant, integrated to errors far below
every error that is measured.

Within one triangle, and between two snapshots, the field is affine in place and time, so a step that ends at every
triangle's edge, snapshot and wall meets no kinks: classical Runge-Kutta (:mod:`.rk4`) keeps its fourth order, and steps
that are short enough leave nothing but rounding. It shares with the tracker the drag law's table, the geometry of walls
and the collision function, and no step; scipy's Radau agrees with it (``tests/proofs``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.tracker.rk4 import Ends, fly_explicit
from wakeflow.air.field import FlowField
from wakeflow.flight import Body, Granules
from wakeflow.laws.constants import GRAVITY
from wakeflow.laws.drag import relaxation_time

STEP = 5e-5  # s, longest of the reference
OF_RELAXATION = 0.05  # longest step over a granule's relaxation time


@dataclass(frozen=True)
class TrackingProblem:
    """What every tracker solves: field, bodies at rest, ``until`` (s), drag law, forces and gravity (m/s2)."""

    field: FlowField
    bodies: tuple[Body, ...]
    until: float
    length: float  # m, unit of errors
    drag: str = "putnam"
    forces: tuple[str, ...] = ("drag", "gravity", "buoyancy")
    gravity: tuple[float, float] = (0.0, -GRAVITY)

    @property
    def arguments(self) -> dict[str, Any]:
        """Those of ``track`` and ``fly_explicit``, but for the field, granules and accuracy."""
        names = ("until", "length", "drag", "forces", "bodies", "gravity")
        return {name: getattr(self, name) for name in names}


def fly_reference(problem: TrackingProblem, grains: Granules, *, step: float = STEP, seconds: float = math.inf) -> Ends:
    """Integrate every granule until it leaves the mesh, with steps of ``step`` (s) at most; ``seconds`` bounds the run
    time. Granules that are not done by then, still fly at the end or began to slide have not landed.
    """
    relaxed = OF_RELAXATION * relaxation_time(grains.diameter, grains.density, problem.field.viscosity)
    steps: NDArray[np.float64] = np.minimum(step, relaxed)
    return fly_explicit(problem.field, grains, step=steps, confined=True, seconds=seconds, **problem.arguments)
