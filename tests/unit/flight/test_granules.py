"""Granules: what is refused, and parts and changed copies of them."""

import numpy as np
import pytest

from wakeflow.core.errors import SceneError
from wakeflow.flight import Granules


def three() -> Granules:
    size = np.array([1e-3, 2e-3, 3e-3])
    return Granules(np.arange(6.0).reshape(3, 2), np.zeros((3, 2)), size, 800.0, fraction=[0, 1, 2], shape=np.ones(3))


def test_parts_keep_every_property_and_share_no_numbers_with_the_whole() -> None:
    whole = three()
    for chosen in (slice(1, None), np.array([1, 2]), np.array([False, True, True])):
        part = whole[chosen]
        assert len(part) == 2
        for name, values in vars(whole).items():
            np.testing.assert_equal(getattr(part, name), values if values is None else values[1:])
        part.position[:] = 9.0
        assert whole.position[1, 0] == 2.0
    with pytest.raises(SceneError, match="a slice, indices or a mask"):
        whole[1]


def test_changes_are_checked_and_leave_the_rest_as_it_is() -> None:
    whole = three()
    made = whole.replace(density=[1.0, 2.0, 3.0], inertia=None, drag_scale=None, diameter=1e-7)
    assert made.density.tolist() == [1.0, 2.0, 3.0]
    assert np.isinf(made.inertia).all()
    assert made.drag_scale is None  # until it is known which gas it flies in
    np.testing.assert_array_equal(made.fraction, whole.fraction)
    made.position[:] = 9.0
    assert whole.position[0, 0] == 0.0
    for changes, said in (
        ({"density": [1.0, -1.0, 1.0]}, "granule density: 1 of 3 must be positive, first -1.0 at index 1"),
        ({"velocity": np.full((3, 2), np.nan)}, "granule velocity: 3 of 3 must be finite"),
        ({"shape": [1.0, 0.0, 1.0]}, "granule shape: 3 of 3 must be positive"),
        ({"inertia": np.nan}, "granule inertia: 3 of 3 must be positive"),
        ({"time": np.zeros(2)}, r"granule time: shape \(2,\) does not fit \(3,\)"),
        ({"arrival": np.full((3, 2), np.inf)}, "granule arrival: 3 of 3 must be finite"),
    ):
        with pytest.raises(SceneError, match=said):
            whole.replace(**changes)


def test_another_number_of_granules_must_fit_all_that_is_kept() -> None:
    with pytest.raises(SceneError, match="does not fit"):
        three().replace(position=np.zeros((4, 2)))
