"""Solve steady airflows from rest and from a neighbour's, and print what that saves and what it moves:

.venv/bin/python cases/studies/neighbours.py [--scales 3,2] [--quick]

The neighbour is the shipped rhombus in air of 5 m/s. The others have slower and faster air, on cells that are 5 %
smaller. In a cache of its own; seconds are the solver's.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

import wakeflow as wf

CASES = Path(__file__).parents[1]
SPEEDS, QUICK_SPEEDS = (4.0, 4.5, 5.5, 6.0), (5.5,)
FINER = 0.95  # of mesh_scale
HEAD = "| mesh_scale | air, m/s | iterations, from rest | from the neighbour | s | s | Cd | Cd |\n" + "|---" * 8 + "|"


def solved(scene: wf.Scene, folder: Path, near: Path | None = None) -> tuple[int, float, float]:
    """Iterations, the solver's seconds, and Cd of a scene's steady airflow."""
    table: dict[str, Any] = wf.run(scene, folder, rung="draft", until="airflow", near=near).table
    return table["airflow"]["steps"], table["seconds"]["airflow"]["seconds"], table["airflow"]["cd"]["value"]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scales", default="3,2", help="numerics.mesh_scale")
    parser.add_argument("--quick", action="store_true", help="one mesh, one speed")
    asked = parser.parse_args(arguments)
    scales = [3.0] if asked.quick else [float(word) for word in asked.scales.split(",")]
    base = wf.Scene.load(CASES / "rhombus.toml")
    with tempfile.TemporaryDirectory() as place:
        os.environ["WAKEFLOW_CACHE"] = str(Path(place, "cache"))
        print(HEAD)
        for scale in scales:
            first = Path(place, f"first-{scale:g}")
            solved(base.replace({"numerics.mesh_scale": scale}), first)
            for speed in QUICK_SPEEDS if asked.quick else SPEEDS:
                other = base.replace({"numerics.mesh_scale": FINER * scale, "air.speed": speed})
                rest, near = (
                    solved(other, Path(place, name), start) for name, start in (("rest", None), ("near", first))
                )
                print(
                    f"| {FINER * scale:.3g} | {speed:g} | {rest[0]} | {near[0]} | {rest[1]:.1f} | {near[1]:.1f} | "
                    f"{rest[2]:.5f} | {near[2]:.5f} |"
                )


if __name__ == "__main__":
    main()
