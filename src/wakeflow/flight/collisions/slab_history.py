"""The history force on a granule of the slab: the memories of the tracker (``kernel.history``), a step at a time.

Over a piece h of the path the memories follow the slip s of its middle, as if that would last. The mean force per mass
over the piece is then

    sum of w_i phi_1(-h / tau_i) (s - l_i) = R s - L

whose first part acts as drag does, so that a step may be longer than the time of a memory. Second order, as the step.
The memories stay where the piece begins, beside the slip that they are to follow, until the next one begins: a meeting
may cut the piece anywhere.
"""

from __future__ import annotations

import math

from ..kernel import layout as at
from ..kernel.history import CHATTERS, RATES
from ..kernel.jit import called, compiled
from . import slab_layout as of


@compiled
def _advance(state, ints, own, grain, ux, uy, sx, sy):
    """Bring the memories to the granule's time, which the slip of the piece before has lasted until.

    At first all memories know the slip that it came with; one that has struck more than CHATTERS times has no past.
    """
    chatters = ints[at.IMPACTS] > CHATTERS
    if chatters or ints[at.STEPS] == 1:
        lag_x, lag_y = (sx, sy) if chatters else (ux - state[at.LAG], uy - state[at.LAG + 1])
        for i in range(at.MEMORIES):
            state[at.LAG + 2 * i], state[at.LAG + 2 * i + 1] = lag_x, lag_y
            own[of.LAG_Z + i] = -own[of.VZ]
        return
    lasted = max(0.0, state[at.T] - own[of.SINCE])
    for i in range(at.MEMORIES):
        follows = -math.expm1(-RATES[i] * grain[at.FORGET] * lasted)
        state[at.LAG + 2 * i] += follows * (own[of.SLIP_X] - state[at.LAG + 2 * i])
        state[at.LAG + 2 * i + 1] += follows * (own[of.SLIP_Y] - state[at.LAG + 2 * i + 1])
        own[of.LAG_Z + i] += follows * (own[of.SLIP_Z] - own[of.LAG_Z + i])


@called
def recalled(state, ints, own, grain, ux, uy, sx, sy, h):
    """R (1/s) and the three components of L (m/s2) over a piece h that begins with the slip (sx, sy) in air (ux, uy);
    none in contact with a wall, where no theory holds.
    """
    _advance(state, ints, own, grain, ux, uy, sx, sy)
    rate = lx = ly = lz = 0.0
    if ints[at.CONTACT] != at.FREE:
        return rate, lx, ly, lz
    for i in range(at.MEMORIES):
        z = -RATES[i] * grain[at.FORGET] * h
        weight = grain[at.RECALL_0 + i] * math.expm1(z) / z
        rate += weight
        lx += weight * state[at.LAG + 2 * i]
        ly += weight * state[at.LAG + 2 * i + 1]
        lz += weight * own[of.LAG_Z + i]
    return rate, lx, ly, lz


@called
def remember(state, own, sx, sy, sz):
    """Note the slip that lasts from now on."""
    own[of.SINCE], own[of.SLIP_X], own[of.SLIP_Y], own[of.SLIP_Z] = state[at.T], sx, sy, sz
