"""What --target-error reaches on twenty varied scenes, and what it costs next to the best fixed setting.

Each scene is run with a target error, then with fixed settings in a scan; the error is that of the bin shares against
an independent reference. Twenty scenes fly without a solver: shaken bodies in a vacuum, open air, bodies with their air
left out. --air adds three scenes whose air OpenFOAM solves on coarse meshes; --laminar is one laminar scene, with
four seeds. docs/validation.md.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import wakeflow as wf
from proofs.scene_curves import (
    OTHER_SEED,
    BinShares,
    bin_shares,
    largest_error,
    one_cache,
    shares_of,
)
from support import shipped
from wakeflow.answer.provenance import RefinedSettings
from wakeflow.answer.result import Result
from wakeflow.answer.separation import separate
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan
from wakeflow.runs.time_budget import applied, cheapest, knobs, settings_of
from wakeflow.scene import Scene

from .common import Row, compile_tracker, show, with_one_fraction

TARGETS = (0.03, 0.02, 0.015)  # half widths of every bin share, in turn
LAMINAR_TARGET = 0.01
TOLERANCES = (1e-3, 1e-4)  # of the fixed settings
SEED = 14  # of the scenes' numbers
COUNT = 16384
MORE_GRANULES, FINER_STEPS, FINER_MESH = 16, 0.01, 0.5  # of the reference, times the settings it is for
MORE_MEETING = 4  # the same of granules that meet, which cost the most
VACUUM, ANALYTIC, LABYRINTH = 8, 6, 6  # scenes of each kind
COLUMNS = {
    "scene": "{scene}", "target, points": "{target:.2g*100}", "granules": "{led.settings.granules}",
    "tolerance": "{led.settings.tolerance:.2g}", "rounds": "{led.rounds}", "half width": "{led.half:.2g*100}",
    "error": "{error:.2g*100}", "s": "{led.seconds:.1f}", "best fixed, s": "{best:.1f}", "times": "{times:.2f}",
}  # fmt: skip
Scenes = Iterator[tuple[str, wf.Scene]]


@dataclass(frozen=True)
class TimedRun:
    """One run: its ``settings``, the ``shares`` that it found, its own largest ``half`` width by computing alone, and
    the processor time (s) that it took, with all programs that it started, in how many ``rounds``.
    """

    settings: RefinedSettings
    shares: BinShares
    half: float
    seconds: float
    rounds: int = 1


def best_fixed(scene: Scene, target: float, tolerances: Sequence[float], rung: str | None = None) -> TimedRun:
    """The quickest of fixed settings whose own half width meets the ``target``: at each of the ``tolerances`` the
    granules are doubled until it does, from the fewest on that can.
    """
    found: list[TimedRun] = []
    own = settings_of(scene, make_plan(scene, rung=rung))
    for tolerance in tolerances:
        settings = replace(own, granules=cheapest(own, target).granules, tolerance=tolerance)
        while (point := timed_run(applied(scene, settings), None, rung)).half > target:
            further = knobs["granules"].next(settings)
            assert further != settings
            settings = further
        found.append(point)
    return min(found, key=lambda point: point.seconds)


def timed_run(scene: Scene, target: float | None, rung: str | None = None) -> TimedRun:
    """A run of ``scene`` in an empty cache, to a ``target`` error or with its own settings."""
    with TemporaryDirectory(prefix="wakeflow-") as folder, one_cache(Path(folder)):
        started = sum(os.times()[:4])  # of this process and all that it waited for: what else runs disturbs it least
        result = wf.run(scene, Path(folder) / "run", rung=rung, target_error=target, report=False)
        seconds = sum(os.times()[:4]) - started
    table = result.refinement
    settings = settings_of(scene, make_plan(scene, rung=rung)) if table is None else table.rounds[-1].settings
    rounds = 1 if table is None else len(table.rounds)
    return TimedRun(settings, bin_shares(result), largest_half(result), seconds, rounds)


def scenes() -> Scenes:
    """Twenty scenes that fly without a solver."""
    chance = np.random.default_rng(SEED)

    def between(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    for number in range(VACUUM):
        yield f"vacuum {number + 1}", _changed("vacuum", {
            "feed.width": between(0.005, 0.03), "feed.height": between(0.05, 0.2), "feed.position": between(0.0, 0.015),
            "fraction.hard.restitution": between(0.2, 0.7), "fraction.soft.friction": between(0.1, 0.6),
            "vibration.frequency": between(10.0, 40.0), "bin.near.to": (edge := between(0.06, 0.16)),
            "bin.far.from": edge,
        })  # fmt: skip
    for number in range(ANALYTIC):
        yield f"open air {number + 1}", _open_air(between)
    for number in range(LABYRINTH):
        name = "prism" if number % 2 else "rhombus"
        changes = {"numerics.rung": "none", "feed.width": between(0.01, 0.05), "feed.height": between(0.05, 0.2)}
        yield f"{name} without air {number + 1}", _heaviest(_changed(name, changes))


def solved() -> Scenes:
    """Three scenes whose air is solved, steady, on coarse meshes."""
    for name, speed in (("prism", 4.0), ("rhombus", 5.0), ("rhombus", 3.0)):
        changes = {"numerics.rung": "draft", "numerics.mesh_scale": 2.5, "air.speed": speed}
        yield f"{name}, air {speed:g} m/s", _heaviest(_changed(name, changes))


def steady() -> Scenes:
    """Two dusts past a prism of 10 mm in air of Re 23, which is steady: drawn by four seeds."""
    edges = -0.025, -0.012, -0.004, 0.004, 0.012, 0.025
    names = "far-left", "left", "middle", "right", "far-right"
    dust = {"density": 1500.0, "restitution": 0.1, "friction": 0.5}
    for seed in range(1, 5):
        yield f"laminar, seed {seed}", wf.Scene.parse({
            "body": {"prism": {"shape": "prism", "width": 0.01, "slope_angle": math.radians(60), "apex": "up"}},
            "channel": {"width": 0.05, "top": 0.04, "bottom": -0.06},
            "air": {"speed": 0.035, "direction": "down", "turbulence": 0.0},
            "feed": {"height": 0.02, "width": 0.024, "count": 1024, "seed": seed},
            "fraction": {
                name: {**dust, "size": {"distribution": "lognormal", "median": size, "geometric_std": 1.3}}
                for name, size in (("fine", 15e-6), ("coarse", 70e-6))
            },
            "bin": dict(zip(names, ({"from": low, "to": high} for low, high in pairwise(edges)), strict=True)),
        })  # fmt: skip


def _changed(name: str, changes: dict[str, Any]) -> wf.Scene:
    return shipped(name, {**changes, "feed.count": COUNT})


def _heaviest(scene: wf.Scene) -> wf.Scene:
    """The scene with its fraction of most mass alone, each granule by itself."""
    shares = scene.mass_shares()
    return with_one_fraction(scene, max(shares, key=lambda one: shares[one]), rate=None)


def _open_air(between: Any) -> wf.Scene:
    """A jet of granules across a channel of rising air, into three bins."""
    edges = -0.3, between(-0.1, -0.05), between(-0.02, 0.03), 0.3
    bins = {name: {"from": edges[i], "to": edges[i + 1]} for i, name in enumerate(("left", "middle", "right"))}
    return wf.Scene.parse({
        "channel": {"width": 0.6, "top": 0.3, "bottom": -0.3},
        "air": {"speed": between(0.5, 2.0), "direction": "up", "turbulence": 0.02},
        "feed": {
            "speed": between(0.2, 1.0), "level": 0.2, "width": between(0.02, 0.08), "position": -0.05, "count": COUNT,
            "direction": between(-1.4, -0.8),
        },
        "fraction": {
            "light": {"size": {"distribution": "lognormal", "median": between(0.8e-3, 1.5e-3), "geometric_std": 1.2},
                      "density": 700.0, "restitution": 0.3, "friction": 0.4},
            "heavy": {"size": between(2e-3, 4e-3), "density": 1300.0, "restitution": 0.5, "friction": 0.3},
        },
        "bin": bins,
    })  # fmt: skip


def reference_shares(scene: Scene, settings: RefinedSettings, rung: str | None = None) -> BinShares:
    """The shares of another sample of ``scene``, far finer than ``settings``, on cells of half the edge: of granules
    that meet where they do.
    """
    mesh, slab = settings.mesh_scale, settings.slab
    finer = replace(
        settings,
        granules=(MORE_GRANULES if slab is None else 1) * settings.granules,
        slab=None if slab is None else MORE_MEETING * slab,
        tolerance=FINER_STEPS * settings.tolerance,
        mesh_scale=None if mesh is None else max(FINER_MESH * mesh, knobs["mesh"].finest),
    )
    other = applied(scene, finer).replace({"feed.seed": scene.feed.seed + OTHER_SEED})
    plan = make_plan(other, rung=rung)
    pipeline = Pipeline(plan.airflow.flown(other), plan)
    flown = pipeline.tracks() if plan.collisions is None else pipeline.collisions()
    return shares_of(separate(other, flown.landings))


def largest_half(result: Result) -> float:
    """The largest half width of a bin share by computing alone."""
    return max((row.total.numerical or 0.0 for row in result.budget), default=0.0)


def row(name: str, scene: wf.Scene, target: float) -> Row:
    """One scene both ways; of a solver's airflow no fixed settings are tried."""
    led = timed_run(scene, target)
    fixed = best_fixed(scene, target, TOLERANCES) if led.settings.mesh_scale is None else None
    error = largest_error(led.shares, reference_shares(scene, led.settings))
    return {
        "scene": name, "target": target, "led": led, "error": error, "met": error <= target, "fixed": fixed,
        "best": fixed and fixed.seconds, "times": fixed and led.seconds / fixed.seconds,
    }  # fmt: skip


def table(names: Sequence[tuple[str, wf.Scene]], targets: Sequence[float] = TARGETS) -> list[Row]:
    """Print a row a scene, and what it comes to."""
    compile_tracker()
    asked = ((*one, targets[number % len(targets)]) for number, one in enumerate(names))
    rows = show(COLUMNS, (row(*one) for one in asked))
    print(f"\nwithin the target against the reference: {sum(row['met'] for row in rows)} of {len(rows)} scenes")
    times = [row["times"] for row in rows if row["times"] is not None]
    if times:
        print(f"processor time over that of the best fixed one: median {np.median(times):.2f}, most {max(times):.2f}")
    return rows


def main(*, air: bool = False, laminar: bool = False, first: int = VACUUM + ANALYTIC + LABYRINTH) -> None:
    """What a target error reaches, on the ``first`` so many scenes; ``air``: three with solved air too; ``laminar``: a
    laminar scene with four seeds instead.
    """
    if laminar:
        table(list(steady()), (LAMINAR_TARGET,))
        return
    table([*list(scenes())[:first], *(solved() if air else ())])
