"""The stages of a march in one triangle: the looks at the force there, and what they find out about it.

N is taken for linear through the triangle, or for a parabola, once its middle was found too far off a line.
docs/kernel.md derives the stages, their error and the numbers below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .dense_output import phis
from .jit import inlined
from .nodes import STIFF, carried, displaced, excess
from .step import TRANSIENT

MARCH_SHARE = 0.2  # of the allowance: chosen by experiment: errors grow on their way through a sheared wake
MOVED = 2.0  # allowances: more than that off the place foretold, the force is looked up anew
MAX_MOVES = 2  # times that it is looked up anew; then the triangle is for confined steps
MAX_LOOKS = 9  # at the force in a triangle: all ways through the stages are shorter
END, MIDDLE, EARLY, LATE = 1.0, 0.5, 0.25, 0.75  # parts of the time in a triangle at which the force is looked at


class Face(NamedTuple):
    """A granule where it enters a triangle."""

    x: float  # m
    y: float
    vx: float  # m/s
    vy: float
    nx: float  # m/s2, N = F + B v
    ny: float
    rate: float  # 1/s, drag rate B
    ux: float  # m/s3, slope of N in time, foretold by that in the last triangle
    uy: float
    speed2: float  # m2/s2
    s: float  # s since the march began


class Bend(NamedTuple):
    """N in a triangle less that at its face: g w + k w (1 - w), 0 <= w <= 1 the part of the time in it; m/s2."""

    gx: float
    gy: float
    kx: float
    ky: float


class Limits(NamedTuple):
    """What holds for a whole march."""

    t0: float  # s, when it begins
    clock: float  # s, when it has to end
    fall: float  # m/s, speed that gravity gives over the extent of the flight


class Shape(NamedTuple):
    """What the stages find out about a triangle."""

    bend: Bend
    zx: float  # m/s, velocity foretold for its end, of which the force there is
    zy: float
    onward: float  # 1/s, drag rate there
    bent: float  # see ``Memory``
    quadratic: bool
    fine: bool  # the error is within what is allowed


@inlined
def along_bend(face, bend, part, h):
    """Place and velocity at a ``part`` of the triangle's time, ``h`` (s) after its face; the phi functions there."""
    cx, cy = part * (bend.gx + bend.kx), part * (bend.gy + bend.ky)
    lx, ly = 2.0 * part * part * bend.kx, 2.0 * part * part * bend.ky
    e, p1, p2, p3, p4 = phis(-face.rate * h)
    wx = e * face.vx + h * (p1 * face.nx + p2 * cx - p3 * lx)
    wy = e * face.vy + h * (p1 * face.ny + p2 * cy - p3 * ly)
    px = face.x + h * (p1 * face.vx + h * (p2 * face.nx + p3 * cx - p4 * lx))
    py = face.y + h * (p1 * face.vy + h * (p2 * face.ny + p3 * cy - p4 * ly))
    return px, py, wx, wy, (p1, p2, p3, p4)


@inlined
def _foretold(face, bend, part):
    """N at a ``part`` of the triangle's time."""
    cx, cy = part * (bend.gx + bend.kx), part * (bend.gy + bend.ky)
    lx, ly = 2.0 * part * part * bend.kx, 2.0 * part * part * bend.ky
    return face.nx + cx - 0.5 * lx, face.ny + cy - 0.5 * ly


@inlined
def _moves(rules, face, bend, dt, px, py, zx, zy, phi):
    """Whether the end, foretold at p, is somewhere else with the force found there: too far for that force to hold."""
    p1, p2, p3, p4 = phi
    cx, cy = bend.gx + bend.kx, bend.gy + bend.ky
    qx = dt * (p1 * face.vx + dt * (p2 * face.nx + p3 * cx - 2.0 * p4 * bend.kx)) - (px - face.x)
    qy = dt * (p1 * face.vy + dt * (p2 * face.ny + p3 * cy - 2.0 * p4 * bend.ky)) - (py - face.y)
    return qx * qx + qy * qy > (MOVED * rules.allowance * dt) ** 2 * max(face.speed2, zx * zx + zy * zy)


@inlined
def _relaxes(rules, face, dt, zx, zy, onward):
    """Whether B, frozen over a velocity transient that the stages step over, displaces more than is allowed."""
    if not face.rate * dt > STIFF:
        return False
    passed = face.rate * dt / (face.rate * dt + TRANSIENT)
    change = math.sqrt((zx - face.vx) ** 2 + (zy - face.vy) ** 2) * abs(1.0 / face.rate - 1.0 / onward)
    return change * passed**3 > rules.allowance * dt * math.sqrt(max(face.speed2, zx * zx + zy * zy))


@inlined
def _error(rules, face, limits, bend, dt, zx, zy):
    """What decides on a triangle: what a constant error of the force displaces (s), what may be displaced per time
    (m/s), and what the bend of N displaces (m/s) where N is taken for linear.
    """
    horizon = min(rules.until - limits.t0, rules.extent / (math.sqrt(face.speed2) + limits.fall))
    carry = carried(phis(-face.rate * dt), face.rate, dt, horizon)
    allowed = MARCH_SHARE * rules.allowance * math.sqrt(max(face.speed2, zx * zx + zy * zy))
    return carry, allowed, carry * math.sqrt(bend.kx * bend.kx + bend.ky * bend.ky) / 6.0  # mean of w (1 - w)


@inlined
def _look(state, ints, affine, air, grain, table, face, tri, bend, part, dt, limits):
    """Look at the force at a ``part`` of the time ``dt`` in a triangle: the place foretold, N less that at the face,
    the drag rate, the velocity, and the phi functions there.
    """
    h = part * dt
    px, py, wx, wy, phi = along_bend(face, bend, part, h)
    nx, ny = _foretold(face, bend, part)
    t, gain = limits.t0 + face.s + h, h * phi[1]
    mx, my, rate, wx, wy, _, _, _ = excess(
        state, ints, affine, air, grain, table, tri, px, py, wx, wy, t, face.rate, nx, ny, gain, 0.0
    )
    return px, py, mx - face.nx, my - face.ny, rate, wx, wy, phi


@inlined
def triangle_stages(
    state, ints, affine, air, grain, table, rules, face, tri, dt, limits, sampled, quadratic, again, bent
):
    """The stages of a triangle: look at the force at its end, or first in the middle where N is a parabola, and, where
    it is ``sampled``, judge the error. ``again``: a parabola's middle is looked at twice; ``bent``: see ``Shape``.
    """
    bend = Bend(face.ux * dt, face.uy * dt, 0.0, 0.0)
    stage, curved, moves, fine = MIDDLE if quadratic else END, quadratic, 0, True
    hx = hy = ox = oy = zx = zy = onward = 0.0
    for _ in range(MAX_LOOKS):
        px, py, mx, my, rate, wx, wy, phi = _look(
            state, ints, affine, air, grain, table, face, tri, bend, stage, dt, limits
        )
        if stage == END:
            zx, zy, onward = wx, wy, rate
            bend = Bend(mx, my, 4.0 * hx - 2.0 * mx, 4.0 * hy - 2.0 * my) if curved else Bend(mx, my, 0.0, 0.0)
            moved = _moves(rules, face, bend, dt, px, py, zx, zy, phi)
            moves += moved
            fine = moves <= MAX_MOVES if moved else not _relaxes(rules, face, dt, zx, zy, onward)
            if not fine or not (moved or sampled):
                break
            stage = END if moved else (EARLY if curved else MIDDLE)
        elif stage == EARLY:
            ox, oy = mx - 0.25 * bend.gx - 0.1875 * bend.kx, my - 0.25 * bend.gy - 0.1875 * bend.ky
            stage = LATE
        elif stage == MIDDLE and curved:  # before the end
            hx, hy, bend = mx, my, Bend(2.0 * mx, 2.0 * my, 0.0, 0.0)
            stage, again = MIDDLE if again else END, False
        else:
            if stage == MIDDLE:
                hx, hy, bend = mx, my, Bend(bend.gx, bend.gy, 4.0 * mx - 2.0 * bend.gx, 4.0 * my - 2.0 * bend.gy)
            carry, allowed, off = _error(rules, face, limits, bend, dt, zx, zy)
            bent = max(bent, off / allowed)
            if stage == LATE:
                mx -= 0.75 * bend.gx + 0.1875 * bend.kx
                my -= 0.75 * bend.gy + 0.1875 * bend.ky
                fine = not displaced(ox, oy, mx, my, carry, face.rate, dt) > allowed
            if stage == LATE or off <= allowed:
                break
            quadratic, curved, stage = True, True, END
    return Shape(bend, zx, zy, onward, bent, quadratic, fine)
