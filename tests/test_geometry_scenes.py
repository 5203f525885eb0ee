"""Shapes, several bodies, secondary streams, inlet profiles and a user's own case: from the scene to the numbers."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest

from wakeflow.errors import SceneError
from wakeflow.geometry import area, distance, distance_to, edges, is_simple, is_symmetric, rounded
from wakeflow.laws.shape import shapes

openfoam = [pytest.mark.openfoam, pytest.mark.skipif(shutil.which("simpleFoam") is None, reason="no OpenFOAM")]
RHOMBUS = shapes["rhombus"](width=0.05, slope_angle=math.pi / 3)


def turns(outline: np.ndarray) -> np.ndarray:
    """How much the outline turns at each corner (rad)."""
    start, end = edges(outline)
    after, before = end - start, start - np.roll(start, 1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.arctan2(cross, (before * after).sum(axis=1))


def test_a_circle_is_a_polygon_on_the_circle() -> None:
    outline = shapes["circle"](width=2.0)
    np.testing.assert_allclose(np.linalg.norm(outline, axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(np.ptp(outline, axis=0), 2.0, rtol=1e-15)
    assert area(outline) == pytest.approx(60 * math.sin(2 * math.pi / 120))
    assert is_symmetric(outline, tolerance=0.0)
    assert is_symmetric(outline[:, ::-1], tolerance=0.0)
    np.testing.assert_allclose(turns(outline), math.radians(3), rtol=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.99])
@pytest.mark.parametrize("slope", [10, 45, 80])
@pytest.mark.parametrize("shape", ["rhombus", "prism"])
def test_rounded_corners_touch_their_edges(shape: str, slope: float, share: float) -> None:
    sharp = shapes[shape](width=0.05, slope_angle=math.radians(slope))
    angle = np.abs(turns(sharp))
    start, end = edges(sharp)
    inscribed = 2 * area(sharp) / float(np.linalg.norm(end - start, axis=1).sum())
    with pytest.raises(SceneError, match="eats an edge"):
        rounded(sharp, 1.01 * inscribed)
    radius = share * inscribed
    outline = rounded(sharp, radius)
    assert is_simple(outline)
    assert is_symmetric(outline, tolerance=1e-12)
    assert turns(outline).max() <= math.radians(7.5) + 1e-12
    assert turns(outline).sum() == pytest.approx(2 * math.pi)
    # tangent circles cut r^2 (tan(t/2) - t/2) off each corner; their chords a little more
    kept = area(sharp) - radius**2 * float(np.sum(np.tan(angle / 2) - angle / 2))
    chords = radius**2 * float(angle.sum()) * math.radians(7.5) ** 2 / 12
    assert kept - chords <= area(outline) <= kept + 1e-15
    # every straight stretch that is left lies on an edge of the sharp shape
    start, end = edges(outline)
    straight = distance_to((start + end) / 2, sharp) < 1e-12
    assert np.count_nonzero(straight) == len(sharp)


def test_a_reentrant_corner_is_filled_by_its_arc() -> None:
    notch = shapes["polygon"](points=[[0, 0], [4, 0], [4, 4], [2, 2], [0, 4]])
    outline = rounded(notch, 0.2)
    assert is_simple(outline)
    added = 0.2**2 * (math.tan(math.pi / 4) - math.pi / 4)  # a right angle in: the arc lies on the air's side
    cut = sum(0.2**2 * (math.tan(t / 2) - t / 2) for t in np.radians([90, 90, 135, 135]))
    chords = 0.2**2 * 2 * math.pi * math.radians(7.5) ** 2 / 12
    assert area(outline) == pytest.approx(area(notch) + added - cut, abs=chords)
    assert turns(outline).min() < -0.05


def test_distance_between_outlines() -> None:
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    assert distance(square, square + np.array([1.5, 0.0])) == pytest.approx(0.5)
    assert distance(square, square + np.array([1.3, 1.4])) == pytest.approx(0.5)
    assert distance(square, square + np.array([0.5, 0.5])) == 0.0
    assert distance(square, 0.1 * square + 0.4) == 0.0  # one inside the other


def test_crossing_edges_are_found() -> None:
    assert is_simple(RHOMBUS)
    assert not is_simple(RHOMBUS[[0, 2, 1, 3]])
    comb = np.array([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (1, 1), (1, 2), (0, 2)], dtype=float)
    assert is_simple(comb)  # two of its edges lie on one line, apart
