"""Who is near whom: granules sorted into cells, cells into the buckets of a hash.

A cell is as wide as the largest granule and twice the longest way of the step, so that whoever can be met stands in one
of the 27 cells about one's own. The hash (Teschner, M. et al. 2003, Vision, Modeling, Visualization, 47) needs no
bounds and no room for empty cells.
"""

from __future__ import annotations

import math

import numpy as np

from ..kernel.jit import compiled
from . import layout as of

__all__ = ["across", "bucket", "clear_cells", "rows_across", "sort_into_cells", "width"]

PX, PY, PZ = np.int64(73856093), np.int64(19349663), np.int64(83492791)  # primes of Teschner et al.


@compiled
def width(clock):
    """Width of a cell (m)."""
    return clock[of.LARGEST] + 2.0 * clock[of.REACH]


@compiled
def rows_across(clock):
    """Cells across the slab; 1 where fewer than three would fit, which are all each other's neighbours."""
    count = int(clock[of.DEPTH] / width(clock))
    return count if count >= 3 else 1


@compiled
def across(z, depth):
    """A distance across the slab, to the nearest image."""
    return z - depth * round(z / depth)


@compiled
def bucket(x, y, z, heads):
    """Where the granules of a cell are listed."""
    return ((x * PX) ^ (y * PY) ^ (z * PZ)) & np.int64(heads.shape[0] - 1)


@compiled
def sort_into_cells(crowd, cells, clock, living):
    """List the granules that others can hit by the cell in which their way begins."""
    per, count = 1.0 / width(clock), rows_across(clock)
    per_z = count / clock[of.DEPTH]
    for k in range(living):
        i = crowd.living[k]
        own, tally = crowd.own[i], crowd.tally[i]
        tally[of.CELL_X] = math.floor(own[of.LEG_X] * per)
        tally[of.CELL_Y] = math.floor(own[of.LEG_Y] * per)
        layer = math.floor(own[of.LEG_Z] * per_z)
        tally[of.CELL_Z] = layer - count * math.floor(layer / count)
        if tally[of.TRACER] == 0:
            b = bucket(tally[of.CELL_X], tally[of.CELL_Y], tally[of.CELL_Z], cells.heads)
            tally[of.NEXT] = cells.heads[b]
            cells.heads[b] = i


@compiled
def clear_cells(crowd, cells, living):
    """Empty the buckets that were used."""
    for k in range(living):
        tally = crowd.tally[crowd.living[k]]
        cells.heads[bucket(tally[of.CELL_X], tally[of.CELL_Y], tally[of.CELL_Z], cells.heads)] = -1
