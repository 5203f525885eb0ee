"""Print the run time that `wakeflow plan` expects of each shipped scene beside the time that `wakeflow run` then takes:

.venv/bin/python cases/studies/plan_times.py [SCENE ...] [--rung RUNG] [--count N]

Each scene runs in a cache of its own, in which nothing is but the compiled kernels and what the scenes before it have
taught of this machine; the first is expected as a machine is that has run nothing. Both times are of the whole command,
its report too. The last line says by which factor the expectations are off, at most, once one scene has run.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import wakeflow as wf
from wakeflow.core.process import cores
from wakeflow.core.store import cache_root
from wakeflow.planning.cost import wall_seconds
from wakeflow.planning.machine_rates import on_this_machine
from wakeflow.planning.make import make_plan

CASES = Path(__file__).parents[1]
SCENES = ("vacuum", "prism", "aspirator", "rhombus", "labyrinth", "wheat-straw-dust")
RATES, KERNELS = "machine-rates.json", "numba"


def taken(name: str, scratch: Path, rung: str | None, count: int | None) -> tuple[float, float]:
    """Seconds that one scene is expected to take, and that it takes."""
    cache, out = scratch / f"cache-{name}", scratch / name
    cache.mkdir()
    for held, known in ((KERNELS, cache_root() / KERNELS), (RATES, scratch / RATES)):
        if known.is_dir():
            shutil.copytree(known, cache / held)
        elif known.exists():
            shutil.copy(known, cache / held)
    scene = wf.Scene.load(CASES / f"{name}.toml", {} if count is None else {"feed.count": count})
    stages, _ = on_this_machine(make_plan(scene, rung=rung), cache)
    expected = wall_seconds(stages, cores())
    command = [sys.executable, "-m", "wakeflow.cli", "run", str(CASES / f"{name}.toml"), "--out", str(out), "--quiet"]
    command += ["--set", f"feed.count={scene.feed.count}"] + ([] if rung is None else ["--rung", rung])
    began = time.monotonic()
    subprocess.run(command, check=True, capture_output=True, env=os.environ | {"WAKEFLOW_CACHE": str(cache)})
    spent = time.monotonic() - began
    if (cache / RATES).exists():
        shutil.copy(cache / RATES, scratch / RATES)
    shutil.rmtree(cache)
    return expected, spent


def main(names: Sequence[str], rung: str | None = None, count: int | None = None) -> list[float]:
    """Print a table of scenes; returns their ratios of expected to taken seconds."""
    print("| scene | expected, s | took, s | ratio |\n|---|---|---|---|")
    found = []
    with TemporaryDirectory(prefix="wakeflow-") as folder:
        for name in names:
            expected, spent = taken(name, Path(folder), rung, count)
            found.append(expected / spent)
            print(f"| {name} | {expected:.0f} | {spent:.0f} | {found[-1]:.2f} |", flush=True)
    known = [max(ratio, 1.0 / ratio) for ratio in found[1:]]
    if known:
        print(f"\nOnce one scene has run: off by a factor {max(known):.2f} at most.")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--rung")
    parser.add_argument("--count", type=int)
    asked = parser.parse_args()
    main(asked.scenes, asked.rung, asked.count)
