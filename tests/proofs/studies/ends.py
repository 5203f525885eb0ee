"""Studies of airflows: inlet and outlet, the locked band, and air that sees the body vibrate (docs/validation.md).

domain: One table a rung: the scene with its inlet and outlet at so many body widths from the body; in the last row they
are furthest off, and the last columns compare each row's shares with that one's. Other ends move cells everywhere:
every row is the mean over meshes of slightly different cells, with its standard error.

locked_band: Where vibration along the air takes over the vortex shedding of a rhombus (or a prism) at Re 100: whether
the lift repeats with the vibration or with every second one, and how much the means differ from a body at rest. Every
run is kept in the folder, so an interrupted series goes on.

vibrating_air: What leaving the body's motion out of the air changes of the shipped scene's time-resolved wake and of
its shares: the same machine and granules in air that sees the body at rest and in air that sees it vibrate, at the
scene's own frequency and at twice that of the shedding, where a wake locks, both with the scene's own a w / U. Each row
is the mean over meshes of slightly different cells, with its standard error.

wake_ends: When the rule ends records of a known mean that no choice of the rule has seen: periods, how far that depends
on the seed, and how often the interval of Cd at the end covers.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from air.test_statistics import STEPS, TRUTH, record
from numpy.typing import NDArray

import wakeflow as wf
from support import shipped
from wakeflow.air.foam.case import FlowSpec, MeshMotion
from wakeflow.air.foam.read import CaseFields, time_folders
from wakeflow.air.foam.solver import run_segment
from wakeflow.air.foam.start import perturb, start_from
from wakeflow.air.foam.statistics import CD, CL, Stopping, evaluate, read_table, upward_crossings
from wakeflow.air.foam.watch import Watch
from wakeflow.air.mesh import build_mesh, ends, plan_mesh
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.laws.best_estimate import NO_ESTIMATE
from wakeflow.laws.shape import shapes
from wakeflow.planning.terms import VIBRATION
from wakeflow.runs.planned import make_plan

from .common import BARE, Row, fresh_case, kept, mean_and_error, show, with_one_fraction

# -- domain ------------------------------------------------------------------------------------------------------------
DISTANCES = ((3.5, 8.0), None, (12.0, 25.0))  # before, behind, in body widths; None: what the program chooses
SCALES = {"draft": 1.0, "standard": 1.5}  # numerics.mesh_scale by rung
MESHES = 1.0 + 0.03 * (np.arange(8) - 3.5)  # factors on it
COUNT = 2048
QUICK_SCALES, QUICK_COUNT = 4.0 * MESHES[3:5] / MESHES[4], 64
ACCURACY = 0.02  # statistics sharper than the answer's
AIR = {"Cd": "cd", "Cl rms": "cl_rms", "Cp base": "cp_base"}
DOMAIN_COLUMNS = {
    "before, D": "{before:.1f}", "behind, D": "{behind:.1f}", "cells": "{cells:.0f}",
    **{head: f"{{{key}}}" for head, key in AIR.items()},
    "change of shares, points: largest": "{largest}", "of each fraction in its bins": "{meant}",
}  # fmt: skip


def moved(scene: wf.Scene, rung: str, distances: tuple[float, float] | None) -> Pipeline:
    """The scene with its inlet and outlet at ``distances`` (body widths) from the body."""
    plan = make_plan(scene, rung=rung, force=BARE)
    made = Pipeline(scene, replace(plan, airflow=replace(plan.airflow, accuracy=ACCURACY)))
    for air in (*made.airs.resolved, *made.airs.steady):
        spec = air.mesh_spec
        before, behind = distances or ends(spec.width / spec.projected_width)
        outline, size = np.array(spec.bodies[0]), spec.widths[0]
        top, bottom = outline[:, 1].max() + before * size, outline[:, 1].min() - behind * size
        air.mesh_spec = replace(spec, top=float(top), bottom=float(bottom))
    return made


def shares(pipeline: Pipeline) -> dict[str, np.ndarray]:
    """Mean share of each fraction in every bin."""
    bins = len(pipeline.scene.bin)
    return {name: landing.counts(bins).mean(axis=0) for name, landing in pipeline.tracks().landings.items()}


def domain_rows(
    scene: wf.Scene, rung: str, scales: Sequence[float], distances: Sequence[tuple[float, float] | None]
) -> Iterator[Row]:
    """A row a place of the ends."""
    meshes = [scene.replace({"numerics.mesh_scale": float(scale)}) for scale in scales]
    made = [[moved(mesh, rung, each) for mesh in meshes] for each in distances]
    found = [[shares(pipeline) for pipeline in row] for row in made]
    bins = list(scene.bin)
    targets = {name: [bins.index(place) for place in fraction.targets] for name, fraction in scene.fraction.items()}
    for row, mine in zip(made, found, strict=True):
        spec, airs = row[0].air.in_case.mesh_spec, [pipeline.airflow for pipeline in row]
        outline, size = np.array(spec.bodies[0]), spec.widths[0]
        moves = {
            name: 100 * np.array([one[name] - last[name] for one, last in zip(mine, found[-1], strict=True)])
            for name in scene.fraction
        }
        every = np.concatenate(list(moves.values()), axis=1)
        meant = {name: move[:, targets[name]].sum(axis=1) for name, move in moves.items()}
        yield {
            "before": (spec.top - outline[:, 1].max()) / size, "behind": (outline[:, 1].min() - spec.bottom) / size,
            "cells": np.mean([air.cells for air in airs]),
            **{key: mean_and_error([getattr(air, key).value for air in airs]) for key in AIR.values()},
            "largest": mean_and_error(every[:, np.abs(every.mean(axis=0)).argmax()], 2, "+"),
            "meant": ", ".join(f"{mean_and_error(move, 2, '+')} {name}" for name, move in meant.items()),
        }  # fmt: skip


def domain(*rungs: str, count: int | None = None, only: str | None = None, quick: bool = False) -> list[Row]:
    """Inlet and outlet at other distances, on draft and standard; ``count`` granules of each fraction, or of the
    ``only`` one that flies.
    """
    scene, found = shipped("rhombus", {"feed.count": count or (QUICK_COUNT if quick else COUNT)}), []
    if only is not None:
        scene = with_one_fraction(scene, only)
    for rung in rungs or SCALES:
        scales = QUICK_SCALES if quick else SCALES[rung] * MESHES
        title = f"{rung}, {len(scales)} meshes of mesh_scale {min(scales):.3g} to {max(scales):.3g}"
        title += f", {scene.feed.count} granules a fraction"
        found += show(DOMAIN_COLUMNS, domain_rows(scene, rung, scales, DISTANCES[:2] if quick else DISTANCES), title)
    return found


# -- locked_band -------------------------------------------------------------------------------------------------------
WIDTH, SPEED, REYNOLDS = 0.05, 1.0, 100.0
SPEEDS = (0.02, 0.05, 0.1, 0.2, 0.4)  # a w / U
FREQUENCIES = (0.5, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.5, 1.8, 1.9, 1.95, 2.0, 2.05, 2.1, 2.2, 3.0)  # f / fs
PERIODS, QUICK = (12, 20), (1, 2)  # shedding periods before and in the measurement
GUESS = 0.2 * SPEED / WIDTH  # Hz, of the shedding, while the lift has not crossed its mean twice
HARMONICS = 6  # of a period: more would explain by chance
SAME = 0.98  # correlation from which on the lift repeats
BODIES: dict[str, dict[str, Any]] = {
    "rhombus": {"slope_angle": math.pi / 4},
    "prism": {"slope_angle": math.pi / 3, "apex": "up"},
}
BAND_COLUMNS = {
    "a w / U": "{speed:g}", "f / fs": "{ratio:g}", "a / D": "{amplitude:.3f}", "lift / fs": "{lift:.3f}",
    "repeats": "{kind} ({correlation:.3f})", "Cd": "{cd:+.1f*100} %", "Cl rms": "{cl_rms:+.1f*100} %",
    "Cp base": "{cp_base:+.1f*100} %", "mean velocity": "{shift:.3f}",
}  # fmt: skip
AVERAGE = """
functions {{ average {{
    type fieldAverage; libs ("libfieldFunctionObjects.so"); writeControl onEnd; timeStart {begin:.12g};
    fields ( U {{ mean on; prime2Mean off; base time; }} p {{ mean on; prime2Mean off; base time; }} );
}} }}
"""


def repeats(clock: NDArray[np.float64], signal: NDArray[np.float64], period: float) -> float:
    """How much of a signal's variance repeats with ``period`` (s): 1 for a signal locked to it, near 0 without.

    ``clock`` (n,) s, even; ``signal`` (n,). The share of the variance that a least-squares sum of the first HARMONICS
    harmonics of the period explains; a neighbouring frequency counts as different once it slips by one cycle over the
    clock. A signal that does not move repeats with any period.
    """
    angle = np.arange(1, HARMONICS + 1) * (2.0 * math.pi / period * (clock - clock[0]))[:, None]
    waves = np.column_stack([np.ones(len(clock)), np.cos(angle), np.sin(angle)])
    left = signal - waves @ np.linalg.lstsq(waves, signal, rcond=None)[0]
    variance = float(np.var(signal))
    return 1.0 if variance == 0.0 else 1.0 - float(np.mean(left**2)) / variance


@dataclass(frozen=True)
class Series:
    """The runs of one body in one folder; ``periods`` of shedding before and in the measurement."""

    folder: Path
    body: str
    periods: tuple[int, int]

    def flow(self, vibration: MeshMotion | None = None) -> FlowSpec:
        """The body in a channel ten times as wide, on about 1600 cells."""
        outline = shapes[self.body](width=WIDTH, **BODIES[self.body])
        ends = {"top": 5 * WIDTH, "bottom": -12 * WIDTH}
        mesh = plan_mesh([outline], width=10 * WIDTH, direction="down", rung="standard", scale=2.5, **ends)
        air = {"speed": SPEED, "density": 1.2, "viscosity": 1.2 * SPEED * WIDTH / REYNOLDS}
        return FlowSpec(mesh, **air, turbulence="laminar", stepping="time-resolved", vibration=vibration)

    def solve(self, spec: FlowSpec, name: str, start: Path | None, shedding: float) -> dict[str, float]:
        """Run through the start-up and the window; mean Cd, rms of Cl, base pressure, frequency of the lift (Hz)."""
        before, window = self.periods
        begin, end = before / shedding, (before + window) / shedding
        case = fresh_case(spec, self.folder / "mesh.msh", self.folder / name / "case")
        start_from(spec, case, start)
        if start is None:
            perturb(spec, case)
        with (case / "system" / "controlDict").open("a") as stream:
            stream.write(AVERAGE.format(begin=begin))
        watch = Watch(case, "locked band", lambda _: None, expected=end)
        run_segment(case, "pimpleFoam", end, {"deltaT": 0.2 * spec.mesh.h_corner / spec.speed}, watch)
        band_rows = read_table(case, "forceCoefficients", (CD, CL))
        band_rows = band_rows[band_rows[:, 0] >= begin]
        clock = np.linspace(band_rows[0, 0], band_rows[-1, 0], 60 * window)
        drag, lift = (np.interp(clock, band_rows[:, 0], band_rows[:, i]) for i in (1, 2))
        crossings = upward_crossings(clock, lift)
        found = {
            "cd": float(drag.mean()), "cl_rms": float(lift.std()), "cp_base": base_pressure(spec, case),
            "frequency": (len(crossings) - 1) / float(crossings[-1] - crossings[0]) if len(crossings) > 1 else GUESS,
        }  # fmt: skip
        if spec.vibration is not None:
            period = spec.vibration.period
            found |= {"one": repeats(clock, lift, period), "two": repeats(clock, lift, 2 * period)}
        return found

    def at_rest(self) -> dict[str, float]:
        """The body at rest: started with a push on a guessed frequency, then over whole windows of its own."""
        if not (self.folder / "mesh.msh").exists():
            build_mesh(replace(self.flow()).mesh, self.folder)
        first = self.solve(self.flow(), "first", None, GUESS)
        return self.solve(self.flow(), "rest", self.folder / "first" / "case", first["frequency"])

    def vibrating(self, name: str, speed: float, frequency: float, shedding: float) -> dict[str, float]:
        """A run in which the body moves with ``speed`` (over U) at ``frequency`` (Hz)."""
        omega, rest = 2 * math.pi * frequency, self.folder / "rest" / "case"
        found = self.solve(self.flow(MeshMotion(speed * SPEED / omega, omega)), name, rest, shedding)
        found["shift"] = mean_shift(self.folder / name / "case", rest)
        shutil.rmtree(self.folder / name / "case")
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
    near = np.abs(CaseFields(one).mesh.plane.centres).max(axis=1) < 3 * WIDTH
    means = [CaseFields(case).field(time_folders(case)[-1], "UMean")[0][near] for case in (one, other)]
    return float(np.linalg.norm(means[0] - means[1], axis=1).max() / SPEED)


def band_rows(series: Series, rest: dict[str, float], quick: bool) -> Iterator[Row]:
    """A row for every speed and frequency."""
    for speed, ratio in product(SPEEDS[: 1 if quick else None], FREQUENCIES[: 1 if quick else None]):
        name, shedding = f"{speed:g}-{ratio:g}", rest["frequency"]
        frequency = ratio * shedding
        made = (name, speed, frequency, shedding)
        found = kept(series.folder / name / "found.json", lambda made=made: series.vibrating(*made))
        yield {
            "speed": speed, "ratio": ratio, "amplitude": speed * SPEED / (2 * math.pi * frequency * WIDTH),
            "lift": found["frequency"] / shedding, "correlation": max(found["one"], found["two"]),
            "kind": "f" if found["one"] > SAME else "f/2" if found["two"] > SAME else "no", "shift": found["shift"],
            **{key: found[key] / rest[key] - 1 for key in ("cd", "cl_rms", "cp_base")},
        }  # fmt: skip


def locked_band(
    folder: Path = Path("runs/locked-band"), body: Literal["rhombus", "prism"] = "rhombus", *, quick: bool = False
) -> list[Row]:
    """Locked band of a vibrating body; ``quick``: one run, far too short to say anything."""
    series = Series(folder / body, body, QUICK if quick else PERIODS)
    rest = kept(series.folder / "rest" / "found.json", series.at_rest)
    print(f"at rest: St {rest['frequency'] * WIDTH / SPEED:.4f}, Cd {rest['cd']:.3f}, Cl rms {rest['cl_rms']:.3f}, "
          f"Cp base {rest['cp_base']:.3f}\n")  # fmt: skip
    return show(BAND_COLUMNS, band_rows(series, rest, quick))


# -- vibrating_air -----------------------------------------------------------------------------------------------------
TIMES_FS = (None, 2.0)  # f over the wake's own frequency at rest; None: the scene's own f
VIBRATING_COLUMNS = {
    "f, Hz": "{frequency:.1f}", "f / fs": "{ratio:.2f}", "a w / U": "{speed:.4f}", "cells": "{cells:.0f}",
    "Cd": "{cd} %", "Cl rms": "{cl_rms} %", "Cp base": "{cp_base} %", "St": "{strouhal} %",
    "shares, points: largest": "{largest}", "of each fraction in its bins": "{meant}",
}  # fmt: skip


def in_air(scene: wf.Scene, scale: float, *, moving: bool) -> Pipeline:
    """The scene in its time-resolved wake alone, which sees the body vibrate or at rest; no granules meet."""
    made = scene.replace({"numerics.mesh_scale": float(scale)})
    plan = make_plan(made, rung="standard", force={**BARE, "collisions": False, VIBRATION: moving})
    return Pipeline(
        made, replace(plan, airflow=replace(plan.airflow, accuracy=ACCURACY, wake=NO_ESTIMATE, brackets=False))
    )


def numbers_of(pipeline: Pipeline) -> dict[str, float]:
    """What the air does: coefficients and Strouhal number."""
    return {key: getattr(pipeline.airflow, key).value for key in ("cd", "cl_rms", "cp_base", "strouhal")}


def vibrating_rows(scene: wf.Scene, scales: Sequence[float], ratios: Sequence[float | None]) -> Iterator[Row]:
    """A row for every frequency."""
    amplitude = float(np.abs(scene.motion[0]).max()) * scene.motion[1] / scene.air.speed
    still = [in_air(scene, scale, moving=False) for scale in scales]
    rest = [numbers_of(pipeline) for pipeline in still]
    shedding = float(np.mean([one["strouhal"] for one in rest])) * scene.air.speed / scene.width
    bins = list(scene.bin)
    targets = {name: [bins.index(place) for place in fraction.targets] for name, fraction in scene.fraction.items()}
    for ratio in ratios:
        frequency = scene.motion[1] / (2.0 * math.pi) if ratio is None else ratio * shedding
        gamma = amplitude * scene.air.speed * 2.0 * math.pi * frequency / 9.81
        shaken = scene.replace({"vibration.frequency": frequency, "vibration.gamma": gamma})
        pairs = [[in_air(shaken, scale, moving=moving) for moving in (False, True)] for scale in scales]
        moved_to = [numbers_of(pipeline) for _, pipeline in pairs]
        both = list(zip(rest, moved_to, strict=True))
        change = {key: [100.0 * (new[key] / old[key] - 1.0) for old, new in both] for key in rest[0]}
        found = [[shares(pipeline) for pipeline in pair] for pair in pairs]
        moves = {name: 100.0 * np.array([b[name] - a[name] for a, b in found]) for name in scene.fraction}
        every = np.concatenate(list(moves.values()), axis=1)
        meant = {name: move[:, targets[name]].sum(axis=1) for name, move in moves.items()}
        yield {
            "frequency": frequency, "ratio": frequency / shedding, "speed": amplitude,
            "cells": np.mean([pipeline.airflow.cells for _, pipeline in pairs]),
            **{key: mean_and_error(values, 2, "+") for key, values in change.items()},
            "largest": mean_and_error(every[:, np.abs(every.mean(axis=0)).argmax()], 2, "+"),
            "meant": ", ".join(f"{mean_and_error(move, 2, '+')} {name}" for name, move in meant.items()),
        }  # fmt: skip


def vibrating_air(*, meshes: int = 4, scale: float = 1.5, count: int = 4096, quick: bool = False) -> list[Row]:
    """What the body's motion changes in the air of the shipped scene, and of where granules land alone in it.

    ``meshes`` of cells about ``scale`` times the usual, ``count`` granules of each fraction; ``quick``: two coarse
    meshes and the scene's own frequency, far too little to say anything.
    """
    scene = shipped("rhombus", {"feed.count": QUICK_COUNT if quick else count})
    scales = QUICK_SCALES if quick else scale * (1.0 + 0.03 * (np.arange(meshes) - 0.5 * (meshes - 1)))
    return show(VIBRATING_COLUMNS, vibrating_rows(scene, scales, TIMES_FS[: 1 if quick else None]))


# -- wake_ends ---------------------------------------------------------------------------------------------------------
ENDS = {
    "correlation from period to period": "{memory:g}", "spread from period to period, %": "{spread:g*100}",
    "asked, %": "{asked:g*100}", "periods": "{periods:.0f}", "latest / median": "{latest:.2f}",
    "of nine twenties in ten at most": "{most:.2f}", "covers, %": "{covers:.0f*100}",
}  # fmt: skip
RECORDS = (
    (0.0, 0.005, 0.03), (0.0, 0.01, 0.03), (0.3, 0.01, 0.03), (0.0, 0.03, 0.03), (0.3, 0.03, 0.03), (0.6, 0.03, 0.03),
    (0.0, 0.05, 0.03), (0.3, 0.05, 0.03), (-0.4, 0.06, 0.03), (0.6, 0.05, 0.04), (0.3, 0.1, 0.05),
)  # fmt: skip
UNSEEN, LONGEST, TOGETHER, TWENTIES = 5000, 300, 20, 200  # first seed; periods; seeds of which the latest counts; draws


def _ended(memory: float, spread: float, asked: float, seed: int) -> tuple[int, bool]:
    """Periods at which the rule ends a record, and whether the interval of Cd covers then."""
    rows, stopping = record(seed, LONGEST, memory=memory, noise=spread), Stopping(asked)
    end = next((count for count in range(8, LONGEST) if stopping.look(rows[: count * STEPS])), LONGEST)
    found = evaluate(rows[: end * STEPS], asked)
    return end, bool(found) and found.cd.low <= TRUTH["cd"] <= found.cd.high


def _ends(seeds: int) -> Iterator[Row]:
    for memory, spread, asked in RECORDS:
        found = [_ended(memory, spread, asked, UNSEEN + seed) for seed in range(seeds)]
        ends, rng = np.array([end for end, _ in found]), np.random.default_rng(0)
        drawn = [rng.choice(ends, min(TOGETHER, seeds), replace=False) for _ in range(TWENTIES)]
        over = [twenty.max() / np.median(twenty) for twenty in drawn]
        yield {
            "memory": memory, "spread": spread, "asked": asked, "periods": float(np.median(ends)),
            "latest": float(np.median(over)), "most": float(np.quantile(over, 0.9)),
            "covers": float(np.mean([covers for _, covers in found])),
        }  # fmt: skip


def wake_ends(*, seeds: int = 160) -> list[Row]:
    """When a wake in time ends whose drag has a known mean."""
    return show(ENDS, _ends(seeds))
