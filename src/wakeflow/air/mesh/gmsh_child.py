"""Gmsh's part: triangles or quads between the loops. Runs only in a child process: Gmsh is global, not thread-safe."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import MeshError
from ...core.record import from_json
from .flat_mesh import LINE, QUAD, TRIANGLE, FlatMesh, write_msh
from .outline import Piece, loops
from .sizing import Sizes, boxes, levels, sources
from .spec import MeshSpec

# Factors on all cell edges, tried in turn: now and then Gmsh 4.15 folds a cell over. Chosen: no grid study sees them.
NUDGES = (1.0, 0.97, 1.03, 0.94, 1.06)


def mesh_in_this_process(argument: dict[str, Any]) -> None:
    """Mesh ``argument['spec']`` into the file ``argument['path']``; MeshError says what Gmsh stumbled over."""
    spec = from_json(MeshSpec, argument["spec"], "mesh")
    meshes = (_mesh(spec.scaled(nudge)) for nudge in NUDGES)
    mesh = next((mesh for mesh in meshes if mesh.is_unfolded()), None)
    if mesh is None:
        raise MeshError("Gmsh folds a cell over at a sharp corner, at every size tried: round the corner a little")
    write_msh(mesh.ordered(), spec.thickness, Path(argument["path"]))


def _mesh(spec: MeshSpec) -> FlatMesh:
    """The whole mesh, no quad flat."""
    import gmsh

    sizes = sources(spec)
    rings = loops(spec, sizes.at)
    gmsh.initialize(argv=["gmsh"], readConfigFiles=False, interruptible=False)
    try:
        for option, value in _options(spec).items():
            gmsh.option.setNumber(option, value)
        surface, lines = _model(gmsh, rings)
        _set_sizes(gmsh, spec, sizes)
        gmsh.model.mesh.generate(2)
        mesh = _read(gmsh, surface, lines)
    except Exception as problem:  # Gmsh raises bare Exception; its own words say what it stumbled over
        raise MeshError(f"Gmsh could not mesh the channel: {problem}") from None
    finally:
        gmsh.finalize()
    return mesh.without_flat_quads()


def _options(spec: MeshSpec) -> dict[str, float]:
    quad = spec.strategy != "triangles"
    return {
        "General.NumThreads": 1,  # more threads would make the numbering depend on their timing
        "Mesh.Algorithm": 8 if quad else 6,  # frontal-Delaunay, for quads or for triangles
        "Mesh.RecombineAll": int(quad),
        "Mesh.RecombinationAlgorithm": 1,  # blossom
        "Mesh.Smoothing": 10 if quad else 3,
        "Mesh.MeshSizeExtendFromBoundary": 0,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.MeshSizeFromCurvature": 0,
        "Mesh.RandomSeed": 1,
    }


def _model(gmsh: Any, rings: list[list[Piece]]) -> tuple[int, list[tuple[int, str]]]:
    """One plane surface between the rings; its tag, and tag and patch of every line."""
    geo = gmsh.model.geo
    lines: list[tuple[int, str]] = []
    ring_tags = []
    for ring in rings:
        points = [geo.addPoint(*piece.start, 0.0) for piece in ring]
        tags = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
        for tag, piece in zip(tags, ring, strict=True):
            lines.append((tag, piece.patch))
            if piece.whole:
                geo.mesh.setTransfiniteCurve(tag, 2)
        ring_tags.append(geo.addCurveLoop(tags))
    surface = geo.addPlaneSurface(ring_tags)
    geo.synchronize()
    return int(surface), lines


def _read(gmsh: Any, surface: int, lines: list[tuple[int, str]]) -> FlatMesh:
    """Gmsh's mesh as arrays: only points that cells use."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    index = np.zeros(int(tags.max()) + 1, dtype=np.intp)
    index[tags] = np.arange(len(tags))

    def elements(tag: int, kind: int, corners: int) -> NDArray[np.intp]:
        nodes = gmsh.model.mesh.getElementsByType(kind, tag)[1]
        return np.asarray(index[nodes].reshape(-1, corners))

    triangles, quads = elements(surface, TRIANGLE, 3), elements(surface, QUAD, 4)
    edges = [elements(tag, LINE, 2) for tag, _ in lines]
    names = tuple(sorted({name for _, name in lines}))
    patch = np.repeat([names.index(name) for _, name in lines], [len(part) for part in edges])
    used = np.unique(np.concatenate([triangles.ravel(), quads.ravel()]))
    number = np.full(len(tags), -1, dtype=np.intp)
    number[used] = np.arange(len(used))
    points = places.reshape(-1, 3)[used, :2]
    return FlatMesh(points, number[triangles], number[quads], number[np.concatenate(edges)], patch, names)


def _set_sizes(gmsh: Any, spec: MeshSpec, sizes: Sizes) -> None:
    """Give Gmsh the cell edge everywhere: the least of the points' levels and the boxes."""
    fields = gmsh.model.mesh.field
    parts = []
    for near, points in levels(sizes):
        tags = [gmsh.model.geo.addPoint(x, y, 0.0) for x, y in points.tolist()]
        distance = fields.add("Distance")
        fields.setNumbers(distance, "PointsList", tags)
        numbers = {"InField": distance, "SizeMin": near, "SizeMax": spec.h_most, "DistMin": 0.0}
        parts.append(_field(fields, "Threshold", {**numbers, "DistMax": _reach(spec, near)}))
    for box in boxes(spec):
        numbers = {"VIn": box.edge, "VOut": spec.h_most, "XMin": box.left, "XMax": box.right, "YMin": box.low}
        numbers |= {"YMax": box.high, "ZMin": -1.0, "ZMax": 1.0, "Thickness": _reach(spec, box.edge)}
        parts.append(_field(fields, "Box", numbers))
    gmsh.model.geo.synchronize()
    least = fields.add("Min")
    fields.setNumbers(least, "FieldsList", parts)
    fields.setAsBackgroundMesh(least)


def _reach(spec: MeshSpec, near: float) -> float:
    """How far (m) cells grow from the edge ``near`` to the far one."""
    return max((spec.h_most - near) / spec.growth, 1e-9)


def _field(fields: Any, kind: str, numbers: dict[str, float]) -> int:
    tag = fields.add(kind)
    for name, value in numbers.items():
        fields.setNumber(tag, name, value)
    return int(tag)
