"""One interpolant for all trackers: OpenFOAM's own, on the mesh of a case, as a FlowField.

OpenFOAM's ``cellPoint`` interpolation is linear between a cell's centre and its faces' points; in the middle plane of a
one-layer mesh that is piecewise linear on the fan of triangles about every cell's centre. The same values on the same
triangles make a FlowField, so that all trackers fly through exactly the same air and differ by no interpolation error.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError
from ..field import FlowField
from ..foam.case import FlowSpec
from ..foam.polymesh import FoamMesh, read_polymesh
from ..foam.prepare import prepare_case
from ..foam.reconstruction import PlaneMesh
from ..meshing import MeshSpec, build_mesh

__all__ = ["FoamInterpolant", "make_foam_interpolant", "vectors", "write_file"]

Array = NDArray[np.float64]
HEADER = "FoamFile\n{{\n    version 2.0;\n    format ascii;\n    class {kind};\n    object {name};\n}}\n\n"


@dataclass(frozen=True)
class FoamInterpolant:
    """A case folder ready for OpenFOAM's tracker (U of a steady airflow in 0/), its interpolant, and the height of a
    granule.
    """

    case: Path
    field: FlowField
    middle: float  # m, z of the plane the granules fly in: the layer of cells stands on z = 0
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
    write_file(
        case / "constant" / "g", "uniformDimensionedVectorField", "dimensions [0 1 -2 0 0 0 0];\nvalue (0 -9.81 0);\n"
    )
    schemes = {"ddt": "Euler", "grad": "Gauss linear", "div": "none", "laplacian": "none", "interpolation": "linear"}
    entries = "".join(f"{name}Schemes {{ default {value}; }}\n" for name, value in schemes.items())
    entries += "snGradSchemes { default none; }\n"
    write_file(case / "system" / "fvSchemes", "dictionary", entries)
    write_file(case / "system" / "fvSolution", "dictionary", "\n")
