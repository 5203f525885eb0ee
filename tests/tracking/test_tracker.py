"""The tracker in the air: exact where it can be, third order elsewhere, honest about its tolerance, and never lost."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial import Delaunay
from scipy.special import lambertw

from support import DENSITY, VISCOSITY, G, field_of, shaken_mesh, with_tau
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.laws.drag import drag_laws
from wakeflow.tracking import Collisions, Fate, Granules, Tracks, track


def still(points: np.ndarray) -> np.ndarray:
    return np.zeros_like(points)


# -- exact problems ---------------------------------------------


def test_ballistic_flight_in_a_vacuum_is_exact() -> None:
    rng = np.random.default_rng(0)
    x, v = rng.normal(size=(50, 2)), rng.normal(size=(50, 2))
    tracks = track(None, Granules(x, v, diameter=1e-3, density=1000), until=0.7, gravity=(1.0, -G))
    np.testing.assert_allclose(tracks.position, x + 0.7 * v + 0.245 * np.array([1.0, -G]), atol=1e-14)
    np.testing.assert_allclose(tracks.velocity, v + 0.7 * np.array([1.0, -G]), atol=1e-14)
    assert np.all(tracks.fate == Fate.AIRBORNE)
    assert np.all(tracks.time == 0.7)
    assert np.all(tracks.steps == 1)


@pytest.mark.parametrize("cells", [1, 30])
def test_stokes_settling_and_the_projectile_are_exact_on_any_mesh(cells: int) -> None:
    field = field_of(still, cells)
    tau = 0.2
    tracks = track(field, with_tau(tau, [[-0.1, -0.2]], [[2.0, 3.0]]), until=0.3, drag="stokes")
    decay = 1 - np.exp(-0.3 / tau)
    x, y = 2 * tau * decay, (3 + G * tau) * tau * decay - G * tau * 0.3
    np.testing.assert_allclose(tracks.position, [[x - 0.1, y - 0.2]], atol=1e-13)
    np.testing.assert_allclose(tracks.velocity, [[2 * (1 - decay), 3 - (3 + G * tau) * decay]], atol=1e-12)


def test_settling_matches_the_published_numbers() -> None:
    points, cells = shaken_mesh(3, -1.0, 1.0)
    field = FlowField.from_arrays(points, cells, still(points), density=1.204, viscosity=1.825e-5)
    grains = Granules([[0.0, 0.0]], [[0.0, 0.0]], diameter=50e-6, density=1500)
    tracks = track(field, grains, until=0.01, drag="stokes")
    assert -tracks.velocity[0, 1] == pytest.approx(0.06535013, abs=6e-9)
    assert -tracks.position[0, 1] == pytest.approx(3.738570e-4, abs=6e-11)


def test_projectile_lands_where_lamberts_function_says() -> None:
    tau, u, w = 0.2, 2.0, 3.0
    a = (w + G * tau) / (G * tau)
    time = tau * (a + float(lambertw(-a * np.exp(-a)).real))
    floor = np.array([[-5.0, -1e-13], [5.0, -1e-13]])  # just below the start, which lies on no line
    field = field_of(still, 12, -2.0, 2.0)
    tracks = track(field, with_tau(tau, [[0.0, 0.0]], [[u, w]]), until=9.0, drag="stokes", lines=[floor])
    assert tracks.fate[0] == Fate.BINNED
    assert tracks.line[0] == 0
    assert tracks.time[0] == pytest.approx(time, abs=1e-11)
    assert tracks.position[0, 0] == pytest.approx(0.3585501, abs=6e-8)
    assert tracks.position[0, 0] == pytest.approx(u * tau * (1 - np.exp(-time / tau)), abs=1e-11)


def test_drag_at_high_reynolds_number_follows_the_quadratic_law() -> None:
    """Putnam's law has a constant coefficient above Re 1000: v = v_t tanh(g t / v_t) from Re 1000 on."""
    d, rho_p = 0.05, 500.0
    terminal = np.sqrt(4 * d * G * rho_p / (3 * 0.424 * DENSITY))
    start = 1.05 * 1000 * VISCOSITY / (DENSITY * d)
    t0 = terminal / G * np.arctanh(start / terminal)
    field = field_of(still, 6, -10.0, 10.0)
    grains = Granules([[0.1, 5.0]], [[0.0, -start]], diameter=d, density=rho_p)
    tracks = track(field, grains, until=1.0, drag="putnam", tolerance=1e-9)
    late = terminal * np.tanh(G * (1.0 + t0) / terminal)
    drop = terminal**2 / G * np.log(np.cosh(G * (1 + t0) / terminal) / np.cosh(G * t0 / terminal))
    assert -tracks.velocity[0, 1] == pytest.approx(late, rel=1e-8)
    assert 5.0 - tracks.position[0, 1] == pytest.approx(drop, abs=1e-8)


def test_a_granule_slows_down_as_the_published_example_does() -> None:
    """Sphere of 1 mm, 2200 kg/m3, thrown down at 30 m/s in air (the fluids package's own example, other drag law)."""
    points, cells = shaken_mesh(8, -15.0, 15.0)
    field = FlowField.from_arrays(points, cells, still(points), density=1.2, viscosity=1.78e-5)
    grains = Granules([[0.0, 0.0]], [[0.0, -30.0]], diameter=1e-3, density=2200)
    tracks = track(field, grains, until=0.5, forces=("drag", "gravity", "buoyancy"), tolerance=1e-9)
    assert -tracks.velocity[0, 1] == pytest.approx(9.68647, rel=0.02)
    assert -tracks.position[0, 1] == pytest.approx(7.82945, rel=0.02)


def test_buoyancy_and_pressure_gradient_have_their_signs_and_sizes() -> None:
    field = field_of(still, 6, pressure=shaken_mesh(6, -1.0, 1.0)[0] @ [12.0, -5.0])
    grains = Granules([[0.0, 0.0]], [[0.0, 0.0]], diameter=1e-3, density=2.4)
    tracks = track(field, grains, until=0.1, forces=("gravity", "buoyancy", "pressure-gradient"))
    np.testing.assert_allclose(tracks.velocity, [[-12 / 2.4 * 0.1, (-G * 0.5 + 5 / 2.4) * 0.1]], atol=1e-12)
    plain = track(field, grains, until=0.1, forces=("gravity",))
    np.testing.assert_allclose(plain.velocity, [[0.0, -G * 0.1]], atol=1e-14)


def test_drag_scale_multiplies_the_drag() -> None:
    field = field_of(still)
    a = track(field, with_tau(0.1, [[0.0, 0.0]], [[1.0, 0.0]], drag_scale=2.0), until=0.2, drag="stokes")
    b = track(field, with_tau(0.05, [[0.0, 0.0]], [[1.0, 0.0]]), until=0.2, drag="stokes")
    np.testing.assert_allclose(a.position, b.position, atol=1e-14)


def test_sphericity_enters_granule_by_granule() -> None:
    field = field_of(still)
    phi = np.array([1.0, 0.5, 0.8, 0.5])
    grains = Granules(np.zeros((4, 2)), np.tile([3.0, 0.0], (4, 1)), diameter=1e-3, density=500, sphericity=phi)
    together = track(field, grains, until=0.1, drag="haider-levenspiel")
    for i in range(4):
        alone = track(field, grains[i : i + 1], until=0.1, drag="haider-levenspiel")
        np.testing.assert_array_equal(alone.position[0], together.position[i])
    assert together.position[1, 0] < together.position[2, 0] < together.position[0, 0]


AFFINE = {
    "rotation": np.array([[0.0, -5.0], [5.0, 0.0]]),
    "stagnation": np.array([[-5.0, 0.0], [0.0, 5.0]]),
    "shear": np.array([[0.0, 5.0], [0.0, 0.0]]),
}


def affine_error(name: str, tau: float, cells: int, tolerance: float, march: bool = True) -> tuple[float, int]:
    """Largest coordinate error after 0.15 s against the matrix exponential, and the steps taken."""
    a = AFFINE[name]
    x, v, end = np.array([0.3, 0.13]), np.array([0.5, -0.4]), 0.15
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [a / tau, -np.eye(2) / tau]])
    exact = (expm(system * end) @ np.concatenate([x, v]))[:2]
    field = field_of(lambda p: p @ a.T, cells)
    grains = with_tau(tau, [x], [v])
    tracks = track(field, grains, until=end, drag="stokes", forces=("drag",), tolerance=tolerance, march=march)
    return float(np.abs(tracks.position[0] - exact).max()), int(tracks.steps[0])


@pytest.mark.parametrize("tau", [1e-6, 1e-2, 1e-1, 3.0])
@pytest.mark.parametrize("name", list(AFFINE))
@pytest.mark.parametrize("cells", [4, 40])
def test_landing_error_stays_within_the_tolerance_in_affine_flow(name: str, tau: float, cells: int) -> None:
    for tolerance in (1e-4, 1e-6, 1e-8):
        assert affine_error(name, tau, cells, tolerance)[0] < tolerance


@pytest.mark.parametrize("tau", [1e-6, 1e-2, 1e-1])
@pytest.mark.parametrize("name", ["rotation", "stagnation"])
@pytest.mark.parametrize("cells", [4, 40])
def test_third_order_in_every_regime_faces_or_not(name: str, tau: float, cells: int) -> None:
    (coarse, few), (fine, many) = (affine_error(name, tau, cells, tolerance, march=False) for tolerance in (1e-7, 1e-9))
    assert np.log(coarse / fine) / np.log(many / few) > 2.7


@pytest.mark.parametrize("s", [0.01, 0.05, 0.1, 0.5, 1.0, 2.0])
def test_growth_rate_in_solid_rotation(s: float) -> None:
    """Spiral of an inertial granule: lambda = (-1 + sqrt(1 + 4 i S)) / (2 tau), S = Omega tau."""
    omega = 2.0
    root = (-1 + np.sqrt(1 + 4j * s)) / (2 * s)  # over Omega
    field = field_of(lambda p: omega * np.stack([-p[:, 1], p[:, 0]], axis=1), 8)
    z, w = 0.1 + 0j, 0.1 * root * omega
    grains = with_tau(s / omega, [[z.real, z.imag]], [[w.real, w.imag]])
    tracks = track(field, grains, until=1.5, drag="stokes", forces=("drag",), tolerance=1e-9)
    end = complex(*tracks.position[0])
    assert np.log(end / z) / (1.5 * omega) == pytest.approx(root, abs=1e-7)


@pytest.mark.parametrize(("stokes", "crosses"), [(0.20, False), (0.24, False), (0.30, True), (0.40, True)])
def test_granules_cross_a_stagnation_line_above_stokes_one_quarter(stokes: float, crosses: bool) -> None:
    a = 2.0
    field = field_of(lambda p: p * [a, -a], 10)
    grains = with_tau(stokes / a, [[0.0, 0.9]], [[0.0, -0.9 * a]])
    tracks = track(field, grains, until=12.0, drag="stokes", forces=("drag",), tolerance=1e-9, record=True)
    assert bool(np.any(tracks.path(0)[1][:, 1] < -1e-6)) == crosses


# -- nonlinear drag in curved fields, judged by scipy on the same interpolant -------------------------------


def swirl(points: np.ndarray) -> np.ndarray:
    """A divergence-free cellular flow with a mean downward stream."""
    k = np.pi
    x, y = points.T
    return 2 * np.stack([np.sin(k * x) * np.cos(k * y), -0.8 - np.cos(k * x) * np.sin(k * y)], axis=1)


def judge(field: FlowField, grains: Granules, end: float, law: str, stiff: bool, t_max_step: float) -> np.ndarray:
    """End position of one granule by scipy with tight tolerances, on the tracker's own interpolant."""
    factor = drag_laws[law].factor
    d, rho_p = float(grains.diameter[0]), float(grains.density[0])
    tau = rho_p * d**2 / (18 * VISCOSITY)
    place = [int(field.locate(grains.position)[0])]

    def air(x: np.ndarray, t: float) -> np.ndarray:
        weight = field.barycentric(np.array(place), x[None])[0]
        while weight.min() < 0:
            onward = int(field.neighbours[place[0], weight.argmin()])
            if onward < 0:
                break
            place[0] = onward
            weight = field.barycentric(np.array(place), x[None])[0]
        i, j, w = field.at_time(t)
        corner = field.triangles[place[0]]
        if field.times is None:
            return weight @ field.velocity[corner]
        return weight @ ((1 - w) * field.velocity[i][corner] + w * field.velocity[j][corner])

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        slip = air(z[:2], t) - z[2:]
        f = float(factor(np.array([DENSITY * np.hypot(*slip) * d / VISCOSITY]), 1.0)[0])
        return np.concatenate([z[2:], f * slip / tau + [0.0, -G]])

    start = np.concatenate([grains.position[0], grains.velocity[0]])
    method = "Radau" if stiff else "DOP853"
    out = solve_ivp(rate, (0, end), start, method=method, rtol=1e-10, atol=1e-13, max_step=t_max_step)
    assert out.success
    return out.y[:2, -1]


@pytest.mark.parametrize(
    ("diameter", "end", "stiff"), [(4e-3, 0.3, False), (3e-4, 0.3, False), (3e-5, 0.1, True), (5e-6, 0.05, True)]
)
def test_tolerance_is_honest_with_nonlinear_drag_in_a_curved_field(diameter: float, end: float, stiff: bool) -> None:
    field = field_of(swirl, 16)
    grains = Granules([[0.23, 0.71]], [[0.8, -0.3]], diameter=diameter, density=900)
    exact = judge(field, grains, end, "brown-lawler", stiff, 5e-3)
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7):
        tracks = track(field, grains, until=end, tolerance=tolerance)
        errors.append(float(np.abs(tracks.position[0] - exact).max()))
        assert errors[-1] < tolerance, errors
    assert errors[2] < 0.05 * max(errors[0], 1e-6), errors  # it falls


def test_snapshots_in_time_are_followed_to_the_tolerance() -> None:
    points, cells = shaken_mesh(8, -1.0, 1.0)
    times = np.array([0.0, 0.03, 0.08, 0.11])
    values = np.stack([swirl(points) * (1 + 0.5 * np.sin(40 * t)) for t in times])
    field = FlowField.from_arrays(points, cells, values, times=times, period=0.13, density=DENSITY, viscosity=VISCOSITY)
    for diameter, stiff in ((1e-3, False), (3e-5, True)):
        grains = Granules([[0.23, 0.71]], [[0.8, -0.3]], diameter=diameter, density=900)
        exact = judge(field, grains, 0.29, "brown-lawler", stiff, 2e-3)
        tracks = track(field, grains, until=0.29, tolerance=1e-7)
        np.testing.assert_allclose(tracks.position[0], exact, atol=1e-7)


def test_oscillating_uniform_flow_is_followed_in_amplitude_and_phase() -> None:
    omega, tau, u = 20.0, 0.04, 0.3
    times = np.linspace(0, 2 * np.pi / omega, 401)[:-1]
    points, cells = shaken_mesh(2, -1.0, 1.0)
    values = np.zeros((400, len(points), 2))
    values[..., 0] = u * np.sin(omega * times)[:, None]
    field = FlowField.from_arrays(
        points, cells, values, times=times, period=2 * np.pi / omega, density=DENSITY, viscosity=VISCOSITY
    )
    end = 1.0
    tracks = track(field, with_tau(tau, [[0.0, 0.0]], [[0.0, 0.0]]), until=end, drag="stokes", forces=("drag",))
    amplitude, lag = u / np.hypot(1, omega * tau), np.arctan(omega * tau)
    expected = amplitude * (np.sin(omega * end - lag) + np.sin(lag) * np.exp(-end / tau))
    assert tracks.velocity[0, 0] == pytest.approx(expected, abs=2e-5)  # snapshots 1/400 of a period apart


def test_birth_time_is_the_phase_of_the_field() -> None:
    points, cells = shaken_mesh(3, -1.0, 1.0)
    values = np.stack([swirl(points), 0.2 * swirl(points), 0.7 * swirl(points)])
    field = FlowField.from_arrays(points, cells, values, times=[0.0, 0.1, 0.2], period=0.3)
    now = with_tau(0.01, [[0.2, 0.3]], [[0.0, 0.0]], time=0.05)
    later = now.replace(time=0.05 + 7 * 0.3)
    a, b = track(field, now, until=0.35), track(field, later, until=0.35 + 7 * 0.3)
    np.testing.assert_allclose(a.position, b.position, atol=1e-11)


# -- limits and cost ---------------------------------------------


@pytest.mark.parametrize("law", ["stokes", "brown-lawler"])
def test_cost_is_bounded_from_dust_to_stone(law: str) -> None:
    field = field_of(swirl, 30)
    rng = np.random.default_rng(2)
    x = np.stack([rng.uniform(-0.6, 0.6, 60), np.full(60, 0.9)], axis=1)
    steps = {}
    for tau in 10.0 ** np.arange(-9, 4):
        # at least as fast as the flow, else the lightest stay and the heaviest leave before anything happens
        tracks = track(field, with_tau(tau, x, np.tile([0.3, -3.0], (60, 1))), until=1.0, drag=law, tolerance=1e-5)
        assert np.all(np.isfinite(tracks.position))
        assert np.all(np.isin(tracks.fate, [Fate.ESCAPED, Fate.AIRBORNE]))
        length = 3.0 * tracks.time  # path, roughly: the cost compared is per metre
        steps[tau] = float(np.mean(tracks.steps / length))
    transit = steps[1.0]
    assert max(steps.values()) <= 3 * transit, steps


@pytest.mark.parametrize("tau", [1e-3, 1e-4, 1e-5])
def test_dust_drifts_by_tau_times_g_minus_the_airs_acceleration(tau: float) -> None:
    """The slow manifold v = u + tau (g - Du/Dt) + O(tau^2), in plane strain where Du/Dt = a^2 x is affine as well."""
    a = 3.0
    field = field_of(lambda p: p * [a, -a], 5)
    x = np.array([0.2, 0.4])
    v = x * [a, -a] + tau * (np.array([0.0, -G]) - a * a * x)
    tracks = track(field, with_tau(tau, [x], [v]), until=0.2, drag="stokes", tolerance=1e-10)
    exponent = np.array([a, -a]) - tau * a * a
    shift = np.array([0.0, -G * tau])
    limit = (x + shift / exponent) * np.exp(exponent * 0.2) - shift / exponent
    assert np.abs(tracks.position[0] - limit).max() < 30 * tau**2


def test_extreme_relaxation_times_are_numbers() -> None:
    field = field_of(swirl, 5)
    grains = Granules(
        np.tile([0.1, 0.2], (6, 1)),
        np.tile([1.0, 1.0], (6, 1)),
        diameter=[1e-12, 1e-9, 1e-6, 1.0, 1e3, 1e6],
        density=[1e-3, 1e5, 1.0, 1e5, 1e-3, 1e9],
    )
    tracks = track(field, grains, until=2.0)
    assert np.all(np.isfinite(tracks.position))
    assert np.all(np.isin(tracks.fate, [Fate.ESCAPED, Fate.AIRBORNE]))


# -- geometry ---------------------------------------------


def test_mirrored_starts_in_a_mirrored_field_end_mirrored() -> None:
    points, cells = shaken_mesh(10, 0.0, 1.0)
    x, y = points.T
    half = FlowField.from_arrays(
        points, cells, np.stack([np.sin(np.pi * x) * np.cos(y), -2 - x**2], axis=1), pressure=np.cos(2 * x) * y
    )
    whole = half.mirrored()
    rng = np.random.default_rng(3)
    start, speed = (
        np.stack([rng.uniform(0.05, 0.6, 100), rng.uniform(0.6, 0.9, 100)], axis=1),
        rng.normal(size=(100, 2)),
    )
    forces = ("drag", "gravity", "pressure-gradient")
    right = track(whole, Granules(start, speed, diameter=5e-4, density=800), until=2.0, forces=forces)
    left = track(
        whole, Granules(start * [-1, 1], speed * [-1, 1], diameter=5e-4, density=800), until=2.0, forces=forces
    )
    np.testing.assert_allclose(left.position * [-1, 1], right.position, atol=1e-10)
    np.testing.assert_array_equal(left.fate, right.fate)


def test_tracks_end_on_the_boundary_exactly_and_on_lines_that_lie_there() -> None:
    field = field_of(lambda p: np.tile([0.0, -2.0], (len(p), 1)), 15)
    x = np.linspace(-0.95, 0.95, 400)
    grains = Granules(np.stack([x, np.full(400, 0.5)], axis=1), np.zeros((400, 2)), diameter=1e-3, density=1000)
    floor = np.array([[-0.5, -1.0], [0.5, -1.0]])
    tracks = track(field, grains, until=9.0, lines=[floor - np.array([0.0, 7.0]), floor])
    np.testing.assert_allclose(tracks.position[:, 1], -1.0, atol=1e-14)
    np.testing.assert_allclose(tracks.position[:, 0], x, atol=1e-12)
    inside = np.abs(x) < 0.5
    np.testing.assert_array_equal(tracks.fate, np.where(inside, Fate.BINNED, Fate.ESCAPED))
    np.testing.assert_array_equal(tracks.line, np.where(inside, 1, -1))


def test_the_first_of_several_lines_counts_and_polylines_bend() -> None:
    vee = np.array([[-2.0, 0.0], [0.0, -1.0], [2.0, 0.0]])
    low = np.array([[-3.0, -1.5], [3.0, -1.5]])
    x = np.array([-1.0, 0.0, 1.0, 2.5])
    grains = Granules(np.stack([x, np.full(4, 1.0)], axis=1), np.zeros((4, 2)), diameter=1e-3, density=1000)
    tracks = track(None, grains, until=9.0, lines=[low, vee])
    np.testing.assert_array_equal(tracks.line, [1, 1, 1, 0])
    np.testing.assert_allclose(tracks.position[:, 1], [-0.5, -1.0, -0.5, -1.5], atol=1e-12)
    np.testing.assert_allclose(tracks.time, np.sqrt(2 * (1 - tracks.position[:, 1]) / G), atol=1e-12)


def test_starts_on_nodes_edges_and_along_edges_get_through() -> None:
    line = np.linspace(-1, 1, 9)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    cells = Delaunay(points).simplices
    field = FlowField.from_arrays(points, cells, np.tile([0.0, -1.0], (len(points), 1)))
    middle = 0.5 * (points[cells[:, 0]] + points[cells[:, 1]])
    start = np.concatenate([points, middle])
    for speed in ([0.0, -1.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0], [0.0, 0.0]):
        grains = Granules(start, np.tile(speed, (len(start), 1)), diameter=1e-3, density=1000)
        tracks = track(field, grains, until=5.0)
        assert np.all(tracks.fate == Fate.ESCAPED)
        assert tracks.steps.max() < 200


def test_uniform_tracers_stay_uniform() -> None:
    """Weak inertia in a divergence-free cellular flow that does not leave the box: counts in boxes stay Poisson."""
    line = np.linspace(0, 1, 65)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    x, y = points.T
    psi = np.sin(2 * np.pi * x) * np.sin(2 * np.pi * y) / (2 * np.pi)
    del psi
    velocity = np.stack(
        [np.sin(2 * np.pi * x) * np.cos(2 * np.pi * y), -np.cos(2 * np.pi * x) * np.sin(2 * np.pi * y)], axis=1
    )
    field = FlowField.from_arrays(points, Delaunay(points).simplices, velocity, density=DENSITY, viscosity=VISCOSITY)
    side = 64
    grid = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2) + 0.5) / side
    jitter = np.random.default_rng(5).uniform(-0.5, 0.5, grid.shape) / side
    grains = with_tau(1e-8, grid + jitter, field.sample(grid + jitter)[0])
    tracks = track(field, grains, until=1.0, drag="stokes", forces=("drag",), tolerance=1e-5)
    assert np.all(tracks.fate == Fate.AIRBORNE)
    count, _, _ = np.histogram2d(*tracks.position.T, bins=8, range=[[0, 1], [0, 1]])
    expected = side * side / 64
    assert np.sum((count - expected) ** 2 / expected) < 100  # chi-square, 63 degrees: 99.8 % point 104 if independent


# -- input, output, threads ---------------------------------------------


def crowd(n: int = 700) -> tuple[FlowField, Granules]:
    rng = np.random.default_rng(7)
    grains = Granules(
        rng.uniform(-0.9, 0.9, (n, 2)), rng.normal(size=(n, 2)), diameter=10.0 ** rng.uniform(-6, -2.3, n), density=900
    )
    return field_of(swirl, 12), grains


@pytest.mark.parametrize("workers", [2, 5])
def test_results_are_bit_identical_for_any_number_of_threads(workers: int) -> None:
    field, grains = crowd()
    one, many = (track(field, grains, until=1.0, workers=w) for w in (1, workers))
    for name in ("position", "velocity", "time", "fate", "steps", "impacts", "line"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


def test_results_do_not_depend_on_the_company() -> None:
    field, grains = crowd()
    whole = track(field, grains, until=1.0)
    some = track(field, grains[100:140], until=1.0)
    np.testing.assert_array_equal(some.position, whole.position[100:140])


def test_every_granule_has_one_fate() -> None:
    field, grains = crowd()
    tracks = track(field, grains, until=1.0)
    counts = tracks.counts()
    assert sum(counts.values()) == len(grains) == len(tracks)
    assert counts[Fate.STOPPED] == 0
    assert all(fate.advice for fate in Fate)


def test_progress_reaches_the_total() -> None:
    field, grains = crowd()
    seen: list[tuple[int, int]] = []
    track(field, grains, until=0.1, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (len(grains), len(grains))
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_recorded_paths_begin_and_end_where_the_track_does_and_are_bounded() -> None:
    field, grains = crowd(30)
    tracks = track(field, grains, until=1.0, tolerance=1e-9, record=True)
    plain = track(field, grains, until=1.0, tolerance=1e-9)
    np.testing.assert_array_equal(plain.position, tracks.position)
    for i in range(30):
        t, x, v = tracks.path(i)
        assert len(t) == len(x) == len(v) <= 1024
        assert np.all(np.diff(t) >= 0)
        np.testing.assert_array_equal(x[0], grains.position[i])
        np.testing.assert_array_equal(x[-1], tracks.position[i])
        np.testing.assert_array_equal(v[-1], tracks.velocity[i])
    with pytest.raises(SceneError, match="record=True"):
        plain.path(0)


def test_no_granules_no_trouble() -> None:
    tracks = track(None, Granules(np.zeros((0, 2)), np.zeros((0, 2)), diameter=1e-3, density=1.0), until=1.0)
    assert isinstance(tracks, Tracks)
    assert len(tracks) == 0


def test_born_outside_the_mesh_escapes_with_no_step() -> None:
    tracks = track(field_of(still), Granules([[3.0, 0.0]], [[0, 0]], diameter=1e-3, density=1000), until=1.0)
    assert tracks.fate[0] == Fate.ESCAPED
    assert tracks.steps[0] == 0
    np.testing.assert_array_equal(tracks.position, [[3.0, 0.0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": [[0, 0], [np.nan, 0]]}, r"position: 1 of 2 must be finite, first \[nan  0.\] at index 1"),
        ({"velocity": [[0, np.inf], [0, 0]]}, "velocity: 1 of 2 must be finite"),
        ({"diameter": [1e-3, 0.0]}, "diameter: 1 of 2 must be positive, first 0.0 at index 1"),
        ({"density": -1.0}, "density: 2 of 2 must be positive"),
        ({"restitution": 1.5}, "restitution: 2 of 2 must be 0 to 1"),
        ({"sphericity": 0.0}, "sphericity"),
        ({"inertia": 0.0}, "inertia"),
        ({"diameter": [1.0, 2.0, 3.0]}, r"diameter: shape \(3,\) does not fit \(2,\)"),
        ({"position": [0.0, 0.0]}, r"expected \(n, 2\)"),
    ],
)
def test_bad_granules_are_named(changes: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "position": np.zeros((2, 2)),
        "velocity": np.zeros((2, 2)),
        "diameter": 1.0,
        "density": 1.0,
    }
    with pytest.raises(SceneError, match=message):
        Granules(**(good | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"forces": ("drag", "lifft")}, r"unknown force 'lifft'; did you mean 'lift'\? \(known: drag, gravity, "),
        (
            {"forces": ("drag", "basset-history"), "collisions": Collisions(depth=0.1)},
            "basset-history remembers the past",
        ),
        ({"forces": ("dispersion",)}, "dispersion needs a field with k and dissipation; a laminar airflow has none"),
        ({"seed": -1}, "seed = -1 must lie between 0"),
        ({"forces": ("gravitiy",)}, "did you mean 'gravity'"),
        ({"drag": "brown"}, "unknown drag law 'brown'"),
        ({"until": np.inf}, "until = inf s must be finite"),
        ({"tolerance": 0.0}, "tolerance = 0 must be positive"),
        ({"gravity": (0.0, 0.0, 1.0)}, "gravity"),
        ({"lines": [[[0, 0]]]}, "line 0: shape"),
        ({"forces": ("pressure-gradient",)}, "needs a field with pressure"),
    ],
)
def test_bad_arguments_are_named(changes: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"until": 1.0}
    with pytest.raises(SceneError, match=message):
        track(field_of(still, 2), with_tau(0.1, [[0, 0]], [[0, 0]]), **(arguments | changes))  # type: ignore[arg-type]


def _cache_hits(cache: str) -> int:
    """How many compiled functions a new process takes from the cache to fly one granule."""
    code = (
        "import numpy as np; from wakeflow.tracking import Granules, track\n"
        "grains = Granules(np.zeros((1, 2)), np.ones((1, 2)), diameter=1e-3, density=1.0)\n"
        "track(None, grains, until=1.0)\n"
        "from wakeflow.tracking.kernel.loop import fly_block as f; print(sum(f.stats.cache_hits.values()))"
    )
    environment = os.environ | {"WAKEFLOW_CACHE": cache}
    command = [sys.executable, "-c", code]
    return int(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)


def test_the_compiled_kernel_is_kept_between_processes() -> None:
    track(None, Granules(np.zeros((1, 2)), np.ones((1, 2)), diameter=1e-3, density=1.0), until=1.0)
    assert _cache_hits(os.environ["WAKEFLOW_CACHE"]) == 1


@pytest.mark.slow
def test_a_new_cache_is_filled_by_the_first_process(tmp_path: Path) -> None:
    assert [_cache_hits(str(tmp_path)) for _ in range(2)] == [0, 1]
    assert len(list((tmp_path / "numba").iterdir())) == 1
