"""Layers of quads along the bodies, and the two-dimensional mesh as arrays with its one-layer extrusion.

Every wall cell edge carries a stack of quads. Where the outline turns by more than 35 degrees, the two stacks stand
apart and a structured *kite* of as many cells as there are layers fills the corner (two kites where it turns by more
than 100 degrees): no fan of slivers, no degenerate cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .outline import Piece, crosses_itself
from .sizing import Sizes, gap
from .spec import Array, MeshSpec

# -- The two-dimensional mesh as arrays, its cells in a good order, and the one-layer ``.msh`` file made ---------------
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


# -- Layers of quads along the bodies: structured, thin across the wall, joined to what Gmsh meshes --------------------
INSIDE = "inside"  # where layers and the mesh around them meet: no patch
# Chosen, so that no quad of layers or kites has an angle near 0 or 180 degrees:
SWELL = 1.3  # ratio of neighbouring layers' thickness
APART = math.radians(35)  # a corner that turns more gets kites
KITE = math.radians(100)  # the most that one kite turns by
OF_GAP = 0.25  # the largest share of a gap that the layers on one of its walls fill
GRAIN = 1e-9  # of the mesh's extent: points nearer to each other are one


@dataclass(frozen=True)
class WallLayers:
    """Points (n, 2) m and quads (q, 4) of the layers along one wall; ``outer``: the points on their far side, in the
    wall's order; ``edges`` (e, 2) on the wall and, where it is open, on the axis, with the ``patch`` of each.
    """

    points: Array
    quads: Indices
    outer: Indices
    edges: Indices
    patch: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether all quads are convex and none is turned over."""
        corner = self.points[self.quads]
        out, back = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
        return bool((out[..., 0] * back[..., 1] - out[..., 1] * back[..., 0] > 0).all())


def with_layers(spec: MeshSpec, rings: list[list[Piece]]) -> tuple[list[list[Piece]], list[WallLayers]]:
    """Rings that go round the layers instead of the bodies, and the layers: none where there is no room for them."""
    made: list[list[Piece]] = []
    found: list[WallLayers] = []
    for ring in rings:
        kept: list[Piece] = []
        for patch, members in groupby(ring, key=lambda piece: piece.patch):
            run = list(members)
            if not patch.startswith("body_"):
                kept += run
                continue
            closed = len(run) == len(ring)
            ends = [] if closed else [ring[(ring.index(run[-1]) + 1) % len(ring)].start]
            nodes = np.array([*(piece.start for piece in run), *ends])
            layers = _fitting(spec, spec.names.index(patch.removeprefix("body_")), nodes if closed else nodes[::-1])
            kept += run if layers is None else _around(layers, closed=closed)
            found += [] if layers is None else [layers]
        made.append(kept)
    return [_moved(ring, found) for ring in made], found


def _around(layers: WallLayers, *, closed: bool) -> list[Piece]:
    """Pieces along the far side of layers, the air on the same side as on the ring's other pieces."""
    outer = layers.points[layers.outer] if closed else layers.points[layers.outer[::-1]]
    return [Piece((x, y), INSIDE, whole=True) for x, y in (outer if closed else outer[:-1]).tolist()]


def _moved(ring: list[Piece], found: list[WallLayers]) -> list[Piece]:
    """The ring with axis pieces that start where layers end, not on the body below them."""
    feet = {tuple(layers.points[0].tolist()): tuple(layers.points[layers.outer[0]].tolist()) for layers in found}
    return [replace(p, start=feet.get(p.start, p.start)) if p.patch == "axis" else p for p in ring]


def _fitting(spec: MeshSpec, index: int, wall: Array) -> WallLayers | None:
    """Layers from the corner's cell edge up to the body's on one wall, the air on its right; None where there is no
    room: they may fill a quarter of a gap, and must neither fold nor run into each other.
    """
    share = spec.widths[index] / min(spec.widths)
    body, least = share * spec.h_body, share * min(spec.h_corner, spec.h_body)
    count = 2 + math.ceil(math.log(body / least) / math.log(SWELL) - 1e-9)
    heights = np.cumsum(np.minimum(least * SWELL ** np.arange(count), body))
    heights = heights[heights <= OF_GAP * gap(spec, index, wall).min()]
    if len(heights) < 2:
        return None
    closed = bool((wall[0] != wall[-1]).any() and not (wall[[0, -1], 0] == 0).all())
    layers = stack(wall, heights, f"body_{spec.names[index]}", closed=closed)
    return layers if layers.sound and not crosses_itself(layers.points[layers.outer]) else None


def stack(wall: Array, heights: Array, patch: str, *, closed: bool) -> WallLayers:
    """Layers on the nodes of a wall (k, 2) with the air on its right, at ``heights`` (l,) m above it, increasing.

    An open wall starts and ends on the axis x = 0, about which the air is symmetric: its end columns lie there.
    """
    builder = _Builder(np.concatenate([[0.0], heights]))
    bases = [builder.add(point) for point in wall]
    columns: list[list[list[int]]] = []
    outer: list[int] = []
    for i, base in enumerate(bases):
        rays = _columns(wall, i, closed=closed)
        made = builder.rays(wall[i], base, rays)
        for k in range(len(rays) - 1):
            outer += [made[k][-1], *builder.kite(wall[i], made[k], made[k + 1], rays[k], rays[k + 1])]
        outer.append(made[-1][-1])
        columns.append(made)
    following = columns[1:] + columns[:1] if closed else columns[1:]
    for one, other in zip(columns, following, strict=False):
        builder.between(one[-1], other[0])
    edges = [(a[0][0], b[0][0]) for a, b in zip(columns, following, strict=False)]
    names = [patch] * len(edges)
    if not closed:
        for column in (columns[0][0], columns[-1][-1]):
            edges += pairwise(column)
            names += ["axis"] * (len(column) - 1)
    return WallLayers(np.array(builder.points), np.array(builder.quads), np.array(outer), np.array(edges), tuple(names))


def sizes_around(sizes: Sizes, parts: Sequence[WallLayers]) -> Sizes:
    """Sizes that also ask for the layers' own edges along their far side."""
    points, edge = [sizes.points], [sizes.edge]
    for part in parts:
        outer = part.points[part.outer]
        length = np.linalg.norm(np.diff(outer, axis=0), axis=1)
        points.append(0.5 * (outer[1:] + outer[:-1]))
        edge.append(np.minimum(length, sizes.largest))
    return replace(sizes, points=np.concatenate(points), edge=np.concatenate(edge))


def joined(mesh: FlatMesh, parts: Sequence[WallLayers]) -> FlatMesh:
    """The mesh around the layers and the layers as one; equal points are one."""
    if not parts:
        return mesh
    offsets = np.cumsum([len(mesh.points), *(len(part.points) for part in parts)])
    points = np.concatenate([mesh.points, *(part.points for part in parts)])
    grain = GRAIN * float(np.ptp(points))
    _, first, number = np.unique(np.round(points / grain), axis=0, return_index=True, return_inverse=True)
    outside = np.array(mesh.names)[mesh.patch] != INSIDE
    named = [*np.array(mesh.names)[mesh.patch[outside]].tolist(), *(name for part in parts for name in part.patch)]
    names = tuple(sorted(set(named)))

    def gathered(own: Indices, each: Sequence[Indices]) -> Indices:
        moved = [cells + offset for cells, offset in zip(each, offsets[:-1], strict=True)]
        return np.asarray(number.reshape(-1)[np.concatenate([own, *moved])])

    return FlatMesh(
        points=points[first],
        triangles=number.reshape(-1)[mesh.triangles],
        quads=gathered(mesh.quads, [part.quads for part in parts]),
        edges=gathered(mesh.edges[outside], [part.edges for part in parts]),
        patch=np.array([names.index(name) for name in named], dtype=np.intp),
        names=names,
    )


def _columns(wall: Array, i: int, *, closed: bool) -> list[Array]:
    """Where the columns above node i point: unit vectors, or one longer vector between stacks that hardly turn."""
    count = len(wall)
    before, after = wall[i] - wall[i - 1], wall[(i + 1) % count] - wall[i]
    at_axis = not closed and i in (0, count - 1)
    if at_axis and i == 0:
        before = after * (1.0, -1.0)  # the last edge of the mirror image
    elif at_axis:
        after = before * (1.0, -1.0)
    one, other = (np.array([along[1], -along[0]]) / np.linalg.norm(along) for along in (before, after))
    turn = math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))
    if turn <= APART:
        return [_turned(one, turn / 2) / math.cos(turn / 2)]
    kites = math.ceil(turn / KITE)
    kites += at_axis and kites % 2  # a column on the axis
    rays = [_turned(one, turn * k / kites) for k in range(kites + 1)]
    if not at_axis:
        return rays
    return rays[kites // 2 :] if i == 0 else rays[: kites // 2 + 1]


def _turned(vector: Array, angle: float) -> Array:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])


class _Builder:
    """Collects points and quads."""

    def __init__(self, heights: Array) -> None:
        self.heights = heights  # (l + 1,) m, from 0
        self.points: list[Array] = []
        self.quads: list[tuple[int, int, int, int]] = []

    def add(self, point: Array) -> int:
        self.points.append(point)
        return len(self.points) - 1

    def rays(self, foot: Array, base: int, rays: list[Array]) -> list[list[int]]:
        """The columns of points above a wall node, each from the node ``base`` up."""
        return [[base, *(self.add(foot + height * ray) for height in self.heights[1:])] for ray in rays]

    def between(self, one: list[int], other: list[int]) -> None:
        """The stack of quads between two columns, the second further along the wall."""
        for k in range(len(one) - 1):
            self.quads.append((one[k], one[k + 1], other[k + 1], other[k]))

    def kite(self, foot: Array, one: list[int], other: list[int], ray: Array, next_ray: Array) -> list[int]:
        """The kite between two columns of one wall node; its far side's points from the first column's end to the
        second's, both left out.
        """
        turn = math.acos(float(np.clip(ray @ next_ray, -1, 1)))
        tip = foot + self.heights[-1] * (ray + next_ray) / (1 + math.cos(turn))
        share = self.heights / self.heights[-1]
        ends = foot + self.heights[-1] * ray, foot + self.heights[-1] * next_ray
        grid = np.empty((len(share), len(share)), dtype=np.intp)
        for j, a in enumerate(share):
            for k, b in enumerate(share):
                if j == 0 or k == 0:
                    grid[j, k] = one[j] if k == 0 else other[k]
                    continue
                place = (1 - a) * (1 - b) * foot + a * (1 - b) * ends[0] + (1 - a) * b * ends[1] + a * b * tip
                grid[j, k] = self.add(place)
        for j in range(len(share) - 1):
            for k in range(len(share) - 1):
                self.quads.append((grid[j, k], grid[j + 1, k], grid[j + 1, k + 1], grid[j, k + 1]))
        return [*grid[-1, 1:].tolist(), *grid[-2:0:-1, -1].tolist()]
