"""One exponential step: third order, with an error estimate of the same order, and how long it may be.

ETD3RK of Cox & Matthews (2002, J. Comput. Phys. 176, 430) on x' = v, v' = F(t, x, v), with the drag rate B at the step's start
as linear part: stages at 0, 1/2 and 1, N = F + B v. Its own stages are too coarse for a dense output of its order in the stiff
limit, so N is evaluated once more along the path they give, at h/2 and h (one Picard iteration): the path through those
is third order everywhere in the step, and by how much it moved is the error estimate. Exact when N is constant, whatever
B: constant forces and drag coefficient, and ballistic flight at B = 0. In the stiff limit the step follows x' = u + a / B.
"""

from __future__ import annotations

import math

from .exponential import phis
from .jit import compiled
from .locate import air_at, barycentric
from .state import KIND, REYNOLDS2, STOKES, VX, VY, X, Y, T
from .walls import constrain

__all__ = ["attempt", "drag_rate", "exit_time", "free_force"]

# The table of drag factors: constants of laws.drag, checked in tests
LOG_LOW = -8.0
LOG_HIGH = 7.0
PER_HALF_NATURAL_LOG = 0.5 / math.log(10.0) * 96.0
OVERSHOOT = 1.1  # of the estimated time to leave a triangle: the exit is then found inside the step


@compiled
def drag_rate(grain, table, slip2):  # type: ignore[no-untyped-def]
    """B = f(Re) / tau (1/s) at a squared slip velocity, from the table of the drag law."""
    if grain[STOKES] == 0.0:
        return 0.0
    re2 = grain[REYNOLDS2] * slip2
    if re2 <= 1e-16:
        return grain[STOKES] * table[0, 0]
    at = PER_HALF_NATURAL_LOG * math.log(re2) - LOG_LOW * 96.0
    cells = table.shape[0]
    extra = 1.0
    if at >= cells:
        extra = math.sqrt(re2) * 1e-7
        at = cells - 1e-9
    i = int(at)
    w = at - i
    return grain[STOKES] * extra * (table[i, 0] + w * (table[i, 1] + w * (table[i, 2] + w * table[i, 3])))


@compiled
def free_force(affine, grain, table, x, y, vx, vy, t):  # type: ignore[no-untyped-def]
    """Acceleration of a granule in free flight, the drag rate, and the air's speed squared."""
    ux, uy, ax, ay = air_at(affine, x, y, t)
    sx, sy = ux - vx, uy - vy
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    return rate * sx + ax, rate * sy + ay, rate, ux * ux + uy * uy


@compiled
def _excess(affine, grain, table, hold, path, lag, x, y, vx, vy, t):  # type: ignore[no-untyped-def]
    """N = F + B0 v at a stage, and the drag rate there; the velocity follows by ``lag`` the air's change since the start."""
    ux, uy, ax, ay = air_at(affine, x, y, t)
    rate0 = path[4]
    vx += lag * (ux - path[11])
    vy += lag * (uy - path[12])
    sx, sy = ux - vx, uy - vy
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    fx, fy = rate * sx + ax, rate * sy + ay
    if hold[KIND] != 0.0:
        fx, fy, _, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t)
    return fx + rate0 * vx, fy + rate0 * vy, rate


@compiled
def _fit(path, h, n1x, n1y, n2x, n2y):  # type: ignore[no-untyped-def]
    """Coefficients N1, N2 of the quadratic through N at 0, h/2 and h."""
    path[7] = (4.0 * n1x - 3.0 * path[5] - n2x) / h
    path[8] = (4.0 * n1y - 3.0 * path[6] - n2y) / h
    path[9] = 2.0 * (path[5] - 2.0 * n1x + n2x) / (h * h)
    path[10] = 2.0 * (path[6] - 2.0 * n1y + n2y) / (h * h)


@compiled
def attempt(path, h, t, affine, grain, table, hold, horizon):  # type: ignore[no-untyped-def]
    """Fill in N1, N2 of a step h from the rest of the path; returns the estimated position error and the speed^2 at the end.

    Error: by how much the correction moved the end, its velocity carried on for min(1/B, horizon); and what a drag
    rate frozen over a velocity transient that the stages step over may displace.
    """
    x, y, vx, vy, rate0 = path[0], path[1], path[2], path[3], path[4]
    n0x, n0y = path[5], path[6]
    g = 0.5 * h
    # The first stages' velocities lag behind the air by its change over the stage; stiff ones would take that for slip
    stiff = rate0 * (rate0 * h) ** 2 / (1.0 + (rate0 * h) ** 2)
    e, p1, p2, p3, p4 = phis(-rate0 * g)
    q0, q1, q2, q3, q4 = phis(-rate0 * h)
    ax, ay = e * vx + g * p1 * n0x, e * vy + g * p1 * n0y
    x1, y1 = x + g * (p1 * vx + g * p2 * n0x), y + g * (p1 * vy + g * p2 * n0y)
    n1x, n1y, _ = _excess(affine, grain, table, hold, path, stiff * g * p2, x1, y1, ax, ay, t + g)
    mx, my = 2.0 * n1x - n0x, 2.0 * n1y - n0y
    ax, ay = q0 * vx + h * q1 * mx, q0 * vy + h * q1 * my
    blend = stiff / rate0 if rate0 > 0.0 else 0.0
    ax += blend * h * q1 * (n0x - mx)
    ay += blend * h * q1 * (n0y - my)
    x1, y1 = x + h * (q1 * vx + h * q2 * mx), y + h * (q1 * vy + h * q2 * my)
    n2x, n2y, _ = _excess(affine, grain, table, hold, path, stiff * h * q2, x1, y1, ax, ay, t + h)
    _fit(path, h, n1x, n1y, n2x, n2y)
    b1x, b1y, b2x, b2y = path[7], path[8], path[9], path[10]
    # the correction: N along the path found, at h/2 and h
    ax = e * vx + g * (p1 * n0x + g * (p2 * b1x + 2.0 * g * p3 * b2x))
    ay = e * vy + g * (p1 * n0y + g * (p2 * b1y + 2.0 * g * p3 * b2y))
    x1 = x + g * (p1 * vx + g * (p2 * n0x + g * (p3 * b1x + 2.0 * g * p4 * b2x)))
    y1 = y + g * (p1 * vy + g * (p2 * n0y + g * (p3 * b1y + 2.0 * g * p4 * b2y)))
    n1x, n1y, _ = _excess(affine, grain, table, hold, path, 0.0, x1, y1, ax, ay, t + g)
    ax = q0 * vx + h * (q1 * n0x + h * (q2 * b1x + 2.0 * h * q3 * b2x))
    ay = q0 * vy + h * (q1 * n0y + h * (q2 * b1y + 2.0 * h * q3 * b2y))
    x1 = x + h * (q1 * vx + h * (q2 * n0x + h * (q3 * b1x + 2.0 * h * q4 * b2x)))
    y1 = y + h * (q1 * vy + h * (q2 * n0y + h * (q3 * b1y + 2.0 * h * q4 * b2y)))
    n2x, n2y, rate2 = _excess(affine, grain, table, hold, path, 0.0, x1, y1, ax, ay, t + h)
    _fit(path, h, n1x, n1y, n2x, n2y)
    c1x, c1y = h * (path[7] - b1x), h * (path[8] - b1y)
    c2x, c2y = 2.0 * h * h * (path[9] - b2x), 2.0 * h * h * (path[10] - b2y)
    # The corrected velocity is a power of h better than the first one in the stiff limit, as it follows the air's gradient
    z2 = (rate0 * h) ** 2
    bend = h * math.sqrt(affine[3] ** 2 + affine[4] ** 2 + affine[6] ** 2 + affine[7] ** 2)
    carried = min(1.0 / rate0, horizon) if rate0 > 0.0 else horizon
    carried *= (1.0 + z2 * min(1.0, bend)) / (1.0 + z2) if z2 < 1e200 else min(1.0, bend)
    error = h * h * math.sqrt((q3 * c1x + q4 * c2x) ** 2 + (q3 * c1y + q4 * c2y) ** 2)
    error += h * carried * math.sqrt((q2 * c1x + q3 * c2x) ** 2 + (q2 * c1y + q3 * c2y) ** 2)
    if rate0 > 0.0 and rate2 > 0.0 and rate0 != rate2:
        z = rate0 * h
        passed = z / (z + 4.0)
        change = math.sqrt((ax - vx) ** 2 + (ay - vy) ** 2)
        error += change * abs(1.0 / rate0 - 1.0 / rate2) * passed * passed * passed
    return error, ax * ax + ay * ay


@compiled
def _nearest_exit(geometry, tri, x, y, wx, wy, least):  # type: ignore[no-untyped-def]
    """Time to leave the triangle at a constant velocity; inf when never. Coordinates below ``least`` count as it."""
    time = math.inf
    for k in range(3):
        rate = geometry[tri, 2 + 2 * k] * wx + geometry[tri, 3 + 2 * k] * wy
        if rate < 0.0:
            time = min(time, max(barycentric(geometry, tri, k, x, y), least) / -rate)
    return time


@compiled
def exit_time(geometry, tri, path, least):  # type: ignore[no-untyped-def]
    """Estimated time to leave the triangle, a little too long: straight first, then along the mean velocity till then."""
    x, y, vx, vy, rate = path[0], path[1], path[2], path[3], path[4]
    fx, fy = path[5] - rate * vx, path[6] - rate * vy
    h = _nearest_exit(geometry, tri, x, y, vx, vy, least)
    accel = math.sqrt(fx * fx + fy * fy)
    if accel > 0.0:  # by acceleration alone, across a triangle's size
        det = abs(geometry[tri, 4] * geometry[tri, 7] - geometry[tri, 5] * geometry[tri, 6])
        across = math.sqrt(2.0 / (accel * math.sqrt(det)))
        if rate * across > 1.0:  # drag lets nothing accelerate that long
            speed = math.sqrt(path[5] ** 2 + path[6] ** 2) / rate
            across = max(across, 1.0 / (math.sqrt(det) * speed) if speed > 0.0 else across)
        h = min(h, across)
    if not math.isfinite(h):
        return h
    for _ in range(2):
        if rate * h < 1e-3:
            wx, wy = vx + 0.5 * h * fx, vy + 0.5 * h * fy
        else:
            _, p1, p2, _, _ = phis(-rate * h)
            wx, wy = p1 * vx + h * p2 * path[5], p1 * vy + h * p2 * path[6]
        onward = _nearest_exit(geometry, tri, x, y, wx, wy, least)
        if not math.isfinite(onward):
            return 2.0 * h
        h = min(max(onward, 0.1 * h), 10.0 * h)
    return OVERSHOOT * h
