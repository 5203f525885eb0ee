"""The jet of air that granules drive: closed forms of the integral model, and its balances."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wakeflow.laws.driven_jet import ENTRAINMENT, DrivenJet, driven_jet, width_after

PUSH = 8.0  # m2/s2: force per metre of fall over the air's density


def jet(width: float, entrainment: float = ENTRAINMENT.value, count: int = 400) -> DrivenJet:
    fall = np.linspace(0.0, 3.0, count + 1)
    return driven_jet(fall, PUSH * fall, width, entrainment)


def test_under_a_uniform_force_a_thin_curtain_s_air_has_one_speed_and_a_wedge_s_width() -> None:
    found = jet(1e-9)
    assert found.speed[1:] == pytest.approx(math.sqrt(PUSH / ENTRAINMENT.value), rel=1e-6)
    assert found.width[1:] == pytest.approx([width_after(fall) for fall in found.fall[1:]], rel=1e-6)
    assert found.flux[0] == found.momentum[0] == found.speed[0] == found.width[0] == 0.0


def test_within_a_wide_curtain_air_is_accelerated_as_by_its_force_alone() -> None:
    """Bernoulli on the axis: u^2 / 2 = force per volume times the fall, over the density."""
    found = jet(5.0)
    assert found.speed == pytest.approx(np.sqrt(2.0 * PUSH / 5.0 * found.fall), rel=1e-9)
    assert found.width[1:] == pytest.approx(5.0 / math.sqrt(2.0 * math.pi))


def test_a_jet_without_further_force_keeps_its_momentum_and_slows_with_the_root_of_its_way() -> None:
    fall = np.linspace(0.0, 50.0, 5001)
    found = driven_jet(fall, np.minimum(PUSH * fall, 0.1), 0.01)
    far = fall > 10.0
    speed, slope = found.speed[far], np.polyfit(np.log(fall[far]), np.log(found.speed[far]), 1)[0]
    assert np.all(np.diff(speed) < 0.0)
    assert slope == pytest.approx(-0.5, abs=0.01)
    assert np.gradient(found.width, fall)[far] == pytest.approx(
        4.0 * ENTRAINMENT.value / math.sqrt(2.0 * math.pi), 0.02
    )


@pytest.mark.parametrize("width", [0.01, 0.3])
def test_its_profile_carries_its_flux_and_its_momentum(width: float) -> None:
    found, across, wide = jet(width), np.linspace(-3.0, 3.0, 6001), slice(100, None)
    speed = np.gradient(found.stream_function(across), across, axis=1)[wide]
    assert np.trapezoid(speed, across) == pytest.approx(found.flux[wide], rel=1e-3)
    assert np.trapezoid(speed**2, across) == pytest.approx(found.momentum[wide], rel=1e-3)
    assert speed.max(axis=1) == pytest.approx(found.speed[wide], rel=1e-3)


def test_its_eddies_mix_as_a_plane_jet_s() -> None:
    found = jet(0.02)
    k, dissipation = found.turbulence(np.array([0.0, 0.05]))
    assert np.sqrt(2.0 / 3.0 * k[-1, 0]) / found.speed[-1] == pytest.approx(0.235, abs=0.005)
    viscosity = 0.09 * k[-1] ** 2 / dissipation[-1]
    assert viscosity == pytest.approx(0.0315 * found.speed[-1] * math.sqrt(math.log(2.0)) * found.width[-1])
    assert not k[0].any()
    assert not dissipation[0].any()


def test_the_more_it_draws_in_the_slower_and_wider_it_is() -> None:
    calm, keen = jet(0.01, 0.075), jet(0.01, 0.15)
    assert keen.speed[-1] / calm.speed[-1] == pytest.approx(2.0**-0.5, rel=1e-3)
    assert keen.width[-1] / calm.width[-1] == pytest.approx(2.0, rel=1e-3)
