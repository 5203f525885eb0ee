"""The time-resolved run: through the start-up, then until the statistics have settled; it keeps a loop of snapshots."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from math import ceil
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FoamError
from ...core.files import write_json
from ...core.record import JsonTable
from .case import FlowSpec, MeshMotion
from .read import LOOP, CaseFields, time_folders
from .solver import PHASE, TIME_ROUNDING, drop_after, last_state, purge, run_segment, segment_ends
from .start import first_step, start_in_time
from .statistics import Stopping, Tail, cycles, evaluate, is_still
from .watch import ProgressListener, Watch

Array = NDArray[np.float64]
# Chosen, where nothing else is said; convective time: the first body's projected width over the inlet speed.
SNAPSHOTS = 24  # a shedding period: the field between them is interpolated
LOOP_PERIODS = 3  # at least this many in the loop of a periodic wake
BROADBAND_PERIODS = 6  # the same where periods differ from each other
SPARE_PERIODS = 3  # more are kept until the run ends, to choose the loop from
SEGMENT = 5.0  # convective times between two decisions of a start-up: starting the solver anew costs 2 or 3 % of them
LONG = 10.0  # convective times of a recording that an interruption may cost, about
COLLAPSED = 1e-7  # convective times: a time step this short will never arrive
PUSHED = 2.0  # convective times at the beginning that show the push, not the shedding
MIN_START = 15.0  # convective times before a start-up may end: the wake has to fill first
ALIKE = 0.1  # relative spread of the last three periods below which their length can be estimated
LONGEST_START = 80.0  # convective times before a start-up is given up as irregular
MAX_CONVECTIVE_TIMES = 300.0  # convective times after which a run ends with what it has, its intervals wider than asked
TYPICAL = 40.0  # convective times of a start-up, or of a whole run: what the time left is estimated from
BLUFF_PERIOD = 6.0  # convective times: shedding period of a bluff body at its usual Strouhal number of 1/6
WHOLE = 1e-6  # relative: a time so near to another one has reached it
USABLE = 0.9  # of a recording that is shorter than the loop wanted: what of it the loop may still take
SHORTER = 0.92  # of the length wanted: shedding periods vary, so that a loop may be so much shorter
OFF_BEAT = 0.02  # cadences by which a snapshot may miss its beat: OpenFOAM rounds the names of times
GAP = 1.5  # cadences between snapshots that are no longer neighbours
IN_PHASE = 0.1  # cadences by which a loop may miss a whole number of vibrations


def run_time_resolved(
    spec: FlowSpec,
    folder: Path,
    *,
    start: Path | None = None,
    listener: ProgressListener = lambda _: None,
) -> str:
    """Run pimpleFoam until the statistics have settled (:class:`Stopping`, FlowSpec.accuracy). Returns the verdict.

    From ``start`` (any solved case, best a time-resolved one of the same bodies) or a uniform flow; a transverse push
    behind the body sets off the shedding where ``start`` has none. Once three periods look alike, or after 80 widths of
    travel, snapshots are written, 24 a period, of which the last are kept; when the run ends, the loop of whole periods
    (3 when periodic, 6 when broadband) that closes best stays, listed in loop.json. A wake that does not shed is kept
    as one steady time. The run ends unfinished after 300 widths of travel: the intervals say what is lacking. Where the
    body vibrates (``spec.vibration``) the loop is whole periods of the vibration, and loop.json holds the motion of the
    mesh and its phase at the loop's start; a wake that only swings with the body is kept as such a loop too.
    """
    phase = folder / PHASE
    if not phase.exists():
        drop_after(folder, last_state(folder))
        if not last_state(folder):
            start_in_time(spec, folder, start)
        _start_up(spec, folder, listener)
        write_json(phase, {
            "phase": "loop", "begin": last_state(folder), "period": _period(Tail(folder).update(), spec),
        })  # fmt: skip
    state = json.loads(phase.read_text())
    if state["period"] is None:
        return "steady"
    if state["phase"] == "loop":
        if not (folder / LOOP).exists():  # else its snapshots were chosen, and the others are being removed
            _record(spec, folder, state, listener)
        verdict = _verdict(spec, Tail(folder).update())
        if verdict == "steady":
            write_json(phase, {**state, "phase": "done", "period": None})
            return verdict
        _close_loop(spec, folder, state, LOOP_PERIODS if verdict == "periodic" else BROADBAND_PERIODS)
        state = {**state, "phase": "done", "verdict": verdict}
        write_json(phase, state)
    return str(state["verdict"])


def _verdict(spec: FlowSpec, rows: Array) -> str:
    """steady | periodic | broadband; the wake that only swings with a vibrating body is periodic."""
    if is_still(rows, spec.convective_time, swings=spec.vibration is not None):
        return "steady" if spec.vibration is None else "periodic"
    return evaluate(rows, spec.accuracy).verdict


def _start_up(spec: FlowSpec, folder: Path, listener: ProgressListener) -> None:
    """Run on until the start-up is over, in segments of five convective times. With a vibration they are equal parts or
    multiples of one, and the start-up ends with a whole one: the recording, and so the loop, begins at phase zero.
    """
    length, vibration = SEGMENT * spec.convective_time, spec.vibration
    if vibration is not None:
        parts = round(vibration.period / length)
        length = vibration.period / parts if parts > 1 else vibration.period * ceil(length / vibration.period)
    watch = watch_over(spec, folder, "start-up", listener, TYPICAL * spec.convective_time)
    while True:
        purge(folder)
        now = last_state(folder)
        begins = vibration is None or abs(now - vibration.period * round(now / vibration.period)) < WHOLE * length
        if now and begins and _has_started(Tail(folder).update(), spec):
            return
        end = (int(now / length + WHOLE) + 1) * length
        run_segment(folder, "pimpleFoam", end, {"deltaT": first_step(spec)}, watch)


def _has_started(rows: Array, spec: FlowSpec) -> bool:
    """Whether the start-up is over: the wake rests, its last periods look alike, or it will not become regular."""
    now, scale = rows[-1, 0], spec.convective_time
    if now < MIN_START * scale * (1 - WHOLE):
        return False
    still = is_still(rows, scale, swings=spec.vibration is not None)
    return still or now > LONGEST_START * scale or alike(rows[rows[:, 0] > PUSHED * scale])


def alike(rows: Array) -> bool:
    """Whether the last three shedding periods have lengths and mean drags within ALIKE: one can be estimated."""
    last = cycles(rows)[-3:]
    return len(last) == 3 and bool((np.ptp(last[:, 1:3], axis=0) <= ALIKE * np.abs(last[:, 1:3].mean(axis=0))).all())


def watch_over(spec: FlowSpec, folder: Path, stage: str, listener: ProgressListener, end: float) -> Watch:
    """A watch that expects the run to end at ``end`` (s) and knows time steps that will never arrive."""
    return Watch(folder, stage, listener, expected=end, least_step=COLLAPSED * spec.convective_time)


def _period(rows: Array, spec: FlowSpec) -> float | None:
    """Shedding period (s) at the end of the start-up; None for a wake at rest, the vibration's where it only swings; 6
    convective times for a wake without a rhythm (a usual bluff body's: St = 1/6).
    """
    scale = spec.convective_time
    if is_still(rows, scale, swings=spec.vibration is not None):
        return None if spec.vibration is None else spec.vibration.period
    late = cycles(rows[rows[:, 0] > PUSHED * scale])[-3:]
    return float(late[:, 1].mean()) if len(late) else BLUFF_PERIOD * scale


def _record(
    spec: FlowSpec,
    folder: Path,
    state: dict[str, float],
    listener: ProgressListener,
) -> None:
    """Run on, writing snapshots at a fixed cadence, until the statistics have settled and a loop can be chosen."""
    begin, step, scale = state["begin"], _cadence(spec, state), spec.convective_time
    vibration = 0.0 if spec.vibration is None else spec.vibration.period  # the loop begins and ends on a whole one
    kept = int(((BROADBAND_PERIODS + SPARE_PERIODS) * state["period"] + 2 * vibration) / step) + 2
    least = (LOOP_PERIODS + 1) * state["period"] + 2 * vibration + 2 * step
    end = max(MAX_CONVECTIVE_TIMES * scale - begin, least)
    watch = watch_over(spec, folder, "recording", listener, min(max(TYPICAL * scale, begin + least), begin + end))
    most = LONG * scale / step  # snapshots in a segment, about
    drop_after(folder, last_state(folder))
    while True:
        purge(folder, kept)
        rows, done = Tail(folder).update(), round((last_state(folder) - begin) / step)
        ends = [end for end in segment_ends(folder) if end > begin + 0.5 * step]
        over, look = _looks(spec, rows, ends, begin + least)
        if over or done * step >= end:
            return
        until = max(min(ceil((look - begin) / step), ceil(end / step)), done + 1)
        parts = max(1, round((until - done) / most))
        run_segment(
            folder, "pimpleFoam", begin + (done + ceil((until - done) / parts)) * step, {"writeInterval": step}, watch,
        )  # fmt: skip


def _looks(spec: FlowSpec, rows: Array, ends: Sequence[float], least: float) -> tuple[bool, float]:
    """Whether a record may end with the last of its segments' ``ends`` (s), and when to look again (s): what looks at
    the earlier ends found is found again. ``least`` (s): the earliest look.
    """
    stopping = Stopping(spec.accuracy)
    over = False
    for end in ends:
        seen = rows[: np.searchsorted(rows[:, 0], end * (1 + TIME_ROUNDING), side="right")]
        if end > least * (1 - WHOLE):
            still = is_still(seen, spec.convective_time, swings=spec.vibration is not None)
            over = still or stopping.look(seen)
    return over, max(least, stopping.next)


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
        folders = _on_beat(time_folders(folder), state["begin"], step, spec.vibration)
        fields = CaseFields(folder)
        clock = np.array([float(path.name) for path in folders])
        velocity = np.stack([fields.field(path, "U")[0] for path in folders])
        whole = 0.0 if spec.vibration is None else spec.vibration.period
        least = min(periods * state["period"], USABLE * float(clock[-1] - clock[0]) - whole)
        first, last, length, mismatch = best_loop(clock, velocity, least, whole)
        table: JsonTable = {"period": length, "periods": round(length / state["period"]), "begin": state["begin"]}
        names = [path.name for path in folders[first:last]]
        if spec.vibration is not None:
            table["motion"] = spec.vibration.motion(clock[first])
        write_json(folder / LOOP, {**table, "mismatch": mismatch, "times": names})
    kept = set(json.loads((folder / LOOP).read_text())["times"])
    read = {"U", "p", *(field.name for field in spec.model.transported)}
    for path in time_folders(folder)[:-1]:  # the last one stays whole: the run can go on from it
        if path.name not in kept:
            shutil.rmtree(path)
            continue
        for member in path.iterdir():
            if member.name not in read:
                shutil.rmtree(member) if member.is_dir() else member.unlink()


def _on_beat(folders: list[Path], begin: float, step: float, vibration: MeshMotion | None) -> list[Path]:
    """The times of the recording, every ``step`` (s) from ``begin``: not those of the start-up, nor those before a gap
    (where older ones were thrown away).

    With a vibration the first one lies a whole number of its periods after ``begin``, where its phase is zero.
    """

    def beats(path: Path, interval: float) -> bool:
        count = (float(path.name) - begin) / interval
        return count > -OFF_BEAT and abs(count - round(count)) * interval < OFF_BEAT * step

    result = [path for path in folders if beats(path, step)]
    gaps = np.diff([float(path.name) for path in result]) > GAP * step
    result = result[int(np.flatnonzero(gaps)[-1]) + 1 :] if gaps.any() else result
    if vibration is not None:
        first = next((i for i, path in enumerate(result) if beats(path, vibration.period)), 0)
        result = result[first:]
    return result


def best_loop(clock: Array, velocity: Array, least: float, whole: float = 0.0) -> tuple[int, int, float, float]:
    """The loop among snapshots that closes best: first and last snapshot (which repeats the first), length (s),
    mismatch.

    ``clock`` (t,) s, ``velocity`` (t, ...); the loop is at least ``least`` (s) long, less 8 %, since shedding periods
    vary. ``whole`` (s), where it is not 0: length and start, counted from the first snapshot, are multiples of it, a
    vibration's period.
    The mismatch is the rms velocity difference at the join, at the refined length, over the rms fluctuation.
    Raises FoamError when the snapshots do not cover the loop.
    """
    count = len(clock)
    flat = velocity.reshape(count, -1)
    flat = flat - flat.mean(axis=0)
    square = (flat**2).sum(axis=1)
    distance = square[:, None] + square[None] - 2 * flat @ flat.T
    lengths = clock[None] - clock[:, None]
    allowed = lengths >= SHORTER * least
    allowed[:, -1] = False  # the parabola needs a snapshot after the last
    if whole:
        over = np.abs(lengths - whole * np.round(lengths / whole)) < IN_PHASE * (clock[1] - clock[0])
        allowed &= over & over[0][:, None]  # lengths and starts
    if not allowed.any():
        raise FoamError(f"the recording of {clock[-1] - clock[0]:.3g} s is shorter than a loop of {least:.3g} s")
    first, last = (int(i) for i in np.unravel_index(np.where(allowed, distance, np.inf).argmin(), distance.shape))
    before, here, after = distance[first, last - 1 : last + 2]
    bend = before - 2 * here + after
    if whole:
        length = whole * float(np.round(lengths[first, last] / whole))
        return first, last, length, float(np.sqrt(max(here, 0.0) / max(square.mean(), 1e-300)))
    shift = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend > 0 else 0.0
    left = max(here - 0.25 * (before - after) * shift, 0.0)
    length = float(lengths[first, last] + shift * (clock[last + 1] - clock[last]))
    return first, last, length, float(np.sqrt(left / max(square.mean(), 1e-300)))
