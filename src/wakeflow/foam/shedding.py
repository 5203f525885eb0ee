"""The time-resolved run: through the start-up, then a loop of snapshots over whole shedding periods."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FoamError
from ..files import write_json
from .case import FlowSpec, write_parameters
from .history import Tail, is_settled, upward_crossings
from .initial import perturb, start_from
from .read import LOOP, CaseFields, time_folders
from .solve import PHASE, SAVE_EVERY, Listener, Watch, solver
from .vibration import Vibration

__all__ = ["best_loop", "run_time_resolved"]

Array = NDArray[np.float64]
SNAPSHOTS = 24  # a period
LOOP_PERIODS = 3  # at least this many in the loop
SPARE_PERIODS = 3  # more are recorded, to choose the loop from
KEPT = {"U", "p", "k", "omega"}
COLLAPSED = 1e-7  # convective times: a time step this short will never arrive
LONGEST_START = 80.0  # convective times (projected width over speed) before a start-up is given up as irregular


def run_time_resolved(
    spec: FlowSpec,
    folder: Path,
    *,
    start: Path | None = None,
    listener: Listener = lambda _: None,
    periods: int = LOOP_PERIODS,
    timeout: float | None = None,
) -> str:
    """Run pimpleFoam through the start-up and record ``periods`` whole shedding periods. Returns the verdict.

    From ``start`` (the case of a draft of the same bodies) or a uniform flow, with a transverse push behind the body
    that sets off the shedding. The start-up ends when three periods repeat (2 % in length and drag, 5 % in lift) or
    after 80 widths of travel; then 24 snapshots a period are kept and listed in loop.json. A wake that does not shed
    is kept as one steady time. Where the body vibrates (``spec.vibration``) the loop is whole periods of the
    vibration, and loop.json holds the motion of the mesh and its phase at the loop's start; a wake that only swings
    with the body is kept as such a loop too.
    """
    phase = folder / PHASE
    if not phase.exists():
        if not time_folders(folder):
            start_from(spec, folder, start)
            perturb(spec, folder)
        _start_up(spec, folder, listener, timeout)
        rows = Tail(folder).update()
        write_json(
            phase, {"phase": "loop", "begin": float(time_folders(folder)[-1].name), "period": _period(rows, spec)}
        )
    state = json.loads(phase.read_text())
    if state["period"] is None:
        return "steady"
    if state["phase"] == "loop":
        _record(spec, folder, state, periods, listener, timeout)
        _close_loop(spec, folder, state, periods)
        write_json(phase, {**state, "phase": "done"})
    rows = Tail(folder).update()
    return "periodic" if is_settled(rows[rows[:, 0] > state["begin"] - 2 * state["period"]]) else "broadband"


def _start_up(spec: FlowSpec, folder: Path, listener: Listener, timeout: float | None) -> None:
    scale = spec.convective_time

    def finished(rows: Array) -> bool:
        now = rows[-1, 0]
        if now < 15 * scale:
            return False
        return (
            is_settled(rows[rows[:, 0] > 5 * scale]) is not None or _is_still(rows, spec) or now > LONGEST_START * scale
        )

    first = 0.2 * spec.mesh.h_corner / spec.speed
    write_parameters(folder, {
        "startFrom": "latestTime", "endTime": 2 * LONGEST_START * scale, "deltaT": first,
        "writeControl": "clockTime", "writeInterval": SAVE_EVERY, "purgeWrite": 2,
    })  # fmt: skip
    solver(folder, "pimpleFoam", _watch(spec, folder, "start-up", listener, finished, 40 * scale), timeout)
    if spec.vibration is not None:
        _swing_to_middle(spec.vibration, spec, folder, listener, timeout)


def _swing_to_middle(
    vibration: Vibration, spec: FlowSpec, folder: Path, listener: Listener, timeout: float | None
) -> None:
    """Go on to the end of the vibration: the recording, and so the loop, begins at phase zero, as the scene does."""
    now = float(time_folders(folder)[-1].name)
    left = -now % vibration.period
    if left > 1e-6 * vibration.period:
        end: dict[str, str | float | int] = {
            "endTime": now + left,
            "writeControl": "adjustableRunTime",
            "writeInterval": left,
        }
        write_parameters(folder, {"startFrom": "latestTime", **end})
        solver(
            folder, "pimpleFoam", _watch(spec, folder, "start-up", listener, lambda rows: False, now + left), timeout
        )


def _watch(
    spec: FlowSpec, folder: Path, stage: str, listener: Listener, finished: Callable[[Array], bool], end: float
) -> Watch:
    return Watch(folder, stage, listener, finished, expected=end, least_step=COLLAPSED * spec.convective_time)


def _is_still(rows: Array, spec: FlowSpec) -> bool:
    """Whether the wake has come to rest: over ten convective times drag within 0.1 % and lift below 1e-3, shrinking.

    The drag of a vibrating body never rests: there the lift decides.
    """
    scale = spec.convective_time
    if rows[-1, 0] < 30 * scale:
        return False
    recent = rows[rows[:, 0] > rows[-1, 0] - 10 * scale]
    half = len(recent) // 2
    shrinks = np.ptp(recent[half:, 2]) <= np.ptp(recent[:half, 2])
    drags = spec.vibration is not None or np.ptp(recent[:, 1]) < 1e-3 * abs(recent[:, 1].mean())
    return bool(drags and np.ptp(recent[:, 2]) < 1e-3 and shrinks)


def _period(rows: Array, spec: FlowSpec) -> float | None:
    """Shedding period (s) at the end of the start-up; None for a wake at rest, the vibration's where it only swings."""
    scale = spec.convective_time
    if _is_still(rows, spec):
        return None if spec.vibration is None else spec.vibration.period
    late = rows[rows[:, 0] > rows[-1, 0] - 0.5 * (rows[-1, 0] - rows[0, 0])]
    crossings = upward_crossings(late[:, 0], late[:, 2])
    if len(crossings) < 2:
        raise FoamError(
            f"the wake neither rests nor sheds after {rows[-1, 0] / scale:.0f} widths of travel: use rung draft"
        )
    return is_settled(late) or float(np.diff(crossings).mean())


def _record(
    spec: FlowSpec, folder: Path, state: dict[str, float], periods: int, listener: Listener, timeout: float | None
) -> None:
    begin, step = state["begin"], _cadence(spec, state)
    end = begin + (periods + SPARE_PERIODS) * state["period"] + step
    if spec.vibration is not None:
        end += spec.vibration.period  # the loop ends on a whole one
    if float(time_folders(folder)[-1].name) < end - step:
        write_parameters(folder, {
            "startFrom": "latestTime", "endTime": end + 0.01 * step, "writeControl": "adjustableRunTime",
            "writeInterval": step, "purgeWrite": 0,
        })  # fmt: skip
        solver(folder, "pimpleFoam", _watch(spec, folder, "recording", listener, lambda rows: False, end), timeout)


def _cadence(spec: FlowSpec, state: dict[str, float]) -> float:
    """Time between snapshots (s): a whole number of them a shedding period, or a vibration."""
    step = state["period"] / SNAPSHOTS
    return step if spec.vibration is None else spec.vibration.cadence(step)


def _close_loop(spec: FlowSpec, folder: Path, state: dict[str, float], periods: int) -> None:
    """Choose the loop among the snapshots and remove the others; loop.json comes first, so that this can be
    repeated.
    """
    if not (folder / LOOP).exists():
        step = _cadence(spec, state)
        folders = [path for path in time_folders(folder) if float(path.name) >= state["begin"] - 1e-3 * step]
        fields = CaseFields(folder)
        clock = np.array([float(path.name) for path in folders])
        velocity = np.stack([fields.field(path, "U")[0] for path in folders])
        whole = None if spec.vibration is None else spec.vibration.period
        first, last, length, mismatch = best_loop(clock, velocity, periods * state["period"], whole)
        table: dict[str, Any] = {"period": length, "periods": round(length / state["period"]), "begin": state["begin"]}
        names = [path.name for path in folders[first:last]]
        if spec.vibration is not None:
            table["motion"] = spec.vibration.motion(clock[first])
        write_json(folder / LOOP, {**table, "mismatch": mismatch, "times": names})
    kept = set(json.loads((folder / LOOP).read_text())["times"])
    for path in time_folders(folder)[:-1]:  # the last one stays whole: the run can go on from it
        if path.name not in kept:
            shutil.rmtree(path)
            continue
        for member in path.iterdir():
            if member.name not in KEPT:
                shutil.rmtree(member) if member.is_dir() else member.unlink()


def best_loop(clock: Array, velocity: Array, least: float, whole: float | None = None) -> tuple[int, int, float, float]:
    """The loop among snapshots that closes best: first and last snapshot (which repeats the first), length (s),
    mismatch.

    ``clock`` (t,) s, ``velocity`` (t, ...); the loop is at least ``least`` (s) long, less 8 %, since shedding periods
    vary. ``whole`` (s): length and start, counted from the first snapshot, are multiples of it, a vibration's period.
    The mismatch is the rms velocity difference at the join, at the refined length, over the rms fluctuation.
    Raises FoamError when the snapshots do not cover the loop.
    """
    count = len(clock)
    flat = velocity.reshape(count, -1)
    flat = flat - flat.mean(axis=0)
    square = (flat**2).sum(axis=1)
    distance = square[:, None] + square[None] - 2 * flat @ flat.T
    lengths = clock[None] - clock[:, None]
    allowed = lengths >= 0.92 * least
    allowed[:, -1] = False  # the parabola needs a snapshot after the last
    if whole is not None:
        over = np.abs(lengths - whole * np.round(lengths / whole)) < 0.1 * (clock[1] - clock[0])
        allowed &= over & over[0][:, None]  # lengths and starts
    if not allowed.any():
        raise FoamError(f"the recording of {clock[-1] - clock[0]:.3g} s is shorter than a loop of {least:.3g} s")
    first, last = (int(i) for i in np.unravel_index(np.where(allowed, distance, np.inf).argmin(), distance.shape))
    before, here, after = distance[first, last - 1 : last + 2]
    bend = before - 2 * here + after
    if whole is not None:
        length = whole * float(np.round(lengths[first, last] / whole))
        return first, last, length, float(np.sqrt(max(here, 0.0) / max(square.mean(), 1e-300)))
    shift = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend > 0 else 0.0
    left = max(here - 0.25 * (before - after) * shift, 0.0)
    length = float(lengths[first, last] + shift * (clock[last + 1] - clock[last]))
    return first, last, length, float(np.sqrt(left / max(square.mean(), 1e-300)))
