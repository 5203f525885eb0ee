"""Impaction of fine granules on a sphere that moves through their air: which of those in its way it meets."""

from __future__ import annotations

from typing import Any

__all__ = ["sphere_caught"]

HALF = 0.25  # Stokes number at which a quarter of them is met


def sphere_caught(stokes: Any) -> Any:
    """Share of the granules in the cross-section of a sphere that it meets: (S / (S + 1/4))^2.

    S = tau u / D (relaxation time at the relative speed u, diameter D of the sphere). Langmuir, I. 1948, J. Meteorology
    5, 175: a fit to paths in the potential flow about a sphere, there as K / (K + 1/2) with K = 2 S; for fine granules,
    much smaller than the sphere, and spheres of a Reynolds number above some hundred. Below S = 1/24 potential theory
    meets none, the fit up to 2 %. Takes arrays, and scalars in the compiled kernel.
    """
    part = stokes / (stokes + HALF)
    return part * part
