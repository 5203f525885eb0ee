"""Triangles: a mesh of triangles, its geometry, which triangle holds a point, gradients of nodal values, a mirror."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import SceneError
from ...core.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Value = TypeVar("Value")
INSIDE = -1e-9  # smallest barycentric coordinate that still counts as inside a triangle
PER_TRIANGLE = 2  # cells of the grid of nearest triangles


def double_area(points: Array, triangles: Index) -> Array:
    """Twice the signed area of every triangle (M,), positive where it runs counter-clockwise."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


class of_mesh(cached_property[Value]):
    """A property that all fields on one mesh share."""

    def place(self, instance: Any) -> dict[str, Any]:
        return instance.geometry  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class Triangles:
    """``points`` (N, 2) m and ``triangles`` (M, 3) of point numbers, counter-clockwise."""

    points: Array
    triangles: Index

    @cached_property
    def geometry(self) -> dict[str, Any]:
        """What was made of the mesh alone, by name."""
        return {}

    @of_mesh
    def box(self) -> tuple[Array, Array]:
        """The least and the largest coordinates (2,) m."""
        return self.points.min(axis=0), self.points.max(axis=0)

    @of_mesh
    def area(self) -> Array:
        """Area of every triangle (M,), m2."""
        return 0.5 * double_area(self.points, self.triangles)

    @of_mesh
    def node_area(self) -> Array:
        """The share of the whole area that each node represents (N,): a third of each triangle around it."""
        area = np.bincount(self.triangles.ravel(), np.repeat(self.area / 3, 3), len(self.points))
        return np.asarray(area / area.sum(), dtype=np.float64)

    @of_mesh
    def neighbours(self) -> Index:
        """Triangle across each edge (M, 3); edge k lies opposite corner k; -1 on the boundary.

        Raises SceneError when an edge belongs to more than two triangles.
        """
        cells = self.triangles
        ends = np.sort(np.concatenate([cells[:, [1, 2]], cells[:, [2, 0]], cells[:, [0, 1]]]), axis=1)
        key = ends[:, 0] * np.int64(len(self.points)) + ends[:, 1]
        order = np.argsort(key, kind="stable")
        same = key[order][1:] == key[order][:-1]
        if np.any(same[1:] & same[:-1]):
            raise SceneError("triangles: an edge belongs to more than two triangles")
        first, second = order[:-1][same], order[1:][same]
        across = np.full(len(key), -1, dtype=np.int64)
        across[first], across[second] = second % len(cells), first % len(cells)
        return np.ascontiguousarray(across.reshape(3, -1).T)

    @of_mesh
    def sides(self) -> tuple[Index, Index, Array]:
        """The two nodes (S,) of every side of a triangle, each side once, and its length (S,) m."""
        ends = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
        first, second = np.divmod(np.unique(ends[:, 0] * len(self.points) + ends[:, 1]), len(self.points))
        return first, second, np.linalg.norm(self.points[second] - self.points[first], axis=1)

    @of_mesh
    def boundary(self) -> Index:
        """The nodes on edges that belong to one triangle only, in order."""
        triangle, opposite = np.nonzero(self.neighbours < 0)
        return np.unique([self.triangles[triangle, (opposite + step) % 3] for step in (1, 2)])

    @of_mesh
    def gradients(self) -> Array:
        """Gradient of every triangle's three barycentric coordinates (M, 3, 2), 1/m."""
        p = self.points[self.triangles]
        across = np.roll(p, -2, axis=1) - np.roll(p, -1, axis=1)
        return np.stack([-across[..., 1], across[..., 0]], axis=2) / (2 * self.area)[:, None, None]

    @of_mesh
    def _centres(self) -> Any:
        """Tree of the triangles' centroids."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points[self.triangles].mean(axis=1))

    def locate(self, points: ArrayLike) -> Index:
        """The triangle that holds each point (n, 2); -1 outside the mesh. A point on the boundary is inside."""
        x = np.atleast_2d(np.asarray(points, dtype=float))
        result = np.full(len(x), -1, dtype=np.int64)
        low, high = self.box
        slack = 1e-9 * (high - low)
        todo = np.flatnonzero(np.all((x >= low - slack) & (x <= high + slack), axis=1))
        if not len(todo):
            return result
        at = self._centres.query(x[todo])[1].astype(np.int64)
        for _ in range(len(self.triangles)):
            coordinate = self.barycentric(at, x[todo])
            lowest = coordinate.argmin(axis=1)
            inside = coordinate[np.arange(len(todo)), lowest] >= INSIDE
            result[todo[inside]] = at[inside]
            onward = self.neighbours[at, lowest]
            go = ~inside & (onward >= 0)
            lost = todo[~inside & (onward < 0)]
            result[lost] = -2  # met the boundary: outside, or behind a body
            todo, at = todo[go], onward[go]
            if not len(todo):
                break
        result[todo] = -2
        lost = np.flatnonzero(result == -2)
        result[lost] = self._search(x[lost])
        return result

    def _search(self, x: Array) -> Index:
        """Every triangle that may hold them tried, for points whose walk met the boundary: those whose boxes do.

        Boxes are looked up on a regular grid, about one triangle a cell.
        """
        start, member, low, pitch, side = self._grid
        place = np.clip(((x - low) / pitch).astype(np.int64), 0, side - 1)
        cell = place[:, 1] * side + place[:, 0]
        count = start[cell + 1] - start[cell]
        point = np.repeat(np.arange(len(x)), count)
        inner = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
        near = member[np.repeat(start[cell], count) + inner]
        least = self.barycentric(near, x[point]).min(axis=1)
        result = np.full(len(x), -1, dtype=np.int64)
        order = np.argsort(least, kind="stable")  # the last one written, the deepest inside, stays
        order = order[least[order] >= INSIDE]
        result[point[order]] = near[order]
        return result

    @of_mesh
    def _grid(self) -> tuple[Index, Index, Array, Array, int]:
        """Triangles by the cells of a regular grid that their boxes touch: first member of each cell, members, corner
        and pitch of the grid, cells a side.
        """
        p = self.points[self.triangles]
        corner, top = self.box
        side = max(1, int(np.sqrt(len(p))))
        pitch = (top - corner) / side
        slack = 1e-9 * np.ptp(p, axis=1).max(axis=1, keepdims=True)
        low = np.clip(((p.min(axis=1) - slack - corner) / pitch).astype(np.int64), 0, side - 1)
        high = np.clip(((p.max(axis=1) + slack - corner) / pitch).astype(np.int64), 0, side - 1)
        wide = high - low + 1
        count = wide.prod(axis=1)
        owner = np.repeat(np.arange(len(p)), count)
        inner = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        column = low[owner, 0] + inner % wide[owner, 0]
        row = low[owner, 1] + inner // wide[owner, 0]
        cell = row * side + column
        order = np.argsort(cell, kind="stable")
        start = np.searchsorted(cell[order], np.arange(side * side + 1))
        return start, owner[order], corner, pitch, side

    @of_mesh
    def nearest_by_cell(self) -> tuple[Index, Array, Array, int]:
        """The triangle whose centroid is nearest to the middle of each cell of a regular grid, row by row; corner and
        pitch of the grid, cells a side.
        """
        corner, top = self.box
        side = max(1, int(np.sqrt(PER_TRIANGLE * len(self.triangles))))
        pitch = (top - corner) / side
        row, column = np.divmod(np.arange(side * side), side)
        nearest = self._centres.query(corner + (np.stack([column, row], axis=1) + 0.5) * pitch)[1]
        return nearest.astype(np.int64), corner, pitch, side

    def barycentric(self, triangle: Index, x: Array) -> Array:
        """Barycentric coordinates (n, 3) of points ``x`` (n, 2) in the given triangles (n,)."""
        offset = x - self.points[self.triangles[triangle, 0]]
        result: Array = np.einsum("nkd,nd->nk", self.gradients[triangle], offset)
        result[:, 0] += 1.0
        return result


# -- The discrete divergence of a velocity on triangles ----------------------------------------------------------------
@dataclass(frozen=True)
class Divergence:
    """Discrete divergence: ``values`` (M,) or (T, M) 1/s, and rms and max of |div u| h / U.

    h is the root of twice a triangle's area, U the rms speed over the mesh.
    """

    values: Array
    rms: float
    max: float


def divergence_of(mesh: Triangles, velocity: Array) -> Divergence:
    """Divergence of the nodal ``velocity`` (N, 2) or (T, N, 2) m/s, which is linear in every triangle."""
    values = np.einsum("mkd,...mkd->...m", mesh.gradients, velocity[..., mesh.triangles, :])
    speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=-1))))
    relative = np.abs(values) * np.sqrt(2 * mesh.area) / (speed or 1.0)
    rms = float(np.sqrt(np.average(np.atleast_2d(relative**2).mean(axis=0), weights=mesh.area)))
    return Divergence(values, rms, float(relative.max()))


# -- The gradient of nodal values at the nodes, second order up to the boundary ----------------------------------------
def gradient_operators(points: Array, triangles: Index) -> tuple[Any, Any]:
    """Sparse (N, N) matrices that take nodal values to their x and y derivatives at the nodes.

    Least-squares quadratics over the nodes around each node (polynomial preserving recovery, Zhang & Naga 2005, SIAM
    J. Sci. Comput. 26, 1192): exact for quadratics, second order up to the boundary. A patch is the node's
    neighbours, and theirs where the fit would not be well posed; coordinates are whitened by the patch's own shape,
    so flat cells do no harm. Where even wide patches are too small a linear fit is made. The last few meshes' are kept:
    many fields share one.
    """
    nodes, cells = np.ascontiguousarray(points, dtype=float), np.ascontiguousarray(triangles, dtype=np.int64)
    return _operators(nodes.tobytes(), cells.tobytes())


@lru_cache(maxsize=8)
def _operators(nodes: bytes, cells: bytes) -> tuple[Any, Any]:
    """:func:`gradient_operators` of the bytes of ``points`` and ``triangles``."""
    from scipy.sparse import coo_matrix, csr_matrix, identity

    points, triangles = np.frombuffer(nodes).reshape(-1, 2), np.frombuffer(cells, dtype=np.int64).reshape(-1, 3)
    count = len(points)
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    ring = csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count)) + identity(count)
    todo = np.arange(count)
    reach, pieces = csr_matrix(ring), []
    for terms, condition in ((6, 1e4), (6, 1e5), (6, 1e6), (3, np.inf)):
        rows, columns, weights, good = _fit(points, csr_matrix(reach[todo]), todo, terms, condition)
        pieces.append((rows, columns, weights))
        todo = todo[~good]
        if not len(todo):
            break
        reach = csr_matrix(reach @ ring)
    rows, columns = (np.concatenate([piece[i] for piece in pieces]) for i in range(2))
    weights = np.concatenate([piece[2] for piece in pieces])
    return tuple(coo_matrix((weights[:, i], (rows, columns)), shape=(count, count)).tocsr() for i in range(2))


def _fit(
    points: Array, patches: Any, centres: Index, terms: int, worst: float
) -> tuple[Index, Index, Array, NDArray[np.bool_]]:
    """Weights of the gradient at ``centres`` from least-squares polynomials of 6 or 3 terms over their patches.

    Returns rows, columns and weights (.., 2) for the centres whose fit has a condition number below ``worst``, and
    which.
    """
    size = np.diff(patches.indptr)
    width = int(size.max())
    filled = np.arange(width) < size[:, None]
    member = np.zeros((len(centres), width), dtype=np.int64)
    member[filled] = patches.indices
    offset = np.where(filled[..., None], points[member] - points[centres][:, None], 0.0)
    spread = np.einsum("nkd,nke->nde", offset, offset) / np.maximum(size - 1, 1)[:, None, None]
    root = np.linalg.cholesky(spread + 1e-12 * np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(2))
    whiten = np.linalg.inv(root)
    xi, eta = np.moveaxis(np.einsum("nde,nke->nkd", whiten, offset), 2, 0)
    basis = np.stack([np.ones_like(xi), xi, eta, xi**2, xi * eta, eta**2][:terms], axis=2)
    basis *= (filled * np.exp(-0.125 * (xi**2 + eta**2)))[..., None]
    normal = np.einsum("nki,nkj->nij", basis, basis)
    values = np.linalg.eigvalsh(normal)
    enough = size >= (terms + 1 if terms > 3 else 3)
    good = enough & (values[:, 0] * worst > values[:, -1])
    inverse = np.linalg.inv(normal[good])
    weight = np.exp(-0.125 * (xi**2 + eta**2))[good] * filled[good]
    local = np.einsum("nij,nkj->nki", inverse[:, 1:3], basis[good]) * weight[..., None]
    gradient = np.einsum("nde,nkd->nke", whiten[good], local)
    inside = filled[good]
    rows = np.broadcast_to(centres[good][:, None], inside.shape)[inside]
    return rows, member[good][inside], gradient[inside], good


# -- Mirror images about a vertical line -------------------------------------------------------------------------------
VECTORS = ("velocity", "given_gradient")  # their x component changes sign
SLACK = 1e-9  # of the mesh's largest extent: how far off the line a node still lies on it


def mirrored(
    points: Array, triangles: Index, nodal: Mapping[str, Array], x: float
) -> tuple[Array, Index, dict[str, Any]]:
    """Points (2 N - A, 2) m, triangles (2 M, 3) and nodal arrays by name of the whole, from a half beside the line at
    ``x`` (m) with A nodes on it, which the halves share: points (N, 2), triangles (M, 3), arrays (.., N) or (.., N, 2).

    Raises SceneError when points lie on both sides, or none on the line.
    """
    offset = points[:, 0] - x
    slack = SLACK * float(np.ptp(points, axis=0).max())
    axis = np.abs(offset) <= slack
    if offset.min() < -slack and offset.max() > slack:
        raise SceneError(f"mirrored: points lie on both sides of x = {x:g} m")
    if not axis.any():
        raise SceneError(f"mirrored: no points on the axis x = {x:g} m")
    count, off = len(points), ~axis
    image = np.arange(count)
    image[off] = count + np.arange(off.sum())
    near = points.copy()
    near[axis, 0] = x

    def double(name: str, values: Array) -> Array:
        if name not in VECTORS:
            return np.concatenate([values, values[..., off]], axis=-1)
        half = values.copy()
        half[..., axis, 0] = 0.0
        return np.concatenate([half, half[..., off, :] * (-1.0, 1.0)], axis=-2)

    return (
        np.concatenate([near, (2 * x, 0.0) + near[off] * (-1.0, 1.0)]),
        np.concatenate([triangles, image[triangles[:, ::-1]]]),
        {name: double(name, values) for name, values in nodal.items()},
    )
