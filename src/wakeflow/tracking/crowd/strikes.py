"""A granule of the crowd and the walls, which are outlines drawn across the slab: strikes, and sliding, rolling and
lying as contact that lasts.

Where and when a wall is struck is the tracker's (``kernel.crossings``); what the strike does is the law of pairs with a
wall for the second granule. Contact that lasts is Moreau's time stepping (Moreau, J.J. 1988, in Nonsmooth Mechanics and
Applications, CISM 302): the granule flies freely for a step, and what of it went into the wall comes back as one
impulse of the same law without rebound, whose Coulomb cap is the friction of the step. Half of that impulse acts on the
place: second order, exact for a constant pull.
"""

from __future__ import annotations

import math

import numpy as np

from ...laws.collision import collide_pair
from ..kernel import layout as at
from ..kernel.dispersion import mirror
from ..kernel.events import wall_displacement
from ..kernel.jit import compiled, inlined
from ..kernel.restitution import restitution_of
from ..kernel.scatter import tilted
from ..kernel.walls import grasp, inside, overlap
from . import layout as of

__all__ = ["PULLS", "STILL", "hit_wall", "pair_law", "press"]

pair_law = compiled(collide_pair)
PULLS = 4.0  # steps of a pull: an approach that much of it makes is contact that lasts, not a strike
STILL = 1e-10  # m/s: slower on its wall a granule is held, to the round-off of a step's impulse
SWEEPS = 4  # over the bodies that a granule may touch at once
NOBODY = np.int64(-1)


@compiled
def _friction(grain, walls, body):
    own = walls.bodies[body, at.BODY_FRICTION]
    return grain[at.FRICTION] if own < 0.0 else own


@compiled
def _kick(state, own, grain, nx, ny, wx, wy, e, f):
    """One collision with a wall that moves with w: velocity and spin; returns the normal impulse over the mass."""
    r, q, light = grain[at.RADIUS], grain[at.MOBILITY], own[of.LIGHT]
    arm = r if q > 0.0 else 0.0
    jx, jy, jz, jn = pair_law(
        state[at.VX] - wx, state[at.VY] - wy, own[of.VZ], arm * own[of.WX], arm * own[of.WY], arm * state[at.SPIN],
        nx, ny, 0.0, light, 0.0, q, 0.0, e, f, grain[at.GIVES_BACK],
    )  # fmt: skip
    state[at.VX] += light * jx
    state[at.VY] += light * jy
    own[of.VZ] += light * jz
    own[of.DRAG] = 0.0
    turn = light * q / r
    own[of.WX] -= turn * ny * jz
    own[of.WY] += turn * nx * jz
    state[at.SPIN] -= turn * (nx * jy - ny * jx)
    return light * jn


@compiled
def hit_wall(state, ints, own, grain, walls, rules, path, hold, h, kind, which):
    """The granule reaches a feature within a step h: collision; contact that lasts where a bounce is not followed."""
    body, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
    nx, ny = hold[at.NX], hold[at.NY]
    state[at.X] -= off * nx
    state[at.Y] -= off * ny
    ints[at.CONTACT] = at.FREE
    hold[at.KIND] = at.FREE
    if walls.members[body, at.CAPTURES] == 1:
        ints[at.FATE] = at.CAPTURED
        return
    _, _, wx, wy, px, py = wall_displacement(walls.bodies, body, state[at.T])
    e = restitution_of(state, grain, walls, body, nx, ny, wx, wy)
    if grain[at.NOISE] != 0.0:
        mirror(state, ints, nx, ny)
    f, mx, my = _friction(grain, walls, body), nx, ny
    if grain[at.SCATTER] != 0.0:  # in the plane alone: the rms angle is that of the plane's projection (laws/rebound)
        mx, my = tilted(state, ints, hold, grain, wx, wy, e, f, rules.seed)
    if _kick(state, own, grain, mx, my, wx, wy, e, f) > 0.0:
        ints[at.IMPACTS] += 1
    rx, ry = state[at.VX] - wx, state[at.VY] - wy
    rebound, slide = rx * nx + ry * ny, nx * ry - ny * rx
    rate = path[at.RATE]
    lift = (path[at.N0X] - rate * state[at.VX] - px) * nx + (path[at.N0Y] - rate * state[at.VY] - py) * ny
    if kind == at.ON_VERTEX:
        lift += slide * slide / grain[at.RADIUS]
    low = rebound <= at.SLOW or rebound * rebound <= -2.0 * lift * rules.tiny or rebound <= -0.5 * lift * h
    if lift < 0.0 and low:
        ints[at.CONTACT], ints[at.FEATURE], ints[at.BODY] = kind, which, body
        state[at.VX] -= rebound * nx
        state[at.VY] -= rebound * ny


@inlined
def _deepest(walls, body, x, y, r):
    """The feature into which a granule reaches deepest (body frame): (kind, which), FREE for none; a centre within the
    body counts for the nearest edge.
    """
    within, nearest = inside(walls, body, x, y)
    if within:
        return at.ON_EDGE, nearest
    depth, kind, which = overlap(walls, body, x, y, r)
    if depth > 0.0:
        return kind, which
    return at.FREE, NOBODY


@compiled
def press(state, ints, own, grain, walls, rules, hold, h, pull):
    """Take what reaches into walls out of them, by impulses of contacts that last h (0: only put it back); whether
    anything did. ``pull`` m/s2: the acceleration of the step, by which slow approaches are told from strikes.
    """
    touches = False
    for _ in range(SWEEPS):
        hit = False
        for body in range(walls.bodies.shape[0]):
            dx, dy, wx, wy, px, py = wall_displacement(walls.bodies, body, state[at.T])
            kind, which = _deepest(walls, body, state[at.X] - dx, state[at.Y] - dy, grain[at.RADIUS])
            if kind == at.FREE:
                continue
            hit = touches = True
            if walls.members[body, at.CAPTURES] == 1:
                ints[at.FATE] = at.CAPTURED
                return True
            _, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
            nx, ny = hold[at.NX], hold[at.NY]
            hold[at.KIND] = at.FREE
            vx, vy, vz = state[at.VX], state[at.VY], own[of.VZ]
            approach = -((vx - wx) * nx + (vy - wy) * ny)
            if approach > 0.0:
                slow = approach <= PULLS * h * (pull + math.hypot(px, py)) + at.SLOW
                e = 0.0 if slow else restitution_of(state, grain, walls, body, nx, ny, wx, wy)
                _kick(state, own, grain, nx, ny, wx, wy, e, _friction(grain, walls, body))
                if slow:
                    lasting = 0.5 * h
                    state[at.X] += lasting * (state[at.VX] - vx)
                    state[at.Y] += lasting * (state[at.VY] - vy)
                    own[of.Z] += lasting * (own[of.VZ] - vz)
                else:
                    ints[at.IMPACTS] += 1
            _, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
            hold[at.KIND] = at.FREE
            state[at.X] -= off * nx
            state[at.Y] -= off * ny
            ints[at.CONTACT], ints[at.FEATURE], ints[at.BODY] = kind, which, body
        if not hit:
            break
    return touches
