"""The force at a point straight from the nodes of its triangle, nothing loaded before: what strides look at.

The interpolant is that of ``air.load_triangle`` and ``air.air_at``. Those are cheaper where a triangle is looked at
several times, this where it is looked at once or twice.

A step makes N = F + B v a parabola in w = time / step, right at w = 0, 1/2 and 1. What N differs from it by at 1/4 and
3/4, o and m, has an even part, whose mean displaces most, and an odd one, of which only the first moment is left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from . import layout as at
from .air import drag_rate, forces_in_gradient, mesh_velocity, share_rates, shares, spin_in_curl
from .jit import compiled

# -- The force at a point straight from the nodes of its triangle, nothing loaded before -------------------------------
STIFF = 0.2  # of the drag rate times a time: a velocity relaxes by a fifth within it, which stages must not step over


class LocalAir(NamedTuple):
    """The mean air at a point, and what its eddies are; zeros where no force of the granule asks for it."""

    ux: float  # m/s
    uy: float
    px: float  # Pa/m
    py: float
    xx: float  # 1/s, du/dx
    xy: float  # du/dy
    yx: float
    yy: float
    tx: float  # m/s2, rate of the velocity in time
    ty: float
    rms: float  # m/s, deviation of the eddies
    life: float  # s, their lifetime
    sx: float  # 1/s, gradient of the deviation
    sy: float
    rise: float  # m/s2, its rate in time


@compiled
def _weights(ints, affine, air, t):
    """Which values in time the air at a time is made of, from the first one on, and the weights of four of them, and of
    its rate in time.
    """
    if air.smooth[at.KNOT_RATE] != 0.0:
        w = (t - air.smooth[at.KNOT_FIRST]) * air.smooth[at.KNOT_RATE]
        n = math.floor(w)
        j = int(n - math.floor(n / air.smooth[at.KNOT_COUNT]) * air.smooth[at.KNOT_COUNT])
        return j, shares(w - n), share_rates(w - n, air.smooth[at.KNOT_RATE])
    w = (t - affine[at.T_BEGIN]) * affine[at.PER_DT]
    return ints[at.SNAP_A], (1.0 - w, w, 0.0, 0.0), (-affine[at.PER_DT], affine[at.PER_DT], 0.0, 0.0)


@compiled
def _in_time(ints, air, c, m, j, s):
    """Quantity m at node c of the weights ``s`` from value ``j`` on."""
    v = air.values
    if air.smooth[at.KNOT_RATE] != 0.0:
        return s[0] * v[c, j, m] + s[1] * v[c, j + 1, m] + s[2] * v[c, j + 2, m] + s[3] * v[c, j + 3, m]
    if s[1] == 0.0:
        return s[0] * v[j, c, m]
    return s[0] * v[j, c, m] + s[1] * v[ints[at.SNAP_B], c, m]


@compiled
def look_at(ints, affine, air, grain, tri, x, y, t):
    """The air at a point of triangle ``tri`` and a time, straight from the triangle's corners."""
    g = air.geometry
    dx, dy = x - g[tri, at.CORNER_X], y - g[tri, at.CORNER_Y]
    j, s, d = _weights(ints, affine, air, t)
    pressed, stirred, slopes = grain[at.PRESSURE] != 0.0, grain[at.DISPERSION] != 0.0, grain[at.EXTRA] != 0.0
    rises = grain[at.INERTIAL] != 0.0
    ux = uy = px = py = xx = xy = yx = yy = tx = ty = rms = life = sx = sy = rise = 0.0
    for k in range(3):
        c, bx, by = air.corners[tri, k], g[tri, at.B0X + 2 * k], g[tri, at.B0Y + 2 * k]
        q = bx * dx + by * dy + (1.0 if k == 0 else 0.0)
        u, v = _in_time(ints, air, c, at.NODE_U, j, s), _in_time(ints, air, c, at.NODE_V, j, s)
        ux, uy = ux + q * u, uy + q * v
        if pressed:
            px += q * _in_time(ints, air, c, at.NODE_PX, j, s)
            py += q * _in_time(ints, air, c, at.NODE_PY, j, s)
        if slopes:
            xx, xy, yx, yy = xx + bx * u, xy + by * u, yx + bx * v, yy + by * v
        if rises:
            tx += q * _in_time(ints, air, c, at.NODE_U, j, d)
            ty += q * _in_time(ints, air, c, at.NODE_V, j, d)
        if stirred:
            deviation = _in_time(ints, air, c, at.NODE_RMS, j, s)
            rms, sx, sy = rms + q * deviation, sx + bx * deviation, sy + by * deviation
            life += q * _in_time(ints, air, c, at.NODE_LIFE, j, s)
            if rises:
                rise += q * _in_time(ints, air, c, at.NODE_RMS, j, d)
    return LocalAir(ux, uy, px, py, xx, xy, yx, yy, tx, ty, rms, life, sx, sy, rise)


@compiled
def excess_in(look, state, air, grain, table, vx, vy, t, rate0, mx, my, gain, curl0):
    """N = F + B0 v but for the history force and the drag rate in air that was looked at; v, the slip and the vorticity
    that the granule sees. ``curl0`` (1/s): the vorticity where the granule had its spin.

    The velocity was made with a foretold N of (mx, my), whose excess ``gain`` (s) times is missing from it: in stiff
    flight it must not pass for slip.
    """
    ux, uy = look.ux + look.rms * state[at.MEAN_X], look.uy + look.rms * state[at.MEAN_Y]
    if grain[at.NOISE] != 0.0:
        ux, uy = ux + state[at.KICK_X], uy + state[at.KICK_Y]
    px, py = grain[at.PRESSURE] * look.px + grain[at.GX], grain[at.PRESSURE] * look.py + grain[at.GY]
    if air.swing[at.SWING_OMEGA] != 0.0:  # v is seen from the mesh, N the lab's
        wx, wy, _, _ = mesh_velocity(air.swing, at.SWING_X, t)
        ux, uy, px, py = ux - wx, uy - wy, px + rate0 * wx, py + rate0 * wy
    xx, xy = look.xx + look.sx * state[at.MEAN_X], look.xy + look.sy * state[at.MEAN_X]
    yx, yy = look.yx + look.sx * state[at.MEAN_Y], look.yy + look.sy * state[at.MEAN_Y]
    tx, ty = look.tx + look.rise * state[at.MEAN_X], look.ty + look.rise * state[at.MEAN_Y]
    curl, spin = yx - xy, state[at.SPIN]
    if grain[at.MAGNUS] != 0.0:
        spin = spin_in_curl(grain, spin, 0.5 * (curl0 + curl), t - state[at.T])
    nx = ny = rate = sx = sy = 0.0
    for again in range(2):
        sx, sy = ux - vx, uy - vy
        rate = drag_rate(grain, table, sx * sx + sy * sy)
        nx, ny = rate * sx + px + rate0 * vx, rate * sy + py + rate0 * vy
        if grain[at.EXTRA] != 0.0:
            ex, ey = forces_in_gradient(grain, xx, xy, yx, yy, tx, ty, ux, uy, sx, sy, spin)
            nx, ny = nx + ex, ny + ey
        if again == 1 or rate0 * gain < STIFF:
            break
        vx += gain * (nx - mx)
        vy += gain * (ny - my)
    return nx, ny, rate, vx, vy, sx, sy, curl


# -- What a force that is not a parabola in time displaces -------------------------------------------------------------
BOOLE = 32.0 / 90.0  # Boole's rule: mean of a quartic that is zero at 0, 1/2 and 1 over its sum at 1/4 and 3/4
# First moment of a cubic with these zeros over its difference between 1/4 and 3/4 is 4/45; twice, rounded up: what it
# displaces in the step, and as much again by the velocity that drag's weighting of it leaves
ODD = 0.18


@compiled
def carried(p, rate, h, horizon):
    """Displacement over h (s) by a constant error of the force, with the phi functions ``p`` of z = -B h: within the
    step h, and after it by the velocity that it leaves, which lasts min(1 / B, horizon).
    """
    return h * p[2] + p[1] * min(1.0 / rate, horizon)


@compiled
def displaced(ox, oy, mx, my, carry, rate, h):
    """Displacement per time (m/s) by defects o at 1/4 and m at 3/4 of a step h; ``carry`` see ``carried``."""
    even = math.sqrt((ox + mx) ** 2 + (oy + my) ** 2)
    odd = math.sqrt((ox - mx) ** 2 + (oy - my) ** 2)
    return BOOLE * carry * even + ODD * h / (1.0 + rate * h) * odd
