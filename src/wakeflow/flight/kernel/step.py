"""One exponential step of third order, its error, and how long it may be.

x' = v, v' = F(t, x, v) with the drag rate B at the step's start as linear part and N = F + B v as polynomial in time,
which integrates exactly (see ``dense_output``). N is built up by Picard iteration: constant, linear through h/2,
quadratic through h/2 and h; each makes the path one order better, everywhere in the step, so that a step may be cut
at any event. The exponential quadrature is that of Cox & Matthews (2002, J. Comput. Phys. 176, 430). The defect of
the last path, between its nodes, gives the error: it sees the error of the quadrature and that of the stages. Exact
when N is constant, whatever B: constant forces and drag coefficient, and ballistic flight at B = 0. In the stiff
limit x' = u + a / B.
"""

from __future__ import annotations

import math

from . import layout as at
from .air import air_at, mesh_velocity
from .dense_output import along, parabola, phis
from .forces import drag_rate, gradient_forces, spin_at
from .history import bend_memory, recall, recall_line, sampled
from .jit import compiled
from .locate import barycentric
from .walls import constrain

TRANSIENT = 4.0  # drag times; (z / (z + 4))^3 of a transient counts in z of them: third order if short, all if long
STRAIGHT = 1e-3  # of the drag time: up to there a path is taken for a parabola
PROGRESS = 1e-8  # of the step tried: less is none
OVERSHOOT = 1.1  # of the estimated time to leave a triangle: the exit is then found inside the step
# The next estimate of that time over the last one, at least and at most; chosen: the mean velocity that it is made of
# belongs to the last estimate, and says little about a time ten times as long or short
MIN_ONWARD, MAX_ONWARD = 0.1, 10.0


@compiled
def _excess(state, ints, affine, grain, table, hold, rate0, x, y, vx, vy, s, lag, wx, wy):
    """N = F + B0 v but for the history force, the drag rate, the air's velocity and the slip at a stage, a time s after
    the step's start.

    ``lag`` times what the air differs there from the (wx, wy) that the stage's velocity was made with is added to it. N
    and the air's velocity are the lab's in free flight seen from a mesh that swings.
    """
    ints[at.EVALUATIONS] += 1
    t = state[at.T] + s
    ux, uy, fx, fy = air_at(affine, x, y, t)
    dx = dy = 0.0
    if affine[at.SWING + at.SWING_OMEGA] != 0.0 and hold[at.KIND] == 0.0:
        dx, dy, ax, ay = mesh_velocity(affine, at.SWING, t)
        fx, fy, wx, wy = fx + ax, fy + ay, wx - dx, wy - dy
    vx += lag * (ux - wx)
    vy += lag * (uy - wy)
    sx, sy = ux - vx, uy - vy
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    fx += rate * sx
    fy += rate * sy
    if grain[at.EXTRA] != 0.0:
        spin = state[at.SPIN]
        if grain[at.MAGNUS] != 0.0 and hold[at.KIND] == 0.0:
            spin = spin_at(affine, grain, spin, state[at.T], s)
        ex, ey = gradient_forces(affine, grain, x, y, t, ux, uy, sx, sy, spin)
        fx += ex
        fy += ey
    if hold[at.KIND] != 0.0:
        fx, fy, _, _, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t)
    return fx + rate0 * (vx + dx), fy + rate0 * (vy + dy), rate, ux + dx, uy + dy, sx, sy


@compiled
def _defect(path, s, state, ints, affine, grain, table, hold, ux, uy):
    """What N differs by from that of the path at time s of the step, but for the history force; what that differs by;
    and the velocity there.

    The history force's own defect leaves no velocity behind; only what the slip differs by from its parabola does.
    """
    rate0, past = path[at.RATE], 0.0
    x, y, wx, wy = along(path, s)
    nx, ny, _, _, _, sx, sy = _excess(state, ints, affine, grain, table, hold, rate0, x, y, wx, wy, s, 0.0, ux, uy)
    nx -= path[at.N0X] + s * (path[at.N1X] + s * path[at.N2X])
    ny -= path[at.N0Y] + s * (path[at.N1Y] + s * path[at.N2Y])
    if grain[at.FORGET] == 0.0:
        return math.sqrt(nx * nx + ny * ny), past, wx, wy
    fx, fy, grows = recall(path, state, grain, hold, s)
    px, py = sampled(path, at.PAST, s)
    qx, qy = sampled(path, at.SLIP, s)
    past = math.sqrt((fx - px) ** 2 + (fy - py) ** 2)
    nx, ny = nx + px, ny + py
    return math.sqrt(nx * nx + ny * ny) + grows * math.sqrt((sx - qx) ** 2 + (sy - qy) ** 2), past, wx, wy


@compiled
def attempt(path, h, state, ints, affine, grain, table, hold, horizon):
    """Fill in N1, N2 of a step h from the rest of the path; returns the estimated position error and the speed^2 at
    the end.

    Error: what the defect at 3/4 of the step displaces, had it that size throughout, its velocity carried on for
    min(1/B, horizon); and what a drag rate frozen over a velocity transient that the stages step over may displace.
    """
    rate0, n0x, n0y, ux, uy = path[at.RATE], path[at.N0X], path[at.N0Y], path[at.AIR_X], path[at.AIR_Y]
    g, remembers = 0.5 * h, grain[at.FORGET] != 0.0
    # Stiff stages must not take for slip that their velocity lags behind the air's change over the stage
    stiff = rate0 * (rate0 * h) ** 2 / (1.0 + (rate0 * h) ** 2) if rate0 * h < 1e100 else rate0
    path[at.N1X] = path[at.N1Y] = path[at.N2X] = path[at.N2Y] = 0.0
    _, _, p2, p3, _ = phis(-rate0 * g)
    _, q1, q2, q3, _ = phis(-rate0 * h)
    x, y, vx, vy = along(path, g)
    lag = stiff * g * p2
    nx, ny, _, wx, wy, sx, sy = _excess(state, ints, affine, grain, table, hold, rate0, x, y, vx, vy, g, lag, ux, uy)
    if remembers:
        ax, ay = recall_line(path, state, grain, hold, g, sx, sy)
        nx, ny = nx + ax, ny + ay
    path[at.N1X], path[at.N1Y] = (nx - n0x) / g, (ny - n0y) / g
    x, y, vx, vy = along(path, g)
    lag = stiff * h * p3
    nx, ny, _, _, _, sx, sy = _excess(state, ints, affine, grain, table, hold, rate0, x, y, vx, vy, g, lag, wx, wy)
    x, y, vx, vy = along(path, h)
    wx, wy = 2.0 * wx - ux, 2.0 * wy - uy
    lag = stiff * 2.0 * h * q3
    mx, my, rate1, _, _, ex, ey = _excess(state, ints, affine, grain, table, hold, rate0, x, y, vx, vy, h, lag, wx, wy)
    if remembers:
        ax, ay, ex, ey = bend_memory(path, h, state, grain, hold, sx, sy, ex, ey)
        nx, ny, mx, my = nx + ax, ny + ay, mx + ex, my + ey
    parabola(path, h, nx, ny, mx, my)
    defect, past, wx, wy = _defect(path, 0.75 * h, state, ints, affine, grain, table, hold, ux, uy)
    carried = min(1.0 / rate0, horizon) if rate0 > 0.0 else horizon
    error = h * (h * q2 + q1 * carried) * defect + h * h * q2 * past
    if rate0 > 0.0 and rate1 > 0.0 and rate0 != rate1:
        z = rate0 * h
        passed = z / (z + TRANSIENT) if z < 1e100 else 1.0
        change = math.sqrt((wx - path[at.START_VX]) ** 2 + (wy - path[at.START_VY]) ** 2)
        error += change * abs(1.0 / rate0 - 1.0 / rate1) * passed * passed * passed
    return error, wx * wx + wy * wy


@compiled
def _nearest_exit(geometry, tri, x, y, wx, wy, least):
    """Time to leave the triangle at a constant velocity; inf when never. Coordinates below ``least`` count as it."""
    time = math.inf
    for k in range(3):
        rate = geometry[tri, at.B0X + 2 * k] * wx + geometry[tri, at.B0Y + 2 * k] * wy
        if rate < 0.0:
            time = min(time, max(barycentric(geometry, tri, k, x, y), least) / -rate)
    return time


@compiled
def exit_time(geometry, tri, path, least):
    """Estimated time to leave the triangle, a little too long: straight first, then along the mean velocity till
    then.
    """
    x, y, vx, vy, rate = path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY], path[at.RATE]
    fx, fy = path[at.N0X] - rate * vx, path[at.N0Y] - rate * vy
    h = _nearest_exit(geometry, tri, x, y, vx, vy, least)
    accel = math.sqrt(fx * fx + fy * fy)
    if accel > 0.0:  # by acceleration alone, across a triangle's size
        det = abs(geometry[tri, at.B1X] * geometry[tri, at.B2Y] - geometry[tri, at.B1Y] * geometry[tri, at.B2X])
        across = math.sqrt(2.0 / (accel * math.sqrt(det)))
        if rate * across > 1.0:  # drag lets nothing accelerate that long
            speed = math.sqrt(path[at.N0X] ** 2 + path[at.N0Y] ** 2) / rate
            across = max(across, 1.0 / (math.sqrt(det) * speed) if speed > 0.0 else across)
        h = min(h, across)
    if not math.isfinite(h):
        return h
    for _ in range(2):
        if rate * h < STRAIGHT:
            wx, wy = vx + 0.5 * h * fx, vy + 0.5 * h * fy
        else:
            _, p1, p2, _, _ = phis(-rate * h)
            wx, wy = p1 * vx + h * p2 * path[at.N0X], p1 * vy + h * p2 * path[at.N0Y]
        onward = _nearest_exit(geometry, tri, x, y, wx, wy, least)
        if not math.isfinite(onward):
            return 2.0 * h
        h = min(max(onward, MIN_ONWARD * h), MAX_ONWARD * h)
    return OVERSHOOT * h
