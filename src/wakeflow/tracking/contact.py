"""A granule in contact: the strike, sliding, being held by friction, and how each of them ends.

Sliding is flight under a constraint (see ``walls.constrain``): the same steps, the same dense output, the same events.
"""

from __future__ import annotations

import math

from ..laws.collision import collide
from .events import HALTED, NOTHING, PLANE, SLID_OFF, SPEED, SPIN, displacement, first_below
from .exponential import along
from .jit import compiled, inlined
from .state import (
    ARM,
    BODY,
    CAPTURED,
    CONTACT,
    FATE,
    FEATURE,
    FREE,
    FRICTION,
    H_ERROR,
    HELD,
    IMPACTS,
    KIND,
    MOBILITY,
    MU,
    NOBODY,
    NX,
    NY,
    ON_EDGE,
    ON_VERTEX,
    OX,
    OY,
    RADIUS,
    RESTING,
    RESTITUTION,
    SIGN,
    T_END,
    TURN,
    VX,
    VY,
    WW,
    T,
    X,
    Y,
)
from .step import free_force
from .walls import constrain, grasp, inside

__all__ = ["ends_of_slide", "grip", "lift_off", "rescue", "settle", "strike"]

_collide = compiled(collide)
SLOW = 1e-6  # m/s, rebounds slower than this are sliding
STATIC = 1e-12  # round-off of a friction coefficient: what is exactly balanced is held


@compiled
def settle(state, ints, hold, walls):
    """Put a sliding granule exactly on its surface, moving along it."""
    _, off = grasp(hold, walls, ints[CONTACT], ints[FEATURE], hold[ARM], state[X], state[Y], state[T])
    nx, ny = hold[NX], hold[NY]
    state[X] -= off * nx
    state[Y] -= off * ny
    _, _, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], state[T])
    vn = (state[VX] - wx) * nx + (state[VY] - wy) * ny
    state[VX] -= vn * nx
    state[VY] -= vn * ny


@compiled
def strike(state, ints, hold, affine, grain, table, walls, rules, kind, which):
    """The granule touches a feature: collision, and sliding from then on where no bounce worth following is left."""
    body, off = grasp(hold, walls, kind, which, grain[RADIUS], state[X], state[Y], state[T])
    nx, ny = hold[NX], hold[NY]
    state[X] -= off * nx
    state[Y] -= off * ny
    ints[CONTACT] = FREE
    if walls.members[body, 5] == 1:
        ints[FATE] = CAPTURED
        hold[KIND] = FREE
        return
    e, f = walls.bodies[body, 8], walls.bodies[body, 9]
    e = grain[RESTITUTION] if e < 0.0 else e
    f = grain[FRICTION] if f < 0.0 else f
    _, _, wx, wy, px, py = displacement(walls.bodies, body, state[T])
    vx, vy, spin, normal, _ = _collide(
        state[VX], state[VY], state[TURN], nx, ny, wx, wy, e, f, grain[MOBILITY], grain[RADIUS]
    )
    if normal > 0.0:
        ints[IMPACTS] += 1
    state[VX], state[VY], state[TURN] = vx, vy, spin
    fx, fy, _, _ = free_force(affine, grain, table, state[X], state[Y], vx, vy, state[T])
    rebound = (vx - wx) * nx + (vy - wy) * ny
    slide = -ny * (vx - wx) + nx * (vy - wy)
    lift = (fx - px) * nx + (fy - py) * ny
    if kind == ON_VERTEX:
        lift += slide * slide / grain[RADIUS]
    if lift < 0.0 and (rebound <= SLOW or rebound * rebound <= -2.0 * lift * rules.tiny):
        ints[CONTACT], ints[FEATURE], ints[BODY] = kind, which, body
        hold[MU] = f
        state[VX] -= rebound * nx
        state[VY] -= rebound * ny
        state[H_ERROR] = math.inf
    else:
        hold[KIND] = FREE


@compiled
def _carried(state, ints, hold, affine, grain, table, walls, dt):
    """Whether friction still holds after riding with the wall for dt, and where and how fast the granule is then."""
    t = state[T]
    x0, y0, _, _, _, _ = displacement(walls.bodies, ints[BODY], t)
    x1, y1, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], t + dt)
    x, y = state[X] + x1 - x0, state[Y] + y1 - y0
    fx, fy, _, _ = free_force(affine, grain, table, x, y, wx, wy, t + dt)
    _, _, press, free, _ = constrain(hold, fx, fy, x, y, wx, wy, t + dt)
    return press > 0.0 and abs(free) <= (hold[MU] + STATIC) * press, x, y, wx, wy


@compiled
def _hold_still(state, ints, hold, affine, grain, table, walls, rules, timed):
    """A granule at rest on a wall that friction holds: it rests for good, or rides on with the wall while it does."""
    moving = hold[WW] != 0.0
    if not moving and not timed:
        ints[FATE] = RESTING
        return
    dt = rules.until - state[T]
    if moving:
        dt = min(dt, 0.05 / hold[WW])
    if timed:
        dt = min(dt, 0.25 / affine[15] if affine[15] != 0.0 else dt, state[T_END] - state[T])
    end = state[T] + dt
    held, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, dt)
    if not held:  # let go within: find out when
        low, high = 0.0, dt
        for _ in range(60):
            middle = 0.5 * (low + high)
            held, _, _, _, _ = _carried(state, ints, hold, affine, grain, table, walls, middle)
            if held:
                low = middle
            else:
                high = middle
        _, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, high)
        dt, end = high, state[T] + high
    state[HELD] += dt
    if state[HELD] > rules.rest:
        ints[FATE] = RESTING
        return
    state[X], state[Y], state[VX], state[VY], state[T] = x, y, vx, vy, end


@compiled
def grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed):
    """For a granule in contact: lifted off, held by static friction, or sliding. Returns whether it was dealt with."""
    hold[SIGN] = 0.0
    _, _, press, free, slide = constrain(hold, fx, fy, state[X], state[Y], state[VX], state[VY], state[T])
    if press <= 0.0:
        state[HELD] = 0.0
        ints[CONTACT] = FREE
        hold[KIND] = FREE
        return False
    if abs(slide) <= 1e-13 * (rules.length + abs(free)):
        if abs(free) <= (hold[MU] + STATIC) * press:
            _hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
            return True
        slide = free
    hold[SIGN] = 1.0 if slide > 0.0 else -1.0
    state[HELD] = 0.0
    return False


@compiled
def ends_of_slide(path, ints, hold, walls, rules, s, t0):
    """The first of: sliding stops, or the end of the face or corner is reached. Returns (time, event, next kind, next
    feature).
    """
    bodies, body, skin = walls.bodies, ints[BODY], 1e-3 * rules.skin
    event, kind, which = NOTHING, FREE, NOBODY
    x, y, vx, vy = along(path, 0.0)
    dx, dy, wx, wy, _, _ = displacement(bodies, body, t0)
    qx, qy, rx, ry = x - dx - hold[OX], y - dy - hold[OY], vx - wx, vy - wy
    x, y, vx, vy = along(path, s)
    dx, dy, wx, wy, _, _ = displacement(bodies, body, t0 + s)
    ex, ey, ux, uy = x - dx - hold[OX], y - dy - hold[OY], vx - wx, vy - wy
    sign, feature = hold[SIGN], ints[FEATURE]
    if hold[KIND] == ON_EDGE:
        tx, ty, size = -hold[NY], hold[NX], walls.edges[feature, 6]
        wa, wb = sign * (tx * rx + ty * ry), sign * (tx * ux + ty * uy)
        if wa > 0.0 and wb < 0.0:
            s = first_below(
                path, t0, bodies, body, SPEED, 0.0, 0.0, 0.0, sign * tx, sign * ty, 0.0, wa, 0.0, s, wb, 0.0, 0.0
            )
            event = HALTED
        for end in range(2):
            q0 = 0.0 if end == 0 else size
            dx, dy = (tx, ty) if end == 0 else (-tx, -ty)
            fa, fb = q0 + dx * qx + dy * qy, q0 + dx * ex + dy * ey
            ra, rb = dx * rx + dy * ry, dx * ux + dy * uy
            if fa < -rules.skin and ra >= 0.0:
                continue
            found = first_below(
                path, t0, bodies, body, PLANE, hold[OX], hold[OY], q0, dx, dy, 0.0, fa, ra, s, fb, rb, skin
            )
            if 0.0 <= found <= s and (fb < 0.0 or found < s):
                s, event = found, SLID_OFF
                which = walls.edge_links[feature, 1 + end]
                kind = ON_VERTEX if which >= 0 else FREE
        return s, event, kind, which
    wa, wb = sign * (qx * ry - qy * rx), sign * (ex * uy - ey * ux)
    if wa > 0.0 and wb < 0.0:
        s = first_below(path, t0, bodies, body, SPIN, hold[OX], hold[OY], sign, 0.0, 0.0, 0.0, wa, 0.0, s, wb, 0.0, 0.0)
        event = HALTED
    for end in range(2):  # beyond the direction of the edge that ends here, before that of the edge that starts here
        e = walls.vertex_links[feature, 1 + end]
        if e < 0:
            continue
        tx, ty = -walls.edges[e, 5], walls.edges[e, 4]
        dx, dy = (tx, ty) if end == 0 else (-tx, -ty)
        fa, fb = dx * qx + dy * qy, dx * ex + dy * ey
        ra, rb = dx * rx + dy * ry, dx * ux + dy * uy
        found = first_below(
            path, t0, bodies, body, PLANE, hold[OX], hold[OY], 0.0, dx, dy, 0.0, fa, ra, s, fb, rb, skin
        )
        if 0.0 <= found <= s and (fb < 0.0 or found < s):
            s, event, kind, which = found, SLID_OFF, ON_EDGE, e
    return s, event, kind, which


@compiled
def _pressed(path, s, t0, affine, grain, table, hold):
    x, y, vx, vy = along(path, s)
    fx, fy, _, _ = free_force(affine, grain, table, x, y, vx, vy, t0 + s)
    _, _, press, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t0 + s)
    return press


@compiled
def lift_off(path, s, t0, affine, grain, table, hold):
    """When the wall stops pressing within [0, s] (bisection); s when it presses to the end."""
    if _pressed(path, s, t0, affine, grain, table, hold) > 0.0:
        return s, False
    low, high = 0.0, s
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _pressed(path, middle, t0, affine, grain, table, hold) > 0.0:
            low = middle
        else:
            high = middle
    return high, True


@inlined
def rescue(state, ints, hold, affine, grain, table, walls, rules):
    """No centre is ever left inside a body: put it back on the nearest edge, as a contact."""
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = displacement(walls.bodies, body, state[T])
        within, nearest = inside(walls, body, state[X] - dx, state[Y] - dy)
        if within:
            strike(state, ints, hold, affine, grain, table, walls, rules, ON_EDGE, nearest)
