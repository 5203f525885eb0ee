"""From granules at birth to the state arrays of the kernel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..field import FlowField
from .bodies import Body
from .granules import Granules
from .kernel import layout as at
from .kernel.layout import PackedAir

__all__ = ["pack_state"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
PAIRS = 1024  # granules whose distances from all covered edges are in memory at a time


def pack_state(
    grains: Granules, first: int, field: FlowField | None, air: PackedAir, bodies: Sequence[Body], reach: float
) -> tuple[Array, Index]:
    """State arrays at birth of granules numbered from ``first``; one in the room a vibrating body has left begins at
    the boundary edge it is next to.
    """
    floats = np.zeros((len(grains), at.FLOATS))
    floats[:, at.X], floats[:, at.Y] = grains.position.T
    floats[:, at.VX], floats[:, at.VY] = grains.velocity.T
    floats[:, [at.LAG, at.LAG + 1]] = grains.velocity if grains.arrival is None else grains.arrival
    floats[:, at.SPIN], floats[:, at.T], floats[:, at.BORN] = grains.spin, grains.time, grains.time
    ints = np.zeros((len(grains), at.INTS), dtype=np.int64)
    ints[:, [at.FATE, at.LINE, at.FEATURE, at.GAP, at.TRI]] = -1
    ints[:, at.FATE] = at.FLYING
    ints[:, at.STREAM] = first + np.arange(len(grains))
    if field is not None and len(grains):
        ints[:, at.TRI] = field.locate(grains.position)
        outside = np.flatnonzero(ints[:, at.TRI] < 0)
        if len(outside) and len(air.covered):
            ints[outside, at.GAP] = _nearest_covered(grains.position[outside], field, air, bodies, reach)
    return floats, ints


def _nearest_covered(x: Array, field: FlowField, air: PackedAir, bodies: Sequence[Body], reach: float) -> Index:
    """Covered edge next to each point outside the mesh, -1 where none is as near as its body may have moved."""
    swing = max(
        (
            float(np.hypot(body.motion.amplitude[0], body.motion.amplitude[1]))
            for body in bodies
            if body.motion is not None
        ),
        default=0.0,
    )
    triangle, edge = air.covered[:, at.COVER_TRI], air.covered[:, at.COVER_EDGE]
    a = field.points[field.triangles[triangle, (edge + 1) % 3]]
    along = field.points[field.triangles[triangle, (edge + 2) % 3]] - a
    found = np.full(len(x), -1, dtype=np.int64)
    for low in range(0, len(x), PAIRS):
        offset = x[low : low + PAIRS, None] - a
        w = np.clip(np.einsum("nci,ci->nc", offset, along) / np.einsum("ci,ci->c", along, along), 0.0, 1.0)
        distance = np.linalg.norm(offset - w[..., None] * along, axis=2)
        best = distance.argmin(axis=1)
        near = distance[np.arange(len(best)), best] <= swing + reach
        found[low : low + PAIRS] = np.where(near, best, -1)
    return found
