"""The discrete divergence of a velocity on triangles: what interpolation makes of air that keeps its volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .triangles import Triangles

__all__ = ["Divergence", "divergence_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Divergence:
    """Discrete divergence: ``values`` (M,) or (T, M) 1/s, and rms and max of |div u| h / U.

    h is the root of twice a triangle's area, U the rms speed over the mesh.
    """

    values: Array
    rms: float
    max: float


def divergence_of(mesh: Triangles, velocity: Array) -> Divergence:
    """Of the nodal ``velocity`` (N, 2) or (T, N, 2) m/s, linear in every triangle."""
    values = np.einsum("mkd,...mkd->...m", mesh.gradients, velocity[..., mesh.triangles, :])
    speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=-1))))
    relative = np.abs(values) * np.sqrt(2 * mesh.area) / (speed or 1.0)
    rms = float(np.sqrt(np.average(np.atleast_2d(relative**2).mean(axis=0), weights=mesh.area)))
    return Divergence(values, rms, float(relative.max()))
