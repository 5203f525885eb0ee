"""The terms of a granule's equation of motion, by name: what each is, what it needs of the field, where it comes from.

    (1 + chi) dv/dt = c f(Re) (u - v) / tau + g (1 - rho / rho_p) - grad p / rho_p + chi Du/Dt + lift + Magnus,
    chi = rho / (2 rho_p) with added mass, else 0; u the air's mean velocity plus, where computed, its fluctuation.

The tracker computes the terms that it is given; the plan chooses them by a bound on the landing shift of each
(``planning.bounds``).
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.registry import Registry

__all__ = ["Force", "forces"]


@dataclass(frozen=True)
class Force:
    """One term: what it ``means``, its ``source``, and what it ``needs``: nothing, air, pressure or turbulence."""

    means: str
    source: str
    needs: str = "air"
    computed: bool = True  # False: only bounded


forces: Registry[Force] = Registry("force")

forces.add("drag", Force("drag of the air at the slip velocity", "laws/drag.py: a registered law for each fraction"))
forces.add("gravity", Force("weight", "g", needs="nothing"))
forces.add("buoyancy", Force("weight of the displaced air", "Archimedes; OpenFOAM's p has no hydrostatic part"))
forces.add("pressure-gradient", Force(
    "-grad p / rho_p: what presses a granule into the suction zone",
    "Maxey, M.R. & Riley, J.J. 1983, Phys. Fluids 26, 883", needs="pressure",
))  # fmt: skip
forces.add("added-mass", Force(
    "half the displaced air's mass takes part in the difference of accelerations; inside the inertia",
    "Auton, T.R., Hunt, J.C.R. & Prud'homme, M. 1988, J. Fluid Mech. 197, 241",
))  # fmt: skip
forces.add("lift", Force(
    "shear lift: across the slip in air that turns",
    "Saffman, P.G. 1965, J. Fluid Mech. 22, 385; Mei, R. 1992, Int. J. Multiphase Flow 18, 145",
))  # fmt: skip
forces.add("magnus", Force(
    "spin lift across the slip, and the air's torque on the spin",
    "Rubinow, S.I. & Keller, J.B. 1961, J. Fluid Mech. 11, 447; Loth, E. 2008, AIAA J. 46, 801",
))  # fmt: skip
forces.add("dispersion", Force(
    "the turbulent velocity that the mean field does not hold, as a Langevin process",
    "Thomson, D.J. 1987, J. Fluid Mech. 180, 529; Bocksell, T.L. & Loth, E. 2006, Int. J. Multiphase Flow 32, 1234",
    needs="turbulence",
))  # fmt: skip
forces.add("brownian", Force(
    "kicks of the air's molecules", "Einstein, A. 1905, Ann. Phys. 322, 549; Li, A. & Ahmadi, G. 1992, Aerosol Sci. "
    "Technol. 16, 209",
))  # fmt: skip
forces.add("basset-history", Force(
    "drag's memory of past slip",
    "Basset, A.B. 1888, Phil. Trans. R. Soc. A 179, 43; Mei, R. & Adrian, R.J. 1992, J. Fluid Mech. 237, 323",
    computed=False,
))  # fmt: skip
