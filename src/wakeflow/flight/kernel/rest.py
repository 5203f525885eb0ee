"""A granule at rest on a wall that friction holds, or wedged between two walls: what holds it, and when it lets go.

Wedged: two walls that move together touch it at once, with normals n1 and n2. In their frame the free acceleration g is
-(a n1 + b n2); with a and b positive both press, and it can go nowhere, whatever the friction (a ball's two contacts
need none). Once one of them is negative that wall is left, and the granule goes on in contact with the other one alone,
held or sliding. Friction at both walls, which could hold it where a or b is negative, needs a preload that rigid bodies
do not have: where the other wall's friction alone holds it, it stays all the same.
"""

from __future__ import annotations

from . import layout as at
from .air import free_force
from .events import carried_along, next_turn, turned_by, wall_motion
from .jit import compiled
from .walls import STILL, carry, constrain, facing, grasp, leans, ride

STATIC = 1e-12  # round-off of a friction coefficient: what is exactly balanced is held
STEEP = 0.05  # the same, of two walls along one of which a granule is put onto the other
FOR_EVER = 40  # strikes in no time; an elastic granule leaves a corner of 4.5 degrees within as many
LOOKS = 0.1  # of the time in which a field changes: between looks at a granule that friction holds
SWAY = 0.05  # rad of a vibration between looks at what it holds: its pull changes by 5 % at most
SAMPLED_SWAY = 0.4  # the same of samples, whose acceleration is linear between them and changes no faster than this
SHARE = 0.25  # of an interval between snapshots, between looks
PARALLEL = 1e-6  # sine of the angle between two walls that make no wedge


@compiled
def held(hold, grain, press, free):
    """Whether friction holds a granule at rest against the free tangential acceleration; what can roll, does."""
    friction = 0.0 if grain[at.MOBILITY] > 0.0 else hold[at.MU]
    return press > 0.0 and abs(free) <= (friction + STATIC) * press


@compiled
def _presses(hold, fx, fy, x, y, vx, vy, t):
    """How hard the two walls of a wedge at (x, y), which move with v, press, the free acceleration f being shared out
    between their normals.
    """
    _, _, _, _, px, py, _, _ = carry(hold, x, y, vx, vy, t)
    gx, gy = turned_by(-leans(hold, t), fx - px, fy - py)  # as the walls stood when the normals were taken
    turn = hold[at.NX] * hold[at.OTHER_NY] - hold[at.NY] * hold[at.OTHER_NX]
    return (gy * hold[at.OTHER_NX] - gx * hold[at.OTHER_NY]) / turn, (hold[at.NY] * gx - hold[at.NX] * gy) / turn


@compiled
def _together(bodies, body, other):
    """Whether two bodies move as one."""
    if body == other:
        return True
    if bodies[body, at.OMEGA] != bodies[other, at.OMEGA]:
        return False
    if bodies[body, at.OMEGA] == 0.0:
        return True
    for column in (at.PHASE, at.SAMPLE_COUNT, at.SAMPLE_PERIOD, at.ROCK, at.PIVOT_X, at.PIVOT_Y):
        if bodies[body, column] != bodies[other, column]:
            return False
    reach = (
        bodies[body, at.REACH_X] == bodies[other, at.REACH_X] and bodies[body, at.REACH_Y] == bodies[other, at.REACH_Y]
    )
    return reach or bodies[body, at.ROCK] != 0.0  # of bodies that rock the reach is that of their outlines


@compiled
def tangent(walls, kind, which, nx, ny, state):
    """The way along a wall that leads a unit distance off another one of normal n; n itself where they are too nearly
    parallel.
    """
    _, mx, my, _ = facing(walls, kind, which, state[at.X], state[at.Y], state[at.T])
    rise = ny * mx - nx * my
    return (nx, ny) if abs(rise) < STEEP else (-my / rise, mx / rise)


@compiled
def caught(state, hold, walls, kind, which, body, rx, ry, e, stuck):
    """Whether a granule that leaves the wall in ``hold``, of ``body``, with the relative velocity (rx, ry) runs into
    the one it lay on or struck just now, and so for ever: it stops. Each wall takes part of the speed along its normal,
    in turn, without end and in no time.

    For ever, if both rebounds (restitution ``e``) are too slow to follow, or after so many strikes in no time.
    """
    other, mx, my, _ = facing(walls, kind, which, state[at.X], state[at.Y], state[at.T])
    into = rx * mx + ry * my
    if into >= -STILL or not _together(walls.bodies, body, other):
        return False
    if abs(hold[at.NX] * my - hold[at.NY] * mx) < PARALLEL:
        return False
    slow = rx * hold[at.NX] + ry * hold[at.NY] <= at.SLOW and -e * into <= at.SLOW
    return slow or (stuck >= FOR_EVER and e < 1.0)


@compiled
def wedge(state, ints, hold, walls, rules, fx, fy, kind, which, e):
    """Wedge a granule that has just come to slide on the wall in ``hold`` while it lay on another one between both: at
    rest, if both press and no bounce between them is worth following. Returns whether it is."""
    body, mx, my, _ = facing(walls, kind, which, state[at.X], state[at.Y], state[at.T])
    turn = abs(hold[at.NX] * my - hold[at.NY] * mx)
    if turn < PARALLEL or not _together(walls.bodies, body, ints[at.BODY]):
        return False
    hold[at.OTHER_NX], hold[at.OTHER_NY] = mx, my
    x, y, t = state[at.X], state[at.Y], state[at.T]
    wx, wy, _, _, whirl = wall_motion(walls.bodies, body, t, x, y, 0.0, 0.0)
    first, second = _presses(hold, fx, fy, x, y, wx, wy, t)
    if not (first > 0.0 and second > 0.0):
        return False
    rx, ry = state[at.VX] - wx, state[at.VY] - wy
    into = rx * mx + ry * my
    speed2 = rx * rx + ry * ry if into >= 0.0 else e * e * into * into
    if speed2 > max(at.SLOW * at.SLOW, 2.0 * min(first, second) * turn * rules.tiny):
        return False
    ints[at.PAIR], ints[at.PAIRED] = kind, which
    state[at.VX], state[at.VY], state[at.HELD] = wx, wy, 0.0
    state[at.SPIN] = whirl if hold[at.MU] > 0.0 else state[at.SPIN]
    return True


@compiled
def unwedge(state, ints, hold, grain, walls, fx, fy):
    """Whether a wedged granule stays; else it is left with the wall that presses."""
    x, y, vx, vy = state[at.X], state[at.Y], state[at.VX], state[at.VY]
    first, second = _presses(hold, fx, fy, x, y, vx, vy, state[at.T])
    if first >= 0.0 and second >= 0.0:
        return True
    if first < 0.0 and second > 0.0:
        ints[at.CONTACT], ints[at.FEATURE] = ints[at.PAIR], ints[at.PAIRED]
        ints[at.BODY], _ = grasp(
            hold, walls, ints[at.PAIR], ints[at.PAIRED], grain[at.RADIUS], state[at.X], state[at.Y], state[at.T]
        )
        hold[at.SIGN] = 0.0
    ints[at.PAIR] = at.FREE
    return False


@compiled
def _carried(state, ints, hold, affine, grain, table, walls, dt):
    """Whether it is still held after riding with the wall for dt, and where and how fast it is then."""
    t = state[at.T]
    x, y, wx, wy = carried_along(walls.bodies, ints[at.BODY], state[at.X], state[at.Y], t, t + dt)
    fx, fy, _, _, _ = free_force(affine, grain, table, x, y, wx, wy, t + dt, state[at.SPIN])
    if ints[at.PAIR] != at.FREE:
        first, second = _presses(hold, fx, fy, x, y, wx, wy, t + dt)
        return first >= 0.0 and second >= 0.0, x, y, wx, wy
    _, _, press, free, _, _ = constrain(hold, fx, fy, x, y, wx, wy, t + dt)
    return held(hold, grain, press, free), x, y, wx, wy


@compiled
def hold_still(state, ints, hold, affine, grain, table, walls, rules, timed):
    """A granule at rest that is held: it rests for good, or rides on with the wall while it is."""
    moving = hold[at.WW] != 0.0
    if not moving and not timed and grain[at.NOISE] == 0.0:
        ints[at.FATE] = at.RESTING
        return
    dt = min(rules.until - state[at.T], LOOKS * rules.coarse)
    if moving:  # what presses is largest and least where the wall's acceleration turns
        dt = min(dt, (SWAY if hold[at.SAMPLED] == 0.0 else SAMPLED_SWAY) / hold[at.WW])
        dt = min(dt, next_turn(walls.bodies, ints[at.BODY], state[at.T]))
    if timed:
        dt = min(dt, SHARE / affine[at.PER_DT] if affine[at.PER_DT] != 0.0 else dt, state[at.T_END] - state[at.T])
    if grain[at.NOISE] != 0.0:
        dt = min(dt, state[at.T_NOISE] - state[at.T])
    end = state[at.T] + dt
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
        high = max(high, STATIC * (abs(state[at.T]) + 1.0))  # the clock has to move, or it is held again
        _, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, high)
        dt, end = high, state[at.T] + high
    state[at.HELD] += dt
    if state[at.HELD] > rules.rest:
        ints[at.FATE] = at.RESTING
        return
    state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T] = x, y, vx, vy, end
    ride(hold, walls, ints[at.BODY], end)
    if hold[at.TURNS] != 0.0 and hold[at.ROCKS] != 0.0 and hold[at.MU] > 0.0:
        _, _, _, _, state[at.SPIN] = wall_motion(walls.bodies, ints[at.BODY], end, x, y, 0.0, 0.0)
