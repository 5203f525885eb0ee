"""The steady solution: iterate until what is measured no longer changes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.files import write_json
from .case import FlowSpec
from .read import STATES, time_folders
from .solver import PHASE, drop_after, ended_early, last_state, purge, run_segment
from .start import start_from
from .statistics import Tail, kind_of, oscillation, read_vectors, spread
from .watch import ProgressListener, Watch

Array = NDArray[np.float64]
# A steady run ends when over its last WINDOW iterations nothing that is measured moved by more than these. Chosen: well
# below what meshes differ by (per cent), reached by sound meshes within some hundred iterations.
WINDOW = 300  # iterations: several times as many as a change of pressure takes through the channel
STANDSTILL = 2e-4  # range of Cd over its mean
STILL_BASE = 1e-3  # range of the base pressure coefficient over its mean, or over 1 where that is smaller
STILL_WAKE = 5e-3  # range of the velocities along the wake's axis over the inlet speed
USABLE = 0.01  # range of Cd over its mean that still counts as steady after the last iteration allowed
MOST = 3000  # iterations of a run that neither settles nor shows that it will not
SEGMENT = 100  # iterations between two decisions: starting the solver anew costs as much as about twelve
STATES_KEPT = 8  # of a run that does not settle. Chosen: phases of a swing, and a share of 16 replicates each
ROUNDING = 1e-12  # of a range over its mean: none
TYPICAL_ITERATIONS = 900  # of a steady run to its end: what the time left is estimated from at first


def run_steady(
    spec: FlowSpec,
    folder: Path,
    *,
    start: Path | None = None,
    listener: ProgressListener = lambda _: None,
    most: int = MOST,
) -> str:
    """Iterate simpleFoam until what is measured no longer changes, until it is clear that it will not, or ``most``
    iterations; go on from what is there, or from ``start`` (another solved case). Returns the verdict.

    Standing still, over the last 300 iterations: Cd within 2e-4, base pressure within 1e-3 (of the dynamic pressure at
    least), the velocities along the wake's axis (and with them the reversal length) within 0.5 % of the inlet speed.
    "steady" when Cd moved by less than 1 % over those iterations; else how it moves: "periodic" or "broadband" (then
    the flow asks for the time-resolved rung; nothing has failed). Of a run that does not settle eight states are kept,
    spread over what it swings through, and listed in states.json (:func:`wakeflow.air.foam.read.late_states`): none of
    its iterations is the flow.
    """
    done = folder / PHASE
    watch = Watch(folder, "steady", listener, expected=min(TYPICAL_ITERATIONS, most))
    if not done.exists():
        drop_after(folder, last_state(folder))
        if start is not None and not last_state(folder):
            start_from(spec, folder, start)
        purge(folder)
        while not _is_over(spec, folder, most):
            end = min(max(WINDOW, last_state(folder) + SEGMENT), most)
            run_segment(folder, "simpleFoam", end, {"deltaT": 1}, watch)
            purge(folder)
            watch.expected = expected_end(Tail(folder).update()[:, 1], most)
        drag = Tail(folder).update()[:, 1]
        verdict = "steady" if ended_early(folder) else kind_of(drag[-WINDOW:], USABLE)
        settled = verdict == "steady" or len(drag) < 2 * WINDOW  # so few iterations do not tell how it moves
        late = {"begin": last_state(folder), "every": _apart(drag)}
        write_json(done, {"phase": "done" if settled else "late", "verdict": verdict, **({} if settled else late)})
    state = json.loads(done.read_text())
    if state["phase"] == "late":
        _keep_states(folder, state["begin"], state["every"], watch)
        write_json(done, {**state, "phase": "done"})
    return str(state["verdict"])


def _is_over(spec: FlowSpec, folder: Path, most: int) -> bool:
    """Whether the iterations may end with the last segment."""
    if not last_state(folder):
        return False
    if ended_early(folder) or last_state(folder) >= most:
        return True
    rows = Tail(folder).update()
    if _stands_still(rows[-WINDOW:]) and _wake_stands_still(folder, spec.speed):
        return True
    return _will_not_settle(rows[:, 1], most) and _will_not_settle(rows[:-SEGMENT, 1], most)


def _will_not_settle(drag: Array, most: int) -> bool:
    """Whether Cd (n,), a value an iteration, will still move by more than USABLE when ``most`` iterations are done.

    Its range over the last WINDOW iterations, beside that of the WINDOW before, says how fast it settles: runs that
    settle lose nine tenths of the range from one window to the next, those that do not less than a tenth. The first
    WINDOW iterations, the start, do not count. One look could meet a lull or a burst: it takes two, SEGMENT apart.
    """
    if len(drag) < 3 * WINDOW:
        return False
    now, before = spread(drag[-WINDOW:]), spread(drag[-2 * WINDOW : -WINDOW])
    if now <= USABLE:
        return False
    return bool(now * min(now / before, 1.0) ** ((most - len(drag)) / WINDOW) > USABLE)


def expected_end(drag: Array, most: int) -> float:
    """The iteration with which a run is likely to end, from Cd (n,) so far: as fast as its range falls now, or when
    it is clear that it will not settle, and the states of it are kept.
    """
    count = len(drag)
    if count < 3 * WINDOW:
        return max(TYPICAL_ITERATIONS, count + SEGMENT)
    if _will_not_settle(drag, most):
        return count + SEGMENT + STATES_KEPT * _apart(drag)
    now, before = (max(spread(part), ROUNDING) for part in (drag[-WINDOW:], drag[-2 * WINDOW : -WINDOW]))
    if now <= STANDSTILL:
        return count + SEGMENT
    windows = np.log(now / STANDSTILL) / np.log(before / now) if before > now else np.inf
    return float(min(max(count + SEGMENT, count + WINDOW * windows), most))


def _apart(drag: Array) -> int:
    """Iterations between the states to keep: between one and two WINDOWs divided by STATES_KEPT, as near as that allows
    to an odd number of eighths of the oscillation, so that eight states meet all its phases.
    """
    least, largest = WINDOW // STATES_KEPT + 1, 2 * WINDOW // STATES_KEPT
    length = oscillation(drag[-2 * WINDOW :])
    if not length:
        return largest
    eighths = 8.0 * np.arange(least, largest + 1) / length
    off = np.abs(eighths - 2.0 * np.floor(eighths / 2.0) - 1.0) / eighths
    return least + int(off.argmin())


def _keep_states(folder: Path, begin: float, every: int, watch: Watch) -> None:
    """Iterate on from ``begin`` and keep STATES_KEPT states, ``every`` so many iterations one."""
    end = watch.expected = begin + STATES_KEPT * every
    if not ended_early(folder):
        run_segment(folder, "simpleFoam", end, {"deltaT": 1, "writeInterval": every}, watch)
    purge(folder, STATES_KEPT)
    names = [path.name for path in time_folders(folder) if float(path.name) > begin]
    write_json(folder / STATES, {"begin": begin, "states": names})


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
