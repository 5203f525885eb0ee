"""Brownian motion: kicks of the air's molecules."""

from __future__ import annotations

import math

from ..drag import slip_correction
from ..turbulence import brownian_diffusivity
from .record import AirProperties, Force, Grains, Slots
from .scales import Bound, FlightScales
from .turbulent_dispersion import TWO_SIGMA

__all__ = ["BROWNIAN_MOTION"]


def _shift(flight: FlightScales) -> float:
    slips = float(slip_correction(flight.diameter))
    diffusivity = brownian_diffusivity(flight.diameter, flight.viscosity, slip_correction=slips)
    return flight.widths(TWO_SIGMA * math.sqrt(2.0 * diffusivity * flight.whole))


def _constants(grains: Grains, air: AirProperties) -> Slots:
    """DIFFUSIVITY (m2/s) among the air's molecules."""
    slips = slip_correction(grains.diameter)
    return {"DIFFUSIVITY": brownian_diffusivity(grains.diameter, air.viscosity, slip_correction=slips)}


BROWNIAN_MOTION = Force(
    name="brownian",
    means="kicks of the air's molecules",
    source="Einstein, A. 1905, Ann. Phys. 322, 549; Li, A. & Ahmadi, G. 1992, Aerosol Sci. Technol. 16, 209",
    random=True,
    bound=Bound(_shift, "2 sqrt(2 D T), D = k_B T Cc / (3 pi mu d)"),
    constants=_constants,
)
