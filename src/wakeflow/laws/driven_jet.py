"""The air that a curtain of granules drives where it was at rest: a plane turbulent jet that is pushed all the way.

Integral model of a jet whose velocity is u = u_m exp(-(x / b)^2) across. At a fall s below the curtain's beginning,
with the flux q = int u dx and the momentum m = int u^2 dx, a force F(s) per metre of fall on air of density rho,

    dm/ds = F / rho,    dq/ds = 2 a m / q,    u_m = sqrt(2) m / q,    b = q^2 / (sqrt(2 pi) m)

The entrainment coefficient a is that of a top-hat profile, of speed m / q: 0.11 +- 15 % in plane plumes (Richardson &
Hunt 2022, J. Fluid Mech. 934), which buoyancy pushes as the granules do; 0.075 in a plane jet pushed at its beginning
alone (half width 0.1 of the way: Pope 2000, Turbulent Flows, 5.4). The jet is no narrower than the curtain: there
u_m^2 = 2 m / w, as a force alone accelerates air on the axis of a uniform curtain of width w. Below, under a uniform
force, u_m = sqrt(F / (rho a)) for good and b = 2 a s / sqrt(2 pi).

Its turbulence is that of a plane jet far from its beginning: k of 0.083 u_m^2 on the axis (rms of the three components
0.27, 0.21 and 0.21 u_m: Gutmark & Wygnanski 1976, J. Fluid Mech. 73, 465), across as the velocity; eddy viscosity
0.0315 u_m times the half width sqrt(ln 2) b (Pope 2000, Turbulent Flows, 5.4), the dissipation 0.09 k^2 over it.

Range: a jet that is narrow against the channel and lets the air beside it come as it likes; granules that fill little
of the volume and fall straight down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number
from .constants import C_MU

Array = NDArray[np.float64]
ENTRAINMENT = Number(0.11, 0.075, 0.15)  # of a plume; from a plane jet's to well above the measured 0.13; chosen
ENERGY = 0.083  # k on the axis over u_m^2
EDDY_VISCOSITY = 0.0315 * math.sqrt(math.log(2.0))  # over u_m b


@dataclass(frozen=True)
class DrivenJet:
    """A jet after each ``fall`` (n,) m: ``flux`` (n,) m2/s and ``momentum`` (n,) m3/s2; nothing where it begins."""

    fall: Array
    flux: Array
    momentum: Array

    @property
    def speed(self) -> Array:
        """The speed on the axis (n,) m/s."""
        return math.sqrt(2.0) * _over(self.momentum, self.flux)

    @property
    def width(self) -> Array:
        """b (n,) m, where the speed is 1/e of that on the axis."""
        return _over(self.flux**2, math.sqrt(2.0 * math.pi) * self.momentum)

    def stream_function(self, across: Array) -> Array:
        """Half of the flux between -x and x (n, k) m2/s, of places ``across`` (k,) m from the axis."""
        from scipy.special import erf

        half: Array = 0.5 * self.flux[:, None] * erf(_over(across[None], self.width[:, None]))
        return half

    def turbulence(self, across: Array) -> tuple[Array, Array]:
        """k (n, k) m2/s2 and its dissipation (n, k) m2/s3 at places ``across`` (k,) m from the axis."""
        speed, width = self.speed[:, None], self.width[:, None]
        k = ENERGY * speed**2 * np.exp(-(_over(across[None], width) ** 2))
        return k, _over(C_MU * k**2, EDDY_VISCOSITY * speed * width)


def width_after(fall: float) -> float:
    """b (m) of a jet under a uniform force below a thin curtain, after a ``fall`` (m)."""
    return 2.0 * ENTRAINMENT.value * fall / math.sqrt(2.0 * math.pi)


def driven_jet(fall: Array, push: Array, width: float, entrainment: float = ENTRAINMENT.value) -> DrivenJet:
    """The jet at ``fall`` (n,) m, increasing from 0, below a curtain of ``width`` (m) that has given the air ``push``
    (n,) m3/s2 down to there: the force above over the air's density, not negative, 0 at first and linear in between.
    """
    gathered = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * np.diff(fall))])
    least = width * push  # sqrt(2 pi) b m, with b that of the curtain: w / sqrt(2 pi)
    grown = 4.0 * entrainment * gathered
    squared = grown + np.maximum.accumulate(least - grown)  # what entrains, from where it was last as narrow as that
    return DrivenJet(fall, np.sqrt(squared), push)


def _over(above: Array, below: Array) -> Array:
    """The quotient, 0 where there is nothing to divide by."""
    shape = np.broadcast_shapes(np.shape(above), np.shape(below))
    return np.divide(above, below, out=np.zeros(shape), where=np.broadcast_to(below != 0.0, shape))
