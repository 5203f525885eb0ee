"""Measure where vibration along the air takes over the vortex shedding of a rhombus (or a prism) at Re 100.

.venv/bin/python cases/studies/locked_band.py runs/locked-band [rhombus|prism] [--quick]

Every run takes some 10 s of one core and is kept in the folder, so an interrupted series goes on. Prints the table of
docs/validation.md: for each speed ratio a w / U and frequency ratio f / fs whether the lift repeats with the vibration
or with every second one, and how much mean drag, lift, base pressure and velocity differ from a body at rest.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakeflow.core.files import write_json
from wakeflow.foam.case import FlowSpec
from wakeflow.foam.case_fields import CaseFields, time_folders
from wakeflow.foam.history import CD, CL, read_table, upward_crossings
from wakeflow.foam.mesh_motion import MeshMotion, repeats
from wakeflow.foam.prepare import prepare_case
from wakeflow.foam.segments import run_segment
from wakeflow.foam.start import perturb, start_from
from wakeflow.foam.watch import Watch
from wakeflow.laws.shape import shapes
from wakeflow.meshing import build_mesh, plan_mesh

Array = NDArray[np.float64]
WIDTH, SPEED, REYNOLDS = 0.05, 1.0, 100.0
SPEEDS = (0.02, 0.05, 0.1, 0.2, 0.4)  # a w / U
FREQUENCIES = (0.5, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.5, 1.8, 1.9, 1.95, 2.0, 2.05, 2.1, 2.2, 3.0)  # f / fs
PERIODS = (12, 20)  # shedding periods before and in the measurement
QUICK = (1, 2)
GUESS = 0.2 * SPEED / WIDTH  # Hz, of the shedding, while the lift has not crossed its mean twice
AVERAGE = """
functions {{ average {{
    type fieldAverage; libs ("libfieldFunctionObjects.so"); writeControl onEnd; timeStart {begin:.12g};
    fields ( U {{ mean on; prime2Mean off; base time; }} p {{ mean on; prime2Mean off; base time; }} );
}} }}
"""


def flow(body: str, vibration: MeshMotion | None) -> FlowSpec:
    """The body in a channel ten times as wide, on about 1600 cells."""
    how: dict[str, Any] = (
        {"slope_angle": math.pi / 4} if body == "rhombus" else {"slope_angle": math.pi / 3, "apex": "up"}
    )
    outline = shapes[body](width=WIDTH, **how)
    ends = {"top": 5 * WIDTH, "bottom": -12 * WIDTH}
    mesh = plan_mesh([outline], width=10 * WIDTH, direction="down", rung="standard", scale=2.5, **ends)
    air = {"speed": SPEED, "density": 1.2, "viscosity": 1.2 * SPEED * WIDTH / REYNOLDS}
    return FlowSpec(mesh, **air, turbulence="laminar", stepping="time-resolved", vibration=vibration)  # type: ignore[arg-type]


def solve(
    spec: FlowSpec, folder: Path, msh: Path, start: Path | None, shedding: float, periods: tuple[int, int]
) -> dict[str, float]:
    """Run through the start-up and the window; mean Cd, rms of Cl, base pressure, frequency of the lift (Hz)."""
    before, window = periods
    begin, end = before / shedding, (before + window) / shedding
    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    case.mkdir(parents=True)
    prepare_case(spec, msh, case)
    start_from(spec, case, start)
    if start is None:
        perturb(spec, case)
    with (case / "system" / "controlDict").open("a") as stream:
        stream.write(AVERAGE.format(begin=begin))
    watch = Watch(case, "locked band", lambda _: None, expected=end)
    run_segment(case, "pimpleFoam", end, {"deltaT": 0.2 * spec.mesh.h_corner / spec.speed}, watch)
    rows = read_table(case, "forceCoefficients", (CD, CL))
    rows = rows[rows[:, 0] >= begin]
    clock = np.linspace(rows[0, 0], rows[-1, 0], 60 * window)
    drag, lift = (np.interp(clock, rows[:, 0], rows[:, i]) for i in (1, 2))
    crossings = upward_crossings(clock, lift)
    found = {
        "cd": float(drag.mean()), "cl_rms": float(lift.std()), "cp_base": base_pressure(spec, case),
        "frequency": (len(crossings) - 1) / float(crossings[-1] - crossings[0]) if len(crossings) > 1 else GUESS,
    }  # fmt: skip
    if spec.vibration is not None:
        period = spec.vibration.period
        found |= {"one": repeats(clock, lift, period), "two": repeats(clock, lift, 2 * period)}
    return found


def base_pressure(spec: FlowSpec, case: Path) -> float:
    """Mean pressure coefficient at the middle of the rear, against the inlet's."""
    fields = CaseFields(case)
    pressure = fields.field(time_folders(case)[-1], "pMean")[1]
    plane = fields.mesh.plane
    rear = np.array([0.0, min(y for _, y in spec.mesh.bodies[0])])
    body = np.flatnonzero(fields.wall)
    nearest = body[np.argsort(np.linalg.norm(plane.midpoints[body] - rear, axis=1))[:2]]
    inlet = np.average(pressure[plane.on("inlet")], weights=plane.lengths[plane.on("inlet")])
    return float((pressure[nearest].mean() - inlet) / (0.5 * spec.speed**2))


def mean_shift(one: Path, other: Path) -> float:
    """Largest difference of two mean velocities over U, within three widths of the body."""
    fields = CaseFields(one)
    near = np.abs(fields.mesh.plane.centres).max(axis=1) < 3 * WIDTH
    means = [CaseFields(case).field(time_folders(case)[-1], "UMean")[0][near] for case in (one, other)]
    return float(np.linalg.norm(means[0] - means[1], axis=1).max() / SPEED)


def at_rest(folder: Path, body: str, msh: Path, periods: tuple[int, int]) -> dict[str, float]:
    """The body at rest: started with a push on a guessed frequency, then over whole windows of its own."""
    done = folder / "rest" / "found.json"
    if not done.exists():
        spec = flow(body, None)
        first = solve(spec, folder / "first", msh, None, GUESS, periods)
        found = solve(spec, folder / "rest", msh, folder / "first" / "case", first["frequency"], periods)
        write_json(done, found)
    return json.loads(done.read_text())


def one(
    folder: Path, body: str, msh: Path, speed: float, frequency: float, rest: dict[str, float],
    periods: tuple[int, int],
) -> dict[str, float]:  # fmt: skip
    """One vibrating run, against the body at rest; kept as found.json."""
    here = folder / f"{speed:g}-{frequency:g}"
    done = here / "found.json"
    if not done.exists():
        omega = 2 * math.pi * frequency * rest["frequency"]
        spec = flow(body, MeshMotion(speed * SPEED / omega, omega))
        found = solve(spec, here, msh, folder / "rest" / "case", rest["frequency"], periods)
        shift = mean_shift(here / "case", folder / "rest" / "case")
        write_json(done, {**found, "shift": shift})
        shutil.rmtree(here / "case")
    return json.loads(done.read_text())


def main(folder: Path, body: str, quick: bool = False) -> None:
    """Print the table of one body, runs kept below ``folder``; ``quick``: one run, far too short to tell anything."""
    folder = folder / body
    periods = QUICK if quick else PERIODS
    if not (folder / "mesh.msh").exists():
        build_mesh(replace(flow(body, None)).mesh, folder)
    msh = folder / "mesh.msh"
    rest = at_rest(folder, body, msh, periods)
    print(f"at rest: St {rest['frequency'] * WIDTH / SPEED:.4f}, Cd {rest['cd']:.3f}, Cl rms {rest['cl_rms']:.3f}, "
          f"Cp base {rest['cp_base']:.3f}\n")  # fmt: skip
    print("| a w / U | f / fs | a / D | lift / fs | repeats | Cd | Cl rms | Cp base | mean velocity |")
    print("|---|---|---|---|---|---|---|---|---|")
    for speed in SPEEDS[:1] if quick else SPEEDS:
        for frequency in FREQUENCIES[:1] if quick else FREQUENCIES:
            found = one(folder, body, msh, speed, frequency, rest, periods)
            kind = "f" if found["one"] > 0.98 else "f/2" if found["two"] > 0.98 else "no"
            amplitude = speed * SPEED / (2 * math.pi * frequency * rest["frequency"] * WIDTH)
            cells = [
                f"{speed:g}",
                f"{frequency:g}",
                f"{amplitude:.3f}",
                f"{found['frequency'] / rest['frequency']:.3f}",
            ]
            cells += [f"{kind} ({max(found['one'], found['two']):.3f})"]
            cells += [f"{100 * (found[key] / rest[key] - 1):+.1f} %" for key in ("cd", "cl_rms", "cp_base")]
            print(f"| {' | '.join(cells)} | {found['shift']:.3f} |", flush=True)


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--quick"]
    main(Path((given or ["runs/locked-band"])[0]), (given[1:] or ["rhombus"])[0], "--quick" in sys.argv)
