"""Run OpenFOAM: mesh conversion and check, and the steady solution; an interrupted run is picked up again."""

from __future__ import annotations

import json
import re
import shutil
import signal
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
from .history import Tail, kind_of, read_vectors
from .initial import start_from
from .read import time_folders

__all__ = ["Listener", "MeshCheck", "Progress", "Watch", "prepare", "run_steady", "solver"]

Array = NDArray[np.float64]
CHECKED, PHASE, STOP = "mesh_check.json", "phase.json", "stop"
SAVE_EVERY = 5  # s of wall time between savings: what an interruption may cost
WINDOW, STANDSTILL = 300, 2e-4  # a steady run ends when Cd moved by less than this share over so many iterations
STILL_BASE, STILL_WAKE = 1e-3, 5e-3  # the same for base pressure and for velocities in the wake, of the inlet speed
USABLE = 0.01  # range of Cd over the window, relative, that still counts as steady
TYPICAL_ITERATIONS = 900
ABSURD = 1e3  # a drag coefficient that no body has
IMPULSE = 50  # first steps, in which a flow started from a guess pushes the body without bound as the step shrinks


@dataclass(frozen=True)
class MeshCheck:
    """What OpenFOAM's checkMesh found: angles in degrees."""

    cells: int
    non_orthogonality: float
    mean_non_orthogonality: float
    skewness: float


@dataclass(frozen=True)
class Progress:
    """Where a solver stands. ``time`` counts iterations when steady, else seconds of flow; ``left`` is wall seconds,
    estimated.
    """

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
        if problem.log is None or not problem.command or "did not end" in str(problem):
            problem.command = problem.command or " ".join(command)  # raised by the watch: it says why itself
            raise
        raise FoamError(
            f"{command[0]} {_reason(str(problem), log, before)}; log: {log}",
            command=problem.command,
            log=log,
            tail=tail(log),
        ) from None


def _reason(said: str, log: Path, start: int) -> str:
    """Why a program failed, from how it ended and from what it logged since byte ``start``."""
    with log.open("rb") as stream:
        stream.seek(start)
        text = stream.read().decode(errors="replace")
    if f"exit code -{signal.SIGFPE:d}" in said or "sigFpe::sigHandler" in text:
        return "diverged (floating point exception): the solution grew without bound"
    fatal = re.search(r"FOAM FATAL (?:IO )?ERROR\s*:?\s*\n?(.*?)\n\s*\n", text, re.S)
    if fatal:
        return "stopped: " + " ".join(fatal[1].split())[:300]
    return said.split("; log:")[0].split(" ", 1)[1]


def prepare(spec: FlowSpec, msh: Path, folder: Path) -> MeshCheck:
    """Write the case, convert ``msh`` and check it. Does nothing but read the result when it was done before.

    Raises MeshError naming the checks that failed, FoamError when OpenFOAM is not installed or cannot read the mesh.
    """
    if re.search(r"[\s'\"]", str(folder.resolve())):
        raise FoamError(
            f"OpenFOAM cannot work below a folder with blanks or quotes in its name: {folder.resolve()}; "
            "set WAKEFLOW_CACHE to another folder"
        )
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


class Watch:
    """Reads a solver's log line by line: residuals, time, drag; ends the run when ``finished`` says so."""

    def __init__(
        self,
        folder: Path,
        stage: str,
        listener: Listener,
        finished: Callable[[Array], bool],
        *,
        expected: float,
        least_step: float = 0.0,
    ) -> None:
        self.folder, self.stage, self.listener, self.finished = folder, stage, listener, finished
        self.expected, self.least_step = expected, least_step
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
        elif line.startswith("deltaT = "):
            if float(line.split("=")[1]) < self.least_step:
                self._diverged(f"the time step collapsed to {line.split('=')[1].strip()} s")
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
        if not np.isfinite(drag) or (abs(drag) > ABSURD and len(rows) > IMPULSE):
            self._diverged(f"the drag coefficient reached {drag:.3g}")
        rate = (time.monotonic() - self.started) / max(now - self.begin, 1e-300)
        left = (self.expected - now) * rate if self.begin < now < self.expected else None  # past it: no idea
        self.listener(Progress(self.stage, now, drag, dict(self.residuals), left))
        if not self.stopping and self.finished(rows):
            (self.folder / STOP).touch()
            self.stopping = True

    def _diverged(self, why: str) -> None:
        log = next(iter(sorted(self.folder.glob("log.*Foam"), key=lambda p: -p.stat().st_mtime)), None)
        raise FoamError(f"the airflow diverged: {why}; log: {log}", log=log, tail=tail(log) if log else "")


def solver(folder: Path, program: str, watch: Watch, timeout: float | None) -> None:
    """Run a solver from the latest whole time folder; ``watch`` follows it and may end it."""
    (folder / STOP).unlink(missing_ok=True)
    _drop_broken_times(folder)
    try:
        _call(folder, [program], watch, timeout=timeout)
    finally:
        (folder / STOP).unlink(missing_ok=True)


def _drop_broken_times(folder: Path) -> None:
    """Remove time folders that a killed solver left half-written: the solver would start from the last one."""
    laminar = re.search(r"^turbulence\s+laminar;", (folder / "system" / "parameters").read_text(), re.M)
    needed = {"U", "p", "phi"} if laminar else {"U", "p", "phi", "k", "omega", "nut"}
    for path in (p for p in folder.iterdir() if re.fullmatch(r"[0-9.e+-]*[1-9][0-9.e+-]*", p.name) and p.is_dir()):
        files = [member for member in path.iterdir() if member.is_file()]
        ended = all(_ends_well(member) for member in files)
        if not (ended and needed <= {member.name for member in files} and (path / "uniform" / "time").exists()):
            shutil.rmtree(path)


def _ends_well(file: Path) -> bool:
    """Whether OpenFOAM came to the closing comment of a file."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 100))
        return stream.read().rstrip().endswith(b"* //")


def run_steady(
    spec: FlowSpec,
    folder: Path,
    *,
    start: Path | None = None,
    listener: Listener = lambda _: None,
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
        steps: dict[str, str | float | int] = {
            "startFrom": "latestTime",
            "endTime": most + 1000,
            "deltaT": 1,
            "writeControl": "clockTime",
        }
        write_parameters(folder, {**steps, "writeInterval": SAVE_EVERY, "purgeWrite": 2})
        solver(folder, "simpleFoam", Watch(folder, "steady", listener, finished, expected=TYPICAL_ITERATIONS), timeout)
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
