"""Functions of time that repeat: periodic cubic B-splines on uniform knots.

f(t) = sum over j of c_j B((t - t_0) / h - j), B the centred cubic B-spline (de Boor 2001, A Practical Guide to Splines,
ch. IX), h the period over the number of knots: twice continuously differentiable, fourth-order accurate in h, and at
any time made of four coefficients only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["POWERS", "around", "design", "fit"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# coefficients of 1, w, w^2, w^3 in an interval between knots, of the four spline coefficients around it
POWERS = np.array([(1, 4, 1, 0), (-3, 0, 3, 0), (3, -6, 3, 0), (-1, 3, -3, 1)]) / 6.0


def around(t: ArrayLike, start: float, period: float, knots: int) -> tuple[Index, Array]:
    """The four coefficients that make f at times ``t`` (..,) s: their indices (.., 4) and weights (.., 4)."""
    place = (np.asarray(t, dtype=float) - start) * (knots / period)
    first = np.floor(place)
    weight = np.asarray((place - first)[..., None] ** np.arange(4) @ POWERS, dtype=np.float64)
    index = (first[..., None].astype(np.int64) + np.arange(-1, 3)) % knots
    return index, weight


def design(t: Array, start: float, period: float, knots: int) -> Array:
    """Matrix (T, knots) from coefficients to values at times ``t`` (T,)."""
    index, weight = around(t, start, period, knots)
    matrix = np.zeros((len(t), knots))
    np.add.at(matrix, (np.arange(len(t))[:, None], index), weight)
    return matrix


def fit(t: Array, values: Array, period: float, knots: int) -> Array:
    """Coefficients (knots, K) of the least-squares splines through ``values`` (T, K) at times ``t``; knots begin at
    t[0].
    """
    found = np.linalg.lstsq(design(t, float(t[0]), period, knots), values, rcond=1e-10)[0]
    return np.asarray(found, dtype=np.float64)
