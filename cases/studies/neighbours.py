"""Solve the airflows of a sweep from rest and from their neighbours, and print what that saves and moves:

.venv/bin/python cases/studies/neighbours.py [--rung draft] [--speeds 3,4,5,6,7] [--quick]

The shipped rhombus at several air speeds, each on a mesh of its own. Both ways in a cache of their own; seconds are the
solver's, of the steady airflow.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

import wakeflow as wf

CASES = Path(__file__).parents[1]
HEAD = (
    "| air, m/s | starts from | iterations, from rest | from the neighbour | s | s | Cd | Cd | largest change of a "
    "share, points | its interval |\n" + "|---" * 10 + "|"
)


def swept(scenes: list[Any], folder: Path, rung: str, *, neighbours: bool) -> list[wf.Result]:
    """The results of a sweep in a cache of its own."""
    os.environ["WAKEFLOW_CACHE"] = str(folder / "cache")
    sweep = wf.sweep(scenes, folder, rung=rung, neighbours=neighbours, figures=False, workers=1)
    assert not sweep.failed, sweep.failed
    return [sweep.result(one.name) for one in scenes]


def moved(rest: wf.Result, near: wf.Result) -> tuple[float, float]:
    """The largest change of a share and half its interval there, in points."""
    first, second = rest.separation["fractions"], near.separation["fractions"]
    found = [
        (abs(second[name][place]["share"] - share["share"]), 0.5 * (share["high"] - share["low"]))
        for name, row in first.items()
        for place, share in row.items()
    ]
    change, half = max(found)
    return 100 * change, 100 * half


def solved(result: wf.Result, rung: str) -> dict[str, Any]:
    """Iterations, solver's seconds and Cd of the steady airflow."""
    stage = "airflow" if rung == "draft" else "draft airflow"
    table = result.table["airflow"]
    return {"steps": table["steps"], "seconds": result.table["seconds"][stage]["seconds"], "cd": table["cd"]["value"]}


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rung", default="draft", choices=["draft", "standard"])
    parser.add_argument("--speeds", default="3,4,5,6,7", help="m/s")
    parser.add_argument("--quick", action="store_true", help="two speeds, a coarse mesh, few granules")
    asked = parser.parse_args(arguments)
    speeds = [4.0, 5.0] if asked.quick else [float(word) for word in asked.speeds.split(",")]
    few = {"feed.count": 64, "numerics.mesh_scale": 4.0} if asked.quick else {"feed.count": 1024}
    alone = {"feed.rate": "0.5 kg/hour", **few}  # granules neither meet nor load the air
    scenes = wf.variants(wf.Scene.load(CASES / "rhombus.toml").replace(alone), {"air.speed": speeds})
    with tempfile.TemporaryDirectory() as place:
        rest = swept(scenes, Path(place, "rest"), asked.rung, neighbours=False)
        near = swept(scenes, Path(place, "near"), asked.rung, neighbours=True)
        print(HEAD)
        total = [0.0, 0.0]
        for speed, one, other in zip(speeds, rest, near, strict=True):
            before, after = solved(one, asked.rung), solved(other, asked.rung)
            total = [total[0] + before["seconds"], total[1] + after["seconds"]]
            source = other.table["options"].get("near")
            begun = "rest" if source is None else f"{wf.Result.load(source).scene['air']['speed']:g}"
            change, half = moved(one, other)
            print(
                f"| {speed:g} | {begun} | {before['steps']} | {after['steps']} | {before['seconds']:.1f} | "
                f"{after['seconds']:.1f} | {before['cd']:.4f} | {after['cd']:.4f} | {change:.2f} | ± {half:.2f} |"
            )
        print(f"\nall airflows: {total[0]:.0f} s from rest, {total[1]:.0f} s from their neighbours")


if __name__ == "__main__":
    main()
