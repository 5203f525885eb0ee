"""The tracker in the air: exact where it can be, third order elsewhere, honest about its tolerance, and never lost."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.special import lambertw

from support import DENSITY, VISCOSITY, G, field_of, shaken_mesh, with_tau
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.tracking import Collisions, Fate, Granules, Tracks, track


def still(points: np.ndarray) -> np.ndarray:
    return np.zeros_like(points)


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
