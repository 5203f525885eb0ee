"""The Gmsh model of a mesh spec: runs only in a child process, for Gmsh is global and not thread-safe."""

from __future__ import annotations

from typing import Any

from ..errors import MeshError
from .outline import Piece, loops
from .spec import MeshSpec
from .zones import Sizes, boxes, levels, sources

__all__ = ["mesh_in_this_process"]


def mesh_in_this_process(argument: dict[str, Any]) -> None:
    """Mesh ``argument['spec']`` into the file ``argument['path']``; MeshError says what Gmsh stumbled over."""
    import gmsh

    spec = MeshSpec.from_json(argument["spec"])
    gmsh.initialize(argv=["gmsh"], readConfigFiles=False, interruptible=False)
    try:
        for option, value in _options(spec).items():
            gmsh.option.setNumber(option, value)
        sizes = sources(spec)
        _model(gmsh, spec, loops(spec, sizes.at))
        _set_sizes(gmsh, spec, sizes)
        gmsh.model.mesh.generate(3)
        gmsh.write(argument["path"])
    except MeshError:
        raise
    except Exception as problem:  # Gmsh raises bare Exception; its own words say what it stumbled over
        raise MeshError(f"Gmsh could not mesh the channel: {problem}") from None
    finally:
        gmsh.finalize()


def _options(spec: MeshSpec) -> dict[str, float]:
    quad = spec.strategy != "triangles"
    return {
        "General.NumThreads": 1,  # more threads would make the numbering depend on their timing
        "Mesh.MshFileVersion": 2.2,
        "Mesh.Binary": 0,
        "Mesh.Algorithm": 8 if quad else 6,  # frontal-Delaunay, for quads or for triangles
        "Mesh.RecombineAll": int(quad),
        "Mesh.RecombinationAlgorithm": 1,  # blossom
        "Mesh.Smoothing": 10 if quad else 3,
        "Mesh.MeshSizeExtendFromBoundary": 0,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.MeshSizeFromCurvature": 0,
        "Mesh.RandomSeed": 1,
    }


def _model(gmsh: Any, spec: MeshSpec, rings: list[list[Piece]]) -> None:
    """The channel as one plane surface, extruded by one layer, with a physical group a patch."""
    geo = gmsh.model.geo
    lines: list[tuple[int, Piece]] = []
    ring_tags = []
    for ring in rings:
        points = [geo.addPoint(*piece.start, 0.0) for piece in ring]
        tags = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
        lines += zip(tags, ring, strict=True)
        ring_tags.append(geo.addCurveLoop(tags))
    surface = geo.addPlaneSurface(ring_tags)
    for tag, piece in lines:
        if piece.cells:
            geo.mesh.setTransfiniteCurve(tag, piece.cells + 1)
    made = geo.extrude([(2, surface)], 0, 0, spec.thickness, numElements=[1], recombine=True)
    geo.synchronize()
    groups: dict[str, list[int]] = {"back": [surface], "front": [made[0][1]]}
    for (_, piece), (_, side) in zip(lines, made[2:], strict=True):
        groups.setdefault(piece.patch, []).append(side)
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.addPhysicalGroup(3, [made[1][1]], name="air")


def _set_sizes(gmsh: Any, spec: MeshSpec, sizes: Sizes) -> None:
    """Give Gmsh the cell edge everywhere: the least of the points' levels and the boxes."""
    fields = gmsh.model.mesh.field
    parts = []
    for near, points in levels(sizes):
        tags = [gmsh.model.geo.addPoint(x, y, 0.0) for x, y in points.tolist()]
        distance = fields.add("Distance")
        fields.setNumbers(distance, "PointsList", tags)
        numbers = {"InField": distance, "SizeMin": near, "SizeMax": spec.h_far, "DistMin": 0.0}
        parts.append(_field(fields, "Threshold", {**numbers, "DistMax": _reach(spec, near)}))
    for box in boxes(spec):
        numbers = {"VIn": box.edge, "VOut": spec.h_far, "XMin": box.left, "XMax": box.right, "YMin": box.low}
        numbers |= {"YMax": box.high, "ZMin": -1.0, "ZMax": 1.0, "Thickness": _reach(spec, box.edge)}
        parts.append(_field(fields, "Box", numbers))
    gmsh.model.geo.synchronize()
    least = fields.add("Min")
    fields.setNumbers(least, "FieldsList", parts)
    fields.setAsBackgroundMesh(least)


def _reach(spec: MeshSpec, near: float) -> float:
    """How far (m) cells grow from the edge ``near`` to the far one."""
    return max((spec.h_far - near) / spec.growth, 1e-9)


def _field(fields: Any, kind: str, numbers: dict[str, float]) -> int:
    tag = fields.add(kind)
    for name, value in numbers.items():
        fields.setNumber(tag, name, value)
    return int(tag)
