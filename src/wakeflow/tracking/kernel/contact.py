"""A granule in contact: the strike, sliding, being held by friction, and how each of them ends.

Sliding is flight under a constraint (see ``walls.constrain``): the same steps, the same dense output, the same events.
"""

from __future__ import annotations

import math

from ...laws.collision import collide
from .dense_output import along
from .dispersion import mirror
from .events import HALTED, LIFTED, NOTHING, PLANE, SLID_OFF, SLIPS, SPEED, SPIN, displacement, first_below
from .jit import compiled, inlined
from .layout import (
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
    NOISE,
    NX,
    NY,
    ON_EDGE,
    ON_VERTEX,
    OX,
    OY,
    PAIR,
    PAIRED,
    RADIUS,
    ROLL,
    SIGN,
    SLOW,
    STUCK,
    TURN,
    VX,
    VY,
    T,
    X,
    Y,
)
from .rest import STATIC, caught, held, hold_still, tangent, unwedge, wedge
from .restitution import restitution_of
from .step import free_force
from .walls import constrain, grasp, inside

__all__ = ["ends_of_slide", "friction_turn", "grip", "lets_go", "rescue", "settle", "strike", "takes_hold"]

_collide = compiled(collide)


@compiled
def settle(state, ints, hold, walls, rolls):
    """Put a granule in contact exactly on its surface, moving along it; where it rolls its contact point is at rest."""
    _, off = grasp(hold, walls, ints[CONTACT], ints[FEATURE], hold[ARM], state[X], state[Y], state[T])
    nx, ny = hold[NX], hold[NY]
    state[X] -= off * nx
    state[Y] -= off * ny
    _, _, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], state[T])
    vn = (state[VX] - wx) * nx + (state[VY] - wy) * ny
    state[VX] -= vn * nx
    state[VY] -= vn * ny
    if rolls:
        state[TURN] = (nx * (state[VY] - wy) - ny * (state[VX] - wx)) / hold[ARM]


@compiled
def strike(state, ints, hold, affine, grain, table, walls, rules, kind, which):
    """The granule touches a feature: collision, and sliding from then on where no bounce worth following is left."""
    body, off = grasp(hold, walls, kind, which, grain[RADIUS], state[X], state[Y], state[T])
    nx, ny = hold[NX], hold[NY]
    before, other = ints[CONTACT], ints[FEATURE]
    mx, my = nx, ny
    if before != FREE:  # put right along the wall that it is on, so as not to enter that one
        mx, my = tangent(walls, before, other, nx, ny, state)
    state[X] -= off * mx
    state[Y] -= off * my
    last, one = (ints[PAIR], ints[PAIRED]) if before == FREE and ints[STUCK] > 1 else (before, other)
    ints[CONTACT] = ints[PAIR] = FREE
    if walls.members[body, 5] == 1:
        ints[FATE] = CAPTURED
        hold[KIND] = FREE
        return
    f = walls.bodies[body, 9]
    f = grain[FRICTION] if f < 0.0 else f
    _, _, wx, wy, px, py = displacement(walls.bodies, body, state[T])
    e = restitution_of(state, grain, walls, body, nx, ny, wx, wy)
    vx, vy, spin, normal, _ = _collide(
        state[VX], state[VY], state[TURN], nx, ny, wx, wy, e, f, grain[MOBILITY], grain[RADIUS]
    )
    if grain[NOISE] != 0.0:
        mirror(state, ints, nx, ny)
    if normal > 0.0:
        ints[IMPACTS] += 1
    if last != FREE and caught(state, hold, walls, last, one, body, vx - wx, vy - wy, e, ints[STUCK]):
        vx, vy = wx, wy
    state[VX], state[VY], state[TURN] = vx, vy, spin
    fx, fy, _, _, _ = free_force(affine, grain, table, state[X], state[Y], vx, vy, state[T], spin)
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
        if before != FREE:
            wedge(state, ints, hold, walls, rules, fx, fy, before, other, e)
    elif before != FREE and normal == 0.0:  # it only touches: it stays on the wall that it is on
        grasp(hold, walls, before, other, grain[RADIUS], state[X], state[Y], state[T])
        ints[CONTACT] = before
    else:
        hold[KIND] = FREE
        ints[PAIR], ints[PAIRED] = kind, which


@compiled
def grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed):
    """For a granule in contact: lifted off, held by static friction, rolling or sliding. Returns whether it was dealt
    with.

    Rolling takes the friction force free / (1 + m r^2 / I) (Routh 1897, ch. 4); where the wall cannot give that, the
    contact point slips.
    """
    hold[SIGN] = hold[ROLL] = 0.0
    if ints[PAIR] != FREE and unwedge(state, ints, hold, grain, walls, fx, fy):
        hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
        return True
    _, _, press, free, slide = constrain(hold, fx, fy, state[X], state[Y], state[VX], state[VY], state[T])
    if press <= 0.0:
        state[HELD] = 0.0
        ints[CONTACT] = FREE
        hold[KIND] = FREE
        return False
    mobility, around = grain[MOBILITY], grain[RADIUS] * state[TURN]
    slip = slide - around if mobility > 0.0 else slide
    still = 1e-13 * (rules.length + abs(free))
    if abs(slide) <= still and abs(slip) <= still and held(hold, grain, press, free):
        state[TURN] = 0.0 if mobility > 0.0 else state[TURN]
        hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
        return True
    state[HELD] = 0.0
    if abs(slip) <= still + (1e-12 * (abs(slide) + abs(around)) if mobility > 0.0 else 0.0):
        part = 1.0 / (1.0 + mobility)
        if mobility > 0.0 and abs(free) * part <= hold[MU] * press:
            hold[ROLL] = part
            state[TURN] = slide / grain[RADIUS]
            return False
        slip = free
    hold[SIGN] = 1.0 if slip > 0.0 else -1.0
    return False


@compiled
def friction_turn(path, h, state, affine, grain, table, hold):
    """Coefficients of s, s^2, s^3 of the spin that friction gives a slipping granule over a step h (Simpson's rule)."""
    if hold[ROLL] != 0.0 or grain[MOBILITY] == 0.0:
        return 0.0, 0.0, 0.0
    spin, t0 = state[TURN], state[T]
    a, _ = _pressed(path, 0.0, t0, affine, grain, table, hold, spin)
    b, _ = _pressed(path, 0.5 * h, t0, affine, grain, table, hold, spin)
    c, _ = _pressed(path, h, t0, affine, grain, table, hold, spin)
    size = hold[SIGN] * hold[MU] * grain[MOBILITY] / grain[RADIUS]
    return size * a, size * (4.0 * b - 3.0 * a - c) / (2.0 * h), size * (a - 2.0 * b + c) * 2.0 / (3.0 * h * h)


@compiled
def _slip(path, s, t0, hold, walls, body, spin, radius):
    """Velocity of the contact point along the moving wall."""
    x, y, vx, vy = along(path, s)
    dx, dy, wx, wy, _, _ = displacement(walls.bodies, body, t0 + s)
    nx, ny = hold[NX], hold[NY]
    if hold[KIND] == ON_VERTEX:
        nx, ny = x - dx - hold[OX], y - dy - hold[OY]
        d = math.sqrt(nx * nx + ny * ny)
        nx, ny = nx / d, ny / d
    return nx * (vy - wy) - ny * (vx - wx) - radius * spin


@compiled
def takes_hold(path, s, state, ints, hold, grain, walls, turn):
    """When within [0, s] the contact point of a slipping granule that can turn comes to rest (bisection): (time, did
    it).
    """
    if hold[ROLL] != 0.0 or grain[MOBILITY] == 0.0:
        return s, False
    a, b, c = turn
    spin, body, radius, sign = state[TURN], ints[BODY], grain[RADIUS], hold[SIGN]
    if sign * _slip(path, s, state[T], hold, walls, body, spin + s * (a + s * (b + s * c)), radius) > 0.0:
        return s, False
    low, high = 0.0, s
    for _ in range(60):
        m = 0.5 * (low + high)
        if sign * _slip(path, m, state[T], hold, walls, body, spin + m * (a + m * (b + m * c)), radius) > 0.0:
            low = m
        else:
            high = m
    return high, True


@compiled
def _beside(path, s, t0, hold, bodies, body):
    """Position from the constraint's origin and velocity, both seen from the wall, at time s of the step."""
    x, y, vx, vy = along(path, s)
    dx, dy, wx, wy, _, _ = displacement(bodies, body, t0 + s)
    return x - dx - hold[OX], y - dy - hold[OY], vx - wx, vy - wy


@compiled
def ends_of_slide(path, ints, hold, grain, walls, rules, s, t0):
    """The first of: sliding stops, or the end of the face or corner is reached. Returns (time, event, next kind, next
    feature). What can turn does not stop when it stops sliding.
    """
    stops = grain[MOBILITY] == 0.0
    bodies, body, skin = walls.bodies, ints[BODY], 1e-3 * rules.skin
    event, kind, which = NOTHING, FREE, NOBODY
    qx, qy, rx, ry = _beside(path, 0.0, t0, hold, bodies, body)
    ex, ey, ux, uy = _beside(path, s, t0, hold, bodies, body)
    sign, feature = hold[SIGN], ints[FEATURE]
    if hold[KIND] == ON_EDGE:
        tx, ty, size = -hold[NY], hold[NX], walls.edges[feature, 6]
        wa, wb = sign * (tx * rx + ty * ry), sign * (tx * ux + ty * uy)
        if stops and wa > 0.0 and wb < 0.0:
            s = first_below(
                path, t0, bodies, body, SPEED, 0.0, 0.0, 0.0, sign * tx, sign * ty, 0.0, wa, 0.0, s, wb, 0.0, 0.0
            )
            event = HALTED
        for end in range(2):
            ex, ey, ux, uy = _beside(path, s, t0, hold, bodies, body)  # s may have become less
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
    if stops and wa > 0.0 and wb < 0.0:
        s = first_below(path, t0, bodies, body, SPIN, hold[OX], hold[OY], sign, 0.0, 0.0, 0.0, wa, 0.0, s, wb, 0.0, 0.0)
        event = HALTED
    for end in range(2):  # beyond the direction of the edge that ends here, before that of the edge that starts here
        e = walls.vertex_links[feature, 1 + end]
        if e < 0:
            continue
        ex, ey, ux, uy = _beside(path, s, t0, hold, bodies, body)
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
def _pressed(path, s, t0, affine, grain, table, hold, spin):
    """How hard the wall presses at time s of the step, and whether a rolling granule's grip is enough."""
    x, y, vx, vy = along(path, s)
    fx, fy, _, _, _ = free_force(affine, grain, table, x, y, vx, vy, t0 + s, spin)
    _, _, press, free, _ = constrain(hold, fx, fy, x, y, vx, vy, t0 + s)
    return press, hold[ROLL] == 0.0 or abs(free) * hold[ROLL] <= (hold[MU] + STATIC) * press


@compiled
def lets_go(path, s, state, affine, grain, table, hold):
    """When within [0, s] the wall stops pressing, or rolling becomes slipping (bisection): (time, event)."""
    spin, t0 = state[TURN], state[T]
    press, firm = _pressed(path, s, t0, affine, grain, table, hold, spin)
    if press > 0.0 and firm:
        return s, NOTHING
    low, high = 0.0, s
    for _ in range(50):
        middle = 0.5 * (low + high)
        press, firm = _pressed(path, middle, t0, affine, grain, table, hold, spin)
        if press > 0.0 and firm:
            low = middle
        else:
            high = middle
    press, _ = _pressed(path, high, t0, affine, grain, table, hold, spin)
    return high, LIFTED if press <= 0.0 else SLIPS


@inlined
def rescue(state, ints, hold, affine, grain, table, walls, rules):
    """No centre is ever left inside a body: put it back on the nearest edge, as a contact."""
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = displacement(walls.bodies, body, state[T])
        within, nearest = inside(walls, body, state[X] - dx, state[Y] - dy)
        if within:
            strike(state, ints, hold, affine, grain, table, walls, rules, ON_EDGE, nearest)
