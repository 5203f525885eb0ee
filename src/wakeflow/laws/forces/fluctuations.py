"""Turbulent dispersion and Brownian motion."""

from __future__ import annotations

import math

from ..drag import slip_correction
from ..turbulence import brownian_diffusivity, crossing_times
from .force import AirProperties, Bound, FlightScales, Force, Grains, Slots

# -- Dispersion --------------------------------------------------------------------------------------------------------
WAKE_INTENSITY = 0.3  # u' / U behind a bluff body; chosen: an estimate, and the bound's reason says so
EDDY = 0.2  # body widths: integral length of the turbulence in the wake; chosen likewise
TWO_SIGMA = 2.0  # standard deviations that hold 95 % of a normal shift
EFFORT = 1.0  # measured on cases/rhombus.toml: a flight takes 1.4 (dust) to 1.8 times (wheat) as long


def eddy_way(flight: FlightScales) -> float:
    """How far (m) eddies carry what follows them while it is near the body, 95 % of it: 2 sqrt(2 u'^2 T_L near)."""
    strength = max(flight.intensity, WAKE_INTENSITY) if flight.turbulent else flight.intensity
    rms = strength * flight.air_speed
    if rms == 0.0:
        return 0.0
    lifetime = crossing_times(EDDY * flight.width / rms, flight.typical_slip, rms)[0]
    return TWO_SIGMA * math.sqrt(2.0 * rms**2 * lifetime * flight.near)


def _shift(flight: FlightScales) -> float:
    return eddy_way(flight) * flight.reach(flight.time) / flight.tau / flight.width


def _constants(_grains: Grains, _air: AirProperties) -> Slots:
    """DISPERSION: 1, a flag; deviation and lifetime of the eddies come with the field."""
    return {"DISPERSION": 1.0}


DISPERSION = Force(
    name="dispersion",
    means="the turbulent velocity that the mean field does not hold, as a Langevin process",
    source="Thomson, D.J. 1987, J. Fluid Mech. 180, 529; Bocksell, T.L. & Loth, E. 2006, Int. J. Multiphase Flow 32, "
    "1234",
    needs="turbulence",
    random=True,
    effort=EFFORT,
    bound=Bound(
        _shift, "an estimate: 2 sqrt(2 u'^2 T_L T) at u' = 0.3 U near the body, less for granules slow to follow"
    ),
    constants=_constants,
)


# -- Brownian motion ---------------------------------------------------------------------------------------------------
def _brownian_motion_shift(flight: FlightScales) -> float:
    slips = float(slip_correction(flight.diameter, flight.mean_free_path))
    diffusivity = brownian_diffusivity(flight.diameter, flight.viscosity, flight.temperature, slips)
    return flight.widths(TWO_SIGMA * math.sqrt(2.0 * diffusivity * flight.whole))


def _brownian_motion_constants(grains: Grains, air: AirProperties) -> Slots:
    """DIFFUSIVITY (m2/s) among the air's molecules."""
    slips = slip_correction(grains.diameter, air.mean_free_path)
    return {"DIFFUSIVITY": brownian_diffusivity(grains.diameter, air.viscosity, air.temperature, slips)}


BROWNIAN_MOTION = Force(
    name="brownian",
    means="kicks of the air's molecules",
    source="Einstein, A. 1905, Ann. Phys. 322, 549; Li, A. & Ahmadi, G. 1992, Aerosol Sci. Technol. 16, 209",
    random=True,
    bound=Bound(_brownian_motion_shift, "2 sqrt(2 D T), D = k_B T Cc / (3 pi mu d)"),
    constants=_brownian_motion_constants,
)
