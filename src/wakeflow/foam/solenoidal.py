"""The part of a layer's velocity that is free of divergence in its plane.

Air enters and leaves a layer of a three-dimensional airflow along the span. Granules that stay in it would be gathered
where it leaves and spread where it enters, as no granule of the real airflow is. So the gradient of a potential is
taken off: u' = u - grad phi with div u' = 0, the least change that does it (Helmholtz' decomposition). The velocity
through inlets and walls stays; what the layer loses on the way no longer leaves through the outlet.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .reconstruction import PlaneMesh

__all__ = ["solenoidal"]

Array = NDArray[np.float64]


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
