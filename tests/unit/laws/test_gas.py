"""The air as a gas."""

from __future__ import annotations

import pytest

from wakeflow.laws.constants import STANDARD_AIR
from wakeflow.laws.gas import MEAN_FREE_PATH, PRESSURE, TEMPERATURE, air_density, air_viscosity, mean_free_path

HOT = 673.15  # K, 400 C


def test_air_of_20_degrees_and_one_atmosphere_is_the_standard_air() -> None:
    assert (air_density(TEMPERATURE, PRESSURE), air_viscosity(TEMPERATURE)) == STANDARD_AIR
    assert mean_free_path(*STANDARD_AIR, TEMPERATURE, PRESSURE) == MEAN_FREE_PATH


def test_hot_air_is_that_of_tables() -> None:
    """Incropera & DeWitt, table A.4, at 400 and 700 K, 1 atm."""
    assert air_density(400.0, PRESSURE) == pytest.approx(0.8711, rel=0.015)
    assert air_density(700.0, PRESSURE) == pytest.approx(0.4975, rel=0.015)
    assert air_viscosity(400.0) == pytest.approx(2.301e-5, rel=0.01)
    assert air_viscosity(700.0) == pytest.approx(3.388e-5, rel=0.015)


@pytest.mark.parametrize(("temperature", "pressure"), [(HOT, PRESSURE), (TEMPERATURE, 2e4), (250.0, 5e5)])
def test_the_path_in_air_is_willekes(temperature: float, pressure: float) -> None:
    """l0 (T / T0)^2 (T0 + S) / (T + S) p0 / p"""
    warmer = temperature / TEMPERATURE
    expected = MEAN_FREE_PATH * warmer**2 * (TEMPERATURE + 110.4) / (temperature + 110.4) * PRESSURE / pressure
    own = air_density(temperature, pressure), air_viscosity(temperature)
    assert mean_free_path(*own, temperature, pressure) == pytest.approx(expected, rel=1e-12)


def test_the_path_in_other_gases_is_that_of_their_density_and_viscosity_and_none_in_a_liquid() -> None:
    """Helium at 20 C: 0.19 um (CRC Handbook, 0.1936 um at 1 bar and 25 C)."""
    assert mean_free_path(0.1664, 1.96e-5, TEMPERATURE, PRESSURE) == pytest.approx(0.19e-6, rel=0.03)
    assert mean_free_path(998.2, 1.002e-3, TEMPERATURE, PRESSURE) == 0.0
