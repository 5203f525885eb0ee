"""Strides: one step over several triangles, wherever the faces between them lie.

At a loose tolerance the kinks of the air's interpolant may be stepped over: what they add to the force is small, and of
another sign from stride to stride. The force is looked up at 1/4, 1/2, 3/4 and the end of the stride; Boole's rule
makes the step, and what it differs by from Simpson's is the error that is judged. Errors of strides add up as
independent ones do, so each may have the part of the tolerance that the root of its way over the flight's gives it.
"""

from __future__ import annotations

import math

from . import layout as at
from .dense_output import along, phis, sway
from .jit import inlined
from .locate import walk
from .multi_cell import BOOLE, ODD, clearance, excess

__all__ = ["stride"]

SAFE = 1.0  # of the tolerance for strides
FEWEST = 3.0  # triangles: a shorter stride is better marched
MOST = 60.0  # triangles: the way to the stages is made on foot
LOOKS = 4.0  # at the air in a stride
FIRST = 12.0  # triangles of the first stride tried


@inlined
def stride(path, cell, state, ints, affine, air, grain, table, walls, rules):
    """Try one stride; ``cell`` (s) is about the time within this triangle. Returns whether the granule has moved."""
    t0 = state[at.T]
    clock = min(rules.until, state[at.T_NOISE], state[at.T_END] if air.smooth[at.KNOT_RATE] == 0.0 else math.inf)
    h = FIRST * cell if state[at.H_STRIDE] == 0.0 else min(state[at.H_STRIDE], MOST * cell)
    h = min(h, clock - t0, LOOKS * rules.coarse)
    speed = math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2)
    fall = math.sqrt(rules.extent * math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2))
    horizon = min(rules.until - t0, rules.extent / (speed + fall + 1e-300))
    path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY], path[at.RATE] = (
        state[at.X],
        state[at.Y],
        state[at.VX],
        state[at.VY],
        0.0,
    )
    wx, wy, _, _ = sway(path, air.swing, at.SWING_X, t0)
    rate = n0x = n0y = nx = ny = mx = my = ox = oy = 0.0
    for attempt in range(3):
        if h < FEWEST * cell:
            break
        tri, code, fast, stage = ints[at.TRI], 0, speed, 0 if attempt == 0 else 1
        path[at.N1X] = path[at.N1Y] = path[at.N2X] = path[at.N2Y] = 0.0
        while stage < 5:  # the start, the middle, the end, 1/4, 3/4
            s = h * (0.5 * stage if stage < 3 else 0.5 * stage - 1.25)
            x, y, vx, vy = along(path, s)
            tri, code = walk(air.geometry, air.neighbours, tri, x, y)
            if code != 0:
                break
            _, _, p2, _, _ = phis(-rate * s)
            fx = path[at.N0X] + s * (path[at.N1X] + s * path[at.N2X])
            fy = path[at.N0Y] + s * (path[at.N1Y] + s * path[at.N2Y])
            ex, ey, now, vx, vy = excess(
                state, ints, affine, air, grain, table, tri, x, y, vx, vy, t0 + s, rate, fx, fy, 0.5 * s * p2
            )
            if stage == 0:
                rate = now
                n0x, n0y = ex + rate * (vx + wx), ey + rate * (vy + wy)
                path[at.RATE], path[at.N0X], path[at.N0Y] = rate, n0x, n0y
            elif stage == 1:
                nx, ny = ex, ey
                path[at.N1X], path[at.N1Y] = (nx - n0x) / s, (ny - n0y) / s
            elif stage == 2:
                mx, my, fast = ex, ey, max(speed, math.sqrt(vx * vx + vy * vy))
                path[at.N1X], path[at.N1Y] = (4.0 * nx - 3.0 * n0x - mx) / h, (4.0 * ny - 3.0 * n0y - my) / h
                path[at.N2X], path[at.N2Y] = (
                    2.0 * (n0x - 2.0 * nx + mx) / (h * h),
                    2.0 * (n0y - 2.0 * ny + my) / (h * h),
                )
            elif stage == 3:
                ox, oy = ex - fx, ey - fy
            else:
                nx, ny = ex - fx, ey - fy
            stage += 1
        if code != 0 or stage < 5:
            h *= 0.5
            continue
        _, p1, p2, _, _ = phis(-rate * h)
        carried = h * p2 + p1 * min(1.0 / rate, horizon)
        even, odd = math.sqrt((ox + nx) ** 2 + (oy + ny) ** 2), math.sqrt((ox - nx) ** 2 + (oy - ny) ** 2)
        error = h * (BOOLE * carried * even + ODD * h / (1.0 + rate * h) * odd)
        way = 1.01 * h * fast
        allowed = SAFE * rules.allowance * math.sqrt(rules.extent * way)
        if not error <= allowed:
            h *= max(0.1, 0.7 * math.sqrt(allowed / error)) if math.isfinite(error) else 0.1
            continue
        x, y, vx, vy = along(path, h)
        cx, cy = BOOLE * (ox + nx), BOOLE * (oy + ny)
        x, y = x + h * h * p2 * cx, y + h * h * p2 * cy
        tri, code = walk(air.geometry, air.neighbours, tri, x, y)
        free = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], way)
        if code == 0:  # nothing is met if the distances before and after add up to more than the way
            free += clearance(walls, x, y, grain[at.RADIUS], way)
        if code != 0 or free <= way:
            h *= 0.5
            continue
        state[at.X], state[at.Y], state[at.VX], state[at.VY] = x, y, vx + h * p1 * cx, vy + h * p1 * cy
        state[at.T] = clock if h == clock - t0 else t0 + h
        ints[at.TRI] = tri
        state[at.H_STRIDE] = h * min(2.0, 0.8 * math.sqrt(allowed / error)) if error > 0.0 else 2.0 * h
        return True
    state[at.H_STRIDE] = max(h, FEWEST * cell)
    return False
