"""Size distributions: registered quantile functions of the mass-based cumulative distribution.

Every distribution is **by mass**: ``quantile(p)`` is the diameter (m) below which the mass fraction p of the material
lies. A granule of a fraction then stands for the same mass whatever its size, which is what bin shares by mass need.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..registry import Registry

__all__ = ["sizes"]

Array = NDArray[np.float64]
sizes: Registry[Callable[..., Array]] = Registry("size distribution")
_normal_quantile = np.vectorize(NormalDist().inv_cdf, otypes=[float])  # the plan asks too, and must not load scipy


@sizes.register("single")
def single(p: Array, *, diameter: float) -> Array:
    """Every granule of one ``diameter`` (m)."""
    return np.full(np.shape(p), diameter)


@sizes.register("uniform")
def uniform(p: Array, *, low: float, high: float) -> Array:
    """Mass spread evenly over diameters from ``low`` to ``high`` (m)."""
    if not low < high:
        raise SceneError(f"low = {low:g} m must be below high = {high:g} m")
    return low + (high - low) * np.asarray(p)


@sizes.register("normal")
def normal(p: Array, *, mean: float, std: float) -> Array:
    """Normal with ``mean`` and ``std`` (m), cut off below zero and renormalised.

    Refused when more than 1 % of the mass would lie below zero: such a sample is not normal.
    """
    below = NormalDist().cdf(-mean / std)
    if below > 0.01:
        raise SceneError(f"std = {std:g} m puts {below:.0%} of the mass at diameters below zero; use lognormal")
    return mean + std * _normal_quantile(below + np.asarray(p) * (1.0 - below))


@sizes.register("lognormal")
def lognormal(p: Array, *, median: float, geometric_std: float) -> Array:
    """Lognormal with mass ``median`` (m) and geometric standard deviation (> 1)."""
    if not geometric_std > 1.0:
        raise SceneError(f"geometric_std = {geometric_std:g} must be above 1 (1.5 is a usual milling product)")
    return median * np.exp(np.log(geometric_std) * _normal_quantile(p))
