"""OpenFOAM's own tracker on the interpolant and with the granules of the others.

OpenFOAM's ``cellPoint`` interpolation is linear between a cell's centre and its faces' points; in the middle plane of a
one-layer mesh that is piecewise linear on the fan of triangles about every cell's centre. The same values on the same
triangles make a FlowField, so that all trackers fly through exactly the same air and differ by no interpolation error.
``icoUncoupledKinematicParcelFoam`` reads its cloud from files of a started state: injection would happen within the
first time step and shift the granules in time.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofs.tracker.rk4 import Ends
from wakeflow.air.field import FlowField
from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.foam.polymesh import FoamMesh, read_polymesh
from wakeflow.air.foam.programs import call
from wakeflow.air.foam.reconstruction import PlaneMesh
from wakeflow.air.foam.start import prepare_case
from wakeflow.air.mesh import MeshSpec, build_mesh
from wakeflow.core.errors import FoamError
from wakeflow.core.record import JsonTable
from wakeflow.flight import Granules
from wakeflow.laws.constants import GRAVITY

Array = NDArray[np.float64]
HEADER = "FoamFile\n{{\n    version 2.0;\n    format ascii;\n    class {kind};\n    object {name};\n}}\n\n"


@dataclass(frozen=True)
class FoamInterpolant:
    """A case folder ready for OpenFOAM's tracker (U of a steady airflow in 0/), its interpolant, and the height of a
    granule.
    """

    case: Path
    field: FlowField
    middle: float  # m, z of the plane the granules fly in: the layer of cells is on z = 0
    mesh: FoamMesh


def make_foam_interpolant(field: FlowField, spec: MeshSpec, top: float, bottom: float, folder: Path) -> FoamInterpolant:
    """Mesh the channel between ``bottom`` and ``top`` (m) as ``spec`` says, and put ``field``'s velocity on it.

    The outlet is then the channel's floor. Raises MeshError and FoamError as meshing and OpenFOAM do.
    """
    whole = replace(spec, half=False, top=top, bottom=bottom)
    mesh_folder, case = folder / "mesh", folder / "case"
    build_mesh(whole, mesh_folder)
    flow = FlowSpec(whole, speed=1.0, density=field.density, viscosity=field.viscosity, turbulence="laminar")
    prepare_case(flow, mesh_folder / "mesh.msh", case)
    mesh = read_polymesh(case)
    plane = mesh.plane
    cells, faces = _sampled(field, plane)
    _write_case(case, field)
    _write_velocity(case / "0" / "U", mesh, cells, faces)
    height = mesh.thickness
    nodes = point_values(plane, height, cells, faces)
    return FoamInterpolant(case, interpolant(plane, cells, nodes, field), 0.5 * height, mesh)


def _sampled(field: FlowField, plane: PlaneMesh) -> tuple[Array, Array]:
    """Velocity at cell centres (m, 2) and boundary edges' middles (b, 2): no slip on bodies, along the sides."""
    cells = field.sample(plane.centres)[0]
    inward = plane.midpoints - 1e-7 * plane.lengths[:, None] * plane.normals
    faces = field.sample(inward)[0]
    for index, name in enumerate(plane.patches):
        on = plane.patch == index
        if name.startswith("body_"):
            faces[on] = 0.0
        elif name in ("left", "right"):
            faces[on] -= (faces[on] * plane.normals[on]).sum(axis=1, keepdims=True) * plane.normals[on]
    if not (np.isfinite(cells).all() and np.isfinite(faces).all()):
        raise FoamError("the airflow does not cover the channel: mesh it at least from the channel's bottom to its top")
    return cells, faces


def point_values(plane: PlaneMesh, height: float, cells: Array, faces: Array) -> Array:
    """Values at the points (n, 2) as OpenFOAM's volPointInterpolation makes them: weights 1 / distance.

    From the cells around an inner point, from the boundary faces around a boundary point; distances in space, from
    the layer's points (half a ``height`` above and below the centres).
    """
    count = len(plane.points)
    corner = np.concatenate([np.asarray(cell) for cell in plane.cells])
    owner = np.repeat(np.arange(len(plane.cells)), [len(cell) for cell in plane.cells])
    inner = _weighted(count, plane.points, corner, plane.centres[owner], cells[owner], height)
    ends = plane.faces.ravel()
    middle, value = np.repeat(plane.midpoints, 2, axis=0), np.repeat(faces, 2, axis=0)
    outer = _weighted(count, plane.points, ends, middle, value, height)
    on_boundary = np.zeros(count, dtype=bool)
    on_boundary[ends] = True
    return np.where(on_boundary[:, None], outer, inner)


def _weighted(count: int, points: Array, point: NDArray[np.intp], source: Array, value: Array, height: float) -> Array:
    away = points[point] - source
    weight = 1.0 / np.sqrt((away**2).sum(axis=1) + (0.5 * height) ** 2)
    total = np.bincount(point, weight, count)
    sums = np.stack([np.bincount(point, weight * value[:, i], count) for i in range(2)], axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(sums / total[:, None])


def interpolant(plane: PlaneMesh, cells: Array, nodes: Array, like: FlowField) -> FlowField:
    """The fan of triangles about every cell's centre, with values at centres and points."""
    triangles = []
    for index, cell in enumerate(plane.cells):
        ring = np.asarray(cell)
        centre = np.full(len(ring), len(plane.points) + index)
        triangles.append(np.stack([ring, np.roll(ring, -1), centre], axis=1))
    return FlowField.from_arrays(
        np.concatenate([plane.points, plane.centres]),
        np.concatenate(triangles),
        np.concatenate([nodes, cells]),
        density=like.density,
        viscosity=like.viscosity,
    )


def write_file(path: Path, kind: str, body: str) -> None:
    """An OpenFOAM file of a class ``kind``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(HEADER.format(kind=kind, name=path.name) + body)


def vectors(values: Array) -> str:
    """A list of vectors (n, 2) in the plane."""
    return f"{len(values)}\n(\n" + "\n".join(f"({x:.17g} {y:.17g} 0)" for x, y in values) + "\n)"


def _write_velocity(path: Path, mesh: FoamMesh, cells: Array, faces: Array) -> None:
    plane = mesh.plane
    entries = ["    front { type empty; }", "    back { type empty; }"]
    for index, name in enumerate(plane.patches):
        on = plane.patch == index
        values = np.empty((int(on.sum()), 2))
        values[mesh.slots[on]] = faces[on]
        entries.append(
            f"    {name}\n    {{\n    type fixedValue;\n    value nonuniform List<vector>\n{vectors(values)};\n    }}"
        )
    body = f"dimensions [0 1 -1 0 0 0 0];\ninternalField nonuniform List<vector>\n{vectors(cells)};\n"
    write_file(path, "volVectorField", body + "boundaryField\n{\n" + "\n".join(entries) + "\n}\n")


def _write_case(case: Path, field: FlowField) -> None:
    """What does not change between runs; the case that ``prepare`` wrote gives the mesh only."""
    for name in ("0", "system"):
        shutil.rmtree(case / name, ignore_errors=True)
    nu = field.viscosity / field.density
    transport = (
        f"transportModel Newtonian;\nnu [0 2 -1 0 0 0 0] {nu:.17g};\nrhoInf [1 -3 0 0 0 0 0] {field.density:.17g};\n"
    )
    write_file(case / "constant" / "transportProperties", "dictionary", transport)
    write_file(case / "constant" / "turbulenceProperties", "dictionary", "simulationType laminar;\n")
    write_gravity(case)
    schemes = {"ddt": "Euler", "grad": "Gauss linear", "div": "none", "laplacian": "none", "interpolation": "linear"}
    entries = "".join(f"{name}Schemes {{ default {value}; }}\n" for name, value in schemes.items())
    entries += "snGradSchemes { default none; }\n"
    write_file(case / "system" / "fvSchemes", "dictionary", entries)
    write_file(case / "system" / "fvSolution", "dictionary", "\n")


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
    dispersionModel %(dispersion)s;
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
FINE_PARCELS: JsonTable = {"scheme": "analytical", "step": 1e-4, "courant": 0.3}


def _write_run(case: Path, grains: Granules, scheme: str, step: float, courant: float, until: float) -> None:
    interval = max(1, round(until / step))
    control = (
        f"application {PROGRAM};\nstartFrom startTime; startTime 0; stopAt endTime; endTime {until:.17g};\n"
        f"deltaT {step:.17g};\nwriteControl timeStep; writeInterval {interval};\nwriteFormat ascii;\n"
        "writePrecision 16; timePrecision 12; writeCompression off; runTimeModifiable no;\n"
    )
    write_file(case / "system" / "controlDict", "dictionary", control)
    write_properties(case, grains, scheme, courant)


def write_gravity(case: Path) -> None:
    """Write the field of gravity, downwards."""
    text = f"dimensions [0 1 -2 0 0 0 0];\nvalue (0 {-GRAVITY} 0);\n"
    write_file(case / "constant" / "g", "uniformDimensionedVectorField", text)


def write_properties(case: Path, grains: Granules, scheme: str, courant: float, dispersion: str = "none") -> None:
    """Write what OpenFOAM's cloud of these granules feels: ``dispersion`` is its model of eddies."""
    words = {
        "courant": f"{courant:.17g}",
        "scheme": scheme,
        "density": f"{float(grains.density[0]):.17g}",
        "restitution": f"{float(grains.restitution[0]):.17g}",
        "friction": f"{float(grains.friction[0]):.17g}",
        "most": str(len(grains) + 1),
        "dispersion": dispersion,
    }
    write_file(case / "constant" / f"{CLOUD}Properties", "dictionary", CLOUD_PROPERTIES % words)


def write_cloud(foam: FoamInterpolant, grains: Granules, state: Path) -> None:
    """Write the cloud into the time folder ``state``, as a solver that was stopped there would have left it."""
    count, folder = len(grains), state / "lagrangian" / CLOUD
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
    write_file(state / "uniform" / "lagrangian" / CLOUD / "cloudProperties", "dictionary",
           f"geometry positions;\nprocessor0 {{ particleCount {count}; }}\n")  # fmt: skip


def fly_parcels(
    foam: FoamInterpolant, grains: Granules, *, scheme: str, step: float, courant: float, until: float, folder: Path
) -> tuple[Ends, float]:
    """Where ``grains`` (all of one density, restitution and friction), flown by OpenFOAM's tracker from time 0 to
    ``until`` (s), met the outlet, NaN for those that did not; and its processor time (s) up to the end of the last
    step, which contains that of :func:`start_up`.

    ``scheme``: Euler or analytical; ``step`` deltaT (s); ``courant`` its maxCo: the share of a cell, and of the step,
    that it tracks at a time; ``folder`` is made anew. Raises FoamError when OpenFOAM fails or a granule begins outside
    the mesh.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in ("constant", "system", "0"):
        shutil.copytree(foam.case / name, folder / name)
    _write_run(folder, grains, scheme, step, courant, until)
    write_cloud(foam, grains, folder / "0")
    log = call(folder, [PROGRAM]).log
    clock = re.findall(r"^ExecutionTime = (\S+) s", log.read_text(), re.M)
    if not clock:
        raise FoamError(f"{PROGRAM} took no step; log: {log}", log=log)
    position, landing = _landings(folder, len(grains))
    return Ends(position, landing, np.isfinite(landing), None), float(clock[-1])


def start_up(foam: FoamInterpolant, grains: Granules, folder: Path) -> float:
    """Seconds that OpenFOAM's tracker needs to read its case and these granules: a run of one very short step."""
    return fly_parcels(foam, grains, scheme="Euler", step=1e-12, courant=0.3, until=1e-12, folder=folder)[1]


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
