"""Print the run time that `wakeflow plan` expects of each shipped scene beside the time that `wakeflow run` then takes:

.venv/bin/python cases/studies/plan_times.py [SCENE ...] [--rung RUNG] [--count N] [--stages]

Each scene runs in a cache of its own, in which nothing is but the compiled kernels. *new* is what is expected of a
machine on which nothing has run, *learned* what is expected once the scenes of the rows above have. All times are of
the whole command, its report too. With --stages a second table has every stage beside what was expected of it, each
time that it is done.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import wakeflow as wf
from wakeflow.core.process import cores
from wakeflow.core.store import cache_root
from wakeflow.pipeline.compilation import compile_slab, compile_tracker
from wakeflow.planning.cost import wall_seconds
from wakeflow.planning.machine_rates import on_this_machine
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import StageCost

CASES = Path(__file__).parents[1]
SCENES = ("vacuum", "aspirator", "wheat-straw-dust", "rhombus", "labyrinth", "prism")
RATES, KERNELS = "machine-rates.json", "numba"


@dataclass(frozen=True)
class Row:
    """Seconds that a scene is expected to take on a ``new`` machine, and once it has ``learned``; that it ``took``;
    its ``stages`` on a new one, and the seconds ``spent`` in them.
    """

    scene: str
    new: float
    learned: float
    took: float
    stages: Sequence[StageCost]
    spent: dict[str, float]

    def __str__(self) -> str:
        told = f"{self.new:.0f} | {self.learned:.0f} | {self.took:.0f}"
        return f"| {self.scene} | {told} | {self.new / self.took:.2f} | {self.learned / self.took:.2f} |"


def run_of(name: str, scratch: Path, rung: str | None, count: int | None) -> Row:
    """What one scene is expected to take, and takes; the cache of ``scratch`` learns from it."""
    cache, out = scratch / f"cache-{name}", scratch / name
    cache.mkdir()
    if (cache_root() / KERNELS).is_dir():
        shutil.copytree(cache_root() / KERNELS, cache / KERNELS)
    scene = wf.Scene.load(CASES / f"{name}.toml", {} if count is None else {"feed.count": count})
    plan = make_plan(scene, rung=rung)
    new, _ = on_this_machine(plan, cache)
    if (scratch / RATES).exists():
        shutil.copy(scratch / RATES, cache / RATES)
    learned, _ = on_this_machine(plan, cache)
    command = [sys.executable, "-m", "wakeflow.cli", "run", str(CASES / f"{name}.toml"), "--out", str(out), "--quiet"]
    command += ["--set", f"feed.count={scene.feed.count}"] + ([] if rung is None else ["--rung", rung])
    began = time.monotonic()
    done = subprocess.run(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
                          env=os.environ | {"WAKEFLOW_CACHE": str(cache)})  # fmt: skip
    took = time.monotonic() - began
    if done.returncode:
        raise SystemExit(f"plan_times: {' '.join(command)} ended with {done.returncode}: {done.stderr}")
    if (cache / RATES).exists():
        shutil.copy(cache / RATES, scratch / RATES)
    shutil.rmtree(cache)
    spent = {stage: timed.seconds for stage, timed in wf.Result.load(out).seconds.items()}
    return Row(name, wall_seconds(new, cores()), wall_seconds(learned, cores()), took, plan.stages, spent)


def farthest(ratios: Sequence[float]) -> float:
    """The largest factor, either way."""
    return max(max(ratio, 1.0 / ratio) for ratio in ratios)


def main(names: Sequence[str], rung: str | None = None, count: int | None = None, *, stages: bool = False) -> list[Row]:
    """Print a row a scene as each is done."""
    compile_tracker()
    compile_slab()
    print("| scene | new, s | learned, s | took, s | new / took | learned / took |\n|---|---|---|---|---|---|")
    rows = []
    with TemporaryDirectory(prefix="wakeflow-") as folder:
        for name in names:
            rows.append(run_of(name, Path(folder), rung, count))
            print(rows[-1], flush=True)
    print(f"\nOff by a factor {farthest([row.new / row.took for row in rows]):.2f} at most on a new machine", end="")
    if len(rows) > 1:
        print(f", {farthest([row.learned / row.took for row in rows[1:]]):.2f} once it has run a scene", end="")
    print(".")
    if stages:
        print("\n| scene | stage | when | times | expected, s each | took, s the last |\n|---|---|---|---|---|---|")
        for row in rows:
            for stage in row.stages:
                took = f"{row.spent[stage.name]:.1f}" if stage.name in row.spent else ""
                print(f"| {row.scene} | {stage.name} | {stage.when} | {stage.times} | {stage.seconds:.1f} | {took} |")
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--rung")
    parser.add_argument("--count", type=int)
    parser.add_argument("--stages", action="store_true")
    asked = parser.parse_args()
    main(asked.scenes, asked.rung, asked.count, stages=asked.stages)
