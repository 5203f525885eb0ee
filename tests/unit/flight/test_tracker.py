"""The tracker in the air: exact where it can be, third order elsewhere, honest about its tolerance, and never lost."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial import Delaunay

from proofs.problems.exact import Setting
from proofs.problems.reference_all_terms import reference_end_states
from proofs.tracker.reference import TrackingProblem, fly_reference
from support import DENSITY, VISCOSITY, G, field_of, shaken_mesh, with_tau
from wakeflow.air.field import FlowField
from wakeflow.core.errors import SceneError
from wakeflow.flight import Body, Fate, Granules, Motion, Tracks, track
from wakeflow.flight.kernel import layout as at
from wakeflow.flight.pack import pack_granules
from wakeflow.laws.drag import slip_correction
from wakeflow.laws.shape import shapes


def still(points: np.ndarray) -> np.ndarray:
    return np.zeros_like(points)


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


def swirl(points: np.ndarray) -> np.ndarray:
    """A divergence-free cellular flow with a mean downward stream."""
    k = np.pi
    x, y = points.T
    return 2 * np.stack([np.sin(k * x) * np.cos(k * y), -0.8 - np.cos(k * x) * np.sin(k * y)], axis=1)


def test_birth_time_is_the_phase_of_the_field() -> None:
    points, cells = shaken_mesh(3, -1.0, 1.0)
    values = np.stack([swirl(points), 0.2 * swirl(points), 0.7 * swirl(points)])
    field = FlowField.from_arrays(points, cells, values, times=[0.0, 0.1, 0.2], period=0.3)
    now = with_tau(0.01, [[0.2, 0.3]], [[0.0, 0.0]], time=0.05)
    later = now.replace(time=0.05 + 7 * 0.3)
    a, b = track(field, now, until=0.35), track(field, later, until=0.35 + 7 * 0.3)
    np.testing.assert_allclose(a.position, b.position, atol=1e-11)


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


def collisions(n: int = 700) -> tuple[FlowField, Granules]:
    rng = np.random.default_rng(7)
    grains = Granules(
        rng.uniform(-0.9, 0.9, (n, 2)), rng.normal(size=(n, 2)), diameter=10.0 ** rng.uniform(-6, -2.3, n), density=900
    )
    return field_of(swirl, 12), grains


def test_progress_reaches_the_total() -> None:
    field, grains = collisions()
    seen: list[tuple[int, int]] = []
    track(field, grains, until=0.1, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (len(grains), len(grains))
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_recorded_paths_begin_and_end_where_the_track_does_and_are_bounded() -> None:
    field, grains = collisions(30)
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
    for workers in (2, 5):
        again = track(field, grains, until=0.5, tolerance=1e-3, forces=forces, workers=workers)
        for name in ("position", "velocity", "time", "fate", "steps", "impacts", "line"):
            np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
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


@pytest.mark.parametrize(
    ("air", "path"),
    [
        ({}, 0.066e-6),
        ({"density": 998.2, "viscosity": 1.002e-3}, 0.0),
        ({"viscosity": 1.8e-5}, 0.0),
        ({"density": 0.24, "viscosity": 1.8e-5, "mean_free_path": 0.33e-6}, 0.33e-6),
        ({"mean_free_path": 0.0}, 0.0),
    ],
)
def test_fine_granules_slip_in_a_gas_alone(air: dict[str, float], path: float) -> None:
    """Stokes' law over Cc in the gas's own path; exactly Stokes' law without one."""
    points, cells = shaken_mesh(3, -1.0, 1.0)
    field = FlowField.from_arrays(points, cells, np.zeros_like(points), **air)
    diameter = np.array([0.1e-6, 1e-6, 10e-6])
    stokes = 2500.0 * diameter**2 / (18.0 * field.viscosity)
    tau = stokes * slip_correction(diameter, path) if path else stokes
    grains = Granules(np.zeros((3, 2)), np.tile([0.1, 0.0], (3, 1)), diameter, 2500.0, time=-tau)
    found = track(field, grains, until=0.0, forces=("drag",), drag="stokes", tolerance=1e-12)
    assert field.mean_free_path == path
    np.testing.assert_allclose(found.velocity[:, 0], 0.1 / np.e, rtol=1e-9)
    again = track(field, grains[::-1], until=0.0, forces=("drag",), drag="stokes", tolerance=1e-12)
    np.testing.assert_array_equal(again.velocity, found.velocity[::-1])


def test_a_gas_is_kept_with_its_field(tmp_path: Path) -> None:
    points, cells = shaken_mesh(3, -1.0, 1.0)
    field = FlowField.from_arrays(points, cells, np.zeros_like(points), temperature=673.15, mean_free_path=1.8e-7)
    field.save(tmp_path / "field.npz")
    read = FlowField.load(tmp_path / "field.npz")
    assert (read.temperature, read.mean_free_path) == (673.15, 1.8e-7)
    with pytest.raises(SceneError, match="mean_free_path = -1"):
        FlowField.from_arrays(points, cells, np.zeros_like(points), mean_free_path=-1.0)


def test_brownian_motion_is_that_of_the_gas() -> None:
    """D = k_B T Cc / (3 pi mu d): in air of 600 K and a longer path more by both."""
    points, cells = shaken_mesh(3, -1.0, 1.0)
    grains = Granules(np.zeros((1, 2)), np.zeros((1, 2)), 0.1e-6, 1000.0)
    constants = [
        pack_granules(
            grains, FlowField.from_arrays(points, cells, np.zeros_like(points), **air), ("brownian",), (0.0, 0.0)
        )[0, at.DIFFUSIVITY]
        for air in ({}, {"temperature": 586.3}, {"mean_free_path": 0.0}, {"mean_free_path": 0.132e-6})
    ]
    slip = [float(slip_correction(0.1e-6, path)) for path in (0.066e-6, 0.066e-6, 0.0, 0.132e-6)]
    expected = 1.380649e-23 * 293.15 / (3 * np.pi * 1.8e-5 * 0.1e-6) * np.array(slip) * (1.0, 2.0, 1.0, 1.0)
    np.testing.assert_allclose(constants, expected, rtol=1e-12)
    assert slip[2] == 1.0
