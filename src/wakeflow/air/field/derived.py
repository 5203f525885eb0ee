"""What follows from a field's nodal values: gradients at the nodes, vorticity, the stream function."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .flow import FlowField


Array = NDArray[np.float64]
Index = NDArray[np.int64]


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


def vorticity(field: FlowField) -> Array:
    """dv/dx - du/dy at the nodes (.., N), 1/s: second order up to the boundary; counter-clockwise is positive."""
    along_x, along_y = gradient_operators(field.points, field.triangles)
    flat = field.velocity.reshape(-1, len(field.points), 2)
    turning = (along_x @ flat[..., 1].T - along_y @ flat[..., 0].T).T
    return np.asarray(turning.reshape(field.velocity.shape[:-1]))


def stream_function(field: FlowField) -> Array:
    """psi at the nodes (N,) of a steady field, m2/s, with u = dpsi/dy and v = -dpsi/dx; zero at the first node.

    Least squares in the triangles, linear finite elements: the one whose lines run nearest to along the velocity, also
    where that is not quite free of divergence. Between two of its lines flows the difference of their psi.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import spsolve

    if field.velocity.ndim != 2:
        raise ValueError("the stream function is of a steady field; take its mean()")
    corners, area = field.triangles, field.area
    slopes = field.gradients  # (M, 3, 2)
    mean = field.velocity[corners].mean(axis=1)
    wanted = np.stack([-mean[:, 1], mean[:, 0]], axis=1)
    stiffness = np.einsum("m,mid,mjd->mij", area, slopes, slopes)
    load = np.einsum("m,mid,md->mi", area, slopes, wanted)
    rows, columns = (np.broadcast_to(part, stiffness.shape) for part in (corners[:, :, None], corners[:, None, :]))
    size = len(field.points)
    matrix = coo_matrix((stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsc()
    right = np.bincount(corners.ravel(), load.ravel(), minlength=size)
    psi = np.zeros(size)
    psi[1:] = spsolve(matrix[1:, 1:], right[1:])
    return psi
