"""The tracker in fields that are smooth in time: as exact, as honest and as cheap as in steady ones; and on moving
meshes.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofs.problems.exact import Setting
from proofs.problems.reference_all_terms import reference_end_states
from support import DENSITY, VISCOSITY, field_of, shaken_mesh, with_tau
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.laws.shape import shapes
from wakeflow.tracking import Body, Fate, Granules, Motion, track
from wakeflow.verify.reference import TrackingProblem, fly_reference

PERIOD = 0.5
ALL = ("drag", "gravity", "buoyancy", "pressure-gradient", "added-mass", "lift", "magnus")


def waving(n: int = 8, count: int = 24) -> FlowField:
    """Two harmonics that travel through the square [-1, 1]."""
    points, cells = shaken_mesh(n, -1.0, 1.0)
    times = 0.05 + PERIOD * np.arange(count) / count
    x, y = points.T

    def velocity(t: float) -> np.ndarray:
        a, b = 2 * np.pi * (y / 2 + t / PERIOD), 4 * np.pi * (y / 2 + t / PERIOD)
        return np.stack([0.5 * np.cos(a) + 0.1 * np.sin(b), 1.0 + 0.3 * x * np.sin(a)], axis=1)

    shots = np.stack([velocity(t) for t in times])
    pressure = np.stack([2.0 * np.cos(2 * np.pi * (y / 2 + t / PERIOD)) for t in times])
    k = np.full(pressure.shape, 0.02)
    whole = FlowField.from_arrays(
        points, cells, shots, pressure, times, PERIOD, k, 0.5 + 0 * k, density=DENSITY, viscosity=VISCOSITY
    )
    return whole.compressed(1e-3)


def swarm(count: int, seed: int = 3, tau: float = 0.05, **more: object) -> Granules:
    rng = np.random.default_rng(seed)
    return with_tau(
        tau,
        rng.uniform(-0.4, 0.4, (count, 2)),
        rng.uniform(-1, 1, (count, 2)),
        time=rng.uniform(0, PERIOD, count),
        **more,
    )


@pytest.mark.parametrize("forces", [("drag", "gravity"), ALL])
@pytest.mark.parametrize("tau", [2e-3, 0.05, 1.0])
def test_landing_errors_stay_below_the_tolerance(forces: tuple[str, ...], tau: float) -> None:
    field, grains, until = waving(), swarm(3, tau=tau, inertia=0.4, spin=5.0), 0.8 if tau > 0.01 else 0.55
    exact = reference_end_states(
        Setting(field, grains, until, {"forces": forces}), stiff=tau < 0.01, rtol=1e-12 if tau > 0.01 else 1e-8
    )
    for tolerance in (1e-3, 1e-5):
        for march in (True, False):
            tracks = track(field, grains, until=until, tolerance=tolerance, forces=forces, march=march)
            assert np.linalg.norm(tracks.position - exact[:, :2], axis=1).max() < tolerance


def test_confined_steps_lose_no_order_in_time() -> None:
    field, grains = waving(), swarm(3)
    exact = reference_end_states(Setting(field, grains, 0.8, {"forces": ("drag", "gravity")}))
    steps, errors = [], []
    for tolerance in (1e-6, 1e-9):
        tracks = track(field, grains, until=0.8, tolerance=tolerance, march=False)
        steps.append(tracks.steps.mean())
        errors.append(np.linalg.norm(tracks.position - exact[:, :2], axis=1).mean())
    assert np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0]) > 2.7


def test_where_tracks_leave_the_mesh_agrees_with_the_reference() -> None:
    field, grains = waving(), swarm(24, tau=0.3)
    problem = TrackingProblem(field, (), 20.0, 1.0)
    exact = fly_reference(problem, grains)
    assert exact.landed.all()
    for tolerance in (1e-3, 1e-5):
        tracks = track(field, grains, until=20.0, tolerance=tolerance, forces=problem.forces, drag=problem.drag)
        off = np.linalg.norm(tracks.position - exact.position, axis=1)
        assert np.mean(off < tolerance) >= 0.95
        assert np.median(off) < 0.5 * tolerance


def test_a_field_whose_modes_do_nothing_is_the_steady_one() -> None:
    field = waving().mean()
    still = FlowField.from_arrays(
        field.points, field.triangles, field.velocity[None], field.pressure[None], np.arange(8) / 16, PERIOD,  # type: ignore[index]
        field.k[None], field.dissipation[None], DENSITY, VISCOSITY, coefficients=np.ones((8, 1)),  # type: ignore[index]
    )  # fmt: skip
    grains = swarm(6)
    for forces in (ALL, ("drag", "gravity", "dispersion")):
        one = track(field, grains, until=0.3, tolerance=1e-7, forces=forces, seed=5)
        other = track(still, grains, until=0.3, tolerance=1e-7, forces=forces, seed=5)
        np.testing.assert_allclose(other.position, one.position, atol=1e-6)


def test_results_depend_on_nothing_but_the_granule() -> None:
    field, grains = waving(), swarm(700, seed=9)
    forces = ("drag", "gravity", "dispersion")
    whole = track(field, grains, until=0.5, tolerance=1e-3, forces=forces, workers=1)
    again = track(field, grains, until=0.5, tolerance=1e-3, forces=forces, workers=2)
    np.testing.assert_array_equal(again.position, whole.position)
    part = track(field, grains[:40], until=0.5, tolerance=1e-3, forces=forces)
    np.testing.assert_array_equal(part.position, whole.position[:40])


# -- moving meshes

AMPLITUDE, OMEGA, PHASE = np.array([0.003, 0.02]), 60.0, 0.7


PRESSED = ("drag", "gravity", "pressure-gradient")


@pytest.mark.parametrize("forces", [PRESSED, (*PRESSED, "added-mass")])
def test_a_linear_field_on_a_moving_mesh_is_flown_as_scipy_does(forces: tuple[str, ...]) -> None:
    points, cells = shaken_mesh(6, -1.0, 1.0)
    slope, base, tau = np.array([[0.5, -1.2], [0.8, -0.5]]), np.array([0.3, -0.2]), 0.05
    air = {"pressure": points @ [3.0, -2.0], "density": DENSITY, "viscosity": VISCOSITY}
    whole = FlowField.from_arrays(points, cells, points @ slope.T + base, **air)  # type: ignore[arg-type]
    field = whole.moving(AMPLITUDE, OMEGA, PHASE)
    grains = with_tau(tau, [[0.1, 0.2], [-0.3, 0.1]], np.zeros((2, 2)))
    chi = 0.5 * DENSITY / 1000.0 if "added-mass" in forces else 0.0

    def rhs(t: float, z: np.ndarray) -> np.ndarray:
        angle = OMEGA * t + PHASE
        u = slope @ (z[:2] - AMPLITUDE * np.sin(angle)) + base
        rise = slope @ (u - AMPLITUDE * OMEGA * np.cos(angle))  # Du/Dt: the field moves past
        pull = np.array([0.0, -9.81]) - np.array([3.0, -2.0]) / 1000.0
        return np.concatenate([z[2:], ((u - z[2:]) / tau + pull + chi * rise) / (1 + chi)])

    for tolerance in (1e-3, 1e-6):
        tracks = track(field, grains, until=0.3, tolerance=tolerance, forces=forces, drag="stokes")
        for i in range(2):
            start = np.r_[grains.position[i], grains.velocity[i]]
            exact = solve_ivp(rhs, (0, 0.3), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
            assert np.linalg.norm(tracks.position[i] - exact[:2]) < 0.1 * tolerance
            assert np.linalg.norm(tracks.velocity[i] - exact[2:]) < tolerance


def test_in_uniform_air_a_moving_mesh_changes_nothing() -> None:
    """Impacts on a body that vibrates, sliding off it, a wall at rest, bins at rest, all in the mesh's frame or not."""
    fixed = field_of(lambda x: np.tile([0.0, -0.5], (len(x), 1)), n=6)
    moving = fixed.moving((0.0, 0.005), OMEGA, PHASE)
    prism = Body(
        np.array([[-0.2, -0.3], [0.2, -0.3], [0.0, -0.1]]), motion=Motion((0.0, 0.005), OMEGA / (2 * np.pi), PHASE)
    )
    wall = Body(np.array([[0.6, -1], [0.7, -1], [0.7, 0.9], [0.6, 0.9]]))
    lines = [np.array([[-0.9, -0.6], [0.9, -0.6]]), np.array([[0.25, -0.9], [0.25, 0.5]])]
    rng = np.random.default_rng(1)
    place = np.stack([rng.uniform(-0.15, 0.7, 24), rng.uniform(0.0, 0.3, 24)], axis=1)
    place[:, 0] = np.where(place[:, 0] > 0.5, 0.5, place[:, 0])
    speed = np.where(place[:, :1] > 0.3, [[1.5, -1.0]], [[0.0, -1.0]])
    grains = with_tau(0.5, place, speed, inertia=0.4, time=rng.uniform(0, 0.2, 24))
    for restitution in (0.5, 0.0):
        some = grains.replace(restitution=restitution)
        how = {"until": 2.0, "tolerance": 1e-5, "bodies": [prism, wall], "lines": lines, "drag": "stokes"}
        one, other = track(fixed, some, **how), track(moving, some, **how)  # type: ignore[arg-type]
        np.testing.assert_array_equal(other.fate, one.fate)
        np.testing.assert_array_equal(other.line, one.line)
        assert np.all(other.impacts[one.impacts > 0] > 0)
        np.testing.assert_allclose(other.position, one.position, atol=1e-5)
        np.testing.assert_allclose(other.time, one.time, atol=1e-5)


def test_elastic_impacts_without_drag_are_those_of_a_vacuum() -> None:
    fixed = field_of(lambda x: np.tile([1.0, -2.0], (len(x), 1)), n=6)
    moving = fixed.moving((0.0, 0.01), OMEGA)
    rhombus = Body(shapes["rhombus"](width=0.4, slope_angle=np.pi / 4), motion=Motion((0.0, 0.01), OMEGA / (2 * np.pi)))
    grains = swarm(90, restitution=1.0, friction=0.0)
    free = np.abs(grains.position).sum(axis=1) > 0.3
    how = {"until": 0.7, "tolerance": 1e-6, "forces": ("gravity",), "bodies": [rhombus]}
    inside = track(moving, grains[free], **how)  # type: ignore[arg-type]
    vacuum = track(None, grains[free], **how)  # type: ignore[arg-type]
    there = inside.fate == Fate.AIRBORNE
    assert inside.impacts[there].sum() >= 3
    np.testing.assert_allclose(inside.position[there], vacuum.position[there], atol=1e-7)
    np.testing.assert_allclose(inside.velocity[there], vacuum.velocity[there], atol=1e-6)


@pytest.mark.parametrize("tau", [1e-3, 0.1])
def test_no_granule_enters_a_body_that_moves_with_its_field(tau: float) -> None:
    omega = 2 * np.pi * 4 / PERIOD
    field, swing = waving().moving((0.0, 0.02), omega, 0.3), Motion((0.0, 0.02), omega / (2 * np.pi), 0.3)
    outline = shapes["rhombus"](width=0.4, slope_angle=np.pi / 4)
    grains = swarm(40, seed=11, tau=tau, restitution=0.4)
    grains = grains[np.abs(grains.position).sum(axis=1) > 0.3]
    tracks = track(
        field, grains, until=3.0, tolerance=1e-4, bodies=[Body(outline, motion=swing)], record=True, length=0.4
    )
    assert tracks.impacts.sum() > 5
    assert not np.any(tracks.fate == Fate.STOPPED)
    for i in range(len(grains)):
        t, x, _ = tracks.path(i)
        offset = x - np.stack([0 * t, 0.02 * np.sin(omega * t + 0.3)], axis=1)
        gap = (np.abs(offset).sum(axis=1) - 0.2) / np.sqrt(2)  # of the centre from the rhombus' faces
        assert gap.min() > -1e-9


def test_what_a_moving_mesh_cannot_have_is_refused() -> None:
    shots = waving().snapshots().moving((0.0, 0.01), 4 * np.pi / PERIOD)
    with pytest.raises(SceneError, match="must be compressed first"):
        track(shots, swarm(1), until=0.1)
    field = waving().moving((0.0, 0.01), 4 * np.pi / PERIOD)
    body = Body(shapes["rhombus"](width=0.4, slope_angle=np.pi / 4), motion=Motion((0.0, 0.01), 5.0))
    with pytest.raises(SceneError, match="they must agree"):
        track(field, swarm(1), until=0.1, bodies=[body])
