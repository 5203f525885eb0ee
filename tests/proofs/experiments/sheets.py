"""Flat pieces and rods let go at rest in a level wind: how far the drag of their terminal velocity carries them.

Lin, Letchford & Holmes 2006, J. Wind Eng. Ind. Aerodyn. 94, 51; Lin, Holmes & Letchford 2007, J. Struct. Eng. 133, 274
(not read): wind tunnels, K x g / U^2 against T = K g t / U with Tachikawa's number K = rho U^2 A / (2 m g), A the flat
area, as polynomials over many K; the sheets' and the rods' first coefficient as a public model of debris has them, the
rods' others from memory. Here chaff of the materials' dimensions and terminal velocity is the sheet, straw the rod.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from proofs.report import Report, Row, Table, Tell
from wakeflow import FlowField, track
from wakeflow.core.errors import known
from wakeflow.flight.feed.feedstock import granules_of
from wakeflow.laws.constants import GRAVITY, STANDARD_AIR
from wakeflow.laws.material import materials
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

Array = NDArray[np.float64]
SOURCE = "Lin, Holmes & Letchford 2007, J. Struct. Eng. 133, 274 (polynomials as others give them)"
FLOWN = {  # powers 2 to 5 of T; the material that is flown
    "sheet": ("chaff", (0.456, -0.148, 0.024, -0.0014)), "rod": ("straw", (0.4005, -0.16, 0.036, -0.0032)),
}  # fmt: skip
TACHIKAWA = (1.0, 3.0, 8.0)
TIMES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)  # T
WITHIN = 0.15  # of the way: chosen, the polynomials' own scatter was not found
BOX = 100.0  # m, of wind
COLUMNS = {
    "piece": "{piece}", "K": "{number:g}", "wind, m/s": "{speed:.2f}", "drag coefficient of its fall": "{drag:.2f}",
    **{f"T {time:g}": f"{{at{10 * time:.0f}:.2f}}" for time in TIMES}, "gate": "{gate}", "met": "{met:yes|NO}",
}  # fmt: skip


def measured(powers: tuple[float, ...]) -> Array:
    """K x g / U^2 at TIMES."""
    return np.asarray(sum(a * np.array(TIMES) ** (2 + n) for n, a in enumerate(powers)))


def piece(material: str) -> tuple[Scene, float, float]:
    """A scene with such granules, all alike; mass (kg) over flat area (kg/m2); its drag coefficient as it falls."""
    scene = Scene.parse({
        "channel": {"width": 1.0, "top": 1.0, "bottom": -1.0}, "air": {"speed": 1.0},
        "feed": {"speed": 0.1, "width": 0.01, "count": 16},
        "fraction": {material: {"material": material}}, "bin": {"floor": {"from": -0.5, "to": 0.5}},
    })  # fmt: skip
    granule, (length, width, _) = scene.fraction[material].properties, known(materials[material].dimensions)
    mass = granule.density * math.pi / 6.0 * granule.diameter**3
    weight = mass / (length * width)
    return scene, weight, 2.0 * weight * GRAVITY / (STANDARD_AIR[0] * float(granule.terminal_velocity or 0.0) ** 2)


def carried(scene: Scene, speed: float, until: Array) -> Array:
    """How far (m) the granule of a scene's fraction is carried by a level wind (m/s) at the times ``until`` (s)."""
    (name,), density = scene.fraction, STANDARD_AIR
    made = granules_of(
        scene, name, make_plan(scene).fractions[name], np.array([scene.fraction[name].properties.diameter])
    )
    corners = BOX * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    wind = FlowField.from_arrays(
        corners, [[0, 1, 2], [0, 2, 3]], np.tile([speed, 0.0], (4, 1)), density=density[0], viscosity=density[1]
    )  # fmt: skip
    law = scene.fraction[name].drag_law
    return np.array([
        track(
            wind, made, until=float(end), tolerance=1e-5, length=0.1, drag=law, forces=("drag", "gravity"),
            gravity=(0.0, -GRAVITY),
        ).position[0, 0]
        for end in until
    ])  # fmt: skip


def run_sheets(tell: Tell = lambda _: None) -> Report:
    """A sheet and a rod at each Tachikawa number."""
    rows: list[Row] = []
    for name, (material, powers) in FLOWN.items():
        tell(f"{material} in a level wind")
        scene, weight, drag = piece(material)
        for number in TACHIKAWA:
            speed = math.sqrt(2.0 * number * weight * GRAVITY / STANDARD_AIR[0])
            way = carried(scene, speed, np.array(TIMES) * speed / (number * GRAVITY))
            ratio = number * GRAVITY * way / speed**2 / measured(powers)
            rows.append({
                "case": "sheets", "piece": f"{name}: {material}", "number": number, "speed": speed, "drag": drag,
                **{f"at{10 * time:.0f}": float(one) for time, one in zip(TIMES, ratio, strict=True)},
                "worst": float(ratio[np.argmax(np.abs(ratio - 1.0))]), "gate": f"1 within {WITHIN:g}",
                "met": bool(np.all(np.abs(ratio - 1.0) <= WITHIN)), "source": SOURCE,
            })  # fmt: skip
    missed = [f"{row['piece']} at K = {row['number']:g}" for row in rows if not row["met"]]
    table = Table("flat pieces and rods in a level wind: way over that measured", COLUMNS, rows)
    return Report("sheets", [table], {"rows": rows}, [SOURCE], missed)
