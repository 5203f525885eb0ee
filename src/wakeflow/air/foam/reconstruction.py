"""Node values from cell values, second order up to the walls.

A node's value is that of a weighted linear least-squares fit through the cells around it and, where the caller says so,
through values known on boundary faces: exact for linear fields everywhere, corners included. The weights depend on the
mesh alone, so one sparse matrix serves all fields and all times.

Air enters and leaves a layer of a three-dimensional airflow along the span. Granules that stay in it would be gathered
where it leaves and spread where it enters, as no granule of the real airflow is. So the gradient of a potential is
taken off: u' = u - grad phi with div u' = 0, the least change that does it (Helmholtz' decomposition). The velocity
through inlets and walls stays; what the layer loses on the way no longer leaves through the outlet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import area
from ..mesh.spec import angles

if TYPE_CHECKING:
    from scipy.sparse import csr_array


Array = NDArray[np.float64]
Index = NDArray[np.intp]
WORST = 1e-3  # least singular value over the largest of a node's scaled fit; below it the stencil grows by one ring
MIN_FIT_POINTS = 4  # data points in a linear fit: one more than it needs
SLENDER = 0.1  # least singular value over the largest of a scaled stencil below which a ring is added. Chosen
RINGS = 4  # most rings that a stencil grows by. Chosen
NEAREST = 1e-6  # of a stencil's size: data nearer to the node weigh as if they were so far off, for 1/distance to exist


@dataclass(frozen=True)
class PlaneMesh:
    """A two-dimensional mesh of polygons and its boundary.

    ``points`` (n, 2) m; ``cells`` m anticlockwise tuples of point numbers; ``centres`` (m, 2) m; ``faces`` (b, 2) end
    points of every boundary edge, ``owner`` (b,) its cell, ``patch`` (b,) the index of its patch in ``patches``.
    """

    points: Array
    cells: Sequence[NDArray[np.int64]]
    centres: Array
    faces: Index
    owner: Index
    patch: Index
    patches: tuple[str, ...]

    @property
    def midpoints(self) -> Array:
        """Middle of every boundary edge, (b, 2) m."""
        return np.asarray(self.points[self.faces].mean(axis=1))

    @property
    def lengths(self) -> Array:
        """Length of every boundary edge, (b,) m."""
        return np.asarray(np.linalg.norm(self.points[self.faces[:, 1]] - self.points[self.faces[:, 0]], axis=1))

    @property
    def normals(self) -> Array:
        """Unit normal of every boundary edge, out of the air, (b, 2)."""
        along = self.points[self.faces[:, 1]] - self.points[self.faces[:, 0]]
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / self.lengths[:, None]
        inward = ((self.midpoints - self.centres[self.owner]) * normal).sum(axis=1) < 0
        return np.where(inward[:, None], -normal, normal)

    @property
    def areas(self) -> Array:
        """Area of every cell, (m,) m2."""
        return np.array([area(self.points[cell] - self.points[cell[0]]) for cell in self.cells])

    def on(self, *names: str) -> NDArray[np.bool_]:
        """Which boundary edges belong to the named patches."""
        return np.isin(self.patch, [i for i, name in enumerate(self.patches) if name in names])


def triangulate(points: Array, cells: Sequence[NDArray[np.int64]]) -> Index:
    """Triangles (t, 3) of polygons, of all ways to cut each the one with the largest least angle: corners in the middle
    of a side, as next to a finer cell, get a triangle with an area.
    """
    pieces = []
    sizes = np.array([len(cell) for cell in cells])
    for size in np.unique(sizes):
        block = np.array([cell for cell in cells if len(cell) == size], dtype=np.intp)
        if size == 4:
            pieces.append(_split_quads(points, block))
        elif size == 3:
            pieces.append(block)
        else:
            pieces.append(np.array([corners for polygon in block for corners in _cut(points, polygon)], dtype=np.intp))
    return np.ascontiguousarray(np.vstack(pieces))


def _cut(points: Array, polygon: Index) -> list[Index]:
    """The triangles of one polygon, of the cut with the largest least angle (Klincsek, G.T. 1980, Ann. Discrete Math.
    9, 121)."""
    size = len(polygon)
    best: dict[tuple[int, int], tuple[float, int]] = {(i, i + 1): (np.inf, i) for i in range(size - 1)}
    for gap in range(2, size):
        for low in range(size - gap):
            high, inside = low + gap, np.arange(low + 1, low + gap)
            corners = np.stack([np.full(gap - 1, low), inside, np.full(gap - 1, high)], axis=1)
            least = angles(points[polygon[corners]]).min(axis=1).tolist()
            cuts = zip(least, inside.tolist(), strict=True)
            best[low, high] = max((min(angle, best[low, m][0], best[m, high][0]), m) for angle, m in cuts)
    result, waiting = [], [(0, size - 1)]
    while waiting:
        low, high = waiting.pop()
        if high - low > 1:
            middle = best[low, high][1]
            result.append(polygon[[low, middle, high]])
            waiting += [(low, middle), (middle, high)]
    return result


def _split_quads(points: Array, quads: Index) -> Index:
    ways = [((0, 1, 2), (0, 2, 3)), ((1, 2, 3), (1, 3, 0))]
    least = [np.minimum(*(angles(points[quads[:, corners]]).min(axis=1) for corners in way)) for way in ways]
    first = (least[0] >= least[1])[:, None]
    return np.vstack([np.where(first, quads[:, ways[0][i]], quads[:, ways[1][i]]) for i in (0, 1)])


@dataclass(frozen=True)
class Reconstruction:
    """Node values on one mesh. ``wall`` and ``slip`` (b,) mark boundary edges with the air at rest relative to the
    wall, and edges that it slides along (slip walls, symmetry)."""

    mesh: PlaneMesh
    wall: NDArray[np.bool_]
    slip: NDArray[np.bool_]

    def operator(self, known: NDArray[np.bool_]) -> csr_array:
        """Matrix (n, m + b) from cell values followed by boundary-edge values to node values.

        Only the edges marked in ``known`` (b,) enter. Second order on any mesh; a linear field is met to round-off.
        """
        from scipy.sparse import csr_array

        mesh = self.mesh
        data = np.vstack([mesh.centres, mesh.midpoints])
        stencils = _stencils(mesh, known)
        rows, columns, weights = _fit(mesh.points, data, stencils)
        return csr_array((weights, (rows, columns)), shape=(len(mesh.points), len(data)))

    def scalar(self, cells: Array, faces: Array, known: NDArray[np.bool_], *, bounded: bool = False) -> Array:
        """Node values (..., n) of a scalar with cell values (..., m) and boundary-edge values (..., b) used where
        ``known``.

        ``bounded`` keeps each node within the range of its data, for quantities such as k that must stay positive.
        """
        operator = self.operator(known)
        nodes = _apply(operator, cells, faces)
        return _clip(operator, cells, faces, nodes) if bounded else nodes

    def vector(self, cells: Array, faces: Array, known: NDArray[np.bool_]) -> Array:
        """Node values (..., n, 2) of the velocity from cell values (..., m, 2) and boundary-edge values (..., b, 2).

        On walls the nodes take the wall's own velocity exactly (the mean of the adjacent edges, weighted by inverse
        length); on slip walls and symmetry lines the normal component is removed.
        """
        operator = self.operator(known & ~self.wall)
        nodes = np.stack([_apply(operator, cells[..., i], faces[..., i]) for i in (0, 1)], axis=-1)
        for normal, members in self._slip_nodes():
            across = nodes[..., members, :] @ normal
            nodes[..., members, :] -= across[..., None] * normal
        share = self._wall_shares()
        on_wall = np.flatnonzero(np.diff(share.indptr))
        for i in (0, 1):
            moving = _times(share, faces[..., i])
            nodes[..., on_wall, i] = moving[..., on_wall]
        return nodes

    def _slip_nodes(self) -> list[tuple[Array, Index]]:
        """Normals of the slip lines with the nodes on each."""
        chosen = np.flatnonzero(self.slip)
        normals = np.round(self.mesh.normals[chosen], 9)
        lines, which = np.unique(normals, axis=0, return_inverse=True)
        return [(line, np.unique(self.mesh.faces[chosen[which.ravel() == i]])) for i, line in enumerate(lines)]

    def _wall_shares(self) -> csr_array:
        """Matrix (n, b): the velocity of a wall node from the wall edges that meet there."""
        from scipy.sparse import csr_array

        chosen = np.flatnonzero(self.wall)
        ends = self.mesh.faces[chosen]
        weight = np.repeat(1 / self.mesh.lengths[chosen], 2)
        total = np.bincount(ends.ravel(), weight, minlength=len(self.mesh.points))
        shape = (len(self.mesh.points), len(self.mesh.faces))
        return csr_array((weight / total[ends.ravel()], (ends.ravel(), np.repeat(chosen, 2))), shape=shape)


def _times(matrix: csr_array, values: Array) -> Array:
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray((matrix @ flat.T).T).reshape(*values.shape[:-1], matrix.shape[0])


def _apply(operator: csr_array, cells: Array, faces: Array) -> Array:
    return _times(operator, np.concatenate([cells, faces], axis=-1))


def _clip(operator: csr_array, cells: Array, faces: Array, nodes: Array) -> Array:
    data = np.concatenate([cells, faces], axis=-1)
    starts = operator.indptr[:-1]
    around = data[..., operator.indices]
    low, high = np.minimum.reduceat(around, starts, axis=-1), np.maximum.reduceat(around, starts, axis=-1)
    return np.clip(nodes, low, high)


def _stencils(mesh: PlaneMesh, known: NDArray[np.bool_]) -> csr_array:
    """Boolean matrix (n, m + b): data points in the fit of every node; rings are added where a fit would be
    ill-posed.
    """
    from scipy.sparse import csr_array, hstack

    sizes = np.array([len(cell) for cell in mesh.cells])
    nodes = np.concatenate(mesh.cells).astype(np.intp)
    cells = np.repeat(np.arange(len(sizes)), sizes)
    touches = csr_array((np.ones(len(nodes)), (nodes, cells)), shape=(len(mesh.points), len(sizes)))
    chosen = np.flatnonzero(known)
    ends = mesh.faces[chosen]
    shape = (len(mesh.points), len(mesh.faces))
    edges = csr_array((np.ones(ends.size), (ends.ravel(), np.repeat(chosen, 2))), shape=shape)
    first = csr_array(hstack([touches, edges]))
    stencil = first.copy()
    data = np.vstack([mesh.centres, mesh.midpoints])
    for _ in range(RINGS):
        poor = _ill_posed(mesh.points, data, stencil)
        if not poor.any():
            break
        neighbours = touches @ (touches.T @ stencil)  # everything used by a node that shares a cell
        keep = csr_array((poor.astype(float), (np.arange(len(poor)), np.arange(len(poor)))))
        stencil = csr_array(stencil + keep @ neighbours)
        stencil.data[:] = 1.0
    stencil.sum_duplicates()
    stencil.sort_indices()
    return stencil


def _padded(points: Array, data: Array, stencil: csr_array) -> tuple[Array, Array, Index, NDArray[np.bool_]]:
    """Scaled offsets (n, s, 2) of the data from the nodes, weights (n, s), columns (n, s), and which of them are
    there.
    """
    counts = np.diff(stencil.indptr)
    slot = np.arange(len(stencil.indices)) - np.repeat(stencil.indptr[:-1], counts)
    row = np.repeat(np.arange(len(counts)), counts)
    columns = np.zeros((len(counts), counts.max()), dtype=np.intp)
    there = np.zeros(columns.shape, dtype=bool)
    columns[row, slot], there[row, slot] = stencil.indices, True
    offset = np.where(there[..., None], data[columns] - points[:, None], 0.0)
    distance = np.linalg.norm(offset, axis=2)
    scale = distance.max(axis=1, keepdims=True)
    offset, distance = offset / scale[..., None], distance / scale
    weight = np.where(there, 1 / np.maximum(distance, NEAREST), 0.0)
    return offset, weight, columns, there


def _ill_posed(points: Array, data: Array, stencil: csr_array) -> NDArray[np.bool_]:
    offset, _, _, there = _padded(points, data, stencil)
    matrix = np.concatenate([there[..., None].astype(float), offset], axis=2)
    singular = np.linalg.svd(matrix, compute_uv=False)
    return np.asarray((there.sum(axis=1) < MIN_FIT_POINTS) | (singular[:, -1] < SLENDER * singular[:, 0]))


def _fit(points: Array, data: Array, stencil: csr_array) -> tuple[Index, Index, Array]:
    """Rows, columns and weights of the value at each node of the weighted linear fit through its data."""
    offset, weight, columns, there = _padded(points, data, stencil)
    matrix = np.concatenate([there[..., None].astype(float), offset], axis=2) * weight[..., None]
    inverse = np.linalg.pinv(matrix, rcond=WORST)
    share = inverse[:, 0, :] * weight
    rows = np.broadcast_to(np.arange(len(points))[:, None], columns.shape)
    return rows[there], columns[there], share[there]


# -- The part of a layer's velocity that is free of divergence in its plane --------------------------------------------
def solenoidal(plane: PlaneMesh, triangles: NDArray[np.intp], at_rest: NDArray[np.intp]) -> Callable[[Array], Array]:
    """The function that takes node velocities (t, n, 2) m/s of ``plane`` to their part free of divergence, by linear
    finite elements on the ``triangles`` (m, 3). The nodes ``at_rest``, on walls, stay so.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    count = len(plane.points)
    gradient, area = _gradients(plane.points[triangles])
    pairs = (np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, (1, 3)).ravel())
    products = area[:, None, None] * np.einsum("mid,mjd->mij", gradient, gradient)
    matrix = coo_array((products.ravel(), pairs), shape=(count, count)).tocsr()
    outlet = np.unique(plane.faces[plane.on("outlet")])
    free = np.setdiff1d(np.arange(count), outlet)
    factors = splu(matrix[free][:, free].tocsc())
    share = np.bincount(triangles.ravel(), np.repeat(area / 3, 3), count)
    first, second = plane.faces.T
    weights = plane.lengths[:, None] * plane.normals

    def free_of_divergence(velocity: Array) -> Array:
        inside = area[:, None] * np.einsum("mid,md->mi", gradient, velocity[triangles].mean(axis=1))
        source = np.bincount(triangles.ravel(), inside.ravel(), count)
        for here, there in ((first, second), (second, first)):  # linear along each edge of the boundary
            through = (weights * (velocity[here] / 3 + velocity[there] / 6)).sum(axis=1)
            source -= np.bincount(here, through, count)
        potential = np.zeros(count)
        potential[free] = factors.solve(source[free])
        slope = (area / 3)[:, None] * np.einsum("mid,mi->md", gradient, potential[triangles])
        change = np.stack([np.bincount(triangles.ravel(), np.repeat(part, 3), count) for part in slope.T], axis=1)
        taken = change / share[:, None]
        taken[at_rest] = 0.0
        return np.asarray(velocity - taken)

    return lambda velocities: np.stack([free_of_divergence(velocity) for velocity in velocities])


def _gradients(corners: Array) -> tuple[Array, Array]:
    """Gradients (m, 3, 2) 1/m of the barycentric coordinates of triangles (m, 3, 2), and their areas (m,) m2."""
    across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return np.stack([-across[..., 1], across[..., 0]], axis=2) / (2 * area)[:, None, None], area
