"""How far the nearest wall or line is at least: the room in which a step may go without looking for contacts."""

from __future__ import annotations

import math

from . import layout as at
from .jit import compiled

__all__ = ["clearance"]


@compiled
def clearance(walls, x, y, radius, enough):
    """A lower bound on the way to the nearest wall or line, wherever the wall is; no more than ``enough`` is told."""
    free = enough
    edges, lines, members = walls.edges, walls.lines, walls.members
    for body in range(walls.bodies.shape[0]):
        box, swing = walls.bodies[body], radius
        if box[at.OMEGA] != 0.0:
            swing += math.sqrt(box[at.REACH_X] ** 2 + box[at.REACH_Y] ** 2)
        dx, dy = max(box[at.LOW_X] - x, x - box[at.HIGH_X], 0.0), max(box[at.LOW_Y] - y, y - box[at.HIGH_Y], 0.0)
        if dx * dx + dy * dy >= (free + swing) ** 2:
            continue
        for e in range(members[body, at.FIRST_EDGE], members[body, at.LAST_EDGE]):
            free = min(free, _distance(edges, e, x, y) - swing)
    frame, moved = walls.frame, 0.0
    if frame[0, at.OMEGA] != 0.0:
        moved = math.sqrt(frame[0, at.REACH_X] ** 2 + frame[0, at.REACH_Y] ** 2)
    for i in range(lines.shape[0]):
        free = min(free, _distance(lines, i, x, y) - moved)
    return free


@compiled
def _distance(segments, i, x, y):
    """Distance of a point from a segment."""
    x0, y0 = segments[i, at.FROM_X], segments[i, at.FROM_Y]
    ex, ey, dx, dy = segments[i, at.TO_X] - x0, segments[i, at.TO_Y] - y0, x - x0, y - y0
    w = min(1.0, max(0.0, (dx * ex + dy * ey) / (ex * ex + ey * ey)))
    dx -= w * ex
    dy -= w * ey
    return math.sqrt(dx * dx + dy * dy)
