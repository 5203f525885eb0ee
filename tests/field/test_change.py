"""A change of one field brought to another: exact on its own mesh, whole through time, positive, at rest on walls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support import field_of, shaken_mesh
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.field.change import changed_as


def turning(points: np.ndarray) -> np.ndarray:
    return np.stack([1.0 + points[:, 1], 0.3 - points[:, 0]], axis=1)


def steady(n: int = 12, more: float = 0.0) -> FlowField:
    """A linear flow with pressure and turbulence; ``more`` of each."""
    points, cells = shaken_mesh(n, -1.0, 1.0)
    x = points[:, 0]
    return FlowField.from_arrays(
        points, cells, (1.0 + more) * turning(points), pressure=(2.0 + more) * x,
        k=(1.0 + more) * (2.0 + x), dissipation=(1.0 + 2.0 * more) * (3.0 + x),
    )  # fmt: skip


def in_time(n: int, snapshots: int = 8) -> FlowField:
    base, phase = steady(n), np.arange(snapshots) / snapshots * 2 * np.pi
    waves = 1.0 + 0.2 * np.cos(phase)
    return FlowField.from_arrays(
        base.points, base.triangles, waves[:, None, None] * base.velocity, np.outer(waves, base.pressure),
        times=phase, period=2 * np.pi, k=np.outer(waves, base.k), dissipation=np.outer(waves, base.dissipation),
    )  # fmt: skip


def test_the_change_of_a_field_itself_is_the_changed_one() -> None:
    before, after = steady(), steady(more=0.25)
    found = changed_as(before, before, after)
    for name in ("velocity", "pressure", "k", "dissipation"):
        np.testing.assert_allclose(getattr(found, name), getattr(after, name), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_field_in_time_keeps_its_fluctuation_and_gets_the_difference_on_its_own_nodes(compressed: bool) -> None:
    whole = in_time(9)
    field = whole.compressed(1e-6) if compressed else whole
    found = changed_as(field, steady(), steady(more=0.25))
    places = np.array([[0.1, 0.2], [-0.4, 0.5], [0.0, -0.61]])
    for t in (0.3, 2.0, 5.1):
        old, new = field.sample(places, t), found.sample(places, t)
        np.testing.assert_allclose(new[0] - old[0], 0.25 * turning(places), atol=2e-6)  # linear: no interpolation error
        np.testing.assert_allclose(new[1] - old[1], 0.25 * places[:, 0], atol=2e-6)
    old, new = field.snapshots(), found.snapshots()
    np.testing.assert_allclose(new.k / old.k, 1.25, rtol=1e-5)
    np.testing.assert_allclose(new.dissipation / old.dissipation, 1.5, rtol=1e-5)
    assert found.period == field.period


def test_the_result_conserves_volume() -> None:
    found = changed_as(in_time(9), steady(), steady(more=0.25))
    assert found.mean().divergence().max < 1e-12


def test_where_there_was_next_to_no_turbulence_it_grows_by_no_more_than_ten() -> None:
    before = steady()
    calm = replace(before, k=np.full(len(before.points), 1e-9))
    found = changed_as(calm, calm, replace(before, k=np.full(len(before.points), 1.0)))
    np.testing.assert_allclose(found.k, 1e-8)


def test_walls_stay_at_rest_on_another_mesh() -> None:
    def shear(points: np.ndarray) -> np.ndarray:  # at rest on y = -1
        return np.stack([1.0 + points[:, 1], np.zeros(len(points))], axis=1)

    before, field = field_of(shear, 12), field_of(shear, 7)
    after = replace(before, velocity=before.velocity + 0.1)  # also on the wall, as interpolation may make it
    found = changed_as(field, before, after)
    wall = np.isclose(field.points[:, 1], -1.0)
    assert wall.sum() > 5
    np.testing.assert_array_equal(found.velocity[wall], field.velocity[wall])
    np.testing.assert_allclose(found.velocity[~wall] - field.velocity[~wall], 0.1)


def test_fields_that_do_not_fit_are_refused() -> None:
    with pytest.raises(SceneError, match="steady fields on one mesh"):
        changed_as(steady(), steady(), steady(10))
    with pytest.raises(SceneError, match="steady fields on one mesh"):
        changed_as(steady(), steady(), in_time(12))
    bare = field_of(turning, 12)
    with pytest.raises(SceneError, match="no pressure"):
        changed_as(steady(), bare, bare)
