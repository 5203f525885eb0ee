"""The air on the crowd's one clock: nodal values at the middle of the step, and the force on a granule from them.

All granules share their clock, so that a field that changes in time is brought to the middle of a step once for all of
them; a granule then reads three nodes. The formulas are the tracker's (``kernel.forces``), and granules fly in the lab:
a mesh that swings is looked up where it stands.
"""

from __future__ import annotations

from ..kernel import layout as at
from ..kernel.air import bracket, nodal
from ..kernel.events import harmonic
from ..kernel.forces import drag_rate, gradient_forces, spin_at
from ..kernel.jit import compiled, inlined
from ..kernel.locate import reproject, walk
from ..kernel.walls import inside
from . import layout as of

__all__ = ["GONE", "aim", "mesh_at", "refresh"]

GONE = -1  # what ``aim`` returns for a granule that has left the mesh


@compiled
def mesh_at(swing, t):
    """Displacement and velocity of a mesh that swings; zeros at rest."""
    if swing[at.SWING_OMEGA] == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    x, y, vx, vy, _, _ = harmonic(swing[at.SWING_X], swing[at.SWING_Y], swing[at.SWING_OMEGA], swing[at.SWING_PHASE], t)
    return x, y, vx, vy


@compiled
def refresh(air, now, rates, clock, room, timed):
    """Bring the nodal values to the middle of the step, and the mesh to where it then is; the rate of the velocity
    where ``rates`` has room for it.
    """
    middle = 0.5 * (clock[of.NOW] + clock[of.UNTIL])
    clock[of.OUT_X], clock[of.OUT_Y], _, _ = mesh_at(air.swing, middle)
    if not timed:
        return
    state, ints = room.air_state, room.air_ints
    for look in range(2 if rates.shape[0] > 0 else 1):
        # the rate first, as a difference over the second half of the step; then the values that stay
        later = look == 0 and rates.shape[0] > 0
        state[at.T] = clock[of.UNTIL] if later else middle
        bracket(state, ints, room.affine, air)
        w = (state[at.T] - room.affine[at.T_BEGIN]) * room.affine[at.PER_DT]
        for c in range(now.shape[0]):
            for m in range(now.shape[1]):
                now[c, m] = nodal(air, ints, w, c, m)
            if rates.shape[0] > 0:
                for m in range(2):
                    rates[c, m] = now[c, m] if later else (rates[c, m] - now[c, m]) / (clock[of.UNTIL] - middle)


@compiled
def _beside(state, ints, air, walls, out_x, out_y, code):
    """For a granule that the walk found beyond a covered edge: the nearest such edge, or back into the mesh round a
    corner of the body.
    """
    ints[at.GAP] = -2 - code
    buried = False
    for body in range(walls.bodies.shape[0]):
        buried = buried or inside(walls, body, state[at.X] - out_x, state[at.Y] - out_y)[0]
    state[at.X] -= out_x
    state[at.Y] -= out_y
    reproject(state, ints, air, buried)
    state[at.X] += out_x
    state[at.Y] += out_y


@compiled
def _gradients(affine, air, now, rates, tri, q0, q1, q2, x, y, t):
    """Load the gradient of the velocity, and its rate at the granule, for the forces made of them."""
    g = air.geometry
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    affine[at.CUBIC] = 0.0
    affine[at.T_BEGIN], affine[at.PER_DT] = t, 0.0
    affine[at.ORIGIN_X], affine[at.ORIGIN_Y] = x, y
    for m in range(2):
        first = at.U0 + at.PER_QUANTITY * m
        f0, f1, f2 = now[c0, m], now[c1, m], now[c2, m]
        affine[first + at.DX] = f0 * g[tri, at.B0X] + f1 * g[tri, at.B1X] + f2 * g[tri, at.B2X]
        affine[first + at.DY] = f0 * g[tri, at.B0Y] + f1 * g[tri, at.B1Y] + f2 * g[tri, at.B2Y]
        if rates.shape[0] > 0:
            affine[at.PER_DT] = 1.0
            first += at.PER_POWER
            affine[first] = q0 * rates[c0, m] + q1 * rates[c1, m] + q2 * rates[c2, m]
            affine[first + at.DX] = affine[first + at.DY] = 0.0


@inlined
def _mix(now, c0, c1, c2, q0, q1, q2, m):
    return q0 * now[c0, m] + q1 * now[c1, m] + q2 * now[c2, m]


@inlined
def _place(state, ints, air, walls, clock, half):
    """The triangle of the granule's place half a step on, and barycentric coordinates there; beyond a covered edge the
    nearest point of it. The first is ``GONE`` outside the mesh.
    """
    out_x, out_y = clock[of.OUT_X], clock[of.OUT_Y]
    x, y = state[at.X] + half * state[at.VX] - out_x, state[at.Y] + half * state[at.VY] - out_y
    tri, code = walk(air.geometry, air.neighbours, ints[at.TRI], x, y)
    ints[at.TRI], ints[at.GAP] = tri, -1
    if code == -1:
        return GONE, 0.0, 0.0, 0.0
    if code < 0:
        _beside(state, ints, air, walls, out_x, out_y, code)
        tri = ints[at.TRI]
    g = air.geometry
    dx, dy = x - g[tri, at.CORNER_X], y - g[tri, at.CORNER_Y]
    q1 = g[tri, at.B1X] * dx + g[tri, at.B1Y] * dy
    q2 = g[tri, at.B2X] * dx + g[tri, at.B2Y] * dy
    q0 = 1.0 - q1 - q2
    if code < 0:
        q0, q1, q2 = max(q0, 0.0), max(q1, 0.0), max(q2, 0.0)
        whole = q0 + q1 + q2
        q0, q1, q2 = q0 / whole, q1 / whole, q2 / whole
    return tri, q0, q1, q2


@inlined
def aim(state, ints, own, grain, table, air, now, rates, walls, clock, path, affine, h):
    """Fill in the path of a step h with the force at its middle; returns ``GONE`` for a granule outside the mesh.

    The exponential midpoint rule: the air half way, the drag rate at the slip half way, both kept over the step, which
    integrates exactly (``kernel.dense_output``). Second order; exact where neither changes.
    """
    x, y, vx, vy, vz = state[at.X], state[at.Y], state[at.VX], state[at.VY], own[of.VZ]
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
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    ux, uy = _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_U), _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_V)
    if grain[at.PRESSURE] != 0.0:
        ax += grain[at.PRESSURE] * _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_PX)
        ay += grain[at.PRESSURE] * _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_PY)
    if grain[at.NOISE] != 0.0:
        rms = _mix(now, c0, c1, c2, q0, q1, q2, at.NODE_RMS) if grain[at.DISPERSION] != 0.0 else 0.0
        ux += rms * state[at.MEAN_X] + state[at.KICK_X]
        uy += rms * state[at.MEAN_Y] + state[at.KICK_Y]
    sx, sy = ux - vx, uy - vy
    shrink = 1.0 / (1.0 + half * drag_rate(grain, table, sx * sx + sy * sy + vz * vz))
    sx, sy, sz = (sx - half * ax) * shrink, (sy - half * ay) * shrink, vz * shrink
    rate = drag_rate(grain, table, sx * sx + sy * sy + sz * sz)
    if grain[at.EXTRA] != 0.0:
        t = state[at.T] + half
        _gradients(affine, air, now, rates, tri, q0, q1, q2, x, y, t)
        if grain[at.MAGNUS] != 0.0:
            state[at.SPIN] = spin_at(affine, grain, state[at.SPIN], t, h)
        ex, ey = gradient_forces(affine, grain, x, y, t, ux, uy, sx, sy, state[at.SPIN])
        ax, ay = ax + ex, ay + ey
    path[at.RATE], path[at.N0X], path[at.N0Y] = rate, ax + rate * ux, ay + rate * uy
    return 0
