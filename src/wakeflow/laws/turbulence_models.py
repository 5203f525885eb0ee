"""Turbulence models: what OpenFOAM solves for beside velocity and pressure, and what the program knows of it.

A model is one record, registered under OpenFOAM's keyword for it. The case template is that of USUAL; another model
brings the files in which its case differs in a folder ``turbulence-models/NAME`` of the template.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from ..core.registry import Registry
from .constants import C_MU

__all__ = [
    "FROM_EPSILON",
    "FROM_OMEGA",
    "KINETIC_ENERGY",
    "MIXING_LENGTH",
    "NUT",
    "OMEGA",
    "SPANWISE",
    "USUAL",
    "Dissipation",
    "TurbulenceField",
    "TurbulenceModel",
    "entering_energy",
    "has_no_turbulence",
    "model_at",
    "turbulence_models",
]

MIXING_LENGTH = 0.07  # of the width of the opening that air enters through: usual estimate for developed duct flow
SPANWISE = "kOmegaSSTDDES"  # the model of an airflow that is resolved in three dimensions
USUAL = "kOmegaSST"  # the model of the case template; it also stands for the unknown model of a user's own case


def entering_energy(intensity: float, speed: float) -> float:
    """k (m2/s2) of air that enters at ``speed`` (m/s) with the turbulence ``intensity`` u'/U: 3/2 (I U)^2."""
    return 1.5 * (intensity * speed) ** 2


@dataclass(frozen=True)
class TurbulenceField:
    """A field that a model needs beside U and p.

    ``name`` in OpenFOAM; ``means`` in words; its unit is m^``metres`` / s^``seconds``. ``entering``: its value (SI) in
    air that enters with k (m2/s2) through an opening of a given width (m); None where the model computes the field from
    the others and nothing is transported.
    """

    name: str
    means: str
    metres: int
    seconds: int
    entering: Callable[[float, float], float] | None = None

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
    ``fields``: what a case needs beside U and p; ``dissipation``: how fast k dissipates. ``reynolds``: the plan chooses
    the model from the first number on and below the second (on the first body's projected width and the inlet's mean
    speed); (0, 0): never. ``correctors``: solutions of velocity and pressure in a time step; ``convection``: scheme of
    a time-resolved velocity.
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
        return tuple(field for field in self.fields if field.entering is not None)


turbulence_models = Registry[TurbulenceModel]("turbulence model")

KINETIC_ENERGY = TurbulenceField("k", "turbulent kinetic energy", 2, 2, lambda k, _: k)
# omega = sqrt(k) / (C_mu^(1/4) l) with l = MIXING_LENGTH times the width
OMEGA = TurbulenceField(
    "omega", "specific dissipation rate", 0, 1, lambda k, width: k**0.5 / (C_MU**0.25 * MIXING_LENGTH * width)
)
NUT = TurbulenceField("nut", "eddy viscosity", 2, 1)

FROM_OMEGA = Dissipation("omega", lambda k, omega: C_MU * k * omega)  # Wilcox, D.C. 1988, AIAA J. 26, 1299
FROM_EPSILON = Dissipation("epsilon", lambda _, epsilon: epsilon)  # of the k-epsilon models: the field itself

turbulence_models.add(
    "laminar",
    TurbulenceModel(
        name="laminar",
        means="no model: all fluctuations are resolved",
        source="the Navier-Stokes equations",
        simulation_type="laminar",
        # The shear layers of bluff bodies turn turbulent somewhere above Re 300 (a circle's wake is irregular from Re
        # 260 on: Williamson 1996, Annu. Rev. Fluid Mech. 28, 477). Chosen: a round number there.
        reynolds=(0.0, 300.0),
        # One made a square's lift 15 % and its drag 1.5 % too large at Re 100.
        correctors=2,
        # Three parts central to one of linearUpwind: on a cylinder's wake at Re 100 (DFG 2D-2, 4.4k cells) it took the
        # error of mean Cd from 5 to 2 % and that of Cl's rms from 19 to 4 %.
        convection="LUST grad(U)",
    ),
)
turbulence_models.add(
    "kOmegaSST",
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
)
turbulence_models.add(
    SPANWISE,
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
)


def model_at(reynolds: float) -> TurbulenceModel:
    """The model that the plan chooses at a Reynolds number: the first registered one whose range holds it."""
    models = (turbulence_models[name] for name in turbulence_models)
    return next(model for model in models if model.reynolds[0] <= reynolds < model.reynolds[1])


def has_no_turbulence(name: str | None) -> bool:
    """Whether a plan's ``turbulence`` is a model without turbulence; False for words that are no model (a user's case,
    a stream whose turbulence decays, no air at all).
    """
    return name in turbulence_models and not turbulence_models[str(name)].turbulent
