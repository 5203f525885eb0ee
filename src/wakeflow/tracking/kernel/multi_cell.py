"""Multi-cell steps: many triangles in one go where no wall is near.

There are two. A *stride* (``strides``) is one step over several triangles; a *march* (``face_to_face``) ends its steps
on the faces of the triangles and judges its error in some of them. Confined steps (``step_control``) do the rest.
docs/kernel.md derives them and the numbers below.
"""

from __future__ import annotations

import math

from . import layout as at
from .face_to_face import march
from .jit import inlined
from .locate import cell_size
from .strides import onward, stride

MIN_STRIDE = 1.0  # sizes of a triangle: a shorter stride is better marched, which takes one look a triangle and no more
MIN_UNMARCHED = 0.25  # the same of a granule that does not march: a confined step goes no farther
MAX_STRIDE = 60.0  # the same: a longer stride may look at nothing of what it passes
DRAWN_STRIDE = 4.0  # the same, of a granule whose path is drawn
MAX_PATIENCE = 4  # steps after a march that did not get far are confined, 1, 2, 4 ... 2^this in a row
MAX_CONFINED = 3  # the same after a stride that was refused, of granules that do not march
FIRST_MARCH = 4  # triangles of the first march after a stride, and of all of a granule whose path is drawn
MAX_DOUBLINGS = 4  # of the triangles of a march from one refused stride to the next
WORTHWHILE_MARCH = 2  # triangles: a march that left more behind was worth it


@inlined
def multi_cell_step(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
    """Strides or a march over several triangles where that is worth it. Returns the steps taken, 0 for none.

    Not in contact. Forces made of the air's gradients jump at faces, what is past has no value there, and faces of a
    mesh that swings move: such granules do not march. After a stride that was refused for its error 4, 8 ... 64
    triangles are marched, or 1, 2, 4, 8 steps confined; after a march that was cut short the next 1, 2, 4 ... steps are
    confined.
    """
    if rules.march == 0 or hold[at.KIND] != at.FREE or grain[at.STOKES] == 0.0:
        return 0
    if grain[at.FORGET] != 0.0 and ints[at.STEPS] == 0:  # its memories begin
        return 0
    if ints[at.PATIENCE] > 0:
        ints[at.PATIENCE] -= 1
        return 0
    marches = grain[at.EXTRA] == 0.0 and grain[at.FORGET] == 0.0 and air.swing[at.SWING_OMEGA] == 0.0
    cell = cell_size(air.geometry, ints[at.TRI]) / math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2)
    least, most = (MIN_STRIDE if marches else MIN_UNMARCHED) * cell, (DRAWN_STRIDE if drawn else MAX_STRIDE) * cell
    h, refused, slope = stride(path, cell, least, most, state, ints, hold, affine, air, grain, table, walls, rules)
    if h > 0.0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = ints[at.MARCHES_CUT] = ints[at.STRIDES_REFUSED] = 0
        steps = 1
        if grain[at.NOISE] != 0.0 and not drawn:
            steps += onward(path, h, slope, state, ints, hold, affine, air, grain, table, walls, rules)
        ints[at.STEPS] += steps
        return steps
    if not marches:
        if refused:
            ints[at.PATIENCE] = 2 ** ints[at.STRIDES_REFUSED]
            ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, MAX_CONFINED)
        return 0
    most = (
        FIRST_MARCH if drawn else FIRST_MARCH * 2 ** ints[at.STRIDES_REFUSED]
    )  # triangles till the next stride is tried
    ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, MAX_DOUBLINGS)
    left = march(state, ints, affine, air, grain, table, walls, rules, most)
    if left > WORTHWHILE_MARCH:
        ints[at.MARCHES_CUT] = 0
    else:
        ints[at.PATIENCE] = 2 ** ints[at.MARCHES_CUT]
        ints[at.MARCHES_CUT] = min(ints[at.MARCHES_CUT] + 1, MAX_PATIENCE)
    if left > 0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = 0
        ints[at.STEPS] += left
    return left
