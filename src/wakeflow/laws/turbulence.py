"""Turbulent dispersion of a granule as a Langevin process of the fluid velocity seen, and Brownian motion.

Each component of the fluctuation that the granule sees is rms = sqrt(2 k / 3) times a unit Ornstein-Uhlenbeck process
of the integral time that :func:`crossing_times` shortens from :func:`lifetime`; :func:`langevin` steps it exactly,
whatever the step.

Scalar functions of the math module, since the tracker's kernel compiles them as they stand; np.vectorize takes arrays.
"""

from __future__ import annotations

import math
from typing import Any

__all__ = ["brownian_diffusivity", "crossing_times", "langevin", "lifetime"]

C0 = 2.1  # of the simplified Langevin model, as in Minier & Peirano and in code_saturne
LIFETIME = 1.0 / (0.5 + 0.75 * C0)
EULERIAN = 0.8  # ratio of the Lagrangian to the Eulerian integral time, as in code_saturne
BOLTZMANN = 1.380649e-23  # J/K, exact


def lifetime(k: Any, dissipation: Any) -> Any:
    """Lagrangian integral time T_L (s) = k / dissipation / (1/2 + 3/4 C0), C0 = 2.1; 0 where k = 0.

    k m2/s2, dissipation m2/s3. Pope, S.B. 1994, Annu. Rev. Fluid Mech. 26, 23; Peirano, E., Chibbaro, S., Pozorski,
    J. & Minier, J.-P. 2006, Prog. Energy Combust. Sci. 32, 315. High turbulence Reynolds number. Takes arrays.
    """
    return LIFETIME * k / (dissipation + 1e-300)


def crossing_times(lifetime: float, slip: float, rms: float) -> tuple[float, float]:
    """Integral times (s) that a granule sees, along its slip and across it: it slips out of eddies, which shortens
    both.

    T_L / sqrt(1 + b^2 slip^2 / rms^2) along and with 4 b^2 across, b = 0.8: Csanady, G.T. 1963, J. Atmos. Sci. 20, 201.
    slip = |u - v| m/s of the mean air velocity, rms = sqrt(2 k / 3) m/s. T_L for both at slip 0; 0 where rms = 0.
    """
    b = EULERIAN * slip
    calm = lifetime * rms
    return calm / max(math.hypot(rms, b), 1e-300), calm / max(math.hypot(rms, 2.0 * b), 1e-300)


def langevin(z: float) -> tuple[float, float, float, float, float]:
    """A unit Ornstein-Uhlenbeck process over z integral times, exactly: (decay, end, mean, shared, own), so that

        w(z)                     = decay w(0) + end xi1
        mean of w over the step  = mean w(0) + shared xi1 + own xi2       xi1, xi2 independent standard normal

    Any z from 0 to infinity, to round-off. Uhlenbeck, G.E. & Ornstein, L.S. 1930, Phys. Rev. 36, 823; the joint law
    after Gillespie, D.T. 1996, Phys. Rev. E 54, 2084: decay = exp(-z), end^2 = 1 - exp(-2 z), mean = (1 - exp(-z)) / z,
    shared^2 = mean^2 tanh(z/2), own^2 = (2 z - 4 tanh(z/2)) / z^2.
    """
    z = max(z, 1e-300)
    x = 0.5 * z
    if x < 0.25:  # one exponential makes all, since a slab draws at every other step; no cancellation either way
        lost = -math.expm1(-z)
        decay = 1.0 - lost
    else:
        decay = math.exp(-z)
        lost = 1.0 - decay
    t = lost / (2.0 - lost)
    mean = lost / z
    if x < 1.0:  # x - tanh x without cancellation: Lambert's continued fraction of tanh
        y = x * x
        d = 3.0 + y / (5.0 + y / (7.0 + y / (9.0 + y / (11.0 + y / (13.0 + y / (15.0 + y / (17.0 + y / 19.0)))))))
        own = math.sqrt(x / (d + y))
    else:
        own = math.sqrt((1.0 - t / x) / x)
    return decay, math.sqrt(lost * (2.0 - lost)), mean, mean * math.sqrt(t), own


def brownian_diffusivity(
    diameter: Any, viscosity: float, temperature: float = 293.15, slip_correction: Any = 1.0
) -> Any:
    """Diffusivity of a granule among the air's molecules (m2/s): k_B T Cc / (3 pi mu d).

    Diameter m, dynamic viscosity Pa s, temperature K, ``slip_correction`` Cc (``drag.slip_correction``); arrays
    broadcast. Einstein, A. 1905, Ann. Phys. 322, 549; any sphere whose Re << 1.
    """
    return BOLTZMANN * temperature * slip_correction / (3.0 * math.pi * viscosity * diameter)
