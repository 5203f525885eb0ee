"""The history force of a step: memories of the slip, each of which follows it in a time of its own.

With lags l_i, l_i' = (s - l_i) / tau_i, the force per mass is the sum of w_i (s - l_i); ``laws.forces`` says what of.
Within a step the slip is the parabola s0 + s1 t + s2 t^2 through the stages, for which all is exact, so that a step may
be cut anywhere:

    s - l_i = e^z (s0 - l_i(0)) + t phi1 s1 + 2 t^2 phi2 s2,    z = -t / tau_i
    impulse of the force = sum of w_i tau_i (l_i(t) - l_i(0))

The path of the step takes the force for a parabola too, which it is not after a jump of the slip or of its rate; what
its impulse differs by from the true one is made good at the end of the step. A slip that jumps, at a wall or where an
eddy begins, is new to all memories at once. A sphere that touches a wall has no theory: there the force does not act,
while the memories go on.
"""

from __future__ import annotations

import math

from ...laws.forces.history_force import MEMORIES
from . import layout as at
from .dense_output import parabola, phis, sampled
from .jit import called, compiled

RATES = 1.0 / MEMORIES
CHATTERS = 32  # impacts after which a granule remembers nothing: what it remembers would keep it bouncing for good


@compiled
def faded(path, grain, s):
    """Where in the path is how far the memories have faded at time s of the step: of each e^z, t phi1 and 2 t^2 phi2.
    Stages come back to the same times, so the last few are kept.
    """
    for k in range(at.FADED_TIMES):
        if path[at.FADED + at.PER_FADED * k] == s:
            return at.FADED + at.PER_FADED * k + 1
    oldest = int(path[at.FADED_NEXT])
    path[at.FADED_NEXT] = (oldest + 1) % at.FADED_TIMES
    kept = at.FADED + at.PER_FADED * oldest + 1
    path[kept - 1] = s
    for i in range(at.MEMORIES):
        e, p1, p2, _, _ = phis(-RATES[i] * grain[at.FORGET] * s)
        path[kept + 3 * i], path[kept + 3 * i + 1], path[kept + 3 * i + 2] = e, s * p1, 2.0 * s * s * p2
    return kept


@called
def begin_memory(path, state, ints, grain, hold, ux, uy, sx, sy):
    """Note the slip (sx, sy) at the step's start, for the moment as if it would last; returns the force per mass there.

    A granule that has struck more than CHATTERS times flies on without a past. Before its first step the first lag
    holds the velocity with which it came: all memories know the slip that
    it had then.
    """
    chatters = ints[at.IMPACTS] > CHATTERS
    if ints[at.STEPS] == 0 or chatters:
        lag_x, lag_y = (sx, sy) if chatters else (ux - state[at.LAG], uy - state[at.LAG + 1])
        for i in range(at.MEMORIES):
            state[at.LAG + 2 * i], state[at.LAG + 2 * i + 1] = lag_x, lag_y
    for slot in range(at.SLIP, at.FADED_NEXT + 1):
        path[slot] = 0.0
    for k in range(at.FADED_TIMES):
        path[at.FADED + at.PER_FADED * k] = -1.0
    path[at.SLIP], path[at.SLIP + 1] = sx, sy
    if hold[at.KIND] == at.FREE:
        for i in range(at.MEMORIES):
            path[at.PAST] += grain[at.RECALL_0 + i] * (sx - state[at.LAG + 2 * i])
            path[at.PAST + 1] += grain[at.RECALL_0 + i] * (sy - state[at.LAG + 2 * i + 1])
    return path[at.PAST], path[at.PAST + 1]


@called
def recall(path, state, grain, hold, s):
    """The history force per mass at time s of the step, and by how much (1/s) it grows with the slip there; none in
    contact.
    """
    fx = fy = grows = 0.0
    if hold[at.KIND] != at.FREE:
        return fx, fy, grows
    first = faded(path, grain, s)
    for i in range(at.MEMORIES):
        e, a, b = path[first + 3 * i], path[first + 3 * i + 1], path[first + 3 * i + 2]
        weight = grain[at.RECALL_0 + i]
        x, y = path[at.SLIP] - state[at.LAG + 2 * i], path[at.SLIP + 1] - state[at.LAG + 2 * i + 1]
        fx += weight * (e * x + a * path[at.SLIP + 2] + b * path[at.SLIP + 4])
        fy += weight * (e * y + a * path[at.SLIP + 3] + b * path[at.SLIP + 5])
        grows += weight * a
    return fx, fy, grows / s


@compiled
def recall_line(path, state, grain, hold, s, sx, sy):
    """The force with a slip that goes straight to (sx, sy) there."""
    path[at.SLIP + 2], path[at.SLIP + 3] = (sx - path[at.SLIP]) / s, (sy - path[at.SLIP + 1]) / s
    path[at.SLIP + 4] = path[at.SLIP + 5] = 0.0
    fx, fy, _ = recall(path, state, grain, hold, s)
    return fx, fy


@compiled
def past_defect(path, state, grain, hold, s, sx, sy):
    """What the history force differs by at time s of the step, where the slip is s, from its own parabola; what the
    slip's own parabola leaves out there does to it; and that parabola's force.
    """
    fx, fy, grows = recall(path, state, grain, hold, s)
    px, py = sampled(path, at.PAST, s)
    qx, qy = sampled(path, at.SLIP, s)
    bent = grows * math.sqrt((sx - qx) ** 2 + (sy - qy) ** 2)
    return math.sqrt((fx - px) ** 2 + (fy - py) ** 2), bent, px, py


@called
def bend_memory(path, h, state, grain, hold, mx, my, ex, ey):
    """The force in the middle of a step h, where the slip is (mx, my), and at its end, where it is (ex, ey)."""
    parabola(path, at.SLIP, h, mx, my, ex, ey)
    mx, my, _ = recall(path, state, grain, hold, 0.5 * h)
    ex, ey, _ = recall(path, state, grain, hold, h)
    parabola(path, at.PAST, h, mx, my, ex, ey)
    return mx, my, ex, ey


@called
def remember(path, state, grain, hold, s):
    """Bring the memories to time s of the step; returns what velocity the path lacks there.

    Drag takes part of what it lacked early in the step: at most all that it lacks over 1 + B s.
    """
    sx, sy = sampled(path, at.SLIP, s)
    wx, wy = sampled(path, at.SLIP, 0.0)
    kick_x = kick_y = 0.0
    first = faded(path, grain, s)
    for i in range(at.MEMORIES):
        rate, x, y = RATES[i] * grain[at.FORGET], at.LAG + 2 * i, at.LAG + 2 * i + 1
        e, a, b = path[first + 3 * i], path[first + 3 * i + 1], path[first + 3 * i + 2]
        lag_x = sx - (e * (wx - state[x]) + a * path[at.SLIP + 2] + b * path[at.SLIP + 4])
        lag_y = sy - (e * (wy - state[y]) + a * path[at.SLIP + 3] + b * path[at.SLIP + 5])
        kick_x += grain[at.RECALL_0 + i] / rate * (lag_x - state[x])
        kick_y += grain[at.RECALL_0 + i] / rate * (lag_y - state[y])
        state[x], state[y] = lag_x, lag_y
    if hold[at.KIND] != at.FREE:
        return 0.0, 0.0
    kick_x -= s * (path[at.PAST] + s * (0.5 * path[at.PAST + 2] + s / 3.0 * path[at.PAST + 4]))
    kick_y -= s * (path[at.PAST + 1] + s * (0.5 * path[at.PAST + 3] + s / 3.0 * path[at.PAST + 5]))
    kept = 1.0 / (1.0 + path[at.RATE] * s)
    return kept * kick_x, kept * kick_y
