"""How many granules meet the front of a body: the plan's ideal flow beside exact values and beside solved airflows.

.venv/bin/python cases/studies/impaction.py [MESH_SCALE] [--quick]

Prints the tables of docs/validation.md. First the cylinder in unbounded ideal flow, where trajectories of high
accuracy and Langmuir & Blodgett's table are known; then bodies in the channel of cases/rhombus.toml: efficiency by the
ideal flow round a wedge and its wake, and by the tracker in OpenFOAM's steady airflow, with the same drag, weight and
drop. Half a minute of one core an airflow.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import wakeflow as wf
from wakeflow.injection.feed import granules_of
from wakeflow.laws.impaction import Cylinder, approach
from wakeflow.pipeline.pipeline import Pipeline
from wakeflow.planning.impaction import deflection, front_of
from wakeflow.planning.make import make_plan
from wakeflow.tracking import Fate, track

K = np.array([0.196, 0.256, 0.4, 0.625, 0.9, 1.6, 3.6, 6.4, 10.0, 19.6])
LANGMUIR_BLODGETT = (0.018, 0.045, 0.129, 0.253, 0.358, 0.506, 0.696, 0.803, 0.864, 0.926)  # 1946, table II
EXACT = (0.01215, 0.04269, 0.12999, 0.24656, 0.35172, 0.51655, 0.71295, 0.81429, 0.87147, 0.92896)  # LSODA, 1e-10
BODIES = {
    "rhombus 25 deg": {"slope_angle": np.radians(25.0)},
    "rhombus 45 deg": {},
    "rhombus 65 deg": {"slope_angle": np.radians(65.0)},
    "prism 60 deg, apex up": {"shape": "prism", "slope_angle": np.radians(60.0)},
    "circle": {"shape": "circle", "slope_angle": None},
}
KINDS = {  # fraction.X changed
    "dust 20 um": {"material": "dust", "size": 20e-6},
    "dust 50 um": {"material": "dust", "size": 50e-6},
    "dust 100 um": {"material": "dust", "size": 100e-6},
    "chaff": {"material": "chaff"},
    "rapeseed": {"material": "rapeseed"},
    "wheat": {"material": "wheat"},
}
CASES = Path(__file__).parents[1]
PLACES = 400  # granules across the body


def cylinder() -> None:
    """Print the efficiencies of the cylinder in unbounded ideal flow."""
    points = approach(
        Cylinder(1.0, 1.0),
        above=50.0,
        speed=1.0,
        radius=np.full(len(K), 1e-9),
        relax=lambda slip: K[:, None] + 0 * slip,
        pull=0.0,
    )
    print("| K = tau U / R | plan's ideal flow | exact | Langmuir & Blodgett 1946 |\n|---|---|---|---|")
    for row in zip(K, points.efficiency, EXACT, LANGMUIR_BLODGETT, strict=True):
        print("| {:g} | {:.4f} | {:.4f} | {:.3f} |".format(*row))


def scene_with(body: dict[str, object], scale: float) -> wf.Scene:
    """The rhombus scene at rest with another body and the six kinds of granules."""
    tables = wf.Scene.load(CASES / "rhombus.toml").tables()
    del tables["vibration"]
    shape = {**tables["body"]["rhombus"], **body}
    tables["body"] = {"it": {key: value for key, value in shape.items() if value is not None}}
    tables["fraction"] = {f"kind{i}": row for i, row in enumerate(KINDS.values())}
    tables["numerics"] = {"rung": "draft", "mesh_scale": scale}
    return wf.Scene.parse(tables)


def in_the_airflow(scene: wf.Scene) -> list[tuple[float, float, float]]:
    """Of each kind: K = tau v / h; efficiency by the ideal flow; by the tracker in the solved airflow."""
    plan = make_plan(scene, force={"air-loading": False})
    pipeline = Pipeline(scene, plan)
    flow = pipeline.field[1]
    body = wf.Body(next(iter(scene.body.values())).outline(), capture=True)
    top, shoulder = body.outline[:, 1].max(), body.outline[:, 1].max() - front_of(scene).depth
    found = []
    for name, how in plan.fractions.items():
        turned = deflection(scene, name, how.drag, how.drag_scale)
        assert turned is not None
        size = scene.fraction[name].properties.diameter
        full = 0.5 * (scene.width + size)
        x = full * (np.arange(PLACES) + 0.5) / PLACES
        grains = granules_of(scene.fraction[name], how, np.full(PLACES, size)).replace(
            position=np.stack([x, np.full(PLACES, top + scene.release[0])], axis=1)
        )
        past = np.array([(-1.0, shoulder - full), (1.0, shoulder - full)])
        tracks = track(
            flow, grains, until=5.0, tolerance=1e-4, length=scene.width, drag=how.drag, bodies=(body,),
            forces=("drag", "gravity", "buoyancy"), lines=(past,),
        )  # fmt: skip
        hits = (tracks.fate == Fate.CAPTURED) & (tracks.position[:, 1] > shoulder - 0.5 * size)
        found.append((how.stokes, turned.efficiency, float(hits.mean())))
    return found


def main(scale: float, quick: bool = False) -> None:
    """Print both tables, airflows on meshes ``scale`` times as coarse; ``quick``: of one body."""
    cylinder()
    print("\n| body | " + " | ".join(KINDS) + " |\n|---|" + "---|" * len(KINDS))
    for title, body in list(BODIES.items())[: 1 if quick else None]:
        rows = in_the_airflow(scene_with(body, scale))
        cells = [f"{100 * ideal:.1f} / {100 * solved:.1f}" for _, ideal, solved in rows]
        print(f"| {title} | {' | '.join(cells)} |", flush=True)
    print("| K = tau v / h | " + " | ".join(f"{stokes:.2g}" for stokes, _, _ in rows) + " |")


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--quick"]
    main(float((given or ["1"])[0]), "--quick" in sys.argv)
