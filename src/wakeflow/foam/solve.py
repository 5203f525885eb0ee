"""Run OpenFOAM: mesh conversion and check, and the steady solution; an interrupted run is picked up again."""

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

from ..core.errors import FoamError, MeshError
from ..core.files import write_json
from ..core.process import tail
from .case import FlowSpec, set_patch_types, write_case, write_inlets, write_parameters
from .failure import AirflowFailure, Cause, disk_is_full
from .history import Tail, kind_of, read_vectors
from .parallel import gather, scatter
from .programs import call
from .read import time_folders
from .start import start_from

__all__ = ["Listener", "MeshCheck", "Progress", "Watch", "prepare", "run_steady", "solver"]

Array = NDArray[np.float64]
CHECKED, PHASE, STOP = "mesh_check.json", "phase.json", "stop"
DIGITS = 15  # timePrecision in the template
SAVE_EVERY = 5  # s of wall time between savings: what an interruption may cost
WINDOW, STANDSTILL = 300, 2e-4  # a steady run ends when Cd moved by less than this share over so many iterations
STILL_BASE, STILL_WAKE = 1e-3, 5e-3  # the same for base pressure and for velocities in the wake, of the inlet speed
USABLE = 0.01  # range of Cd over the window, relative, that still counts as steady
TYPICAL_ITERATIONS = 900
ABSURD = 1e3  # a drag coefficient that no body has above Re 1; below, drag grows as 1/Re
MOST_SWEEPS, UNSOLVED = 1000, 20  # OpenFOAM's own limit on a linear solver; reached so often in a row it is stuck
CRAWL, CRAWLING = 10.0, 200  # so many time steps in a row below so many of the least ones: time stands still
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
    call(folder, ["gmshToFoam", str(msh.resolve())])
    set_patch_types(folder, walls=spec.mesh.walls)
    write_inlets(spec, folder)
    log = folder / "log.checkMesh"
    log.unlink(missing_ok=True)
    call(folder, ["checkMesh"])
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
        self.crawling = self.unsolved = 0
        self.absurd = ABSURD * max(1.0, 1.0 / _reynolds(folder))

    def __call__(self, line: str) -> None:
        if "Initial residual" in line:
            match = re.search(r"Solving for (\w+), Initial residual = ([^,]+).*No Iterations (\d+)", line)
            if match:
                self._equation(match[1], float(match[2]), int(match[3]))
        elif line.startswith("deltaT = "):
            self._time_step(float(line.split("=")[1]))
        elif line.startswith("Time = "):
            self._step(float(line.split("=")[1]))

    def _equation(self, name: str, residual: float, iterations: int) -> None:
        """Notice a residual that is not a number, and a pressure that its solver never finishes solving for."""
        self.residuals[name] = residual
        if not np.isfinite(residual):
            self._fail(Cause.DIVERGED, f"diverged: the residual of {name} is not a number")
        if name == "p":
            self.unsolved = self.unsolved + 1 if iterations >= MOST_SWEEPS else 0
            if self.unsolved >= UNSOLVED:
                self._fail(Cause.STALLED, f"stalled: the pressure took {iterations} sweeps {UNSOLVED} times in a row")

    def _time_step(self, step: float) -> None:
        """Notice time steps that will never arrive."""
        if step < self.least_step:
            self._fail(Cause.COLLAPSED, f"diverged: the time step collapsed to {step:.6g} s")
        self.crawling = self.crawling + 1 if step < CRAWL * self.least_step else 0
        if self.crawling >= CRAWLING:
            self._fail(Cause.STALLED, f"stalled: {CRAWLING} time steps in a row were below {step:.3g} s")

    def _step(self, now: float) -> None:
        self.begin = now if self.begin is None else self.begin
        if time.monotonic() - self.looked < 0.2:
            return
        self.looked = time.monotonic()
        rows = self.history.update()
        if not len(rows):
            return
        drag = float(rows[-1, 1])
        if not np.isfinite(drag) or (abs(drag) > self.absurd and len(rows) > IMPULSE):
            self._fail(Cause.DIVERGED, f"diverged: the drag coefficient reached {drag:.3g}")
        rate = (time.monotonic() - self.started) / max(now - self.begin, 1e-300)
        left = (self.expected - now) * rate if self.begin < now < self.expected else None  # past it: no idea
        self.listener(Progress(self.stage, now, drag, dict(self.residuals), left))
        if not self.stopping and self.finished(rows):
            (self.folder / STOP).touch()
            self.stopping = True

    def _fail(self, cause: Cause, why: str) -> None:
        log = next(iter(sorted(self.folder.glob("log.*Foam"), key=lambda p: -p.stat().st_mtime)), None)
        raise AirflowFailure(cause, f"the airflow {why}; log: {log}", log=log, tail=tail(log) if log else "")


def _reynolds(folder: Path) -> float:
    """Of the case, from its parameters; 1 without them."""
    path = folder / "system" / "parameters"
    values = dict(re.findall(r"^(\w+)\s+([^;]*);", path.read_text(), re.M)) if path.exists() else {}
    numbers = [abs(float(values[name])) for name in ("inletSpeed", "bodyWidth", "nu") if name in values]
    return numbers[0] * numbers[1] / numbers[2] if len(numbers) == 3 else 1.0


def solver(folder: Path, program: str, watch: Watch, timeout: float | None) -> None:
    """Run a solver from the latest whole time folder on as many ranks as system/parameters says; ``watch`` follows it
    and may end it.

    Raises AirflowFailure, also when it ended well but left a time cut short: then the disk was full.
    """
    (folder / STOP).unlink(missing_ok=True)
    gather(folder, is_whole=lambda path: _is_whole(folder, path))  # what an interrupted parallel run left
    _drop_broken_times(folder)
    _name_plainly(folder)
    launcher, options = scatter(folder)
    try:
        call(folder, [program, *options], watch, launcher=launcher, timeout=timeout)
        gather(folder, is_whole=lambda path: _is_whole(folder, path))
    finally:
        (folder / STOP).unlink(missing_ok=True)
    for path in _times(folder):
        if not _is_whole(folder, path):
            why = "the disk is full or its quota used up" if disk_is_full(folder) else "the disk was full for a while"
            raise AirflowFailure(
                Cause.DISK_FULL, f"{program} left {path} cut short: {why}; {Cause.DISK_FULL.advice}", command=program
            )


def _times(folder: Path) -> list[Path]:
    """Time folders, whole or not; 0 is left out."""
    return [p for p in folder.iterdir() if re.fullmatch(r"[0-9.e+-]*[1-9][0-9.e+-]*", p.name) and p.is_dir()]


def _drop_broken_times(folder: Path) -> None:
    """Remove time folders that a killed solver left half-written: the solver would start from the last one."""
    for path in _times(folder):
        if not _is_whole(folder, path):
            shutil.rmtree(path)


def _name_plainly(folder: Path) -> None:
    """Give time folders the names that a restart looks for: OpenFOAM adds digits where two times nearly coincide."""
    for path in _times(folder):
        plain = path.with_name(f"{float(path.name):.{DIGITS}g}")
        if not plain.exists():
            path.rename(plain)


def _is_whole(folder: Path, path: Path) -> bool:
    """Whether the time folder ``path`` of the case ``folder``, or of one of its ranks, holds all that a run needs."""
    parameters = (folder / "system" / "parameters").read_text()
    laminar = re.search(r"^turbulence\s+laminar;", parameters, re.M)
    needed = {"U", "p", "phi"} if laminar else {"U", "p", "phi", "k", "omega", "nut"}
    files = [member for member in path.iterdir() if member.is_file()]
    if re.search(r"^bodyWall\s+movingWallVelocity;", parameters, re.M):  # the mesh goes on from where it stands
        files.append(path / "polyMesh" / "points")
    ended = all(member.is_file() and _ends_well(member) for member in files)
    return ended and needed <= {member.name for member in files} and (path / "uniform" / "time").exists()


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
