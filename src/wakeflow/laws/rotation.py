"""Spin: the lift it gives (Magnus) and its decay by the air's torque, both at finite Reynolds number.

With the relative spin W = curl u / 2 - w (w the granule's), the slip s = u - v, Re = rho |s| d / mu and the spin
Reynolds number Re_r = rho |W| d^2 / mu, a sphere is accelerated by  3/4 (rho / rho_p) c W x s  with c from
:func:`magnus_factor`, and its relative spin in steady air follows :func:`spin_decay`.

Scalar functions of the math module, since the tracker's kernel compiles them as they stand; np.vectorize takes arrays.
"""

from __future__ import annotations

import math
from typing import Any

__all__ = ["SPIN_CROSSOVER", "magnus_factor", "spin_decay", "spin_rate"]

# The torque of Dennis et al. over the creeping one, as ROOT sqrt(Re_r) + BASE; they meet at SPIN_CROSSOVER = 31.7
ROOT = 12.9 / (64.0 * math.pi)
BASE = 128.4 / (64.0 * math.pi)
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
