"""The flight of one granule of the crowd to the end of the step, past walls, lines and the mesh's edge."""

from __future__ import annotations

import math

from ..kernel import layout as at
from ..kernel.clearance import clearance
from ..kernel.crossings import first_line, first_wall
from ..kernel.dense_output import along
from ..kernel.events import wall_displacement
from ..kernel.jit import compiled, inlined
from ..kernel.locate import barycentric
from . import layout as of
from .air import GONE, aim, stir
from .strikes import STILL, hit_wall, press

__all__ = ["begin_leg", "end_leg", "fly_on"]

MOST_PIECES = 32  # of a step: a granule that rattles faster is pressed on
SAME = 1e-6  # of a step: round-off between the ends of steps and of intervals of noise
SPARE = 1.05  # of the straight way: a path of one step bends less
C0, C1, C2, C3, C4, C5, C6, C7 = (1.0 / math.factorial(k + 2) for k in range(8))  # of the series of phi_2
ON_LINE = 1e-9  # of the extent: round-off of a place on the mesh's boundary (as in kernel.edge_crossing)


@compiled
def begin_leg(state, own, tally, clock):
    """A piece of path begins, on which the granule can be met."""
    own[of.LEG_BEGIN] = state[at.T] - clock[of.NOW]
    own[of.LEG_X], own[of.LEG_Y], own[of.LEG_Z] = state[at.X], state[at.Y], own[of.Z]
    own[of.LEG_VX], own[of.LEG_VY], own[of.LEG_VZ] = state[at.VX], state[at.VY], own[of.VZ]
    own[of.LEG_WX], own[of.LEG_WY], own[of.LEG_WZ] = own[of.WX], own[of.WY], state[at.SPIN]
    tally[of.STAMP] += 1


@compiled
def end_leg(state, own, clock):
    """It ends where the granule is now: the parabola between."""
    own[of.LEG_END] = state[at.T] - clock[of.NOW]
    s = own[of.LEG_END] - own[of.LEG_BEGIN]
    own[of.LEG_AX] = own[of.LEG_AY] = own[of.LEG_AZ] = 0.0
    if s > 0.0:
        twice = 2.0 / (s * s)
        own[of.LEG_AX] = twice * (state[at.X] - own[of.LEG_X] - s * own[of.LEG_VX])
        own[of.LEG_AY] = twice * (state[at.Y] - own[of.LEG_Y] - s * own[of.LEG_VY])
        own[of.LEG_AZ] = twice * (own[of.Z] - own[of.LEG_Z] - s * own[of.LEG_VZ])


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


@inlined
def _glide(path, own, h):
    """Place and velocity at the end of the path, across the slab too."""
    e, p1, p2 = _decay(-path[at.RATE] * h)
    a, b = h * p1, h * h * p2
    return (
        path[at.START_X] + a * path[at.START_VX] + b * path[at.N0X],
        path[at.START_Y] + a * path[at.START_VY] + b * path[at.N0Y],
        e * path[at.START_VX] + a * path[at.N0X],
        e * path[at.START_VY] + a * path[at.N0Y],
        own[of.Z] + a * own[of.VZ],
        e * own[of.VZ],
    )


@compiled
def _leave(state, ints, own, air, walls, rules, clock):
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
    own[of.Z] += s * own[of.VZ]
    state[at.T] += s
    ints[at.FATE] = at.ESCAPED
    near = (ON_LINE + rules.allowance) * rules.extent
    for i in range(walls.lines.shape[0]):
        x0, y0 = walls.lines[i, at.FROM_X], walls.lines[i, at.FROM_Y]
        ex, ey = walls.lines[i, at.TO_X] - x0, walls.lines[i, at.TO_Y] - y0
        w = ((state[at.X] - x0) * ex + (state[at.Y] - y0) * ey) / (ex * ex + ey * ey)
        w = min(1.0, max(0.0, w))
        if math.hypot(state[at.X] - x0 - w * ex, state[at.Y] - y0 - w * ey) <= near:
            ints[at.FATE], ints[at.LINE] = at.BINNED, walls.line_ids[i]
            return


@inlined
def _alone(state, own, grain, walls, rules, end):
    """Whether no wall and no line can be met on the way to ``end``."""
    dx, dy = end[0] - state[at.X], end[1] - state[at.Y]
    way = SPARE * math.sqrt(dx * dx + dy * dy) + rules.skin
    if own[of.ROOM] < way:
        own[of.ROOM] = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], rules.length)
    if own[of.ROOM] < way:
        return False
    own[of.ROOM] -= way
    return True


@compiled
def _slide(state, ints, own, grain, walls, rules, path, hold, h):
    """For a granule just moved freely over a step h that it began on a wall: the wall's impulse, and whether it is held
    there.
    """
    body = ints[at.BODY]
    rate = path[at.RATE]
    pull = math.hypot(path[at.N0X] - rate * path[at.START_VX], path[at.N0Y] - rate * path[at.START_VY])
    if not press(state, ints, own, grain, walls, rules, hold, h, pull):
        ints[at.CONTACT] = at.FREE
    elif ints[at.FATE] == at.FLYING:
        _, _, wx, wy, _, _ = wall_displacement(walls.bodies, body, state[at.T])
        rx, ry = state[at.VX] - wx, state[at.VY] - wy
        if math.sqrt(rx * rx + ry * ry + own[of.VZ] * own[of.VZ]) <= STILL:
            own[of.TOUCHED] = of.HELD_BY_WALL


@compiled
def _by_walls(state, ints, own, tally, grain, walls, rules, clock, path, hold, end, h, last):
    """The piece of path h past walls and lines: moves to the first that is met, or to its end."""
    t0 = state[at.T]
    s, kind, which = h, at.FREE, at.NOBODY
    if ints[at.CONTACT] == at.FREE and not last:
        found, its_kind, its = first_wall(path, h, end, t0, grain[at.RADIUS], rules.skin, walls, ints)
        if found >= 0.0:
            s, kind, which = found, its_kind, its
    found, line = first_line(path, s, along(path, s), t0, walls, rules.skin)
    if found >= 0.0:
        s, kind = found, at.FREE
    x, y, vx, vy, z, vz = _glide(path, own, s)
    state[at.X], state[at.Y], state[at.VX], state[at.VY], own[of.Z], own[of.VZ] = x, y, vx, vy, z, vz
    state[at.T] = clock[of.UNTIL] if s == h and t0 + h >= clock[of.UNTIL] else t0 + s
    if found >= 0.0:
        ints[at.FATE], ints[at.LINE] = at.BINNED, line
    elif kind != at.FREE:
        end_leg(state, own, clock)
        hit_wall(state, ints, own, grain, walls, rules, path, hold, h, kind, which)
        begin_leg(state, own, tally, clock)
    elif ints[at.CONTACT] != at.FREE or last:
        _slide(state, ints, own, grain, walls, rules, path, hold, h)


@inlined
def fly_on(state, ints, own, tally, grain, table, air, nodes, walls, rules, clock, room):
    """Fly from the granule's time to the end of the step."""
    path, hold = room.path, room.hold
    begin_leg(state, own, tally, clock)
    own[of.TOUCHED] = of.LOOSE
    pieces = 0
    while ints[at.FATE] == at.FLYING and state[at.T] < clock[of.UNTIL]:
        pieces += 1
        h = clock[of.UNTIL] - state[at.T]
        last = pieces >= MOST_PIECES
        if grain[at.NOISE] != 0.0 and not last:
            if not state[at.T] < state[at.T_NOISE] - SAME * clock[of.STEP]:
                stir(state, ints, grain, table, air, nodes, rules, clock)
            if state[at.T_NOISE] < clock[of.UNTIL] - SAME * clock[of.STEP]:
                h = min(h, state[at.T_NOISE] - state[at.T])
        ints[at.STEPS] += 1
        if aim(state, ints, own, grain, table, air, nodes, walls, clock, path, h) == GONE:
            _leave(state, ints, own, air, walls, rules, clock)
            break
        x, y, vx, vy, z, vz = _glide(path, own, h)
        if ints[at.CONTACT] == at.FREE and _alone(state, own, grain, walls, rules, (x, y, vx, vy)):
            state[at.X], state[at.Y], state[at.VX], state[at.VY], own[of.Z], own[of.VZ] = x, y, vx, vy, z, vz
            state[at.T] = clock[of.UNTIL] if state[at.T] + h >= clock[of.UNTIL] else state[at.T] + h
        else:
            own[of.ROOM] = 0.0
            _by_walls(state, ints, own, tally, grain, walls, rules, clock, path, hold, (x, y, vx, vy), h, last)
        if last:
            state[at.T] = clock[of.UNTIL]
    if ints[at.FATE] == at.FLYING and ints[at.IMPACTS] >= rules.impacts:
        ints[at.FATE] = at.STOPPED
    end_leg(state, own, clock)
