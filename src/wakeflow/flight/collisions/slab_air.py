"""The air on the common clock: nodal values at the middle of the step, and the force on a granule from them.

All granules share their clock, so that a field that changes in time is brought to the middle of a step once for all of
them, node by node where a granule reads it; a granule then reads three nodes. The formulas are the tracker's
(``kernel.air``), and granules fly in the lab: a mesh that swings is looked up where it stands.
"""

from __future__ import annotations

import math

from ..kernel import layout as at
from ..kernel.air import bracket, drag_rate, forces_in_gradient, shares, spin_in_curl
from ..kernel.dispersion import renew_in
from ..kernel.events import harmonic
from ..kernel.history import CHATTERS, RATES
from ..kernel.jit import called, compiled
from ..kernel.locate import INSIDE, reproject, walk
from . import slab_layout as of

GONE = -1  # what ``aim`` returns for a granule that has left the mesh


@called
def refresh(air, nodes, clock, room, timed):
    """Bring the mesh, and the weights of what is about it in time, to the middle of the step."""
    middle = 0.5 * (clock[of.NOW] + clock[of.UNTIL])
    out, _, _ = harmonic(air.swing[at.SWING_OMEGA], air.swing[at.SWING_PHASE], middle)
    clock[of.OUT_X], clock[of.OUT_Y] = air.swing[at.SWING_X] * out, air.swing[at.SWING_Y] * out
    if not timed:
        return
    state, ints, weights = room.air_state, room.air_ints, nodes.weights
    state[at.T] = middle
    bracket(state, ints, room.affine, air)
    per = room.affine[at.PER_DT]
    w = (middle - room.affine[at.T_BEGIN]) * per
    nodes.when[of.THIS_STEP] += 1
    nodes.when[of.BEFORE], nodes.when[of.AFTER] = ints[at.SNAP_A], ints[at.SNAP_B]
    if air.smooth[at.KNOT_RATE] == 0.0:
        weights[0], weights[1] = 1.0 - w, w
        weights[of.RATES], weights[of.RATES + 1] = -per, per
        return
    weights[0], weights[1], weights[2], weights[3] = shares(w)
    v = 1.0 - w
    weights[of.RATES], weights[of.RATES + 1] = -0.5 * per * v * v, 0.5 * per * w * (3.0 * w - 4.0)
    weights[of.RATES + 2], weights[of.RATES + 3] = -0.5 * per * v * (3.0 * v - 4.0), 0.5 * per * w * w


@compiled
def _bring(air, nodes, c):
    """Bring node c to the middle of the step."""
    v, now, rates, s = air.values, nodes.now, nodes.rates, nodes.weights
    a, b = nodes.when[of.BEFORE], nodes.when[of.AFTER]
    nodes.looked[c] = nodes.when[of.THIS_STEP]
    smooth = air.smooth[at.KNOT_RATE] != 0.0
    for m in range(now.shape[1]):
        if smooth:
            now[c, m] = s[0] * v[c, a, m] + s[1] * v[c, a + 1, m] + s[2] * v[c, a + 2, m] + s[3] * v[c, a + 3, m]
        else:
            now[c, m] = s[0] * v[a, c, m] + s[1] * v[b, c, m]
    if rates.shape[0] == 0:
        return
    r = of.RATES
    for m in range(2):
        if smooth:
            rates[c, m] = (
                s[r] * v[c, a, m] + s[r + 1] * v[c, a + 1, m] + s[r + 2] * v[c, a + 2, m] + s[r + 3] * v[c, a + 3, m]
            )
        else:
            rates[c, m] = s[r] * v[a, c, m] + s[r + 1] * v[b, c, m]


@compiled
def _corners(air, nodes, tri):
    """The nodes of a triangle, brought to the middle of the step."""
    for k in range(3):
        c = air.corners[tri, k]
        if nodes.looked[c] != nodes.when[of.THIS_STEP]:
            _bring(air, nodes, c)
    return air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]


@called
def _beside(state, ints, air, walls, out_x, out_y, code):
    """Move a granule that the walk found beyond a covered edge on to the nearest such edge, or back into the mesh round
    a corner of the body.
    """
    ints[at.GAP] = -2 - code
    state[at.X] -= out_x
    state[at.Y] -= out_y
    reproject(state, ints, air, walls)
    state[at.X] += out_x
    state[at.Y] += out_y


@compiled
def _extra(state, grain, air, nodes, tri, q0, q1, q2, ux, uy, sx, sy, h):
    """Acceleration by the forces made of the air's gradients; turns the granule's spin."""
    g = air.geometry
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    u0, u1, u2 = nodes.now[c0, at.NODE_U], nodes.now[c1, at.NODE_U], nodes.now[c2, at.NODE_U]
    v0, v1, v2 = nodes.now[c0, at.NODE_V], nodes.now[c1, at.NODE_V], nodes.now[c2, at.NODE_V]
    xx = u0 * g[tri, at.B0X] + u1 * g[tri, at.B1X] + u2 * g[tri, at.B2X]
    xy = u0 * g[tri, at.B0Y] + u1 * g[tri, at.B1Y] + u2 * g[tri, at.B2Y]
    yx = v0 * g[tri, at.B0X] + v1 * g[tri, at.B1X] + v2 * g[tri, at.B2X]
    yy = v0 * g[tri, at.B0Y] + v1 * g[tri, at.B1Y] + v2 * g[tri, at.B2Y]
    tx = ty = 0.0
    if nodes.rates.shape[0] > 0:
        tx, ty = _mix(nodes.rates, c0, c1, c2, q0, q1, q2, 0), _mix(nodes.rates, c0, c1, c2, q0, q1, q2, 1)
    if grain[at.MAGNUS] != 0.0:
        state[at.SPIN] = spin_in_curl(grain, state[at.SPIN], yx - xy, h)
    return forces_in_gradient(grain, xx, xy, yx, yy, tx, ty, ux, uy, sx, sy, state[at.SPIN])


@compiled
def _mix(now, c0, c1, c2, q0, q1, q2, m):
    return q0 * now[c0, m] + q1 * now[c1, m] + q2 * now[c2, m]


@compiled
def _shares(g, tri, x, y):
    """Barycentric coordinates of a point in a triangle."""
    dx, dy = x - g[tri, at.CORNER_X], y - g[tri, at.CORNER_Y]
    q1 = g[tri, at.B1X] * dx + g[tri, at.B1Y] * dy
    q2 = g[tri, at.B2X] * dx + g[tri, at.B2Y] * dy
    return 1.0 - q1 - q2, q1, q2


@compiled
def _place(state, ints, air, walls, clock, half):
    """The triangle of the granule's place half a step on, and barycentric coordinates there; beyond a covered edge the
    nearest point of it. The first is ``GONE`` outside the mesh.
    """
    out_x, out_y = clock[of.OUT_X], clock[of.OUT_Y]
    x, y = state[at.X] + half * state[at.VX] - out_x, state[at.Y] + half * state[at.VY] - out_y
    tri = ints[at.TRI]
    ints[at.GAP] = -1
    q0, q1, q2 = _shares(air.geometry, tri, x, y)
    if min(q0, q1, q2) >= INSIDE:  # as most are: a step is shorter than a triangle
        return tri, q0, q1, q2
    tri, code = walk(air.geometry, air.neighbours, tri, x, y)
    ints[at.TRI] = tri
    if code == -1:
        return GONE, 0.0, 0.0, 0.0
    if code < 0:
        _beside(state, ints, air, walls, out_x, out_y, code)
        tri = ints[at.TRI]
    q0, q1, q2 = _shares(air.geometry, tri, x, y)
    if code < 0:
        q0, q1, q2 = max(q0, 0.0), max(q1, 0.0), max(q2, 0.0)
        whole = q0 + q1 + q2
        q0, q1, q2 = q0 / whole, q1 / whole, q2 / whole
    return tri, q0, q1, q2


@compiled
def stir(state, ints, grain, table, air, nodes, rules, clock):
    """Begin an interval of noise, which is the tracker's, in the air of this step; it ends with a step of the clock."""
    g, tri = air.geometry, max(ints[at.TRI], 0)
    c0, c1, c2 = _corners(air, nodes, tri)
    now = nodes.now
    wind = max(abs(now[c0, at.NODE_U]), abs(now[c0, at.NODE_V]))
    seen = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if grain[at.DISPERSION] != 0.0:
        q0, q1, q2 = _shares(g, tri, state[at.X] - clock[of.OUT_X], state[at.Y] - clock[of.OUT_Y])
        q0, q1, q2 = min(1.0, max(0.0, q0)), min(1.0, max(0.0, q1)), min(1.0, max(0.0, q2))
        r0, r1, r2 = now[c0, at.NODE_RMS], now[c1, at.NODE_RMS], now[c2, at.NODE_RMS]
        seen = (
            _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_U),
            _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_V),
            _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_LIFE),
            q0 * r0 + q1 * r1 + q2 * r2,
            r0 * g[tri, at.B0X] + r1 * g[tri, at.B1X] + r2 * g[tri, at.B2X],
            r0 * g[tri, at.B0Y] + r1 * g[tri, at.B1Y] + r2 * g[tri, at.B2Y],
            q0 * air.even[c0] + q1 * air.even[c1] + q2 * air.even[c2],
        )
    renew_in(state, ints, grain, table, rules, wind, seen, clock[of.UNTIL] - state[at.T], clock[of.STEP])


# -- The history force -------------------------------------------------------------------------------------------------
# The memories are the tracker's (kernel.history), a step at a time. Over a piece h of the path they follow the slip s
# of its middle, as if that would last. The mean force per mass over the piece is then
#
#     sum of w_i phi_1(-h / tau_i) (s - l_i) = R s - L
#
# whose first part acts as drag does, so that a step may be longer than the time of a memory. Second order, as the step.
# The memories stay where the piece begins, beside the slip that they are to follow, until the next one begins: a
# meeting may cut the piece anywhere.
@compiled
def _advance(state, ints, extra, grain, ux, uy, sx, sy):
    """Bring the memories to the granule's time, which the slip of the piece before has lasted until.

    At first all memories know the slip that it came with; one that has struck more than CHATTERS times has no past.
    """
    chatters = ints[at.IMPACTS] > CHATTERS
    if chatters or ints[at.STEPS] == 1:
        lag_x, lag_y = (sx, sy) if chatters else (ux - state[at.LAG], uy - state[at.LAG + 1])
        for i in range(at.MEMORIES):
            state[at.LAG + 2 * i], state[at.LAG + 2 * i + 1] = lag_x, lag_y
            extra[of.LAG_Z + i] = -extra[of.VZ]
        return
    lasted = max(0.0, state[at.T] - extra[of.SINCE])
    for i in range(at.MEMORIES):
        follows = -math.expm1(-RATES[i] * grain[at.FORGET] * lasted)
        state[at.LAG + 2 * i] += follows * (extra[of.SLIP_X] - state[at.LAG + 2 * i])
        state[at.LAG + 2 * i + 1] += follows * (extra[of.SLIP_Y] - state[at.LAG + 2 * i + 1])
        extra[of.LAG_Z + i] += follows * (extra[of.SLIP_Z] - extra[of.LAG_Z + i])


@called
def recalled(state, ints, extra, grain, ux, uy, sx, sy, h):
    """R (1/s) and the three components of L (m/s2) over a piece h that begins with the slip (sx, sy) in air (ux, uy);
    none in contact with a wall, where no theory holds.
    """
    _advance(state, ints, extra, grain, ux, uy, sx, sy)
    rate = lx = ly = lz = 0.0
    if ints[at.CONTACT] != at.FREE:
        return rate, lx, ly, lz
    for i in range(at.MEMORIES):
        z = -RATES[i] * grain[at.FORGET] * h
        weight = grain[at.RECALL_0 + i] * math.expm1(z) / z
        rate += weight
        lx += weight * state[at.LAG + 2 * i]
        ly += weight * state[at.LAG + 2 * i + 1]
        lz += weight * extra[of.LAG_Z + i]
    return rate, lx, ly, lz


@called
def remember(state, extra, sx, sy, sz):
    """Note the slip that lasts from now on."""
    extra[of.SINCE], extra[of.SLIP_X], extra[of.SLIP_Y], extra[of.SLIP_Z] = state[at.T], sx, sy, sz


# -- The force of a step -----------------------------------------------------------------------------------------------
@compiled
def aim(state, ints, extra, grain, table, air, nodes, walls, clock, path, h):
    """Fill in the path of a step h with the force at its middle; returns ``GONE`` for a granule outside the mesh.

    The exponential midpoint rule: the air half way, the drag rate at the slip half way, both kept over the step, which
    integrates exactly (``kernel.dense_output``). Second order; exact where neither changes. The slip half way needs a
    drag rate to first order only: that of the piece before.
    """
    x, y, vx, vy, vz = state[at.X], state[at.Y], state[at.VX], state[at.VY], extra[of.VZ]
    path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY] = x, y, vx, vy
    ax, ay = grain[at.GX], grain[at.GY]
    ints[at.EVALUATIONS] += 1
    if air.corners.shape[0] == 0:
        path[at.RATE], path[at.N0X], path[at.N0Y] = 0.0, ax, ay
        return 0
    half = 0.5 * h
    tri, q0, q1, q2 = _place(state, ints, air, walls, clock, half)
    if tri == GONE:
        return GONE
    c0, c1, c2 = _corners(air, nodes, tri)
    now = nodes.now
    ux, uy = _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_U), _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_V)
    if grain[at.PRESSURE] != 0.0:
        ax += grain[at.PRESSURE] * _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_PX)
        ay += grain[at.PRESSURE] * _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_PY)
    if grain[at.NOISE] != 0.0:
        rms = _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_RMS) if grain[at.DISPERSION] != 0.0 else 0.0
        ux += rms * state[at.MEAN_X] + state[at.KICK_X]
        uy += rms * state[at.MEAN_Y] + state[at.KICK_Y]
    sx, sy = ux - vx, uy - vy
    before = extra[of.DRAG] if extra[of.DRAG] > 0.0 else drag_rate(grain, table, sx * sx + sy * sy + vz * vz)
    past = pull_z = 0.0
    if grain[at.FORGET] != 0.0:
        past, lx, ly, lz = recalled(state, ints, extra, grain, ux, uy, sx, sy, h)
        ax, ay, pull_z = ax - lx, ay - ly, -lz
    shrink = 1.0 / (1.0 + half * (before + past))
    sx, sy, sz = (sx - half * ax) * shrink, (sy - half * ay) * shrink, -(vz + half * pull_z) * shrink
    rate = drag_rate(grain, table, sx * sx + sy * sy + sz * sz)
    if grain[at.FORGET] != 0.0:
        remember(state, extra, sx, sy, sz)
    if grain[at.EXTRA] != 0.0:
        ex, ey = _extra(state, grain, air, nodes, tri, q0, q1, q2, ux, uy, sx, sy, h)
        ax, ay = ax + ex, ay + ey
    extra[of.DRAG], extra[of.PULL_Z] = rate, pull_z
    rate += past
    path[at.RATE], path[at.N0X], path[at.N0Y] = rate, ax + rate * ux, ay + rate * uy
    return 0
