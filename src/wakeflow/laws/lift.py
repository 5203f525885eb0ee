"""Lift of shear (Saffman-Mei) and of spin (Magnus), and the air's torque on a spin.

    F = rho V_p C_l (u - v) x curl u,    Re = rho |u - v| d / mu,    Re_w = rho |curl u| d^2 / mu

Scalar functions of the math module, since the tracker's kernel compiles them as they are; np.vectorize takes arrays.

With the relative spin W = curl u / 2 - w (w the granule's), the slip s = u - v, Re = rho |s| d / mu and the spin
Reynolds number Re_r = rho |W| d^2 / mu, a sphere is accelerated by  3/4 (rho / rho_p) c W x s  with c from
:func:`magnus_factor`, and its relative spin in steady air follows :func:`spin_decay`.

Scalar functions of the math module, since the tracker's kernel compiles them as they are; np.vectorize takes arrays.
"""

from __future__ import annotations

import math
from typing import Any

# -- Shear lift of Saffman and Mei -------------------------------------------------------------------------------------
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


# -- Spin --------------------------------------------------------------------------------------------------------------
# The torque of Dennis et al. over the creeping one, as ROOT sqrt(Re_r) + BASE; they meet at SPIN_CROSSOVER = 31.7
ROOT = 12.9 / (64.0 * math.pi)
BASE = 128.4 / (64.0 * math.pi)
# 95 % of what spin lift is over its law: spheres of Re 550 to 1600 have C_L = (0.4 +- 0.1) q (Tsuji, Y., Morikawa, Y. &
# Mizuno, O. 1985, J. Fluids Eng. 107, 484), fits in use differ by more; a plate's chord and C_R are as uncertain
MAGNUS_RANGE = (0.3, 2.0)
CROSSOVER_ROOT = (1.0 - BASE) / ROOT
SPIN_CROSSOVER = CROSSOVER_ROOT**2


def magnus_factor(reynolds: float, spin_reynolds: float) -> float:
    """Spin lift over that of creeping flow, 0 < c <= 1: 1 - (0.675 + 0.15 (1 + tanh(0.28 (q - 2)))) tanh(0.18 Re^1/2).

    q = Re_r / Re is the spin ratio |W| d / |s|. c = 1 is Rubinow, S.I. & Keller, J.B. 1961, J. Fluid Mech. 11, 447; the
    factor is Loth, E. 2008, AIAA J. 46, 801, for Re < 2000 and q < 20. Granules that leave a slope have Re up to 1000
    and q below 1, where c = 1/4. The fit of Oesterle, B. & Bui Dinh, T. 1998, Exp. Fluids 25, 16, holds for 10 < Re <
    140 and fast spin only, where the two differ by up to 40 %; at slow spin it exceeds even creeping flow's lift.
    Continuous everywhere; 1 at Re = 0, 0.025 where both numbers are large.
    """
    ratio = spin_reynolds / max(reynolds, 1e-300)
    return 1.0 - (0.825 + 0.15 * math.tanh(0.28 * (ratio - 2.0))) * math.tanh(0.18 * math.sqrt(reynolds))


def spin_rate(diameter: Any, density: Any, viscosity: float, inertia: Any = 0.4) -> Any:
    """Rate (1/s) at which the relative spin decays in creeping flow: 24 mu / (k rho_p d^2), k = I / (m r^2).

    Diameter m, density kg/m3, dynamic viscosity Pa s; arrays broadcast. The torque 8 pi mu r^3 W is Kirchhoff's
    (1876); a sphere has k = 0.4 and 60 mu / (rho_p d^2).
    """
    return 24.0 * viscosity / (inertia * density * diameter**2)


def plate_spin(relative: float, time: float, torque: float) -> float:
    """Relative spin (1/s) of a plate after ``time`` (s) from ``relative``: W / (1 + c |W| t), exact for W' = -c W |W|.

    ``torque`` c is :func:`~wakeflow.laws.flake.plate_torque`.
    """
    return relative / (1.0 + torque * abs(relative) * time)


def spin_decay(relative: float, time: float, rate: float, reynolds_per_spin: float) -> float:
    """Relative spin (1/s) after ``time`` (s, up to infinity) from ``relative``, exact; the sign is kept.

    ``rate`` is :func:`spin_rate`, ``reynolds_per_spin`` rho d^2 / mu (s). Torque T = rho / 2 r^5 C_R W |W|: Re_r C_R =
    64 pi in creeping flow, 12.9 sqrt(Re_r) + 128.4 above the crossover (Dennis, S.C.R., Singh, S.N. & Ingham, D.B.
    1980, J. Fluid Mech. 101, 257; 80 < Re_r < 4000). So W' = -rate W below and, a Bernoulli equation, W' = -rate (ROOT
    sqrt(Re_r) + BASE) W above; the time of the crossover is known, so each law acts for its own part of ``time``.
    """
    root = math.sqrt(abs(relative) * reynolds_per_spin)
    passed = rate * time
    if root <= CROSSOVER_ROOT:
        return relative * math.exp(-passed)
    fast = 2.0 / BASE * math.log(root / (CROSSOVER_ROOT * (BASE + ROOT * root)))  # rate times time to the crossover
    if passed >= fast:
        return relative * (CROSSOVER_ROOT / root) ** 2 * math.exp(fast - passed)
    grown = math.expm1(0.5 * BASE * passed)
    return relative / (1.0 + grown * (1.0 + root * ROOT / BASE)) ** 2
