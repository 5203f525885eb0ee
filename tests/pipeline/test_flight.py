"""From the feed to the landing: walls and ends of a scene, mirror-image ensembles, fractions that are kept."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.injection.feed import feedstock
from wakeflow.injection.sobol import samples
from wakeflow.pipeline.landings import load_tracked
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.tracks import Flight, _second_half, bodies_and_walls, end_lines
from wakeflow.planning.make import make_plan
from wakeflow.planning.plan import COMPARED, REPLICATES, replicate_size
from wakeflow.scene import Scene


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "rhombus.toml", {"feed.count": 256})


def leaning(scene: Scene, speed: float = 1.0) -> FlowField:
    """A time-resolved airflow that blows to the right all the time, with that ``speed`` (m/s)."""
    half, low, high = scene.channel.width / 2, scene.channel.bottom, scene.channel.top
    corners = np.array([(-half, low), (half, low), (half, high), (-half, high)])
    wind = np.tile([speed, -5.0], (2, 4, 1))
    return FlowField.from_arrays(
        corners, [(0, 1, 2), (0, 2, 3)], wind, np.zeros((2, 4)), times=[0.0, 0.05], period=0.1, density=1.2
    )


def test_each_replicate_flies_half_in_the_mirror_image_of_a_time_resolved_airflow(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    Flight(scene, plan, Realisations(leaning(scene)), 1e-4).fly_all(tmp_path, drawn=False)
    size = replicate_size(256)
    for name, landing in load_tracked(tmp_path, scene).landings.items():
        np.testing.assert_array_equal(landing.replicate, np.repeat(np.arange(REPLICATES), size))
        x = landing.position[:, 0].reshape(REPLICATES, 2, size // 2)
        right, left = x[:, 0].mean(), x[:, 1].mean()
        assert right > 5e-3
        assert left == pytest.approx(-right, abs=0.2 * right), name
        assert np.abs(x.mean(axis=(1, 2))).max() < 0.4 * right, name  # each is balanced: there are no two clusters


def test_the_halves_of_a_replicate_are_balanced_in_every_coordinate(scene: Scene) -> None:
    """Place, size, phase and period of release: in each quarter of its range, half of the granules are of either."""
    feed = feedstock(scene, make_plan(scene, rung="draft"), "chaff", 0.1, range(4))
    points, _ = samples("chaff", 256, scene.feed.seed, range(4))
    size = len(points) // 4
    other = _second_half(feed, size, range(4)).reshape(4, size)
    for replicate, coordinates in enumerate(points.reshape(4, size, 4)):
        for values in coordinates.T:
            in_quarter = other[replicate][np.argsort(values)].reshape(4, size // 4).sum(axis=1)
            assert in_quarter.tolist() == 4 * [size // 8]


def test_replicates_fly_in_the_realisations_of_the_airflow_in_turn(scene: Scene, tmp_path: Path) -> None:
    """Winds of three strengths: each replicate meets one of them and its mirror image; the fields are made one by one,
    and the answer of a comparison's few replicates is that of the same ones among all.
    """
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    made: list[float] = []

    def wind(speed: float) -> FlowField:
        made.append(speed)
        return leaning(scene, speed)

    others = (partial(wind, 2.0), partial(wind, 3.0))
    flight = Flight(scene, plan, Realisations(leaning(scene), others, cycles=2), 1e-4)
    flight.fly_all(tmp_path, drawn=True)
    assert made == [2.0, 3.0] * len(scene.fraction)
    replace(flight, replicates=COMPARED).fly_all(tmp_path / "few", drawn=False)
    few = load_tracked(tmp_path / "few", scene).landings
    for name, landing in load_tracked(tmp_path, scene).landings.items():
        np.testing.assert_array_equal(landing.realisation, landing.replicate % 3)
        size = replicate_size(256)
        x = landing.position[:, 0].reshape(REPLICATES, 2, size // 2)
        away = [np.mean(x[i::3, 0] - x[i::3, 1]) for i in range(3)]
        assert away == sorted(away), name
        np.testing.assert_allclose(np.bincount(landing.cycle), 2 * [8 * size], rtol=0.1)
        np.testing.assert_array_equal(few[name].position, landing.position[landing.replicate < COMPARED])


def test_realisations_have_one_period(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    other = replace(leaning(scene), period=0.2)
    with pytest.raises(SceneError, match=r"realisation 1: its period is 0\.2 s"):
        Flight(scene, plan, Realisations(leaning(scene), (lambda: other,)), 1e-4).fly_all(tmp_path, drawn=False)


def test_a_landing_keeps_the_cycle_of_its_release(scene: Scene) -> None:
    airs = Realisations(leaning(scene), cycles=4)
    assert airs.cycle_of(np.array([0.0, 0.024, 0.026, 0.0999, 0.1, 1.051])).tolist() == [0, 0, 1, 3, 0, 2]
    steady = airs.mapped(FlowField.mean)
    assert steady.cycle_of(np.array([0.0, 1.0])).tolist() == [0, 0]
    assert Realisations(None).cycle_of(np.array([1.0])).tolist() == [0]


def test_an_unsymmetric_geometry_has_no_mirror_image(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    plan = replace(plan, airflow=replace(plan.airflow, symmetric=False))
    Flight(scene, plan, Realisations(leaning(scene)), 1e-4).fly_all(tmp_path, drawn=False)
    for landing in load_tracked(tmp_path, scene).landings.values():
        assert landing.position[landing.replicate % 2 == 1, 0].mean() > 5e-3


def test_a_fraction_that_is_there_is_not_flown_again(scene: Scene, tmp_path: Path) -> None:
    told: list[str] = []
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    flight = Flight(scene, plan, Realisations(leaning(scene)), 1e-4, tell=told.append)
    flight.fly_all(tmp_path, drawn=False)
    (tmp_path / "chaff.npz").unlink()
    told.clear()
    flight.fly_all(tmp_path, drawn=False)
    assert {line.split(":")[0] for line in told} == {"chaff"}


def test_bins_open_the_walls_and_come_first_among_the_ends(scene: Scene) -> None:
    assert len(bodies_and_walls(scene)) == 3  # the body and two walls
    window = scene.replace({"bin.window": {"on": "left", "from": -0.1, "to": 0.0}})
    walls = bodies_and_walls(window)[1:]
    assert len(walls) == 3  # the left wall in two pieces
    left = sorted((w.outline[:, 1].min(), w.outline[:, 1].max()) for w in walls if w.outline[0, 0] < 0)
    assert left[0][1] == pytest.approx(-0.1)
    assert left[1][0] == pytest.approx(0.0)
    lines = end_lines(window)
    assert len(lines) == len(window.bin) + 2
    np.testing.assert_allclose(lines[list(window.bin).index("window")], [(-0.2, -0.1), (-0.2, 0.0)])
    assert lines[-2][0, 1] < scene.channel.bottom
    assert lines[-1][0, 1] > scene.channel.top
