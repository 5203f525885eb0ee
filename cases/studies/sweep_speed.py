"""How sweeps scale: two workers against one, and 100 feeds over 5 airflows against the sum of their stages.

    .venv/bin/python cases/studies/sweep_speed.py [--tiny] [--airflows] [--tracks] [--feeds]

Every sweep has an empty cache, but for the compiled tracker; one worker has one core of the machine. --tiny: a few
coarse scenes, to see that it works.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import wakeflow as wf
from wakeflow.core.process import cores
from wakeflow.core.store import cache_root

CASES = Path(__file__).parents[1]
QUIET = {"collisions": False, "air-loading": False}  # the stages of airflow and tracks alone


def main(words: list[str]) -> None:
    tiny, parts = "--tiny" in words, [word for word in words if word != "--tiny"]
    print(f"{cores()} cores; load {os.getloadavg()[0]:.1f}")
    if not parts or "--airflows" in parts:
        coarse = {"numerics.mesh_scale": 3.0 if tiny else 1.5, "feed.count": 64}
        _two_against_one(
            "OpenFOAM bounds", "rhombus", coarse, {"air.speed": [4.0, 5.0] if tiny else [4.0, 4.5, 5.0, 5.5]}
        )
    if not parts or "--tracks" in parts:
        heights = [0.08, 0.1] if tiny else [0.08, 0.09, 0.1, 0.11]
        _two_against_one("tracking bounds", "vacuum", {"feed.count": 256 if tiny else 2**19}, {"feed.height": heights})
    if not parts or "--feeds" in parts:
        _feeds(tiny)


def _two_against_one(what: str, name: str, base: Mapping[str, Any], over: Mapping[str, list[Any]]) -> None:
    scene = wf.Scene.load(CASES / f"{name}.toml", dict(base))
    one, two = (_swept(wf.variants(scene, over), count)[0] for count in (1, 2))
    print(f"{what}: one worker {one:.1f} s, two {two:.1f} s, {one / two:.2f} times")


def _feeds(tiny: bool) -> None:
    """Wall time on one worker against the run time of every stage, each counted once."""
    scene = wf.Scene.load(
        CASES / "rhombus.toml", {"numerics.mesh_scale": 3.0 if tiny else 1.5, "feed.count": 256 if tiny else 512}
    )
    speeds, heights = (2, 2) if tiny else (5, 20)
    over = {
        "air.speed": {"from": 4.0, "to": 6.0, "count": speeds},
        "feed.height": {"from": 0.08, "to": 0.14, "count": heights},
    }
    spent, folder = _swept(wf.variants(scene, over), 1)
    tables = [json.loads(file.read_text())["seconds"] for file in folder.glob("*/result.json")]
    stages = sum(seconds for _, seconds in {(name, one["seconds"]) for table in tables for name, one in table.items()})
    told = f"{spent:.1f} s, their stages {stages:.1f} s, {spent / stages:.2f} times"
    print(f"{speeds * heights} feeds over {speeds} airflows: {told}")


def _swept(found: Any, workers: int) -> tuple[float, Path]:
    """Seconds of a sweep, and its folder."""
    compiled, folder = cache_root() / "numba", Path(tempfile.mkdtemp(prefix="sweep-speed-"))
    compiled.mkdir(parents=True, exist_ok=True)
    (folder / "cache").mkdir()
    (folder / "cache" / "numba").symlink_to(compiled)
    before = os.environ.get("WAKEFLOW_CACHE")
    os.environ["WAKEFLOW_CACHE"] = str(folder / "cache")
    allowed, rung = os.sched_getaffinity(0), "draft" if "air.speed" in found[0].inputs else None
    os.sched_setaffinity(0, sorted(allowed)[:workers])
    try:
        started = time.monotonic()
        done = wf.sweep(found, folder / "sweep", rung=rung, force=QUIET, workers=workers, figures=False)
        spent = time.monotonic() - started
    finally:
        os.sched_setaffinity(0, allowed)
        os.environ.pop("WAKEFLOW_CACHE")
        if before is not None:
            os.environ["WAKEFLOW_CACHE"] = before
    if done.failed:
        raise SystemExit(f"failed: {done.failed}")
    return spent, done.folder


if __name__ == "__main__":
    main(sys.argv[1:])
