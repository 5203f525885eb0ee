"""The air at a granule, and the compiled terms of the forces.

The air: snapshots or knots in time, the affine field of one triangle, and its rates. The forces: drag by table, added
mass, shear lift, spin lift, and how the air turns a granule; formulas and sources are in ``laws``, and what is constant
of a term for one granule (``at.STOKES`` to ``at.SPIN_RATE``) is packed before the flight. Gravity, buoyancy and
pressure gradient are in the loaded air (``load_triangle``).
"""

from __future__ import annotations

import math

from ...laws import lift
from ...laws.drag import TABLE_CELLS, TABLE_DECADES
from . import layout as at
from .jit import called, compiled
from .locate import on_edge


@compiled
def _knot(state, ints, affine, air):
    """The interval between two knots of a smooth field that holds the granule's clock."""
    t, t0, per = state[at.T], air.smooth[at.KNOT_FIRST], air.smooth[at.KNOT_RATE]
    n = math.floor((t - t0) * per)
    if t0 + (n + 1.0) / per <= t + 1e-12 * (abs(t) + 1.0 / per):  # a clock this close below a knot has reached it
        n += 1.0
    ints[at.SNAP_A] = int(n - math.floor(n / air.smooth[at.KNOT_COUNT]) * air.smooth[at.KNOT_COUNT])
    ints[at.SNAP_B] = ints[at.SNAP_A] + 1
    affine[at.T_BEGIN], affine[at.PER_DT], affine[at.CUBIC] = t0 + n / per, per, 1.0
    state[at.T_END] = t0 + (n + 1.0) / per
    ints[at.FRESH] = 0


@called
def bracket(state, ints, affine, air):
    """Choose the two snapshots around the granule's clock, or the knot before it; before the first snapshot and after
    the last the field stands still.
    """
    if air.smooth[at.KNOT_RATE] != 0.0:
        _knot(state, ints, affine, air)
        return
    times, period = air.times, air.period[0]
    t, last = state[at.T], times.shape[0] - 1
    shift = 0.0
    if period > 0.0:
        shift = math.floor((t - times[0]) / period) * period
    near = 1e-12 * (abs(t) + times[last] - times[0])  # a clock this close below a snapshot has reached it
    i = -1
    while i < last and times[i + 1] + shift <= t + near:
        i += 1
    if i < last and i >= 0:
        a, b = times[i] + shift, times[i + 1] + shift
        ints[at.SNAP_A], ints[at.SNAP_B] = i, i + 1
    elif period > 0.0:
        if i < 0:
            shift -= period
        a, b = times[last] + shift, times[0] + period + shift
        ints[at.SNAP_A], ints[at.SNAP_B] = last, 0
        if b <= t + near:  # the clock has reached the next turn
            a, b = times[0] + period + shift, times[1] + period + shift
            ints[at.SNAP_A], ints[at.SNAP_B] = 0, 1
    else:
        a, b = (times[last], math.inf) if i >= 0 else (-math.inf, times[0])
        ints[at.SNAP_A] = ints[at.SNAP_B] = last if i >= 0 else 0
    affine[at.T_BEGIN] = a if math.isfinite(a) else 0.0
    affine[at.PER_DT] = 1.0 / (b - a) if ints[at.SNAP_A] != ints[at.SNAP_B] else 0.0
    state[at.T_END] = b
    ints[at.FRESH] = 0


@compiled
def shares(w):
    """Weights of the four coefficients of a cubic B-spline at part w of an interval between knots."""
    v = 1.0 - w
    a, d = v * v * v, w * w * w
    return a / 6.0, (3.0 * d - 6.0 * w * w + 4.0) / 6.0, (3.0 * a - 6.0 * v * v + 4.0) / 6.0, d / 6.0


@compiled
def share_rates(w, per):
    """Rates in time of these weights, ``per`` knots per s."""
    v = 1.0 - w
    a, d = 0.5 * v * v * per, 0.5 * w * w * per
    return -a, (1.5 * w * w - 2.0 * w) * per, (2.0 * v - 1.5 * v * v) * per, d


@compiled
def mesh_velocity(swing, first, t):
    """Velocity and acceleration of a mesh that swings as the four numbers ``swing[first:]`` say."""
    x, y, omega = swing[first + at.SWING_X], swing[first + at.SWING_Y], swing[first + at.SWING_OMEGA]
    angle = omega * t + swing[first + at.SWING_PHASE]
    rate, pull = omega * math.cos(angle), -omega * omega * math.sin(angle)
    return x * rate, y * rate, x * pull, y * pull


@compiled
def _flatten(state, affine, air, gap):
    """Take the air of the nearest boundary point for that of everywhere in the gap."""
    x, y, _ = on_edge(air, gap, state[at.X], state[at.Y])
    for power in range(4 if affine[at.CUBIC] != 0.0 else 2):
        for m in range(4):
            first = at.U0 + at.PER_POWER * power + at.PER_QUANTITY * m
            dx, dy = x - affine[at.ORIGIN_X], y - affine[at.ORIGIN_Y]
            affine[first] += affine[first + at.DX] * dx + affine[first + at.DY] * dy
            affine[first + at.DX] = affine[first + at.DY] = 0.0


@compiled
def _add(affine, to, k, f, bx, by):
    """Add what node k of the triangle, with the value f, gives to a coefficient, which the first node begins."""
    if k == 0:
        affine[to], affine[to + at.DX], affine[to + at.DY] = f, f * bx, f * by
    else:
        affine[to + at.DX] += f * bx
        affine[to + at.DY] += f * by


@compiled
def _add_splines(affine, first, air, tri, j, m, factor, mean):
    """Add quantity m, times ``factor``, and the deviation, times ``mean``, in the powers of time after knot j."""
    geometry, v = air.geometry, air.values
    for k in range(3):
        c = air.corners[tri, k]
        f0, f1 = factor * v[c, j, m], factor * v[c, j + 1, m]
        f2, f3 = factor * v[c, j + 2, m], factor * v[c, j + 3, m]
        if mean != 0.0:
            f0, f1 = f0 + mean * v[c, j, at.NODE_RMS], f1 + mean * v[c, j + 1, at.NODE_RMS]
            f2, f3 = f2 + mean * v[c, j + 2, at.NODE_RMS], f3 + mean * v[c, j + 3, at.NODE_RMS]
        bx, by = geometry[tri, at.B0X + 2 * k], geometry[tri, at.B0Y + 2 * k]
        _add(affine, first, k, (f0 + 4.0 * f1 + f2) / 6.0, bx, by)
        _add(affine, first + at.PER_POWER, k, 0.5 * (f2 - f0), bx, by)
        _add(affine, first + 2 * at.PER_POWER, k, 0.5 * (f0 - 2.0 * f1 + f2), bx, by)
        _add(affine, first + 3 * at.PER_POWER, k, (f3 - f0 + 3.0 * (f1 - f2)) / 6.0, bx, by)


@compiled
def _load_smooth(state, ints, affine, air, grain, tri):
    """The four polynomial coefficients in time, between two knots, of what ``load_triangle`` loads."""
    for i in range(4):
        affine[at.SWING + i] = air.swing[i]
    for m in range(4):
        first, pressed = at.U0 + at.PER_QUANTITY * m, m >= 2
        factor = grain[at.PRESSURE] if pressed else 1.0
        mean = state[at.MEAN_X + m] if not pressed and grain[at.DISPERSION] != 0.0 else 0.0
        for power in range(4):
            to = first + at.PER_POWER * power
            affine[to] = affine[to + at.DX] = affine[to + at.DY] = 0.0
        if not pressed or factor != 0.0:
            _add_splines(affine, first, air, tri, ints[at.SNAP_A], m, factor, mean)
        if pressed:
            affine[first] += grain[at.GX] if m == 2 else grain[at.GY]
        elif grain[at.NOISE] != 0.0:
            affine[first] += state[at.KICK_X + m]


@compiled
def _load_between(affine, air, grain, tri, a, b, m, base, mean):
    """Quantity m of what ``load_triangle`` loads, linear in time between snapshots a and b: ``base`` more than in them,
    and the deviation times ``mean``.
    """
    first, to, v = at.U0 + at.PER_QUANTITY * m, at.U1 + at.PER_QUANTITY * m, air.values
    factor = grain[at.PRESSURE] if m >= 2 else 1.0
    stirred = m < 2 and grain[at.DISPERSION] != 0.0
    for k in range(3):
        c, bx, by = air.corners[tri, k], air.geometry[tri, at.B0X + 2 * k], air.geometry[tri, at.B0Y + 2 * k]
        f = factor * v[a, c, m]
        if a != b:
            d = factor * v[b, c, m] - f
            if stirred:
                d += mean * (v[b, c, at.NODE_RMS] - v[a, c, at.NODE_RMS])
            _add(affine, to, k, d, bx, by)
        if stirred:
            f += mean * v[a, c, at.NODE_RMS]
        _add(affine, first, k, f + base, bx, by)


@compiled
def _load_snapshots(state, ints, affine, air, grain, tri):
    """What ``load_triangle`` loads, in a steady field or between two snapshots."""
    for m in range(4):
        if m >= 2:
            base = grain[at.GX] if m == 2 else grain[at.GY]
        else:
            base = state[at.KICK_X + m] if grain[at.NOISE] != 0.0 else 0.0
        if m >= 2 and grain[at.PRESSURE] == 0.0:
            first, to = at.U0 + at.PER_QUANTITY * m, at.U1 + at.PER_QUANTITY * m
            affine[first] = base
            affine[first + at.DX] = affine[first + at.DY] = 0.0
            affine[to] = affine[to + at.DX] = affine[to + at.DY] = 0.0
        else:
            mean = state[at.MEAN_X + m] if m < 2 else 0.0
            _load_between(affine, air, grain, tri, ints[at.SNAP_A], ints[at.SNAP_B], m, base, mean)


@called
def load_triangle(state, ints, affine, air, grain):
    """Velocity and acceleration (gravity, pressure gradient) as affine functions in the current triangle and interval.

    The velocity is the mean field's plus the fluctuation a granule sees: its deviation, linear in the triangle, times
    the mean over the interval of noise. In the gap between a boundary of the mesh and the body that moved away from
    it, the values of the nearest boundary point, constant.
    """
    ints[at.FRESH] = 1
    gap, tri = ints[at.GAP], ints[at.TRI]
    if gap >= 0:
        tri = air.covered[gap, at.COVER_TRI]
    affine[at.ORIGIN_X], affine[at.ORIGIN_Y] = air.geometry[tri, at.CORNER_X], air.geometry[tri, at.CORNER_Y]
    if affine[at.CUBIC] != 0.0:
        _load_smooth(state, ints, affine, air, grain, tri)
    else:
        _load_snapshots(state, ints, affine, air, grain, tri)
    if gap >= 0:
        _flatten(state, affine, air, gap)


@compiled
def _value(affine, first, dx, dy):
    """A coefficient of the loaded air at (dx, dy) from the origin."""
    return affine[first] + affine[first + at.DX] * dx + affine[first + at.DY] * dy


@compiled
def air_at(affine, x, y, t):
    """Air velocity and the acceleration by gravity and pressure at a point and time, from the loaded triangle."""
    dx, dy = x - affine[at.ORIGIN_X], y - affine[at.ORIGIN_Y]
    ux, uy = _value(affine, at.U0, dx, dy), _value(affine, at.V0, dx, dy)
    ax, ay = _value(affine, at.AX0, dx, dy), _value(affine, at.AY0, dx, dy)
    if affine[at.PER_DT] != 0.0:
        w = (t - affine[at.T_BEGIN]) * affine[at.PER_DT]
        ux += w * _value(affine, at.U1, dx, dy)
        uy += w * _value(affine, at.V1, dx, dy)
        ax += w * _value(affine, at.AX1, dx, dy)
        ay += w * _value(affine, at.AY1, dx, dy)
        if affine[at.CUBIC] != 0.0:
            for power in range(2, 4):
                r = w * w if power == 2 else w * w * w
                higher = at.PER_POWER * power
                ux += r * _value(affine, at.U0 + higher, dx, dy)
                uy += r * _value(affine, at.V0 + higher, dx, dy)
                ax += r * _value(affine, at.AX0 + higher, dx, dy)
                ay += r * _value(affine, at.AY0 + higher, dx, dy)
            if affine[at.SWING + at.SWING_OMEGA] != 0.0:  # seen from the mesh
                wx, wy, px, py = mesh_velocity(affine, at.SWING, t)
                ux, uy, ax, ay = ux - wx, uy - wy, ax - px, ay - py
    return ux, uy, ax, ay


@compiled
def gradient_at(affine, t):
    """Gradient of the air's velocity at a time: (du/dx, du/dy, dv/dx, dv/dy)."""
    w = (t - affine[at.T_BEGIN]) * affine[at.PER_DT]
    xx, xy = affine[at.U0_X] + w * affine[at.U1_X], affine[at.U0_Y] + w * affine[at.U1_Y]
    yx, yy = affine[at.V0_X] + w * affine[at.V1_X], affine[at.V0_Y] + w * affine[at.V1_Y]
    if affine[at.CUBIC] != 0.0:
        p, q = w * w, w * w * w
        xx, xy = xx + p * affine[at.U2_X] + q * affine[at.U3_X], xy + p * affine[at.U2_Y] + q * affine[at.U3_Y]
        yx, yy = yx + p * affine[at.V2_X] + q * affine[at.V3_X], yy + p * affine[at.V2_Y] + q * affine[at.V3_Y]
    return xx, xy, yx, yy


@compiled
def rise_at(affine, x, y, t):
    """Rate in time of the air's velocity at a place."""
    dx, dy = x - affine[at.ORIGIN_X], y - affine[at.ORIGIN_Y]
    tx, ty = _value(affine, at.U1, dx, dy), _value(affine, at.V1, dx, dy)
    if affine[at.CUBIC] != 0.0:
        w = (t - affine[at.T_BEGIN]) * affine[at.PER_DT]
        p, q = 2.0 * w, 3.0 * w * w
        tx += p * _value(affine, at.U2, dx, dy) + q * _value(affine, at.U3, dx, dy)
        ty += p * _value(affine, at.V2, dx, dy) + q * _value(affine, at.V3, dx, dy)
    return affine[at.PER_DT] * tx, affine[at.PER_DT] * ty


# -- The terms of the forces -------------------------------------------------------------------------------------------
lift_coefficient = compiled(lift.lift_coefficient)
magnus_factor = compiled(lift.magnus_factor)
spin_decay = compiled(lift.spin_decay)
plate_spin = compiled(lift.plate_spin)

# Where a Reynolds number is in the table of drag factors, and the inverse of the table's last
FIRST_CELL = float(TABLE_DECADES[0] * TABLE_CELLS)
PER_HALF_NATURAL_LOG = 0.5 / math.log(10.0) * TABLE_CELLS
BEYOND = 10.0 ** -TABLE_DECADES[1]


@compiled
def drag_rate(grain, table, slip2):
    """B = f(Re) / tau (1/s) at a squared slip velocity, from the table of the drag law."""
    if grain[at.STOKES] == 0.0:
        return 0.0
    re2 = grain[at.REYNOLDS2] * slip2
    if re2 <= 1e-16:
        return grain[at.STOKES] * table[0, 0]
    place = PER_HALF_NATURAL_LOG * math.log(re2) - FIRST_CELL
    cells = table.shape[0]
    extra = 1.0
    if place >= cells:
        extra = math.sqrt(re2) * BEYOND
        place = cells - 1e-9
    i = int(place)
    w = place - i
    return grain[at.STOKES] * extra * (table[i, 0] + w * (table[i, 1] + w * (table[i, 2] + w * table[i, 3])))


@compiled
def spin_at(affine, grain, spin, t, s):
    """Spin at time s after t: the air of the loaded triangle turns it exactly, with its vorticity half way."""
    _, xy, yx, _ = gradient_at(affine, t + 0.5 * s)
    return spin_in_curl(grain, spin, yx - xy, s)


@compiled
def spin_in_curl(grain, spin, curl, s):
    """Spin after a time s in air of the vorticity ``curl`` (1/s)."""
    half = 0.5 * curl
    if grain[at.SPIN_TORQUE] != 0.0:
        return half - plate_spin(half - spin, s, grain[at.SPIN_TORQUE])
    return half - spin_decay(half - spin, s, grain[at.SPIN_RATE], grain[at.VORTICITY])


@compiled
def gradient_forces(affine, grain, x, y, t, ux, uy, sx, sy, spin):
    """Acceleration by the air's own (added mass), shear lift and spin lift: terms made of the air's gradients.

    (ux, uy) is the air's velocity, (sx, sy) that velocity less the granule's, in m/s; spin in rad/s.
    """
    xx, xy, yx, yy = gradient_at(affine, t)
    tx, ty = rise_at(affine, x, y, t) if grain[at.INERTIAL] != 0.0 else (0.0, 0.0)
    return forces_in_gradient(grain, xx, xy, yx, yy, tx, ty, ux, uy, sx, sy, spin)


@compiled
def forces_in_gradient(grain, xx, xy, yx, yy, tx, ty, ux, uy, sx, sy, spin):
    """Acceleration by the gradient (du/dx, du/dy, dv/dx, dv/dy) of the air's velocity and its rate (tx, ty) in time."""
    fx = fy = 0.0
    if grain[at.INERTIAL] != 0.0:
        fx += grain[at.INERTIAL] * (tx + xx * ux + xy * uy)
        fy += grain[at.INERTIAL] * (ty + yx * ux + yy * uy)
    curl = yx - xy
    reynolds = math.sqrt(grain[at.REYNOLDS2] * (sx * sx + sy * sy))
    if grain[at.LIFT] != 0.0:
        lift = grain[at.LIFT] * lift_coefficient(reynolds, grain[at.VORTICITY] * abs(curl)) * curl
        fx += lift * sy
        fy -= lift * sx
    if grain[at.MAGNUS] != 0.0:
        turn = 0.5 * curl - spin
        lift = grain[at.MAGNUS] * turn
        if grain[at.SPIN_TORQUE] == 0.0:
            lift *= magnus_factor(reynolds, grain[at.VORTICITY] * abs(turn))
        fx -= lift * sy
        fy += lift * sx
    return fx, fy


@compiled
def free_force(affine, grain, table, x, y, vx, vy, t, spin):
    """Acceleration of a granule in free flight, the drag rate, and the air's velocity."""
    ux, uy, fx, fy = air_at(affine, x, y, t)
    sx, sy = ux - vx, uy - vy
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    fx += rate * sx
    fy += rate * sy
    if grain[at.EXTRA] != 0.0:
        ex, ey = gradient_forces(affine, grain, x, y, t, ux, uy, sx, sy, spin)
        fx += ex
        fy += ey
    return fx, fy, rate, ux, uy
