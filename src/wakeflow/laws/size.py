"""Size distributions: registered quantile functions of the mass-based cumulative distribution.

Every distribution is **by mass**: ``quantile(p)`` is the diameter (m) below which the mass fraction p of the material
lies. A granule of a fraction then represents the same mass whatever its size, which is what bin shares by mass need.

Measured terminal velocities (m/s) are spread by the same functions, where only ends, mean, median or spread are given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.quantities import metres
from ..core.registry import Registry

Array = NDArray[np.float64]
sizes: Registry[Callable[..., Array]] = Registry("size distribution")
normal_quantile = np.vectorize(NormalDist().inv_cdf, otypes=[float])  # the plan asks too, and must not load scipy
QUANTILE_ROUND_OFF = 1e-12  # quantiles keep that far from 0 and 1, where a distribution may be infinite


def within(p: Array, *, mean: float, std: float, low: float = -math.inf, high: float = math.inf) -> Array:
    """Values below which the shares ``p`` lie, of a normal distribution cut off at ``low`` and ``high`` and
    renormalised; ``mean`` and ``std`` are those before the cut. All have the ``mean`` where ``std`` is 0.
    """
    if std == 0.0:
        return np.full(np.shape(p), mean)
    least, most = (NormalDist(mean, std).cdf(end) for end in (low, high))
    value: Array = np.clip(mean + std * normal_quantile(least + np.asarray(p) * (most - least)), low, high)
    return value


@sizes.register("single")
def single(p: Array, *, diameter: float) -> Array:
    """Every granule of one ``diameter`` (m)."""
    return np.full(np.shape(p), diameter)


@sizes.register("uniform")
def uniform(p: Array, *, low: float, high: float) -> Array:
    """Mass spread evenly over diameters from ``low`` to ``high`` (m)."""
    if not low < high:
        raise SceneError(f"low = {low:g} must be below high = {high:g}")
    return low + (high - low) * np.asarray(p)


@sizes.register("normal")
def normal(p: Array, *, mean: float, std: float) -> Array:
    """Normal with ``mean`` and ``std`` (m), cut off below zero and renormalised.

    Refused when more than 1 % of the mass would lie below zero: such a sample is not normal.
    """
    below = NormalDist().cdf(-mean / std)
    if below > 0.01:
        raise SceneError(f"std = {std:g} puts {below:.0%} of the mass below zero; use lognormal")
    value: Array = mean + std * normal_quantile(below + np.asarray(p) * (1.0 - below))
    return value


@sizes.register("lognormal")
def lognormal(p: Array, *, median: float, geometric_std: float) -> Array:
    """Lognormal with mass ``median`` (m) and geometric standard deviation (> 1)."""
    if not geometric_std > 1.0:
        raise SceneError(f"geometric_std = {geometric_std:g} must be above 1 (1.5 is a usual milling product)")
    value: Array = median * np.exp(np.log(geometric_std) * normal_quantile(p))
    return value


@sizes.register("rosin-rammler")
def rosin_rammler(p: Array, *, scale: float, spread: float, low: float = 1e-9, high: float = math.inf) -> Array:
    """Retained mass exp(-(d / scale)^spread): 63.2 % passes ``scale`` (m); a larger ``spread`` is a narrower product.

    ``low`` and ``high`` (m) cut it off, the rest renormalised; by default nothing lies below 1 nm. Rosin, P. &
    Rammler, E. 1933, J. Inst. Fuel 7, 29; milled and broken goods have a spread of about 0.7 to 3.
    """
    if not (scale > 0.0 and spread > 0.0):
        raise SceneError(f"scale = {metres(scale)} and spread = {spread:g} must be positive")
    if not low < high:
        raise SceneError(f"low = {metres(low)} must be below high = {metres(high)}")
    finest, coarsest = (
        math.exp(min(spread * math.log(cut / scale), 700.0)) if cut > 0.0 else 0.0 for cut in (low, high)
    )
    kept = math.exp(-finest) - math.exp(-coarsest)
    if kept < 1e-6:
        raise SceneError(
            f"low = {metres(low)} and high = {metres(high)} keep {kept:.1g} of this distribution; widen them"
        )
    mass = -math.expm1(finest - coarsest)  # between the cuts, of what exceeds the lower one
    return scale * (finest - np.log1p(-np.asarray(p) * mass)) ** (1.0 / spread)


@sizes.register("table")
def table(p: Array, *, diameters: Sequence[float], passing: Sequence[float]) -> Array:
    """A sieve analysis: the mass fraction ``passing`` each of the ``diameters`` (m), from 0 up to 1.

    Between two sieves the mass is spread evenly over the logarithm of the diameter: straight lines on the usual
    semi-logarithmic plot. Two equal fractions: nothing lies between those sieves.
    """
    d, share = np.asarray(diameters, dtype=float), np.asarray(passing, dtype=float)
    if len(d) != len(share) or len(d) < 2:
        raise SceneError(f"diameters ({len(d)}) and passing ({len(share)}) must pair up, two at least")
    if not (d[0] > 0.0 and np.all(np.diff(d) > 0.0)):
        raise SceneError("diameters must increase from a positive one, the finest sieve first")
    if share[0] != 0.0 or share[-1] != 1.0:
        raise SceneError(
            f"passing goes from {share[0]:g} to {share[-1]:g}; it must begin with 0, at the smallest granule, and end "
            "with 1 (fractions, not percent), at the largest"
        )
    if not np.all(np.diff(share) >= 0.0):
        raise SceneError("passing must not decrease: what passes a sieve passes every wider one")
    value: Array = np.exp(np.interp(np.asarray(p), share, np.log(d)))
    return value


def normal_points(dimensions: int, count: int, *seed: int) -> Array:
    """Points (count, dimensions) of independent standard normal numbers, scrambled Sobol's."""
    from scipy.stats import qmc

    if not dimensions:
        return np.zeros((count, 0))
    points = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed)).random(count)
    return np.asarray(normal_quantile(np.clip(points, QUANTILE_ROUND_OFF, 1.0 - QUANTILE_ROUND_OFF)), dtype=float)
