"""The march: from face to face through many triangles, at one or two looks at the air a triangle.

In a triangle the air is affine, at its faces continuous. An exponential step from face to face therefore loses no order
at the kinks, and can take the force at a face from the step before; what the confined steps spend on events, on loading
triangles and on a third-order step with an error of its own is left out, or done for one triangle in a few.
With B the drag rate at the last face, N = F + B v is linear through a triangle, its slope foretold by that in the last
one; or quadratic, once its middle was found too far off that (``face_stages``). docs/kernel.md derives the step, its
error and the numbers below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from . import layout as at
from .dense_output import phis
from .face_stages import Bend, Face, Limits, along_bend, triangle_stages
from .jit import compiled, inlined
from .locate import barycentric
from .nodes import excess
from .walls import clearance

SAMPLED = 4  # the error is looked at in every so many triangles: chosen by experiment for speed
LONGER = 1.3  # than in the last triangle looked at: look again, since the error of a third-order step has doubled
AHEAD = 10.0  # triangles for which a clearance is looked up: one look in ten where nothing is near
KEEP = 0.1  # of the error allowed: with less bend than that the next march begins linear
ON_FACE = 1e-7  # barycentric distance at which a face is met: far below any allowance, far above round-off
BEYOND = -1e-4  # barycentric distance at which a triangle does not hold a point any more: a path that was too bent
FLAT = 1e-9  # of the extent: a shorter way through a triangle is a corner cut
MAX_CUTS = 6  # corners cut in a row: about as many triangles as meet in a node
NEWTON = 4  # steps towards a face; each squares the distance, so that three are enough where one is
OFF_FACE = 0.1  # of the step by which its end may still be moved to be on the face
AROUND = 1.01  # a path is longer than its chord by less than one in a hundred where it is nearly straight
THROUGH, CUT, STOP = range(3)  # what becomes of a triangle: stepped through, skipped at a corner, not entered


class Memory(NamedTuple):
    """What a march remembers from triangle to triangle."""

    free: float  # m, clearance left
    checked: float  # s, time in the last triangle in which the error was looked at
    bent: float  # largest error so far of a linear N over what is allowed
    quadratic: bool  # N is a parabola from here on


@compiled
def way_out(geometry, tri, x, y, vx, vy, nx, ny, rate):
    """About when which face is reached: along the velocity, then twice along the mean velocity till there."""
    time, edge, wx, wy = math.inf, at.NOBODY, vx, vy
    for turn in range(3):
        soonest, which = math.inf, at.NOBODY
        for k in range(3):
            speed = geometry[tri, at.B0X + 2 * k] * wx + geometry[tri, at.B0Y + 2 * k] * wy
            if speed < 0.0:
                reached = max(barycentric(geometry, tri, k, x, y), 0.0) / -speed
                if reached < soonest:
                    soonest, which = reached, k
        if which < 0:
            break
        time, edge = soonest, which
        if turn < 2:
            _, p1, p2, _, _ = phis(-rate * time)
            wx, wy = p1 * vx + time * p2 * nx, p1 * vy + time * p2 * ny
    return time, edge


@compiled
def _holds(geometry, tri, x, y):
    """Whether a triangle holds a point, or nearly."""
    least = 1.0
    for k in range(3):
        q = barycentric(geometry, tri, k, x, y)
        least = q if not q >= least else least  # NaN stays
    return least >= BEYOND


@inlined
def _limits(state, air, grain, rules):
    """See ``Limits``."""
    clock = min(rules.until, state[at.T_NOISE], state[at.T_END] if air.smooth[at.KNOT_RATE] == 0.0 else math.inf)
    fall = math.sqrt(rules.extent * math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2))
    return Limits(state[at.T], clock, fall)


@inlined
def _departure(state, ints, affine, air, grain, table):
    """The face that the march begins on: the force is looked at where the granule is."""
    x, y, vx, vy = state[at.X], state[at.Y], state[at.VX], state[at.VY]
    tri, t = ints[at.TRI], state[at.T]
    fx, fy, rate, _, _, _, _, _ = excess(
        state, ints, affine, air, grain, table, tri, x, y, vx, vy, t, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    return Face(x, y, vx, vy, fx + rate * vx, fy + rate * vy, rate, 0.0, 0.0, vx * vx + vy * vy, 0.0)


@inlined
def _aim(air, rules, face, tri, limits):
    """About how long the granule stays in the triangle, the face it leaves by, whether the clock stops it before, and
    what becomes of it: THROUGH, CUT or STOP.
    """
    dt, edge = way_out(air.geometry, tri, face.x, face.y, face.vx, face.vy, face.nx, face.ny, face.rate)
    last = not limits.t0 + face.s + dt < limits.clock
    dt = limits.clock - limits.t0 - face.s if last else dt
    verdict = THROUGH
    if (edge < 0 and not last) or dt > rules.coarse:  # confined steps end at knots
        verdict = STOP
    elif dt * dt * face.speed2 <= FLAT * rules.extent * FLAT * rules.extent:
        verdict = CUT
    return dt, edge, last, verdict


@inlined
def _meet(geometry, face, tri, edge, dt, limits):
    """When the path foretold meets the face ``edge``, by Newton's method from ``dt``, or the clock ends it before, and
    whether it does; a time not above zero: never.
    """
    gx, gy = face.ux * dt, face.uy * dt
    for _ in range(NEWTON):
        e, p1, p2, p3, _ = phis(-face.rate * dt)
        px = face.x + dt * (p1 * face.vx + dt * (p2 * face.nx + p3 * gx))
        py = face.y + dt * (p1 * face.vy + dt * (p2 * face.ny + p3 * gy))
        off = barycentric(geometry, tri, edge, px, py)
        if abs(off) <= ON_FACE:
            break
        bx, by = geometry[tri, at.B0X + 2 * edge], geometry[tri, at.B0Y + 2 * edge]
        wx, wy = e * face.vx + dt * (p1 * face.nx + p2 * gx), e * face.vy + dt * (p1 * face.ny + p2 * gy)
        speed = bx * wx + by * wy
        dt = dt - off / speed if speed < 0.0 else -1.0
        gx, gy = face.ux * dt, face.uy * dt
        if not dt > 0.0:
            return dt, False
    last = not limits.t0 + face.s + dt < limits.clock
    return limits.clock - limits.t0 - face.s if last else dt, last


@inlined
def _arrive(geometry, face, tri, edge, dt, last, bend, limits):
    """The end of the step, put onto the face where it is not on it: its time, whether the clock ends it, the bend of N
    till then, place, velocity, and whether that was near enough.
    """
    fine = True
    px = py = wx = wy = 0.0
    for met in range(2):
        px, py, wx, wy, _ = along_bend(face, bend, 1.0, dt)
        if last or met == 1:
            break
        off = barycentric(geometry, tri, edge, px, py)
        if abs(off) <= ON_FACE:
            break
        speed = geometry[tri, at.B0X + 2 * edge] * wx + geometry[tri, at.B0Y + 2 * edge] * wy
        part = 1.0 - off / (speed * dt) if speed < 0.0 else 1.0
        fine = 1.0 - OFF_FACE < part < 1.0 + OFF_FACE
        if not fine:
            break
        last = not limits.t0 + face.s + part * dt < limits.clock
        part = (limits.clock - limits.t0 - face.s) / dt if last else part
        dt *= part
        cx, cy = bend.gx + bend.kx, bend.gy + bend.ky
        bend = Bend(
            part * (cx - part * bend.kx), part * (cy - part * bend.ky), part * part * bend.kx, part * part * bend.ky
        )
    return dt, last, bend, px, py, wx, wy, fine and _holds(geometry, tri, px, py)


@inlined
def _room(walls, grain, face, px, py, way, free):
    """What is left of a clearance ``free`` (m) after ``way``, and whether nothing can have been met on it: nothing is
    if the distances from walls before and after add up to more than the way.
    """
    if free > way:
        return free - way, True
    before = clearance(walls, face.x, face.y, grain[at.RADIUS], way)
    free = clearance(walls, px, py, grain[at.RADIUS], AHEAD * way)
    return free, before + min(free, way) > way


@inlined
def _onward(face, shape, bend, dt, px, py, wx, wy):
    """The next face: its force is that at the velocity reached, from that at the one foretold."""
    rate, onward = face.rate, shape.onward
    fx = face.nx + bend.gx - rate * wx + (onward - rate) * (shape.zx - wx)
    fy = face.ny + bend.gy - rate * wy + (onward - rate) * (shape.zy - wy)
    ux, uy = (bend.gx + bend.kx) / dt, (bend.gy + bend.ky) / dt
    nx, ny = fx + onward * wx, fy + onward * wy
    return Face(px, py, wx, wy, nx, ny, onward, ux, uy, wx * wx + wy * wy, face.s + dt)


@inlined
def _leave(air, walls, grain, face, tri, edge, dt, last, shape, limits, free):
    """Step to the end of a triangle, unless something may be met on the way: the next face, the clearance left there,
    whether the clock ends the step, and whether all is well.
    """
    dt, last, bend, px, py, wx, wy, fine = _arrive(air.geometry, face, tri, edge, dt, last, shape.bend, limits)
    way = AROUND * dt * math.sqrt(max(face.speed2, wx * wx + wy * wy))
    if fine:
        free, fine = _room(walls, grain, face, px, py, way, free)
    return _onward(face, shape, bend, dt, px, py, wx, wy), free, last, fine


@inlined
def _through(
    state, ints, affine, air, grain, table, walls, rules, limits, face, tri, edge, dt, last, sampled, again, memory
):
    """Step through triangle ``tri`` to about its face ``edge``. Returns the next face, the memory, whether the clock
    ended the step, and whether all is well; else the granule stays where it was. ``again``: see ``triangle_stages``.
    """
    free, checked, bent, quadratic = memory
    sampled = sampled or last or dt > LONGER * checked
    checked = dt if sampled else checked
    if not last:
        dt, last = _meet(air.geometry, face, tri, edge, dt, limits)
        if not dt > 0.0:
            return face, memory, last, False
    shape = triangle_stages(
        state, ints, affine, air, grain, table, rules, face, tri, dt, limits, sampled, quadratic, again, bent
    )
    fine = shape.fine
    if fine:
        face, free, last, fine = _leave(air, walls, grain, face, tri, edge, dt, last, shape, limits, free)
    return face, Memory(free, checked, shape.bent, shape.quadratic), last, fine


@inlined
def march(state, ints, affine, air, grain, table, walls, rules, most):
    """Go from face to face up to the next snapshot or interval of noise, the mesh's end, until a wall or line may be
    met, or as long as the estimated error is within the allowance, through at most ``most`` triangles. The state is
    that of the last face. Returns how many triangles were left behind.
    """
    limits = _limits(state, air, grain, rules)
    face = _departure(state, ints, affine, air, grain, table)
    memory = Memory(0.0, 0.0, 0.0, ints[at.QUADRATIC] == 1)
    tri, left, cut = ints[at.TRI], 0, 0
    for cell in range(most):
        dt, edge, last, verdict = _aim(air, rules, face, tri, limits)
        cut = cut + 1 if verdict == CUT else 0
        if verdict == STOP or cut > MAX_CUTS or (cut > 0 and last):
            break
        if verdict == THROUGH:
            sampled, again = cell % SAMPLED == 0, cell == 0
            face, memory, last, fine = _through(
                state, ints, affine, air, grain, table, walls, rules, limits, face, tri, edge, dt, last, sampled, again,
                memory,
            )  # fmt: skip
            if not fine:
                break
            left += 1
            state[at.X], state[at.Y], state[at.VX], state[at.VY] = face.x, face.y, face.vx, face.vy
            state[at.T] = limits.clock if last else limits.t0 + face.s
            if last:
                break
        tri = air.neighbours[tri, edge]
        if tri < 0:
            break
        ints[at.TRI] = tri
    ints[at.QUADRATIC] = 1 if memory.bent > KEEP else 0
    return left
