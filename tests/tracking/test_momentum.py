"""What granules exert on the air: it is what they lost to it, whatever walls they met and however coarse the boxes."""

from typing import Any

import numpy as np
import pytest

from support import DENSITY, G, field_of, with_tau
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import Boxes
from wakeflow.tracking import Granules, Tracks, track
from wakeflow.tracking.momentum import force_on_the_air

WIND = np.array([0.4, -1.5])  # m/s
FLOW = 0.7  # kg/s and metre
BOXES = Boxes.across(2.0, -1.0, 1.0, 0.05)
ROOF = np.array([[-0.4, -0.5], [0.4, -0.5], [0.0, 0.1]])  # m: granules bounce off it and slide down its sides


def windy(points: np.ndarray) -> np.ndarray:
    return np.broadcast_to(WIND, points.shape)


def falling(tau: float, count: int = 40, **more: Any) -> Granules:
    places = np.stack([np.linspace(-0.3, 0.3, count), np.full(count, 0.7)], axis=1)
    return with_tau(tau, places, np.zeros((count, 2)), **more)


def test_in_free_flight_the_force_is_what_the_ends_of_the_tracks_tell() -> None:
    grains = falling(0.2)
    tracks = track(field_of(windy), grains, until=0.35, tolerance=1e-6, record=True)
    force = force_on_the_air(tracks, grains, FLOW, BOXES)
    lost = -(tracks.velocity - grains.velocity - np.outer(tracks.time, (0.0, -G))).mean(axis=0) * FLOW
    assert force.total == pytest.approx(lost, rel=1e-11)
    assert force.total[0] < 0.0  # the wind pushes them to the right, they push it to the left


@pytest.mark.parametrize(("restitution", "error"), [(0.0, 1e-3), (0.6, 1e-4)])
def test_walls_take_no_part_of_it(restitution: float, error: float) -> None:
    """Under Stokes drag in a uniform wind u the air gives (u T - way) / tau, whatever walls give beside it; along a
    wall, where granules without rebound slide, to the trapezoidal rule over the tracker's steps.
    """
    tau = 0.2
    grains = falling(tau, restitution=restitution, friction=0.3)
    tracks = track(field_of(windy), grains, until=0.6, tolerance=1e-7, bodies=[ROOF], drag="stokes", record=True)
    assert np.mean(tracks.impacts > 0) > 0.8
    force = force_on_the_air(tracks, grains, FLOW, BOXES)
    way = tracks.position - grains.position
    given = ((np.outer(tracks.time, WIND) - way) / tau).mean(axis=0)
    assert force.total == pytest.approx(-FLOW * given, rel=error)


def test_neither_boxes_nor_thinned_paths_change_the_whole_force() -> None:
    grains, field = falling(0.05), field_of(windy)
    tracks, thin = (
        track(field, grains, until=0.6, tolerance=1e-6, bodies=[ROOF], record=points) for points in (1024, 16)
    )
    fine = force_on_the_air(tracks, grains, FLOW, BOXES)
    coarse = force_on_the_air(tracks, grains, FLOW, Boxes.across(2.0, -1.0, 1.0, 1.0))
    assert coarse.total == pytest.approx(fine.total, rel=1e-12)
    assert force_on_the_air(thin, grains, FLOW, BOXES).total == pytest.approx(fine.total, rel=1e-9)


def test_at_terminal_velocity_the_air_carries_the_weight_of_what_is_in_a_box() -> None:
    """n m g: a mass flow M at the speed v is M / v in a metre of height, and buoyancy is no drag."""
    tau, speed = 0.01, 0.01 * G
    places = np.stack([np.full(32, 0.025), np.linspace(0.3, 0.35, 32)], axis=1)
    grains = with_tau(tau, places, np.tile([0.0, -speed], (32, 1)))
    tracks = track(
        field_of(np.zeros_like),
        grains,
        until=6.0,
        tolerance=1e-8,
        drag="stokes",
        forces=("drag", "gravity"),
        record=True,
    )
    force = force_on_the_air(tracks, grains, FLOW, BOXES)
    column = np.flatnonzero(np.abs(BOXES.centres[0, :, 0] - 0.025) < 1e-9)
    rows = np.flatnonzero(np.abs(BOXES.centres[:, 0, 1]) < 0.2)
    expected = -FLOW / speed * G / BOXES.pitch
    assert float(force.density[rows, column, 1].mean()) == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(force.density[rows, column, 1], expected, rtol=0.1)  # a piece of a track more or less
    light = force_on_the_air(tracks, grains, FLOW, BOXES, air_density=DENSITY, forces=("drag", "gravity", "buoyancy"))
    ratio = 1.0 - DENSITY / grains.density[0]  # the same path told as one with buoyancy: so much less was drag
    assert light.total[1] == pytest.approx(ratio * force.total[1], rel=1e-9)


def test_a_mirrored_scene_exerts_the_mirror_image() -> None:
    def bent(points: np.ndarray) -> np.ndarray:
        return np.stack([points[:, 0], -1.0 - points[:, 1]], axis=1)

    grid = np.linspace(-1.0, 1.0, 21)
    points = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    from scipy.spatial import Delaunay

    from wakeflow.field import FlowField

    field = FlowField.from_arrays(points, Delaunay(points).simplices, bent(points))
    place = np.array([[0.31, 0.6]])
    forces = []
    for sign in (1.0, -1.0):
        grains = with_tau(0.1, place * (sign, 1.0), np.zeros((1, 2)))
        tracks = track(field, grains, until=0.5, tolerance=1e-9, bodies=[ROOF], record=True)
        forces.append(force_on_the_air(tracks, grains, FLOW, BOXES))
    np.testing.assert_allclose(forces[0].total, forces[1].total * (-1.0, 1.0), rtol=1e-6)


def test_tracks_without_paths_are_refused() -> None:
    with pytest.raises(SceneError, match="no paths were kept"):
        force_on_the_air(Tracks.empty(1), falling(0.1, 1), FLOW, BOXES)
