"""Strides where no wall is near: one step over several triangles (``strides``), in place of many confined ones
(``step_control``). docs/model.md derives them and the numbers below.
"""

from __future__ import annotations

import math

from . import layout as at
from .jit import compiled
from .locate import cell_size
from .strides import onward, stride

MIN_STRIDE = 0.5  # sizes of a triangle: its mean chord, and so as far as a confined step goes
MAX_STRIDE = 60.0  # the same: a longer stride may look at nothing of what it passes
DRAWN_STRIDE = 4.0  # the same, of a granule whose path is drawn
MAX_CONFINED = 3  # steps after a stride that was refused are confined, 1, 2, 4 ... 2^this in a row


@compiled
def multi_cell_step(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
    """Strides over several triangles where that is worth it. Returns whether there was one.

    Not in contact: what is past has no value there. After a stride that was refused for its error 1, 2, 4, 8 steps are
    confined before the next is tried.
    """
    if rules.march == 0 or hold[at.KIND] != at.FREE or grain[at.STOKES] == 0.0:
        return False
    if grain[at.FORGET] != 0.0 and ints[at.STEPS] == 0:  # its memories begin
        return False
    if ints[at.PATIENCE] > 0:
        ints[at.PATIENCE] -= 1
        return False
    cell = cell_size(air.geometry, ints[at.TRI]) / math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2)
    least, most = MIN_STRIDE * cell, (DRAWN_STRIDE if drawn else MAX_STRIDE) * cell
    h, refused, slope = stride(path, cell, least, most, state, ints, hold, affine, air, grain, table, walls, rules)
    if h > 0.0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = ints[at.STRIDES_REFUSED] = 0
        ints[at.STEPS] += 1
        if grain[at.NOISE] != 0.0 and not drawn:
            ints[at.STEPS] += onward(path, h, slope, state, ints, hold, affine, air, grain, table, walls, rules)
        return True
    if refused:
        ints[at.PATIENCE] = 2 ** ints[at.STRIDES_REFUSED]
        ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, MAX_CONFINED)
    return False
