"""The steady solution: iterate until what is measured stands still."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.files import write_json
from .case import FlowSpec
from .history import Tail, kind_of, read_vectors
from .segments import drop_after, ended_early, last_state, purge, run_segment
from .solver import PHASE
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
SEGMENT = 100  # iterations between two decisions: starting the solver anew costs as much as about twelve
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
    done = folder / PHASE
    if not done.exists():
        drop_after(folder, last_state(folder))
        if start is not None and not last_state(folder):
            start_from(spec, folder, start)
        watch = Watch(folder, "steady", listener, expected=TYPICAL_ITERATIONS)
        while not _is_over(spec, folder, most):
            end = min(max(WINDOW, last_state(folder) + SEGMENT), most)
            run_segment(folder, "simpleFoam", end, {"deltaT": 1}, watch, timeout)
            purge(folder)
        drag = Tail(folder).update()[:, 1]
        verdict = "steady" if ended_early(folder) else kind_of(drag[-WINDOW:], USABLE)
        write_json(done, {"phase": "done", "verdict": verdict})
    return str(json.loads(done.read_text())["verdict"])


def _is_over(spec: FlowSpec, folder: Path, most: int) -> bool:
    """Whether the iterations may end with the last segment."""
    if not last_state(folder):
        return False
    if ended_early(folder) or last_state(folder) >= most:
        return True
    return _stands_still(Tail(folder).update()[-WINDOW:]) and _wake_stands_still(folder, spec.speed)


def _stands_still(recent: Array) -> bool:
    drag, base = recent[:, 1], recent[:, 3]
    return bool(
        len(recent) == WINDOW
        and np.ptp(drag) <= STANDSTILL * abs(drag.mean())
        and np.ptp(base) <= STILL_BASE * max(abs(float(base.mean())), 1.0)
    )


def _wake_stands_still(folder: Path, speed: float) -> bool:
    """Whether no velocity on the wake's axis moved by more than STILL_WAKE of the inlet speed over the window; true
    without a record.
    """
    rows = read_vectors(folder, "wakeAxis")[-WINDOW:]
    return not len(rows) or bool(np.ptp(rows[:, 1:], axis=0).max() <= STILL_WAKE * speed)
