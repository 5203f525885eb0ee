"""Labyrinths of staggered prisms: rows of one, two, one, ... in a channel, as many as asked for.

.venv/bin/python cases/labyrinths.py [FOLDER] [--rows 1,2,3]

Writes FOLDER/labyrinth-ROWS.toml (runs/labyrinths by default) and says where wheat and chaff go without the air, by
impacts and parabolas in closed form: seconds, for a first search. A body of another shape is one entry of `bodies`
below; a shape that wakeflow does not know is one function (docs/extending.md, "A shape").
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import wakeflow as wf

WIDTH, PITCH, GAP = 40.0, 75.0, 72.0  # mm: of a prism, between rows, between the middles of two in a row
CHANNEL = 300.0  # mm wide
ABOVE, BELOW = 150.0, 130.0  # mm of channel above the first row and below the last


def labyrinth(rows: int) -> wf.Scene:
    """A scene with ``rows`` rows, single prisms and pairs in turn."""
    bodies: dict[str, dict[str, Any]] = {}
    for row in range(rows):
        middles = (0.0,) if row % 2 == 0 else (-0.5 * GAP, 0.5 * GAP)
        for side, x in zip("abc", middles, strict=False):
            at = [f"{x:g} mm", f"{-PITCH * row:g} mm"]
            bodies[f"row{row + 1}{side}"] = {"shape": "prism", "width": f"{WIDTH:g} mm", "slope_angle": 1.0, "at": at}
    half, floor = 0.5 * CHANNEL, -PITCH * (rows - 1) - BELOW
    edges = [-half, -0.3 * half, 0.3 * half, half]
    bins = {
        name: {"from": f"{low:g} mm", "to": f"{high:g} mm"}
        for name, low, high in zip(("left", "middle", "right"), edges, edges[1:], strict=False)
    }
    return wf.Scene.parse({
        "body": bodies,
        "channel": {"width": f"{CHANNEL:g} mm", "top": f"{ABOVE:g} mm", "bottom": f"{floor:g} mm"},
        "air": {"speed": "3 m/s", "direction": "down"},
        "feed": {"height": "80 mm", "width": "30 mm", "rate": "100 kg/hour", "depth": "300 mm", "count": 2048},
        "fraction": {
            "chaff": {"material": "chaff", "mass_share": 0.1, "target": "middle"},
            "wheat": {"material": "wheat", "mass_share": 0.9, "target": ["left", "right"]},
        },
        "bin": bins,
    })  # fmt: skip


def main(folder: Path, rows: Sequence[int]) -> wf.Sweep:
    """Write the scenes and compare them without the air."""
    folder.mkdir(parents=True, exist_ok=True)
    scenes = {f"labyrinth-{count}": labyrinth(count) for count in rows}
    for name, scene in scenes.items():
        scene.save(folder / f"{name}.toml")
    found = wf.sweep(scenes, folder / "first-look", rung="none")
    for entry in found.table.entries:
        wheat, chaff = (100 * entry.by_name[f"recovery.{name}"].value for name in ("wheat", "chaff"))
        print(f"{entry.name}: recovered without the air: wheat {wheat:.1f} %, chaff {chaff:.1f} %")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs", "labyrinths"))
    parser.add_argument("--rows", default="1,2,3", help="of prisms")
    asked = parser.parse_args()
    main(asked.folder, [int(x) for x in asked.rows.split(",")])
