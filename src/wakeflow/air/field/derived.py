"""What follows from a field's velocity: vorticity, the stream function."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .triangles import gradient_operators

if TYPE_CHECKING:
    from .flow import FlowField

Array = NDArray[np.float64]


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
