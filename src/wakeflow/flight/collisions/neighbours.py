"""Neighbours of granules: a ball about the way that a granule goes in a step, and a larger one, its range, about the
ways of many steps. Pairs whose ranges touch are in a list; in a step only they are looked at, and of them only those
can meet whose balls touch.

A range lies ahead of its granule, so that it holds it for ``AHEAD`` steps unless it is struck, and when it is left,
that granule alone is listed anew, with a new range (Verlet lists, one granule at a time: Verlet, L. 1967, Phys. Rev.
159, 98). Who is about it then is asked of cells as wide as two of the largest ranges, in the buckets of a hash, which
needs no bounds and no room for empty cells (Teschner, M. et al. 2003, Vision, Modeling, Visualization, 47).
"""

from __future__ import annotations

import math

import numpy as np

from ..kernel import layout as at
from ..kernel.jit import called, compiled
from . import slab_layout as of

PX, PY, PZ = np.int64(73856093), np.int64(19349663), np.int64(83492791)  # primes of Teschner et al.
AHEAD = 16.0  # steps for which a range is meant at most; measured: twice and half of it are slower
WIDE = 2.5  # a range is no larger than so many of the largest balls: cells stay small
SPARE_WAY, SPARE_RADIUS = 0.25, 0.1  # of a range: for ways that bend, and for what moves little
ANEW = 128  # steps after which the cells' width is chosen anew
MAX_PAIRS, MIN_PAIRS = 8, 3  # pairs a granule, above which ranges become shorter and below which they grow again


@compiled
def across(z, depth):
    """A distance across the slab, to the nearest image."""
    return z - depth * round(z / depth)


@compiled
def near(balls, i, j, depth):
    """Whether the balls of two granules touch."""
    dx, dy = balls[i, of.BALL_X] - balls[j, of.BALL_X], balls[i, of.BALL_Y] - balls[j, of.BALL_Y]
    reach = balls[i, of.BALL] + balls[j, of.BALL]
    flat = dx * dx + dy * dy
    if flat > reach * reach:
        return False
    dz = across(balls[i, of.BALL_Z] - balls[j, of.BALL_Z], depth)
    return flat + dz * dz <= reach * reach


@compiled
def _wrap(extra, grain, ball):
    """The ball about the way that a granule goes since its last strike; returns its radius."""
    s = extra[of.LEG_END] - extra[of.LEG_BEGIN]
    half, sag = 0.5 * s, 0.125 * s * s
    vx, vy, vz = extra[of.LEG_VX], extra[of.LEG_VY], extra[of.LEG_VZ]
    ax, ay, az = extra[of.LEG_AX], extra[of.LEG_AY], extra[of.LEG_AZ]
    ball[of.BALL_X] = extra[of.LEG_X] + half * vx + sag * ax
    ball[of.BALL_Y] = extra[of.LEG_Y] + half * vy + sag * ay
    ball[of.BALL_Z] = extra[of.LEG_Z] + half * vz + sag * az
    way = half * math.sqrt(vx * vx + vy * vy + vz * vz) + 3.0 * sag * math.sqrt(ax * ax + ay * ay + az * az)
    ball[of.BALL] = (1.0 + of.SPARE_BALL) * (grain[at.GIRTH] + way)
    return ball[of.BALL]


@compiled
def _in_range(ball, reach, depth):
    """Whether a granule's ball lies within its range; not if it has none."""
    spare = reach[of.BALL] - ball[of.BALL]
    if spare < 0.0:
        return False
    dx, dy = ball[of.BALL_X] - reach[of.BALL_X], ball[of.BALL_Y] - reach[of.BALL_Y]
    dz = across(ball[of.BALL_Z] - reach[of.BALL_Z], depth)
    return dx * dx + dy * dy + dz * dz <= spare * spare


@compiled
def _reach_out(extra, grain, ball, reach, clock):
    """The range of a granule: about where it will be, as fast as it is, for some steps; returns its radius."""
    s = extra[of.LEG_END] - extra[of.LEG_BEGIN]
    vx, vy, vz = extra[of.LEG_VX] + s * extra[of.LEG_AX], extra[of.LEG_VY] + s * extra[of.LEG_AY], extra[of.LEG_VZ]
    vz += s * extra[of.LEG_AZ]
    ahead = 0.5 * (clock[of.AHEAD] - 1.0) * clock[of.STEP]
    way = (1.0 + SPARE_WAY) * ahead * math.sqrt(vx * vx + vy * vy + vz * vz)
    least = ball[of.BALL] + SPARE_RADIUS * grain[at.GIRTH]
    most = max(0.5 * clock[of.WIDTH] - least, 0.0)
    if way > most:
        ahead, way = ahead * (most / way), most
    reach[of.BALL_X] = ball[of.BALL_X] + ahead * vx
    reach[of.BALL_Y] = ball[of.BALL_Y] + ahead * vy
    reach[of.BALL_Z] = ball[of.BALL_Z] + ahead * vz
    reach[of.BALL] = least + way
    return reach[of.BALL]


@compiled
def _bucket(x, y, z, mask):
    """Where the granules of a cell are listed."""
    return ((x * PX) ^ (y * PY) ^ (z * PZ)) & mask


@called
def unlist(cells, counts, i):
    """Take a granule out of its cell, and its pairs out of the list; nothing if it is in none."""
    if cells.ranges[i, of.BALL] == 0.0:
        return
    b = _bucket(cells.where[i, 0], cells.where[i, 1], cells.where[i, 2], counts[of.MASK])
    j = cells.heads[b]
    if j == i:
        cells.heads[b] = cells.next[i]
    else:
        while cells.next[j] != i:
            j = cells.next[j]
        cells.next[j] = cells.next[i]
    cells.ranges[i, of.BALL] = 0.0
    cells.stamps[i] += 1


@compiled
def _pair(colliding, cells, counts, i, j):
    """List a pair, a tracer first. Tracers do not meet each other."""
    first, second = (j, i) if colliding.tally[j, of.TRACER] == 1 else (i, j)
    if colliding.tally[second, of.TRACER] == 1:
        return
    k = counts[of.PAIRS]
    if k == cells.pairs.shape[0]:
        counts[of.FULL] = 1
        return
    cells.pairs[k, of.FIRST], cells.pairs[k, of.SECOND] = first, second
    cells.pairs[k, of.FIRST_STAMP], cells.pairs[k, of.SECOND_STAMP] = cells.stamps[first], cells.stamps[second]
    counts[of.PAIRS] = k + 1


@called
def relist(colliding, cells, clock, counts, i):
    """Give a granule a new range from the way that it goes now, its cell, and its pairs with all whose ranges touch it;
    they follow those that ``counts[PAIRS]`` counted before.
    """
    unlist(cells, counts, i)
    cells.stamps[i] += 1
    _wrap(colliding.extra[i], colliding.grains[i], cells.balls[i])
    reach = _reach_out(colliding.extra[i], colliding.grains[i], cells.balls[i], cells.ranges[i], clock)
    clock[of.MOST] = max(clock[of.MOST], reach)
    per, high, mask = 1.0 / clock[of.WIDTH], int(clock[of.ROWS]), counts[of.MASK]
    column = np.int64(math.floor(cells.ranges[i, of.BALL_X] * per))
    row = np.int64(math.floor(cells.ranges[i, of.BALL_Y] * per))
    layer = np.int64(math.floor(cells.ranges[i, of.BALL_Z] * (high / clock[of.DEPTH])))
    layer -= high * np.int64(math.floor(layer / high))
    wide = max(1, math.ceil((reach + clock[of.MOST]) * per - of.SPARE_BALL))
    low, top = (-wide, wide) if high > 2 * wide else (0, high - 1)
    for dx in range(-wide, wide + 1):
        for dy in range(-wide, wide + 1):
            for dz in range(low, top + 1):
                x, y, z = column + dx, row + dy, layer + dz
                z = z + high if z < 0 else (z - high if z >= high else z)
                j = cells.heads[_bucket(x, y, z, mask)]
                while j >= 0:
                    if near(cells.ranges, i, j, clock[of.DEPTH]):
                        its = cells.where[j]  # other cells may share the bucket
                        if its[0] == x and its[1] == y and its[2] == z:
                            _pair(colliding, cells, counts, i, j)
                    j = cells.next[j]
    b = _bucket(column, row, layer, mask)
    cells.where[i, 0], cells.where[i, 1], cells.where[i, 2] = column, row, layer
    cells.next[i] = cells.heads[b]
    cells.heads[b] = i


@called
def _begin_anew(colliding, cells, clock, counts):
    """Empty the list and all cells, whose width and number follow the granules as they are now."""
    largest, living, size = 0.0, counts[of.LIVING], 64
    while size < 4 * living and size < cells.heads.shape[0]:  # as few buckets as do: they stay in the cache
        size *= 2
    cells.heads[:] = -1
    cells.ranges[:, of.BALL] = 0.0
    for k in range(living):
        largest = max(largest, cells.balls[colliding.living[k], of.BALL])
    if counts[of.PAIRS] > MAX_PAIRS * living or counts[of.FULL] == 1:
        clock[of.AHEAD] = max(1.0, 0.5 * clock[of.AHEAD])
    elif counts[of.PAIRS] < MIN_PAIRS * living:
        clock[of.AHEAD] = min(AHEAD, 2.0 * clock[of.AHEAD])
    clock[of.WIDTH], counts[of.MASK] = 2.0 * WIDE * largest, size - 1
    rows = math.floor(clock[of.DEPTH] / clock[of.WIDTH])
    clock[of.ROWS] = rows if rows >= 3 else 1  # fewer are all each other's neighbours
    clock[of.MOST] = 0.0
    counts[of.PAIRS] = counts[of.FULL] = 0
    counts[of.ANEW] = counts[of.STEPS] + ANEW


@called
def keep_lists(colliding, cells, clock, counts):
    """Put a ball about the way of every granule in this step, and list those anew that have left their ranges."""
    for k in range(counts[of.LIVING]):
        i = colliding.living[k]
        _wrap(colliding.extra[i], colliding.grains[i], cells.balls[i])
    if counts[of.STEPS] >= counts[of.ANEW] or clock[of.MOST] > (0.5 + of.SPARE_BALL) * clock[of.WIDTH]:
        _begin_anew(colliding, cells, clock, counts)
    while True:
        for k in range(counts[of.LIVING]):
            i = colliding.living[k]
            if not _in_range(cells.balls[i], cells.ranges[i], clock[of.DEPTH]):
                relist(colliding, cells, clock, counts, i)
        if counts[of.FULL] == 0 or clock[of.AHEAD] == 1.0:
            break
        _begin_anew(colliding, cells, clock, counts)
