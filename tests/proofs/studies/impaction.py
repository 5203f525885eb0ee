"""How many granules meet the front of a body: the plan's ideal flow, exact values, and solved airflows.

First the cylinder in unbounded ideal flow, where trajectories of high accuracy and Langmuir & Blodgett's table are
known; then bodies in the channel of cases/rhombus.toml: efficiency by the ideal flow round a wedge and its wake, and by
the tracker in OpenFOAM's steady airflow, with the same drag, weight and drop. Half a minute of one core an airflow;
docs/validation.md.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.injection.feed import granules_of
from wakeflow.laws.impaction import Cylinder, approach
from wakeflow.planning.impaction import deflection, front_of
from wakeflow.tracking import Fate, track

from .common import BARE, Row, piped, show

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
PLACES = 400  # granules across the body
CYLINDER = {
    "K = tau U / R": "{k:g}", "plan's ideal flow": "{plan:.4f}", "exact": "{exact:.4f}",
    "Langmuir & Blodgett 1946": "{published:.3f}",
}  # fmt: skip


def cylinder() -> list[Row]:
    """Efficiencies of the cylinder in unbounded ideal flow."""
    points = approach(
        Cylinder(1.0, 1.0), above=50.0, speed=1.0, radius=np.full(len(K), 1e-9), pull=0.0,
        relax=lambda slip: K[:, None] + 0 * slip,
    )  # fmt: skip
    found = zip(K, points.efficiency, EXACT, LANGMUIR_BLODGETT, strict=True)
    return show(CYLINDER, (dict(zip(("k", "plan", "exact", "published"), row, strict=True)) for row in found))


def scene_with(body: dict[str, object], scale: float) -> wf.Scene:
    """The rhombus scene at rest with another body and the six kinds of granules."""
    tables = shipped("rhombus").tables()
    del tables["vibration"]
    shape = {**tables["body"]["rhombus"], **body}
    tables["body"] = {"it": {key: value for key, value in shape.items() if value is not None}}
    tables["fraction"] = {f"kind{i}": row for i, row in enumerate(KINDS.values())}
    tables["numerics"] = {"rung": "draft", "mesh_scale": scale}
    return wf.Scene.parse(tables)


def in_the_airflow(scene: wf.Scene) -> Iterator[tuple[float, float, float]]:
    """Of each kind: K = tau v / h; efficiency by the ideal flow; by the tracker in the solved airflow."""
    pipeline = piped(scene, force=BARE)
    body = wf.Body(next(iter(scene.body.values())).outline(), capture=True)
    top, shoulder = body.outline[:, 1].max(), body.outline[:, 1].max() - front_of(scene).depth
    for name, how in pipeline.plan.fractions.items():
        turned, size = deflection(scene, name, how.drag, how.drag_scale), scene.fraction[name].properties.diameter
        full = 0.5 * (scene.width + size)
        place = np.stack([full * (np.arange(PLACES) + 0.5) / PLACES, np.full(PLACES, top + scene.release[0])], axis=1)
        grains = granules_of(scene.fraction[name], how, np.full(PLACES, size)).replace(position=place)
        past = np.array([(-1.0, shoulder - full), (1.0, shoulder - full)])
        tracks = track(
            pipeline.field[1], grains, until=5.0, tolerance=1e-4, length=scene.width, drag=how.drag, bodies=(body,),
            forces=("drag", "gravity", "buoyancy"), lines=(past,),
        )  # fmt: skip
        hits = (tracks.fate == Fate.CAPTURED) & (tracks.position[:, 1] > shoulder - 0.5 * size)
        yield how.stokes, turned.efficiency, float(hits.mean())


def rows(scale: float, bodies: list[str]) -> Iterator[Row]:
    """A row a body; the last one has the granules' K."""
    for body in bodies:
        found = dict(zip(KINDS, in_the_airflow(scene_with(BODIES[body], scale)), strict=True))
        cells = {kind: f"{100 * ideal:.1f} / {100 * solved:.1f}" for kind, (_, ideal, solved) in found.items()}
        yield {"body": body, **cells}
    yield {"body": "K = tau v / h", **{kind: f"{stokes:.2g}" for kind, (stokes, _, _) in found.items()}}


def main(scale: float = 1.0, *, quick: bool = False) -> list[Row]:
    """Impaction efficiency, airflows on meshes ``scale`` times as coarse; ``quick``: of one body."""
    cylinder()
    print()
    return show(("body", *KINDS), rows(scale, list(BODIES)[: 1 if quick else None]))
