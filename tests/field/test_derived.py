"""Vorticity and stream function of flows whose own are known."""

from __future__ import annotations

import numpy as np
import pytest

from support import field_of
from wakeflow.field.derived import stream_function, vorticity


def _strain_and_turn(points: np.ndarray) -> np.ndarray:
    """psi = x y + x^2 + y^2: u = x + 2 y, v = -y - 2 x; it turns with -4 1/s everywhere."""
    x, y = points.T
    return np.stack([x + 2.0 * y, -y - 2.0 * x], axis=1)


def test_the_vorticity_of_a_linear_flow_is_exact() -> None:
    assert vorticity(field_of(_strain_and_turn)) == pytest.approx(-4.0)


def test_stream_function_gives_the_flow_between_two_points() -> None:
    errors = []
    for n in (10, 20):
        field = field_of(_strain_and_turn, n)
        x, y = field.points.T
        exact = x * y + x**2 + y**2
        psi = stream_function(field)
        errors.append(np.abs(psi - psi.mean() - (exact - exact.mean())).max())
    assert errors[0] < 0.05
    assert errors[1] < errors[0] / 3.0  # second order


def test_the_stream_function_is_of_one_instant() -> None:
    field = field_of(_strain_and_turn)
    moving = type(field).from_arrays(
        field.points, field.triangles, np.stack([field.velocity] * 2), times=[0.0, 1.0]
    )  # fmt: skip
    with pytest.raises(ValueError, match="steady"):
        stream_function(moving)
    assert vorticity(moving).shape == (2, len(field.points))
