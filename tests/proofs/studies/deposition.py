"""How fast turbulence lays granules on a smooth wall: V+ against tau+, and the measured curve.

Still mean air beside a wall that keeps what touches it, on a mesh for wall functions and on one that resolves the
layer; without gravity and Brownian motion. The curve: 6e-4 tau+^2 to 12.9, 0.1 above (Liu, B.Y.H. & Agarwal, J.K. 1974,
J. Aerosol Sci. 5, 145, as quoted by Willeke & Baron).
deposition --count 2000
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from proofs.problems.exact import VISCOSITY, of_tau
from support import DENSITY
from wakeflow.field import FlowField
from wakeflow.tracking import Body, Fate, Tracks, track

from .common import Row, show

Array = NDArray[np.float64]
FRICTION = 0.5  # m/s, u*
NU = VISCOSITY / DENSITY
UNIT = NU / FRICTION  # m
DEPTH, WIDTH = 200.0, 100.0  # y+ from the wall to the plane of symmetry, and along the wall
TAU = (0.01, 0.1, 1.0, 3.0, 10.0, 30.0, 100.0)
MESHES = {
    "wall function": np.array([0.0, 33.0, 45.0, 60.0, 80.0, 100.0, 130.0, 160.0, DEPTH]),
    "resolved": np.array([0.0, 0.5, 1.0, 2.0, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 56.0, 80.0, 120.0, DEPTH]),
}
COLUMNS = {"mesh": "{mesh}", "tau+": "{tau:g}", "V+": "{found:.2g}", "within": "{error:.2g}", "measured": "{curve:.2g}",
           "us a granule": "{spent:.0f}"}  # fmt: skip


def curve(tau: float) -> float:
    """Measured V+ but for Brownian motion."""
    return 6e-4 * tau**2 if tau <= 12.9 else 0.1


def energy(y: Array) -> Array:
    """k+ of channel flow at y+: Dreeben, T.D. & Pope, S.B. 1997, Phys. Fluids 9, 2692, as quoted by Dehbi."""
    z = np.minimum(y, 100.0)
    along = 0.40 * z / (1.0 + 0.0239 * z**1.496)
    across = 0.0116 * z**2 / (1.0 + 0.203 * z + 0.00140 * z**2.421)
    return np.asarray(0.5 * (along**2 + across**2 + (0.19 * z / (1.0 + 0.0361 * z**1.322)) ** 2))


def layer(name: str) -> FlowField:
    """Still air beside a wall at y = 0, on one of ``MESHES``."""
    rows, columns = MESHES[name], np.linspace(0.0, WIDTH, 5)
    points = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    corner = (5 * np.arange(len(rows) - 1)[:, None] + np.arange(4)).ravel()
    cut = ([0, 1, 6], [0, 6, 5])
    y = points[:, 1]
    if name == "resolved":
        k, dissipation = energy(y), 1.0 / (0.41 * (y + 12.0))
    else:
        k, dissipation = np.full(len(y), 3.33), 1.0 / (0.41 * np.maximum(y, rows[1]))
    return FlowField.from_arrays(
        UNIT * points, np.concatenate([corner[:, None] + np.array(c) for c in cut]), 0.0 * points,
        k=k * FRICTION**2, dissipation=dissipation * FRICTION**4 / NU, density=DENSITY, viscosity=VISCOSITY,
        walls=y == 0.0,
    )  # fmt: skip


def flown(field: FlowField, tau: float, count: int, until: float, keeps: bool = True, seed: int = 1) -> Tracks:
    """Granules of relaxation time ``tau`` that fill the layer evenly, ``until`` that time; both in wall units."""
    top, side, t = UNIT * DEPTH, UNIT * WIDTH, UNIT * WIDTH
    boxes = ((-t, -t, side + t, 0.0), (-t, top, side + t, top + t), (-t, 0.0, 0.0, top), (side, 0.0, side + t, top))
    solids = [
        Body(np.array([[a, b], [c, b], [c, d], [a, d]]), restitution=1.0, friction=0.0, capture=keeps and not place)
        for place, (a, b, c, d) in enumerate(boxes)
    ]
    start = np.random.default_rng(seed).uniform(1e-2, 1.0 - 1e-2, (count, 2)) * (side, top)
    per = NU / FRICTION**2
    return track(
        field, of_tau(np.full(count, tau * per), start, np.zeros((count, 2))), until=until * per, tolerance=1e-3,
        length=top, forces=("drag", "dispersion"), drag="stokes", bodies=solids, seed=seed, workers=1,
    )  # fmt: skip


def laid(field: FlowField, tau: float, count: int) -> tuple[float, float]:
    """V+ and its standard error, from what is laid after the layer has become stationary."""
    begin = max(500.0, 5.0 * tau)
    until = begin + (2e3 if tau > 5.0 else 2e4)
    tracks = flown(field, tau, count, until)
    when = np.where(tracks.fate == Fate.CAPTURED, tracks.time * FRICTION**2 / NU, until)
    hits = np.sum((tracks.fate == Fate.CAPTURED) & (when > begin))
    exposed = np.sum(np.maximum(when - begin, 0.0))
    return DEPTH * hits / exposed, DEPTH * np.sqrt(max(hits, 1.0)) / exposed


def rows(count: int) -> Iterator[Row]:
    for name in MESHES:
        field = layer(name)
        laid(field, TAU[-1], 2)  # compiles
        for tau in TAU:
            begun = time.process_time()
            found, error = laid(field, tau, count)
            spent = 1e6 * (time.process_time() - begun) / count
            yield {"mesh": name, "tau": tau, "found": found, "error": error, "curve": curve(tau), "spent": spent}


def main(*, count: int = 2000) -> list[Row]:
    """V+ against tau+ on two meshes."""
    return show(COLUMNS, rows(count))
