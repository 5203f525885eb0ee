"""The one collision function: published cases, stick and slip, conservation, and that it never makes energy."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support import DOCS, ROOT
from wakeflow.core.errors import SceneError
from wakeflow.laws.collision import ImpactModel, bounce, collide, impact, impact_models

BETA = np.pi / 4
finite = st.floats(-5, 5)
unit = st.floats(0, 1)


@pytest.mark.parametrize(
    ("restitution", "friction", "expected"), [(0.5, 0.3, (0.8925, 0.2575)), (0.1, 0.6, (0.3740, 0.0960))]
)
def test_reference_cases_of_the_derived_equation(
    restitution: float, friction: float, expected: tuple[float, float]
) -> None:
    hit = impact(BETA, 1.4, 0.3, restitution, friction)
    np.testing.assert_allclose(hit.velocity, expected, atol=5e-5)
    assert hit.tangential == pytest.approx(1.7 * (np.sin(BETA) - friction * (1 + restitution) * np.cos(BETA)))
    assert hit.normal == pytest.approx(restitution * 1.7 * np.cos(BETA))
    assert not hit.sticks
    assert np.isnan(hit.spin)


def test_the_misprinted_equation_is_not_what_is_computed() -> None:
    hit = impact(BETA, 1.4, 0.3, 0.5, 0.3)
    assert hit.tangential == pytest.approx(0.6611, abs=5e-5)
    assert 1.7 * np.sin(BETA - 0.3 * np.cos(BETA)) * 1.5 == pytest.approx(1.3831, abs=2e-4)  # makes energy


every_model = pytest.mark.parametrize("model", [impact_models[name] for name in impact_models], ids=list(impact_models))


def test_limits_of_rolling_are_the_known_ones() -> None:
    """tan(b) / (1 + R) / (1 + 1/k) at b = 45 deg, R = 0.5: a point 2/3, a sphere 4/21, a disc 2/9."""
    for name, limit in (("paper", 2 / 3), ("sphere", 0.1904762), ("disc", 0.2222222), ("tube", 1 / 3)):
        hits = impact(BETA, 1.0, 0.0, 0.5, limit * np.array([1 - 1e-6, 1 + 1e-6]), impact_models[name].inertia, 0.01)
        np.testing.assert_array_equal(hits.sticks, [False, True])


@every_model
def test_limits_of_restitution_and_friction(model: ImpactModel) -> None:
    """R = 0: nothing is left of the normal velocity, R = 1: all of it; f = 0: nothing turns, f = inf: it rolls."""
    for restitution in (0.0, 1.0):
        smooth = impact(0.9, 1.0, 0.2, restitution, 0.0, model.inertia, 1e-3)
        rough = impact(0.9, 1.0, 0.2, restitution, np.inf, model.inertia, 1e-3)
        for hit in (smooth, rough):
            assert hit.normal == pytest.approx(restitution * 1.2 * np.cos(0.9), abs=1e-15)
        assert smooth.tangential == pytest.approx(1.2 * np.sin(0.9))
        assert smooth.spin == 0.0
        rolling = 0.0 if model.inertia is None else 1.0 / (1.0 + model.inertia)
        assert rough.tangential == pytest.approx(1.2 * np.sin(0.9) * rolling, abs=1e-15)
        assert rough.tangential + (1e-3 * rough.spin if model.inertia else 0.0) == pytest.approx(0.0, abs=1e-15)


@every_model
def test_it_sticks_above_the_limit_and_rolls_from_then_on(model: ImpactModel) -> None:
    inertia = model.inertia
    limit = np.tan(BETA) / 1.5 / (1.0 + model.mobility)
    speed = 0.0 if inertia is None else 1.0 / (1.0 + inertia)
    slip = impact(BETA, 1.0, 0.0, 0.5, limit * (1 - 1e-6), inertia, 0.01)
    stick = impact(BETA, 1.0, 0.0, 0.5, np.array([limit * (1 + 1e-6), 5.0]), inertia, 0.01)
    assert not slip.sticks
    assert np.all(stick.sticks)
    np.testing.assert_allclose(stick.tangential, speed * np.sin(BETA), atol=1e-12)
    assert slip.tangential == pytest.approx(speed * np.sin(BETA), abs=1e-5)
    expected = 0.0 if inertia is None else -speed * np.sin(BETA) / 0.01  # rolling towards +x turns clockwise
    np.testing.assert_allclose(stick.spin, expected, atol=1e-9)


def test_no_approach_means_no_impact() -> None:
    hit = impact(BETA, 1.0, np.array([-1.0, -1.5]), 0.5, np.array([0.3, np.inf]), 0.4, 0.01)
    np.testing.assert_array_equal(hit.velocity, [[0.0, -1.0], [0.0, -1.0]])
    np.testing.assert_array_equal(hit.normal_impulse, 0.0)
    np.testing.assert_array_equal(hit.tangential_impulse, 0.0)
    assert not np.any(hit.sticks)


def test_impulses_are_the_changes_of_velocity() -> None:
    hit = impact(BETA, 1.4, 0.3, 0.5, 0.3)
    assert hit.normal_impulse == pytest.approx(hit.normal + 1.7 * np.cos(BETA))
    assert hit.tangential_impulse == pytest.approx(hit.tangential - 1.7 * np.sin(BETA))
    assert hit.tangential_impulse < 0


def test_arrays_broadcast() -> None:
    hit = impact(np.array([[0.3], [0.9]]), np.array([1.0, 2.0, 3.0]), 0.1, 0.5, 0.2, 0.4, 1e-3)
    assert hit.velocity.shape == (2, 3, 2)
    assert hit.sticks.shape == hit.spin.shape == (2, 3)
    one = impact(0.9, 3.0, 0.1, 0.5, 0.2, 0.4, 1e-3)
    np.testing.assert_array_equal(hit.velocity[1, 2], one.velocity)


@settings(max_examples=300, deadline=None)
@given(
    v=st.tuples(finite, finite),
    w=st.tuples(finite, finite),
    spin=st.floats(-1e3, 1e3),
    angle=st.floats(0, 6.3),
    restitution=unit,
    friction=st.floats(0, 3) | st.just(np.inf),
    mobility=st.sampled_from([impact_models[name].mobility for name in impact_models]),
)
def test_energy_never_grows_and_angular_momentum_about_the_contact_is_kept(
    v: tuple[float, float],
    w: tuple[float, float],
    spin: float,
    angle: float,
    restitution: float,
    friction: float,
    mobility: float,
) -> None:
    r, (nx, ny) = 1e-3, (np.cos(angle), np.sin(angle))
    vx, vy, after, jn, jt = collide(*v, spin, nx, ny, *w, restitution, friction, mobility, r)
    rotating = 1.0 / mobility if mobility else 0.0

    def energy(ux: float, uy: float, omega: float) -> float:
        return (ux - w[0]) ** 2 + (uy - w[1]) ** 2 + rotating * (r * omega) ** 2

    assert energy(vx, vy, after) <= energy(*v, spin) * (1 + 1e-12) + 1e-12
    before_t, after_t = (-ny * ux + nx * uy for ux, uy in (v, (vx, vy)))
    if mobility:  # (v . t) r + I omega / m; a point mass takes the whole tangential impulse and does not turn
        momentum = r * before_t + rotating * r * r * spin
        assert r * after_t + rotating * r * r * after == pytest.approx(momentum, abs=1e-14)
    else:
        assert after == spin
        assert after_t - before_t == pytest.approx(jt, abs=1e-12)
    assert abs(jt) <= min(friction, 1e300) * jn + 1e-12
    approach = (v[0] - w[0]) * nx + (v[1] - w[1]) * ny
    if approach >= 0:
        assert (vx, vy, after) == (*v, spin)
    else:
        assert (vx - w[0]) * nx + (vy - w[1]) * ny == pytest.approx(-restitution * approach, abs=1e-12)
    arm = r if mobility else 0.0
    slip_before = (v[1] - w[1]) * nx - (v[0] - w[0]) * ny - arm * spin
    slip_after = (vy - w[1]) * nx - (vx - w[0]) * ny - arm * after
    assert slip_before * slip_after >= -1e-12  # friction never reverses the contact point


@settings(max_examples=100, deadline=None)
@given(frame=st.tuples(finite, finite), v=st.tuples(finite, finite), angle=st.floats(0, 6.3), turn=st.floats(0, 6.3))
def test_every_inertial_frame_and_direction_sees_the_same(
    frame: tuple[float, float], v: tuple[float, float], angle: float, turn: float
) -> None:
    def run(boost: np.ndarray, rotation: float) -> np.ndarray:
        c, s = np.cos(rotation), np.sin(rotation)
        spun = np.array([[c, -s], [s, c]])
        n = spun @ [np.cos(angle), np.sin(angle)]
        start, wall = spun @ (np.array(v) + boost), spun @ (np.array([0.2, -0.4]) + boost)
        out = collide(*start, 30.0, *n, *wall, 0.6, 0.25, 2.5, 1e-2)
        return np.array([*(spun.T @ out[:2] - boost), out[2], out[3], out[4]])

    np.testing.assert_allclose(run(np.array(frame), turn), run(np.zeros(2), 0.0), atol=1e-11)


def test_bounce_is_the_same_collision_for_many_point_masses() -> None:
    n = np.array([np.sin(BETA), np.cos(BETA)])
    out = bounce([[0.0, -1.4]] * 3, n, [0.0, 0.3], [0.5, 0.5, 0.1], [0.3, 9.0, 0.6])
    np.testing.assert_allclose(out[0], impact(BETA, 1.4, 0.3, 0.5, 0.3).velocity)
    np.testing.assert_allclose(out[1], impact(BETA, 1.4, 0.3, 0.5, 9.0).velocity)
    np.testing.assert_allclose(out[2], [0.3740, 0.0960], atol=5e-5)


def test_the_printed_form_makes_energy_and_the_docs_show_the_table() -> None:
    command = [sys.executable, ROOT / "tests" / "proofs" / "studies", "printed_form"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout in (DOCS / "model.md").read_text()
    rows = [[float(cell) for cell in line.strip("| ").split("|")] for line in done.stdout.splitlines()[2:]]
    assert all(row[4] <= 1.0 for row in rows)  # the derived form never does
    assert [row[6] for row in rows if row[:3] == [45.0, 0.5, 0.0]] == [1.25]
    assert sum(row[6] > 1.0 for row in rows) >= 3


@pytest.mark.parametrize("angle", [60.0, -0.1, np.nan])
def test_a_slope_angle_is_in_radians(angle: float) -> None:
    with pytest.raises(SceneError, match=r"slope_angle \(rad\) = .*must be 0 to 1.5708"):
        impact(angle, 1.4, 0.0, 0.5, 0.3)
