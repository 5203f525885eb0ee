"""What something changes of one field, brought to another field of the same channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from .blend import interpolated
from .flow import NODAL, FlowField

__all__ = ["changed_as"]

Array = NDArray[np.float64]
POSITIVE = ("k", "dissipation")
MOST = 10.0  # times as much, or as little, k and dissipation as before: chosen, where there was next to none before
AT_REST = 1e-3  # of the fastest air: mean speed at a wall


def changed_as(field: FlowField, before: FlowField, after: FlowField) -> FlowField:
    """``field`` with the change from ``before`` to ``after``, two steady fields on one mesh of the same channel.

    Velocity and pressure change by the difference, all through time; k and dissipation by the factor, at most MOST, so
    that they stay positive. Walls stay at rest. Each of the three fields conserves volume, and so does the result, to
    the error of interpolation. The change of a field as of ``before`` itself gives ``after``.
    Raises SceneError where before and after differ in their mesh or in what they hold, or lack what ``field`` has.
    """
    own = {name: values for name in NODAL if (values := getattr(field, name)) is not None}
    change = _change(own, before, after)
    same = len(field.points) == len(before.points) and bool(np.array_equal(field.points, before.points))
    if not same:
        change = interpolated(before, change, field.points)
        change["velocity"][_walls(field)] = 0.0
    made: dict[str, Any] = {}
    for name, values in own.items():
        if name in POSITIVE:
            made[name] = values * change[name]
        elif field.coefficients is None:
            made[name] = values + change[name]
        else:  # part 0 is the mean, the others have none
            made[name] = np.concatenate([values[:1] + change[name], values[1:]])
    return replace(field, **made)


def _change(own: Mapping[str, Array], before: FlowField, after: FlowField) -> dict[str, Array]:
    """Differences, of POSITIVE ones the factor, of all arrays in ``own``, on the nodes of both fields."""
    if before.times is not None or after.times is not None or not np.array_equal(before.points, after.points):
        raise SceneError("changed_as: before and after must be steady fields on one mesh")
    change = {}
    for name in own:
        source = "pressure_gradient" if name == "given_gradient" else name
        old, new = getattr(before, source), getattr(after, source)
        if old is None or new is None:
            raise SceneError(f"changed_as: the fields of the change have no {name}, the one to be changed has")
        if name in POSITIVE:
            least = np.finfo(float).tiny
            change[name] = np.clip(np.maximum(new, least) / np.maximum(old, least), 1.0 / MOST, MOST)
        else:
            change[name] = new - old
    return change


def _walls(field: FlowField) -> NDArray[np.int64]:
    """Nodes of the boundary where the mean air rests."""
    speed = np.linalg.norm(field.mean().velocity, axis=1)
    edge = np.unique(field.boundary)
    return np.asarray(edge[speed[edge] < AT_REST * speed.max()])
