"""Two clouds of granules that meet while they fall through rising air: the slab, DPMFoam and MPPICFoam.

All granules are there at the beginning, so that everybody flies the same ones; there is no wall, one restitution, no
friction. The air rises evenly and does not feel the granules: what the tracker computes. DPMFoam
computes every contact by soft spheres; in MPPICFoam parcels, here one a granule, never meet: the effect of contacts is
modelled from averages over cells.
"""

from __future__ import annotations

import math
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofs.tracker.foam import write_file
from wakeflow.air.field import FlowField
from wakeflow.air.foam.programs import call
from wakeflow.flight import Collisions, Granules, track
from wakeflow.laws.constants import GRAVITY

Array = NDArray[np.float64]
CASE = Path(__file__).with_name("meeting_clouds")
DEPTH, HALF, TOP = 0.06, 0.4, 0.4  # m: of the box, periodic across
CELL = 0.02  # m
BLOCK = ((0.01, 0.09), (0.20, 0.36))  # m: where the right cloud begins; the left one is its image
SPEED, UPDRAFT = 1.0, 2.0  # m/s: of each cloud towards the other, and of the air
DIAMETER, DENSITY = 3e-3, 300.0  # m, kg/m3: terminal velocity some 4.5 m/s
AIR_DENSITY, AIR_VISCOSITY = 1.2, 1.8e-5  # kg/m3, Pa s
RESTITUTION = 0.5
MODULUS, POISSON = 2e6, 0.25  # Pa, of the soft spheres
RESOLUTION = 12  # steps in a contact, as in OpenFOAM's own example
STEP, END = 5e-4, 0.45  # s: of the air, and when all but one in a thousand have landed
MIDDLE = 0.05  # m: half of the middle bin
SPACING = 1.01  # diameters between centres at least
PLACE, ORIG_ID = 6, 15  # columns of a landed parcel


@dataclass(frozen=True)
class CloudFlight:
    """Where each granule met the floor, x (n,) m, NaN where it did not; processor ``seconds``."""

    x: Array
    seconds: float

    def outcomes(self) -> NDArray[np.bool_]:
        """Whether each granule crossed to the other side, and whether it landed in the middle, (2, n)."""
        came = np.where(np.arange(len(self.x)) < len(self.x) // 2, -1.0, 1.0)
        return np.stack([self.x * came < 0.0, np.abs(self.x) < MIDDLE])

    def shares(self) -> tuple[float, float, float]:
        """Share of granules that crossed, share in the middle, rms of x (m) of those that landed."""
        crossed, middle = self.outcomes().mean(axis=1)
        return float(crossed), float(middle), float(np.sqrt(np.nanmean(self.x**2)))


def two_clouds(count: int, seed: int) -> Granules:
    """``count`` granules on the left and as many on the right, at random places without overlap."""
    rng = np.random.default_rng(seed)
    places = np.concatenate([_cloud(rng, count) * [-1.0, 1.0, 1.0], _cloud(rng, count)])
    velocity = np.zeros((2 * count, 2))
    velocity[:count, 0], velocity[count:, 0] = SPEED, -SPEED
    return Granules(places[:, :2], velocity, DIAMETER, DENSITY, depth=places[:, 2])


def _cloud(rng: np.random.Generator, count: int) -> Array:
    found = np.zeros((0, 3))
    while len(found) < count:
        place = np.array([rng.uniform(*BLOCK[0]), rng.uniform(*BLOCK[1]), rng.uniform(0.0, DEPTH)])
        away = found - place
        away[:, 2] -= DEPTH * np.round(away[:, 2] / DEPTH)
        if np.all(np.linalg.norm(away, axis=1) > SPACING * DIAMETER):
            found = np.concatenate([found, place[None]])
    return found


def fly_clouds(grains: Granules, *, collide: bool = True) -> CloudFlight:
    """By the slab, or each granule alone."""
    corners = HALF * np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]])
    corners[:, 1] *= TOP / HALF
    air = FlowField.from_arrays(
        corners, [(0, 1, 2), (0, 2, 3)], np.tile([0.0, UPDRAFT], (4, 1)), density=AIR_DENSITY, viscosity=AIR_VISCOSITY
    )
    collisions = Collisions(DEPTH, RESTITUTION, 0.0) if collide else None
    begun = time.process_time()
    tracks = track(
        air, grains if collide else grains.replace(depth=None), until=2.0, tolerance=1e-4, length=MIDDLE,
        forces=("drag", "gravity"), drag="putnam", gravity=(0.0, -GRAVITY), workers=1, collisions=collisions,
        lines=[np.array([[-HALF, 0.0], [HALF, 0.0]])],
    )  # fmt: skip
    x = np.where(tracks.line == 0, tracks.position[:, 0], np.nan)
    return CloudFlight(x, time.process_time() - begun)


def fly_foam_clouds(
    solver: str, grains: Granules, folder: Path, *, modulus: float = MODULUS, until: float = END
) -> CloudFlight:
    """By ``solver``, DPMFoam or MPPICFoam, in ``folder``, ``until`` all have landed (s); DPMFoam's spheres have Young's
    ``modulus`` (Pa). Raises FoamError as OpenFOAM does.
    """
    shutil.copytree(CASE, folder, dirs_exist_ok=True)
    words = {"solver": solver, "most": len(grains) + 1, "youngs": modulus, "end": until} | _settings()
    (folder / "settings").write_text("".join(f"{name} {value};\n" for name, value in words.items()))
    assert grains.depth is not None
    half = len(grains) // 2
    places = np.column_stack([grains.position, grains.depth])
    for name, some in (("left", places[:half]), ("right", places[half:])):
        rows = "\n".join(f"({x:.12g} {y:.12g} {z:.12g})" for x, y, z in some)
        write_file(folder / "constant" / name, "vectorField", f"(\n{rows}\n)\n")
    for program in ("blockMesh", solver):
        log = call(folder, [program]).log
    clock = [line.split()[2] for line in log.read_text().splitlines() if line.startswith("ExecutionTime = ")]
    return CloudFlight(_landings(folder, len(grains)), float(clock[-1]))


def _settings() -> dict[str, float]:
    """The damping is that of Hertz' spring with F = k d^1.5 + a sqrt(m k) d^0.25 d', whose restitution is exact:
    a = -sqrt(5) ln e / sqrt(ln^2 e + pi^2) (Antypov & Elliott 2011, EPL 94, 50004).
    """
    log = math.log(RESTITUTION)
    return {
        "left": -HALF, "right": HALF, "top": TOP, "depth": DEPTH,
        "cells_x": round(2 * HALF / CELL), "cells_y": round(TOP / CELL), "cells_z": round(DEPTH / CELL),
        "updraft": UPDRAFT, "fall": -GRAVITY, "air_density": AIR_DENSITY, "air_viscosity": AIR_VISCOSITY / AIR_DENSITY,
        "towards": SPEED, "away": -SPEED, "diameter": DIAMETER, "density": DENSITY, "restitution": RESTITUTION,
        "poisson": POISSON, "damping": -math.sqrt(5.0) * log / math.hypot(log, math.pi),
        "resolution": RESOLUTION, "step": STEP,
    }  # fmt: skip


def _landings(folder: Path, count: int) -> Array:
    """x (n,) of the granules on the floor, by their own order: that of the two injections."""
    x = np.full(count, np.nan)
    for path in folder.glob("postProcessing/lagrangian/kinematicCloud/landing/*/floor.post"):
        for line in path.read_text().splitlines():
            if line.strip() and not line.startswith("#"):
                row = line.replace("(", " ").replace(")", " ").split()
                x[int(row[ORIG_ID])] = float(row[PLACE])
    return x
