"""Beads of hollow glass spread behind a grid: what dispersion's lifetime of eddies is held against.

Snyder & Lumley 1971: mean square of how far beads went sideways after the first camera, 68.4 meshes behind a grid in a
wind tunnel that blows up, digitised from the paper by the author of a public test of another program (9 points, about
2 ms and 0.04 cm2). v'^2 = U^2 / (39.4 (y/M - 12)) is their fit of the decay, as quoted by others. With k = 3/2 v'^2 and
the dissipation of that decay, k / dissipation is the time since y = 12 M, and grows from 0.22 to 0.63 s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from proofs.report import Report, Row, Table, Tell
from wakeflow import FlowField, Granules, track
from wakeflow.laws.constants import GRAVITY
from wakeflow.laws.turbulence import LIFETIME, LIFETIMES

Array = NDArray[np.float64]
SOURCE = "Snyder & Lumley 1971, J. Fluid Mech. 48, 41 (points and fit as others give them)"
MESH, SPEED, DECAY, ORIGIN, CAMERA = 0.0254, 6.55, 39.4, 12.0, 68.4  # m, m/s; the last two in meshes
BEAD = {"diameter": 46.5e-6, "density": 260.0}  # m, kg/m3: falls 17 mm/s, quoted
START, END, HALF = 64.0, 200.0, 0.5  # meshes, and m: where beads begin, ahead of the camera, and the field's extent
MEASURED = (  # s after the first camera, cm2
    (0.02543, 0.132), (0.05639, 0.285), (0.09509, 0.636), (0.12604, 0.987), (0.16916, 1.469), (0.21892, 1.908),
    (0.27531, 2.632), (0.33943, 3.421), (0.41241, 4.518),
)  # fmt: skip
FROM, WITHIN = 0.09, 0.2  # s from which on the range's short end is as measured, to that part of it; chosen
COLUMNS = {
    "after, s": "{time:.3f}", "measured, cm2": "{measured:.2f}", "shortest lifetime, 0.14 k / eps": "{shortest:.2f}",
    f"the law's, {LIFETIME:.3f}": "{law:.2f}", "longest, 0.5": "{longest:.2f}", "gate": "{gate}", "met": "{met:yes|NO}",
}  # fmt: skip


def tunnel(lifetime: float) -> FlowField:
    """The air behind the grid, whose eddies live for ``lifetime`` k / dissipation."""
    y = MESH * np.linspace(START - 1.0, END, 273)
    points = np.stack(np.meshgrid([-HALF, HALF], y), axis=-1).reshape(-1, 2)
    corner = 2 * np.arange(len(y) - 1)
    halves = [np.stack([corner, corner + a, corner + b], axis=1) for a, b in ((1, 3), (3, 2))]
    since = (points[:, 1] / MESH - ORIGIN) * MESH / SPEED
    k = 1.5 * SPEED * MESH / DECAY / since
    velocity = np.tile([0.0, SPEED], (len(points), 1))
    dissipation = k / since * LIFETIME / lifetime
    return FlowField.from_arrays(points, np.concatenate(halves), velocity, k=k, dissipation=dissipation)


def spread(lifetime: float, count: int) -> Array:
    """Mean square (cm2) of the way sideways at the times that were MEASURED."""
    begin, zeros = np.tile([0.0, START * MESH], (count, 1)), np.zeros(count)
    beads = Granules(begin, np.stack([zeros, zeros + SPEED], axis=1), **BEAD)
    late = np.array([0.0, *(time for time, _ in MEASURED)]) + (CAMERA - START) * MESH / SPEED
    found = track(
        tunnel(lifetime), beads, until=float(late[-1]), tolerance=1e-4, length=0.1, record=True, seed=1,
        forces=("drag", "gravity", "dispersion"), gravity=(0.0, -GRAVITY),
    )  # fmt: skip
    x = np.array([np.interp(late, path[:, 0], path[:, 1]) for path in found.recorded])
    return np.asarray(1e4 * np.mean((x[:, 1:] - x[:, :1]) ** 2, axis=0))


def run_grid(tell: Tell = lambda _: None, count: int = 4096) -> Report:
    """At the law's lifetime and at both ends of its range."""
    tell("beads behind a grid")
    found = {name: spread(life, count) for name, life in zip(
        ("shortest", "law", "longest"), (LIFETIMES[0], LIFETIME, LIFETIMES[1]), strict=True
    )}  # fmt: skip
    rows: list[Row] = []
    for number, (time, measured) in enumerate(MEASURED):
        row = {name: float(values[number]) for name, values in found.items()}
        near = abs(row["shortest"] / measured - 1.0) <= WITHIN
        rows.append({
            "case": "grid", "time": time, "measured": measured, **row, "source": SOURCE,
            "gate": f"shortest within {WITHIN:.0%}" if time > FROM else None, "met": near if time > FROM else None,
        })  # fmt: skip
    missed = [f"beads behind a grid after {row['time']} s" for row in rows if row["met"] is False]
    return Report("grid", [Table("beads behind a grid", COLUMNS, rows)], {"rows": rows}, [SOURCE], missed)
