"""The coefficient of restitution of one strike: a body's own, a granule's number, or the granules' law at the approach
speed.
"""

from __future__ import annotations

import math

from ...laws.collision import approach_speed
from .jit import compiled
from .layout import RESTITUTION, VX, VY

__all__ = ["restitution_of"]

_approach = compiled(approach_speed)
SLOWEST = 1e-300  # m/s: has a logarithm


@compiled
def restitution_of(state, grain, walls, body, nx, ny, wx, wy):
    """e of the collision with ``body``, whose surface moves with w and has the normal n there."""
    own = walls.bodies[body, 8]
    if own >= 0.0:
        return own
    if grain[RESTITUTION] >= 0.0:
        return grain[RESTITUTION]
    cells = walls.restitution
    y = math.log10(max(_approach(state[VX], state[VY], nx, ny, wx, wy), SLOWEST))
    low, high = 0, cells.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if cells[middle, 0] <= y:
            low = middle
        else:
            high = middle
    w = min(1.0, max(0.0, (y - cells[low, 0]) * cells[low, 1]))
    e = cells[low, 2] + w * (cells[low, 3] + w * (cells[low, 4] + w * cells[low, 5]))
    return min(1.0, max(0.0, e))
