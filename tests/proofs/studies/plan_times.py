"""The run time that `wakeflow plan` expects of each shipped scene next to the time that `wakeflow run` then takes.

Each scene runs in a cache of its own, in which nothing is but the compiled kernels. *new* is what is expected of a
machine on which nothing has run, *learned* what is expected once the scenes of the rows above have. All times are of
the whole command, its report too. With --stages a second table has every stage next to what was expected of it, each
time that it is done. Half an hour of two cores; docs/validation.md.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import wakeflow as wf
from support import CASES, shipped
from wakeflow.core.process import cores
from wakeflow.core.store import cache_root
from wakeflow.planning.cost import wall_seconds
from wakeflow.planning.machine_rates import on_this_machine

from .common import Row, compile_slab, compile_tracker, make_plan, show

SCENES = ("vacuum", "aspirator", "wheat-straw-dust", "rhombus", "labyrinth", "prism")
RATES, KERNELS = "machine-rates.json", "numba"
COLUMNS = {
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
    if (cache_root() / KERNELS).is_dir():
        shutil.copytree(cache_root() / KERNELS, cache / KERNELS)
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


def main(*scenes: str, rung: str | None = None, count: int | None = None, stages: bool = False) -> list[Row]:
    """Run times expected and taken, a row a scene as each is done."""
    compile_tracker()
    compile_slab()
    with TemporaryDirectory(prefix="wakeflow-") as folder:
        rows = show(COLUMNS, (run_of(name, Path(folder), rung, count) for name in scenes or SCENES))
    print(f"\nOff by a factor {farthest([row['by_new'] for row in rows]):.2f} at most on a new machine", end="")
    if len(rows) > 1:
        print(f", {farthest([row['by_learned'] for row in rows[1:]]):.2f} once it has run a scene", end="")
    print(".")
    if stages:
        print()
        show(STAGES, stages_of(rows))
    return rows
