"""The two-dimensional mesh as arrays, its cells in a good order, and the one-layer ``.msh`` file made of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .spec import Array

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
        """The same mesh, quads with an angle above FLAT degrees cut into two triangles from that corner."""
        corner = self.points[self.quads]
        ahead, back = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
        turn = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
        angle = np.degrees(np.arctan2(turn, (ahead * back).sum(axis=2))) % 360
        flat = angle.max(axis=1) > FLAT
        order = (angle[flat].argmax(axis=1)[:, None] + np.arange(4)) % 4
        a, b, c, d = np.take_along_axis(self.quads[flat], order, axis=1).T
        triangles = np.concatenate([self.triangles, np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        return replace(self, triangles=triangles, quads=self.quads[~flat])

    def is_unfolded(self) -> bool:
        """Whether all cells turn the same way round: one that does not lies on top of others."""
        turns = []
        for cells in (self.triangles, self.quads):
            (x, y), (nx, ny) = self.points[cells].T, np.roll(self.points[cells], -1, axis=1).T
            turns.append((x * ny - nx * y).sum(axis=0))
        turn = np.concatenate(turns)
        return bool((turn > 0).all() or (turn < 0).all())

    def ordered(self) -> FlatMesh:
        """The same mesh, points and cells numbered so that neighbours stand near to each other.

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
