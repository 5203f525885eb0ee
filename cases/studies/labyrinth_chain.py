"""The chain next to flights in the airflow of cases/labyrinth.toml, printed as the tables of docs/validation.md:

.venv/bin/python cases/studies/labyrinth_chain.py [count of granules a fraction, 1024] [mesh_scale of the airflow, 2]

They differ by what the labyrinth's steady airflow does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import wakeflow as wf
from wakeflow.pipeline.compilation import compile_tracker
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.make import make_plan

CASES = Path(__file__).parents[1]


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """What ``work`` returns, and the processor time (s) it took."""
    start = time.process_time()
    found = work()
    return found, time.process_time() - start


def with_air(scene: wf.Scene, mesh_scale: float) -> None:
    """Shares by the chain and in the airflow of all bodies, and how far the air moves a granule's landing."""
    chained, spent = timed(lambda: wf.chain(scene))
    asked = scene.replace({"numerics.mesh_scale": mesh_scale})
    whole = Pipeline(asked, make_plan(asked, rung="draft", force={"air-loading": False}))
    landed = whole.tracks().landings
    print("\n| fraction | bin | chain | in the airflow |\n|---|---|---|---|")
    from wakeflow.results.separation import separate

    air = separate(asked, landed)
    for name, row in chained.shares.fractions.items():
        for place, own in row.items():
            pair = (own, air.fractions[name][place])
            cells = [f"{100 * e.value:.1f} ({100 * e.low:.1f} to {100 * e.high:.1f})" for e in pair]
            print(f"| {name} | {place} | {' | '.join(cells)} |")
    print("\n| fraction | moved by the air, median | 95 % | bound of the plan (body widths) |\n|---|---|---|---|")
    bounds = {row.fraction: row.bound for row in chained.plan.left_out if row.name == "air"}
    for name, landing in landed.items():
        off = np.linalg.norm(landing.position - chained.landings[name].position, axis=1) / scene.width
        print(f"| {name} | {np.median(off):.2g} | {np.percentile(off, 95):.2g} | {bounds[name]:.2g} |")
    slow = {str(stage): f"{took.seconds:.1f}" for stage, took in whole.seconds.items()}
    print(f"\nchain: {spent:.2f} s of processor; stages of the other, s on the clock: {slow}")


def main(count: int, mesh_scale: float) -> None:
    """Print all tables for ``count`` granules a fraction, the airflow on a mesh ``mesh_scale`` times as coarse."""
    scene = wf.Scene.load(CASES / "labyrinth.toml").replace({"feed.count": count})
    compile_tracker()
    with_air(scene, mesh_scale)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1024, float(sys.argv[2]) if len(sys.argv) > 2 else 2.0)
