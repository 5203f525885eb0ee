"""How long the next confined step is. It stays in its triangle, of which it sees every event.

A triangle is often much smaller than the step that the tolerance asks for, and the air seldom far from linear in time
along a track through it: away from walls multi-cell steps (``strides``) do for many triangles what confined steps
would do one by one.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .dense_output import along
from .events import first_below, seen_from
from .jit import called, compiled
from .locate import barycentric, walk
from .step import attempt, exit_time
from .walls import distance

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
def _horizon(state, rules, speed, pull):
    """How long a velocity error may be carried on: to the end, or as long as the flight takes."""
    return min(rules.until - state[at.T], rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300))


@compiled
def confined_step(path, h, state, ints, affine, grain, table, hold, rules, speed, pull):
    """Try steps from h down until the estimated error is within the allowance; returns the step, 0.0 when none is."""
    shortest = ROUND_OFF * rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300)
    horizon = _horizon(state, rules, speed, pull)
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
        found = first_below(path, 0.0, g, at.NOBODY, events.PLANE, cx, cy, q0, bx, by, 0.0, fa, ra, h, fb, rb, EDGE)
        if found >= 0.0 and (found < s or (found == s and fb <= 0.0)):
            s, edge = found, k
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
    found, code = walk(air.geometry, air.neighbours, ints[at.TRI], state[at.X], state[at.Y])
    ints[at.TRI] = found
    if code <= -2:
        ints[at.GAP] = -2 - code
    elif code == -1:
        ints[at.FATE] = at.ESCAPED
