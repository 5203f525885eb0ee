"""The time-resolved run: through the start-up, then on until the statistics stand, keeping a loop of snapshots."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FoamError
from ..files import write_json
from .case import FlowSpec, write_parameters
from .history import Tail
from .initial import perturb, start_from
from .read import LOOP, CaseFields, time_folders
from .solve import PHASE, SAVE_EVERY, Listener, Watch, solver
from .statistics import Stopping, cycles, evaluate, is_still

__all__ = ["LONGEST", "LOOP_PERIODS", "SNAPSHOTS", "best_loop", "run_time_resolved"]

Array = NDArray[np.float64]
SNAPSHOTS = 24  # a period
LOOP_PERIODS = 3  # at least this many in the loop of a periodic wake
BROADBAND_PERIODS = 6  # the same where periods differ from each other
SPARE_PERIODS = 3  # more are kept until the run ends, to choose the loop from
RECORDED = "recorded"  # a file: the solver ended by itself
KEPT = {"U", "p", "k", "omega"}
COLLAPSED = 1e-7  # convective times: a time step this short will never arrive
LONGEST_START = 80.0  # convective times (projected width over speed) before a start-up is given up as irregular
LONGEST = 300.0  # convective times after which a run ends with what it has, its intervals wider than asked


def run_time_resolved(
    spec: FlowSpec,
    folder: Path,
    *,
    start: Path | None = None,
    listener: Listener = lambda _: None,
    periods: int | None = None,
    timeout: float | None = None,
) -> str:
    """Run pimpleFoam until the statistics stand (:class:`Stopping`, FlowSpec.accuracy). Returns the verdict.

    From ``start`` (any solved case, best the draft of the same bodies) or a uniform flow, with a transverse push behind
    the body that sets off the shedding. Once three periods look alike, or after 80 widths of travel, snapshots are
    written, 24 a period, of which OpenFOAM keeps the last; when the run ends, the loop of ``periods`` whole periods (3
    when periodic, 6 when broadband) that closes best stays, listed in loop.json. A wake that does not shed is kept as
    one steady time. The run ends unfinished after 300 widths of travel: the intervals say what is lacking.
    """
    scale = spec.convective_time
    phase = folder / PHASE
    if not phase.exists():
        if not time_folders(folder):
            start_from(spec, folder, start)
            perturb(spec, folder)
        _start_up(spec, folder, listener, timeout)
        period = _period(Tail(folder).update(), scale)
        write_json(phase, {"phase": "loop", "begin": float(time_folders(folder)[-1].name), "period": period})
    state = json.loads(phase.read_text())
    if state["period"] is None:
        return "steady"
    if state["phase"] == "loop":
        _record(spec, folder, state, periods or BROADBAND_PERIODS, listener, timeout)
        rows = Tail(folder).update()
        if is_still(rows, scale):
            write_json(phase, {**state, "phase": "done", "period": None, "verdict": "steady"})
            return "steady"
        found = evaluate(rows, spec.accuracy)
        verdict = found.verdict if found else "broadband"
        _close_loop(folder, state, periods or (LOOP_PERIODS if verdict == "periodic" else BROADBAND_PERIODS))
        state = {**state, "phase": "done", "verdict": verdict}
        write_json(phase, state)
    return str(state["verdict"])


def _start_up(spec: FlowSpec, folder: Path, listener: Listener, timeout: float | None) -> None:
    scale = spec.convective_time

    def finished(rows: Array) -> bool:
        now = rows[-1, 0]
        if now < 15 * scale:
            return False
        return now > LONGEST_START * scale or is_still(rows, scale) or alike(rows[rows[:, 0] > 2 * scale])

    first = 0.2 * spec.mesh.h_corner / spec.speed
    write_parameters(folder, {
        "startFrom": "latestTime", "endTime": 2 * LONGEST_START * scale, "deltaT": first,
        "writeControl": "clockTime", "writeInterval": SAVE_EVERY, "purgeWrite": 2,
    })  # fmt: skip
    solver(folder, "pimpleFoam", _watch(spec, folder, "start-up", listener, finished, 40 * scale), timeout)


def alike(rows: Array) -> bool:
    """Whether the last three shedding periods have lengths and mean drags within 10 %: their length can be told."""
    last = cycles(rows)[-3:]
    return len(last) == 3 and bool((np.ptp(last[:, 1:3], axis=0) <= 0.1 * np.abs(last[:, 1:3].mean(axis=0))).all())


def _watch(
    spec: FlowSpec, folder: Path, stage: str, listener: Listener, finished: Callable[[Array], bool], end: float
) -> Watch:
    return Watch(folder, stage, listener, finished, expected=end, least_step=COLLAPSED * spec.convective_time)


def _period(rows: Array, scale: float) -> float | None:
    """Shedding period (s) at the end of the start-up; None for a wake at rest; 6 convective times for a wake without a
    rhythm (a usual bluff body's: St = 1/6).
    """
    if is_still(rows, scale):
        return None
    late = cycles(rows[rows[:, 0] > 2 * scale])[-3:]
    return float(late[:, 1].mean()) if len(late) else 6 * scale


def _record(
    spec: FlowSpec, folder: Path, state: dict[str, float], periods: int, listener: Listener, timeout: float | None
) -> None:
    """Run on, writing a snapshot every 1/24 of a period, until the statistics stand and a loop can be chosen."""
    begin, step, scale = state["begin"], state["period"] / SNAPSHOTS, spec.convective_time
    kept = (periods + SPARE_PERIODS) * SNAPSHOTS + 2
    least = begin + ((LOOP_PERIODS + 1) * SNAPSHOTS + 2) * step
    end = max(LONGEST * scale, least)
    stopping = Stopping(spec.accuracy)

    def finished(rows: Array) -> bool:
        return rows[-1, 0] > least and (stopping.look(rows) or is_still(rows, scale))

    if (folder / RECORDED).exists():
        return
    write_parameters(folder, {
        "startFrom": "latestTime", "endTime": end, "writeControl": "adjustableRunTime", "writeInterval": step,
        "purgeWrite": kept,
    })  # fmt: skip
    expected = min(max(40 * scale, least), end)
    solver(folder, "pimpleFoam", _watch(spec, folder, "recording", listener, finished, expected), timeout)
    (folder / RECORDED).touch()


def _close_loop(folder: Path, state: dict[str, float], periods: int) -> None:
    """Choose the loop among the snapshots and remove the others; loop.json comes first, so that this can be
    repeated.
    """
    if not (folder / LOOP).exists():
        step = state["period"] / SNAPSHOTS
        folders = [path for path in time_folders(folder) if _on_beat(float(path.name), state["begin"], step)]
        fields = CaseFields(folder)
        clock = np.array([float(path.name) for path in folders])
        velocity = np.stack([fields.field(path, "U")[0] for path in folders])
        least = min(periods * state["period"], 0.9 * float(clock[-1] - clock[0]))
        first, last, length, mismatch = best_loop(clock, velocity, least)
        table = {"period": length, "periods": round(length / state["period"]), "begin": state["begin"]}
        names = [path.name for path in folders[first:last]]
        write_json(folder / LOOP, {**table, "mismatch": mismatch, "times": names})
    kept = set(json.loads((folder / LOOP).read_text())["times"])
    for path in time_folders(folder)[:-1]:  # the last one stays whole: the run can go on from it
        if path.name not in kept:
            shutil.rmtree(path)
            continue
        for member in path.iterdir():
            if member.name not in KEPT:
                shutil.rmtree(member) if member.is_dir() else member.unlink()


def _on_beat(time: float, begin: float, step: float) -> bool:
    """Whether a time is one of the recording's, which OpenFOAM counts from its begin; a stop comes between two."""
    return time >= begin and abs((time - begin) / step - round((time - begin) / step)) < 0.02


def best_loop(clock: Array, velocity: Array, least: float) -> tuple[int, int, float, float]:
    """The loop among snapshots that closes best: first and last snapshot (which repeats the first), length (s),
    mismatch.

    ``clock`` (t,) s, ``velocity`` (t, ...); the loop is at least ``least`` (s) long, less 8 %, since shedding periods
    vary. The mismatch is the rms velocity difference at the join, at the refined length, over the rms fluctuation.
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
    if not allowed.any():
        raise FoamError(f"the recording of {clock[-1] - clock[0]:.3g} s is shorter than a loop of {least:.3g} s")
    first, last = (int(i) for i in np.unravel_index(np.where(allowed, distance, np.inf).argmin(), distance.shape))
    before, here, after = distance[first, last - 1 : last + 2]
    bend = before - 2 * here + after
    shift = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend > 0 else 0.0
    left = max(here - 0.25 * (before - after) * shift, 0.0)
    length = float(lengths[first, last] + shift * (clock[last + 1] - clock[last]))
    return first, last, length, float(np.sqrt(left / max(square.mean(), 1e-300)))
