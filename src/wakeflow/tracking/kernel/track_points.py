"""The points of a granule's track that are kept."""

from __future__ import annotations

from . import layout as at
from .jit import compiled

__all__ = ["store_point"]


@compiled
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
    record[i, at.REC_T] = state[at.T]
    record[i, at.REC_X], record[i, at.REC_Y], record[i, at.REC_VX], record[i, at.REC_VY] = (
        state[at.X],
        state[at.Y],
        state[at.VX],
        state[at.VY],
    )
    record[i, at.REC_GAIN_X], record[i, at.REC_GAIN_Y] = state[at.GAIN_X], state[at.GAIN_Y]
    ints[at.KEPT] = i + 1
    ints[at.OFFERED] += 1
