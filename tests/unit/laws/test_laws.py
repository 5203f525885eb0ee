"""The laws of lift, spin, turbulence and Brownian motion: published values, limits, exactness where it is claimed."""

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import wakeflow as wf
from support import FLOOR, G
from wakeflow.core.errors import SceneError
from wakeflow.flight import Body, Fate, Granules, Motion, track
from wakeflow.laws.drag import drag_laws, relaxation_time, slip_correction
from wakeflow.laws.lift import lift_coefficient, magnus_factor, spin_decay, spin_rate
from wakeflow.laws.restitution import restitution_laws, restitution_table
from wakeflow.laws.size import sizes
from wakeflow.laws.turbulence import brownian_diffusivity, crossing_times, held, lifetime
from wakeflow.scene import Scene

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
    assert lifetime(0.3, 2.0) == pytest.approx(0.15 / (0.5 + 0.75 * 5.0), rel=1e-15)
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


def test_a_fluctuation_that_is_held_has_unit_variance_and_the_integral_time() -> None:
    """Of autocorrelations stays^n at whole steps, straight between them: size^2 z (1 + stays) / (1 - stays) / 2 = 1."""
    for z in intervals():
        stays, fresh, size = held(z)
        assert stays**2 + fresh**2 == pytest.approx(1.0, rel=1e-15)
        less = 1.0 - stays if z > 0.1 else fresh**2 / (1.0 + stays)  # cancels
        assert size**2 * z * (1.0 + stays) / less / 2.0 == pytest.approx(1.0, rel=1e-12)


def test_it_forgets_as_the_ornstein_uhlenbeck_process_does() -> None:
    for z in (0.05, 0.1, 0.5, 1.0, 1.9):
        lag = np.linspace(0.0, 20.0 / z, 4001)
        whole, part = np.floor(lag), lag - np.floor(lag)
        found = held(z)[0] ** whole * (1.0 - part * (1.0 - held(z)[0]))
        assert np.abs(found - np.exp(-z * lag)).max() < z * z / 8


def test_a_held_fluctuation_at_its_ends() -> None:
    assert held(0.0) == (1.0, 0.0, 1.0)
    assert held(math.inf) == (0.0, 1.0, 0.0)


# Brownian motion


def test_brownian_diffusivity_in_air() -> None:
    # Hinds, W.C. 1999, Aerosol Technology, table 7.1 (20 C), m2/s
    for diameter, published in ((1e-7, 6.9e-10), (1e-6, 2.7e-11), (1e-5, 2.4e-12)):
        ours = brownian_diffusivity(diameter, 1.825e-5, 293.15, float(slip_correction(diameter)))
        assert ours == pytest.approx(published, rel=0.03)


LAWS = [
    wf.Restitution("constant", value=0.5),
    wf.Restitution("power", value=0.5, at=1.0),
    wf.Restitution("power", value=0.3, at=2.0, exponent=1.0, most=0.8),
    wf.Restitution("elastic-plastic", value=0.6, at=1.4),
    wf.Restitution("viscoelastic", value=0.9, at=1.0),
    wf.Restitution("viscoelastic", value=0.2, at=3.0),
    wf.Restitution("table", speeds=[0.3, 1.0, 4.0], values=[0.62, 0.5, 0.31]),
]
every_law = pytest.mark.parametrize("law", LAWS, ids=repr)


def test_every_registered_law_is_tried() -> None:
    assert {law.law for law in LAWS} == set(restitution_laws)


@every_law
def test_a_law_is_a_restitution_that_falls_with_the_speed_through_the_value_given(law: wf.Restitution) -> None:
    speeds = np.concatenate([[0.0, 1e-300], np.logspace(-12, 12, 2000)])
    e = law(speeds)
    assert np.all((e >= 0.0) & (e <= 1.0))
    assert np.all(np.diff(e) <= 1e-15)
    given = law.parameters
    if "at" in given:
        assert law(given["at"]) == pytest.approx(given["value"], abs=1e-12)


@every_law
def test_the_table_is_the_law_also_at_its_kinks(law: wf.Restitution) -> None:
    cells = restitution_table(law)
    kinks = np.array(law.kinks)
    speeds = np.concatenate([np.logspace(-7.99, 2.99, 5001), kinks, kinks * (1 - 1e-6), kinks * (1 + 1e-6)])
    y = np.log10(speeds)
    cell = np.searchsorted(cells[:, 0], y, side="right") - 1
    w = (y - cells[cell, 0]) * cells[cell, 1]
    table = sum(cells[cell, 2 + i] * w**i for i in range(4))
    np.testing.assert_allclose(table, law(speeds), atol=1e-7)


def test_the_viscoelastic_law_is_the_contact_integrated() -> None:
    """Hertz with dissipation, d'' = -d^1.5 - b sqrt(d) d', until the force is gone; b grows as v^1/5 with the speed."""

    def bounced(b: float) -> float:
        def force_gone(t: float, y: Any) -> float:
            return y[0] + b * y[1]

        force_gone.terminal, force_gone.direction = True, -1  # type: ignore[attr-defined]
        root = lambda d: np.sqrt(max(d, 0.0))  # noqa: E731
        run = solve_ivp(
            lambda t, y: [y[1], -root(y[0]) * (y[0] + b * y[1])],
            (0.0, 100.0), [1e-14, 1.0], events=force_gone, rtol=1e-11, atol=1e-14,
        )  # fmt: skip
        return float(-run.y_events[0][0][1])

    law = wf.Restitution("viscoelastic", value=bounced(0.1), at=1.0)  # 0.893
    for b, accuracy in ((0.01, 2e-5), (0.2, 3e-4), (0.6, 3e-3), (3.0, 9e-3)):
        assert law((b / 0.1) ** 5) == pytest.approx(bounced(b), abs=accuracy)


def test_the_elastic_plastic_law_is_its_energy_balance() -> None:
    """Hertz up to the yield, then the force grows linearly; the unloading is Hertz' on the flattened contact.

    In units of the yield point, at the indentation 1 + s: F = 1 + 1.5 s, work 0.4 + s + 0.75 s^2, given back
    0.4 F^2 / sqrt(1 + s); the speed is sqrt(work / 0.4) yield speeds.
    """
    s = np.logspace(-2, 4, 20)
    work = 0.4 + s + 0.75 * s**2
    e = np.sqrt(0.4 * (1 + 1.5 * s) ** 2 / np.sqrt(1 + s) / work)
    speed = np.sqrt(work / 0.4)
    law = wf.Restitution("elastic-plastic", value=float(e[7]), at=float(speed[7]), most=1.0)
    np.testing.assert_allclose(law(speed), e, rtol=1e-12)
    assert law(0.999) == pytest.approx(1.0, abs=1e-15)
    assert law(1e6) * 1e6**0.25 == pytest.approx(1.185, abs=1e-3)  # far above the yield: v^-1/4


@pytest.mark.parametrize(
    ("law", "given", "message"),
    [
        ("power", {"value": 0.5}, "lacks at"),
        ("power", {"value": 0.5, "at": 1.0, "speeds": [1.0]}, "has no speeds"),
        ("powr", {}, "did you mean 'power'"),
        ("power", {"value": 0.5, "at": 0.0}, "at = 0"),
        ("power", {"value": 0.5, "at": 1.0, "most": 0.4}, "value = 0.5, allowed 0.001 to 0.4"),
        ("constant", {"value": 1.1}, "value = 1.1"),
        ("table", {"speeds": [1.0, 1.0], "values": [0.5, 0.5]}, "must be positive and rise"),
        ("table", {"speeds": [1.0], "values": [0.5, 0.5]}, "1 speeds and 2 values"),
    ],
)
def test_a_wrong_law_says_what_is_wrong(law: str, given: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        wf.Restitution(law, **given)


@every_law
def test_walls_throw_back_by_the_law_of_the_speed_into_them(law: wf.Restitution) -> None:
    speeds = np.array([1e-3, 0.05, 0.3, 1.0, 3.0, 20.0])
    up = np.column_stack([np.linspace(-0.5, 0.5, 6), np.full(6, 2e-3)])
    grains = Granules(up, np.column_stack([np.full(6, 0.2), -speeds]), 2e-3, 1000.0, restitution=law, friction=0.0)
    far = {"until": 3.0, "gravity": (0.0, 0.0), "lines": [np.array([[-9.0, 4e-3], [9.0, 4e-3]])]}
    tracks = track(None, grains, bodies=[FLOOR], **far)
    np.testing.assert_allclose(tracks.velocity[:, 1], law(speeds) * speeds, rtol=1e-6)
    np.testing.assert_allclose(tracks.velocity[:, 0], 0.2)
    own = track(None, grains, bodies=[Body(FLOOR, restitution=0.25)], **far)  # the body's own number wins
    np.testing.assert_allclose(own.velocity[:, 1], 0.25 * speeds)


def test_a_slope_that_moves_and_the_impact_law_agree() -> None:
    law, b, lift = wf.Restitution("power", value=0.4, at=1.0), 0.6, 0.3
    wedge = np.array([[0.0, 0.0], [-np.cos(b), np.sin(b)], [-np.cos(b), 0.0]])
    place = wedge[1] / 2 + 2e-3 * np.array([np.sin(b), np.cos(b)])
    grains = Granules([place], [[0.0, -1.2]], 2e-3, 1000.0, restitution=law, friction=0.2, inertia=0.4)
    body = Body(wedge, motion=Motion((0.0, lift / 1e-3), 1e-3 / (2 * np.pi)))  # moves up at a constant 0.3 m/s
    line = np.array([[-2.0, place[1] + 2e-3], [2.0, place[1] + 2e-3]])
    tracks = track(None, grains, until=0.02, bodies=[body], gravity=(0.0, 0.0), lines=[line])
    expected = wf.impact(b, 1.2, lift, law, 0.2, 0.4, 1e-3)
    np.testing.assert_allclose(tracks.velocity[0], expected.velocity, rtol=1e-6)
    assert tracks.spin[0] == pytest.approx(float(expected.spin), rel=1e-6)
    assert expected.restitution == pytest.approx(float(law(1.5 * np.cos(b))))


@every_law
def test_what_bounces_on_a_floor_comes_to_rest(law: wf.Restitution) -> None:
    grains = Granules([[0.0, 0.501]], [[0.0, 0.0]], 2e-3, 1000.0, restitution=law)
    tracks = track(None, grains, until=99.0, bodies=[FLOOR], length=0.05, tolerance=1e-4)
    assert tracks.fate[0] == Fate.RESTING
    assert tracks.impacts[0] < 2000
    np.testing.assert_allclose(tracks.position[0], [0.0, 1e-3], atol=1e-12)


def test_a_wall_that_takes_no_energy_ends_at_the_hard_stop_not_never() -> None:
    law = wf.Restitution("power", value=0.5, at=1.0, most=1.0)  # elastic below 62.5 mm/s
    grains = Granules([[0.0, 0.011]], [[0.0, 0.0]], 2e-3, 1000.0, restitution=law)
    tracks = track(None, grains, until=1e9, bodies=[FLOOR])
    assert tracks.fate[0] == Fate.STOPPED
    assert 0.5 * tracks.velocity[0] @ tracks.velocity[0] + G * (tracks.position[0, 1] - 1e-3) <= 0.5 * 0.0626**2


SIEVES = {"diameters": [1e-5, 4e-5, 8e-5, 2e-4, 4e-4], "passing": [0.0, 0.25, 0.6, 0.6, 1.0]}
PARAMETERS = {
    "single": {"diameter": 1e-3},
    "uniform": {"low": 1e-3, "high": 2e-3},
    "normal": {"mean": 1e-3, "std": 2e-4},
    "lognormal": {"median": 1e-3, "geometric_std": 1.5},
    "rosin-rammler": {"scale": 4e-5, "spread": 1.4},
    "table": SIEVES,
}
EVENLY = (np.arange(200_000) + 0.5) / 200_000


@pytest.mark.parametrize("name", list(sizes))
def test_quantiles_increase_and_stay_positive(name: str) -> None:
    diameters = sizes[name](np.linspace(0.001, 0.999, 999), **PARAMETERS[name])
    assert np.all(diameters > 0)
    assert np.all(np.diff(diameters) >= 0)
    far = sizes[name](np.array([1e-12, 1.0 - 1e-12]), **PARAMETERS[name])
    assert np.all(np.isfinite(far) & (far > 0))


def test_moments_are_the_ones_asked_for() -> None:
    normal = sizes["normal"](EVENLY, mean=1e-3, std=2e-4)
    assert normal.mean() == pytest.approx(1e-3, rel=1e-4)
    assert normal.std() == pytest.approx(2e-4, rel=1e-3)
    log = np.log(sizes["lognormal"](EVENLY, median=1e-3, geometric_std=1.5))
    assert np.exp(log.mean()) == pytest.approx(1e-3, rel=1e-6)
    assert np.exp(log.std()) == pytest.approx(1.5, rel=1e-3)
    with pytest.raises(SceneError, match="below zero"):
        sizes["normal"](EVENLY, mean=1e-3, std=1e-3)


def test_rosin_rammler_passes_63_percent_at_its_scale_and_has_weibulls_mean() -> None:
    quantile = sizes["rosin-rammler"]
    assert quantile(1 - math.exp(-1), scale=4e-5, spread=2.7, low=0.0) == pytest.approx(4e-5, rel=1e-14)
    for spread in (0.8, 1.0, 2.5):
        mean = quantile(EVENLY, scale=1e-3, spread=spread, low=0.0).mean()
        assert mean == pytest.approx(1e-3 * math.gamma(1 + 1 / spread), rel=2e-4)


def test_cut_rosin_rammler_keeps_to_its_cuts_and_to_its_shape() -> None:
    low, high = 1e-5, 6e-5
    d = sizes["rosin-rammler"](EVENLY, scale=4e-5, spread=1.4, low=low, high=high)
    assert low <= d.min()
    assert d.max() <= high
    passing = 1 - np.exp(-((np.array([low, 3e-5, high]) / 4e-5) ** 1.4))
    wanted = (passing[1] - passing[0]) / (passing[2] - passing[0])
    assert np.mean(d < 3e-5) == pytest.approx(wanted, abs=1e-5)
    tail = sizes["rosin-rammler"](1 - 1e-9, scale=4e-5, spread=0.3, low=0.0)  # uncut it has its whole tail
    assert tail == pytest.approx(4e-5 * (9 * math.log(10)) ** (1 / 0.3), rel=1e-6)
    assert sizes["rosin-rammler"](1e-12, scale=4e-5, spread=0.5) == pytest.approx(1e-9, rel=1e-6)  # no atoms
    ends = sizes["rosin-rammler"](np.array([0.0, 1.0]), scale=4e-5, spread=1.4, low=low, high=high)
    np.testing.assert_allclose(ends, [low, high], rtol=1e-12)


def test_sieve_table_gives_back_its_mass_fractions() -> None:
    d = sizes["table"](EVENLY, **SIEVES)
    for sieve, passing in zip(SIEVES["diameters"], SIEVES["passing"], strict=True):
        assert np.mean(d <= sieve * (1 + 1e-12)) == pytest.approx(passing, abs=1e-5)
    assert not np.any((d > 8.0001e-5) & (d < 1.9999e-4))  # a plateau: nothing between those sieves
    assert np.mean(d < 2e-5) == pytest.approx(0.125, abs=1e-5)  # half of a step in log d
    np.testing.assert_allclose(sizes["table"](np.array([0.0, 1.0]), **SIEVES), [1e-5, 4e-4], rtol=1e-12)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ({"distribution": "rosin-rammler", "scale": "40 um"}, "lacks spread"),
        ({"distribution": "rosin-rammler", "scale": "40 um", "spread": 0}, "spread"),
        ({"distribution": "rosin-rammler", "scale": 4e-5, "spread": 1, "low": 2e-5, "high": 1e-5}, "must be below"),
        ({"distribution": "rosin-rammler", "scale": 4e-5, "spread": 40, "low": 2e-4}, "widen them"),
        ({"distribution": "rosin-rammler", "scale": 1e-9, "spread": 50, "low": 0.05}, "widen them"),
        ({"distribution": "rosin-rammler", "scale": 4e-5, "spread": 50, "high": 2e-5}, "widen them"),
        ({"distribution": "table", "diameters": ["40 um"], "passing": [1.0]}, "two at least"),
        ({"distribution": "table", "diameters": [1e-5, 2e-5], "passing": [0, 0.5, 1]}, "must pair up"),
        ({"distribution": "table", "diameters": [2e-5, 1e-5], "passing": [0, 1]}, "diameters must increase"),
        ({"distribution": "table", "diameters": [1e-5, 1e-5, 2e-5], "passing": [0, 0.5, 1]}, "must increase"),
        ({"distribution": "table", "diameters": [1e-5, 2e-5, 3e-5], "passing": [0, 0.7, 0.6]}, "must begin with 0"),
        ({"distribution": "table", "diameters": [1e-5, 2e-5], "passing": [0.1, 1]}, "must begin with 0"),
        (
            {"distribution": "table", "diameters": [1e-5, 2e-5, 3e-5, 4e-5], "passing": [0, 0.7, 0.6, 1]},
            "must not decrease",
        ),
        ({"distribution": "table", "diameters": [1e-5, 2e-5], "passing": [0, 100]}, "passing"),
    ],
)
def test_scenes_refuse_what_is_no_distribution(rhombus: Scene, size: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        rhombus.replace({"fraction.dust.size": size})


def test_percent_are_not_taken_for_fractions() -> None:
    with pytest.raises(SceneError, match="fractions, not percent"):
        sizes["table"](EVENLY, diameters=[1e-5, 2e-5], passing=[0.0, 100.0])


def test_scenes_take_units_and_lists_and_save_them(rhombus: Scene, tmp_path: Path) -> None:
    sieves = {"distribution": "table", "diameters": ["10 um", "40 um", 1e-4], "passing": [0, 0.4, 1]}
    scene = rhombus.replace(
        {
            "fraction.dust.size": {"distribution": "rosin-rammler", "scale": "40 um", "spread": 1.4, "high": "0.2 mm"},
            "fraction.chaff.size": sieves,
        }
    )
    scene.save(tmp_path / "scene.toml")
    again = Scene.load(tmp_path / "scene.toml")
    p = np.linspace(0.01, 0.99, 50)
    dust = sizes["rosin-rammler"](p, scale=4e-5, spread=1.4, high=2e-4)
    np.testing.assert_allclose(again.fraction["dust"].diameters(p), dust, rtol=1e-12)
    chaff = sizes["table"](p, diameters=[1e-5, 4e-5, 1e-4], passing=[0, 0.4, 1])
    np.testing.assert_allclose(again.fraction["chaff"].diameters(p), chaff, rtol=1e-12)
    wider = scene.replace({"fraction.dust.size.spread": 2.0}).fraction["dust"].diameters(p)
    np.testing.assert_allclose(wider, sizes["rosin-rammler"](p, scale=4e-5, spread=2.0, high=2e-4), rtol=1e-12)


def test_the_schema_names_every_distribution_and_the_drag_laws() -> None:
    text = json.dumps(Scene.model_json_schema(by_alias=True))
    for name in (*sizes, *drag_laws):
        assert name in text


def test_a_fraction_chooses_its_drag_law(rhombus: Scene) -> None:
    assert rhombus.fraction["wheat"].drag_law == "brown-lawler"
    assert rhombus.replace({"fraction.wheat.sphericity": 0.8}).fraction["wheat"].drag_law == "haider-levenspiel"
    chosen = rhombus.replace({"fraction.wheat.sphericity": 0.8, "fraction.wheat.drag": "ganser"})
    assert chosen.fraction["wheat"].drag_law == "ganser"
    assert rhombus.replace({"fraction.wheat.drag": "putnam"}).fraction["wheat"].drag_law == "putnam"
    with pytest.raises(SceneError, match=r"unknown drag law 'gansr'.*did you mean"):
        rhombus.replace({"fraction.wheat.drag": "gansr"})
    with pytest.raises(SceneError, match="'ganser' needs a sphericity"):
        rhombus.replace({"fraction.wheat.drag": "ganser"})
    with pytest.raises(SceneError, match="'putnam' has no sphericity"):
        rhombus.replace({"fraction.wheat.sphericity": 0.8, "fraction.wheat.drag": "putnam"})
