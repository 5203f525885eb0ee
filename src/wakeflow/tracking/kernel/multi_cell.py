"""Multi-cell steps: many triangles in one go where no wall is near.

There are two. A *march* (``face_to_face``) ends its steps on the faces of the triangles and judges its error in some of
them; a *stride* (``across_faces``) is one step over several triangles. Confined steps (``step_control``) do the rest.
"""

from __future__ import annotations

from . import layout as at
from .across_faces import stride
from .face_to_face import march, way_out
from .jit import inlined

__all__ = ["multi_cell_step"]

MOST_PATIENCE = 4  # steps after a march that did not get far are confined, 1, 2, 4 ... 2^this in a row
FEW = 4  # triangles of the first march after a stride, and of all of a granule whose path is drawn
MOST_DOUBLINGS = 4  # of the triangles of a march from one refused stride to the next
FAR = 2  # triangles: a march that left more behind was worth it


@inlined
def multi_cell_step(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
    """A stride or a march over several triangles where that is worth it. Returns the steps taken, 0 for none.

    Not in contact, nor with forces made of the air's gradients (they jump at faces) or of the past. After a stride that
    was refused 4, 8 ... 64 triangles are marched, after a march that was cut short the next 1, 2, 4 ... steps are
    confined.
    """
    if rules.march == 0 or hold[at.KIND] != at.FREE or grain[at.STOKES] == 0.0:
        return 0
    if grain[at.EXTRA] != 0.0 or grain[at.FORGET] != 0.0:
        return 0
    if ints[at.PATIENCE] > 0:
        ints[at.PATIENCE] -= 1
        return 0
    cell, _ = way_out(air.geometry, ints[at.TRI], state[at.X], state[at.Y], state[at.VX], state[at.VY], 0.0, 0.0, 0.0)
    if not drawn and stride(path, cell, state, ints, affine, air, grain, table, walls, rules):
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = ints[at.MARCHES_CUT] = ints[at.STRIDES_REFUSED] = 0
        ints[at.STEPS] += 1
        return 1
    if air.swing[at.SWING_OMEGA] != 0.0:  # faces that move: confined steps
        return 0
    most = FEW if drawn else FEW * 2 ** ints[at.STRIDES_REFUSED]  # triangles till the next stride is tried
    ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, MOST_DOUBLINGS)
    left = march(state, ints, affine, air, grain, table, walls, rules, most)
    if left > FAR:
        ints[at.MARCHES_CUT] = 0
    else:
        ints[at.PATIENCE] = 2 ** ints[at.MARCHES_CUT]
        ints[at.MARCHES_CUT] = min(ints[at.MARCHES_CUT] + 1, MOST_PATIENCE)
    if left > 0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = 0
        ints[at.STEPS] += left
    return left
