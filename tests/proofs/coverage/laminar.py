"""Error of mesh and averaging: laminar airflows on coarse meshes beside references on fine ones.

The references stand in laminar.json; ``python -m proofs.coverage.laminar``, in ``tests``, computes
those that are missing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from proofs.coverage.counted import Counted, numerical_alone
from proofs.coverage.flown import predicted
from proofs.coverage.scenes import SINGLE, VariedScene
from wakeflow.answer.separation import separate
from wakeflow.core.files import write_json
from wakeflow.core.store import Store, cache_root
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.uncertainty import OF_FRACTION, OF_SCENE

FILE = Path(__file__).with_name("laminar.json")
WIDTH, BLOCKED = 0.01, 8.0  # m, of the bodies; channel widths over it
KINEMATIC, DENSITY = 1.5e-5, 1.2  # m2/s and kg/m3
COARSE, FINE = 3.0, 1.0  # factors on every cell edge
COUNT, MANY = 4096, 2**14
SQUARE = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
BODIES: dict[str, dict[str, Any]] = {
    "rhombus": {"shape": "rhombus", "width": WIDTH, "slope_angle": "45 deg"},
    "prism": {"shape": "prism", "width": WIDTH, "slope_angle": "45 deg"},
    "square": {"shape": "polygon", "points": [[WIDTH * x for x in point] for point in SQUARE]},
}
REYNOLDS = (10, 15, 20, 25, 60, 120)  # below 27.7 the steady flow is the flow itself; above it sheds
NAMES = tuple(f"{body} at Re {reynolds}" for reynolds in REYNOLDS for body in BODIES)


def laminar_scene(name: str, scale: float, count: int) -> Scene:
    """One of :data:`NAMES` on a mesh of cell edges ``scale`` times the usual ones; all its numbers are exact."""
    body, _, reynolds = name.partition(" at Re ")
    half = 0.5 * BLOCKED * WIDTH
    ends = (-half, -0.8 * WIDTH, 0.0, 0.8 * WIDTH, half)
    sizes = {"fine": "30 um", "middle": "60 um", "coarse": "120 um"}
    own = {"density": 1000.0, "restitution": 0.5, "friction": 0.3}
    tables: dict[str, Any] = {
        "body": {body: BODIES[body]},
        "channel": {"width": 2 * half, "top": 3 * WIDTH, "bottom": -4 * WIDTH},
        "air": {
            "speed": float(reynolds) * KINEMATIC / WIDTH,
            "direction": "down",
            "density": DENSITY,
            "viscosity": KINEMATIC * DENSITY,
        },
        "feed": {"height": WIDTH, "width": 1.2 * WIDTH, "count": count},
        "fraction": {size: {"size": diameter, **own} for size, diameter in sizes.items()},
        "bin": {f"bin-{i}": {"from": ends[i], "to": ends[i + 1]} for i in range(len(ends) - 1)},
        "force": SINGLE,
        "numerics": {"mesh_scale": scale, "tolerance": 1e-4},
    }
    of_fractions = (f"fraction.{size}.{key}" for size in sizes for key in OF_FRACTION)
    scene = Scene.parse(tables)
    return scene.model_copy(update={"uncertainty": dict.fromkeys([*of_fractions, *OF_SCENE], 0.0)})


@cache
def references() -> dict[str, dict[str, Any]]:
    """By name: ``cells`` of the fine mesh, and ``shares`` by fraction and bin."""
    found: dict[str, dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    return found


def compute_references(names: tuple[str, ...] = NAMES, tell: Callable[[str], None] = print) -> None:
    """Solve and fly what laminar.json lacks of ``names``, on fine meshes with many granules, and keep it there."""
    known = dict(references())
    for name in names:
        if name in known:
            continue
        tell(name)
        scene = laminar_scene(name, FINE, MANY)
        pipeline = Pipeline(scene, make_plan(scene), store=Store(cache_root()))
        found = separate(scene, pipeline.tracks().landings)
        shares = {f: {place: round(s.value, 6) for place, s in row.items()} for f, row in found.fractions.items()}
        known[name] = {"cells": pipeline.airflow.cells, "shares": shares}
        write_json(FILE, known)


def laminar_rows(name: str) -> Iterator[Counted]:
    """Shares on the coarse mesh with what the budget gives them by computing alone, against the reference's: that was
    flown by the same plan, so that terms left out are no part of the error.
    """
    told = predicted(VariedScene(name, "laminar", laminar_scene(name, COARSE, COUNT)), Store(cache_root()))
    true = references()[name]["shares"]
    return numerical_alone(told, {fraction: list(true[fraction].values()) for fraction in true})


if __name__ == "__main__":
    compute_references(tuple(sys.argv[1:]) or NAMES)
