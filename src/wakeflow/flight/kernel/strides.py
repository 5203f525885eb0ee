"""The stride: one step over several triangles, for all forces; and strides in a row over intervals of noise.

At a loose tolerance the kinks of the air's interpolant, and the jumps of what is made of its gradients, may be stepped
over: what they add to the force is small, and of another sign from stride to stride. The force is looked up at 1/4,
1/2, 3/4 and the end of the stride; Boole's rule makes the step, and what it differs by from Simpson's is the error that
is judged. Errors of strides add up as independent ones do, so each may have the part of the tolerance that the root of
its way over the flight's gives it.

Where an interval of noise ends before the error asks for an end, the strides that follow look at the air once, at their
end, and judge themselves by how the force bends from one to the next. docs/model.md derives the steps, their errors
and the numbers below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from . import layout as at
from .air import spin_in_curl
from .crossings import first_line, first_wall
from .dense_output import along, along_phis, parabola, phis, sampled, sway
from .dispersion import renew_at
from .history import begin_memory, bend_memory, past_defect, recall_line, remember
from .jit import called, compiled
from .locate import barycentric, cell_size, farthest, find
from .nodes import BOOLE, carried, displaced, excess_in, look_at
from .step import PROGRESS, TRANSIENT, flight_left
from .walls import clearance

STRIDE_SHARE = 1.0  # of the tolerance for strides: the whole of it, since the judged error is that of Simpson's rule
LOOKS = 4.0  # at the air in a stride: it may be as long as four times what changes in time ask for
FIRST = 6.0  # sizes of a triangle: the first stride tried; chosen by experiment
GROWTH = 4.0  # of strides in a row
TRIES = 3  # lengths tried in a row
AROUND = 1.01  # a path is longer than its chord by less than one in a hundred where it is nearly straight
IN_A_ROW = 64  # strides from one interval of noise to the next
ROW_SHARE = 3.0  # times what such a stride's parabola differs by from a straight line: errors of a row have one sign
SKEW = 4.0  # times B h: part of a slip that fades which is no straight line; the same
HOPELESS = 4.0  # times the allowed error: a stride that would have more, did N bend as before, is not tried
AHEAD = 10.0  # ways of strides for which a clearance is looked up
CLOSE = 0.5  # of a body's length, and as much more as walls are away: a path so long is nearly straight
BEFORE_IT = 1.0 - 1e-6  # of the way to a wall, where the stride ends: far from contact, and from where it began
OPEN = -1  # code of an edge of the mesh that nothing covers
OVER, AIMED = 0.5, 0.1  # barycentric distances beyond the mesh's edge: largest and aimed at of the end of a stride
NEWTON = 4  # steps towards that edge; each squares the distance
OFF_EDGE = 0.5  # of a stride: the least that its end on the mesh's edge may leave of it


class Start(NamedTuple):
    """Where a stride begins."""

    curl: float  # 1/s, the vorticity that the granule sees
    speed: float  # m/s
    sx: float  # m/s, slip
    sy: float


class Stages(NamedTuple):
    """What the looks at the force in a stride find out."""

    left: float  # s, about when the path leaves the mesh, a little late; inf: it does not
    tri: int  # the triangle at the end
    fast: float  # m/s, the larger of the speeds at both ends
    curl: float  # 1/s, the mean vorticity that the granule saw
    ox: float  # m/s2, the parabola's defect at 1/4, but for the history force
    oy: float
    mx: float  # and at 3/4
    my: float
    past: float  # m/s2, defect at 3/4 of the history force's own parabola
    bent: float  # m/s2, what the slip's own parabola leaves out there does to it
    relaxed: float  # m, what B, frozen over all of a velocity's transient, displaces
    gx: float  # m/s3, mean slope of N but for what the drag rate changes by
    gy: float


@compiled
def _begin(path, look, state, ints, hold, air, grain, table):
    """Begin the path of a stride in the air ``look`` where the granule is."""
    x, y, vx, vy, t = state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T]
    ints[at.EVALUATIONS] += 1
    path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY] = x, y, vx, vy
    wx, wy, _, _ = sway(path, air.swing, at.SWING_X, t)
    nx, ny, rate, _, _, sx, sy, curl = excess_in(look, state, air, grain, table, vx, vy, t, 0.0, 0.0, 0.0, 0.0, 0.0)
    if grain[at.FORGET] != 0.0:
        ax, ay = begin_memory(path, state, ints, grain, hold, sx + vx, sy + vy, sx, sy)
        nx, ny = nx + ax, ny + ay
    path[at.RATE], path[at.N0X], path[at.N0Y] = rate, nx + rate * (vx + wx), ny + rate * (vy + wy)
    return Start(curl, math.sqrt(vx * vx + vy * vy), sx, sy)


@compiled
def _bend(path, h, stage, s, nx, ny, hx, hy, ex, ey, sx, sy, state, hold, grain):
    """Let N go through what was found in the middle, e at time ``s`` of the stride (``stage`` 1), then also through e
    at its end (2); with (sx, sy) the slip there, n and (hx, hy) force and slip found in the middle.
    """
    remembers = grain[at.FORGET] != 0.0
    if stage == 1:
        if remembers:
            ax, ay = recall_line(path, state, grain, hold, s, sx, sy)
            ex, ey = ex + ax, ey + ay
        path[at.N1X], path[at.N1Y] = (ex - path[at.N0X]) / s, (ey - path[at.N0Y]) / s
        return
    if remembers:
        ax, ay, sx, sy = bend_memory(path, h, state, grain, hold, hx, hy, sx, sy)
        nx, ny, ex, ey = nx + ax, ny + ay, ex + sx, ey + sy
    parabola(path, at.N0X, h, nx, ny, ex, ey)


@compiled
def _fades(path, h, now, vx, vy, sx, sy):
    """What B, frozen, displaces (m) by the end of a stride h (s), with the drag rate ``now`` and the slip there, and
    the mean slope of N (m/s3) but for what B changes by.
    """
    change = math.sqrt((vx - path[at.START_VX]) ** 2 + (vy - path[at.START_VY]) ** 2)
    per = (now - path[at.RATE]) / h
    gx = path[at.N1X] + h * path[at.N2X] - per * sx
    return change * abs(1.0 / path[at.RATE] - 1.0 / now), gx, path[at.N1Y] + h * path[at.N2Y] - per * sy


@compiled
def _left(path, s, geometry, tri, code, x, y):
    """The time, about, when a path that is on (x, y) at time s leaves the mesh, of which ``tri`` is the last triangle;
    s where it does not, or goes a little beyond an open edge: the air of the triangle is taken there.
    """
    if code != OPEN:
        return s if code == 0 else 0.5 * s
    beyond, edge = farthest(geometry, tri, x, y)
    if beyond >= -OVER:
        return s
    before = barycentric(geometry, tri, edge, path[at.START_X], path[at.START_Y])
    if before <= 0.0:
        return 0.5 * s
    bx, by = geometry[tri, at.B0X + 2 * edge], geometry[tri, at.B0Y + 2 * edge]
    aim, turn = before + AIMED, s * (bx * path[at.START_VX] + by * path[at.START_VY])  # a parabola from both ends
    return 2.0 * s * aim / (math.sqrt(turn * turn + 4.0 * aim * (before + turn - beyond)) - turn)


@compiled
def _stages(path, h, ends, start, state, ints, hold, affine, air, grain, table):
    """Look at the force in the middle of a stride h (s), at its end, where the phi functions are ``ends``, at 1/4 and
    at 3/4.
    """
    tri = half_way = last = ints[at.TRI]
    fast, rate, curl = start.speed, path[at.RATE], 7.0 / 90.0 * start.curl  # of the vorticity by Boole's rule
    past = bent = relaxed = ox = oy = nx = ny = hx = hy = gx = gy = 0.0
    path[at.N1X] = path[at.N1Y] = path[at.N2X] = path[at.N2Y] = 0.0
    for stage in range(1, 5):
        s = h * (0.5 * stage if stage < 3 else 0.5 * stage - 1.25)
        p = ends if stage == 2 else phis(-rate * s)
        x, y, vx, vy = along_phis(path, s, p)
        tri, code = find(air, tri if stage < 3 else half_way, x, y)
        left = _left(path, s, air.geometry, tri, code, x, y)
        if left < s:
            return Stages(left, tri, fast, curl, ox, oy, nx, ny, past, bent, relaxed, gx, gy)
        half_way, last = (tri if stage == 1 else half_way), (tri if stage == 2 else last)
        ints[at.EVALUATIONS] += 1
        look = look_at(ints, affine, air, grain, tri, x, y, state[at.T] + s)
        fx, fy = sampled(path, at.N0X, s)
        ex, ey, now, vx, vy, sx, sy, turn = excess_in(
            look, state, air, grain, table, vx, vy, state[at.T] + s, rate, fx, fy, 0.5 * s * p[2], start.curl
        )
        if stage < 3:
            curl += (12.0 / 90.0 if stage == 1 else 7.0 / 90.0) * turn
            _bend(path, h, stage, s, nx, ny, hx, hy, ex, ey, sx, sy, state, hold, grain)
            nx, ny, hx, hy = ex, ey, sx, sy
            if stage == 2:
                fast = max(fast, math.sqrt(vx * vx + vy * vy))
                relaxed, gx, gy = _fades(path, h, now, vx, vy, sx, sy)
            continue
        curl += 32.0 / 90.0 * turn
        nx, ny = ex - fx, ey - fy
        if grain[at.FORGET] != 0.0:  # the history force's own defect is made good by its impulse
            px, py = sampled(path, at.PAST, s)
            nx, ny = nx + px, ny + py
        if stage == 3:
            ox, oy = nx, ny
        elif grain[at.FORGET] != 0.0:
            past, bent, _, _ = past_defect(path, state, grain, hold, s, sx, sy)
    return Stages(math.inf, last, fast, curl, ox, oy, nx, ny, past, bent, relaxed, gx, gy)


@compiled
def _arrive(path, h, clock, tri, end, curl, state, ints, hold, grain):
    """Move the granule to the end of a stride h (s), with its spin and what it remembers; ``clock``: when it has to
    end.
    """
    x, y, vx, vy = end
    if grain[at.MAGNUS] != 0.0:
        state[at.SPIN] = spin_in_curl(grain, state[at.SPIN], curl, h)
    if grain[at.FORGET] != 0.0:
        kick_x, kick_y = remember(path, state, grain, hold, h)
        vx, vy = vx + kick_x, vy + kick_y
    state[at.X], state[at.Y], state[at.VX], state[at.VY] = x, y, vx, vy
    state[at.T] = clock if h == clock - state[at.T] else state[at.T] + h
    ints[at.TRI] = tri


# -- A stride that is judged -------------------------------------------------------------------------------------------
@compiled
def _error(path, h, p, stages, horizon, grain):
    """What a stride h (s) with the phi functions ``p`` at its end may displace (m): by its defects, by a velocity's
    transient, and by the history force.
    """
    rate = path[at.RATE]
    carry = carried(p, rate, h, horizon)
    error = h * displaced(stages.ox, stages.oy, stages.mx, stages.my, carry, rate, h)
    error += stages.relaxed * (rate * h / (rate * h + TRANSIENT)) ** 3
    if grain[at.FORGET] != 0.0:
        error += h * (h * p[2] * stages.past + carry * stages.bent)
    return error


@called
def _first_met(path, h, end, state, ints, grain, walls, rules, free, way):
    """When the granule first meets a wall or a line on a stride h (s) that goes ``way`` (m) at most, with ``free`` room
    (m) where it begins; -1.0: never. Of a path that is too long to be searched, which was not foretold, the end of what
    is searched.
    """
    searched, met = CLOSE * rules.length + free, -1.0
    if way > searched:
        h = met = h * searched / way
        end = along(path, h)
    hit, _, _ = first_wall(path, h, end, state[at.T], grain[at.RADIUS], rules.skin, walls, ints)
    if hit >= 0.0:
        h = met = hit
        end = along(path, h)
    crossed, _ = first_line(path, h, end, state[at.T], walls, rules.skin)
    if hit >= 0.0 or crossed >= 0.0:  # a confined step makes the contact
        ints[at.PATIENCE] = 1
    return crossed if crossed >= 0.0 else met


@called
def _on_edge(path, h, geometry, tri):
    """When a path that ends a little beyond the mesh's edge, at time h (s), crosses it."""
    x, y, vx, vy = along(path, h)
    _, k = farthest(geometry, tri, x, y)
    bx, by, s = geometry[tri, at.B0X + 2 * k], geometry[tri, at.B0Y + 2 * k], h
    for _ in range(NEWTON):
        s -= barycentric(geometry, tri, k, x, y) / (bx * vx + by * vy)
        x, y, vx, vy = along(path, s)
    return s


@compiled
def _end(path, h, p, tri, state, ints, air, grain, walls, rules, free, way):
    """Where a stride h (s), with the phi functions ``p`` there, ends: its time, triangle, place and velocity. That is
    on the mesh's edge where it goes beyond it, and short of a wall or a line that is met before; a time that is not
    above zero: nowhere. There is ``free`` room (m) where it begins.
    """
    end, s = along_phis(path, h, p), h
    tri, code = find(air, tri, end[0], end[1])
    if code == OPEN:
        s = _on_edge(path, h, air.geometry, tri)
        end = along(path, s)
    if not (code == 0 or (code == OPEN and OFF_EDGE * h < s < h)):
        return -1.0, tri, end
    hit = -1.0
    if free <= way and free + clearance(walls, end[0], end[1], grain[at.RADIUS], way) <= way:
        hit = _first_met(path, s, end, state, ints, grain, walls, rules, free, way)
    if 0.0 <= hit <= PROGRESS * h:  # it is at the wall: a confined step makes the contact
        return -1.0, tri, end
    if hit > 0.0:
        s = BEFORE_IT * hit
        end = along(path, s)
        tri, code = find(air, tri, end[0], end[1])
        s = s if code == 0 else -1.0
    return s, tri, end


@compiled
def _land(path, h, p, clock, stages, state, ints, hold, air, grain, walls, rules, free, way):
    """Make good the mean defect of the force, and arrive at the end of a stride h (s). Returns when; a time that is not
    above zero: the granule has not moved.
    """
    path[at.N0X] += BOOLE * (stages.ox + stages.mx)
    path[at.N0Y] += BOOLE * (stages.oy + stages.my)
    s, tri, end = _end(path, h, p, stages.tri, state, ints, air, grain, walls, rules, free, way)
    if s > 0.0:
        _arrive(path, s, clock, tri, end, stages.curl, state, ints, hold, grain)
    return s


@compiled
def _room(h, speed, state, grain, walls, rules):
    """How long (s) a stride of at most h may be so that what it meets is found, and the room (m) where it begins. The
    room at both ends may add up to more than the way: then nothing is met.
    """
    way = AROUND * h * speed
    free = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], way)
    if free < way:
        x, y = state[at.X] + h * state[at.VX], state[at.Y] + h * state[at.VY]
        if free + clearance(walls, x, y, grain[at.RADIUS], way) <= way:
            h = min(h, (CLOSE * rules.length + free) / speed)
    return h, free


@compiled
def stride(path, cell, least, most, state, ints, hold, affine, air, grain, table, walls, rules):
    """Try one stride of ``least`` to ``most`` (s), or to the end of an interval of noise. Returns its length (s; 0:
    the granule has not moved), whether one was refused for its error, and the mean slope (m/s3) of N but for what
    the drag rate changed by.
    """
    t0, speed, known = state[at.T], math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2), state[at.H_STRIDE]
    clock = min(rules.until, state[at.T_NOISE], state[at.T_END] if air.smooth[at.KNOT_RATE] == 0.0 else math.inf)
    wanted = min(FIRST * cell if known == 0.0 else max(known, least), most)
    h, free = _room(min(wanted, clock - t0, LOOKS * rules.coarse), speed, state, grain, walls, rules)
    if not (h >= least or h == state[at.T_NOISE] - t0 > 0.0):
        return 0.0, False, (0.0, 0.0)
    weight = math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2)
    refused, horizon = False, flight_left(state, rules, speed, weight)
    look = look_at(ints, affine, air, grain, ints[at.TRI], state[at.X], state[at.Y], t0)
    start = _begin(path, look, state, ints, hold, air, grain, table)
    for _ in range(TRIES):
        p = phis(-path[at.RATE] * h)
        stages = _stages(path, h, p, start, state, ints, hold, affine, air, grain, table)
        if stages.left < h:
            h = stages.left
            if h < least:
                break
            continue
        way = AROUND * h * stages.fast
        error = _error(path, h, p, stages, horizon, grain)
        allowed = STRIDE_SHARE * rules.allowance * math.sqrt(rules.extent * way)
        if error <= allowed:
            longer = h * min(GROWTH, 0.8 * math.sqrt(math.sqrt(allowed / error))) if error > 0.0 else GROWTH * h
            state[at.H_STRIDE] = max(longer, known) if h < wanted and not refused else longer
            h = _land(path, h, p, clock, stages, state, ints, hold, air, grain, walls, rules, free, way)
            return max(h, 0.0), False, (stages.gx, stages.gy)
        h *= max(0.1, 0.7 * math.sqrt(math.sqrt(allowed / error))) if math.isfinite(error) else 0.1
        refused, known = True, h
        if h < least:
            break
    if refused:
        state[at.H_STRIDE] = max(known, least)
    return 0.0, refused, (0.0, 0.0)


# -- Strides in a row, from one interval of noise to the next ----------------------------------------------------------
@compiled
def _one_look(path, h, p, slope, before, start, look, state, ints, hold, air, grain, table):
    """The rest of a path of h (s) from one look at its end; ``p``: phi functions there. Returns the mean slope (m/s3)
    of N but for what drag's rate changes by, half of what bends it (m/s4), and the vorticity at the end (1/s).

    N is the sum of a parabola that goes on with the ``slope`` that it had on the stride ``before`` (s) this one, and of
    the change of drag's rate times the slip, both straight lines: where the noise jumps a slip begins to fade, and that
    part begins anew.
    """
    _, _, vx, vy = along_phis(path, h, p)
    fx, fy = path[at.N0X] + h * path[at.N1X], path[at.N0Y] + h * path[at.N1Y]
    nx, ny, rate, _, _, sx, sy, curl = excess_in(
        look, state, air, grain, table, vx, vy, state[at.T] + h, path[at.RATE], fx, fy, h * p[2], start.curl
    )
    per, change = 1.0 / h, rate - path[at.RATE]
    gx, gy = (nx - path[at.N0X] - change * sx) * per, (ny - path[at.N0Y] - change * sy) * per
    if grain[at.FORGET] != 0.0:
        ax, ay = recall_line(path, state, grain, hold, h, sx, sy)
        ax, ay = (ax - path[at.PAST]) * per, (ay - path[at.PAST + 1]) * per
        path[at.PAST + 2], path[at.PAST + 3] = ax, ay
        gx, gy = gx + ax, gy + ay
    bx, by = (gx - slope[0]) / (h + before), (gy - slope[1]) / (h + before)
    change *= per
    fx, fy = change * (sx - start.sx) * per, change * (sy - start.sy) * per
    path[at.N1X], path[at.N1Y] = gx - h * bx + change * start.sx, gy - h * by + change * start.sy
    path[at.N2X], path[at.N2Y] = bx + fx, by + fy
    fades = min(1.0, SKEW * path[at.RATE] * h)
    return (gx, gy), math.sqrt(bx * bx + by * by) + fades * math.sqrt(fx * fx + fy * fy), curl


@compiled
def onward(path, before, slope, state, ints, hold, affine, air, grain, table, walls, rules):
    """Strides over the next intervals of noise with one look each, after a stride of ``before`` (s) and the mean
    ``slope`` that ``stride`` tells, for as long as what the parabola of each differs by from a straight line is small.
    Returns how many.
    """
    end = rules.until if air.smooth[at.KNOT_RATE] != 0.0 else min(rules.until, state[at.T_END])
    bend, free = math.sqrt(path[at.N2X] ** 2 + path[at.N2Y] ** 2), 0.0
    weight = math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2)
    horizon = flight_left(state, rules, math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2), weight)
    look = look_at(ints, affine, air, grain, ints[at.TRI], state[at.X], state[at.Y], state[at.T])
    for taken in range(IN_A_ROW):
        if state[at.T] != state[at.T_NOISE] or not state[at.T] < end:
            return taken
        renew_at(look, ints[at.TRI], state[at.X], state[at.Y], state, ints, air, grain, table, rules)
        clock = min(end, state[at.T_NOISE])
        h = clock - state[at.T]
        start = _begin(path, look, state, ints, hold, air, grain, table)
        p = phis(-path[at.RATE] * h)
        # Displacement by a part of N that is 1 m/s4 times s (s - h), over the allowed one
        amiss = ROW_SHARE * h * h * h / 6.0 * carried(p, path[at.RATE], h, horizon)
        amiss /= STRIDE_SHARE * rules.allowance * math.sqrt(rules.extent * AROUND * h * start.speed)
        if h > LOOKS * rules.coarse or amiss * bend > HOPELESS:
            return taken
        path[at.N1X], path[at.N1Y] = slope
        path[at.N2X] = path[at.N2Y] = 0.0
        x, y, _, _ = along_phis(path, h, p)
        tri, code = find(air, ints[at.TRI], x, y)
        if code != 0:
            return taken
        ints[at.EVALUATIONS] += 1
        look = look_at(ints, affine, air, grain, tri, x, y, clock)
        slope, bend, curl = _one_look(path, h, p, slope, before, start, look, state, ints, hold, air, grain, table)
        if not amiss * bend <= 1.0:
            return taken
        last = along_phis(path, h, p)
        way = AROUND * h * max(start.speed, math.sqrt(last[2] * last[2] + last[3] * last[3]))
        if free <= way:
            free = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], AHEAD * way)
        s, tri, last = _end(path, h, p, tri, state, ints, air, grain, walls, rules, free, way)
        if s != h:
            return taken
        free, before = free - way, h
        _arrive(path, h, clock, tri, last, 0.5 * (start.curl + curl), state, ints, hold, grain)
    return IN_A_ROW


# -- When strides are tried in place of many confined steps (``step``) -----------------------------------------
MIN_STRIDE = 0.5  # sizes of a triangle: its mean chord, and so as far as a confined step goes
MAX_STRIDE = 60.0  # the same: a longer stride may look at nothing of what it passes
DRAWN_STRIDE = 4.0  # the same, of a granule whose path is drawn
MAX_CONFINED = 3  # steps after a stride that was refused are confined, 1, 2, 4 ... 2^this in a row


@compiled
def multi_cell_step(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
    """Strides over several triangles where that is worth it. Returns whether there was one.

    Not in contact: what is past has no value there. After a stride that was refused for its error 1, 2, 4, 8 steps are
    confined before the next is tried.
    """
    if rules.march == 0 or hold[at.KIND] != at.FREE or grain[at.STOKES] == 0.0:
        return False
    if grain[at.FORGET] != 0.0 and ints[at.STEPS] == 0:  # its memories begin
        return False
    if ints[at.PATIENCE] > 0:
        ints[at.PATIENCE] -= 1
        return False
    cell = cell_size(air.geometry, ints[at.TRI]) / math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2)
    least, most = MIN_STRIDE * cell, (DRAWN_STRIDE if drawn else MAX_STRIDE) * cell
    h, refused, slope = stride(path, cell, least, most, state, ints, hold, affine, air, grain, table, walls, rules)
    if h > 0.0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = ints[at.STRIDES_REFUSED] = 0
        ints[at.STEPS] += 1
        if grain[at.NOISE] != 0.0 and not drawn:
            ints[at.STEPS] += onward(path, h, slope, state, ints, hold, affine, air, grain, table, walls, rules)
        return True
    if refused:
        ints[at.PATIENCE] = 2 ** ints[at.STRIDES_REFUSED]
        ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, MAX_CONFINED)
    return False
