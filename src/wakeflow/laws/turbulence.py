"""Turbulence: the models that OpenFOAM solves, and the dispersion of a granule as a Langevin process.

Each component of the fluctuation that the granule sees is rms = sqrt(2 k / 3) times a unit Ornstein-Uhlenbeck process
of the integral time that :func:`crossing_times` shortens from :func:`lifetime`; :func:`held` steps it.

Scalar functions of the math module, since the tracker's kernel compiles them as they are; np.vectorize takes arrays.

A model is one record, registered under OpenFOAM's keyword for it. The case template is that of USUAL; another model
brings the files in which its case differs in a folder ``turbulence-models/NAME`` of the template.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..core.registry import Registry
from .constants import C_MU
from .gas import TEMPERATURE

# -- Turbulent dispersion of a granule as a Langevin process of the fluid velocity seen --------------------------------
C0 = 5.0  # of the simplified Langevin model; chosen: amid the numbers below
LIFETIME = 1.0 / (0.5 + 0.75 * C0)  # 0.235, over k / dissipation; the geometric mean of the range below is 0.26
# 95 % of the same, measured and in use. Longest: 0.5, an eddy that is held for k / dissipation (OpenFOAM's
# stochasticDispersionRAS, read), and 0.48 by C0 = 2.1 of Minier & Peirano. 0.36 by C0 = 3.0 +- 0.5 as heat spreads in
# grid turbulence (Du, S., Sawford, B.L., Wilson, J.D. & Wilson, D.J. 1995, Phys. Fluids 7, 3083, title read); 0.32 by
# C0 = 3.5 (code_saturne 8, src/turb/cs_turbulence_model.cpp, read); 0.27 by 4 / (3 C0), C0 = 5 (Reynolds, A.M. 2000,
# Agric. For. Meteorol. 104, 107, quoted). Shortest: 2 / 14 (Mito, Y. & Hanratty, T.J. 2002, Flow Turbul. Combust. 68,
# 1, quoted), 0.15 of other programs' k-epsilon runs, and 0.14 to 0.17 as hollow glass beads spread in the grid
# turbulence, of low Reynolds number, of Snyder, W.H. & Lumley, J.L. 1971, J. Fluid Mech. 48, 41 (digitised by others)
LIFETIMES = (0.14, 0.5)
SHORTEST, DAMPED = 4.5, 21.0  # Kolmogorov's times and lengths, beside walls
EULERIAN = 0.8  # ratio of the Lagrangian to the Eulerian integral time, as in code_saturne
BOLTZMANN = 1.380649e-23  # J/K, exact


def lifetime(k: Any, dissipation: Any) -> Any:
    """Lagrangian integral time T_L (s) = k / dissipation / (1/2 + 3/4 C0), C0 = 5; 0 where k = 0.

    k m2/s2, dissipation m2/s3. Pope, S.B. 1994, Annu. Rev. Fluid Mech. 26, 23; Peirano, E., Chibbaro, S., Pozorski,
    J. & Minier, J.-P. 2006, Prog. Energy Combust. Sci. 32, 315. High turbulence Reynolds number. Takes arrays.
    """
    return LIFETIME * k / (dissipation + 1e-300)


def shortest_life(dissipation: Any, viscosity: float) -> Any:
    """Integral time (s) that eddies have at least beside a wall: 4.5 of Kolmogorov's times sqrt(nu / eps), dissipation
    m2/s3, viscosity kinematic m2/s. The form is Durbin's (1991, Theor. Comput. Fluid Dyn. 3, 1); 4.5 makes 10 nu / u*^2
    on the wall and 13 at y+ 10, as in Kallio, G.A. & Reeks, M.W. 1989, Int. J. Multiphase Flow 15, 433. Takes arrays.
    """
    return SHORTEST * (viscosity / (dissipation + 1e-300)) ** 0.5


def damping(dissipation: Any, away: Any, viscosity: float) -> Any:
    """Deviation across a wall over sqrt(2 k / 3), ``away`` (m) from it: 1 - exp(-y / (21 eta)), 0 on the wall, with
    Kolmogorov's length eta = (nu^3 / eps)^(1/4); dissipation m2/s3, viscosity kinematic m2/s. Takes arrays.

    21 is fitted to the profiles of channel flow by Dreeben, T.D. & Pope, S.B. 1997, Phys. Fluids 9, 2692 (quoted):
    within 20 % from y+ 1 to 100. The measure is that of Abe, K., Kondoh, T. & Nagano, Y. 1994, Int. J. Heat Mass
    Transfer 37, 139.
    """
    return -np.expm1(-away / DAMPED * (np.asarray(dissipation) / viscosity**3) ** 0.25)


def crossing_times(lifetime: float, slip: float, rms: float) -> tuple[float, float]:
    """Integral times (s) that a granule sees, along its slip and across it: it slips out of eddies, which shortens
    both.

    T_L / sqrt(1 + b^2 slip^2 / rms^2) along and with 4 b^2 across, b = 0.8: Csanady, G.T. 1963, J. Atmos. Sci. 20, 201.
    slip = |u - v| m/s in the mean, without what the eddies make of it, rms = sqrt(2 k / 3) m/s. T_L for both at slip 0;
    0 where rms = 0.
    """
    b2, rms2 = (EULERIAN * slip) ** 2, rms * rms
    calm = lifetime * rms
    return calm / max(math.sqrt(rms2 + b2), 1e-300), calm / max(math.sqrt(rms2 + 4.0 * b2), 1e-300)


def held(z: float) -> tuple[float, float, float]:
    """A unit process of integral time T that is held over steps of z T: (stays, fresh, size), so that from step to step

        w' = stays w + fresh xi,      seen over the step: size w',      xi standard normal

    stays = (2 - z) / (2 + z), fresh^2 = 1 - stays^2, size = 1 up to z = 2; beyond it w is drawn anew each time, and
    size^2 = 2 / z. Whatever z, the integral of its autocorrelation is T, so that tracers spread by Taylor's 2 u'^2 T t
    in the end; its autocorrelation, a straight line over each step, differs from the Ornstein-Uhlenbeck process'
    exp(-t / T) by z^2 / 8 at most (z < 2). Taylor, G.I. 1921, Proc. London Math. Soc. 20, 196.
    """
    if z >= 2.0:
        return 0.0, 1.0, math.sqrt(2.0 / z)
    per = 1.0 / (2.0 + z)
    return (2.0 - z) * per, math.sqrt(8.0 * z) * per, 1.0


def brownian_diffusivity(
    diameter: Any, viscosity: float, temperature: float = TEMPERATURE, slip_correction: Any = 1.0
) -> Any:
    """Diffusivity of a granule among the air's molecules (m2/s): k_B T Cc / (3 pi mu d).

    Diameter m, dynamic viscosity Pa s, temperature K, ``slip_correction`` Cc (``drag.slip_correction``); arrays
    broadcast. Einstein, A. 1905, Ann. Phys. 322, 549; any sphere whose Re << 1.
    """
    return BOLTZMANN * temperature * slip_correction / (3.0 * math.pi * viscosity * diameter)


# -- Turbulence models -------------------------------------------------------------------------------------------------
MIXING_LENGTH = 0.07  # of the width of the opening that air enters through: usual estimate for developed duct flow
SPANWISE = "kOmegaSSTDDES"  # the model of an airflow that is resolved in three dimensions
USUAL = "kOmegaSST"  # the model of the case template; it also represents the unknown model of a user's own case


def entering_energy(intensity: float, speed: float) -> float:
    """k (m2/s2) of air that enters at ``speed`` (m/s) with the turbulence ``intensity`` u'/U: 3/2 (I U)^2."""
    return 1.5 * (intensity * speed) ** 2


def not_carried(_k: float, _width: float) -> float:
    """What enters of a field that a model computes from the others."""
    return math.nan


@dataclass(frozen=True)
class TurbulenceField:
    """A field that a model needs in addition to U and p.

    ``name`` in OpenFOAM; ``means`` in words; its unit is m^``metres`` / s^``seconds``. ``entering``: its value (SI) in
    air that enters with k (m2/s2) through an opening of a given width (m); ``not_carried`` where the model computes the
    field from the others and nothing is transported.
    """

    name: str
    means: str
    metres: int
    seconds: int
    entering: Callable[[float, float], float] = not_carried

    @property
    def inlet(self) -> str:
        """What the case calls its value on the inlet, as inletOmega; ``inletsOmega`` are those of secondary streams."""
        return f"inlet{self.name[0].upper()}{self.name[1:]}"

    @property
    def is_energy(self) -> bool:
        """Whether it is a kinetic energy per mass, which the air's own speed limits."""
        return (self.metres, self.seconds) == (2, 2)

    def rescaled(self, speed: float, size: float) -> float:
        """The factor on the field from one flow to a similar one with ``speed`` times the speed, ``size`` the lengths.

        A quantity in m^a / s^b goes with U^b / L^(b - a).
        """
        return float(speed**self.seconds / size ** (self.seconds - self.metres))


@dataclass(frozen=True)
class Dissipation:
    """How fast k dissipates (m2/s3): ``rate`` of k (m2/s2) and the field called ``field``, arrays of one shape."""

    field: str
    rate: Callable[[Any, Any], Any]


@dataclass(frozen=True)
class TurbulenceModel:
    """A turbulence model; its ``name`` is OpenFOAM's keyword and what plan, FlowSpec and result call it.

    ``means`` in words, ``source``: where it was published. ``simulation_type`` of OpenFOAM: laminar, RAS or LES. All
    but laminar are linear eddy-viscosity models: OpenFOAM leaves 2k/3 in their p, and the reader takes it out.
    ``fields``: what a case needs in addition to U and p; ``dissipation``: how fast k dissipates. ``reynolds``: the plan
    chooses the model from the first number on and below the second (on the first body's projected width and the inlet's
    mean speed); (0, 0): never. ``correctors``: solutions of velocity and pressure in a time step; ``convection``:
    scheme of a time-resolved velocity.
    """

    name: str
    means: str
    source: str
    simulation_type: Literal["laminar", "RAS", "LES"]
    fields: tuple[TurbulenceField, ...] = ()
    dissipation: Dissipation | None = None
    reynolds: tuple[float, float] = (0.0, 0.0)
    correctors: int = 1
    convection: str = "linearUpwind grad(U)"

    @property
    def turbulent(self) -> bool:
        """Whether its airflow brings turbulence: k, and a wake whose fluctuations decay."""
        return self.simulation_type != "laminar"

    @property
    def transported(self) -> tuple[TurbulenceField, ...]:
        """The fields that air carries in through the inlet."""
        return tuple(field for field in self.fields if field.entering is not not_carried)


turbulence_models = Registry[TurbulenceModel]("turbulence model")

KINETIC_ENERGY = TurbulenceField("k", "turbulent kinetic energy", 2, 2, lambda k, _: k)
# omega = sqrt(k) / (C_mu^(1/4) l) with l = MIXING_LENGTH times the width
OMEGA = TurbulenceField(
    "omega", "specific dissipation rate", 0, 1, lambda k, width: k**0.5 / (C_MU**0.25 * MIXING_LENGTH * width)
)
NUT = TurbulenceField("nut", "eddy viscosity", 2, 1)

FROM_OMEGA = Dissipation("omega", lambda k, omega: C_MU * k * omega)  # Wilcox, D.C. 1988, AIAA J. 26, 1299
FROM_EPSILON = Dissipation("epsilon", lambda _, epsilon: epsilon)  # of the k-epsilon models: the field itself

for _model in (
    TurbulenceModel(
        name="laminar",
        means="no model: all fluctuations are resolved",
        source="the Navier-Stokes equations",
        simulation_type="laminar",
        # The shear layers of bluff bodies turn turbulent somewhere above Re 300 (a circle's wake is irregular from Re
        # 260 on: Williamson 1996, Annu. Rev. Fluid Mech. 28, 477). Chosen: a round number there.
        reynolds=(0.0, 300.0),
        # One made a square's lift 15 % and its drag 1.5 % too large at Re 100, two a cylinder's lift 2.5 to 4 %
        # (DFG 2D-2); with three it is that of five.
        correctors=3,
        # Three parts central to one of linearUpwind: on a cylinder's wake at Re 100 (DFG 2D-2, 4.4k cells) it took the
        # error of mean Cd from 5 to 2 % and that of Cl's rms from 19 to 4 %.
        convection="LUST grad(U)",
    ),
    TurbulenceModel(
        name="kOmegaSST",
        means="k-omega SST: k-omega near walls, k-epsilon away from them, with a limit on the shear stress",
        source="Menter, F.R., Kuntz, M. & Langtry, R. 2003, Turbulence, Heat and Mass Transfer 4, 625",
        simulation_type="RAS",
        fields=(KINETIC_ENERGY, OMEGA, NUT),
        dissipation=FROM_OMEGA,
        reynolds=(300.0, math.inf),
        # With one, half the Courant number moved a rhombus' Cd by 1.5 % and its lift by 2 %, at twice the cost.
        correctors=1,
        # Cells are too coarse for central differences.
        convection="linearUpwind grad(U)",
    ),
    TurbulenceModel(
        name=SPANWISE,
        means="delayed detached-eddy simulation: k-omega SST in attached layers, a subgrid model of k in the wake",
        source="Gritskevich, M.S., Garbaruk, A.V., Schuetze, J. & Menter, F.R. 2012, Flow Turbul. Combust. 88, 431",
        simulation_type="LES",
        fields=(KINETIC_ENERGY, OMEGA, NUT),
        dissipation=FROM_OMEGA,  # of the attached layers; what the wake's cells resolve is in foam.span_record
        correctors=1,
        # One part upwind to three central: linearUpwind damps the eddies that the model leaves to the cells.
        convection="LUST grad(U)",
    ),
):
    turbulence_models.add(_model.name, _model)


def model_at(reynolds: float) -> TurbulenceModel:
    """The model that the plan chooses at a Reynolds number: the first registered one whose range holds it."""
    models = (turbulence_models[name] for name in turbulence_models)
    return next(model for model in models if model.reynolds[0] <= reynolds < model.reynolds[1])


def has_no_turbulence(name: object) -> bool:
    """Whether a plan's ``turbulence`` is a model without turbulence; False for words that are no model (a user's case,
    a stream whose turbulence decays, no air at all).
    """
    return name in turbulence_models and not turbulence_models[str(name)].turbulent
