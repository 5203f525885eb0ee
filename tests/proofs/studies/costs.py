"""Studies of run time (docs/validation.md, docs/scenes.md).

plan_times: The run time that `wakeflow plan` expects of each shipped scene next to the time that `wakeflow run` then
takes, each in a cache of its own: *new* is what is expected of a machine on which nothing has run, *learned* what is
expected once the scenes of the rows above have.

cost_by_seed: Processor seconds of each stage of the shipped scenes over ten seeds of their feeds, the largest over the
median. The seeds of a scene share a cache, and a first run, which solves what no seed changes, does not count. What
each run took is kept beside `--cache`: a study that is called again goes on with the next run (of one that was
interrupted what its stages had left counts). `--quick` has the settings of a quick answer; `--unloaded` leaves out the
granules' force on the air, which solves the airflow anew for every seed.

sweep_speed: Two workers against one, where OpenFOAM bounds (airflows) and where tracking does (tracks), 100 feeds over
5 airflows, and airflows solved on from a neighbour's. Every sweep has an empty cache, but for the compiled tracker.

threads: How much faster more threads fly the answer's granules through its own air: 1 and 2 measured, 4 and 8 by the
times that blocks of granules take alone, handed out in their order as threads become free.

mpi_ranks: From how many cells a second MPI rank pays: the shipped rhombus' steady airflow on finer and finer meshes.

time_resolved_cost: What the shipped rhombus' time-resolved airflow costs, and its error, with other steps, cells and
solvers, each averaged over whole periods of one flow time. Cost is the solver's processor time (user).
"""

from __future__ import annotations

import heapq
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import wakeflow as wf
from proofs.scene_curves import one_cache
from support import CASES, shipped
from wakeflow.air.foam.case import FlowSpec, write_parameters
from wakeflow.air.foam.programs import call, scatter
from wakeflow.air.foam.start import first_step, start_from
from wakeflow.air.foam.statistics import Tail, cycles
from wakeflow.air.kinds.airflow_kinds import Realisations, flow_spec, mesh_spec
from wakeflow.air.mesh import build_mesh
from wakeflow.core.code_key import code_key
from wakeflow.core.files import read_json, write_json
from wakeflow.core.process import cores
from wakeflow.core.store import content_key
from wakeflow.flight import Granules
from wakeflow.flight.driver import BLOCK
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight
from wakeflow.flight.stages.machine_rates import on_this_machine
from wakeflow.planning.cost import wall_seconds
from wakeflow.planning.plan import REPLICATES
from wakeflow.runs.progress import DONE, FROM_CACHE

from .common import Row, compile_slab, compile_tracker, fresh_case, make_plan, piped, show, solver_seconds

# -- threads -----------------------------------------------------------------------------------------------------------
THREADS, SIMULATED = (1, 2), (4, 8)
THREAD_COLUMNS = {
    "fraction": "{name}", "granules": "{count}", "s on one thread": "{one:.1f}",
    **{f"{n} threads, times": f"{{by{n}:.2f}}" for n in (*THREADS[1:], *SIMULATED)}, "same places": "{same:yes|NO}",
}  # fmt: skip


def makespan(blocks: Sequence[float], threads: int) -> float:
    """Seconds until the last of ``blocks`` (s) is done, each begun by the thread that is free first."""
    free = [0.0] * threads
    for block in blocks:
        heapq.heapreplace(free, free[0] + block)
    return max(free)


def thread_rows(scene: wf.Scene, rung: str) -> Iterator[Row]:
    """A row a fraction."""
    pipeline = piped(scene, rung, QUIET)
    flight = Flight(scene, pipeline.plan, Realisations(pipeline.field[1]), scene.numerics.tolerance)
    for name in scene.fraction:
        grains = feedstock(scene, pipeline.plan, name, pipeline.field[1].period, range(REPLICATES)).granules

        def flown(workers: int, some: slice, name: str = name, grains: Granules = grains) -> tuple[float, np.ndarray]:
            started = time.perf_counter()
            found = replace(flight, workers=workers).fly(name, grains[some])
            return time.perf_counter() - started, found.position

        flown(1, slice(BLOCK))  # the field is packed
        measured = {workers: flown(workers, slice(None)) for workers in THREADS}
        blocks = [flown(1, slice(low, low + BLOCK))[0] for low in range(0, len(grains), BLOCK)]
        one = measured[1][0]
        yield {
            "name": name, "count": len(grains), "one": one, "by2": one / measured[2][0],
            **{f"by{n}": sum(blocks) / makespan(blocks, n) for n in SIMULATED},
            "same": bool(np.array_equal(measured[1][1], measured[2][1])),
        }  # fmt: skip


def threads(rung: str = "standard", *, count: int = 65536) -> list[Row]:
    """What more threads save; ``count`` granules of each fraction of the shipped rhombus."""
    changes = {"feed.count": count, **({} if count > 1024 else {"numerics.mesh_scale": 3.0})}
    compile_tracker()
    return show(THREAD_COLUMNS, thread_rows(shipped("rhombus", changes), rung))


# -- plan_times --------------------------------------------------------------------------------------------------------
SCENES = ("vacuum", "aspirator", "wheat-straw-dust", "rhombus", "labyrinth", "prism")
RATES = "machine-rates.json"
PLAN_COLUMNS = {
    "scene": "{scene}", "new, s": "{new:.0f}", "learned, s": "{learned:.0f}", "took, s": "{took:.0f}",
    "new / took": "{by_new:.2f}", "learned / took": "{by_learned:.2f}",
}  # fmt: skip
STAGES = {
    "scene": "{scene}", "stage": "{stage.name}", "when": "{stage.when}", "times": "{stage.times}",
    "expected, s each": "{stage.seconds:.1f}", "took, s the last": "{took:.1f}",
}  # fmt: skip


def run_of(name: str, scratch: Path, rung: str | None, count: int | None) -> Row:
    """What one scene is expected to take, and takes; the cache of ``scratch`` learns from it."""
    cache, out = scratch / f"cache-{name}", scratch / name
    cache.mkdir()
    scene = shipped(name, {} if count is None else {"feed.count": count})
    plan = make_plan(scene, rung=rung)
    new = wall_seconds(on_this_machine(plan, cache)[0], cores())
    if (scratch / RATES).exists():
        shutil.copy(scratch / RATES, cache / RATES)
    learned = wall_seconds(on_this_machine(plan, cache)[0], cores())
    command = [sys.executable, "-m", "wakeflow.cli", "run", str(CASES / f"{name}.toml"), "--out", str(out), "--quiet"]
    command += ["--set", f"feed.count={scene.feed.count}"] + ([] if rung is None else ["--rung", rung])
    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"WAKEFLOW_CACHE": str(cache)})
    took = time.monotonic() - began
    if done.returncode:
        raise SystemExit(f"plan_times: {' '.join(command)} ended with {done.returncode}: {done.stderr}")
    if (cache / RATES).exists():
        shutil.copy(cache / RATES, scratch / RATES)
    shutil.rmtree(cache)
    return {
        "scene": name, "new": new, "learned": learned, "took": took, "by_new": new / took, "by_learned": learned / took,
        "stages": plan.stages, "spent": wf.Result.load(out).seconds,
    }  # fmt: skip


def farthest(ratios: Sequence[float]) -> float:
    """The largest factor, either way."""
    return max(max(ratio, 1.0 / ratio) for ratio in ratios)


def stages_of(rows: Sequence[Row]) -> Iterator[Row]:
    """Every stage of each scene."""
    for row in rows:
        for stage in row["stages"]:
            spent = row["spent"].get(stage.name)
            yield {"scene": row["scene"], "stage": stage, "took": None if spent is None else spent.seconds}


def plan_times(*scenes: str, rung: str | None = None, count: int | None = None, stages: bool = False) -> list[Row]:
    """Run times expected and taken, a row a scene as each is done."""
    compile_tracker()
    compile_slab()
    with TemporaryDirectory(prefix="wakeflow-") as folder:
        rows = show(PLAN_COLUMNS, (run_of(name, Path(folder), rung, count) for name in scenes or SCENES))
    print(f"\nOff by a factor {farthest([row['by_new'] for row in rows]):.2f} at most on a new machine", end="")
    if len(rows) > 1:
        print(f", {farthest([row['by_learned'] for row in rows[1:]]):.2f} once it has run a scene", end="")
    print(".")
    if stages:
        print()
        show(STAGES, stages_of(rows))
    return rows


# -- cost_by_seed ------------------------------------------------------------------------------------------------------
SEED_COLUMNS = {
    "scene": "{scene}", "stage": "{stage}", "seeds": "{seeds}", "median, CPU s": "{median:.2f}",
    "largest": "{largest:.2f}", "largest / median": "{ratio:.2f}",
}  # fmt: skip


def stage_seconds(scene: wf.Scene, out: Path, how: Mapping[str, Any]) -> dict[str, float]:
    """Processor seconds (this process and those it started) by stage that a run computes, and of the run (``whole``):
    from the end of one stage to that of the next, so that what runs beside a stage counts to the one that ends first.
    """
    spent: dict[str, float] = {}
    clock = [time.process_time() + solver_seconds()] * 2

    def hear(stage: str, text: str) -> None:
        if text.startswith(DONE):
            clock[1], before = time.process_time() + solver_seconds(), clock[1]
            if not text.startswith(FROM_CACHE):
                spent[stage] = spent.get(stage, 0.0) + clock[1] - before

    wf.run(scene, out, listener=hear, report=False, **how)
    return {**spent, "whole": time.process_time() + solver_seconds() - clock[0]}


def seed_rows(name: str, seeds: int, kept: Path, how: Mapping[str, Any], count: int | None) -> Iterator[Row]:
    """A row a stage of one scene, the dearest first; what each run took is ``kept`` in a folder. Before the first that
    is made now one runs that does not count, which loads what is imported and solves what no seed changes.
    """
    runs, warm = list[dict[str, float]](), False
    for seed in range(1, seeds + 1):
        scene = shipped(name, {"feed.seed": seed, **({} if count is None else {"feed.count": count})})
        path = kept / f"{content_key(repr(scene.tables()), repr(how), code_key('wakeflow.runs.one_run'))}.json"
        if not path.exists():
            with TemporaryDirectory(prefix="wakeflow-") as out:
                if not warm:
                    stage_seconds(scene.replace({"feed.seed": 0}), Path(out, "first"), how)
                write_json(path, stage_seconds(scene, Path(out, "run"), how))
            warm = True
        runs.append(read_json(path))
    by_stage = {stage: [run[stage] for run in runs if stage in run] for run in runs for stage in run}
    for stage, spent in sorted(by_stage.items(), key=lambda one: -max(one[1])):
        median, largest = float(np.median(spent)), max(spent)
        yield {
            "scene": name, "stage": stage, "seeds": len(spent), "median": median, "largest": largest,
            "ratio": largest / max(median, 1e-9),
        }  # fmt: skip


def cost_by_seed(
    *scenes: str,
    seeds: int = 10,
    rung: str | None = None,
    count: int | None = None,
    cache: Path | None = None,
    quick: bool = False,
    unloaded: bool = False,
) -> list[Row]:
    """Processor seconds of each stage over seeds; ``cache``: that of airflows that are there, else an empty one."""
    compile_tracker()
    compile_slab()
    how = {"rung": rung, "quick": quick, "force": {"air-loading": False} if unloaded else None}
    with TemporaryDirectory(prefix="wakeflow-") as folder:
        stages = cache or Path(folder, "cache")
        kept = stages.with_name(f"{stages.name}-cost-by-seed")
        kept.mkdir(parents=True, exist_ok=True)
        with one_cache(stages):
            rows = (row for name in scenes or SCENES for row in seed_rows(name, seeds, kept, how, count))
            return show(SEED_COLUMNS, rows)


# -- sweep_speed -------------------------------------------------------------------------------------------------------
QUIET = {"collisions": False, "air-loading": False}  # the stages of airflow and tracks alone
FINER = 0.95  # of mesh_scale
NEIGHBOURS = {
    "mesh_scale": "{scale:.3g}", "air, m/s": "{speed:g}", "iterations, from rest": "{rest[0]}",
    "from the neighbour": "{near[0]}", "s, from rest": "{rest[1]:.1f}", "s": "{near[1]:.1f}",
    "Cd, from rest": "{rest[2]:.5f}", "Cd": "{near[2]:.5f}",
}  # fmt: skip


def swept(scene: wf.Scene, over: Mapping[str, Any], workers: int) -> tuple[float, wf.Sweep]:
    """Seconds of a sweep, and the sweep."""
    folder = Path(tempfile.mkdtemp(prefix="sweep-speed-"))
    allowed, rung = os.sched_getaffinity(0), "draft" if "air.speed" in over else None
    os.sched_setaffinity(0, sorted(allowed)[:workers])
    try:
        with one_cache(folder / "cache"):
            started = time.monotonic()
            done = wf.sweep(
                wf.variants(scene, over), folder / "sweep", rung=rung, force=QUIET, workers=workers, figures=False
            )
            spent = time.monotonic() - started
    finally:
        os.sched_setaffinity(0, allowed)
    if done.failed:
        raise SystemExit(f"failed: {done.failed}")
    return spent, done


def two_against_one(what: str, scene: wf.Scene, over: Mapping[str, Any]) -> None:
    """Print what a second worker saves."""
    one, two = (swept(scene, over, count)[0] for count in (1, 2))
    print(f"{what}: one worker {one:.1f} s, two {two:.1f} s, {one / two:.2f} times")


def airflows(tiny: bool) -> None:
    """Scenes whose airflows take the time."""
    coarse = shipped("rhombus", {"numerics.mesh_scale": 3.0 if tiny else 1.5, "feed.count": 64})
    two_against_one("OpenFOAM bounds", coarse, {"air.speed": [4.0, 5.0] if tiny else [4.0, 4.5, 5.0, 5.5]})


def tracks(tiny: bool) -> None:
    """Scenes whose granules take the time."""
    many = shipped("vacuum", {"feed.count": 256 if tiny else 2**19})
    two_against_one("tracking bounds", many, {"feed.height": [0.08, 0.1] if tiny else [0.08, 0.09, 0.1, 0.11]})


def feeds(tiny: bool) -> None:
    """Many feeds over few airflows."""
    coarse = {"numerics.mesh_scale": 3.0 if tiny else 1.5, "feed.count": 256 if tiny else 512}
    speeds, heights = (2, 2) if tiny else (5, 20)
    over = {
        "air.speed": {"from": 4.0, "to": 6.0, "count": speeds},
        "feed.height": {"from": 0.08, "to": 0.14, "count": heights},
    }
    spent, done = swept(shipped("rhombus", coarse), over, 1)
    runs = [wf.Result.load(file.parent).seconds for file in done.folder.glob("*/result.json")]
    stages = sum(seconds for _, seconds in {(name, took.seconds) for run in runs for name, took in run.items()})
    print(f"{speeds * heights} feeds over {speeds} airflows: {spent:.1f} s, their stages {stages:.1f} s, "
          f"{spent / stages:.2f} times")  # fmt: skip


def solved(scene: wf.Scene, folder: Path, near: Path | None = None) -> tuple[int, float, float]:
    """Iterations, the solver's seconds, and Cd of a scene's steady airflow."""
    found = wf.run(scene, folder, rung="draft", until="airflow", near=near)
    return found.airflow.steps, found.seconds["airflow"].seconds, found.airflow.cd.value


def _neighbours(tiny: bool, place: Path) -> Iterator[Row]:
    for scale in (3.0,) if tiny else (3.0, 2.0):
        first = place / f"first-{scale:g}"
        solved(shipped("rhombus", {"numerics.mesh_scale": scale}), first)
        for speed in (5.5,) if tiny else (4.0, 4.5, 5.5, 6.0):
            other = shipped("rhombus", {"numerics.mesh_scale": FINER * scale, "air.speed": speed})
            found = {"rest": solved(other, place / "rest"), "near": solved(other, place / "near", first)}
            yield {"scale": FINER * scale, "speed": speed, **found}


def neighbours(tiny: bool) -> list[Row]:
    """Steady airflows from rest and from a neighbour's."""
    with tempfile.TemporaryDirectory() as folder, one_cache(Path(folder, "cache")):
        return show(NEIGHBOURS, _neighbours(tiny, Path(folder)))


PARTS = {part.__name__: part for part in (airflows, tracks, feeds, neighbours)}


def sweep_speed(*parts: str, tiny: bool = False) -> None:
    """What sweeps cost: airflows, tracks, feeds, neighbours. ``tiny``: a few coarse scenes, to see that it works."""
    print(f"{cores()} cores; load {os.getloadavg()[0]:.1f}")
    for part in parts or PARTS:
        PARTS[part](tiny)


# -- mpi_ranks ---------------------------------------------------------------------------------------------------------
SCALES = (0.7, 0.5, 0.4, 0.3)  # of every cell edge of the whole channel's draft
ITERATIONS, FIRST = 60, 10  # run, and left out
MPI_COLUMNS = {
    "cells": "{cells}", "one rank, s an iteration": "{one:.3f}", "two ranks": "{two:.3f}", "gain": "{gain:.2f}"
}  # fmt: skip


@dataclass
class Clock:
    """Hears a solver's lines and notes when each iteration begins (s)."""

    beats: list[float] = field(default_factory=list)

    def __call__(self, line: str) -> None:
        if line.startswith("Time = "):
            self.beats.append(time.monotonic())


def iteration(spec: FlowSpec, msh: Path, case: Path) -> float:
    """Seconds of one iteration, their mean: single ones are heard only every 50 ms."""
    fresh_case(spec, msh, case)
    write_parameters(case, {"endTime": ITERATIONS, "deltaT": 1, "writeControl": "timeStep", "writeInterval": 1000})
    launcher, options = scatter(case)
    clock = Clock()
    call(case, ["simpleFoam", *options], clock, launcher=launcher)
    return (clock.beats[-1] - clock.beats[FIRST]) / (len(clock.beats) - 1 - FIRST)


def mpi_rows(folder: Path, scales: Sequence[float]) -> Iterator[Row]:
    """A row a scale of the mesh; cases are made below ``folder``."""
    plan = make_plan(shipped("rhombus"), rung="draft")
    for scale in scales:
        finer, here = shipped("rhombus", {"numerics.mesh_scale": scale}), folder / f"{scale:g}"
        mesh = replace(mesh_spec(finer, plan), half=False)
        cells, spec = build_mesh(mesh, here).cells, flow_spec(finer, plan, mesh)
        one, two = (iteration(replace(spec, ranks=n), here / "mesh.msh", here / "case") for n in (1, 2))
        yield {"cells": cells, "one": one, "two": two, "gain": one / two}


def mpi_ranks(folder: Path = Path("runs/mpi-ranks"), *, quick: bool = False) -> list[Row]:
    """Seconds an iteration on one MPI rank and on two."""
    return show(MPI_COLUMNS, mpi_rows(folder, (2.0,) if quick else SCALES))


# -- time_resolved_cost ------------------------------------------------------------------------------------------------
SOLUTION = Path("system", "time-resolved", "fvSolution")
SETTLE, PERIODS = 2.0, 9.0  # shedding periods: left out, and run in all
PERIOD = 5.4  # convective times of one
TIME_COLUMNS = {
    "variant": "{variant}", "cells": "{cells}", "steps": "{steps}", "core-s": "{seconds:.0f}", "Cd": "{cd}",
    "Cl rms": "{lift}", "Cp base": "{base}", "periods": "{periods}",
}  # fmt: skip


@dataclass(frozen=True)
class Variant:
    """What differs from the program's own: Courant number, outer correctors, every cell's edge, words of fvSolution."""

    courant: float = 4.0
    correctors: int = 1
    scale: float = 1.0
    corner: float = 1.0  # of the edge at sharp corners
    words: tuple[tuple[str, str], ...] = ()


VARIANTS = {
    "the program's own": Variant(),
    "Courant number 8": Variant(courant=8.0),
    "Courant number 8, two outer correctors": Variant(courant=8.0, correctors=2),
    "Courant number 2": Variant(courant=2.0),
    "cells 0.7 times as long": Variant(scale=0.7),
    "corner cells 1.6 times as long": Variant(corner=1.6),
    "pressure: one level of cells at a time": Variant(words=(("mergeLevels     2", "mergeLevels     1"),)),
    "one pressure correction": Variant(words=(("nCorrectors         2", "nCorrectors         1"),)),
}


def run(scene: wf.Scene, variant: Variant, start: Path, folder: Path) -> tuple[FlowSpec, int, float]:
    """Run one variant from the solved case ``start``: its airflow, number of cells, processor seconds."""
    finer = scene.replace({"numerics.mesh_scale": variant.scale * scene.numerics.mesh_scale})
    plan = make_plan(finer, rung="standard")
    mesh = mesh_spec(finer, plan)
    mesh = replace(mesh, h_corner=variant.corner * mesh.h_corner)
    spec = replace(flow_spec(finer, plan, mesh), max_courant=variant.courant)
    cells = build_mesh(mesh, folder).cells
    case = fresh_case(spec, folder / "mesh.msh", folder / "case")
    start_from(spec, case, start)
    write_parameters(case, {
        "endTime": PERIODS * PERIOD * spec.convective_time, "deltaT": first_step(spec), "writeControl": "timeStep",
        "writeInterval": 10**8, "correctors": variant.correctors,
    })  # fmt: skip
    text = (case / SOLUTION).read_text()
    for here, instead in variant.words:
        assert here in text
        text = text.replace(here, instead)
    (case / SOLUTION).write_text(text)
    before = solver_seconds()
    call(case, ["pimpleFoam"])
    return spec, cells, solver_seconds() - before


def mean(values: np.ndarray, weights: np.ndarray) -> str:
    """Weighted mean and standard error."""
    return f"{np.average(values, weights=weights):.3f} ± {values.std(ddof=1) / np.sqrt(len(values)):.3f}"


def time_rows(scene: wf.Scene, names: Sequence[str], folder: Path) -> Iterator[Row]:
    """A row a variant; cases are made below ``folder``."""
    start = piped(scene, "standard").air.in_case.solution[1] / "case"
    for name in names:
        here = folder / f"{list(VARIANTS).index(name)}"
        spec, cells, seconds = run(scene, VARIANTS[name], start, here)
        history = Tail(here / "case").update()
        table = cycles(history[history[:, 0] > SETTLE * PERIOD * spec.convective_time])
        lengths = table[:, 1]
        lift = np.sqrt(np.maximum(table[:, 4] - np.average(table[:, 3], weights=lengths) ** 2, 0.0))
        found = (mean(values, lengths) for values in (table[:, 2], lift, table[:, 5]))
        yield {
            "variant": name, "cells": cells, "steps": len(history), "seconds": seconds, "periods": len(table),
            **dict(zip(("cd", "lift", "base"), found, strict=True)),
        }  # fmt: skip


def time_resolved_cost(
    folder: Path = Path("runs/time-resolved-cost"), *variants: str, quick: bool = False
) -> list[Row]:
    """Cost of a time-resolved airflow with other steps, cells and solvers."""
    scene = shipped("rhombus", {"numerics.mesh_scale": 4.0} if quick else {})
    return show(TIME_COLUMNS, time_rows(scene, variants or tuple(VARIANTS), folder))
