"""Events on the dense output: where a function of position or velocity first falls below zero within a step.

An event function is one of three kinds about an origin (ox, oy), in the frame of a body that may move (body -1: lab):
PLANE  q0 + q1 (x - ox) + q2 (y - oy), ROUND  distance - q0, SPEED  q1 vx + q2 vy, SPIN  q0 times the angular speed.
"""

from __future__ import annotations

import math

import numpy as np

from . import layout as at
from .dense_output import along
from .jit import compiled

PLANE, ROUND, SPEED, SPIN = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
NOTHING, EXIT, WALL, CROSSED, SLID_OFF, HALTED, LIFTED, SLIPS, GRIPS = range(9)  # what ends a step
SOON = 1e-3  # of a step: then a function that stands still at its beginning shows where it goes
SAME = 1e-9  # of a period: times nearer to a crest or sample are on it
CLOSE = 1e-3  # of the skin: so near to zero a value is a root; chosen: its place then errs by far less than the skin
SINKS = 0.1  # of a root's nearness: what stood still goes down if it falls by more; chosen: less than a root may be off
TURNED = 1e-4  # of the smaller rate at the ends: so slow it turns; chosen: the value errs by the square of that, 1e-8
# Parts of a bracket between which the next look for a turning point is taken; chosen: no look leaves more than 95 %
NEAREST, FARTHEST = 0.05, 0.95
LAST_BIT = 4e-16  # of a time: a bracket as short as this is a root; about two spacings of doubles near it
MAX_ROOT_LOOKS, MAX_TURN_LOOKS = 100, 40  # looks in one search; chosen: guards against loops without end


@compiled
def harmonic(ax, ay, omega, phase, t):
    """Displacement, velocity and acceleration of amplitude (ax, ay) sin(omega t + phase)."""
    angle = omega * t + phase
    s, c = math.sin(angle), omega * math.cos(angle)
    w = -omega * omega * s
    return ax * s, ay * s, ax * c, ay * c, ax * w, ay * w


@compiled
def cubic(ax, ay, x, v, a, jerk, s):
    """The same of (ax, ay) times what began at x, v, a a time s ago, its acceleration linear in time."""
    d = x + s * (v + s * (0.5 * a + s * jerk / 6.0))
    c = v + s * (a + 0.5 * s * jerk)
    w = a + s * jerk
    return ax * d, ay * d, ax * c, ay * c, ax * w, ay * w


@compiled
def interval(bodies, body, t):
    """Column of the sample at or before time t of a body's record, and the time since."""
    period, count = bodies[body, at.SAMPLE_PERIOD], int(bodies[body, at.SAMPLE_COUNT])
    since = t + bodies[body, at.PHASE]
    since -= math.floor(since / period) * period
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if bodies[body, at.SAMPLES + at.PER_SAMPLE * middle] <= since:
            low = middle
        else:
            high = middle
    column = at.SAMPLES + at.PER_SAMPLE * low
    return column, since - bodies[body, column]


@compiled
def wall_displacement(bodies, body, t):
    """Displacement, velocity and acceleration of a body at time t: a harmonic, or a record of samples."""
    ax, ay, omega = bodies[body, at.REACH_X], bodies[body, at.REACH_Y], bodies[body, at.OMEGA]
    if omega == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if bodies[body, at.SAMPLE_COUNT] == 0.0:
        return harmonic(ax, ay, omega, bodies[body, at.PHASE], t)
    k, s = interval(bodies, body, t)
    return cubic(
        ax,
        ay,
        bodies[body, k + at.SAMPLE_OUT],
        bodies[body, k + at.SAMPLE_SPEED],
        bodies[body, k + at.SAMPLE_PULL],
        bodies[body, k + at.SAMPLE_JERK],
        s,
    )


@compiled
def next_turn(bodies, body, t):
    """Time from t to where the body's acceleration may turn: the next crest of a harmonic, the next sample."""
    omega = bodies[body, at.OMEGA]
    if bodies[body, at.SAMPLE_COUNT] == 0.0:
        turns = (omega * t + bodies[body, at.PHASE]) / math.pi - 0.5
        return (math.floor(turns + SAME) + 1.0 - turns) * math.pi / omega
    ahead = SAME * bodies[body, at.SAMPLE_PERIOD]
    k, s = interval(bodies, body, t + ahead)
    return bodies[body, k + at.PER_SAMPLE] - bodies[body, k] - s + ahead


@compiled
def level(path, s, t0, bodies, body, kind, ox, oy, q0, q1, q2):
    """Value and rate of an event function at time s of the step (no rate for speeds: 0)."""
    x, y, vx, vy = along(path, s)
    if body >= 0 and bodies[body, at.OMEGA] != 0.0:
        dx, dy, wx, wy, _, _ = wall_displacement(bodies, body, t0 + s)
        x, y, vx, vy = x - dx, y - dy, vx - wx, vy - wy
    x, y = x - ox, y - oy
    if kind == PLANE:
        return q0 + q1 * x + q2 * y, q1 * vx + q2 * vy
    if kind == ROUND:
        d = math.sqrt(x * x + y * y)
        return d - q0, (x * vx + y * vy) / d if d > 0.0 else 0.0
    if kind == SPEED:
        return q1 * vx + q2 * vy, 0.0
    return q0 * (x * vy - y * vx), 0.0


@compiled
def _root(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, low, f_low, high, f_high, close):
    """Where the function passes from above zero at ``low`` to below at ``high``: Newton kept in the bracket."""
    s = low + (high - low) * f_low / (f_low - f_high)
    for _ in range(MAX_ROOT_LOOKS):
        f, rate = level(path, s, t0, bodies, body, kind, ox, oy, q0, q1, q2)
        if abs(f) <= close:
            return s
        if f > 0.0:
            low = s
        else:
            high = s
        if high - low <= LAST_BIT * high:
            return high
        s = s - f / rate if rate != 0.0 else low
        if not (low < s < high):
            s = 0.5 * (low + high)
    return s


@compiled
def _turn(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, low, r_low, high, r_high):
    """The time between ``low`` and ``high`` where the rate changes sign, and the value there (regula falsi, damped)."""
    scale = TURNED * min(abs(r_low), abs(r_high))
    s, f = low, 0.0
    for _ in range(MAX_TURN_LOOKS):
        s = low + (high - low) * min(FARTHEST, max(NEAREST, r_low / (r_low - r_high)))
        f, rate = level(path, s, t0, bodies, body, kind, ox, oy, q0, q1, q2)
        if abs(rate) <= scale:
            break
        if (rate > 0.0) == (r_high > 0.0):
            high, r_high = s, rate
        else:
            low, r_low = s, rate
    return s, f


@compiled
def first_below(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, a, fa, ra, b, fb, rb, skin):
    """First time in [a, b] at which the function falls below zero; -1.0 if it does not. (f, r): values and rates at
    both ends.

    At most one turning point inside is looked for, so steps must be short enough to be nearly straight. Within ``skin``
    of zero at ``a`` it falls at once when it goes down or is about to, and may rise and fall again when it goes up.
    """
    close = CLOSE * skin
    if fa > skin:
        if fb < 0.0:
            return _root(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, a, fa, b, fb, close)
        if ra < 0.0 and rb > 0.0:
            m, fm = _turn(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, a, ra, b, rb)
            if fm < 0.0:
                return _root(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, a, fa, m, fm, close)
        return -1.0
    if ra < 0.0:
        return a
    sunk, soon = fa - SINKS * close, a + SOON * (b - a)
    if ra == 0.0 and level(path, soon, t0, bodies, body, kind, ox, oy, q0, q1, q2)[0] < sunk:
        return a
    if fb < 0.0 and fb < fa:
        if rb >= 0.0:
            return b
        m, fm = _turn(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, a, ra, b, rb)
        if fm > skin:
            return _root(path, t0, bodies, body, kind, ox, oy, q0, q1, q2, m, fm, b, fb, close)
        return min(b, 2.0 * m - a)
    return -1.0
