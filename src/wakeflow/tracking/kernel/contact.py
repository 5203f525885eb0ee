"""A granule in contact: the strike, sliding, and being held by friction; ``contact_ends`` has how each of them ends.

Sliding is flight under a constraint (see ``walls.constrain``): the same steps, the same dense output, the same events.
"""

from __future__ import annotations

import math

from ...laws.collision import collide
from . import layout as at
from .dispersion import mirror
from .events import wall_displacement
from .forces import free_force
from .jit import compiled, inlined
from .rest import caught, held, hold_still, tangent, unwedge, wedge
from .restitution import restitution_of
from .scatter import tilted
from .walls import constrain, grasp, inside

__all__ = ["grip", "rescue", "settle", "strike"]

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
    _, _, wx, wy, _, _ = wall_displacement(walls.bodies, ints[at.BODY], state[at.T])
    vn = (state[at.VX] - wx) * nx + (state[at.VY] - wy) * ny
    state[at.VX] -= vn * nx
    state[at.VY] -= vn * ny
    if rolls:
        state[at.SPIN] = (nx * (state[at.VY] - wy) - ny * (state[at.VX] - wx)) / hold[at.ARM]


@inlined
def _collision(state, ints, hold, grain, walls, body, friction, last, one, seed):
    """Velocity and spin after the impact on the wall in ``hold``; a granule that it throws back for ever at the wall
    (last, one) stops. Returns the restitution, the normal impulse, the wall's velocity and its acceleration.

    Only granules that come flying are scattered: not those that lie on another wall, or rattle between two.
    """
    nx, ny = hold[at.NX], hold[at.NY]
    _, _, wx, wy, px, py = wall_displacement(walls.bodies, body, state[at.T])
    e = restitution_of(state, grain, walls, body, nx, ny, wx, wy)
    mobility, radius, back = grain[at.MOBILITY], grain[at.RADIUS], grain[at.GIVES_BACK]
    mx, my = nx, ny
    if grain[at.SCATTER] != 0.0 and last == at.FREE:
        mx, my = tilted(state, ints, hold, grain, wx, wy, e, friction, seed)
    vx, vy, spin, normal, _ = _collide(
        state[at.VX], state[at.VY], state[at.SPIN], mx, my, wx, wy, e, friction, mobility, radius, back
    )
    if grain[at.NOISE] != 0.0:
        mirror(state, ints, nx, ny)
    if normal > 0.0:
        ints[at.IMPACTS] += 1
    if last != at.FREE and caught(state, hold, walls, last, one, body, vx - wx, vy - wy, e, ints[at.STUCK]):
        vx, vy = wx, wy
    state[at.VX], state[at.VY], state[at.SPIN] = vx, vy, spin
    return e, normal, wx, wy, px, py


@compiled
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
    last, one = (ints[at.PAIR], ints[at.PAIRED]) if before == at.FREE and ints[at.STUCK] > 1 else (before, other)
    ints[at.CONTACT] = ints[at.PAIR] = at.FREE
    if walls.members[body, at.CAPTURES] == 1:
        ints[at.FATE] = at.CAPTURED
        hold[at.KIND] = at.FREE
        return
    f = walls.bodies[body, at.BODY_FRICTION]
    f = grain[at.FRICTION] if f < 0.0 else f
    e, normal, wx, wy, px, py = _collision(state, ints, hold, grain, walls, body, f, last, one, rules.seed)
    vx, vy = state[at.VX], state[at.VY]
    fx, fy, _, _, _ = free_force(affine, grain, table, state[at.X], state[at.Y], vx, vy, state[at.T], state[at.SPIN])
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
    """For a granule in contact: lifted off, held by static friction, rolling or sliding. Returns whether it was dealt
    with.

    Rolling takes the friction force free / (1 + m r^2 / I) (Routh 1897, ch. 4); where the wall cannot give that, the
    contact point slips.
    """
    hold[at.SIGN] = hold[at.ROLL] = 0.0
    if ints[at.PAIR] != at.FREE and unwedge(state, ints, hold, grain, walls, fx, fy):
        hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
        return True
    _, _, press, free, slide = constrain(
        hold, fx, fy, state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T]
    )
    if press <= 0.0:
        state[at.HELD] = 0.0
        ints[at.CONTACT] = at.FREE
        hold[at.KIND] = at.FREE
        return False
    mobility, around = grain[at.MOBILITY], grain[at.RADIUS] * state[at.SPIN]
    slip = slide - around if mobility > 0.0 else slide
    still = AT_REST * (rules.length + abs(free))
    if abs(slide) <= still and abs(slip) <= still and held(hold, grain, press, free):
        state[at.SPIN] = 0.0 if mobility > 0.0 else state[at.SPIN]
        hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
        return True
    state[at.HELD] = 0.0
    if abs(slip) <= still + (ROLLS * (abs(slide) + abs(around)) if mobility > 0.0 else 0.0):
        part = 1.0 / (1.0 + mobility)
        if mobility > 0.0 and abs(free) * part <= hold[at.MU] * press:
            hold[at.ROLL] = part
            state[at.SPIN] = slide / grain[at.RADIUS]
            return False
        slip = free
    hold[at.SIGN] = 1.0 if slip > 0.0 else -1.0
    return False


@inlined
def rescue(state, ints, hold, affine, grain, table, walls, rules):
    """No centre is ever left inside a body: put it back on the nearest edge, as a contact."""
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = wall_displacement(walls.bodies, body, state[at.T])
        within, nearest = inside(walls, body, state[at.X] - dx, state[at.Y] - dy)
        if within:
            strike(state, ints, hold, affine, grain, table, walls, rules, at.ON_EDGE, nearest)
