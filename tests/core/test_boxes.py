"""Boxes of a force in the plane: what they cover, their mirror image, their sum."""

from __future__ import annotations

import numpy as np
import pytest

from wakeflow.core.boxes import Boxes, ForceDensity


def test_boxes_fill_the_channel_and_none_lies_astride_the_axis() -> None:
    boxes = Boxes.across(0.4, -0.2, 0.2, 0.05 / 16)
    assert boxes.columns % 2 == 0
    assert boxes.columns * boxes.pitch == pytest.approx(0.4)
    assert boxes.bottom + boxes.rows * boxes.pitch >= 0.2 - 1e-12
    np.testing.assert_allclose(boxes.centres[0, :, 0], -boxes.centres[0, ::-1, 0], atol=1e-15)


def test_every_centre_lies_in_its_own_box_and_a_point_outside_in_the_nearest() -> None:
    boxes = Boxes(-0.3, 0.1, 0.1, 6, 3)
    np.testing.assert_array_equal(boxes.holding(boxes.centres.reshape(-1, 2)), np.arange(18))
    np.testing.assert_array_equal(boxes.holding(np.array([[-9.0, 0.15], [9.0, 9.0]])), [0, 17])


def test_a_mirrored_force_is_its_own_image_and_as_strong_along() -> None:
    boxes = Boxes(-0.2, 0.0, 0.1, 4, 2)
    force = ForceDensity(boxes, np.random.default_rng(1).normal(size=(2, 4, 2)))
    made = force.mirrored()
    np.testing.assert_allclose(made.density, made.density[:, ::-1] * (-1.0, 1.0))
    assert made.total == pytest.approx([0.0, force.total[1]], abs=1e-15)
    np.testing.assert_allclose(made.mirrored().density, made.density)


def test_the_part_of_a_way_and_what_is_too_weak() -> None:
    boxes = Boxes(0.0, 0.0, 0.5, 2, 1)
    weak, strong = (ForceDensity(boxes, np.array([[[0.0, a], [3.0, 4.0]]])) for a in (0.1, 0.3))
    assert weak.towards(strong, 0.5).density[0, 0, 1] == pytest.approx(0.2)
    assert weak.above(5.0).total == pytest.approx([0.75, 1.0])  # |(3, 4)| = 5 stays, 0.25 m2 a box
