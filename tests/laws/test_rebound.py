"""Rebounds with scatter: granules leave the wall, no energy is made, the law is symmetric, grazing stays grazing."""

from __future__ import annotations

import numpy as np
import pytest

from wakeflow.laws.collision import collide
from wakeflow.laws.random_numbers import normal_pair
from wakeflow.laws.rebound import thrown

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
    velocity, spin, impulse = thrown(**hit, angle=np.random.default_rng(2).normal(0, rms, COUNT))
    assert np.all(((velocity - hit["wall"]) * hit["normal"]).sum(axis=1) > 0.0)
    assert np.all(impulse > 0.0)
    assert np.all(energy(hit, velocity, spin) <= energy(hit, hit["velocity"], hit["spin"]) * (1 + 1e-12))


def test_without_an_angle_it_is_the_collision_itself() -> None:
    hit = impacts(3)
    velocity, spin, impulse = thrown(**hit, angle=np.zeros(COUNT))
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
    velocity, spin, _ = thrown(**hit, angle=angle)
    mirrored, turning, _ = thrown(**image, angle=-angle)
    np.testing.assert_allclose(mirrored * flip, velocity, atol=1e-12)
    np.testing.assert_allclose(-turning, spin, rtol=1e-9, atol=1e-9)


def test_without_restitution_nothing_is_scattered() -> None:
    hit = impacts(6, restitution=0.0)
    smooth, rough = (thrown(**hit, angle=np.full(COUNT, angle))[0] for angle in (0.0, 0.3))
    np.testing.assert_array_equal(rough, smooth)


def test_a_grazing_granule_keeps_grazing() -> None:
    """Without friction its rebound stays between 0 and 2 R u, with R u in the mean."""
    u, w, e = 1e-3, 1.0, 0.5
    rows = np.ones((COUNT, 1))
    velocity, _, _ = thrown(
        rows * [w, -u], np.zeros(COUNT), rows * [0.0, 1.0], np.zeros((COUNT, 2)), e, 0.0, 0.0, 1e-3, 0.0,
        np.random.default_rng(7).normal(0, 0.15, COUNT),
    )  # fmt: skip
    assert velocity[:, 1].min() > 0.0
    assert velocity[:, 1].max() < 2 * e * u * 1.01
    assert velocity[:, 1].mean() == pytest.approx(e * u, rel=0.01)


def test_a_steep_impact_is_turned_by_twice_the_angle() -> None:
    """Straight down on a level wall, elastic and smooth: a mirror turned by a turns the ray by 2 a."""
    angle = np.array([-0.1, 0.05, 0.2])
    velocity, _, _ = thrown(
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
