"""How long the next step is: confined to its triangle, of which it sees every event, or a march over several.

A triangle is often much smaller than the step that the tolerance asks for, and the air seldom far from linear in time
along a track through it: away from walls a march (see ``march``) does for many triangles what confined steps would do
one by one.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .dense_output import along
from .events import first_below
from .jit import compiled, inlined
from .locate import barycentric
from .multi_cell import march, way_out
from .step import attempt, exit_time
from .stride import stride

__all__ = ["EDGE", "HOP_LIMIT", "confined_step", "leap", "leaves", "longest_step"]

EDGE = 1e-11  # barycentric distance below which a granule is on an edge
LOOKS = 2.0  # at the air in a confined step
HOP_LIMIT = 60  # crossings of edges or contacts in a row without progress
MOST_PATIENCE = 4  # steps after a march that did not get far are confined, 2, 4 ... 2^this in a row


@inlined
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
            within = exit_time(air.geometry, ints[at.TRI], path, 1e-3)
    if walls.bodies.shape[0] > 0:  # nearly straight where bodies may be met
        x, y = state[at.X], state[at.Y]
        away = max(rules.left - x, x - rules.right, rules.bottom - y, y - rules.top, 0.0) - grain[at.RADIUS]
        half = 0.5 * rules.length + max(away, 0.0)
        slow = speed + math.sqrt(half * pull)
        if slow > 0.0:
            h = min(h, half / slow)
    if (
        ints[at.STUCK] >= HOP_LIMIT
    ):  # too many contacts in no time: a step too short to reach into a wall, without looking
        h = min(h, math.sqrt(rules.skin / (pull + 1e-3 * rules.length)))
    if hold[at.KIND] != at.FREE:
        if hold[at.WW] != 0.0:
            h = min(h, 0.2 / hold[at.WW])
        if hold[at.SAMPLED] != 0.0:  # the wall's acceleration has a kink there
            h = min(h, hold[at.W_END] - state[at.T])
        if hold[at.KIND] == at.ON_VERTEX:
            h = min(h, 0.2 * hold[at.ARM] / (speed + math.sqrt(hold[at.ARM] * pull)))
    return h, within


@compiled
def _allowed(rules, h, speed, fast):
    return rules.allowance * h * max(speed, math.sqrt(fast)) + 1e-15 * rules.extent


@compiled
def _horizon(state, rules, speed, pull):
    """How long a velocity error may be carried on: to the end, or as long as the flight takes."""
    return min(rules.until - state[at.T], rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300))


@inlined
def confined_step(path, h, state, ints, affine, grain, table, hold, rules, speed, pull):
    """Try steps from h down until the estimated error is within the allowance; returns the step, 0.0 when none is."""
    shortest = 1e-13 * rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300)
    horizon = _horizon(state, rules, speed, pull)
    for rejected in range(60):
        error, fast = attempt(path, h, state, ints, affine, grain, table, hold, horizon)
        allowed = _allowed(rules, h, speed, fast)
        if error <= allowed or (h <= shortest and math.isfinite(error)):
            state[at.H_ERROR] = h * min(5.0, 0.9 * (allowed / error) ** (1.0 / 3.0)) if error > 0.0 else math.inf
            return h
        # a velocity transient shorter than the step shrinks the error no faster than the step: then go down quickly
        most = 0.9 if rejected == 0 else (0.5 if rejected < 4 else 0.1)
        h *= max(0.1, most * min(1.0, (allowed / error) ** (1.0 / 3.0))) if math.isfinite(error) else 0.1
    return 0.0


@inlined
def leap(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
    """A stride or a march over several triangles where that is worth it. Returns the steps taken, 0 for none.

    Not in contact, nor with forces made of the air's gradients (they jump at faces). After a stride that was refused
    4, 8 ... 64 triangles are marched, after a march that was cut short the next 1, 2, 4 ... steps are confined.
    """
    if rules.march == 0 or hold[at.KIND] != at.FREE or grain[at.EXTRA] != 0.0 or grain[at.STOKES] == 0.0:
        return 0
    if ints[at.PATIENCE] > 0:
        ints[at.PATIENCE] -= 1
        return 0
    cell, _ = way_out(air.geometry, ints[at.TRI], state[at.X], state[at.Y], state[at.VX], state[at.VY], 0.0, 0.0, 0.0)
    if not drawn and stride(path, cell, state, ints, affine, air, grain, table, walls, rules):
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = ints[at.MARCHES_CUT] = ints[at.STRIDES_REFUSED] = 0
        ints[at.STEPS] += 1
        return 1
    if air.swing[at.SWING_OMEGA] != 0.0:  # faces that move: confined steps
        return 0
    most = 4 if drawn else 4 * 2 ** ints[at.STRIDES_REFUSED]  # triangles till the next stride is tried
    ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, 4)
    left = march(state, ints, affine, air, grain, table, walls, rules, most)
    if left > 2:
        ints[at.MARCHES_CUT] = 0
    else:
        ints[at.PATIENCE] = 2 ** ints[at.MARCHES_CUT]
        ints[at.MARCHES_CUT] = min(ints[at.MARCHES_CUT] + 1, MOST_PATIENCE)
    if left > 0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = 0
        ints[at.STEPS] += left
    return left


@inlined
def leaves(path, h, ints, air):
    """When and across which edge the step leaves the triangle: (time, edge), edge -1 when it does not."""
    g, tri = air.geometry, ints[at.TRI]
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
        found = first_below(
            path,
            0.0,
            g,
            at.NOBODY,
            events.PLANE,
            g[tri, at.CORNER_X],
            g[tri, at.CORNER_Y],
            q0,
            bx,
            by,
            0.0,
            fa,
            ra,
            h,
            fb,
            rb,
            EDGE,
        )
        if found >= 0.0 and (found < s or (found == s and fb <= 0.0)):
            s, edge = found, k
    return s, edge
