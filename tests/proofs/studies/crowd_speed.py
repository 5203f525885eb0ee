"""How fast granules that meet fly: granule steps a second and core, and memory, of streams in a channel, by density.

A stream of wheat and chaff falls through air that rises in a channel past the rhombus, fed evenly in time, in a slab
that is periodic across the picture. Of drag and gravity, and with the pressure gradient and dispersion too: the
granules that fly at once, the steps of granules a second and core, collisions a granule, and the memory of the slab.
docs/crowd.md: --granules 3000
"""

from __future__ import annotations

import resource
import time
from itertools import product

import numpy as np
from scipy.spatial import Delaunay

import wakeflow as wf

from .common import Row, show

WIDTH, HEIGHT, SPEED = 0.48, 0.5, 1.5
RHOMBUS = np.array([[-0.03, 0.0], [0.0, -0.03], [0.03, 0.0], [0.0, 0.03]])
FORCES = {
    "drag, gravity": ("drag", "gravity"), "all four": ("drag", "gravity", "pressure-gradient", "dispersion"),
}  # fmt: skip
RATES = (3e3, 3e4)  # 1/s
COLUMNS = {
    "forces": "{forces}", "rate 1/s": "{rate:.0f}", "at once": "{at_once:.0f}", "granule steps": "{steps}",
    "million/s/core": "{speed:.2f*1e-6}", "collisions": "{collisions:.2f}",
}  # fmt: skip


def channel(cells: int = 96) -> wf.FlowField:
    """Air that rises past a round obstacle (ideal flow), with pressure and even turbulence, on triangles."""
    x, y = np.meshgrid(np.linspace(-WIDTH / 2, WIDTH / 2, cells + 1), np.linspace(-HEIGHT / 2, HEIGHT / 2, cells + 1))
    points = np.column_stack([x.ravel(), y.ravel()])
    z = points[:, 0] + 1j * points[:, 1]
    z = np.where(np.abs(z) < 0.03, 0.03 * np.exp(1j * np.angle(z)), z)
    w = -1j * SPEED * (1 + (0.03**2) / z**2)
    velocity = np.column_stack([w.real, -w.imag])
    pressure = 0.6 * (SPEED**2 - (velocity**2).sum(axis=1))
    k = np.full(len(points), 0.1)
    cells_of = Delaunay(points).simplices
    return wf.FlowField.from_arrays(points, cells_of, velocity, pressure=pressure, k=k, dissipation=k * 20.0)


def feed(count: int, rate: float, seed: int = 1) -> wf.Granules:
    """Wheat, and ten of chaff for each, ``rate`` granules a second, over 40 mm above the rhombus."""
    rng = np.random.default_rng(seed)
    chaff = rng.random(count) < 10 / 11
    position = np.column_stack([rng.uniform(-0.02, 0.02, count), np.full(count, 0.2)])
    velocity = np.column_stack([np.zeros(count), np.full(count, -1.0)])
    return wf.Granules(
        position, velocity, np.where(chaff, 2e-3, 4e-3), np.where(chaff, 250.0, 1300.0), fraction=chaff.astype(int),
        inertia=0.4, time=np.sort(rng.uniform(0, count / rate, count)),
    )  # fmt: skip


def flown(count: int, rate: float, forces: str) -> Row:
    """One slab of 60 mm."""
    field = channel()
    exits = [np.array([[-1.0, y], [1.0, y]]) for y in (-0.24, 0.24)]
    law = wf.Collisions(0.06, [[0.5, 0.3], [0.3, 0.3]], 0.3, step=1e-4)
    laws = {
        "until": count / rate + 1.0, "bodies": [RHOMBUS], "lines": exits, "forces": FORCES[forces], "tolerance": 1e-3,
        "collisions": law,
    }  # fmt: skip
    wf.track(field, feed(8, 1e3), **laws)  # compiles
    began = time.process_time()
    tracks = wf.track(field, feed(count, rate), **laws)
    speed = tracks.crowd.flown / (time.process_time() - began)
    return {
        "forces": forces, "rate": rate, "at_once": tracks.crowd.flown / tracks.crowd.steps, "speed": speed,
        "steps": tracks.crowd.flown, "collisions": tracks.meetings.mean(),
    }  # fmt: skip


def main(granules: int = 20_000) -> list[Row]:
    """Granule steps a second and core where granules meet."""
    found = show(COLUMNS, (flown(granules, rate, forces) for forces, rate in product(FORCES, RATES)))
    print(f"memory of the process at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    return found
