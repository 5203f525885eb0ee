"""The flight of one of the granules that meet to the end of the step, past walls, lines and the mesh's edge.

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
from ..kernel.crossings import first_line, first_wall
from ..kernel.dense_output import along
from ..kernel.dispersion import mirror
from ..kernel.events import seen_from, wall_motion
from ..kernel.jit import called, compiled
from ..kernel.locate import barycentric
from ..kernel.step import leave
from ..kernel.strike import flake_spin, friction_of, restitution_of, stays, tilted
from ..kernel.walls import clearance, grasp, inside, overlap
from . import slab_layout as of
from .slab_air import GONE, aim, stir

# -- A granule and the walls ------------------------------------------------------------------------------
pair_law = compiled(collide_pair)
PULLS = 4.0  # steps of a pull: an approach that much of it makes is contact that lasts, not a strike
STILL = 1e-10  # m/s: slower on its wall a granule is held, to the round-off of a step's impulse
SWEEPS = 4  # over the bodies that a granule may touch at once
NOBODY = np.int64(-1)


@compiled
def _kick(state, extra, grain, nx, ny, wx, wy, e, f, q):
    """One collision with a wall that moves with w: velocity and spin; returns the normal impulse over the mass. ``q``
    m r^2 / I.
    """
    r, light = grain[at.RADIUS], extra[of.LIGHT]
    arm = r if q > 0.0 else 0.0
    jx, jy, jz, jn = pair_law(
        state[at.VX] - wx, state[at.VY] - wy, extra[of.VZ], arm * extra[of.WX], arm * extra[of.WY],
        arm * state[at.SPIN], nx, ny, 0.0, light, 0.0, q, 0.0, e, f, grain[at.GIVES_BACK],
    )  # fmt: skip
    state[at.VX] += light * jx
    state[at.VY] += light * jy
    extra[of.VZ] += light * jz
    extra[of.DRAG] = 0.0
    turn = light * q / r
    extra[of.WX] -= turn * ny * jz
    extra[of.WY] += turn * nx * jz
    state[at.SPIN] -= turn * (nx * jy - ny * jx)
    return light * jn


@compiled
def _touched(state, grain, walls, body, nx, ny):
    """Velocity of a wall of normal n where a granule touches it, and the rate at which it turns."""
    wx, wy, _, _, turn = wall_motion(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
    around = turn * grain[at.RADIUS]
    return wx + around * ny, wy - around * nx, turn


@called
def hit_wall(state, ints, extra, grain, walls, rules, path, hold, h, kind, which):
    """The granule reaches a feature within a step h: collision; contact that lasts where a bounce is not followed."""
    body, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
    nx, ny = hold[at.NX], hold[at.NY]
    state[at.X] -= off * nx
    state[at.Y] -= off * ny
    ints[at.CONTACT] = at.FREE
    hold[at.KIND] = at.FREE
    wx, wy, turn = _touched(state, grain, walls, body, nx, ny)
    if stays(state, ints, grain, walls, body, nx, ny, wx, wy, rules.seed):
        return
    e = restitution_of(state, grain, walls, body, nx, ny, wx, wy)
    if grain[at.NOISE] != 0.0:
        mirror(state, ints, nx, ny)
    f, mx, my = friction_of(grain, walls, body), nx, ny
    if grain[at.SCATTER] != 0.0:  # in the plane alone: the rms angle is that of the plane's projection (laws/rebound)
        mx, my = tilted(state, ints, hold, grain, wx, wy, e, f, rules.seed)
    sx, sy, spin = state[at.VX] - wx, state[at.VY] - wy, state[at.SPIN]
    across = extra[of.WX], extra[of.WY]
    normal = _kick(state, extra, grain, mx, my, wx, wy, e, f, grain[at.BLOW])
    rx, ry = state[at.VX] - wx, state[at.VY] - wy
    if grain[at.TOSS] != 0.0:
        extra[of.WX], extra[of.WY] = across
        state[at.SPIN] = flake_spin(ints, grain, spin, sx, sy, rx, ry, mx, my, rules.seed)
    if normal > 0.0:
        ints[at.IMPACTS] += 1
    rebound, slide = rx * nx + ry * ny, nx * ry - ny * rx - turn * grain[at.RADIUS]
    rate = path[at.RATE]
    _, _, px, py, _ = wall_motion(walls.bodies, body, state[at.T], state[at.X], state[at.Y], state[at.VX], state[at.VY])
    lift = (path[at.N0X] - rate * state[at.VX] - px) * nx + (path[at.N0Y] - rate * state[at.VY] - py) * ny
    if kind == at.ON_VERTEX:
        lift += slide * slide / grain[at.RADIUS]
    low = rebound <= at.SLOW or rebound * rebound <= -2.0 * lift * rules.tiny or rebound <= -0.5 * lift * h
    if lift < 0.0 and low:
        ints[at.CONTACT], ints[at.FEATURE], ints[at.BODY] = kind, which, body
        state[at.VX] -= rebound * nx
        state[at.VY] -= rebound * ny


@compiled
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
def press(state, ints, extra, grain, walls, rules, hold, h, pull):
    """Take what reaches into walls out of them, by impulses of contacts that last h (0: only put it back); whether
    anything did. ``pull`` m/s2: the acceleration of the step, by which slow approaches are distinguished from strikes.
    """
    touches = False
    for _ in range(SWEEPS):
        hit = False
        for body in range(walls.bodies.shape[0]):
            x, y, _, _ = seen_from(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
            kind, which = _deepest(walls, body, x, y, grain[at.RADIUS])
            if kind == at.FREE:
                continue
            hit = touches = True
            _, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])
            nx, ny = hold[at.NX], hold[at.NY]
            wx, wy, _ = _touched(state, grain, walls, body, nx, ny)
            if stays(state, ints, grain, walls, body, nx, ny, wx, wy, rules.seed):
                return True
            hold[at.KIND] = at.FREE
            vx, vy, vz = state[at.VX], state[at.VY], extra[of.VZ]
            _, _, px, py, _ = wall_motion(walls.bodies, body, state[at.T], state[at.X], state[at.Y], vx, vy)
            approach = -((vx - wx) * nx + (vy - wy) * ny)
            if approach > 0.0:
                slow = approach <= PULLS * h * (pull + math.hypot(px, py)) + at.SLOW
                e = 0.0 if slow else restitution_of(state, grain, walls, body, nx, ny, wx, wy)
                q = grain[at.MOBILITY]
                _kick(state, extra, grain, nx, ny, wx, wy, e, friction_of(grain, walls, body), q)
                if slow:
                    lasting = 0.5 * h
                    state[at.X] += lasting * (state[at.VX] - vx)
                    state[at.Y] += lasting * (state[at.VY] - vy)
                    extra[of.Z] += lasting * (extra[of.VZ] - vz)
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


# -- The flight of one of the granules that meet to the end of the step ------------------------------------------------
MAX_PIECES = 32  # of a step: a granule that rattles faster is pressed on
STEP_ROUNDING = 1e-6  # of a step: round-off between the ends of steps and of intervals of noise
SPARE = 1.05  # of the straight way: a path of one step bends less
C0, C1, C2, C3, C4, C5, C6, C7 = (1.0 / math.factorial(k + 2) for k in range(8))  # of the series of phi_2


@compiled
def begin_leg(state, extra, tally, clock):
    """A piece of path begins, on which the granule can be met."""
    extra[of.LEG_BEGIN] = state[at.T] - clock[of.NOW]
    extra[of.LEG_X], extra[of.LEG_Y], extra[of.LEG_Z] = state[at.X], state[at.Y], extra[of.Z]
    extra[of.LEG_VX], extra[of.LEG_VY], extra[of.LEG_VZ] = state[at.VX], state[at.VY], extra[of.VZ]
    extra[of.LEG_WX], extra[of.LEG_WY], extra[of.LEG_WZ] = extra[of.WX], extra[of.WY], state[at.SPIN]
    extra[of.LEG_GAIN_X], extra[of.LEG_GAIN_Y] = state[at.GAIN_X], state[at.GAIN_Y]
    tally[of.STAMP] += 1


@compiled
def end_leg(state, extra, clock):
    """End the piece of path where the granule is now: the parabola between."""
    extra[of.LEG_END] = state[at.T] - clock[of.NOW]
    s = extra[of.LEG_END] - extra[of.LEG_BEGIN]
    extra[of.LEG_AX] = extra[of.LEG_AY] = extra[of.LEG_AZ] = 0.0
    if s > 0.0:
        twice = 2.0 / (s * s)
        extra[of.LEG_AX] = twice * (state[at.X] - extra[of.LEG_X] - s * extra[of.LEG_VX])
        extra[of.LEG_AY] = twice * (state[at.Y] - extra[of.LEG_Y] - s * extra[of.LEG_VY])
        extra[of.LEG_AZ] = twice * (extra[of.Z] - extra[of.LEG_Z] - s * extra[of.LEG_VZ])


@compiled
def _decay(z):
    """e^z, phi_1 and phi_2 for z <= 0, to round-off: what ``dense_output.phis`` gives, less those that a path of one
    force does not need.
    """
    if z < -0.1:
        e = math.exp(z)
        p1 = (e - 1.0) / z
        return e, p1, (p1 - 1.0) / z
    p2 = C0 + z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * (C6 + z * C7))))))
    p1 = 1.0 + z * p2
    return 1.0 + z * p1, p1, p2


@compiled
def _gain(state, vx, vy):
    """Count the velocity that a piece of way gives, which ends with (vx, vy)."""
    state[at.GAIN_X] += vx - state[at.VX]
    state[at.GAIN_Y] += vy - state[at.VY]


@compiled
def _glide(path, extra, h):
    """Place and velocity at the end of the path, across the slab too."""
    e, p1, p2 = _decay(-path[at.RATE] * h)
    a, b = h * p1, h * h * p2
    return (
        path[at.START_X] + a * path[at.START_VX] + b * path[at.N0X],
        path[at.START_Y] + a * path[at.START_VY] + b * path[at.N0Y],
        e * path[at.START_VX] + a * path[at.N0X],
        e * path[at.START_VY] + a * path[at.N0Y],
        extra[of.Z] + a * extra[of.VZ] + b * extra[of.PULL_Z],
        e * extra[of.VZ] + a * extra[of.PULL_Z],
    )


@called
def _leave(state, ints, extra, air, walls, rules, clock):
    """End the track where its straight way crosses the mesh's edge, on the line that lies there."""
    g, tri = air.geometry, ints[at.TRI]
    x, y = state[at.X] - clock[of.OUT_X], state[at.Y] - clock[of.OUT_Y]
    worst, edge = math.inf, -1
    for k in range(3):  # the boundary edge that is farthest beyond
        if air.neighbours[tri, k] == -1:
            q = barycentric(g, tri, k, x, y)
            if q < worst:
                worst, edge = q, k
    edge = max(edge, 0)
    rate = g[tri, at.B0X + 2 * edge] * state[at.VX] + g[tri, at.B0Y + 2 * edge] * state[at.VY]
    s = -worst / rate if rate < 0.0 else 0.0
    most = clock[of.UNTIL] - clock[of.NOW]
    s = min(most, max(-most, s))
    state[at.X] += s * state[at.VX]
    state[at.Y] += s * state[at.VY]
    extra[of.Z] += s * extra[of.VZ]
    state[at.T] += s
    leave(state, ints, walls, rules)


@compiled
def _alone(state, extra, grain, walls, rules, end):
    """Whether no wall and no line can be met on the way to ``end``."""
    dx, dy = end[0] - state[at.X], end[1] - state[at.Y]
    way = SPARE * math.sqrt(dx * dx + dy * dy) + rules.skin
    if extra[of.ROOM] < way:
        extra[of.ROOM] = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], rules.length)
    if extra[of.ROOM] < way:
        return False
    extra[of.ROOM] -= way
    return True


@compiled
def _slide(state, ints, extra, grain, walls, rules, path, hold, h):
    """The wall's impulse on a granule just moved freely over a step h that it began on that wall, and whether it is
    held there.
    """
    body = ints[at.BODY]
    rate = path[at.RATE]
    pull = math.hypot(path[at.N0X] - rate * path[at.START_VX], path[at.N0Y] - rate * path[at.START_VY])
    if not press(state, ints, extra, grain, walls, rules, hold, h, pull):
        ints[at.CONTACT] = at.FREE
    elif ints[at.FATE] == at.FLYING:
        wx, wy, _, _, _ = wall_motion(walls.bodies, body, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
        rx, ry = state[at.VX] - wx, state[at.VY] - wy
        if math.sqrt(rx * rx + ry * ry + extra[of.VZ] * extra[of.VZ]) <= STILL:
            extra[of.TOUCHED] = of.HELD_BY_WALL


@compiled
def _by_walls(state, ints, extra, tally, grain, walls, rules, clock, path, hold, end, h, last):
    """The piece of path h past walls and lines: moves to the first that is met, or to its end."""
    t0 = state[at.T]
    s, kind, which = h, at.FREE, at.NOBODY
    if ints[at.CONTACT] == at.FREE and not last:
        met, its_kind, its = first_wall(path, h, end, t0, grain[at.RADIUS], rules.skin, walls, ints)
        if met >= 0.0:
            s, kind, which = met, its_kind, its
    met, line = first_line(path, s, along(path, s), t0, walls, rules.skin)
    if met >= 0.0:
        s, kind = met, at.FREE
    x, y, vx, vy, z, vz = _glide(path, extra, s)
    _gain(state, vx, vy)
    state[at.X], state[at.Y], state[at.VX], state[at.VY], extra[of.Z], extra[of.VZ] = x, y, vx, vy, z, vz
    state[at.T] = clock[of.UNTIL] if s == h and t0 + h >= clock[of.UNTIL] else t0 + s
    if met >= 0.0:
        ints[at.FATE], ints[at.LINE] = at.BINNED, line
    elif kind != at.FREE:
        end_leg(state, extra, clock)
        hit_wall(state, ints, extra, grain, walls, rules, path, hold, h, kind, which)
        begin_leg(state, extra, tally, clock)
    elif ints[at.CONTACT] != at.FREE or last:
        _slide(state, ints, extra, grain, walls, rules, path, hold, h)


@compiled
def fly_on(state, ints, extra, tally, grain, table, air, nodes, walls, rules, clock, room):
    """Fly from the granule's time to the end of the step."""
    path, hold = room.path, room.hold
    begin_leg(state, extra, tally, clock)
    extra[of.TOUCHED] = of.LOOSE
    pieces = 0
    while ints[at.FATE] == at.FLYING and state[at.T] < clock[of.UNTIL]:
        pieces += 1
        h = clock[of.UNTIL] - state[at.T]
        last = pieces >= MAX_PIECES
        if grain[at.NOISE] != 0.0 and not last:
            if not state[at.T] < state[at.T_NOISE] - STEP_ROUNDING * clock[of.STEP]:
                stir(state, ints, grain, table, air, nodes, rules, clock)
            if state[at.T_NOISE] < clock[of.UNTIL] - STEP_ROUNDING * clock[of.STEP]:
                h = min(h, state[at.T_NOISE] - state[at.T])
        ints[at.STEPS] += 1
        if aim(state, ints, extra, grain, table, air, nodes, walls, clock, path, h) == GONE:
            _leave(state, ints, extra, air, walls, rules, clock)
            break
        x, y, vx, vy, z, vz = _glide(path, extra, h)
        if ints[at.CONTACT] == at.FREE and _alone(state, extra, grain, walls, rules, (x, y, vx, vy)):
            _gain(state, vx, vy)
            state[at.X], state[at.Y], state[at.VX], state[at.VY], extra[of.Z], extra[of.VZ] = x, y, vx, vy, z, vz
            state[at.T] = clock[of.UNTIL] if state[at.T] + h >= clock[of.UNTIL] else state[at.T] + h
        else:
            extra[of.ROOM] = 0.0
            _by_walls(state, ints, extra, tally, grain, walls, rules, clock, path, hold, (x, y, vx, vy), h, last)
        if last:
            state[at.T] = clock[of.UNTIL]
    if ints[at.FATE] == at.FLYING and ints[at.IMPACTS] >= rules.impacts:
        ints[at.FATE] = at.STOPPED
    end_leg(state, extra, clock)
