"""Move inlet and outlet of the shipped rhombus' airflow, and see what that changes of the air and of the shares.

One table a rung: the scene with its ends at so many body widths before and behind the body; in the last row they are
furthest off, and the last columns compare each row's shares with that one's. Other ends move cells everywhere, and so
the shares by more than the ends themselves do: every row is the mean over meshes of slightly different cells, and its
change has the standard error of that mean. The steady wake shows what the inlet does, through which no vortices leave;
the time-resolved one what the outlet does. docs/validation.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.meshing import ends
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.make import make_plan

from .common import BARE, Row, mean_and_error, show, with_one_fraction

DISTANCES = ((3.5, 8.0), None, (12.0, 25.0))  # before, behind, in body widths; None: what the program chooses
SCALES = {"draft": 1.0, "standard": 1.5}  # numerics.mesh_scale by rung
MESHES = 1.0 + 0.03 * (np.arange(8) - 3.5)  # factors on it
COUNT = 2048
QUICK_SCALES, QUICK_COUNT = 4.0 * MESHES[3:5] / MESHES[4], 64
ACCURACY = 0.02  # statistics sharper than the answer's
AIR = {"Cd": "cd", "Cl rms": "cl_rms", "Cp base": "cp_base"}
COLUMNS = {
    "before, D": "{before:.1f}", "behind, D": "{behind:.1f}", "cells": "{cells:.0f}",
    **{head: f"{{{key}}}" for head, key in AIR.items()},
    "change of shares, points: largest": "{largest}", "of each fraction in its bins": "{meant}",
}  # fmt: skip


def moved(scene: wf.Scene, rung: str, distances: tuple[float, float] | None) -> Pipeline:
    """The scene with its inlet and outlet at ``distances`` (body widths) from the body."""
    plan = make_plan(scene, rung=rung, force=BARE)
    made = Pipeline(scene, replace(plan, airflow=replace(plan.airflow, accuracy=ACCURACY)))
    for pipeline in (made, made.draft):
        spec = pipeline.mesh_spec
        before, behind = distances or ends(spec.width / spec.projected_width)
        outline, size = np.array(spec.bodies[0]), spec.widths[0]
        top, bottom = outline[:, 1].max() + before * size, outline[:, 1].min() - behind * size
        pipeline.kind.mesh_spec = replace(spec, top=float(top), bottom=float(bottom))
    return made


def shares(pipeline: Pipeline) -> dict[str, np.ndarray]:
    """Mean share of each fraction in every bin."""
    bins = len(pipeline.scene.bin)
    return {name: landing.counts(bins).mean(axis=0) for name, landing in pipeline.tracks().landings.items()}


def rows(
    scene: wf.Scene, rung: str, scales: Sequence[float], distances: Sequence[tuple[float, float] | None]
) -> Iterator[Row]:
    """A row a place of the ends."""
    meshes = [scene.replace({"numerics.mesh_scale": float(scale)}) for scale in scales]
    made = [[moved(mesh, rung, each) for mesh in meshes] for each in distances]
    found = [[shares(pipeline) for pipeline in row] for row in made]
    bins = list(scene.bin)
    targets = {name: [bins.index(place) for place in fraction.targets] for name, fraction in scene.fraction.items()}
    for row, mine in zip(made, found, strict=True):
        spec, airs = row[0].mesh_spec, [pipeline.airflow for pipeline in row]
        outline, size = np.array(spec.bodies[0]), spec.widths[0]
        moves = {
            name: 100 * np.array([one[name] - last[name] for one, last in zip(mine, found[-1], strict=True)])
            for name in scene.fraction
        }
        every = np.concatenate(list(moves.values()), axis=1)
        meant = {name: move[:, targets[name]].sum(axis=1) for name, move in moves.items()}
        yield {
            "before": (spec.top - outline[:, 1].max()) / size, "behind": (outline[:, 1].min() - spec.bottom) / size,
            "cells": np.mean([air.cells for air in airs]),
            **{key: mean_and_error([getattr(air, key).value for air in airs]) for key in AIR.values()},
            "largest": mean_and_error(every[:, np.abs(every.mean(axis=0)).argmax()], 2, "+"),
            "meant": ", ".join(f"{mean_and_error(move, 2, '+')} {name}" for name, move in meant.items()),
        }  # fmt: skip


def main(*rungs: str, count: int | None = None, only: str | None = None, quick: bool = False) -> list[Row]:
    """Inlet and outlet at other distances, on draft and standard; ``count`` granules of each fraction, or of the
    ``only`` one that flies.
    """
    scene, found = shipped("rhombus", {"feed.count": count or (QUICK_COUNT if quick else COUNT)}), []
    if only is not None:
        scene = with_one_fraction(scene, only)
    for rung in rungs or SCALES:
        scales = QUICK_SCALES if quick else SCALES[rung] * MESHES
        title = f"{rung}, {len(scales)} meshes of mesh_scale {min(scales):.3g} to {max(scales):.3g}"
        title += f", {scene.feed.count} granules a fraction"
        found += show(COLUMNS, rows(scene, rung, scales, DISTANCES[:2] if quick else DISTANCES), title)
    return found
