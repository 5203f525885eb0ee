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
PERIOD_ROUNDING = 1e-9  # of a period: times nearer to a crest or sample are on it
CLOSE = 1e-3  # of the skin: so near to zero a value is a root; chosen: its place then errs by far less than the skin
SINKS = 0.1  # of a root's nearness: what stood still goes down if it falls by more; chosen: less than a root may be off
TURNED = 1e-4  # of the smaller rate at the ends: so slow it turns; chosen: the value errs by the square of that, 1e-8
# Parts of a bracket between which the next look for a turning point is taken; chosen: no look leaves more than 95 %
NEAREST, FARTHEST = 0.05, 0.95
LAST_BIT = 4e-16  # of a time: a bracket as short as this is a root; about two spacings of doubles near it
MAX_ROOT_LOOKS, MAX_TURN_LOOKS = 100, 40  # looks in one search; chosen: guards against loops without end


@compiled
def harmonic(omega, phase, t):
    """sin(omega t + phase) and its first two derivatives."""
    angle = omega * t + phase
    s = math.sin(angle)
    return s, omega * math.cos(angle), -omega * omega * s


@compiled
def cubic(x, v, a, jerk, s):
    """Place, velocity and acceleration of what began at x, v, a a time s ago, its acceleration linear in time."""
    return x + s * (v + s * (0.5 * a + s * jerk / 6.0)), v + s * (a + 0.5 * s * jerk), a + s * jerk


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
def _swing(bodies, body, t):
    """How far out a body is at time t, over its amplitude, and the first two derivatives: a harmonic, or samples."""
    omega = bodies[body, at.OMEGA]
    if omega == 0.0:
        return 0.0, 0.0, 0.0
    if bodies[body, at.SAMPLE_COUNT] == 0.0:
        return harmonic(omega, bodies[body, at.PHASE], t)
    k, s = interval(bodies, body, t)
    out, speed = bodies[body, k + at.SAMPLE_OUT], bodies[body, k + at.SAMPLE_SPEED]
    return cubic(out, speed, bodies[body, k + at.SAMPLE_PULL], bodies[body, k + at.SAMPLE_JERK], s)


@compiled
def turning(angle, x, y):
    """What a turn by an angle adds to a vector: to full precision also for a far pivot and a small angle."""
    half, s = math.sin(0.5 * angle), math.sin(angle)
    h = 2.0 * half * half
    return -h * x - s * y, s * x - h * y


@compiled
def turned_by(angle, x, y):
    """A vector turned by an angle."""
    if angle == 0.0:
        return x, y
    dx, dy = turning(angle, x, y)
    return x + dx, y + dy


@compiled
def rocking(turn, growth, x, y, vx, vy):
    """Velocity of a body that turns about a pivot at the rate ``turn``, which grows by ``growth``, at (x, y) from it;
    and the acceleration in the lab of what moves there with the velocity v and is at rest or goes straight on as seen
    from the body: that of the place and Coriolis'.
    """
    wx, wy = -turn * y, turn * x
    rx, ry = vx - wx, vy - wy
    return wx, wy, -growth * y - turn * (turn * x + 2.0 * ry), growth * x - turn * (turn * y - 2.0 * rx)


@compiled
def angle_of(bodies, body, t):
    """The angle (rad) by which a body has turned at time t; 0 for one that is displaced."""
    rock = bodies[body, at.ROCK]
    return rock * _swing(bodies, body, t)[0] if rock != 0.0 else 0.0


@compiled
def wall_motion(bodies, body, t, x, y, vx, vy):
    """Velocity of a body at the place (x, y), the acceleration of what is there with velocity v and moves uniformly as
    seen from the body, and the rate (rad/s) at which the body turns.
    """
    _, rate, pull = _swing(bodies, body, t)
    rock = bodies[body, at.ROCK]
    if rock == 0.0:
        ax, ay = bodies[body, at.REACH_X], bodies[body, at.REACH_Y]
        return ax * rate, ay * rate, ax * pull, ay * pull, 0.0
    x, y = x - bodies[body, at.PIVOT_X], y - bodies[body, at.PIVOT_Y]
    wx, wy, px, py = rocking(rock * rate, rock * pull, x, y, vx, vy)
    return wx, wy, px, py, rock * rate


@compiled
def seen_from(bodies, body, t, x, y, vx, vy):
    """Position and velocity in the frame of a body, in which its outline does not move."""
    if bodies[body, at.OMEGA] == 0.0:
        return x, y, vx, vy
    out, rate, _ = _swing(bodies, body, t)
    rock = bodies[body, at.ROCK]
    if rock == 0.0:
        ax, ay = bodies[body, at.REACH_X], bodies[body, at.REACH_Y]
        return x - ax * out, y - ay * out, vx - ax * rate, vy - ay * rate
    qx, qy = x - bodies[body, at.PIVOT_X], y - bodies[body, at.PIVOT_Y]
    dx, dy = turning(-rock * out, qx, qy)
    vx, vy = turned_by(-rock * out, vx + rock * rate * qy, vy - rock * rate * qx)
    return x + dx, y + dy, vx, vy


@compiled
def carried_along(bodies, body, x, y, t0, t1):
    """Where a body takes a place on it from time t0 to t1, and the velocity there then."""
    rock = bodies[body, at.ROCK]
    before, after = _swing(bodies, body, t0)[0], _swing(bodies, body, t1)[0]
    if rock == 0.0:
        ax, ay = bodies[body, at.REACH_X], bodies[body, at.REACH_Y]
        x, y = x + ax * after - ax * before, y + ay * after - ay * before
    else:
        px, py = bodies[body, at.PIVOT_X], bodies[body, at.PIVOT_Y]
        dx, dy = turning(rock * (after - before), x - px, y - py)
        x, y = x + dx, y + dy
    wx, wy, _, _, _ = wall_motion(bodies, body, t1, x, y, 0.0, 0.0)
    return x, y, wx, wy


@compiled
def next_turn(bodies, body, t):
    """Time from t to where the body's acceleration may turn: the next crest of a harmonic, the next sample."""
    omega = bodies[body, at.OMEGA]
    if bodies[body, at.SAMPLE_COUNT] == 0.0:
        turns = (omega * t + bodies[body, at.PHASE]) / math.pi - 0.5
        return (math.floor(turns + PERIOD_ROUNDING) + 1.0 - turns) * math.pi / omega
    ahead = PERIOD_ROUNDING * bodies[body, at.SAMPLE_PERIOD]
    k, s = interval(bodies, body, t + ahead)
    return bodies[body, k + at.PER_SAMPLE] - bodies[body, k] - s + ahead


@compiled
def level(path, s, t0, bodies, body, kind, ox, oy, q0, q1, q2):
    """Value and rate of an event function at time s of the step (no rate for speeds: 0)."""
    x, y, vx, vy = along(path, s)
    if body >= 0 and bodies[body, at.OMEGA] != 0.0:
        x, y, vx, vy = seen_from(bodies, body, t0 + s, x, y, vx, vy)
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
