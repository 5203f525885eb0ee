"""Move inlet and outlet of the shipped rhombus' airflow, and see what that changes of the air and of the shares:

.venv/bin/python cases/studies/domain.py [draft|standard ...] [--count N] [--only FRACTION] [--quick]

Prints the tables of docs/validation.md, one a rung: the same scene with its ends at so many body widths before and
behind the body; in the last row they are furthest off, and the last columns compare each row's shares with that one's.
Other ends move cells everywhere, and so the shares by more than the ends themselves do: every row is the mean over
meshes of slightly different cells, and its change has the standard error of that mean.
The steady wake shows what the inlet does, through which no vortices leave; the time-resolved one what the outlet does.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import wakeflow as wf
from wakeflow.meshing import ends
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.make import make_plan

CASES = Path(__file__).parents[1]
# (before, behind) in body widths; None: what the program chooses
DISTANCES: dict[str, tuple[tuple[float, float] | None, ...]] = {
    "draft": ((3.5, 8.0), None, (12.0, 25.0)),
    "standard": ((3.5, 8.0), None, (12.0, 25.0)),
}
SHORT = ((3.5, 8.0), None)
SCALES = {"draft": 1.0, "standard": 1.5}  # numerics.mesh_scale
MESHES = 1.0 + 0.03 * (np.arange(8) - 3.5)  # factors on it
COUNT = 2048
QUICK_SCALE, QUICK_COUNT = 4.0, 64
ACCURACY = 0.02  # statistics sharper than the answer's
HEAD = (
    "| before, D | behind, D | cells | Cd | Cl rms | Cp base | change of shares, points: largest "
    "| of each fraction in its bins |\n" + "|---" * 8 + "|"
)
Shares = dict[str, np.ndarray]


def moved(scene: wf.Scene, rung: str, distances: tuple[float, float] | None) -> Pipeline:
    """The scene with its inlet and outlet at ``distances`` (body widths) from the body."""
    plan = make_plan(scene, rung=rung, force={"air-loading": False})
    plan = replace(plan, airflow=replace(plan.airflow, accuracy=ACCURACY))
    made = Pipeline(scene, plan)
    for pipeline in (made, made.draft):
        spec = pipeline.mesh_spec
        before, behind = distances or ends(spec.width / spec.projected_width)
        outline = np.array(spec.bodies[0])
        top, bottom = outline[:, 1].max() + before * spec.widths[0], outline[:, 1].min() - behind * spec.widths[0]
        pipeline.kind.mesh_spec = replace(spec, top=float(top), bottom=float(bottom))  # type: ignore[attr-defined]
    return made


def shares(pipeline: Pipeline) -> Shares:
    """Mean share of each fraction in every bin."""
    landings, bins = pipeline.tracks().landings, len(pipeline.scene.bin)
    return {name: landings[name].counts(bins).mean(axis=0) for name in landings}


def target(scene: wf.Scene, name: str) -> list[int]:
    """The bins that a fraction is meant for."""
    meant = scene.fraction[name].target
    return [list(scene.bin).index(each) for each in ([meant] if isinstance(meant, str) else meant or ())]


def mean_and_error(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Over the meshes, the first axis."""
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))


def table(scene: wf.Scene, rung: str, scales: Sequence[float], tell: Callable[[str], None], short: bool) -> None:
    """Tell the lines of a rung's table."""
    distances: Sequence[tuple[float, float] | None] = SHORT if short else DISTANCES[rung]
    rows = [[moved(scene.replace({"numerics.mesh_scale": float(s)}), rung, each) for s in scales] for each in distances]
    found = [[shares(pipeline) for pipeline in row] for row in rows]
    tell(
        f"\n{rung}, {len(scales)} meshes of mesh_scale {min(scales):.3g} to {max(scales):.3g}, {scene.feed.count} "
        f"granules a fraction\n\n{HEAD}"
    )
    for row, mine in zip(rows, found, strict=True):
        spec, airs = row[0].mesh_spec, [pipeline.airflow for pipeline in row]
        outline, size = np.array(spec.bodies[0]), spec.widths[0]
        before, behind = (spec.top - outline[:, 1].max()) / size, (outline[:, 1].min() - spec.bottom) / size
        numbers = " | ".join(
            "{:.3f} ± {:.3f}".format(*mean_and_error(np.array([getattr(air, name).value for air in airs])))
            for name in ("cd", "cl_rms", "cp_base")
        )
        moves = {
            name: 100 * np.array([one[name] - last[name] for one, last in zip(mine, found[-1], strict=True)])
            for name in mine[0]
        }
        mean, error = mean_and_error(np.concatenate(list(moves.values()), axis=1))
        largest = int(np.abs(mean).argmax())
        meant = ", ".join(
            "{:+.2f} ± {:.2f} {}".format(*mean_and_error(move[:, target(scene, name)].sum(axis=1)), name)
            for name, move in moves.items()
        )
        cells = round(float(np.mean([air.cells for air in airs])))
        tell(
            f"| {before:.1f} | {behind:.1f} | {cells} | {numbers} | {mean[largest]:+.2f} ± {error[largest]:.2f} | "
            f"{meant} |"
        )


def main(
    rungs: Sequence[str],
    tell: Callable[[str], None] = print,
    quick: bool = False,
    count: int | None = None,
    only: str | None = None,
) -> None:
    """Tell the table of each rung; ``count`` granules of each fraction, or of the ``only`` one that is flown."""
    scene = wf.Scene.load(CASES / "rhombus.toml").replace({"feed.count": count or (QUICK_COUNT if quick else COUNT)})
    if only is not None:
        tables = scene.tables()
        scene = wf.Scene.parse({**tables, "fraction": {only: {**tables["fraction"][only], "mass_share": 1.0}}})
    for rung in rungs:
        scales = QUICK_SCALE * MESHES[3:5] / MESHES[4] if quick else SCALES[rung] * MESHES
        table(scene, rung, scales, tell, short=quick)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("rungs", nargs="*", choices=list(DISTANCES), default=list(DISTANCES))
    parser.add_argument("--count", type=int, help="granules of each fraction")
    parser.add_argument("--only", help="one fraction instead of all")
    parser.add_argument("--quick", action="store_true", help="two coarse meshes, few granules")
    asked = parser.parse_args()
    main(asked.rungs, quick=asked.quick, count=asked.count, only=asked.only)
