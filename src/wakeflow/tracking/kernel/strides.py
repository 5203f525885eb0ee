"""The stride: one step over several triangles, for all forces; and strides in a row over intervals of noise.

At a loose tolerance the kinks of the air's interpolant, and the jumps of what is made of its gradients, may be stepped
over: what they add to the force is small, and of another sign from stride to stride. The force is looked up at 1/4,
1/2, 3/4 and the end of the stride; Boole's rule makes the step, and what it differs by from Simpson's is the error that
is judged. Errors of strides add up as independent ones do, so each may have the part of the tolerance that the root of
its way over the flight's gives it.

Where an interval of noise ends before the error asks for an end, the next few strides are not judged: they look at the
air in their middle and at their end. docs/kernel.md derives the step, its error and the numbers below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from . import layout as at
from .dense_output import along, parabola, phis, sway
from .dispersion import renew_at
from .forces import spin_in_curl
from .history import begin_memory, bend_memory, recall, recall_line, remember, sampled
from .jit import inlined
from .locate import walk
from .nodes import BOOLE, LocalAir, carried, displaced, excess_in, look_at
from .step import TRANSIENT
from .walls import clearance

STRIDE_SHARE = 1.0  # of the tolerance for strides: the whole of it, since the judged error is that of Simpson's rule
LOOKS = 4.0  # at the air in a stride: it may be as long as four times what changes in time ask for
FIRST = 12.0  # triangles of the first stride tried; chosen by experiment
GROWTH = 2.0  # of strides in a row
TRIES = 3  # lengths tried in a row
AROUND = 1.01  # a path is longer than its chord by less than one in a hundred where it is nearly straight
UNJUDGED = 4  # strides in a row whose error is not looked at, after one whose was
AHEAD = 10.0  # ways of such strides for which a clearance is looked up


class Start(NamedTuple):
    """Where a stride begins."""

    curl: float  # 1/s, the vorticity that the granule sees
    speed: float  # m/s


class Stages(NamedTuple):
    """What the looks at the force in a stride find out."""

    met: bool  # whether all lay in the mesh
    tri: int  # the last triangle
    look: LocalAir  # the air there
    fast: float  # m/s, the larger of the speeds at both ends
    curl: float  # 1/s, the mean vorticity that the granule saw
    ox: float  # m/s2, the parabola's defect at 1/4, but for the history force
    oy: float
    mx: float  # and at 3/4
    my: float
    past: float  # m/s2, defect at 3/4 of the history force's own parabola
    bent: float  # m/s2, what the slip's own parabola leaves out there does to it
    relaxed: float  # m, what B, frozen over all of a velocity's transient, displaces


@inlined
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
    return Start(curl, math.sqrt(vx * vx + vy * vy))


@inlined
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
    parabola(path, h, nx, ny, ex, ey)


@inlined
def _past(path, s, state, hold, grain, sx, sy):
    """Defects at time s of the stride of the history force's own parabola, and of the slip's, in what that is to it."""
    ax, ay, grows = recall(path, state, grain, hold, s)
    px, py = sampled(path, at.PAST, s)
    qx, qy = sampled(path, at.SLIP, s)
    bent = grows * math.sqrt((sx - qx) ** 2 + (sy - qy) ** 2)
    return math.sqrt((ax - px) ** 2 + (ay - py) ** 2), bent


@inlined
def _stages(path, h, last, start, look, state, ints, hold, affine, air, grain, table):
    """Look at the force in the middle and at the end of a stride h (s), where ``last`` is 4 also at 1/4 and 3/4."""
    tri, fast, rate = ints[at.TRI], start.speed, path[at.RATE]
    past = bent = relaxed = ox = oy = nx = ny = hx = hy = 0.0
    # Of the vorticity at the ends and in the middle: Simpson's rule, or Boole's
    outer, middle = (1.0 / 6.0, 4.0 / 6.0) if last == 2 else (7.0 / 90.0, 12.0 / 90.0)
    curl = outer * start.curl
    path[at.N1X] = path[at.N1Y] = path[at.N2X] = path[at.N2Y] = 0.0
    for stage in range(1, last + 1):
        s = h * (0.5 * stage if stage < 3 else 0.5 * stage - 1.25)
        x, y, vx, vy = along(path, s)
        tri, code = walk(air.geometry, air.neighbours, tri, x, y)
        if code != 0:
            return Stages(False, tri, look, fast, curl, ox, oy, nx, ny, past, bent, relaxed)
        ints[at.EVALUATIONS] += 1
        look = look_at(ints, affine, air, grain, tri, x, y, state[at.T] + s)
        fx = path[at.N0X] + s * (path[at.N1X] + s * path[at.N2X])
        fy = path[at.N0Y] + s * (path[at.N1Y] + s * path[at.N2Y])
        gain = 0.5 * s * phis(-rate * s)[2]
        ex, ey, now, vx, vy, sx, sy, turn = excess_in(
            look, state, air, grain, table, vx, vy, state[at.T] + s, rate, fx, fy, gain, start.curl
        )
        if stage < 3:
            curl += (middle if stage == 1 else outer) * turn
            _bend(path, h, stage, s, nx, ny, hx, hy, ex, ey, sx, sy, state, hold, grain)
            nx, ny, hx, hy = ex, ey, sx, sy
            if stage == 2:
                fast = max(fast, math.sqrt(vx * vx + vy * vy))
                change = math.sqrt((vx - path[at.START_VX]) ** 2 + (vy - path[at.START_VY]) ** 2)
                relaxed = change * abs(1.0 / rate - 1.0 / now)
            continue
        curl += 32.0 / 90.0 * turn
        nx, ny = ex - fx, ey - fy
        if grain[at.FORGET] != 0.0:  # the history force's own defect is made good by its impulse
            px, py = sampled(path, at.PAST, s)
            nx, ny = nx + px, ny + py
        if stage == 3:
            ox, oy = nx, ny
        elif grain[at.FORGET] != 0.0:
            past, bent = _past(path, s, state, hold, grain, sx, sy)
    return Stages(True, tri, look, fast, curl, ox, oy, nx, ny, past, bent, relaxed)


@inlined
def _arrive(path, h, clock, tri, x, y, vx, vy, curl, state, ints, hold, grain):
    """Move the granule to the end of a stride h (s), with its spin and what it remembers; ``clock``: when it has to
    end.
    """
    if grain[at.MAGNUS] != 0.0:
        state[at.SPIN] = spin_in_curl(grain, state[at.SPIN], curl, h)
    if grain[at.FORGET] != 0.0:
        kick_x, kick_y = remember(path, state, grain, hold, h)
        vx, vy = vx + kick_x, vy + kick_y
    state[at.X], state[at.Y], state[at.VX], state[at.VY] = x, y, vx, vy
    state[at.T] = clock if h == clock - state[at.T] else state[at.T] + h
    ints[at.TRI] = tri


# -- A stride that is judged -------------------------------------------------------------------------------------------
@inlined
def _error(path, h, found, horizon, grain):
    """What a stride h (s) may displace (m): by its defects, by a velocity's transient, and by the history force."""
    rate = path[at.RATE]
    carry = carried(rate, h, horizon)
    error = h * displaced(found.ox, found.oy, found.mx, found.my, carry, rate, h)
    error += found.relaxed * (rate * h / (rate * h + TRANSIENT)) ** 3
    if grain[at.FORGET] != 0.0:
        error += h * (h * phis(-rate * h)[2] * found.past + carry * found.bent)
    return error


@inlined
def _landing(path, h, found, state, air, grain, walls, way):
    """Where a stride h (s) ends, with the mean defect of the force made good, and whether it is in the mesh and
    nothing can have been met on the way: nothing is if the distances before and after add up to more than the way.
    """
    cx, cy = BOOLE * (found.ox + found.mx), BOOLE * (found.oy + found.my)
    _, p1, p2, _, _ = phis(-path[at.RATE] * h)
    x, y, vx, vy = along(path, h)
    x, y = x + h * h * p2 * cx, y + h * h * p2 * cy
    tri, code = walk(air.geometry, air.neighbours, found.tri, x, y)
    free = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], way)
    if code == 0:
        free += clearance(walls, x, y, grain[at.RADIUS], way)
    return tri, x, y, vx + h * p1 * cx, vy + h * p1 * cy, not (code != 0 or free <= way)


@inlined
def _room(h, least, speed, state, grain, walls):
    """The longest stride (s), at most h, on whose way nothing can be met if it is straight; 0: none of ``least``."""
    x, y, radius = state[at.X], state[at.Y], grain[at.RADIUS]
    free = clearance(walls, x, y, radius, AROUND * h * speed)
    for _ in range(3):
        way = AROUND * h * speed
        if free >= way or free + clearance(walls, x + h * state[at.VX], y + h * state[at.VY], radius, way) > way:
            return h
        h = (2.0 if 2.0 * free < way else 1.0) * free / (AROUND * speed)  # along the wall, towards it
        if h < least:
            break
    return 0.0


@inlined
def stride(path, cell, least, most, state, ints, hold, affine, air, grain, table, walls, rules):
    """Try one stride of ``least`` to ``most`` (s), or to the end of an interval of noise. Returns how long the next may
    be (s; 0: the granule has not moved), and whether one was refused for its error.
    """
    t0, speed, known = state[at.T], math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2), state[at.H_STRIDE]
    clock = min(rules.until, state[at.T_NOISE], state[at.T_END] if air.smooth[at.KNOT_RATE] == 0.0 else math.inf)
    asked = min(FIRST * cell if known == 0.0 else known, most)
    h = _room(min(asked, clock - t0, LOOKS * rules.coarse), least, speed, state, grain, walls)
    refused = 0.0 < known < least
    if not (h >= least or h == state[at.T_NOISE] - t0 > 0.0):
        if refused:
            state[at.H_STRIDE] = least
        return 0.0, refused
    fall = math.sqrt(rules.extent * math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2))
    horizon = min(rules.until - t0, rules.extent / (speed + fall + 1e-300))
    look = look_at(ints, affine, air, grain, ints[at.TRI], state[at.X], state[at.Y], t0)
    start = _begin(path, look, state, ints, hold, air, grain, table)
    for _ in range(TRIES):
        found = _stages(path, h, 4, start, look, state, ints, hold, affine, air, grain, table)
        way, shorter = AROUND * h * found.fast, 0.5
        if found.met:
            error = _error(path, h, found, horizon, grain)
            allowed = STRIDE_SHARE * rules.allowance * math.sqrt(rules.extent * way)
            if error <= allowed:
                tri, x, y, vx, vy, clear = _landing(path, h, found, state, air, grain, walls, way)
                if clear:
                    _arrive(path, h, clock, tri, x, y, vx, vy, found.curl, state, ints, hold, grain)
                    longer = h * min(GROWTH, 0.8 * math.sqrt(allowed / error)) if error > 0.0 else GROWTH * h
                    state[at.H_STRIDE] = max(longer, known) if h < asked and not refused else longer
                    plain = rules.allowance * way  # no mean defect is made good: errors add up
                    return (h * min(GROWTH, 0.8 * math.sqrt(plain / error)) if error > 0.0 else GROWTH * h), False
            else:
                shorter, refused = max(0.1, 0.7 * math.sqrt(allowed / error)) if math.isfinite(error) else 0.1, True
                known = shorter * h
        h *= shorter
        if h < least:
            break
    if refused:
        state[at.H_STRIDE] = max(known, least)
    return 0.0, refused


# -- Strides that are not judged ---------------------------------------------------------------------------------------
@inlined
def onward(path, longest, state, ints, hold, affine, air, grain, table, walls, rules):
    """Strides over the next intervals of noise, each at most ``longest`` (s) and not judged. Returns how many."""
    end = rules.until if air.smooth[at.KNOT_RATE] != 0.0 else min(rules.until, state[at.T_END])
    free = 0.0
    look = look_at(ints, affine, air, grain, ints[at.TRI], state[at.X], state[at.Y], state[at.T])
    for taken in range(UNJUDGED):
        if state[at.T] != state[at.T_NOISE] or not state[at.T] < end:
            return taken
        renew_at(look, state, ints, air, grain, table, rules)
        clock = min(end, state[at.T_NOISE])
        h = clock - state[at.T]
        if h > longest:
            return taken
        start = _begin(path, look, state, ints, hold, air, grain, table)
        found = _stages(path, h, 2, start, look, state, ints, hold, affine, air, grain, table)
        x, y, vx, vy = along(path, h)
        tri, code = walk(air.geometry, air.neighbours, found.tri, x, y)
        way = AROUND * h * found.fast
        if not (found.met and code == 0):
            return taken
        if free <= way:
            free = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], AHEAD * way)
            if free <= way:
                return taken
        free -= way
        look = look_at(ints, affine, air, grain, tri, x, y, clock)
        _arrive(path, h, clock, tri, x, y, vx, vy, found.curl, state, ints, hold, grain)
    return UNJUDGED
