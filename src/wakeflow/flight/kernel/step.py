"""One exponential step of third order, its error, and how long it may be.

x' = v, v' = F(t, x, v) with the drag rate B at the step's start as linear part and N = F + B v as polynomial in time,
which integrates exactly (see ``dense_output``). N is built up by Picard iteration: constant, linear through h/2,
quadratic through h/2 and h; each makes the path one order better, everywhere in the step, so that a step may be cut
at any event. The exponential quadrature is that of Cox & Matthews (2002, J. Comput. Phys. 176, 430). The defect of
the last path, between its nodes, gives the error: it sees the error of the quadrature and that of the stages. Exact
when N is constant, whatever B: constant forces and drag coefficient, and ballistic flight at B = 0. In the stiff
limit x' = u + a / B.

A confined step stays in its triangle, of which it sees every event. A triangle is often much smaller than the step that
the tolerance asks for, and the air seldom far from linear in time along a track through it: away from walls multi-cell
steps (``strides``) do for many triangles what confined steps would do one by one.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .air import air_at, drag_rate, gradient_forces, mesh_velocity, spin_at
from .dense_output import along, parabola, phis, sampled
from .events import first_below, seen_from
from .history import bend_memory, past_defect, recall_line
from .jit import called, compiled
from .locate import barycentric, walk
from .walls import constrain, distance

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
    rate0, past, bent = path[at.RATE], 0.0, 0.0
    x, y, wx, wy = along(path, s)
    nx, ny, _, _, _, sx, sy = _excess(state, ints, affine, grain, table, hold, rate0, x, y, wx, wy, s, 0.0, ux, uy)
    fx, fy = sampled(path, at.N0X, s)
    nx, ny = nx - fx, ny - fy
    if grain[at.FORGET] != 0.0:
        past, bent, px, py = past_defect(path, state, grain, hold, s, sx, sy)
        nx, ny = nx + px, ny + py
    return math.sqrt(nx * nx + ny * ny) + bent, past, wx, wy


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
    parabola(path, at.N0X, h, nx, ny, mx, my)
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


# -- How long the next confined step is --------------------------------------------------------------------------------
EDGE = 1e-11  # barycentric distance below which a granule is on an edge
LOOKS = 2.0  # at the air in a confined step: it may be as long as twice what changes in time ask for
HOP_LIMIT = 60  # crossings of edges or contacts in a row without progress
TURN = 0.2  # rad of a wall's vibration, or of a corner, gone round in a step in contact: nearly straight
CRAWL = 1e-3  # of a body's length (1/s^2): with no pull at all a step in a corner is sqrt(1e-8) s long
INWARDS = 1e-3  # barycentric distance from which on a time to leave the triangle is counted
ROUND_OFF = 1e-13  # of the time that a flight takes: a step as short as this is taken, whatever its error
AIR_OF = 1e-15  # of the extent: round-off of a place, which no error can be asked to be below
MAX_TRIES = 60  # lengths of a step: those after the fourth are a tenth of the one before each
# The next step is 0.9 of what the error asks for, and at most 5 times as long, the usual numbers (Hairer, Norsett &
# Wanner 1993, Solving Ordinary Differential Equations I, II.4); one that was refused becomes no shorter than a tenth
SAFETY, MAX_GROWTH, MIN_SHRINK = 0.9, 5.0, 0.1
ORDER = 3.0  # of the step


@compiled
def _longest_contact(state, hold, speed, pull):
    """The longest step (s) in contact: a part of the wall's vibration, to its next sample, and a part of a corner."""
    h = math.inf
    if hold[at.WW] != 0.0:
        h = min(h, TURN / hold[at.WW])
    if hold[at.SAMPLED] != 0.0:  # the wall's acceleration has a kink there
        h = min(h, hold[at.W_END] - state[at.T])
    if hold[at.KIND] == at.ON_VERTEX:
        h = min(h, TURN * hold[at.ARM] / (speed + math.sqrt(hold[at.ARM] * pull)))
    return h


@compiled
def _nearly_straight(state, grain, rules, speed, pull):
    """The longest step (s) that is nearly straight where bodies may be met: over half of their size, and farther by as
    much as they are away.
    """
    x, y = state[at.X], state[at.Y]
    away = max(rules.left - x, x - rules.right, rules.bottom - y, y - rules.top, 0.0) - grain[at.RADIUS]
    half = 0.5 * rules.length + max(away, 0.0)
    slow = speed + math.sqrt(half * pull)
    return half / slow if slow > 0.0 else math.inf


@compiled
def longest_step(state, ints, path, hold, air, grain, walls, rules, timed, speed, pull, edge):
    """The longest step worth trying: (end, snapshot, noise, last error, nearly straight where there are walls; and
    about as long as it stays in its triangle).
    """
    h = min(rules.until - state[at.T], state[at.H_ERROR])
    if timed:
        h = min(h, state[at.T_END] - state[at.T])
    if grain[at.NOISE] != 0.0:
        h = min(h, state[at.T_NOISE] - state[at.T])
    h = min(h, LOOKS * rules.coarse)
    within = math.inf
    if air.corners.shape[0] > 0:
        if ints[at.GAP] >= 0:
            within = 0.5 * edge / speed if speed > 0.0 else math.inf
        else:
            within = exit_time(air.geometry, ints[at.TRI], path, INWARDS)
    if walls.bodies.shape[0] > 0:
        h = min(h, _nearly_straight(state, grain, rules, speed, pull))
    if ints[at.STUCK] >= HOP_LIMIT:  # contacts in no time: a step too short to reach into a wall, without looking
        h = min(h, math.sqrt(rules.skin / (pull + CRAWL * rules.length)))
    if hold[at.KIND] != at.FREE:
        h = min(h, _longest_contact(state, hold, speed, pull))
    return h, within


@compiled
def _allowed(rules, h, speed, fast):
    return rules.allowance * h * max(speed, math.sqrt(fast)) + AIR_OF * rules.extent


@compiled
def flight_left(state, rules, speed, pull):
    """How long a velocity error may be carried on: to the end, or as long as the flight takes."""
    return min(rules.until - state[at.T], rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300))


@compiled
def confined_step(path, h, state, ints, affine, grain, table, hold, rules, speed, pull):
    """Try steps from h down until the estimated error is within the allowance; returns the step, 0.0 when none is."""
    shortest = ROUND_OFF * rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300)
    horizon = flight_left(state, rules, speed, pull)
    for rejected in range(MAX_TRIES):
        error, fast = attempt(path, h, state, ints, affine, grain, table, hold, horizon)
        allowed = _allowed(rules, h, speed, fast)
        if error <= allowed or (h <= shortest and math.isfinite(error)):
            longer = min(MAX_GROWTH, SAFETY * (allowed / error) ** (1.0 / ORDER))
            state[at.H_ERROR] = h * longer if error > 0.0 else math.inf
            return h
        # a velocity transient shorter than the step shrinks the error no faster than the step: then go down quickly
        most = SAFETY if rejected == 0 else (0.5 if rejected < 4 else MIN_SHRINK)
        shorter = max(MIN_SHRINK, most * min(1.0, (allowed / error) ** (1.0 / ORDER)))
        h *= shorter if math.isfinite(error) else MIN_SHRINK
    return 0.0


@compiled
def leaves(path, h, ints, air):
    """When and across which edge the step leaves the triangle: (time, edge), edge -1 when it does not."""
    g, tri = air.geometry, ints[at.TRI]
    cx, cy = g[tri, at.CORNER_X], g[tri, at.CORNER_Y]
    x, y, vx, vy = along(path, h)
    s, edge = h, at.NOBODY
    for k in range(3):
        bx, by = g[tri, at.B0X + 2 * k], g[tri, at.B0Y + 2 * k]
        fb, rb = barycentric(g, tri, k, x, y), bx * vx + by * vy
        ra = bx * path[at.START_VX] + by * path[at.START_VY]
        if fb > 0.0 and not (ra < 0.0 and rb > 0.0):
            continue
        fa = barycentric(g, tri, k, path[at.START_X], path[at.START_Y])
        q0 = 1.0 if k == 0 else 0.0
        met = first_below(path, 0.0, g, at.NOBODY, events.PLANE, cx, cy, q0, bx, by, 0.0, fa, ra, h, fb, rb, EDGE)
        if met >= 0.0 and (met < s or (met == s and fb <= 0.0)):
            s, edge = met, k
    return s, edge


# -- From triangle to triangle -----------------------------------------------------------------------------------------
ON_LINE = 1e-9  # of the extent: round-off of a place on the mesh's boundary; chosen: far above that of doubles


@called
def _at_boundary(state, ints, air, walls, rules, k):
    """End the track on edge k of the mesh, or on the line that lies there."""
    tri, g = ints[at.TRI], air.geometry
    bx, by = g[tri, at.B0X + 2 * k], g[tri, at.B0Y + 2 * k]
    off = barycentric(g, tri, k, state[at.X], state[at.Y]) / (bx * bx + by * by)
    state[at.X] -= off * bx
    state[at.Y] -= off * by
    leave(state, ints, walls, rules)


@called
def leave(state, ints, walls, rules):
    """End the track of a granule on the mesh's edge, on the line that lies there if there is one."""
    ints[at.FATE] = at.ESCAPED
    near = ON_LINE * rules.extent + rules.allowance * rules.extent
    x, y, _, _ = seen_from(walls.frame, 0, state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
    for i in range(walls.lines.shape[0]):
        if distance(walls.lines, i, x, y) <= near:
            ints[at.FATE], ints[at.LINE] = at.BINNED, walls.line_ids[i]
            return


@compiled
def cross_edge(state, ints, air, walls, rules, k):
    """Go over edge k of the current triangle."""
    onward = air.neighbours[ints[at.TRI], k]
    ints[at.FRESH] = 0
    if onward >= 0:
        ints[at.TRI] = onward
    elif onward == -1:
        _at_boundary(state, ints, air, walls, rules, k)
    else:
        ints[at.GAP] = -2 - onward


@compiled
def hop(state, ints, air, walls, rules):
    """Cross at once an edge the granule is on and moves out through. Returns whether it did."""
    tri, worst, edge = ints[at.TRI], 0.0, at.NOBODY
    for k in range(3):
        if barycentric(air.geometry, tri, k, state[at.X], state[at.Y]) <= EDGE:
            bx, by = air.geometry[tri, at.B0X + 2 * k], air.geometry[tri, at.B0Y + 2 * k]
            rate = (bx * state[at.VX] + by * state[at.VY]) / math.sqrt(bx * bx + by * by)
            if rate < worst:
                worst, edge = rate, k
    if edge < 0:
        return False
    ints[at.HOPS] += 1
    cross_edge(state, ints, air, walls, rules, edge)
    return True


@called
def relocate(state, ints, air):
    """The triangle of a granule that has moved without a look at the faces it crossed."""
    triangle, code = walk(air.geometry, air.neighbours, ints[at.TRI], state[at.X], state[at.Y])
    ints[at.TRI] = triangle
    if code <= -2:
        ints[at.GAP] = -2 - code
    elif code == -1:
        ints[at.FATE] = at.ESCAPED
