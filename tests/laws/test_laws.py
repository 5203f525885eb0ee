"""The laws of lift, spin, turbulence and Brownian motion: published values, limits, exactness where it is claimed."""

import math
from collections.abc import Callable, Iterator
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wakeflow.laws.drag import relaxation_time, slip_correction
from wakeflow.laws.lift import lift_coefficient, magnus_factor, spin_decay, spin_rate
from wakeflow.laws.turbulence import brownian_diffusivity, crossing_times, langevin, lifetime

EXTREMES = [0.0, 5e-324, 1e-300, 1e-12, 1e-3, 0.45, 1.0, 31.7, 39.999, 40.0, 1e3, 1e7, 1e12]


# Every law at once


@pytest.mark.parametrize("law", [lift_coefficient, magnus_factor])
def test_coefficients_are_finite_and_never_negative_for_any_pair_of_reynolds_numbers(law: Callable[..., float]) -> None:
    values = np.array([[law(re, other) for other in EXTREMES] for re in EXTREMES])
    assert np.all(np.isfinite(values))
    assert np.all(values >= 0.0)


# Shear lift


def openfoam(reynolds: float, shear: float) -> float:
    """SaffmanMeiLift of OpenFOAM, written from its published formulas; it jumps at Re = 40."""
    beta = shear / (2 * reynolds)
    a = 0.3314 * math.sqrt(beta)
    f = (1 - a) * math.exp(-0.1 * reynolds) + a if reynolds < 40 else 0.0524 * math.sqrt(beta * reynolds)
    return 3 / (2 * math.pi * math.sqrt(shear)) * 6.46 * f


def test_creeping_lift_is_saffmans() -> None:
    rho, mu, d, slip, turning = 1.2, 1.8e-5, 2e-5, 1e-7, 5.0
    coefficient = lift_coefficient(rho * slip * d / mu, rho * turning * d**2 / mu)
    force = rho * math.pi / 6 * d**3 * coefficient * slip * turning
    assert force == pytest.approx(1.615 * d**2 * slip * math.sqrt(rho * mu * turning), rel=1e-3)


@pytest.mark.parametrize("beta", [0.005, 0.05, 0.4])
def test_lift_is_meis_fit_within_its_range(beta: float) -> None:
    for reynolds in np.linspace(0.1, 39.99, 30):
        shear = 2 * reynolds * beta
        assert lift_coefficient(reynolds, shear) == pytest.approx(openfoam(reynolds, shear), rel=1e-12)
    for reynolds in np.linspace(40.0, 100.0, 30):  # where ours lets the creeping part die out instead of dropping it
        shear = 2 * reynolds * beta
        saffman = 3 * 6.46 / (2 * math.pi * math.sqrt(shear))
        excess = (lift_coefficient(reynolds, shear) - openfoam(reynolds, shear)) / saffman
        assert -1e-5 < excess < 0.0184 * math.exp(-0.1 * (reynolds - 40.0)) + 1e-5


def test_lift_does_not_jump_at_re_40_and_vanishes_with_the_shear() -> None:
    assert lift_coefficient(40.0 * (1 - 1e-12), 3.0) == pytest.approx(
        lift_coefficient(40.0 * (1 + 1e-12), 3.0), rel=1e-11
    )
    forces = [shear * lift_coefficient(5.0, shear) for shear in (0.0, 1e-300, 1e-12, 1e-3, 1.0)]
    assert forces[0] == 0.0
    assert np.all(np.diff(forces) > 0.0)
    assert lift_coefficient(5.0, 0.0) == 0.0


def test_lift_far_outside_its_range_tends_to_what_is_stated() -> None:
    assert lift_coefficient(1e4, 1e12) == pytest.approx(0.114, abs=5e-4)
    assert lift_coefficient(0.0, 4.0) == pytest.approx(3 * 6.46 / (4 * math.pi), rel=1e-12)


# Magnus lift and the decay of spin


def test_magnus_lift_is_rubinow_and_kellers_in_creeping_flow() -> None:
    rho, d, spin, slip = 1.2, 1e-4, 30.0, 0.01
    volume, rho_p = math.pi / 6 * d**3, 900.0
    acceleration = 0.75 * rho / rho_p * magnus_factor(1e-9, 1e-9) * spin * slip
    assert acceleration * rho_p * volume == pytest.approx(math.pi / 8 * rho * d**3 * spin * slip, rel=1e-3)
    assert magnus_factor(0.0, 0.0) == magnus_factor(0.0, 7.0) == 1.0


@pytest.mark.parametrize("ratio", [0.0, 0.3, 2.0, 19.0])
def test_magnus_lift_is_loths_correlation(ratio: float) -> None:
    for re in (0.01, 1.0, 60.0, 1000.0, 2000.0):
        loth = 1 - (0.675 + 0.15 * (1 + math.tanh(0.28 * (ratio - 2)))) * math.tanh(0.18 * re**0.5)  # his eq. 16
        assert magnus_factor(re, ratio * re) == pytest.approx(loth, rel=1e-12)
    assert magnus_factor(1000.0, 300.0) == pytest.approx(0.24, abs=0.005)  # a granule just off a slope


def torque(spin: float, d: float, rho: float, mu: float) -> float:
    """Dennis, Singh & Ingham 1980, N m, from their coefficient C_R = 12.9 Re_r^-1/2 + 128.4 / Re_r, or 64 pi / Re_r."""
    reynolds = rho * abs(spin) * d**2 / mu
    coefficient = max(64 * math.pi, 12.9 * math.sqrt(reynolds) + 128.4) / reynolds
    return -rho / 2 * (d / 2) ** 5 * coefficient * abs(spin) * spin


@pytest.mark.parametrize("spin", [1.0, 100.0, -4000.0])
@pytest.mark.parametrize("k", [0.4, 0.5, 0.25])
def test_spin_decays_at_first_by_the_published_torque(spin: float, k: float) -> None:
    rho, mu, d, rho_p = 1.2, 1.8e-5, 3e-3, 1300.0
    inertia = k * rho_p * math.pi / 6 * d**3 * (d / 2) ** 2
    rate = torque(spin, d, rho, mu) / inertia
    step = 1e-6 * abs(spin / rate)
    after = spin_decay(spin, step, spin_rate(d, rho_p, mu, k), rho * d**2 / mu)
    assert (after - spin) / step == pytest.approx(rate, rel=2e-6)


def test_creeping_spin_relaxes_within_rho_d2_over_60_mu() -> None:
    d, rho_p, mu = 1e-4, 1500.0, 1.8e-5
    rate = spin_rate(d, rho_p, mu)
    assert rate == pytest.approx(60 * mu / (rho_p * d**2), rel=1e-15)
    assert rate * relaxation_time(d, rho_p, mu) == pytest.approx(10 / 3, rel=1e-15)
    assert spin_decay(5.0, 0.2 / rate, rate, 0.01) == pytest.approx(5.0 * math.exp(-0.2), rel=1e-15)


@pytest.mark.parametrize("spin", [-5e4, 700.0, 634.0, 100.0])
def test_spin_decay_solves_its_equation_across_the_crossover(spin: float) -> None:
    rate, per_spin = 3.0, 0.05

    def slope(_: float, w: Any) -> Any:
        reynolds = np.abs(w) * per_spin
        return -rate * np.maximum(1.0, (12.9 * np.sqrt(reynolds) + 128.4) / (64 * math.pi)) * w

    times = np.array([0.01, 0.1, 0.3, 1.0])
    truth = solve_ivp(slope, (0, 1), [spin], rtol=1e-11, atol=1e-11, t_eval=times, max_step=2e-3).y[0]
    np.testing.assert_allclose([spin_decay(spin, t, rate, per_spin) for t in times], truth, rtol=1e-8)


def test_spin_decay_is_odd_and_survives_extremes() -> None:
    assert spin_decay(-800.0, 0.1, 3.0, 0.05) == -spin_decay(800.0, 0.1, 3.0, 0.05)
    for spin in (0.0, 1e-300, 1.0, 1e12):
        assert spin_decay(spin, 0.0, 3.0, 0.05) == spin
        assert spin_decay(spin, math.inf, 3.0, 0.05) == 0.0
        values = [spin_decay(spin, t, 1e9, 1e-3) for t in (1e-300, 1e-12, 1.0, 1e300)]
        assert np.all(np.isfinite(values))
        assert np.all(np.diff(values) <= 0.0)


# Turbulence


def test_lifetime_is_the_simplified_langevin_models() -> None:
    assert lifetime(0.3, 2.0) == pytest.approx(0.15 / (0.5 + 0.75 * 2.1), rel=1e-15)
    assert lifetime(0.0, 0.0) == lifetime(0.0, 1.0) == 0.0
    assert math.isfinite(lifetime(1e-3, 0.0))


def test_slipping_shortens_what_a_granule_sees_by_csanadys_factors() -> None:
    k, slip, life = 0.3, 1.7, 0.05
    rms = math.sqrt(2 * k / 3)
    along, across = crossing_times(life, slip, rms)
    assert along == pytest.approx(life / math.sqrt(1 + 0.64 * 3 * slip**2 / (2 * k)), rel=1e-14)
    assert across == pytest.approx(life / math.sqrt(1 + 4 * 0.64 * 3 * slip**2 / (2 * k)), rel=1e-14)
    assert crossing_times(life, 0.0, rms) == (life, life)
    far = crossing_times(life, 1e9, rms)
    assert far[0] / far[1] == pytest.approx(
        2.0, rel=1e-12
    )  # longitudinal over transverse scale of isotropic turbulence
    assert far[0] * 1e9 == pytest.approx(life * rms / 0.8, rel=1e-9)  # crosses an Eulerian length
    assert crossing_times(life, 0.0, 0.0) == crossing_times(life, 3.0, 0.0) == (0.0, 0.0)


def intervals() -> Iterator[float]:
    yield from 10.0 ** np.linspace(-12, 4, 400)
    yield from (1.999, 2.0, 2.001, 1e8, 1e12)


def exact(z: float) -> tuple[float, ...]:
    """The law's coefficients in 100 digits from the moments themselves; they cancel, which is what is tested."""
    with localcontext() as context:
        context.prec = 100
        x = Decimal(z)
        e = (-x).exp()
        end = 1 - e * e
        covariance = (1 - e) ** 2 / x
        variance = (2 * x - 3 + 4 * e - e * e) / x**2
        shared = covariance / end.sqrt()
        return tuple(float(v) for v in (e, end.sqrt(), (1 - e) / x, shared, (variance - shared**2).sqrt()))


def test_langevin_is_exact_to_round_off_for_any_interval() -> None:
    for z in intervals():
        np.testing.assert_allclose(langevin(z), exact(z), rtol=5e-15 if z < 100 else 1e-12, atol=1e-300)


def test_langevin_at_its_ends() -> None:
    np.testing.assert_allclose(langevin(0.0), (1.0, 0.0, 1.0, 0.0, 0.0), atol=1e-140)
    assert langevin(math.inf) == (0.0, 1.0, 0.0, 0.0, 0.0)


# Brownian motion


def test_brownian_diffusivity_in_air() -> None:
    # Hinds, W.C. 1999, Aerosol Technology, table 7.1 (20 C), m2/s
    for diameter, published in ((1e-7, 6.9e-10), (1e-6, 2.7e-11), (1e-5, 2.4e-12)):
        ours = brownian_diffusivity(diameter, 1.825e-5, 293.15, float(slip_correction(diameter)))
        assert ours == pytest.approx(published, rel=0.03)
