"""OpenFOAM's ``icoUncoupledKinematicParcelFoam`` on the same interpolant, with the same granules and laws.

The cloud is read from files of a started state instead of being injected: injection would happen within the first time
step and shift the granules in time.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError
from ..core.process import run_program
from ..foam.case import INSTALL, environment
from ..tracking import Granules
from .foam_interpolant import FoamInterpolant, vectors, write_file

__all__ = ["FINE_PARCELS", "ParcelRun", "fly_parcels", "start_up"]

Array = NDArray[np.float64]
PROGRAM = "icoUncoupledKinematicParcelFoam"
CLOUD = "kinematicCloud"
COLLISION_RECORDS = {
    "collisionRecordsPairAccessed": "label",
    "collisionRecordsPairOrigProcOfOther": "label",
    "collisionRecordsPairOrigIdOfOther": "label",
    "collisionRecordsPairData": "vector",
    "collisionRecordsWallAccessed": "label",
    "collisionRecordsWallPRel": "vector",
    "collisionRecordsWallData": "vector",
}
CLOUD_PROPERTIES = """solution
{
    active true; coupled false; transient yes; cellValueSourceCorrection off; maxCo %(courant)s;
    interpolationSchemes { rho cell; U cellPoint; mu cell; }
    integrationSchemes { U %(scheme)s; }
}
constantProperties { rho0 %(density)s; alphaMax 0.9; }
subModels
{
    particleForces { sphereDrag; gravity; }
    injectionModels {}
    dispersionModel none;
    patchInteractionModel localInteraction;
    localInteractionCoeffs
    {
        patches
        (
            "(outlet|inlet)" { type escape; }
            "(front|back)" { type none; }
            ".*" { type rebound; e %(restitution)s; mu %(friction)s; }
        );
    }
    stochasticCollisionModel none;
    surfaceFilmModel none;
    collisionModel none;
}
cloudFunctions
{
    landing { type patchPostProcessing; maxStoredParcels %(most)s; patches (outlet); }
}
"""
PLACE, ORIG_ID, AGE = 6, 15, 25  # columns of a landed parcel
# Settings (s, share of a cell) with landing errors of some 1e-4 body widths
FINE_PARCELS: dict[str, Any] = {"scheme": "analytical", "step": 1e-4, "courant": 0.3}


@dataclass(frozen=True)
class ParcelRun:
    """Where granules met the outlet: ``position`` (n, 2) m and ``time`` (n,) s, NaN for those that did not.

    ``seconds`` is processor time up to the end of the last step; that of :func:`start_up` is contained in it.
    """

    position: Array
    time: Array
    seconds: float


def _write_run(case: Path, grains: Granules, scheme: str, step: float, courant: float, until: float) -> None:
    interval = max(1, round(until / step))
    control = (
        f"application {PROGRAM};\nstartFrom startTime; startTime 0; stopAt endTime; endTime {until:.17g};\n"
        f"deltaT {step:.17g};\nwriteControl timeStep; writeInterval {interval};\nwriteFormat ascii;\n"
        "writePrecision 16; timePrecision 12; writeCompression off; runTimeModifiable no;\n"
    )
    write_file(case / "system" / "controlDict", "dictionary", control)
    words = {
        "courant": f"{courant:.17g}",
        "scheme": scheme,
        "density": f"{float(grains.density[0]):.17g}",
        "restitution": f"{float(grains.restitution[0]):.17g}",
        "friction": f"{float(grains.friction[0]):.17g}",
        "most": str(len(grains) + 1),
    }
    write_file(case / "constant" / "kinematicCloudProperties", "dictionary", CLOUD_PROPERTIES % words)


def _write_cloud(foam: FoamInterpolant, grains: Granules, case: Path) -> None:
    """Write the cloud as a solver that was stopped at time 0 would have left it."""
    count, folder = len(grains), case / "0" / "lagrangian" / CLOUD
    triangle = foam.field.locate(grains.position)
    if np.any(triangle < 0):
        raise FoamError(f"{int(np.sum(triangle < 0))} granules begin outside OpenFOAM's mesh")
    cell = foam.field.triangles[triangle, 2] - len(foam.mesh.plane.points)
    rows = zip(grains.position.tolist(), cell.tolist(), strict=True)
    places = "\n".join(f"({x:.17g} {y:.17g} {foam.middle:.17g}) {c}" for (x, y), c in rows)
    write_file(folder / "positions", "Cloud<basicKinematicCollidingParcel>", f"{count}\n(\n{places}\n)\n")
    write_file(folder / "U", "vectorField", vectors(grains.velocity) + "\n")
    write_file(folder / "origId", "labelField", f"{count}\n(\n" + "\n".join(map(str, range(count))) + "\n)\n")
    for name, values in (("d", grains.diameter), ("dTarget", grains.diameter), ("rho", grains.density)):
        write_file(folder / name, "scalarField", f"{count}\n(\n" + "\n".join(f"{v:.17g}" for v in values) + "\n)\n")
    for name, value in (("nParticle", 1), ("age", 0), ("tTurb", 0)):
        write_file(folder / name, "scalarField", f"{count}{{{value}}}\n")
    for name, value in (("active", 1), ("typeId", -1), ("origProcId", 0)):
        write_file(folder / name, "labelField", f"{count}{{{value}}}\n")
    for name in ("UTurb", "f", "angularMomentum", "torque"):
        write_file(folder / name, "vectorField", f"{count}{{(0 0 0)}}\n")
    for name, kind in COLLISION_RECORDS.items():  # OpenFOAM's parcels can collide; these have not
        write_file(folder / name, kind + "FieldField", f"{count}\n(\n" + "0()\n" * count + ")\n")
    write_file(folder.parents[1] / "uniform" / "lagrangian" / CLOUD / "cloudProperties", "dictionary",
           f"geometry positions;\nprocessor0 {{ particleCount {count}; }}\n")  # fmt: skip


def fly_parcels(
    foam: FoamInterpolant, grains: Granules, *, scheme: str, step: float, courant: float, until: float, folder: Path
) -> ParcelRun:
    """Fly ``grains`` (all of one density, restitution and friction) with OpenFOAM's tracker, from time 0 to ``until``
    (s).

    ``scheme``: Euler or analytical; ``step`` deltaT (s); ``courant`` its maxCo: the share of a cell, and of the step,
    that it tracks at a time; ``folder`` is made anew. Raises FoamError when OpenFOAM fails or a granule begins outside
    the mesh.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in ("constant", "system", "0"):
        shutil.copytree(foam.case / name, folder / name)
    _write_run(folder, grains, scheme, step, courant, until)
    _write_cloud(foam, grains, folder)
    log = folder / f"log.{PROGRAM}"
    run_program([PROGRAM], cwd=folder, log=log, env=environment(), error=FoamError, hint=INSTALL)
    clock = re.findall(r"^ExecutionTime = (\S+) s", log.read_text(), re.M)
    if not clock:
        raise FoamError(f"{PROGRAM} took no step; log: {log}", log=log)
    position, landing = _landings(folder, len(grains))
    return ParcelRun(position, landing, float(clock[-1]))


def start_up(foam: FoamInterpolant, grains: Granules, folder: Path) -> float:
    """Seconds that OpenFOAM's tracker needs to read its case and these granules: a run of one very short step."""
    return fly_parcels(foam, grains, scheme="Euler", step=1e-12, courant=0.3, until=1e-12, folder=folder).seconds


def _landings(folder: Path, count: int) -> tuple[Array, Array]:
    """Positions (n, 2) and times (n,) at the outlet from what patchPostProcessing wrote, by the granules' own order."""
    position, time = np.full((count, 2), np.nan), np.full(count, np.nan)
    for path in folder.glob(f"postProcessing/lagrangian/{CLOUD}/landing/*/outlet.post"):
        for line in path.read_text().splitlines():
            if line.strip() and not line.startswith("#"):
                row = line.replace("(", " ").replace(")", " ").split()
                which = int(row[ORIG_ID])
                position[which], time[which] = [float(x) for x in row[PLACE : PLACE + 2]], float(row[AGE])
    return position, time
