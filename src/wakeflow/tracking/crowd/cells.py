"""Who is near whom: balls about the ways of a step, sorted into cells, cells into the buckets of a hash.

The ball of a granule holds all of it on its way in the step. A cell is as wide as two of the largest balls, so that
whoever can be met stands in one of the 27 cells about one's own; most of those are told apart by their balls alone. The
hash (Teschner, M. et al. 2003, Vision, Modeling, Visualization, 47) needs no bounds and no room for empty cells.
"""

from __future__ import annotations

import math

import numpy as np

from ..kernel import layout as at
from ..kernel.jit import compiled, inlined
from . import layout as of

__all__ = ["across", "bucket", "clear_cells", "move", "near", "sort_into_cells"]

PX, PY, PZ = np.int64(73856093), np.int64(19349663), np.int64(83492791)  # primes of Teschner et al.


@inlined
def across(z, depth):
    """A distance across the slab, to the nearest image."""
    return z - depth * round(z / depth)


@inlined
def bucket(x, y, z, mask):
    """Where the granules of a cell are listed."""
    return ((x * PX) ^ (y * PY) ^ (z * PZ)) & mask


@inlined
def near(balls, i, j, depth):
    """Whether the balls of two granules touch, so that they may meet."""
    dx, dy = balls[i, of.BALL_X] - balls[j, of.BALL_X], balls[i, of.BALL_Y] - balls[j, of.BALL_Y]
    reach = balls[i, of.BALL] + balls[j, of.BALL]
    flat = dx * dx + dy * dy
    if flat > reach * reach:
        return False
    dz = across(balls[i, of.BALL_Z] - balls[j, of.BALL_Z], depth)
    return flat + dz * dz <= reach * reach


@inlined
def _wrap(own, grain, ball):
    """The ball about the way that a granule goes since its last strike; returns its radius."""
    s = own[of.LEG_END] - own[of.LEG_BEGIN]
    half, sag = 0.5 * s, 0.125 * s * s
    vx, vy, vz = own[of.LEG_VX], own[of.LEG_VY], own[of.LEG_VZ]
    ax, ay, az = own[of.LEG_AX], own[of.LEG_AY], own[of.LEG_AZ]
    ball[of.BALL_X] = own[of.LEG_X] + half * vx + sag * ax
    ball[of.BALL_Y] = own[of.LEG_Y] + half * vy + sag * ay
    ball[of.BALL_Z] = own[of.LEG_Z] + half * vz + sag * az
    way = half * math.sqrt(vx * vx + vy * vy + vz * vz) + 3.0 * sag * math.sqrt(ax * ax + ay * ay + az * az)
    ball[of.BALL] = (1.0 + of.SPARE_BALL) * (grain[at.RADIUS] + way)
    return ball[of.BALL]


@inlined
def _put(crowd, cells, clock, counts, i):
    """List a granule by the cell in which its ball stands; a tracer, which nobody can hit, only knows its cell."""
    per, count = 1.0 / clock[of.WIDTH], int(clock[of.ROWS])
    ball, tally = cells.balls[i], crowd.tally[i]
    tally[of.CELL_X] = math.floor(ball[of.BALL_X] * per)
    tally[of.CELL_Y] = math.floor(ball[of.BALL_Y] * per)
    layer = math.floor(ball[of.BALL_Z] * (count / clock[of.DEPTH]))
    tally[of.CELL_Z] = layer - count * math.floor(layer / count)
    if tally[of.TRACER] == 0:
        b = bucket(tally[of.CELL_X], tally[of.CELL_Y], tally[of.CELL_Z], counts[of.MASK])
        cells.next[i] = cells.heads[b]
        cells.heads[b] = i


@compiled
def sort_into_cells(crowd, cells, clock, counts):
    """Put a ball about the way of every granule, and list those that others can hit."""
    largest, living, size = 0.0, counts[of.LIVING], 1
    while size < 2 * living and size < cells.heads.shape[0]:  # as few buckets as do: they stay in the cache
        size *= 2
    for k in range(living):
        i = crowd.living[k]
        largest = max(largest, _wrap(crowd.own[i], crowd.grains[i], cells.balls[i]))
    clock[of.MOST], clock[of.WIDTH], counts[of.MASK] = largest, 2.0 * largest, size - 1
    rows = math.floor(clock[of.DEPTH] / clock[of.WIDTH])
    clock[of.ROWS] = rows if rows >= 3 else 1  # fewer are all each other's neighbours
    for k in range(living):
        _put(crowd, cells, clock, counts, crowd.living[k])


@compiled
def move(crowd, cells, clock, counts, i):
    """Bring the ball of a granule that flies another way, and the cell that lists it, up to date."""
    tally = crowd.tally[i]
    if tally[of.TRACER] == 0:
        b = bucket(tally[of.CELL_X], tally[of.CELL_Y], tally[of.CELL_Z], counts[of.MASK])
        j = cells.heads[b]
        if j == i:
            cells.heads[b] = cells.next[i]
        else:
            while cells.next[j] != i:
                j = cells.next[j]
            cells.next[j] = cells.next[i]
    clock[of.MOST] = max(clock[of.MOST], _wrap(crowd.own[i], crowd.grains[i], cells.balls[i]))
    _put(crowd, cells, clock, counts, i)


@compiled
def clear_cells(crowd, cells, counts):
    """Empty the buckets that were used."""
    for k in range(counts[of.LIVING]):
        tally = crowd.tally[crowd.living[k]]
        cells.heads[bucket(tally[of.CELL_X], tally[of.CELL_Y], tally[of.CELL_Z], counts[of.MASK])] = -1
