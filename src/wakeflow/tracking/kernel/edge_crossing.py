"""From triangle to triangle: over an edge into the next one, or out of the mesh, where the track ends."""

from __future__ import annotations

import math

from . import layout as at
from .events import wall_displacement
from .jit import compiled, inlined
from .locate import barycentric, walk
from .step_control import EDGE

__all__ = ["cross_edge", "hop", "relocate"]

ON_LINE = 1e-9  # of the extent: round-off of a place on the mesh's boundary; chosen: far above that of doubles


@compiled
def _at_boundary(state, ints, air, walls, rules, k):
    """End the track on edge k of the mesh, or on the line that lies there."""
    tri, g = ints[at.TRI], air.geometry
    bx, by = g[tri, at.B0X + 2 * k], g[tri, at.B0Y + 2 * k]
    off = barycentric(g, tri, k, state[at.X], state[at.Y]) / (bx * bx + by * by)
    state[at.X] -= off * bx
    state[at.Y] -= off * by
    ints[at.FATE] = at.ESCAPED
    near = ON_LINE * rules.extent + rules.allowance * rules.extent
    sx, sy, _, _, _, _ = wall_displacement(walls.frame, 0, state[at.T])
    for i in range(walls.lines.shape[0]):
        x0, y0, x1, y1 = (
            walls.lines[i, at.FROM_X] + sx,
            walls.lines[i, at.FROM_Y] + sy,
            walls.lines[i, at.TO_X] + sx,
            walls.lines[i, at.TO_Y] + sy,
        )
        ex, ey = x1 - x0, y1 - y0
        w = ((state[at.X] - x0) * ex + (state[at.Y] - y0) * ey) / (ex * ex + ey * ey)
        w = min(1.0, max(0.0, w))
        dx, dy = state[at.X] - x0 - w * ex, state[at.Y] - y0 - w * ey
        if math.sqrt(dx * dx + dy * dy) <= near:
            ints[at.FATE], ints[at.LINE] = at.BINNED, walls.line_ids[i]
            return


@compiled
def cross_edge(state, ints, air, walls, rules, k):
    """Go over edge k of the current triangle."""
    onward = air.neighbours[ints[at.TRI], k]
    ints[at.FRESH] = 0
    if onward >= 0:
        ints[at.TRI] = onward
    elif onward == -1:
        _at_boundary(state, ints, air, walls, rules, k)
    else:
        ints[at.GAP] = -2 - onward


@inlined
def hop(state, ints, air, walls, rules):
    """Cross at once an edge the granule stands on and moves out through. Returns whether it did."""
    tri, worst, edge = ints[at.TRI], 0.0, at.NOBODY
    for k in range(3):
        if barycentric(air.geometry, tri, k, state[at.X], state[at.Y]) <= EDGE:
            bx, by = air.geometry[tri, at.B0X + 2 * k], air.geometry[tri, at.B0Y + 2 * k]
            rate = (bx * state[at.VX] + by * state[at.VY]) / math.sqrt(bx * bx + by * by)
            if rate < worst:
                worst, edge = rate, k
    if edge < 0:
        return False
    ints[at.HOPS] += 1
    cross_edge(state, ints, air, walls, rules, edge)
    return True


@compiled
def relocate(state, ints, air):
    """The triangle of a granule that has moved without a look at the faces it crossed."""
    found, code = walk(air.geometry, air.neighbours, ints[at.TRI], state[at.X], state[at.Y])
    ints[at.TRI] = found
    if code <= -2:
        ints[at.GAP] = -2 - code
    elif code == -1:
        ints[at.FATE] = at.ESCAPED
