"""The start of a track, and the points of it that are kept."""

from __future__ import annotations

import math

from . import layout as at
from .events import seen_from
from .jit import called, compiled
from .step import relocate
from .walls import grasp, inside, overlap


# -- The start of a track ----------------------------------------------------------------------------------------------
@compiled
def _born_inside(state, walls):
    """Whether the granule's centre lies in a body."""
    for body in range(walls.bodies.shape[0]):
        x, y, _, _ = seen_from(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
        within, _ = inside(walls, body, x, y)
        if within:
            return True
    return False


@compiled
def _pushed_out(state, hold, grain, walls):
    """Put a granule that reaches into a body onto its surface; whether it did."""
    moved = False
    for body in range(walls.bodies.shape[0]):
        x, y, _, _ = seen_from(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
        depth, kind, which = overlap(walls, body, x, y, grain[at.RADIUS])
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


@called
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


# -- The points of a granule's track that are kept ---------------------------------------------------------------------
@called
def store_point(state, ints, record, last):
    """Keep a point of the track; when the room is full every second one goes and the stride doubles."""
    room = record.shape[0]
    if room == 0:
        return
    if last == 0 and ints[at.OFFERED] % ints[at.KEEP_EVERY] != 0:
        ints[at.OFFERED] += 1
        return
    if ints[at.KEPT] == room - 1 and last == 0:
        half = (room - 1) // 2
        for i in range(half):
            for j in range(at.RECORD):
                record[i, j] = record[2 * i, j]
        ints[at.KEPT] = half
        ints[at.KEEP_EVERY] *= 2
    i = ints[at.KEPT]
    record[i, at.REC_T], record[i, at.REC_X], record[i, at.REC_Y] = state[at.T], state[at.X], state[at.Y]
    record[i, at.REC_VX], record[i, at.REC_VY] = state[at.VX], state[at.VY]
    record[i, at.REC_GAIN_X], record[i, at.REC_GAIN_Y] = state[at.GAIN_X], state[at.GAIN_Y]
    ints[at.KEPT] = i + 1
    ints[at.OFFERED] += 1
