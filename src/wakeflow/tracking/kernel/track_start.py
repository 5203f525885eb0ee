"""The start of a track: the state of a new granule, and where it may begin."""

from __future__ import annotations

import math

from . import layout as at
from .edge_crossing import relocate
from .events import wall_displacement
from .jit import compiled, inlined
from .walls import grasp, inside, overlap

__all__ = ["begin_track"]


@inlined
def _born_inside(state, walls):
    """Whether the granule's centre lies in a body."""
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = wall_displacement(walls.bodies, body, state[at.T])
        within, _ = inside(walls, body, state[at.X] - dx, state[at.Y] - dy)
        if within:
            return True
    return False


@inlined
def _pushed_out(state, hold, grain, walls):
    """Put a granule that reaches into a body onto its surface; whether it did."""
    moved = False
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = wall_displacement(walls.bodies, body, state[at.T])
        depth, kind, which = overlap(walls, body, state[at.X] - dx, state[at.Y] - dy, grain[at.RADIUS])
        if depth > 0.0:
            _, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
            state[at.X] -= off * hold[at.NX]
            state[at.Y] -= off * hold[at.NY]
            hold[at.KIND] = at.FREE
            moved = True
    return moved


@compiled
def _begin(state, ints, hold, air, grain, walls):
    """The start of a track: inside a body it stops, reaching into one it is pushed out, outside the mesh it ends."""
    if _born_inside(state, walls):
        ints[at.FATE] = at.STOPPED
        return
    moved = _pushed_out(state, hold, grain, walls)
    if air.corners.shape[0] == 0:
        return
    if ints[at.TRI] < 0 and ints[at.GAP] < 0:
        ints[at.FATE] = at.ESCAPED
    elif moved and ints[at.TRI] >= 0:
        relocate(state, ints, air)


@inlined
def begin_track(state, ints, affine, hold, air, grain, walls, timed):
    """Scratch and state of a new granule."""
    affine[:] = 0.0
    hold[:] = 0.0
    ints[at.KEEP_EVERY] = 1
    state[at.T_END] = -math.inf if timed else math.inf
    state[at.H_ERROR] = math.inf
    state[at.T_NOISE] = -math.inf if grain[at.NOISE] != 0.0 else math.inf
    if air.corners.shape[0] == 0:
        affine[at.AX0], affine[at.AY0] = grain[at.GX], grain[at.GY]
        ints[at.FRESH] = 1
    _begin(state, ints, hold, air, grain, walls)
