"""Where each fraction lands behind the plain rhombus, with an additional air stream, and with a barrier.

Steady airflows (rung draft). Takes options of `wakeflow run`; runs what has not been run yet, in runs/paper.
docs/paper.md: paper_compare --set feed.count=1024 --set numerics.mesh_scale=2
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import wakeflow as wf
from support import CASES
from wakeflow.cli import main as wakeflow

from .common import Row, percent, show

SCENES = {
    "plain": CASES / "rhombus.toml",
    "air stream": CASES / "paper" / "air-stream.toml",
    "barrier": CASES / "paper" / "barrier.toml",
}


def rows(options: tuple[str, ...]) -> Iterator[Row]:
    """A row a fraction and scene."""
    found = {}
    for name, scene in SCENES.items():
        out = Path("runs", "paper", scene.stem)
        if code := wakeflow(["run", str(scene), "--out", str(out), "--rung", "draft", "--quiet", *options]):
            raise SystemExit(code)
        found[name] = wf.Result.load(out).landings.separation
    for fraction in found["plain"].fractions:
        for name, table in found.items():
            shares = {place: f"{100 * share.value:.1f}" for place, share in table.fractions[fraction].items()}
            yield {"fraction": fraction, "scene": name, **shares, "recovery": percent(table.recovery[fraction])}


def main(*options: Annotated[str, Parameter(allow_leading_hyphen=True)]) -> list[Row]:
    """The paper's rhombus, plain, with an air stream and with a barrier; OPTIONS of `wakeflow run`."""
    bins = [*wf.Scene.load(SCENES["plain"]).bin, "elsewhere"]
    return show(("fraction", "scene", *bins, "recovery"), rows(options))
