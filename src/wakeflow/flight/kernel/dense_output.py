"""The dense output of an exponential Runge-Kutta step, and the phi functions it is made of.

Within a step  v' = -B v + N(s),  x' = v  with B frozen and N quadratic in s, which integrates to

    v(s) = e^z v0 + s phi1 N0 + s^2 phi2 N1 + 2 s^3 phi3 N2
    x(s) = x0 + s phi1 v0 + s^2 phi2 N0 + s^3 phi3 N1 + 2 s^4 phi4 N2,   z = -B s.

phi_0 = e^z, phi_{k+1} = (phi_k - 1/k!) / z (Cox & Matthews 2002, J. Comput. Phys. 176, 430; Hochbruck & Ostermann 2010,
Acta Numerica 19, 209). A step is kept as one array ``path``: x0, y0, vx0, vy0, B, N0x, N0y, N1x, N1y, N2x, N2y, the
air's velocity at its start; and, in free flight seen from a mesh that swings, the swing's amplitude, frequency, phase
at the start, displacement and velocity there. All of that is then the lab's but for the first four, and the swing comes
off exactly.
"""

from __future__ import annotations

import math

from . import layout as at
from .jit import compiled

# Taylor coefficients of phi_4: divisions would take most of the time of a step
C0, C1, C2, C3, C4, C5, C6, C7, C8, C9, C10, C11, C12, C13, C14, C15 = (1.0 / math.factorial(k + 4) for k in range(16))


@compiled
def phis(z):
    """e^z and phi_1 .. phi_4 for z <= 0, to round-off for every size of z.

    The series of phi_4 with the downward recurrence near zero, where the upward one cancels; upward elsewhere.
    """
    if z <= -1.0:
        e = math.exp(z)
        p1 = (e - 1.0) / z
        p2 = (p1 - 1.0) / z
        p3 = (p2 - 0.5) / z
        return e, p1, p2, p3, (p3 - 1.0 / 6.0) / z
    if z > -1e-3:
        p4 = C0 + z * (C1 + z * (C2 + z * (C3 + z * C4)))
    elif z > -0.1:
        p4 = C0 + z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * (C6 + z * (C7 + z * C8)))))))
    else:
        p4 = C8 + z * (C9 + z * (C10 + z * (C11 + z * (C12 + z * (C13 + z * (C14 + z * C15))))))
        p4 = C0 + z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * (C6 + z * (C7 + z * p4)))))))
    p3 = 1.0 / 6.0 + z * p4
    p2 = 0.5 + z * p3
    p1 = 1.0 + z * p2
    return 1.0 + z * p1, p1, p2, p3, p4


@compiled
def _swayed(path, s, e, a, x, y, vx, vy):
    """What is seen from the mesh of a path that was made from there without the swing."""
    angle = path[at.MESH_ANGLE] + path[at.MESH_OMEGA] * s
    out, rate = math.sin(angle), path[at.MESH_OMEGA] * math.cos(angle)
    x += a * path[at.MESH_VX] - (path[at.MESH_X] * out - path[at.MESH_OUT_X])
    y += a * path[at.MESH_VY] - (path[at.MESH_Y] * out - path[at.MESH_OUT_Y])
    return x, y, vx + e * path[at.MESH_VX] - path[at.MESH_X] * rate, vy + e * path[at.MESH_VY] - path[at.MESH_Y] * rate


@compiled
def along(path, s):
    """Position and velocity at time ``s`` after the step's start."""
    return along_phis(path, s, phis(-path[at.RATE] * s))


@compiled
def along_phis(path, s, p):
    """Position and velocity at time ``s``, with the phi functions ``p`` of z = -B s."""
    e, p1, p2, p3, p4 = p
    a, b, c = s * p1, s * s * p2, 2.0 * s * s * s * p3
    d, f = s * s * s * p3, 2.0 * s * s * s * s * p4
    x = path[at.START_X] + a * path[at.START_VX] + b * path[at.N0X] + d * path[at.N1X] + f * path[at.N2X]
    y = path[at.START_Y] + a * path[at.START_VY] + b * path[at.N0Y] + d * path[at.N1Y] + f * path[at.N2Y]
    vx = e * path[at.START_VX] + a * path[at.N0X] + b * path[at.N1X] + c * path[at.N2X]
    vy = e * path[at.START_VY] + a * path[at.N0Y] + b * path[at.N1Y] + c * path[at.N2Y]
    if path[at.MESH_OMEGA] != 0.0:
        return _swayed(path, s, e, a, x, y, vx, vy)
    return x, y, vx, vy


@compiled
def parabola(path, first, h, mx, my, ex, ey):
    """Let a parabola of the path, whose first coefficient is ``first`` (N0X, SLIP, PAST), go on from its value at the
    start through (mx, my) in the middle of a step h and (ex, ey) at its end.
    """
    x, y = path[first], path[first + 1]
    path[first + 2], path[first + 3] = (4.0 * mx - 3.0 * x - ex) / h, (4.0 * my - 3.0 * y - ey) / h
    path[first + 4], path[first + 5] = 2.0 * (x - 2.0 * mx + ex) / (h * h), 2.0 * (y - 2.0 * my + ey) / (h * h)


@compiled
def sampled(path, first, s):
    """A parabola of the path at time s of the step."""
    x = path[first] + s * (path[first + 2] + s * path[first + 4])
    return x, path[first + 1] + s * (path[first + 3] + s * path[first + 5])


@compiled
def sway(path, swing, first, t):
    """Note the swing ``swing[first:]`` of the mesh at the step's start ``t``; returns its velocity and acceleration
    there.
    """
    ax, ay, omega = swing[first + at.SWING_X], swing[first + at.SWING_Y], swing[first + at.SWING_OMEGA]
    path[at.MESH_X], path[at.MESH_Y], path[at.MESH_OMEGA] = ax, ay, omega
    if omega == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    angle = omega * t + swing[first + at.SWING_PHASE]
    out, rate = math.sin(angle), omega * math.cos(angle)
    path[at.MESH_ANGLE], path[at.MESH_OUT_X], path[at.MESH_OUT_Y] = angle, ax * out, ay * out
    path[at.MESH_VX], path[at.MESH_VY] = ax * rate, ay * rate
    ax, ay = -omega * omega * path[at.MESH_OUT_X], -omega * omega * path[at.MESH_OUT_Y]
    return path[at.MESH_VX], path[at.MESH_VY], ax, ay
