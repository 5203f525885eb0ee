"""Goals of the tracker beside what is measured; nothing is asserted."""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ProgramError
from ...core.process import run_program
from ...injection.feed import feedstock
from ...pipeline.pipeline import Pipeline
from ...pipeline.realisations import Realisations
from ...pipeline.tracks import Flight
from ...scene import Scene
from ...tracking import Granules
from .benchmark_cases import SPEED, travelling_wave
from .curves import CurvePoint, cost_at, timed

__all__ = ["development_targets"]

CALM = ("drag", "gravity", "buoyancy")
ERROR = 1e-4  # body widths, where speeds are compared
START = "import time, numpy as np; t = time.perf_counter(); import wakeflow as wf\n" + (
    "wf.track(None, wf.Granules(position=np.zeros((1, 2)), velocity=np.zeros((1, 2)), diameter=1e-3, density=1e3), "
    "until=1e-3, forces=('gravity',)); print(time.perf_counter() - t)\n"
)
CROWD = """
import json, resource, sys, tempfile, time
from pathlib import Path
from wakeflow.pipeline.compilation import compile_tracker
from wakeflow.pipeline.tracks import Flight
from wakeflow.verify.trackers.benchmark_cases import shipped
from wakeflow.planning.make import make_plan
scene, _, pipeline = shipped(lambda stage, text: None)
wheat = {**scene.tables()["fraction"]["wheat"], "mass_share": 1.0}
scene = scene.replace({"feed.count": int(sys.argv[1]), "fraction": {"wheat": wheat}})
plan = make_plan(scene, rung="draft", force={"air-loading": False}).with_forces(("drag", "gravity", "buoyancy"))
flight = Flight(scene, plan, pipeline.kind.realisations, scene.numerics.tolerance)
compile_tracker()
begun = time.perf_counter()
with tempfile.TemporaryDirectory() as folder:
    flight.fly_all(Path(folder), drawn=False)
print(json.dumps([time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))
"""
CROWD_COUNT = 10_000_000

Goal = dict[str, Any]


def development_targets(
    rows: Sequence[CurvePoint], scene: Scene, pipeline: Pipeline, slow: bool, tell: Callable[[str], None]
) -> list[Goal]:
    """Every goal: the value wanted, the value measured, and whether the goal is met."""
    found = _ratios(rows)
    tell("flights of the shipped case")
    found += _shipped_flights(scene, pipeline)
    found.append(_rate(rows))
    tell("first and second start")
    found += _starts()
    if slow:
        tell(f"{CROWD_COUNT:.0e} granules")
        found.append(_crowd())
    return found


def _goal(what: str, wanted: str, reached: float | None, unit: str, met: bool, note: str = "") -> Goal:
    return {"what": what, "wanted": wanted, "reached": reached, "unit": unit, "met": met, "note": note}


def _ratios(rows: Sequence[CurvePoint]) -> list[Goal]:
    found = []
    for kind, air in dict.fromkeys((row.kind, row.air) for row in rows):
        same = [row for row in rows if (row.kind, row.air) == (kind, air)]
        ours = [row for row in same if row.method == "wakeflow"]
        for rival, name, wanted in (("OpenFOAM", "OpenFOAM's tracker", 200.0), ("explicit", "explicit RK4", 1.0)):
            theirs = [row for row in same if row.method.startswith(rival)]
            ratio, core, worst = (
                _ratio(ours, theirs, which, clock)
                for which, clock in (("median", "seconds"), ("median", "cpu"), ("p95", "seconds"))
            )
            if theirs:
                note = f"for each core's time {_number(core)}; at the 95th percentile {_number(worst)}"
                note += "" if ratio is None or ratio >= wanted else f"; {_why(ours, theirs, wanted)}"
                what = f"{kind}, {air}: times faster than {name} at {ERROR:.0e} body widths (median)"
                met = ratio is not None and ratio >= wanted
                found.append(_goal(what, f">= {wanted:.0f}", ratio, "", met, note))
    return found


def _why(ours: Sequence[CurvePoint], theirs: Sequence[CurvePoint], wanted: float) -> str:
    """For a goal that is missed: what it would need, and what the tracker's cheapest setting gives."""
    best = min(ours, key=lambda row: row.cpu)
    needed = (cost_at(theirs, ERROR) or 0.0) / wanted
    error = "–" if best.median is None else f"{best.median:.0e}"
    step = best.cpu / (best.steps or 1.0)
    return (
        f"that takes {1e6 * needed:.2g} us a granule; our cheapest setting: {best.steps or 0:.0f} steps of "
        f"{1e6 * step:.2g} us for an error of {error}"
    )


def _ratio(ours: Sequence[CurvePoint], theirs: Sequence[CurvePoint], which: str, clock: str) -> float | None:
    mine, other = (cost_at(rows, ERROR, which, clock) for rows in (ours, theirs))
    return None if mine is None or other is None else other / mine


def _number(value: float | None) -> str:
    return "not reached" if value is None else f"{value:.3g}"


def _shipped_flights(scene: Scene, pipeline: Pipeline) -> list[Goal]:
    """The scene as it is shipped: its own field, laws, walls, tolerance; with the forces of its plan, and with few."""
    field = pipeline.field[1]
    wave = travelling_wave(field, SPEED, scene.width)
    calm = pipeline.plan.with_forces(CALM)  # the synthetic wave has no pressure
    found, total, waving = [], np.zeros(2), np.zeros(2)
    for name in scene.fraction:
        grains = feedstock(scene, pipeline.plan, name, None).granules[::2]
        flight = Flight(scene, pipeline.plan, Realisations(field), scene.numerics.tolerance)

        def cost(how: Flight, name: str = name, grains: Granules = grains) -> NDArray[np.float64]:
            return np.array(timed(lambda: how.fly(name, grains))) / len(grains)

        still = replace(flight, plan=calm)
        steady = cost(still)
        for (wall, cpu), forces in ((steady, CALM), (cost(flight), pipeline.plan.fractions[name].forces)):
            what = f"{name} of the shipped case: a granule's flight"
            note = f"{1e6 * cpu:.3g} us of processor time; {', '.join(forces)}"
            found.append(_goal(what, "< 20", 1e6 * float(wall), "us", bool(wall < 20e-6), note))
        total, waving = total + steady, waving + cost(replace(still, airs=Realisations(wave)))
    what = "all fractions, time-resolved (synthetic wave, 32 snapshots a period) over steady"
    wall, cpu = waving / total
    return [*found, _goal(what, "<= 2", float(wall), "", bool(wall <= 2.0), f"in processor time {cpu:.2f}")]


def _rate(rows: Sequence[CurvePoint]) -> Goal:
    rates = [rate for row in rows if row.method == "wakeflow" and (rate := row.evaluation_rate) is not None]
    best = max(rates, default=None)
    met = best is not None and best >= 1e7
    return _goal(
        "stage evaluations a second and core, best", ">= 10", None if best is None else best / 1e6, "million", met
    )


def _starts() -> list[Goal]:
    """A tracker's first call in a fresh process, with an empty cache and with a filled one."""
    with tempfile.TemporaryDirectory(prefix="wakeflow-start-") as cache:
        starts = [_start(cache), _start(cache)]
    wanted = (("first start, compilation included", 10.0), ("later starts", 2.0))
    return [
        _goal(what, f"< {limit:.0f}", wall, "s", wall < limit, f"{cpu:.3g} s of processor time")
        for (what, limit), (wall, cpu) in zip(wanted, starts, strict=True)
    ]


def _start(cache: str) -> tuple[float, float]:
    """Wall and processor seconds of a process that imports the package and tracks one granule."""
    begun, busy = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    _child(START, cache)
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - busy.ru_utime - busy.ru_stime


def _child(code: str, cache: str | None, *arguments: str) -> str:
    """Run a piece of Python in a process of its own; returns what it prints."""
    with tempfile.TemporaryDirectory(prefix="wakeflow-") as folder:
        script, log = Path(folder, "script.py"), Path(folder, "log")
        script.write_text(code)
        env = os.environ if cache is None else {**os.environ, "WAKEFLOW_CACHE": cache}
        run_program(
            [sys.executable, "-P", str(script), *arguments], cwd=Path.cwd(), log=log, env=env, error=ProgramError
        )
        return log.read_text()


def _crowd() -> Goal:
    import json

    seconds, memory = json.loads(_child(CROWD, None, str(CROWD_COUNT)).splitlines()[-1])
    note = f"{CROWD_COUNT / seconds:.3g} granules a second"
    return _goal(f"memory of {CROWD_COUNT:.0e} granules of wheat", "< 4", memory / 1e9, "GB", memory < 4e9, note)
