"""The steady solution: iterate until what is measured stands still."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.files import write_json
from ..core.process import tail
from .case import FlowSpec, write_parameters
from .case_fields import time_folders
from .history import Tail, kind_of, read_vectors
from .solver import PHASE, SAVE_EVERY, run_solver
from .start import start_from
from .watch import ProgressListener, Watch

__all__ = ["WINDOW", "run_steady"]

Array = NDArray[np.float64]
# A steady run ends when over its last WINDOW iterations nothing that is measured moved by more than these. Chosen: well
# below what meshes differ by (per cent), reached by sound meshes within some hundred iterations.
WINDOW = 300  # iterations: several times as many as a change of pressure takes through the channel
STANDSTILL = 2e-4  # range of Cd over its mean
STILL_BASE = 1e-3  # range of the base pressure coefficient over its mean, or over 1 where that is smaller
STILL_WAKE = 5e-3  # range of the velocities along the wake's axis over the inlet speed
USABLE = 0.01  # range of Cd over its mean that still counts as steady after the last iteration allowed
SPARE_ITERATIONS = 1000  # beyond the most asked for: the file "stop", not OpenFOAM's endTime, ends a run
TYPICAL_ITERATIONS = 900  # of a steady run to its end: what the time left is estimated from


def run_steady(
    spec: FlowSpec,
    folder: Path,
    *,
    start: Path | None = None,
    listener: ProgressListener = lambda _: None,
    most: int = 3000,
    timeout: float | None = None,
) -> str:
    """Iterate simpleFoam until what is measured stands still or ``most`` iterations; go on from what is there, or from
    ``start`` (another solved case). Returns the verdict.

    Standing still, over the last 300 iterations: Cd within 2e-4, base pressure within 1e-3 (of the dynamic pressure at
    least), the velocities along the wake's axis (and with them the reversal length) within 0.5 % of the inlet speed.
    "steady" when Cd moved by less than 1 % over those iterations; else how it moves: "periodic" or "broadband" (then
    the flow asks for the time-resolved rung; nothing has failed).
    """
    wake = _Wake(folder, spec.speed)

    def finished(rows: Array) -> bool:
        return bool(rows[-1, 0] >= most or (_stands_still(rows[-WINDOW:]) and wake.stands_still()))

    done = folder / PHASE
    if not done.exists():
        if start is not None and not time_folders(folder):
            start_from(spec, folder, start)
        write_parameters(folder, {
            "startFrom": "latestTime", "endTime": most + SPARE_ITERATIONS, "deltaT": 1, "writeControl": "clockTime",
            "writeInterval": SAVE_EVERY, "purgeWrite": 2,
        })  # fmt: skip
        watch = Watch(folder, "steady", listener, finished, expected=TYPICAL_ITERATIONS)
        run_solver(folder, "simpleFoam", watch, timeout)
        drag = Tail(folder).update()[:, 1]
        converged = "solution converged" in tail(folder / "log.simpleFoam", 40)
        verdict = "steady" if converged else kind_of(drag[-WINDOW:], USABLE)
        write_json(done, {"phase": "done", "verdict": verdict})
    return str(json.loads(done.read_text())["verdict"])


def _stands_still(recent: Array) -> bool:
    drag, base = recent[:, 1], recent[:, 3]
    return bool(
        len(recent) == WINDOW
        and np.ptp(drag) <= STANDSTILL * abs(drag.mean())
        and np.ptp(base) <= STILL_BASE * max(abs(float(base.mean())), 1.0)
    )


class _Wake:
    """The velocities along the wake's axis that a steady run records."""

    def __init__(self, folder: Path, speed: float) -> None:
        self.folder, self.speed = folder, speed

    def stands_still(self) -> bool:
        """Whether none moved by more than STILL_WAKE of the inlet speed over the window; true without a record."""
        rows = read_vectors(self.folder, "wakeAxis")[-WINDOW:]
        return not len(rows) or bool(np.ptp(rows[:, 1:], axis=0).max() <= STILL_WAKE * self.speed)
