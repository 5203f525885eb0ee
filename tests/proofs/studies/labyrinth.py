"""What the air does in cases/labyrinth.toml: shares without air and in the steady airflow of all bodies.

How far a granule's landing moves by the air is compared with the bound of the plan that leaves the air out;
docs/validation.md: labyrinth 512 2
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import wakeflow as wf
from support import shipped

from .common import BARE, Pipeline, Row, piped, separation, show

SHARE = "{0.value:.1f*100} ({0.low:.1f*100} to {0.high:.1f*100})"
SHARES = {
    "fraction": "{fraction}", "bin": "{bin}", "without air": SHARE.replace("{0", "{still"),
    "in the airflow": SHARE.replace("{0", "{air"),
}  # fmt: skip
MOVED = {
    "fraction": "{fraction}", "moved by the air, median": "{median:.2g}", "95 %": "{most:.2g}",
    "bound of the plan (body widths)": "{bound:.2g}",
}  # fmt: skip


def moved(still: Any, air: Pipeline) -> Iterator[Row]:
    """How far the air moves landings of each fraction."""
    bounds = {row.fraction: row.bound for row in still.plan.left_out if row.name == "air"}
    for name, landing in air.tracks().landings.items():
        off = np.linalg.norm(landing.position - still.landings[name].position, axis=1) / air.scene.width
        yield {"fraction": name, "median": np.median(off), "most": np.percentile(off, 95), "bound": bounds[name]}


def main(count: int = 1024, mesh_scale: float = 2.0) -> list[Row]:
    """Shares in the labyrinth without air and with it, of ``count`` granules a fraction."""
    scene = shipped("labyrinth", {"feed.count": count})
    still, air = wf.chain(scene), piped(scene.replace({"numerics.mesh_scale": mesh_scale}), "draft", BARE)
    found = separation(air).fractions
    show(SHARES, (
        {"fraction": name, "bin": place, "still": own, "air": found[name][place]}
        for name, row in still.shares.fractions.items() for place, own in row.items()
    ))  # fmt: skip
    print()
    rows = show(MOVED, moved(still, air))
    spent = ", ".join(f"{stage} {took.seconds:.1f}" for stage, took in air.seconds.items())
    print(f"\nstages with air, s on the clock: {spent}")
    return rows
