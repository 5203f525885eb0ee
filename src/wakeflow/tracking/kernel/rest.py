"""A granule at rest on a wall that friction holds, or wedged between two walls: what holds it, and when it lets go.

Wedged: two walls that move together touch it at once, with normals n1 and n2. In their frame the free acceleration g is
-(a n1 + b n2); with a and b positive both press, and it can go nowhere, whatever the friction (a ball's two contacts
need none). Once one of them is negative that wall is left, and the granule goes on in contact with the other one alone,
held or sliding. Friction at both walls, which could hold it where a or b is negative, needs a preload that rigid bodies
do not have: where the other wall's friction alone holds it, it stays all the same.
"""

from __future__ import annotations

from .events import displacement, next_turn
from .jit import compiled
from .layout import (
    BODY,
    CONTACT,
    FATE,
    FEATURE,
    FREE,
    HELD,
    MOBILITY,
    MU,
    N2X,
    N2Y,
    NOISE,
    NX,
    NY,
    PAIR,
    PAIRED,
    RADIUS,
    RESTING,
    SAMPLED,
    SIGN,
    SLOW,
    T_END,
    T_NOISE,
    TURN,
    VX,
    VY,
    WW,
    T,
    X,
    Y,
)
from .step import free_force
from .walls import STILL, carry, constrain, facing, grasp, ride

__all__ = ["STATIC", "caught", "held", "hold_still", "tangent", "unwedge", "wedge"]

STATIC = 1e-12  # round-off of a friction coefficient: what is exactly balanced is held
STEEP = 0.05  # the same, of two walls along one of which a granule is put onto the other
FOR_EVER = 40  # strikes in no time; an elastic granule leaves a corner of 4.5 degrees within as many
PARALLEL = 1e-6  # sine of the angle between two walls that make no wedge


@compiled
def held(hold, grain, press, free):
    """Whether friction holds a granule at rest against the free tangential acceleration; what can roll, does."""
    friction = 0.0 if grain[MOBILITY] > 0.0 else hold[MU]
    return press > 0.0 and abs(free) <= (friction + STATIC) * press


@compiled
def _presses(hold, fx, fy, t):
    """How hard the two walls of a wedge press, the free acceleration f being shared out between their normals."""
    _, _, _, _, px, py = carry(hold, t)
    gx, gy = fx - px, fy - py
    turn = hold[NX] * hold[N2Y] - hold[NY] * hold[N2X]
    return (gy * hold[N2X] - gx * hold[N2Y]) / turn, (hold[NY] * gx - hold[NX] * gy) / turn


@compiled
def _together(bodies, one, other):
    """Whether two bodies move as one."""
    if one == other:
        return True
    same = bodies[one, 6] == bodies[other, 6]
    return same and (bodies[one, 6] == 0.0 or (
        bodies[one, 4] == bodies[other, 4] and bodies[one, 5] == bodies[other, 5] and bodies[one, 7] == bodies[other, 7]
        and bodies[one, 10] == bodies[other, 10] and bodies[one, 11] == bodies[other, 11]
    ))  # fmt: skip


@compiled
def tangent(walls, kind, which, nx, ny, state):
    """The way along a wall that leads a unit distance off another one of normal n; n itself where they are too nearly
    parallel.
    """
    _, mx, my, _ = facing(walls, kind, which, state[X], state[Y], state[T])
    rise = ny * mx - nx * my
    return (nx, ny) if abs(rise) < STEEP else (-my / rise, mx / rise)


@compiled
def caught(state, hold, walls, kind, which, body, rx, ry, e, stuck):
    """Whether a granule that leaves the wall in ``hold``, of ``body``, with the relative velocity (rx, ry) runs into
    the one it lay on or struck just now, and so for ever: it stops. Each wall takes part of the speed along its normal,
    in turn, without end and in no time.

    For ever, if both rebounds (restitution ``e``) are too slow to follow, or after so many strikes in no time.
    """
    other, mx, my, _ = facing(walls, kind, which, state[X], state[Y], state[T])
    into = rx * mx + ry * my
    if into >= -STILL or not _together(walls.bodies, body, other):
        return False
    if abs(hold[NX] * my - hold[NY] * mx) < PARALLEL:
        return False
    slow = rx * hold[NX] + ry * hold[NY] <= SLOW and -e * into <= SLOW
    return slow or (stuck >= FOR_EVER and e < 1.0)


@compiled
def wedge(state, ints, hold, walls, rules, fx, fy, kind, which, e):
    """For a granule that has just come to slide on the wall in ``hold`` while it lay on another one: wedged between
    them, at rest, if both press and no bounce between them is worth following. Returns whether it is."""
    body, mx, my, _ = facing(walls, kind, which, state[X], state[Y], state[T])
    turn = abs(hold[NX] * my - hold[NY] * mx)
    if turn < PARALLEL or not _together(walls.bodies, body, ints[BODY]):
        return False
    hold[N2X], hold[N2Y] = mx, my
    first, second = _presses(hold, fx, fy, state[T])
    if not (first > 0.0 and second > 0.0):
        return False
    _, _, wx, wy, _, _ = displacement(walls.bodies, body, state[T])
    rx, ry = state[VX] - wx, state[VY] - wy
    into = rx * mx + ry * my
    speed2 = rx * rx + ry * ry if into >= 0.0 else e * e * into * into
    if speed2 > max(SLOW * SLOW, 2.0 * min(first, second) * turn * rules.tiny):
        return False
    ints[PAIR], ints[PAIRED] = kind, which
    state[VX], state[VY], state[HELD] = wx, wy, 0.0
    state[TURN] = 0.0 if hold[MU] > 0.0 else state[TURN]
    return True


@compiled
def unwedge(state, ints, hold, grain, walls, fx, fy):
    """Whether a wedged granule stays; else it is left with the wall that presses."""
    first, second = _presses(hold, fx, fy, state[T])
    if first >= 0.0 and second >= 0.0:
        return True
    if first < 0.0 and second > 0.0:
        ints[CONTACT], ints[FEATURE] = ints[PAIR], ints[PAIRED]
        ints[BODY], _ = grasp(hold, walls, ints[PAIR], ints[PAIRED], grain[RADIUS], state[X], state[Y], state[T])
        hold[SIGN] = 0.0
    ints[PAIR] = FREE
    return False


@compiled
def _carried(state, ints, hold, affine, grain, table, walls, dt):
    """Whether it is still held after riding with the wall for dt, and where and how fast it is then."""
    t = state[T]
    x0, y0, _, _, _, _ = displacement(walls.bodies, ints[BODY], t)
    x1, y1, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], t + dt)
    x, y = state[X] + x1 - x0, state[Y] + y1 - y0
    fx, fy, _, _, _ = free_force(affine, grain, table, x, y, wx, wy, t + dt, 0.0)
    if ints[PAIR] != FREE:
        first, second = _presses(hold, fx, fy, t + dt)
        return first >= 0.0 and second >= 0.0, x, y, wx, wy
    _, _, press, free, _ = constrain(hold, fx, fy, x, y, wx, wy, t + dt)
    return held(hold, grain, press, free), x, y, wx, wy


@compiled
def hold_still(state, ints, hold, affine, grain, table, walls, rules, timed):
    """A granule at rest that is held: it rests for good, or rides on with the wall while it is."""
    moving = hold[WW] != 0.0
    if not moving and not timed and grain[NOISE] == 0.0:
        ints[FATE] = RESTING
        return
    dt = min(rules.until - state[T], 0.1 * rules.coarse)
    if moving:  # what presses is largest and least where the wall's acceleration turns
        dt = min(dt, (0.05 if hold[SAMPLED] == 0.0 else 0.4) / hold[WW])
        dt = min(dt, next_turn(walls.bodies, ints[BODY], state[T]))
    if timed:
        dt = min(dt, 0.25 / affine[15] if affine[15] != 0.0 else dt, state[T_END] - state[T])
    if grain[NOISE] != 0.0:
        dt = min(dt, state[T_NOISE] - state[T])
    end = state[T] + dt
    stays, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, dt)
    if not stays:  # let go within: find out when
        low, high = 0.0, dt
        for _ in range(60):
            middle = 0.5 * (low + high)
            stays, _, _, _, _ = _carried(state, ints, hold, affine, grain, table, walls, middle)
            if stays:
                low = middle
            else:
                high = middle
        high = max(high, STATIC * (abs(state[T]) + 1.0))  # the clock has to move, or it is held again
        _, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, high)
        dt, end = high, state[T] + high
    state[HELD] += dt
    if state[HELD] > rules.rest:
        ints[FATE] = RESTING
        return
    state[X], state[Y], state[VX], state[VY], state[T] = x, y, vx, vy, end
    ride(hold, walls, ints[BODY], end)
