"""Gmsh's part: cells between the loops, in a good order, as a one-layer .msh file.

Runs only in a child process: Gmsh is global, not thread-safe.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import MeshError
from ...core.record import from_json
from .outline import Piece, loops
from .sizing import Sizes, boxes, levels, sources
from .spec import Array, MeshSpec, angles, double_area

Indices = NDArray[np.intp]
FLAT = 160.0  # degrees: a quad with a larger angle is cut in two. Chosen
LINE, TRIANGLE, QUAD, HEXAHEDRON, PRISM = 1, 2, 3, 5, 6  # MSH's numbers of element types


@dataclass(frozen=True)
class FlatMesh:
    """Points (n, 2) m, triangles (t, 3) and quads (q, 4) counter-clockwise, boundary edges (e, 2) with the number of
    their patch (e,) in ``names``.
    """

    points: Array
    triangles: Indices
    quads: Indices
    edges: Indices
    patch: Indices
    names: tuple[str, ...]

    def without_flat_quads(self) -> FlatMesh:
        """This mesh with quads that have an angle above FLAT degrees cut into two triangles from that corner."""
        angle = np.degrees(angles(self.points[self.quads])) % 360
        flat = angle.max(axis=1) > FLAT
        order = (angle[flat].argmax(axis=1)[:, None] + np.arange(4)) % 4
        a, b, c, d = np.take_along_axis(self.quads[flat], order, axis=1).T
        triangles = np.concatenate([self.triangles, np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        return replace(self, triangles=triangles, quads=self.quads[~flat])

    def is_unfolded(self) -> bool:
        """Whether all cells turn the same way round: one that does not lies on top of others."""
        turn = np.concatenate([double_area(self.points[cells]) for cells in (self.triangles, self.quads)])
        return bool((turn > 0).all() or (turn < 0).all())

    def ordered(self) -> FlatMesh:
        """This mesh with points and cells numbered so that neighbours stand near to each other.

        Reverse Cuthill-McKee on the points: OpenFOAM's solvers run through memory in this order, and its Gauss-Seidel
        smoothers sweep along it.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        count = len(self.points)
        pairs = np.concatenate(
            [
                np.stack([cells, np.roll(cells, 1, axis=1)], axis=2).reshape(-1, 2)
                for cells in (self.triangles, self.quads)
            ]
        )
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
        order = np.asarray(reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True), dtype=np.intp)
        number = np.empty(count, dtype=np.intp)
        number[order] = np.arange(count)

        def sorted_by_place(cells: Indices) -> Indices:
            renumbered = number[cells]
            return np.asarray(renumbered[np.argsort(renumbered.mean(axis=1), kind="stable")])

        return replace(
            self,
            points=self.points[order],
            triangles=sorted_by_place(self.triangles),
            quads=sorted_by_place(self.quads),
            edges=number[self.edges],
        )


def write_msh(mesh: FlatMesh, thickness: float, path: Path) -> None:
    """Write one layer of ``thickness`` (m) as MSH 2.2: volume ``air``, surfaces ``back`` (z = 0), ``front``, sides."""
    surfaces = ("back", "front", *mesh.names)
    count = len(mesh.points)
    points = np.column_stack([np.vstack([mesh.points, mesh.points]), np.repeat([0.0, thickness], count)])
    a, b = mesh.edges.T
    sides = np.column_stack([a, b, b + count, a + count])
    blocks: list[tuple[int, NDArray[np.intp], Indices]] = []
    for flat, solid, cells in ((TRIANGLE, PRISM, mesh.triangles), (QUAD, HEXAHEDRON, mesh.quads)):
        if len(cells):
            ones = np.ones(len(cells), dtype=np.intp)
            blocks.append((solid, (len(surfaces) + 1) * ones, np.hstack([cells, cells + count])))
            blocks += [(flat, ones, cells), (flat, 2 * ones, cells + count)]
    blocks.append((QUAD, mesh.patch + 3, sides))
    names = [f'2 {i + 1} "{name}"' for i, name in enumerate(surfaces)] + [f'3 {len(surfaces) + 1} "air"']
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(points))]
    lines += [f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(points.tolist(), 1)]
    lines += ["$EndNodes", "$Elements", str(sum(len(cells) for _, _, cells in blocks))]
    number = 0
    for kind, group, cells in blocks:
        for tag, cell in zip(group.tolist(), (cells + 1).tolist(), strict=True):
            number += 1
            lines.append(f"{number} {kind} 2 {tag} {tag} " + " ".join(map(str, cell)))
    path.write_text("\n".join([*lines, "$EndElements", ""]))


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
