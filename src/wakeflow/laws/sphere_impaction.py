"""Impaction of fine granules on a sphere that moves through their air: which of those in its way it meets."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["sphere_caught"]

WIDE = 2.0 / 3.0


def sphere_caught(stokes: Any, reynolds: Any) -> Any:
    """Share of the granules in the cross-section of a sphere that it meets: ((S - S0) / (S - S0 + 2/3))^(3/2), 0 for
    S <= S0 = (1.2 + ln(1 + R) / 12) / (1 + ln(1 + R)).

    ``stokes`` tau u / D (relaxation time at the relative speed u, diameter D of the sphere), S = twice that;
    ``reynolds`` rho u D / mu of the sphere, R half of that. Slinn's fit for raindrops (1984), as an open program writes
    it (rivm-syso/SBoo, after Wang, Zhang & Moran 2010, Atmos. Chem. Phys. Discuss. 10, 2503); neither paper was read.
    A fit between creeping flow, which meets none below S0 = 1.2, and potential flow, S0 = 1/12, with whose
    paths it agrees to 0.03; for granules much smaller than the sphere. Takes arrays, and the compiled kernel's scalars.
    """
    turn = np.log(1.0 + 0.5 * reynolds)
    above = np.maximum(2.0 * stokes - (1.2 + turn / 12.0) / (1.0 + turn), 0.0)
    part = above / (above + WIDE)
    return part * np.sqrt(part)
