"""What the air does at a granule: snapshots or knots in time, the affine field of one triangle, and its rates."""

from __future__ import annotations

import math

from .jit import compiled
from .layout import (
    CUBIC,
    DISPERSION,
    FRESH,
    GAP,
    GX,
    GY,
    KICK_X,
    MEAN_X,
    NOISE,
    PRESSURE,
    SNAP_A,
    SNAP_B,
    SWING,
    T_END,
    TRI,
    T,
    X,
    Y,
)
from .locate import on_edge

__all__ = ["air_at", "bracket", "gradient_at", "load", "nodal", "rise_at", "shares", "swinging"]


@compiled
def _knot(state, ints, affine, air):
    """The interval between two knots of a smooth field that holds the granule's clock."""
    t, t0, per = state[T], air.smooth[0], air.smooth[1]
    n = math.floor((t - t0) * per)
    if t0 + (n + 1.0) / per <= t + 1e-12 * (abs(t) + 1.0 / per):  # a clock this close below a knot has reached it
        n += 1.0
    ints[SNAP_A] = int(n - math.floor(n / air.smooth[2]) * air.smooth[2])
    ints[SNAP_B] = ints[SNAP_A] + 1
    affine[14], affine[15], affine[CUBIC] = t0 + n / per, per, 1.0
    state[T_END] = t0 + (n + 1.0) / per
    ints[FRESH] = 0


@compiled
def bracket(state, ints, affine, air):
    """Choose the two snapshots around the granule's clock, or the knot before it; before the first snapshot and after
    the last the field stands still.
    """
    if air.smooth[1] != 0.0:
        _knot(state, ints, affine, air)
        return
    times, period = air.times, air.period[0]
    t, last = state[T], times.shape[0] - 1
    shift = 0.0
    if period > 0.0:
        shift = math.floor((t - times[0]) / period) * period
    near = 1e-12 * (abs(t) + times[last] - times[0])  # a clock this close below a snapshot has reached it
    i = -1
    while i < last and times[i + 1] + shift <= t + near:
        i += 1
    if i < last and i >= 0:
        a, b = times[i] + shift, times[i + 1] + shift
        ints[SNAP_A], ints[SNAP_B] = i, i + 1
    elif period > 0.0:
        if i < 0:
            shift -= period
        a, b = times[last] + shift, times[0] + period + shift
        ints[SNAP_A], ints[SNAP_B] = last, 0
        if b <= t + near:  # the clock has reached the next turn
            a, b = times[0] + period + shift, times[1] + period + shift
            ints[SNAP_A], ints[SNAP_B] = 0, 1
    else:
        a, b = (times[last], math.inf) if i >= 0 else (-math.inf, times[0])
        ints[SNAP_A] = ints[SNAP_B] = last if i >= 0 else 0
    affine[14] = a if math.isfinite(a) else 0.0
    affine[15] = 1.0 / (b - a) if ints[SNAP_A] != ints[SNAP_B] else 0.0
    state[T_END] = b
    ints[FRESH] = 0


@compiled
def shares(w):
    """Weights of the four coefficients of a cubic B-spline at part w of an interval between knots."""
    v = 1.0 - w
    a, d = v * v * v, w * w * w
    return a / 6.0, (3.0 * d - 6.0 * w * w + 4.0) / 6.0, (3.0 * a - 6.0 * v * v + 4.0) / 6.0, d / 6.0


@compiled
def nodal(air, ints, w, c, m):
    """Quantity m of the air at node c, at part w of the interval that holds the granule's clock."""
    a, b, v = ints[SNAP_A], ints[SNAP_B], air.values
    if air.smooth[1] != 0.0:
        s0, s1, s2, s3 = shares(w)
        return s0 * v[c, a, m] + s1 * v[c, a + 1, m] + s2 * v[c, a + 2, m] + s3 * v[c, a + 3, m]
    return v[a, c, m] + w * (v[b, c, m] - v[a, c, m])


@compiled
def swinging(x, y, omega, phase, t):
    """Velocity and acceleration of a mesh that swings by (x, y) sin(omega t + phase)."""
    angle = omega * t + phase
    rate, pull = omega * math.cos(angle), -omega * omega * math.sin(angle)
    return x * rate, y * rate, x * pull, y * pull


@compiled
def _plane(affine, at, f0, f1, f2, geometry, tri):
    affine[at] = f0
    affine[at + 1] = f0 * geometry[tri, 2] + f1 * geometry[tri, 4] + f2 * geometry[tri, 6]
    affine[at + 2] = f0 * geometry[tri, 3] + f1 * geometry[tri, 5] + f2 * geometry[tri, 7]


@compiled
def _flatten(state, affine, air, gap):
    """In the gap the air of the nearest boundary point is everywhere."""
    x, y, _ = on_edge(air, gap, state[X], state[Y])
    for power in range(4 if affine[CUBIC] != 0.0 else 2):
        for m in range(4):
            at = (2 if power == 0 else 4 + 12 * power) + 3 * m
            affine[at] += affine[at + 1] * (x - affine[0]) + affine[at + 2] * (y - affine[1])
            affine[at + 1] = affine[at + 2] = 0.0


@compiled
def _load_smooth(state, ints, affine, air, grain, tri):
    """The four polynomial coefficients in time, between two knots, of what ``load`` loads."""
    geometry, v, j = air.geometry, air.values, ints[SNAP_A]
    for i in range(4):
        affine[SWING + i] = air.swing[i]
    for m in range(4):
        at, pressed = 2 + 3 * m, m >= 2
        factor = grain[PRESSURE] if pressed else 1.0
        mean = state[MEAN_X + m] if not pressed and grain[DISPERSION] != 0.0 else 0.0
        for power in range(4):
            to = at + (2 + 12 * power if power > 0 else 0)
            affine[to] = affine[to + 1] = affine[to + 2] = 0.0
        if not pressed or factor != 0.0:
            for k in range(3):
                c = air.corners[tri, k]
                f0, f1 = factor * v[c, j, m], factor * v[c, j + 1, m]
                f2, f3 = factor * v[c, j + 2, m], factor * v[c, j + 3, m]
                if mean != 0.0:
                    f0, f1 = f0 + mean * v[c, j, 4], f1 + mean * v[c, j + 1, 4]
                    f2, f3 = f2 + mean * v[c, j + 2, 4], f3 + mean * v[c, j + 3, 4]
                bx, by = geometry[tri, 2 + 2 * k], geometry[tri, 3 + 2 * k]
                for power in range(4):
                    to = at + (2 + 12 * power if power > 0 else 0)
                    if power == 0:
                        f = (f0 + 4.0 * f1 + f2) / 6.0
                    elif power == 1:
                        f = 0.5 * (f2 - f0)
                    elif power == 2:
                        f = 0.5 * (f0 - 2.0 * f1 + f2)
                    else:
                        f = (f3 - f0 + 3.0 * (f1 - f2)) / 6.0
                    if k == 0:
                        affine[to] = f
                    affine[to + 1] += f * bx
                    affine[to + 2] += f * by
        if pressed:
            affine[at] += grain[GX] if m == 2 else grain[GY]
        elif grain[NOISE] != 0.0:
            affine[at] += state[KICK_X + m]


@compiled
def load(state, ints, affine, air, grain):
    """Velocity and acceleration (gravity, pressure gradient) as affine functions in the current triangle and interval.

    The velocity is the mean field's plus the fluctuation a granule sees: its deviation, linear in the triangle, times
    the mean over the interval of noise. In the gap between a boundary of the mesh and the body that moved away from
    it, the values of the nearest boundary point, constant.
    """
    ints[FRESH] = 1
    gap, tri = ints[GAP], ints[TRI]
    if gap >= 0:
        tri = air.covered[gap, 0]
    geometry, values = air.geometry, air.values
    affine[0], affine[1] = geometry[tri, 0], geometry[tri, 1]
    if affine[CUBIC] != 0.0:
        _load_smooth(state, ints, affine, air, grain, tri)
        if gap >= 0:
            _flatten(state, affine, air, gap)
        return
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    a, b = ints[SNAP_A], ints[SNAP_B]
    timed = a != b
    noisy = grain[NOISE] != 0.0
    for m in range(4):
        at, to = 2 + 3 * m, 16 + 3 * m
        if m >= 2 and grain[PRESSURE] == 0.0:
            affine[at] = grain[GX] if m == 2 else grain[GY]
            affine[at + 1] = affine[at + 2] = affine[to] = affine[to + 1] = affine[to + 2] = 0.0
            continue
        factor = grain[PRESSURE] if m >= 2 else 1.0
        base = grain[GX] if m == 2 else (grain[GY] if m == 3 else 0.0)
        f0, f1, f2 = factor * values[a, c0, m], factor * values[a, c1, m], factor * values[a, c2, m]
        if timed:
            d0 = factor * values[b, c0, m] - f0
            d1 = factor * values[b, c1, m] - f1
            d2 = factor * values[b, c2, m] - f2
            if m < 2 and grain[DISPERSION] != 0.0:
                mean = state[MEAN_X + m]
                d0 += mean * (values[b, c0, 4] - values[a, c0, 4])
                d1 += mean * (values[b, c1, 4] - values[a, c1, 4])
                d2 += mean * (values[b, c2, 4] - values[a, c2, 4])
            _plane(affine, to, d0, d1, d2, geometry, tri)
        if m < 2 and noisy:
            base = state[KICK_X + m]
            if grain[DISPERSION] != 0.0:
                mean = state[MEAN_X + m]
                f0 += mean * values[a, c0, 4]
                f1 += mean * values[a, c1, 4]
                f2 += mean * values[a, c2, 4]
        _plane(affine, at, f0 + base, f1 + base, f2 + base, geometry, tri)
    if gap >= 0:
        _flatten(state, affine, air, gap)


@compiled
def air_at(affine, x, y, t):
    """Air velocity and the acceleration by gravity and pressure at a point and time, from the loaded triangle."""
    dx, dy = x - affine[0], y - affine[1]
    ux = affine[2] + affine[3] * dx + affine[4] * dy
    uy = affine[5] + affine[6] * dx + affine[7] * dy
    ax = affine[8] + affine[9] * dx + affine[10] * dy
    ay = affine[11] + affine[12] * dx + affine[13] * dy
    if affine[15] != 0.0:
        w = (t - affine[14]) * affine[15]
        ux += w * (affine[16] + affine[17] * dx + affine[18] * dy)
        uy += w * (affine[19] + affine[20] * dx + affine[21] * dy)
        ax += w * (affine[22] + affine[23] * dx + affine[24] * dy)
        ay += w * (affine[25] + affine[26] * dx + affine[27] * dy)
        if affine[CUBIC] != 0.0:
            p, q = w * w, w * w * w
            for i in range(2):
                r = p if i == 0 else q
                at = 28 + 12 * i
                ux += r * (affine[at] + affine[at + 1] * dx + affine[at + 2] * dy)
                uy += r * (affine[at + 3] + affine[at + 4] * dx + affine[at + 5] * dy)
                ax += r * (affine[at + 6] + affine[at + 7] * dx + affine[at + 8] * dy)
                ay += r * (affine[at + 9] + affine[at + 10] * dx + affine[at + 11] * dy)
            if affine[SWING + 2] != 0.0:  # seen from the mesh
                wx, wy, px, py = swinging(affine[SWING], affine[SWING + 1], affine[SWING + 2], affine[SWING + 3], t)
                ux, uy, ax, ay = ux - wx, uy - wy, ax - px, ay - py
    return ux, uy, ax, ay


@compiled
def gradient_at(affine, t):
    """Gradient of the air's velocity at a time: (du/dx, du/dy, dv/dx, dv/dy)."""
    w = (t - affine[14]) * affine[15]
    xx, xy = affine[3] + w * affine[17], affine[4] + w * affine[18]
    yx, yy = affine[6] + w * affine[20], affine[7] + w * affine[21]
    if affine[CUBIC] != 0.0:
        p, q = w * w, w * w * w
        xx, xy = xx + p * affine[29] + q * affine[41], xy + p * affine[30] + q * affine[42]
        yx, yy = yx + p * affine[32] + q * affine[44], yy + p * affine[33] + q * affine[45]
    return xx, xy, yx, yy


@compiled
def rise_at(affine, x, y, t):
    """Rate in time of the air's velocity at a place."""
    dx, dy = x - affine[0], y - affine[1]
    tx = affine[16] + affine[17] * dx + affine[18] * dy
    ty = affine[19] + affine[20] * dx + affine[21] * dy
    if affine[CUBIC] != 0.0:
        w = (t - affine[14]) * affine[15]
        p, q = 2.0 * w, 3.0 * w * w
        tx += p * (affine[28] + affine[29] * dx + affine[30] * dy) + q * (
            affine[40] + affine[41] * dx + affine[42] * dy
        )
        ty += p * (affine[31] + affine[32] * dx + affine[33] * dy) + q * (
            affine[43] + affine[44] * dx + affine[45] * dy
        )
    return affine[15] * tx, affine[15] * ty
