"""From a one-layer case to one with a periodic span: the mesh, its patches, and which cell stands over which."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError, MeshError, known
from ..core.files import atomic_write
from ..core.process import tail
from .case import FlowSpec, axis_points, write_case, write_parameters
from .case_fields import CaseFields
from .programs import call
from .span_record import LAYERS

__all__ = ["extrude", "layer_map", "make_periodic"]

Array = NDArray[np.float64]
BASE_POINTS = 8  # places along the span at which the base pressure is recorded
OFF = 1e-6  # body widths by which a cell may miss the plane cell it was extruded from: round-off


def extrude(spec: FlowSpec, plane: Path, folder: Path) -> None:
    """Write the case ``folder`` with the span of ``spec``: the mesh of the one-layer case ``plane``, extruded.

    ``layers.npz`` beside it (in ``plane``) holds the plane cell ``at`` (n,) and the height ``z`` (n,) m of each cell.
    Raises MeshError for a mesh that checkMesh refuses, FoamError where a program fails.
    """
    shutil.rmtree(folder, ignore_errors=True)
    write_case(spec, folder)
    shutil.copytree(plane / "constant" / "polyMesh", folder / "constant" / "polyMesh", dirs_exist_ok=True)
    write_parameters(folder, span_parameters(spec))
    call(folder, ["extrudeMesh"])
    make_periodic(folder / "constant" / "polyMesh" / "boundary", _depth(spec))
    call(folder, ["checkMesh"])
    log = folder / "log.checkMesh"
    if "Mesh OK" not in log.read_text():
        raise MeshError(f"OpenFOAM refuses the extruded mesh; log: {log}", command="checkMesh", log=log, tail=tail(log))
    call(folder, ["postProcess", "-func", "writeCellCentres", "-time", "0"])
    centres = np.column_stack([_scalar(folder / "0" / name) for name in ("Cx", "Cy", "Cz")])
    for name in ("C", "Cx", "Cy", "Cz"):
        (folder / "0" / name).unlink(missing_ok=True)
    at = layer_map(centres, CaseFields(plane).mesh.plane.centres, spec.mesh.projected_width)
    with atomic_write(plane / LAYERS, "wb") as stream:
        np.savez(stream, at=at, z=centres[:, 2])


def _depth(spec: FlowSpec) -> float:
    """Of the span (m)."""
    return known(spec.span).depth * spec.mesh.projected_width


def span_parameters(spec: FlowSpec) -> dict[str, str | float | int]:
    """What system/parameters of a case with a span has otherwise than that of one layer.

    The span begins where the layer ended. Its coefficients are those of the whole depth; the base pressure is recorded
    at places along it.
    """
    depth, low = _depth(spec), spec.mesh.thickness
    middle, _, rear = axis_points(spec)
    heights = low + depth * (np.arange(BASE_POINTS) + 0.5) / BASE_POINTS
    return {
        "layer": "cyclic",
        "layers": known(spec.span).layers,
        "spanDepth": depth,
        "bodyArea": spec.mesh.projected_width * depth,
        "basePoint": " ".join(f"({middle:.9g} {spec.along * rear:.9g} {z:.9g})" for z in heights),
    }


def make_periodic(boundary: Path, depth: float) -> None:
    """Turn the patches front and back of constant/polyMesh/boundary into a pair, ``depth`` (m) apart along z.

    Raises FoamError where one of them is not there.
    """
    text = boundary.read_text()
    for name, other, shift in (("front", "back", -depth), ("back", "front", depth)):
        entries = (
            f"type            cyclic;\n        neighbourPatch  {other};\n        matchTolerance  1e-4;\n"
            f"        transform       translational;\n        separationVector (0 0 {shift:.12g});\n"
        )
        pattern = rf"(^\s*{name}\s*\{{\s*)type\s+\w+;\s*(?:inGroups[^;]*;\s*)?"
        text, count = re.subn(pattern, rf"\g<1>{entries}        ", text, count=1, flags=re.M)
        if count != 1:
            raise FoamError(f"{boundary} has no patch {name}: extrudeMesh did not make a span")
    with atomic_write(boundary) as stream:
        stream.write(text)


def layer_map(centres: Array, plane: Array, width: float) -> NDArray[np.intp]:
    """The plane cell (n,) that each cell stands over, from the ``centres`` (n, 3) and those of the ``plane`` (m, 2).

    extrudeMesh does not keep the order of the cells. Raises FoamError for a cell over none.
    """
    from scipy.spatial import cKDTree

    distance, at = cKDTree(plane).query(centres[:, :2])
    worst = float(np.max(distance))
    if worst > OFF * width:
        raise FoamError(f"an extruded cell lies {worst:.3g} m beside the cell it was made from: remove the case")
    return np.asarray(at, dtype=np.intp)


def _scalar(path: Path) -> Array:
    from foamlib import FoamFieldFile

    return np.asarray(FoamFieldFile(path).internal_field, dtype=float)
