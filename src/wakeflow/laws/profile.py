"""Profiles of a falling curtain: registered quantile functions of where its mass falls across its width.

``quantile(p, width)`` is the place (m from the curtain's middle, within half a width) left of which the share p of the
mass falls. Granules spread by it represent the same mass each, wherever they fall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.registry import Registry
from .size import normal_quantile

Array = NDArray[np.float64]
profiles: Registry[Callable[..., Array]] = Registry("curtain profile")


@profiles.register("uniform")
def uniform(p: Array, width: float) -> Array:
    """Mass spread evenly over the width: a slot, a vibrating feeder's edge."""
    return width * (np.asarray(p) - 0.5)


@profiles.register("triangular")
def triangular(p: Array, width: float) -> Array:
    """Mass that falls off linearly from the middle, twice as dense as the mean, to nothing at the edges."""
    below = np.minimum(p, 1.0 - np.asarray(p))
    return 0.5 * width * np.copysign(1.0 - np.sqrt(2.0 * below), np.asarray(p) - 0.5)


@profiles.register("parabolic")
def parabolic(p: Array, width: float) -> Array:
    """Density 3/2 (1 - (2 x / width)^2) of the mean: dense flow through a slot. The root of 3 s^2 - 2 s^3 = p."""
    return -width * np.sin(np.arcsin(1.0 - 2.0 * np.asarray(p)) / 3.0)


@profiles.register("normal")
def normal(p: Array, width: float, *, std: float = math.nan) -> Array:
    """Normal with standard deviation ``std`` (m; a quarter of the width without), cut off at the curtain's edges."""
    spread = 0.25 * width if math.isnan(std) else std
    below = NormalDist().cdf(-0.5 * width / spread)
    return np.asarray(spread * normal_quantile(below + np.asarray(p) * (1.0 - 2.0 * below)))


@profiles.register("table")
def table(p: Array, width: float, *, positions: Sequence[float], weights: Sequence[float]) -> Array:
    """Mass per width as measured: ``weights`` (any unit) at ``positions`` (m from the middle), linear between them."""
    x, w = np.asarray(positions, dtype=float), np.asarray(weights, dtype=float)
    if len(x) != len(w) or len(x) < 2:
        raise SceneError(f"positions ({len(x)}) and weights ({len(w)}) must pair up, two at least")
    if not np.all(np.diff(x) > 0.0):
        raise SceneError("positions must increase")
    if np.abs(x).max() > 0.5 * width * (1.0 + 1e-9):
        raise SceneError(f"positions reach {np.abs(x).max():g} m from the middle, beyond half of width = {width:g} m")
    if not (np.all(w >= 0.0) and np.any(w > 0.0)):
        raise SceneError("weights must not be negative, and not all zero")
    mass = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(x))])
    target = np.asarray(p) * mass[-1]
    k = np.clip(np.searchsorted(mass, target, side="right") - 1, 0, len(x) - 2)
    rest, step = target - mass[k], x[k + 1] - x[k]
    slope = (w[k + 1] - w[k]) / step  # w s + slope s^2 / 2 = rest, in the form that does not cancel
    root = np.sqrt(np.maximum(w[k] ** 2 + 2.0 * slope * rest, 0.0))
    value: Array = x[k] + np.clip(2.0 * rest / np.maximum(w[k] + root, 1e-300), 0.0, step)
    return value


def crowding(quantile: Callable[[Array], Array], width: float) -> float:
    """How much denser than a uniform curtain the curtain is about a granule, in the mean over the granules: width times
    the integral of the density squared; 1 uniform, 4/3 triangular, 6/5 parabolic.
    """
    edges = quantile(np.linspace(1e-9, 1.0 - 1e-9, 4001))
    return float(np.mean(1.0 / np.maximum(np.diff(edges), 1e-9 * width)) * width / 4000)
