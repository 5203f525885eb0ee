"""Shear lift of Saffman and Mei: a granule that slips in rotating air is pushed across its slip.

    F = rho V_p C_l (u - v) x curl u,    Re = rho |u - v| d / mu,    Re_w = rho |curl u| d^2 / mu

Scalar functions of the math module, since the tracker's kernel compiles them as they stand; np.vectorize takes arrays.
"""

from __future__ import annotations

import math

__all__ = ["lift_coefficient"]

SAFFMAN = 3.0 * 6.46 / (2.0 * math.pi)  # 6.46 (1.615 on the diameter) is Saffman's constant, per volume of a sphere


def lift_coefficient(reynolds: float, shear_reynolds: float) -> float:
    """C_l = 3 / (2 pi sqrt(Re_w)) 6.46 [e + a (1 - e)], e = exp(-Re / 10), a = 0.3314 sqrt(Re_w / (2 min(Re, 40))).

    Saffman, P.G. 1965, J. Fluid Mech. 22, 385 (corrigendum 1968, 31, 624): the bracket is 1, for Re << sqrt(Re_w) << 1.
    Mei, R. 1992, Int. J. Multiphase Flow 18, 145, fits Dandy & Dwyer's simulations for 0.1 <= Re <= 100 and 0.005 <
    beta < 0.4, beta = Re_w / (2 Re); his a keeps growing as sqrt(Re) above Re = 40. There his fit drops e, a jump of up
    to 1.8 % of Saffman's force; here e fades out instead, since every track that crosses a jump would need more steps.

    Outside these ranges it stays finite, positive and continuous: Re -> 0 gives Saffman's force however strong the
    shear, and Re_w -> infinity above Re = 40 gives C_l = 0.114. For Re_w -> 0 C_l grows as Re_w^(-1/2) while the force
    falls as Re_w^(1/2); C_l = 0 at Re_w = 0.
    """
    if shear_reynolds <= 0.0:
        return 0.0
    gone = -math.expm1(-0.1 * reynolds)
    slope = 0.3314 * gone / math.sqrt(2.0 * min(max(reynolds, 1e-300), 40.0))  # 0 at Re = 0: gone falls faster
    return SAFFMAN * ((1.0 - gone) / math.sqrt(shear_reynolds) + slope)
