"""From the feed to the landing: walls and ends of a scene, mirror-image ensembles, fractions that are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wakeflow.field import FlowField
from wakeflow.pipeline.landings import load_tracked
from wakeflow.pipeline.tracks import Flight, bodies_and_walls, end_lines
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "rhombus.toml", {"feed.count": 256})


def leaning(scene: Scene) -> FlowField:
    """A time-resolved airflow that blows to the right all the time."""
    half, low, high = scene.channel.width / 2, scene.channel.bottom, scene.channel.top
    corners = np.array([(-half, low), (half, low), (half, high), (-half, high)])
    wind = np.tile([1.0, -5.0], (2, 4, 1))
    return FlowField.from_arrays(
        corners, [(0, 1, 2), (0, 2, 3)], wind, np.zeros((2, 4)), times=[0.0, 0.05], period=0.1, density=1.2
    )


def test_half_of_the_granules_fly_in_the_mirror_image_of_a_time_resolved_airflow(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    Flight(scene, plan, leaning(scene), 1e-4).fly_all(tmp_path, drawn=False)
    for name, landing in load_tracked(tmp_path, scene).landings.items():
        odd = landing.replicate % 2 == 1
        right, left = landing.position[~odd, 0].mean(), landing.position[odd, 0].mean()
        assert right > 5e-3
        assert left == pytest.approx(-right, abs=0.2 * right), name


def test_an_unsymmetric_geometry_has_no_mirror_image(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    plan = replace(plan, airflow=replace(plan.airflow, symmetric=False))
    Flight(scene, plan, leaning(scene), 1e-4).fly_all(tmp_path, drawn=False)
    for landing in load_tracked(tmp_path, scene).landings.values():
        assert landing.position[landing.replicate % 2 == 1, 0].mean() > 5e-3


def test_a_fraction_that_is_there_is_not_flown_again(scene: Scene, tmp_path: Path) -> None:
    told: list[str] = []
    flight = Flight(
        scene, make_plan(scene, rung="standard", force={"dispersion": False}), leaning(scene), 1e-4, tell=told.append
    )
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
