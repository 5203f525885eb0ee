"""What a field looks like in a mirror, and in a mesh that swings with the vibrating bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import SceneError

# -- Mirror images about a vertical line -------------------------------------------------------------------------------
Array = NDArray[np.float64]
Index = NDArray[np.int64]
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


# -- The motion of a field's whole mesh --------------------------------------------------------------------------------
WHOLE = 0.01  # vibrations by which a moving field's period may miss a whole number of them. Chosen: 4 degrees of phase


class MeshOscillation(NamedTuple):
    """Harmonic motion of the whole mesh: displacement (x, y) sin(omega t + phase); m, rad/s, rad."""

    x: float
    y: float
    omega: float
    phase: float = 0.0

    def displacement(self, t: ArrayLike) -> Array:
        """Where the mesh is (.., 2) m at times ``t`` (..,) s, from where its points say."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.sin(angle)[..., None] * np.array([self.x, self.y]))

    def velocity(self, t: ArrayLike) -> Array:
        """How fast the mesh moves (.., 2) m/s."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.cos(angle)[..., None] * np.array([self.x, self.y]) * self.omega)

    def check(self, in_time: bool, period: float) -> None:
        """Raise SceneError for numbers that are not finite, and for a field in time (``in_time``) whose ``period`` (s)
        is not a whole number of swings.
        """
        if not (np.all(np.isfinite(self)) and self.omega > 0):
            raise SceneError(f"motion: amplitude, omega and phase {tuple(self)} must be finite, and omega positive")
        if in_time:
            turns = period * self.omega / (2 * np.pi)
            if not abs(turns - np.round(turns)) <= WHOLE:
                raise SceneError(f"motion: the field repeats after {turns:.4g} swings of its mesh, not a whole number")
