"""The force at a point straight from the nodes of its triangle, nothing loaded before: what multi-cell steps look at.

The interpolant is that of ``air.load_triangle`` and ``air.air_at``. Those are cheaper where a triangle is looked at
several times, this where it is looked at once or twice.

A step makes N = F + B v a parabola in w = time / step, right at w = 0, 1/2 and 1. What N differs from it by at 1/4 and
3/4, o and m, has an even part, whose mean displaces most, and an odd one, of which only the first moment is left.
"""

from __future__ import annotations

import math

from . import layout as at
from .air import mesh_velocity, shares
from .dense_output import phis
from .forces import drag_rate
from .jit import compiled, inlined

# -- The force at a point straight from the nodes of its triangle, nothing loaded before -------------------------------
STIFF = 0.2  # of the drag rate times a time: a velocity relaxes by a fifth within it, which stages must not step over


@compiled
def _in_splines(values, smooth, c0, c1, c2, q0, q1, q2, t, pressed, stirred):
    """Velocity, pressure gradient, deviation at point q of the triangle of nodes c, in a field of splines in time."""
    w = (t - smooth[at.KNOT_FIRST]) * smooth[at.KNOT_RATE]
    n = math.floor(w)
    j = int(n - math.floor(n / smooth[at.KNOT_COUNT]) * smooth[at.KNOT_COUNT])
    s = shares(w - n)
    ux = uy = px = py = rms = 0.0
    for i in range(4):
        a, b, c, k = s[i] * q0, s[i] * q1, s[i] * q2, j + i
        ux += a * values[c0, k, at.NODE_U] + b * values[c1, k, at.NODE_U] + c * values[c2, k, at.NODE_U]
        uy += a * values[c0, k, at.NODE_V] + b * values[c1, k, at.NODE_V] + c * values[c2, k, at.NODE_V]
        if pressed:
            px += a * values[c0, k, at.NODE_PX] + b * values[c1, k, at.NODE_PX] + c * values[c2, k, at.NODE_PX]
            py += a * values[c0, k, at.NODE_PY] + b * values[c1, k, at.NODE_PY] + c * values[c2, k, at.NODE_PY]
        if stirred:
            rms += a * values[c0, k, at.NODE_RMS] + b * values[c1, k, at.NODE_RMS] + c * values[c2, k, at.NODE_RMS]
    return ux, uy, px, py, rms


@compiled
def _in_snapshot(values, a, c0, c1, c2, q0, q1, q2, pressed, stirred):
    """The same in snapshot ``a``."""
    ux = q0 * values[a, c0, at.NODE_U] + q1 * values[a, c1, at.NODE_U] + q2 * values[a, c2, at.NODE_U]
    uy = q0 * values[a, c0, at.NODE_V] + q1 * values[a, c1, at.NODE_V] + q2 * values[a, c2, at.NODE_V]
    px = py = rms = 0.0
    if pressed:
        px = q0 * values[a, c0, at.NODE_PX] + q1 * values[a, c1, at.NODE_PX] + q2 * values[a, c2, at.NODE_PX]
        py = q0 * values[a, c0, at.NODE_PY] + q1 * values[a, c1, at.NODE_PY] + q2 * values[a, c2, at.NODE_PY]
    if stirred:
        rms = q0 * values[a, c0, at.NODE_RMS] + q1 * values[a, c1, at.NODE_RMS] + q2 * values[a, c2, at.NODE_RMS]
    return ux, uy, px, py, rms


@inlined
def _interpolated(ints, affine, air, grain, tri, x, y, t):
    """Velocity, pressure gradient, deviation of the mean air at a point of triangle ``tri`` and a time."""
    g, values = air.geometry, air.values
    dx, dy = x - g[tri, at.CORNER_X], y - g[tri, at.CORNER_Y]
    q1 = g[tri, at.B1X] * dx + g[tri, at.B1Y] * dy
    q2 = g[tri, at.B2X] * dx + g[tri, at.B2Y] * dy
    q0 = 1.0 - q1 - q2
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    pressed, stirred = grain[at.PRESSURE] != 0.0, grain[at.DISPERSION] != 0.0
    if air.smooth[at.KNOT_RATE] != 0.0:
        return _in_splines(values, air.smooth, c0, c1, c2, q0, q1, q2, t, pressed, stirred)
    a, b = ints[at.SNAP_A], ints[at.SNAP_B]
    ux, uy, px, py, rms = _in_snapshot(values, a, c0, c1, c2, q0, q1, q2, pressed, stirred)
    if a != b:
        w = (t - affine[at.T_BEGIN]) * affine[at.PER_DT]
        ex, ey, fx, fy, other = _in_snapshot(values, b, c0, c1, c2, q0, q1, q2, pressed, stirred)
        ux, uy = ux + w * (ex - ux), uy + w * (ey - uy)
        px, py, rms = px + w * (fx - px), py + w * (fy - py), rms + w * (other - rms)
    return ux, uy, px, py, rms


@inlined
def excess(state, ints, affine, air, grain, table, tri, x, y, vx, vy, t, rate0, mx, my, gain):
    """N = F + B0 v and the drag rate at a point of a triangle, straight from its corners; and v.

    The velocity was made with a foretold N of (mx, my), whose excess ``gain`` (s) times is missing from it: in stiff
    flight it must not pass for slip.
    """
    ints[at.EVALUATIONS] += 1
    ux, uy, px, py, rms = _interpolated(ints, affine, air, grain, tri, x, y, t)
    if grain[at.NOISE] != 0.0:
        ux += rms * state[at.MEAN_X] + state[at.KICK_X]
        uy += rms * state[at.MEAN_Y] + state[at.KICK_Y]
    px, py = grain[at.PRESSURE] * px + grain[at.GX], grain[at.PRESSURE] * py + grain[at.GY]
    if air.swing[at.SWING_OMEGA] != 0.0:  # v is seen from the mesh, N the lab's
        wx, wy, _, _ = mesh_velocity(air.swing, at.SWING_X, t)
        ux, uy, px, py = ux - wx, uy - wy, px + rate0 * wx, py + rate0 * wy
    nx = ny = rate = 0.0
    for again in range(2):
        sx, sy = ux - vx, uy - vy
        rate = drag_rate(grain, table, sx * sx + sy * sy)
        nx, ny = rate * sx + px + rate0 * vx, rate * sy + py + rate0 * vy
        if again == 1 or rate0 * gain < STIFF:
            break
        vx += gain * (nx - mx)
        vy += gain * (ny - my)
    return nx, ny, rate, vx, vy


# -- What a force that is not a parabola in time displaces -------------------------------------------------------------
BOOLE = 32.0 / 90.0  # Boole's rule: mean of a quartic that is zero at 0, 1/2 and 1 over its sum at 1/4 and 3/4
# First moment of a cubic with these zeros over its difference between 1/4 and 3/4 is 4/45; twice, rounded up: what it
# displaces in the step, and as much again by the velocity that drag's weighting of it leaves
ODD = 0.18


@compiled
def carried(rate, h, horizon):
    """Displacement over h (s) by a constant error of the force: within the step h, and after it by the velocity that it
    leaves, which lasts min(1 / B, horizon).
    """
    _, p1, p2, _, _ = phis(-rate * h)
    return h * p2 + p1 * min(1.0 / rate, horizon)


@compiled
def displaced(ox, oy, mx, my, carry, rate, h):
    """Displacement per time (m/s) by defects o at 1/4 and m at 3/4 of a step h; ``carry`` see ``carried``."""
    even = math.sqrt((ox + mx) ** 2 + (oy + my) ** 2)
    odd = math.sqrt((ox - mx) ** 2 + (oy - my) ** 2)
    return BOOLE * carry * even + ODD * h / (1.0 + rate * h) * odd
