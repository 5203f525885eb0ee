"""The coefficient of restitution of one strike: a body's own, a granule's number, or the granules' law at the approach
speed.
"""

from __future__ import annotations

import math

from ...laws.collision import approach_speed
from . import layout as at
from .jit import compiled

__all__ = ["restitution_of"]

_approach = compiled(approach_speed)
SLOWEST = 1e-300  # m/s: has a logarithm


@compiled
def restitution_of(state, grain, walls, body, nx, ny, wx, wy):
    """e of the collision with ``body``, whose surface moves with w and has the normal n there."""
    own = walls.bodies[body, at.BODY_RESTITUTION]
    if own >= 0.0:
        return own
    if grain[at.RESTITUTION] >= 0.0:
        return grain[at.RESTITUTION]
    cells = walls.restitution
    y = math.log10(max(_approach(state[at.VX], state[at.VY], nx, ny, wx, wy), SLOWEST))
    low, high = 0, cells.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if cells[middle, at.CELL_BEGIN] <= y:
            low = middle
        else:
            high = middle
    w = min(1.0, max(0.0, (y - cells[low, at.CELL_BEGIN]) * cells[low, at.CELL_PER]))
    e = cells[low, at.CELL_0] + w * (cells[low, at.CELL_1] + w * (cells[low, at.CELL_2] + w * cells[low, at.CELL_3]))
    return min(1.0, max(0.0, e))
