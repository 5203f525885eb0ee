"""How fast a crowd flies: granule steps a second and core, and memory, of streams in a channel, by their density.

    .venv/bin/python cases/studies/crowd_speed.py [--granules 20000]

A stream of wheat and chaff falls through air that rises in a channel past the rhombus, fed evenly in time, in a slab
that is periodic across the picture. Prints for drag and gravity, and with the pressure gradient and dispersion too: the
granules that fly at once, the steps of granules a second and core, meetings a granule, and the memory of the slab.
"""

from __future__ import annotations

import argparse
import resource
import time
from typing import Any

import numpy as np
from scipy.spatial import Delaunay

import wakeflow as wf

WIDTH, HEIGHT, SPEED = 0.48, 0.5, 1.5
RHOMBUS = np.array([[-0.03, 0.0], [0.0, -0.03], [0.03, 0.0], [0.0, 0.03]])


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
    return wf.FlowField.from_arrays(
        points, Delaunay(points).simplices, velocity, pressure=pressure, k=k, dissipation=k * 20.0
    )


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


def speed(count: int, rate: float, forces: tuple[str, ...], step: float = 1e-4) -> dict[str, Any]:
    """One slab of 60 mm: granule steps a second, how many fly at once, meetings a granule."""
    field = channel()
    exits = [np.array([[-1.0, -0.24], [1.0, -0.24]]), np.array([[-1.0, 0.24], [1.0, 0.24]])]
    law = wf.Collisions(0.06, [[0.5, 0.3], [0.3, 0.3]], 0.3, step=step)
    laws: dict[str, Any] = {
        "until": count / rate + 1.0, "bodies": [RHOMBUS], "lines": exits, "forces": forces, "tolerance": 1e-3,
        "collisions": law,
    }  # fmt: skip
    wf.track(field, feed(8, 1e3), **laws)  # compiles
    began = time.process_time()
    tracks = wf.track(field, feed(count, rate), **laws)
    took = time.process_time() - began
    assert tracks.crowd is not None
    assert tracks.meetings is not None
    return {
        "at once": tracks.crowd.flown / tracks.crowd.steps, "steps": tracks.crowd.flown, "seconds": took,
        "per second": tracks.crowd.flown / took, "meetings": float(tracks.meetings.mean()),
        "fates": {fate.name: number for fate, number in tracks.counts().items() if number},
    }  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--granules", type=int, default=20_000)
    given = parser.parse_args(arguments)
    print("forces                       rate 1/s  at once  granule steps  million/s/core  meetings")
    simple, more = ("drag", "gravity"), ("drag", "gravity", "pressure-gradient", "dispersion")
    for forces in (simple, more):
        for rate in (3e3, 3e4):
            found = speed(given.granules, rate, forces)
            print(
                f"{'all four' if forces is more else 'drag, gravity':28s} {rate:8.0f} {found['at once']:8.0f} "
                f"{found['steps']:14d} {found['per second'] / 1e6:15.2f} {found['meetings']:9.2f}"
            )
    print(f"memory of the process at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
