"""What sweeps cost: two workers against one, 100 feeds over 5 airflows, and airflows solved on from a neighbour's.

Every sweep has an empty cache, but for the compiled tracker; one worker has one core of the machine. Parts: airflows,
tracks (two workers against one, where OpenFOAM bounds and where tracking does), feeds (wall time on one worker against
the run time of every stage, each counted once), neighbours (steady airflows from rest and from that of the shipped
rhombus in air of 5 m/s, on cells 5 % smaller; seconds are the solver's). docs/sweeps.md.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import wakeflow as wf
from support import shipped
from wakeflow.core.process import cores
from wakeflow.core.store import cache_root

from .common import Row, cache_at, show

QUIET = {"collisions": False, "air-loading": False}  # the stages of airflow and tracks alone
FINER = 0.95  # of mesh_scale
NEIGHBOURS = {
    "mesh_scale": "{scale:.3g}", "air, m/s": "{speed:g}", "iterations, from rest": "{rest[0]}",
    "from the neighbour": "{near[0]}", "s, from rest": "{rest[1]:.1f}", "s": "{near[1]:.1f}",
    "Cd, from rest": "{rest[2]:.5f}", "Cd": "{near[2]:.5f}",
}  # fmt: skip


def swept(scene: wf.Scene, over: Mapping[str, Any], workers: int) -> tuple[float, wf.Sweep]:
    """Seconds of a sweep, and the sweep."""
    compiled, folder = cache_root() / "numba", Path(tempfile.mkdtemp(prefix="sweep-speed-"))
    compiled.mkdir(parents=True, exist_ok=True)
    (folder / "cache").mkdir()
    (folder / "cache" / "numba").symlink_to(compiled)
    allowed, rung = os.sched_getaffinity(0), "draft" if "air.speed" in over else None
    os.sched_setaffinity(0, sorted(allowed)[:workers])
    try:
        with cache_at(folder / "cache"):
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
    with tempfile.TemporaryDirectory() as folder, cache_at(Path(folder, "cache")):
        return show(NEIGHBOURS, _neighbours(tiny, Path(folder)))


PARTS = {part.__name__: part for part in (airflows, tracks, feeds, neighbours)}


def main(*parts: str, tiny: bool = False) -> None:
    """What sweeps cost: airflows, tracks, feeds, neighbours. ``tiny``: a few coarse scenes, to see that it works."""
    print(f"{cores()} cores; load {os.getloadavg()[0]:.1f}")
    for part in parts or PARTS:
        PARTS[part](tiny)
