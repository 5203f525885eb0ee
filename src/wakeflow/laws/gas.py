"""The air as a gas: its density, viscosity and mean free path at a temperature and a pressure.

All are 1 of the standard air's (20 C, 1 atm) there, and go from it as an ideal gas's do.
"""

from __future__ import annotations

import math

from .constants import STANDARD_AIR

TEMPERATURE = 293.15  # K, of the standard air
PRESSURE = 101325.0  # Pa, of the standard air
SUTHERLAND = 110.4  # K, of air (US Standard Atmosphere 1976)
MEAN_FREE_PATH = 0.066e-6  # m, of the standard air (Hinds, W.C. 1999, Aerosol Technology, 2nd ed., 21)
LIGHTEST_LIQUID = 40.0  # over the density of air there: liquid hydrogen's 70 kg/m3 is 58, the heaviest gas, UF6, is 12


def air_density(temperature: float, pressure: float) -> float:
    """kg/m3 of air at K and Pa, as an ideal gas: within 0.1 % at 1 atm."""
    return STANDARD_AIR[0] * (TEMPERATURE / temperature) * (pressure / PRESSURE)


def air_viscosity(temperature: float) -> float:
    """Dynamic viscosity (Pa s) of air at K, at any pressure up to some 10 bar: Sutherland, W. 1893, Philos. Mag. 36,
    507. Within 2 % from 170 to 1900 K.
    """
    warmer = temperature / TEMPERATURE
    return STANDARD_AIR[1] * warmer * math.sqrt(warmer) * (TEMPERATURE + SUTHERLAND) / (temperature + SUTHERLAND)


def mean_free_path(density: float, viscosity: float, temperature: float, pressure: float) -> float:
    """The mean free path (m) of the molecules of a gas of ``density`` (kg/m3) and dynamic ``viscosity`` (Pa s) at K and
    Pa; 0 of what is too dense to be one.

    It goes with viscosity / sqrt(density pressure), by kinetic theory and whatever the gas: Jennings, S.G. 1988,
    J. Aerosol Sci. 19, 159. Of air the same as Willeke, K. 1976, J. Aerosol Sci. 7, 381.
    """
    air = air_density(temperature, pressure)
    if density > LIGHTEST_LIQUID * air:
        return 0.0
    thinner = STANDARD_AIR[0] * PRESSURE / (density * pressure)
    return MEAN_FREE_PATH * (viscosity / STANDARD_AIR[1]) * math.sqrt(thinner)
