"""A granule in contact: the strike, sliding, and being held by friction; ``contact_ends`` has how each of them ends.

Sliding is flight under a constraint (see ``walls.constrain``): the same steps, the same dense output, the same events.
"""

from __future__ import annotations

import math

from ...laws.collision import collide
from . import events
from . import layout as at
from .air import free_force
from .dense_output import along
from .dispersion import mirror
from .events import first_below, seen_from, turned_by, wall_motion
from .jit import called, compiled
from .rest import STATIC, caught, held, hold_still, tangent, unwedge, wedge
from .strike import flake_spin, friction_of, restitution_of, stays, tilted
from .walls import carry, constrain, grasp, inside, leans

# -- A granule in contact ----------------------------------------------------------------------------------------------
_collide = compiled(collide)
AT_REST = 1e-13  # of a body's length per s and of the free acceleration: slower is at rest, to round-off
ROLLS = 1e-12  # of sliding and turning speed: a slip below it is the round-off of their difference


@compiled
def settle(state, ints, hold, walls, rolls):
    """Put a granule in contact exactly on its surface, moving along it; where it rolls its contact point is at rest."""
    _, off = grasp(hold, walls, ints[at.CONTACT], ints[at.FEATURE], hold[at.ARM], state[at.X], state[at.Y], state[at.T])
    nx, ny = hold[at.NX], hold[at.NY]
    state[at.X] -= off * nx
    state[at.Y] -= off * ny
    wx, wy, _, _, turn = wall_motion(walls.bodies, ints[at.BODY], state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
    vn = (state[at.VX] - wx) * nx + (state[at.VY] - wy) * ny
    state[at.VX] -= vn * nx
    state[at.VY] -= vn * ny
    if rolls:
        state[at.SPIN] = (nx * (state[at.VY] - wy) - ny * (state[at.VX] - wx)) / hold[at.ARM] + turn


@compiled
def _collision(state, ints, hold, grain, walls, body, friction, last, feature, seed):
    """Velocity and spin after the impact on the wall in ``hold``; a granule that it throws back for ever at the wall
    (last, feature) stops. Returns the restitution and the normal impulse.

    Only granules that come flying are scattered: not those that lie on another wall, or rattle between two.
    """
    nx, ny = hold[at.NX], hold[at.NY]
    mobility, radius, back = grain[at.BLOW], grain[at.RADIUS], grain[at.GIVES_BACK]
    sx, sy, _, _, turn = wall_motion(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
    wx, wy = sx + turn * radius * ny, sy - turn * radius * nx  # where they touch
    e = restitution_of(state, grain, walls, body, nx, ny, wx, wy)
    mx, my = nx, ny
    if grain[at.SCATTER] != 0.0 and last == at.FREE:
        mx, my = tilted(state, ints, hold, grain, wx, wy, e, friction, seed)
    vx, vy, spin, normal, _ = _collide(
        state[at.VX], state[at.VY], state[at.SPIN], mx, my, wx, wy, e, friction, mobility, radius, back
    )
    if grain[at.TOSS] != 0.0:
        rx, ry, spin = state[at.VX] - wx, state[at.VY] - wy, state[at.SPIN]
        spin = flake_spin(ints, grain, spin, rx, ry, vx - wx, vy - wy, mx, my, seed)
    if grain[at.NOISE] != 0.0:
        mirror(state, ints, nx, ny)
    if normal > 0.0:
        ints[at.IMPACTS] += 1
    if last != at.FREE and caught(state, hold, walls, last, feature, body, vx - sx, vy - sy, e, ints[at.STUCK]):
        vx, vy = sx, sy
    state[at.VX], state[at.VY], state[at.SPIN] = vx, vy, spin
    return e, normal


@called
def strike(state, ints, hold, affine, grain, table, walls, rules, kind, which):
    """The granule touches a feature: collision, and sliding from then on where no bounce worth following is left."""
    body, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
    before, other = ints[at.CONTACT], ints[at.FEATURE]
    nx, ny = hold[at.NX], hold[at.NY]
    mx, my = nx, ny
    if before != at.FREE:  # put right along the wall that it is on, so as not to enter that one
        mx, my = tangent(walls, before, other, nx, ny, state)
    state[at.X] -= off * mx
    state[at.Y] -= off * my
    last, feature = (ints[at.PAIR], ints[at.PAIRED]) if before == at.FREE and ints[at.STUCK] > 1 else (before, other)
    ints[at.CONTACT] = ints[at.PAIR] = at.FREE
    x, y = state[at.X], state[at.Y]
    wx, wy, _, _, _ = wall_motion(walls.bodies, body, state[at.T], x, y, 0.0, 0.0)
    if stays(state, ints, grain, walls, body, nx, ny, wx, wy, rules.seed):
        hold[at.KIND] = at.FREE
        return
    f = friction_of(grain, walls, body)
    e, normal = _collision(state, ints, hold, grain, walls, body, f, last, feature, rules.seed)
    vx, vy = state[at.VX], state[at.VY]
    _, _, px, py, _ = wall_motion(walls.bodies, body, state[at.T], x, y, vx, vy)
    fx, fy, _, _, _ = free_force(affine, grain, table, x, y, vx, vy, state[at.T], state[at.SPIN])
    rebound, slide = (vx - wx) * nx + (vy - wy) * ny, -ny * (vx - wx) + nx * (vy - wy)
    lift = (fx - px) * nx + (fy - py) * ny
    if kind == at.ON_VERTEX:
        lift += slide * slide / grain[at.RADIUS]
    if lift < 0.0 and (rebound <= at.SLOW or rebound * rebound <= -2.0 * lift * rules.tiny):
        ints[at.CONTACT], ints[at.FEATURE], ints[at.BODY] = kind, which, body
        hold[at.MU] = f
        state[at.VX] -= rebound * nx
        state[at.VY] -= rebound * ny
        state[at.H_ERROR] = math.inf
        if before != at.FREE:
            wedge(state, ints, hold, walls, rules, fx, fy, before, other, e)
    elif before != at.FREE and normal == 0.0:  # it only touches: it stays on the wall that it is on
        grasp(hold, walls, before, other, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
        ints[at.CONTACT] = before
    else:
        hold[at.KIND] = at.FREE
        ints[at.PAIR], ints[at.PAIRED] = kind, which


@compiled
def grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed):
    """Tell whether a granule in contact is lifted off, held by static friction, rolling or sliding. Returns whether it
    was dealt with.

    Rolling takes the friction force free / (1 + m r^2 / I) (Routh 1897, ch. 4); where the wall cannot give that, the
    contact point slips.
    """
    hold[at.SIGN] = hold[at.ROLL] = 0.0
    hold[at.TURNS] = hold[at.ARM] if grain[at.MOBILITY] > 0.0 else 0.0
    if ints[at.PAIR] != at.FREE and unwedge(state, ints, hold, grain, walls, fx, fy):
        hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
        return True
    _, _, press, free, slide, turn = constrain(
        hold, fx, fy, state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T]
    )
    if press <= 0.0:
        state[at.HELD] = 0.0
        ints[at.CONTACT] = at.FREE
        hold[at.KIND] = at.FREE
        return False
    mobility, around = grain[at.MOBILITY], grain[at.RADIUS] * (state[at.SPIN] - turn)
    slip = slide - around if mobility > 0.0 else slide
    still = AT_REST * (rules.length + abs(free))
    if abs(slide) <= still and abs(slip) <= still and held(hold, grain, press, free):
        state[at.SPIN] = turn if mobility > 0.0 else state[at.SPIN]
        hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
        return True
    state[at.HELD] = 0.0
    if abs(slip) <= still + (ROLLS * (abs(slide) + abs(around)) if mobility > 0.0 else 0.0):
        part = 1.0 / (1.0 + mobility)
        if mobility > 0.0 and abs(free) * part <= hold[at.MU] * press:
            hold[at.ROLL] = part
            state[at.SPIN] = slide / grain[at.RADIUS] + turn
            return False
        slip = free
    hold[at.SIGN] = 1.0 if slip > 0.0 else -1.0
    return False


@compiled
def rescue(state, ints, hold, affine, grain, table, walls, rules):
    """Put a centre that is inside a body back on the nearest edge, as a contact: none is ever left there."""
    for body in range(walls.bodies.shape[0]):
        x, y, _, _ = seen_from(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
        within, nearest = inside(walls, body, x, y)
        if within:
            strike(state, ints, hold, affine, grain, table, walls, rules, at.ON_EDGE, nearest)


# -- How contact ends --------------------------------------------------------------------------------------------------
SLIVER = 1e-3  # of the skin: how near to the end of a face a granule must be to slide off it at once


@compiled
def friction_turn(path, h, state, affine, grain, table, hold):
    """Coefficients of s, s^2, s^3 of the spin that friction gives a slipping granule over a step h (Simpson's rule)."""
    if hold[at.ROLL] != 0.0 or grain[at.MOBILITY] == 0.0:
        return 0.0, 0.0, 0.0
    spin, t0 = state[at.SPIN], state[at.T]
    a, _ = _pressed(path, 0.0, t0, affine, grain, table, hold, spin)
    b, _ = _pressed(path, 0.5 * h, t0, affine, grain, table, hold, spin)
    c, _ = _pressed(path, h, t0, affine, grain, table, hold, spin)
    size = hold[at.SIGN] * hold[at.MU] * grain[at.MOBILITY] / grain[at.RADIUS]
    return size * a, size * (4.0 * b - 3.0 * a - c) / (2.0 * h), size * (a - 2.0 * b + c) * 2.0 / (3.0 * h * h)


@compiled
def _slip(path, s, t0, hold, spin, radius):
    """Velocity of the contact point along the moving wall."""
    x, y, vx, vy = along(path, s)
    nx, ny, wx, wy, _, _, turn, _ = carry(hold, x, y, vx, vy, t0 + s)
    if hold[at.KIND] == at.ON_VERTEX:
        d = math.sqrt(nx * nx + ny * ny)
        nx, ny = nx / d, ny / d
    else:
        nx, ny = turned_by(leans(hold, t0 + s), hold[at.NX], hold[at.NY])
    return nx * (vy - wy) - ny * (vx - wx) - radius * (spin - turn)


@compiled
def takes_hold(path, s, state, hold, grain, turn):
    """When within [0, s] the contact point of a slipping granule that can turn comes to rest (bisection): (time, did
    it).
    """
    if hold[at.ROLL] != 0.0 or grain[at.MOBILITY] == 0.0:
        return s, False
    a, b, c = turn
    spin, radius, sign = state[at.SPIN], grain[at.RADIUS], hold[at.SIGN]
    if sign * _slip(path, s, state[at.T], hold, spin + s * (a + s * (b + s * c)), radius) > 0.0:
        return s, False
    low, high = 0.0, s
    for _ in range(60):
        m = 0.5 * (low + high)
        if sign * _slip(path, m, state[at.T], hold, spin + m * (a + m * (b + m * c)), radius) > 0.0:
            low = m
        else:
            high = m
    return high, True


@compiled
def _beside(path, s, t0, hold, bodies, body):
    """Position from the constraint's origin and velocity, both in the wall's frame, at time s of the step."""
    x, y, vx, vy = along(path, s)
    x, y, vx, vy = seen_from(bodies, body, t0 + s, x, y, vx, vy)
    return x - hold[at.OX], y - hold[at.OY], vx, vy


@compiled
def ends_of_slide(path, ints, hold, grain, walls, rules, s, t0):
    """The first of: sliding stops, or the end of the face or corner is reached. Returns (time, event, next kind, next
    feature). What can turn does not stop when it stops sliding.

    A face ends at the corners at its start and end; a corner beyond the direction of the edge that ends there, and
    before that of the edge that starts there.
    """
    bodies, edges, body, feature = walls.bodies, walls.edges, ints[at.BODY], ints[at.FEATURE]
    event, kind, which, face = events.NOTHING, at.FREE, at.NOBODY, hold[at.KIND] == at.ON_EDGE
    qx, qy, rx, ry = _beside(path, 0.0, t0, hold, bodies, body)
    ex, ey, ux, uy = _beside(path, s, t0, hold, bodies, body)
    ox, oy, sign, skin = hold[at.OX], hold[at.OY], hold[at.SIGN], SLIVER * rules.skin
    what, q0, dx, dy, wa, wb = events.SPIN, sign, 0.0, 0.0, sign * (qx * ry - qy * rx), sign * (ex * uy - ey * ux)
    if face:
        tx, ty = -edges[feature, at.OUT_Y], edges[feature, at.OUT_X]
        wa, wb = sign * (tx * rx + ty * ry), sign * (tx * ux + ty * uy)
        what, q0, dx, dy = events.SPEED, 0.0, sign * tx, sign * ty
    if grain[at.MOBILITY] == 0.0 and wa > 0.0 and wb < 0.0:
        s = first_below(path, t0, bodies, body, what, ox, oy, q0, dx, dy, 0.0, wa, 0.0, s, wb, 0.0, 0.0)
        event = events.HALTED
    for end in range(2):
        e = feature if face else walls.vertex_links[feature, at.BEFORE + end]
        if e < 0:
            continue
        ex, ey, ux, uy = _beside(path, s, t0, hold, bodies, body)  # s may have become less
        q0 = edges[e, at.LENGTH] if face and end == 1 else 0.0
        tx, ty = -edges[e, at.OUT_Y], edges[e, at.OUT_X]
        dx, dy = (tx, ty) if end == 0 else (-tx, -ty)
        fa, fb = q0 + dx * qx + dy * qy, q0 + dx * ex + dy * ey
        ra, rb = dx * rx + dy * ry, dx * ux + dy * uy
        if face and fa < -rules.skin and ra >= 0.0:
            continue
        met = first_below(path, t0, bodies, body, events.PLANE, ox, oy, q0, dx, dy, 0.0, fa, ra, s, fb, rb, skin)
        if 0.0 <= met <= s and (fb < 0.0 or met < s):
            s, event, kind, which = met, events.SLID_OFF, at.ON_EDGE, e
            if face:
                which = walls.edge_links[feature, at.BEFORE + end]
                kind = at.ON_VERTEX if which >= 0 else at.FREE
    return s, event, kind, which


@compiled
def _pressed(path, s, t0, affine, grain, table, hold, spin):
    """How hard the wall presses at time s of the step, and whether a rolling granule's grip is enough."""
    x, y, vx, vy = along(path, s)
    fx, fy, _, _, _ = free_force(affine, grain, table, x, y, vx, vy, t0 + s, spin)
    _, _, press, free, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t0 + s)
    return press, hold[at.ROLL] == 0.0 or abs(free) * hold[at.ROLL] <= (hold[at.MU] + STATIC) * press


@compiled
def lets_go(path, s, state, affine, grain, table, hold):
    """When within [0, s] the wall stops pressing, or rolling becomes slipping (bisection): (time, event)."""
    spin, t0 = state[at.SPIN], state[at.T]
    press, firm = _pressed(path, s, t0, affine, grain, table, hold, spin)
    if press > 0.0 and firm:
        return s, events.NOTHING
    low, high = 0.0, s
    for _ in range(50):
        middle = 0.5 * (low + high)
        press, firm = _pressed(path, middle, t0, affine, grain, table, hold, spin)
        if press > 0.0 and firm:
            low = middle
        else:
            high = middle
    press, _ = _pressed(path, high, t0, affine, grain, table, hold, spin)
    return high, events.LIFTED if press <= 0.0 else events.SLIPS
