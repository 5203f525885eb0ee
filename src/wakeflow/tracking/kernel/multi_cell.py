"""Multi-cell steps: many triangles in one go where no wall is near.

At a loose tolerance the kinks of the air's interpolant may be stepped over: what they add to the force is small, and of
another sign from stride to stride. The force is looked up at 1/4, 1/2, 3/4 and the end of the stride; Boole's rule
makes the step, and what it differs by from Simpson's is the error that is judged. Errors of strides add up as
independent ones do, so each may have the part of the tolerance that the root of its way over the flight's gives it.
docs/kernel.md derives the step, its error and the numbers below.

There are two. A *march* (``face_to_face``) ends its steps on the faces of the triangles and judges its error in some of
them; a *stride* (``across_faces``) is one step over several triangles. Confined steps (``step_control``) do the rest.
"""

from __future__ import annotations

import math

from . import layout as at
from .dense_output import along, parabola, phis, sway
from .face_to_face import march, way_out
from .jit import inlined
from .locate import walk
from .nodes import BOOLE, carried, displaced, excess
from .walls import clearance

# -- The stride --------------------------------------------------------------------------------------------------------
STRIDE_SHARE = 1.0  # of the tolerance for strides: the whole of it, since the judged error is that of Simpson's rule
MIN_STRIDE = 3.0  # triangles: a shorter stride is better marched, which takes one look a triangle and no more
MAX_STRIDE = 60.0  # triangles: the way to the stages is made on foot
LOOKS = 4.0  # at the air in a stride: it may be as long as four times what changes in time ask for
FIRST = 12.0  # triangles of the first stride tried; chosen by experiment
TRIES = 3  # lengths tried in a row
AROUND = 1.01  # a path is longer than its chord by less than one in a hundred where it is nearly straight


@inlined
def _longest(cell, state, air, rules):
    """When the stride has to end (s on the granule's clock), and its length to try first (s)."""
    clock = min(rules.until, state[at.T_NOISE], state[at.T_END] if air.smooth[at.KNOT_RATE] == 0.0 else math.inf)
    h = FIRST * cell if state[at.H_STRIDE] == 0.0 else min(state[at.H_STRIDE], MAX_STRIDE * cell)
    return clock, min(h, clock - state[at.T], LOOKS * rules.coarse)


@inlined
def _stages(path, h, first, state, ints, affine, air, grain, table, speed, wx, wy):
    """Look at the force at the start, where it is the ``first`` time, in the middle, at the end, at 1/4 and at 3/4 of a
    stride h (s). Returns the last triangle, the largest speed, the defects at 1/4 and 3/4, and whether all lay in the
    mesh. (wx, wy): velocity of a mesh that swings, at the start.
    """
    tri, fast = ints[at.TRI], speed
    ox = oy = nx = ny = 0.0
    path[at.N1X] = path[at.N1Y] = path[at.N2X] = path[at.N2Y] = 0.0
    for stage in range(0 if first else 1, 5):
        s = h * (0.5 * stage if stage < 3 else 0.5 * stage - 1.25)
        x, y, vx, vy = along(path, s)
        tri, code = walk(air.geometry, air.neighbours, tri, x, y)
        if code != 0:
            return tri, fast, ox, oy, nx, ny, False
        rate = path[at.RATE]
        _, _, p2, _, _ = phis(-rate * s)
        fx = path[at.N0X] + s * (path[at.N1X] + s * path[at.N2X])
        fy = path[at.N0Y] + s * (path[at.N1Y] + s * path[at.N2Y])
        ex, ey, now, vx, vy = excess(
            state, ints, affine, air, grain, table, tri, x, y, vx, vy, state[at.T] + s, rate, fx, fy, 0.5 * s * p2
        )
        if stage == 0:
            path[at.RATE], path[at.N0X], path[at.N0Y] = now, ex + now * (vx + wx), ey + now * (vy + wy)
        elif stage == 1:
            nx, ny = ex, ey
            path[at.N1X], path[at.N1Y] = (nx - path[at.N0X]) / s, (ny - path[at.N0Y]) / s
        elif stage == 2:
            fast = max(speed, math.sqrt(vx * vx + vy * vy))
            parabola(path, h, nx, ny, ex, ey)
        elif stage == 3:
            ox, oy = ex - fx, ey - fy
        else:
            nx, ny = ex - fx, ey - fy
    return tri, fast, ox, oy, nx, ny, True


@inlined
def _landing(path, h, tri, cx, cy, state, air, grain, walls, way):
    """Where a stride h (s) ends, with the mean defect c of the force made good, and whether it is in the mesh and
    nothing can have been met on the way: nothing is if the distances before and after add up to more than the way.
    """
    _, p1, p2, _, _ = phis(-path[at.RATE] * h)
    x, y, vx, vy = along(path, h)
    x, y = x + h * h * p2 * cx, y + h * h * p2 * cy
    tri, code = walk(air.geometry, air.neighbours, tri, x, y)
    free = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], way)
    if code == 0:
        free += clearance(walls, x, y, grain[at.RADIUS], way)
    return tri, x, y, vx + h * p1 * cx, vy + h * p1 * cy, not (code != 0 or free <= way)


@inlined
def stride(path, cell, state, ints, affine, air, grain, table, walls, rules):
    """Try one stride; ``cell`` (s) is about the time within this triangle. Returns whether the granule has moved."""
    t0 = state[at.T]
    clock, h = _longest(cell, state, air, rules)
    speed = math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2)
    fall = math.sqrt(rules.extent * math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2))
    horizon = min(rules.until - t0, rules.extent / (speed + fall + 1e-300))
    path[at.START_X], path[at.START_Y], path[at.START_VX] = state[at.X], state[at.Y], state[at.VX]
    path[at.START_VY], path[at.RATE] = state[at.VY], 0.0
    wx, wy, _, _ = sway(path, air.swing, at.SWING_X, t0)
    for attempt in range(TRIES):
        if h < MIN_STRIDE * cell:
            break
        tri, fast, ox, oy, nx, ny, met = _stages(
            path, h, attempt == 0, state, ints, affine, air, grain, table, speed, wx, wy
        )
        if not met:
            h *= 0.5
            continue
        rate, way = path[at.RATE], AROUND * h * fast
        error = h * displaced(ox, oy, nx, ny, carried(rate, h, horizon), rate, h)
        allowed = STRIDE_SHARE * rules.allowance * math.sqrt(rules.extent * way)
        if not error <= allowed:
            h *= max(0.1, 0.7 * math.sqrt(allowed / error)) if math.isfinite(error) else 0.1
            continue
        cx, cy = BOOLE * (ox + nx), BOOLE * (oy + ny)
        tri, x, y, vx, vy, clear = _landing(path, h, tri, cx, cy, state, air, grain, walls, way)
        if not clear:
            h *= 0.5
            continue
        state[at.X], state[at.Y], state[at.VX], state[at.VY] = x, y, vx, vy
        state[at.T] = clock if h == clock - t0 else t0 + h
        ints[at.TRI] = tri
        state[at.H_STRIDE] = h * min(2.0, 0.8 * math.sqrt(allowed / error)) if error > 0.0 else 2.0 * h
        return True
    state[at.H_STRIDE] = max(h, MIN_STRIDE * cell)
    return False


# -- Multi-cell steps --------------------------------------------------------------------------------------------------
MAX_PATIENCE = 4  # steps after a march that did not get far are confined, 1, 2, 4 ... 2^this in a row
FIRST_MARCH = 4  # triangles of the first march after a stride, and of all of a granule whose path is drawn
MAX_DOUBLINGS = 4  # of the triangles of a march from one refused stride to the next
WORTHWHILE_MARCH = 2  # triangles: a march that left more behind was worth it


@inlined
def multi_cell_step(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
    """A stride or a march over several triangles where that is worth it. Returns the steps taken, 0 for none.

    Not in contact, nor with forces made of the air's gradients (they jump at faces) or of the past. After a stride that
    was refused 4, 8 ... 64 triangles are marched, after a march that was cut short the next 1, 2, 4 ... steps are
    confined.
    """
    if rules.march == 0 or hold[at.KIND] != at.FREE or grain[at.STOKES] == 0.0:
        return 0
    if grain[at.EXTRA] != 0.0 or grain[at.FORGET] != 0.0:
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
    most = (
        FIRST_MARCH if drawn else FIRST_MARCH * 2 ** ints[at.STRIDES_REFUSED]
    )  # triangles till the next stride is tried
    ints[at.STRIDES_REFUSED] = min(ints[at.STRIDES_REFUSED] + 1, MAX_DOUBLINGS)
    left = march(state, ints, affine, air, grain, table, walls, rules, most)
    if left > WORTHWHILE_MARCH:
        ints[at.MARCHES_CUT] = 0
    else:
        ints[at.PATIENCE] = 2 ** ints[at.MARCHES_CUT]
        ints[at.MARCHES_CUT] = min(ints[at.MARCHES_CUT] + 1, MAX_PATIENCE)
    if left > 0:
        ints[at.FRESH] = ints[at.HOPS] = ints[at.STUCK] = 0
        ints[at.STEPS] += left
    return left
