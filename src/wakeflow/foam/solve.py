"""Run OpenFOAM: mesh conversion, check, steady or time-resolved solution, each picking up what an interrupted run left."""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FoamError, MeshError
from ..files import write_json
from ..process import Finished, run, tail
from .case import INSTALL, FlowSpec, environment, set_patch_types, write_case, write_parameters
from .history import Tail, is_settled, kind_of
from .initial import perturb, start_from
from .read import LOOP, CaseFields, time_folders

__all__ = ["MeshCheck", "Progress", "prepare", "run_steady", "run_time_resolved"]

Array = NDArray[np.float64]
CHECKED, PHASE, STOP = "mesh_check.json", "phase.json", "stop"
SAVE_EVERY = 20  # s of wall time between savings: what an interruption may cost
WINDOW, STANDSTILL = 300, 2e-4  # a steady run ends when Cd moved by less than this share over so many iterations
USABLE = 0.01  # range of Cd over the window, relative, that still counts as steady
TYPICAL_ITERATIONS = 900
ABSURD = 1e3  # a drag coefficient that no body has
SNAPSHOTS = 24  # a period
LOOP_PERIODS = 3  # at least this many in the loop
RECORDED = 6  # periods to choose the loop from
KEPT = {"U", "p", "k", "omega"}
LONGEST_START = 80.0  # convective times (projected width over speed) before a start-up is given up as irregular


@dataclass(frozen=True)
class MeshCheck:
    """What OpenFOAM's checkMesh found: angles in degrees."""

    cells: int
    non_orthogonality: float
    mean_non_orthogonality: float
    skewness: float


@dataclass(frozen=True)
class Progress:
    """Where a solver stands. ``time`` counts iterations when steady, else seconds of flow; ``left`` is wall seconds, estimated."""

    stage: str
    time: float
    cd: float | None = None
    residuals: dict[str, float] = field(default_factory=dict)
    left: float | None = None

    def __str__(self) -> str:
        where = f"iteration {self.time:.0f}" if self.stage == "steady" else f"{self.stage}, t = {self.time:.4g} s"
        parts = [where]
        if self.cd is not None:
            parts.append(f"Cd {self.cd:.3f}")
        if "p" in self.residuals:
            parts.append(f"pressure residual {self.residuals['p']:.1e}")
        if self.left is not None:
            parts.append(f"about {self.left:.0f} s left")
        return ", ".join(parts)


Listener = Callable[[Progress], None]


def _call(
    folder: Path, command: list[str], on_line: Callable[[str], None] | None = None, **how: float | None
) -> Finished:
    """Run one OpenFOAM program in the case; a failure says why in one line."""
    log = folder / f"log.{command[0]}"
    before = log.stat().st_size if log.exists() else 0
    try:
        return run(
            command, cwd=folder, log=log, env=environment(), on_line=on_line, append=True, error=FoamError,
            hint=INSTALL, timeout=how.get("timeout"),
        )  # fmt: skip
    except FoamError as problem:
        if problem.log is None:
            raise
        raise FoamError(
            f"{command[0]} {_reason(log, before)}; log: {log}", command=problem.command, log=log, tail=tail(log)
        ) from None


def _reason(log: Path, start: int) -> str:
    with log.open("rb") as stream:
        stream.seek(start)
        text = stream.read().decode(errors="replace")
    if "sigFpe" in text or "Floating point exception" in text:
        return "diverged (floating point exception): the solution grew without bound"
    fatal = re.search(r"FOAM FATAL (?:IO )?ERROR\s*:?\s*\n?(.*?)\n\s*\n", text, re.S)
    if fatal:
        return "stopped: " + " ".join(fatal[1].split())[:300]
    return "failed: " + " ".join(text.split("\n")[-2:])[:200]


def prepare(spec: FlowSpec, msh: Path, folder: Path) -> MeshCheck:
    """Write the case, convert ``msh`` and check it. Does nothing but read the result when it was done before.

    Raises MeshError naming the checks that failed, FoamError when OpenFOAM is not installed or cannot read the mesh.
    """
    write_case(spec, folder)
    done = folder / CHECKED
    if done.exists():
        return MeshCheck(**json.loads(done.read_text()))
    _call(folder, ["gmshToFoam", str(msh.resolve())])
    set_patch_types(folder, walls=spec.mesh.walls)
    log = folder / "log.checkMesh"
    log.unlink(missing_ok=True)
    _call(folder, ["checkMesh"])
    text = log.read_text()
    failed = re.findall(r"^\s*\*\*\*(.*)$", text, re.M)
    if failed or "Mesh OK" not in text:
        named = "; ".join(" ".join(line.split()) for line in failed) or "it did not say Mesh OK"
        raise MeshError(f"OpenFOAM refuses the mesh: {named}; log: {log}", command="checkMesh", log=log, tail=tail(log))
    check = MeshCheck(
        cells=int(_number(r"cells:\s+(\d+)", text)),
        non_orthogonality=_number(r"non-orthogonality Max: (\S+)", text),
        mean_non_orthogonality=_number(r"non-orthogonality Max: \S+ average: (\S+)", text),
        skewness=_number(r"Max skewness = (\S+)", text),
    )
    write_json(done, asdict(check))
    return check


def _number(pattern: str, text: str) -> float:
    match = re.search(pattern, text)
    if match is None:
        raise FoamError(f"checkMesh's output lacks {pattern!r}: is this OpenFOAM 1912?")
    return float(match[1])


class _Watch:
    """Reads a solver's log line by line: residuals, time, drag; ends the run when ``finished`` says so."""

    def __init__(
        self, folder: Path, stage: str, listener: Listener, finished: Callable[[np.ndarray], bool], expected: float
    ) -> None:
        self.folder, self.stage, self.listener, self.finished, self.expected = (
            folder,
            stage,
            listener,
            finished,
            expected,
        )
        self.history = Tail(folder)
        self.residuals: dict[str, float] = {}
        self.started = time.monotonic()
        self.begin: float | None = None
        self.looked = 0.0
        self.stopping = False

    def __call__(self, line: str) -> None:
        if "Initial residual" in line:
            match = re.search(r"Solving for (\w+), Initial residual = ([^,]+)", line)
            if match:
                self.residuals[match[1]] = float(match[2])
                if not np.isfinite(self.residuals[match[1]]):
                    self._diverged(f"the residual of {match[1]} is not a number")
        elif line.startswith("Time = "):
            self._step(float(line.split("=")[1]))

    def _step(self, now: float) -> None:
        self.begin = now if self.begin is None else self.begin
        if time.monotonic() - self.looked < 0.2:
            return
        self.looked = time.monotonic()
        rows = self.history.update()
        if not len(rows):
            return
        drag = float(rows[-1, 1])
        if not np.isfinite(drag) or abs(drag) > ABSURD:
            self._diverged(f"the drag coefficient reached {drag:.3g}")
        rate = (time.monotonic() - self.started) / max(now - self.begin, 1e-300)
        left = max(self.expected - now, 0.0) * rate if now > self.begin else None
        self.listener(Progress(self.stage, now, drag, dict(self.residuals), left))
        if not self.stopping and self.finished(rows):
            (self.folder / STOP).touch()
            self.stopping = True

    def _diverged(self, why: str) -> None:
        log = next(iter(sorted(self.folder.glob("log.*Foam"), key=lambda p: -p.stat().st_mtime)), None)
        raise FoamError(f"the airflow diverged: {why}; log: {log}", log=log, tail=tail(log) if log else "")


def _solver(folder: Path, program: str, watch: _Watch, timeout: float | None) -> None:
    (folder / STOP).unlink(missing_ok=True)
    _drop_broken_times(folder)
    try:
        _call(folder, [program], watch, timeout=timeout)
    finally:
        (folder / STOP).unlink(missing_ok=True)


def _drop_broken_times(folder: Path) -> None:
    """Remove time folders that a killed solver left half-written: the solver would start from the last one."""
    for path in time_folders(folder):
        stamp = path / "uniform" / "time"
        names = [p for p in path.iterdir() if p.is_file()]
        whole = stamp.exists() and all(p.read_bytes().rstrip().endswith(b"//") for p in names)
        if not whole:
            shutil.rmtree(path)


def run_steady(
    spec: FlowSpec, folder: Path, *, listener: Listener = lambda _: None, most: int = 3000, timeout: float | None = None
) -> str:
    """Iterate simpleFoam until Cd stands still or ``most`` iterations; go on from what is there. Returns the verdict.

    "steady" when Cd moved by less than 1 % over the last 300 iterations; else how it moves: "periodic" or "broadband" (then the flow
    asks for the time-resolved rung; nothing has failed).
    """

    def finished(rows: np.ndarray) -> bool:
        recent = rows[-WINDOW:, 1]
        still = len(recent) == WINDOW and np.ptp(recent) <= STANDSTILL * abs(recent.mean())
        return bool(still or rows[-1, 0] >= most)

    done = folder / PHASE
    if not done.exists():
        steps = {"startFrom": "latestTime", "endTime": most + 1000, "deltaT": 1, "writeControl": "clockTime"}
        write_parameters(folder, {**steps, "writeInterval": SAVE_EVERY, "purgeWrite": 2})
        _solver(folder, "simpleFoam", _Watch(folder, "steady", listener, finished, TYPICAL_ITERATIONS), timeout)
        write_json(done, {"phase": "done"})
    drag = Tail(folder).update()[:, 1]
    return kind_of(drag[-WINDOW:], USABLE)


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

    From ``start`` (the case of a draft of the same bodies) or a uniform flow, with a transverse push behind the body that
    sets off the shedding. The start-up ends when three periods repeat (2 % in length and drag, 5 % in lift) or after 80 widths
    of travel; then 24 snapshots a period are kept and listed in loop.json. A wake that does not shed is kept as one steady
    time.
    """
    scale = spec.convective_time
    phase = folder / PHASE
    if not phase.exists():
        if not time_folders(folder):
            start_from(spec, folder, start)
            perturb(spec, folder)
        _start_up(spec, folder, listener, timeout)
        rows = Tail(folder).update()
        write_json(
            phase, {"phase": "loop", "begin": float(time_folders(folder)[-1].name), "period": _period(rows, scale)}
        )
    state = json.loads(phase.read_text())
    if state["period"] is None:
        return "steady"
    if state["phase"] == "loop":
        _record(spec, folder, state, periods, listener, timeout)
        _close_loop(folder, state, periods)
        write_json(phase, {**state, "phase": "done"})
    rows = Tail(folder).update()
    return "periodic" if is_settled(rows[rows[:, 0] > state["begin"] - 2 * state["period"]]) else "broadband"


def _start_up(spec: FlowSpec, folder: Path, listener: Listener, timeout: float | None) -> None:
    scale = spec.convective_time

    def finished(rows: np.ndarray) -> bool:
        now = rows[-1, 0]
        if now < 15 * scale:
            return False
        return (
            is_settled(rows[rows[:, 0] > 5 * scale]) is not None
            or _is_still(rows, scale)
            or now > LONGEST_START * scale
        )

    first = 0.2 * spec.mesh.h_corner / spec.speed
    write_parameters(folder, {
        "startFrom": "latestTime", "endTime": 2 * LONGEST_START * scale, "deltaT": first,
        "writeControl": "clockTime", "writeInterval": SAVE_EVERY, "purgeWrite": 2,
    })  # fmt: skip
    _solver(folder, "pimpleFoam", _Watch(folder, "start-up", listener, finished, 40 * scale), timeout)


def _is_still(rows: np.ndarray, scale: float) -> bool:
    """Whether the wake has come to rest: over ten convective times drag within 0.1 % and lift below 1e-3, shrinking."""
    if rows[-1, 0] < 30 * scale:
        return False
    recent = rows[rows[:, 0] > rows[-1, 0] - 10 * scale]
    half = len(recent) // 2
    shrinks = np.ptp(recent[half:, 2]) <= np.ptp(recent[:half, 2])
    return bool(np.ptp(recent[:, 1]) < 1e-3 * abs(recent[:, 1].mean()) and np.ptp(recent[:, 2]) < 1e-3 and shrinks)


def _period(rows: np.ndarray, scale: float) -> float | None:
    """Shedding period (s) at the end of the start-up; None for a wake at rest."""
    if _is_still(rows, scale):
        return None
    from .history import upward_crossings

    late = rows[rows[:, 0] > rows[-1, 0] - 0.5 * (rows[-1, 0] - rows[0, 0])]
    crossings = upward_crossings(late[:, 0], late[:, 2])
    if len(crossings) < 2:
        raise FoamError(
            f"the wake neither rests nor sheds after {rows[-1, 0] / scale:.0f} widths of travel: use rung draft for this scene"
        )
    return is_settled(late) or float(np.diff(crossings).mean())


def _record(
    spec: FlowSpec, folder: Path, state: dict[str, float], periods: int, listener: Listener, timeout: float | None
) -> None:
    begin, step = state["begin"], state["period"] / SNAPSHOTS
    end = begin + ((periods + RECORDED - LOOP_PERIODS) * SNAPSHOTS + 1) * step
    if float(time_folders(folder)[-1].name) < end - step:
        write_parameters(folder, {
            "startFrom": "latestTime", "endTime": end + 0.01 * step, "writeControl": "adjustableRunTime",
            "writeInterval": step, "purgeWrite": 0,
        })  # fmt: skip
        _solver(folder, "pimpleFoam", _Watch(folder, "recording", listener, lambda rows: False, end), timeout)


def _close_loop(folder: Path, state: dict[str, float], periods: int) -> None:
    """Keep the best loop among the snapshots: from one to a later one, ``periods`` or more periods on, that resembles it most.

    The loop's length is refined between snapshots by a parabola through the squared velocity difference.
    """
    begin, step = state["begin"], state["period"] / SNAPSHOTS
    folders = [path for path in time_folders(folder) if float(path.name) >= begin - 1e-3 * step]
    fields = CaseFields(folder)
    clock = np.array([float(path.name) for path in folders])
    velocity = np.stack([fields.field(path, "U")[0] for path in folders])
    first, last, length = best_loop(clock, velocity, periods * state["period"])
    kept = folders[first:last]
    for path in time_folders(folder)[:-1]:  # the last one stays whole: the run can go on from it
        if path not in kept:
            shutil.rmtree(path)
        else:
            for member in path.iterdir():
                if member.name not in KEPT:
                    shutil.rmtree(member) if member.is_dir() else member.unlink()
    count = round(length / state["period"])
    table = {"period": length, "periods": count, "begin": begin, "times": [path.name for path in kept]}
    fluctuation = np.sqrt(np.mean((velocity - velocity.mean(axis=0)) ** 2))
    table["mismatch"] = float(np.sqrt(np.mean((velocity[last] - velocity[first]) ** 2)) / max(fluctuation, 1e-12))
    write_json(folder / LOOP, table)


def best_loop(clock: Array, velocity: Array, least: float) -> tuple[int, int, float]:
    """First snapshot, last snapshot (which repeats the first) and length (s) of the loop that closes best, at least ``least`` long.

    ``clock`` (t,) s, ``velocity`` (t, ...). A little shorter than ``least`` (8 %) is allowed: shedding periods vary.
    """
    count = len(clock)
    flat = velocity.reshape(count, -1)
    square = (flat**2).sum(axis=1)
    distance = square[:, None] + square[None] - 2 * flat @ flat.T
    lengths = clock[None] - clock[:, None]
    allowed = lengths >= 0.92 * least
    allowed[:, -1] = False  # the parabola needs a snapshot after the last
    if not allowed.any():
        raise FoamError(f"the recording of {clock[-1] - clock[0]:.3g} s is shorter than a loop of {least:.3g} s")
    first, last = np.unravel_index(np.where(allowed, distance, np.inf).argmin(), distance.shape)
    before, here, after = distance[first, last - 1 : last + 2]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
    step = clock[last + 1] - clock[last]
    return int(first), int(last), float(lengths[first, last] + np.clip(shift, -0.5, 0.5) * step)
