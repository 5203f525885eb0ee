"""Collisions with walls, of pairs, with scatter, of spheres with dust: published cases, and no energy made."""

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from support import DOCS, ROOT
from wakeflow.core.errors import SceneError
from wakeflow.laws.collision import ImpactModel, collide, collide_pair, impact, impact_models, scattered_rebound
from wakeflow.laws.impaction import sphere_caught
from wakeflow.laws.random_numbers import normal_pair

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
    limit = np.tan(BETA) / 1.5 / (1.0 + 1.0 / model.inertia)
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


@settings(max_examples=300, deadline=None)
@given(
    v=st.tuples(finite, finite),
    w=st.tuples(finite, finite),
    spin=st.floats(-1e3, 1e3),
    angle=st.floats(0, 6.3),
    restitution=unit,
    friction=st.floats(0, 3) | st.just(np.inf),
    mobility=st.sampled_from([1.0 / impact_models[name].inertia for name in impact_models]),
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


Array = NDArray[np.float64]
MANY = 4096


def _unit(rng: np.random.Generator) -> Array:
    n = rng.normal(size=(MANY, 3))
    return np.asarray(n / np.linalg.norm(n, axis=1)[:, None])


def _pairs(seed: int, mobility: Any = None) -> dict[str, Any]:
    """Pairs of all masses and radii up to 1000 : 1, of any spin and slip."""
    rng = np.random.default_rng(seed)
    turning = rng.choice([2.5, 2.0, 1.5, 1.0], (2, MANY)) if mobility is None else np.full((2, MANY), mobility)
    return {
        "m": 10 ** rng.uniform(-9, 0, (2, MANY)), "r": 10 ** rng.uniform(-5, -2, (2, MANY)), "n": _unit(rng),
        "v": rng.normal(size=(2, MANY, 3)), "w": rng.normal(size=(2, MANY, 3)) * 100, "q": turning,
        "e": rng.choice([0.0, 1.0, 0.3, 0.85], MANY), "f": rng.choice([0.0, 0.1, 0.5, np.inf], MANY),
        "back": rng.choice([0.0, 0.4, 1.0], MANY),
    }  # fmt: skip


def _after(p: dict[str, Any]) -> tuple[Array, Array, Array]:
    """Velocities and spins (2, n, 3) after the collision, and the impulse (n, 3)."""
    s = (p["r"][:, :, None] * p["w"] * np.sign(p["q"])[:, :, None]).sum(axis=0)
    r, n = p["v"][0] - p["v"][1], p["n"]
    impulse = np.stack(
        collide_pair(*r.T, *s.T, *n.T, 1 / p["m"][0], 1 / p["m"][1], *p["q"], p["e"], p["f"], p["back"])[:3], axis=1
    )
    v = np.stack([p["v"][0] + impulse / p["m"][0, :, None], p["v"][1] - impulse / p["m"][1, :, None]])
    turn = np.cross(n, impulse)[None] * (p["q"] / (p["m"] * p["r"]))[:, :, None]
    return v, p["w"] - turn, impulse


def _energy(p: dict[str, Any], v: Array, w: Array) -> Array:
    inertia = np.where(p["q"] > 0, p["m"] * p["r"] ** 2 / np.maximum(p["q"], 1e-9), 0.0)
    return np.asarray((0.5 * p["m"] * (v**2).sum(axis=2) + 0.5 * inertia * (w**2).sum(axis=2)).sum(axis=0))


def test_angular_momentum_and_momentum_are_kept_to_round_off() -> None:
    p = _pairs(1)
    v, w, impulse = _after(p)
    change = p["m"][:, :, None] * (v - p["v"])
    size = np.linalg.norm(impulse, axis=1) + (p["m"][:, :, None] * np.abs(p["v"])).sum(axis=(0, 2))
    assert np.max(np.abs(change.sum(axis=0)) / size[:, None]) < 1e-14
    inertia = (p["m"] * p["r"] ** 2 / p["q"])[:, :, None]
    orbit = np.cross(p["n"] * p["r"][0, :, None], change[0]) - np.cross(p["n"] * p["r"][1, :, None], change[1])
    arm = (np.abs(p["w"]) * inertia).sum(axis=(0, 2)) + size * p["r"].sum(axis=0)
    assert np.max(np.abs(orbit + (inertia * (w - p["w"])).sum(axis=0)) / arm[:, None]) < 1e-14


@pytest.mark.parametrize("mobility", [None, 0.0])
def test_energy_never_grows(mobility: float | None) -> None:
    p = _pairs(2, mobility)
    before = _energy(p, p["v"], p["w"])
    v, w, _ = _after(p)
    assert np.all(_energy(p, v, w) <= before * (1 + 1e-13))


def test_smooth_elastic_pairs_keep_energy_and_restitution_turns_the_approach() -> None:
    p = _pairs(3) | {"f": np.zeros(MANY), "e": np.ones(MANY)}
    v, w, _ = _after(p)
    np.testing.assert_allclose(_energy(p, v, w), _energy(p, p["v"], p["w"]), rtol=1e-12)
    for e in (0.0, 0.4, 1.0):
        p["e"] = np.full(MANY, e)
        v, _, _ = _after(p)
        before, after = (((u[0] - u[1]) * p["n"]).sum(axis=1) for u in (p["v"], v))
        np.testing.assert_allclose(after, np.where(before < 0, -e * before, before), atol=2e-14)


def test_a_sticking_contact_turns_its_slip_round_by_the_tangential_restitution() -> None:
    p = _pairs(4) | {"f": np.full(MANY, np.inf)}
    p["n"] *= -np.sign(((p["v"][0] - p["v"][1]) * p["n"]).sum(axis=1))[:, None]
    v, w, _ = _after(p)

    def slip(u: Array, spin: Array) -> Array:
        g = u[0] - u[1] - np.cross((p["r"][:, :, None] * spin).sum(axis=0), p["n"])
        return np.asarray(g - (g * p["n"]).sum(axis=1)[:, None] * p["n"])

    before, after = slip(p["v"], p["w"]), slip(v, w)
    np.testing.assert_allclose(after, -p["back"][:, None] * before, atol=1e-12)


def test_a_wall_is_a_second_granule_of_no_inverse_mass() -> None:
    """In the plane the law of pairs is the wall's, for every mass of the granule."""
    p = _pairs(5)
    angle = np.random.default_rng(6).uniform(0, 2 * np.pi, MANY)
    nx, ny, none = np.cos(angle), np.sin(angle), np.zeros(MANY)
    (v, wall), spin, m, r, q = p["v"][:, :, :2], p["w"][0, :, 2], p["m"][0], p["r"][0], p["q"][0]
    laws = p["e"], p["f"], p["back"]
    vx, vy, turned, normal, _ = collide(*v.T, spin, nx, ny, *wall.T, *laws[:2], q, r, laws[2])
    jx, jy, jz, jn = collide_pair(*(v - wall).T, none, none, none, r * spin, nx, ny, none, 1 / m, none, q, none, *laws)
    np.testing.assert_allclose(v[:, 0] + jx / m, vx, atol=1e-13)
    np.testing.assert_allclose(v[:, 1] + jy / m, vy, atol=1e-13)
    np.testing.assert_allclose(jn / m, normal, atol=1e-13)
    np.testing.assert_allclose(r * spin - q / m * (nx * jy - ny * jx), r * turned, atol=1e-12)
    assert np.all(jz == 0.0)


COUNT = 20_000


def impacts(seed: int, restitution: float | None = None) -> dict[str, np.ndarray]:
    """Impacts from all sides on walls that move, of spinning granules: bodies of any inertia, point masses too."""
    rng = np.random.default_rng(seed)
    n = rng.normal(size=(COUNT, 2))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    velocity, wall = rng.normal(size=(2, COUNT, 2))
    into = ((velocity - wall) * n).sum(axis=1)
    velocity -= 2.0 * np.maximum(into, 0.0)[:, None] * n  # all of them approach
    return {
        "velocity": velocity, "spin": rng.normal(0, 1e3, COUNT), "normal": n, "wall": wall,
        "restitution": rng.uniform(0.01, 1.0, COUNT) if restitution is None else np.full(COUNT, restitution),
        "friction": rng.uniform(0.0, 1.0, COUNT), "mobility": rng.choice([0.0, 2.0, 2.5], COUNT),
        "radius": np.full(COUNT, 1e-3), "tangential_restitution": rng.choice([0.0, 0.4, 1.0], COUNT),
    }  # fmt: skip


def energy(hit: dict[str, np.ndarray], velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Twice the energy per mass seen from the wall."""
    inertia = np.divide(1.0, hit["mobility"], out=np.zeros(COUNT), where=hit["mobility"] > 0)
    return ((velocity - hit["wall"]) ** 2).sum(axis=1) + inertia * (hit["radius"] * spin) ** 2


@pytest.mark.parametrize("rms", [0.1, 0.2, 1.0])
def test_every_granule_leaves_the_true_wall_and_no_energy_is_made(rms: float) -> None:
    hit = impacts(1)
    velocity, spin, impulse = scattered_rebound(**hit, angle=np.random.default_rng(2).normal(0, rms, COUNT))
    assert np.all(((velocity - hit["wall"]) * hit["normal"]).sum(axis=1) > 0.0)
    assert np.all(impulse > 0.0)
    assert np.all(energy(hit, velocity, spin) <= energy(hit, hit["velocity"], hit["spin"]) * (1 + 1e-12))


def test_without_an_angle_it_is_the_collision_itself() -> None:
    hit = impacts(3)
    velocity, spin, impulse = scattered_rebound(**hit, angle=np.zeros(COUNT))
    (vx, vy), (nx, ny), (wx, wy) = hit["velocity"].T, hit["normal"].T, hit["wall"].T
    rest = (hit[key] for key in ("restitution", "friction", "mobility", "radius", "tangential_restitution"))
    ends = collide(vx, vy, hit["spin"], nx, ny, wx, wy, *rest)
    np.testing.assert_array_equal(velocity, np.stack(ends[:2], axis=1))
    np.testing.assert_array_equal(spin, ends[2])
    np.testing.assert_array_equal(impulse, ends[3])


def test_a_mirror_image_rebounds_as_the_mirror_image() -> None:
    """The law prefers no side: angle and opposite are cut down alike, so that their mean stays zero."""
    hit, angle, flip = impacts(4), np.random.default_rng(5).normal(0, 0.5, COUNT), np.array([-1.0, 1.0])
    image = hit | {key: hit[key] * flip for key in ("velocity", "normal", "wall")} | {"spin": -hit["spin"]}
    velocity, spin, _ = scattered_rebound(**hit, angle=angle)
    mirrored, turning, _ = scattered_rebound(**image, angle=-angle)
    np.testing.assert_allclose(mirrored * flip, velocity, atol=1e-12)
    np.testing.assert_allclose(-turning, spin, rtol=1e-9, atol=1e-9)


def test_without_restitution_nothing_is_scattered() -> None:
    hit = impacts(6, restitution=0.0)
    smooth, rough = (scattered_rebound(**hit, angle=np.full(COUNT, angle))[0] for angle in (0.0, 0.3))
    np.testing.assert_array_equal(rough, smooth)


def test_a_grazing_granule_keeps_grazing() -> None:
    """Without friction its rebound stays between 0 and 2 R u, with R u in the mean."""
    u, w, e = 1e-3, 1.0, 0.5
    rows = np.ones((COUNT, 1))
    velocity, _, _ = scattered_rebound(
        rows * [w, -u], np.zeros(COUNT), rows * [0.0, 1.0], np.zeros((COUNT, 2)), e, 0.0, 0.0, 1e-3, 0.0,
        np.random.default_rng(7).normal(0, 0.15, COUNT),
    )  # fmt: skip
    assert velocity[:, 1].min() > 0.0
    assert velocity[:, 1].max() < 2 * e * u * 1.01
    assert velocity[:, 1].mean() == pytest.approx(e * u, rel=0.01)


def test_a_steep_impact_is_turned_by_twice_the_angle() -> None:
    """Straight down on a level wall, elastic and smooth: a mirror turned by a turns the ray by 2 a."""
    angle = np.array([-0.1, 0.05, 0.2])
    velocity, _, _ = scattered_rebound(
        np.array([[0.0, -1.0]] * 3), np.zeros(3), np.array([[0.0, 1.0]] * 3), np.zeros((3, 2)), 1.0, 0.0, 0.0, 1e-3,
        0.0, angle,
    )  # fmt: skip
    np.testing.assert_allclose(np.arctan2(-velocity[:, 0], velocity[:, 1]), 2 * angle, atol=1e-12)


def test_random_numbers_are_normal_and_depend_on_their_number_alone() -> None:
    from scipy.stats import kstest

    count = np.arange(50_000)
    seed = np.full(len(count), 7)
    x, y = normal_pair(seed, count, -1 - count % 5)
    for drawn in (x, y):
        assert kstest(drawn, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(x, y)[0, 1]) < 0.02
    assert abs(np.corrcoef(x[:-1], x[1:])[0, 1]) < 0.02
    some = np.array([3, 999, 40_000])
    np.testing.assert_array_equal(normal_pair(seed[some], count[some], -1 - count[some] % 5)[0], x[some])
    assert not np.any(normal_pair(seed, count, -2 - count % 5)[0] == x)


POTENTIAL = 1e200  # a Reynolds number, of which the law's logarithm is large


def _met(stokes: float, step: float = 0.01, starts: int = 400) -> float:
    """The share by integration of paths towards a sphere of radius 1 at rest, air of speed 1 along x: exponential
    midpoint steps of granules that start with the air, six diameters upstream.
    """
    tau, y = 2.0 * stokes, np.linspace(0.0025, 1.0, starts)
    start, x, hit = y.copy(), np.full(starts, -12.0), np.zeros(starts, dtype=bool)
    decay = math.exp(-step / tau)

    def air(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r2 = np.maximum(x * x + y * y, 1.0)
        return 1.0 + 0.5 * (y * y - 2.0 * x * x) / r2**2.5, -1.5 * x * y / r2**2.5

    u, v = air(x, y)
    for _ in range(round(20.0 / step)):
        ax, ay = air(x + 0.5 * step * u, y + 0.5 * step * v)
        x = x + ax * step + (u - ax) * tau * (1.0 - decay)
        y = y + ay * step + (v - ay) * tau * (1.0 - decay)
        u, v = ax + (u - ax) * decay, ay + (v - ay) * decay
        hit |= x * x + y * y < 1.0
    return float(start[hit].max(initial=0.0) ** 2)


@pytest.mark.parametrize("stokes", [0.04, 0.08, 0.12, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0])
def test_at_a_high_reynolds_number_paths_in_potential_flow_are_met_as_often(stokes: float) -> None:
    assert abs(_met(stokes) - sphere_caught(stokes, POTENTIAL)) < 0.03


def test_none_of_the_finest_and_all_of_the_coarsest_are_met_and_more_in_faster_air() -> None:
    assert sphere_caught(0.0, 1e3) == 0.0
    assert sphere_caught(0.6, 0.0) == 0.0  # creeping flow: S0 = 1.2
    assert sphere_caught(1e6, 1.0) == pytest.approx(1.0, abs=1e-6)
    stokes, reynolds = np.meshgrid(np.geomspace(0.01, 100.0, 60), np.geomspace(1.0, 1e5, 20))
    share = sphere_caught(stokes, reynolds)
    assert np.all(np.diff(share, axis=1) >= 0.0)
    assert np.all(np.diff(share, axis=0) >= 0.0)
    assert np.all((share >= 0.0) & (share < 1.0))
