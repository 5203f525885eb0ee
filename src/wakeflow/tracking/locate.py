"""Where a granule is in the mesh and what the air does there: walking, snapshots, the affine field of one triangle."""

from __future__ import annotations

import math

from .jit import compiled
from .state import (
    DISPERSION,
    FRESH,
    GAP,
    GX,
    GY,
    H_ERROR,
    KICK_X,
    MEAN_X,
    NOBODY,
    NOISE,
    PRESSURE,
    SNAP_A,
    SNAP_B,
    STEPS,
    T_END,
    TRI,
    T,
    X,
    Y,
)

__all__ = ["air_at", "anywhere", "barycentric", "bracket", "load", "reproject", "walk"]

INSIDE = -1e-12
AROUND = 3  # covered edges on each side of the nearest one that are tried
SELDOM = 32  # steps in the gap: then all triangles are looked at


@compiled
def barycentric(geometry, tri, k, x, y):
    """Barycentric coordinate k of a point in triangle ``tri``."""
    value = geometry[tri, 2 + 2 * k] * (x - geometry[tri, 0]) + geometry[tri, 3 + 2 * k] * (y - geometry[tri, 1])
    return value + 1.0 if k == 0 else value


@compiled
def walk(geometry, neighbours, tri, x, y):
    """Triangle that holds the point, from ``tri`` across the edge it lies farthest beyond; also the last boundary code.

    Returns (triangle, 0) when found, else (last triangle, code < 0) where the straight walk meets the boundary.
    """
    for _ in range(neighbours.shape[0] + 10):
        worst, edge = INSIDE, NOBODY
        for k in range(3):
            value = barycentric(geometry, tri, k, x, y)
            if value < worst:
                worst, edge = value, k
        if edge < 0:
            return tri, NOBODY + 1
        onward = neighbours[tri, edge]
        if onward < 0:
            return tri, onward
        tri = onward
    return tri, NOBODY + 1


@compiled
def bracket(state, ints, affine, times, period):
    """Choose the two snapshots around the granule's clock; before the first and after the last the field stands
    still.
    """
    t, last = state[T], times.shape[0] - 1
    shift = 0.0
    if period > 0.0:
        shift = math.floor((t - times[0]) / period) * period
    near = 1e-12 * (abs(t) + times[last] - times[0])  # a clock this close below a snapshot has reached it
    i = -1
    while i < last and times[i + 1] + shift <= t + near:
        i += 1
    if i < last and i >= 0:
        a, b = times[i] + shift, times[i + 1] + shift
        ints[SNAP_A], ints[SNAP_B] = i, i + 1
    elif period > 0.0:
        if i < 0:
            shift -= period
        a, b = times[last] + shift, times[0] + period + shift
        ints[SNAP_A], ints[SNAP_B] = last, 0
        if b <= t + near:  # the clock has reached the next turn
            a, b = times[0] + period + shift, times[1] + period + shift
            ints[SNAP_A], ints[SNAP_B] = 0, 1
    else:
        a, b = (times[last], math.inf) if i >= 0 else (-math.inf, times[0])
        ints[SNAP_A] = ints[SNAP_B] = last if i >= 0 else 0
    affine[14] = a if math.isfinite(a) else 0.0
    affine[15] = 1.0 / (b - a) if ints[SNAP_A] != ints[SNAP_B] else 0.0
    state[T_END] = b
    ints[FRESH] = 0


@compiled
def _plane(affine, at, f0, f1, f2, geometry, tri):
    affine[at] = f0
    affine[at + 1] = f0 * geometry[tri, 2] + f1 * geometry[tri, 4] + f2 * geometry[tri, 6]
    affine[at + 2] = f0 * geometry[tri, 3] + f1 * geometry[tri, 5] + f2 * geometry[tri, 7]


@compiled
def load(state, ints, affine, air, grain):
    """Velocity and acceleration (gravity, pressure gradient) as affine functions in the current triangle and interval.

    The velocity is the mean field's plus the fluctuation a granule sees: its deviation, linear in the triangle, times
    the mean over the interval of noise. In the gap between a boundary of the mesh and the body that moved away from
    it, the values of the nearest boundary point, constant.
    """
    ints[FRESH] = 1
    gap, tri = ints[GAP], ints[TRI]
    if gap >= 0:
        tri = air.covered[gap, 0]
    geometry, values = air.geometry, air.values
    affine[0], affine[1] = geometry[tri, 0], geometry[tri, 1]
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    a, b = ints[SNAP_A], ints[SNAP_B]
    timed = a != b
    noisy = grain[NOISE] != 0.0
    for m in range(4):
        at, to = 2 + 3 * m, 16 + 3 * m
        if m >= 2 and grain[PRESSURE] == 0.0:
            affine[at] = grain[GX] if m == 2 else grain[GY]
            affine[at + 1] = affine[at + 2] = affine[to] = affine[to + 1] = affine[to + 2] = 0.0
            continue
        factor = grain[PRESSURE] if m >= 2 else 1.0
        base = grain[GX] if m == 2 else (grain[GY] if m == 3 else 0.0)
        f0, f1, f2 = factor * values[a, c0, m], factor * values[a, c1, m], factor * values[a, c2, m]
        if timed:
            d0 = factor * values[b, c0, m] - f0
            d1 = factor * values[b, c1, m] - f1
            d2 = factor * values[b, c2, m] - f2
            if m < 2 and grain[DISPERSION] != 0.0:
                mean = state[MEAN_X + m]
                d0 += mean * (values[b, c0, 4] - values[a, c0, 4])
                d1 += mean * (values[b, c1, 4] - values[a, c1, 4])
                d2 += mean * (values[b, c2, 4] - values[a, c2, 4])
            _plane(affine, to, d0, d1, d2, geometry, tri)
        if m < 2 and noisy:
            base = state[KICK_X + m]
            if grain[DISPERSION] != 0.0:
                mean = state[MEAN_X + m]
                f0 += mean * values[a, c0, 4]
                f1 += mean * values[a, c1, 4]
                f2 += mean * values[a, c2, 4]
        _plane(affine, at, f0 + base, f1 + base, f2 + base, geometry, tri)
    if gap >= 0:
        x, y, _ = _on_edge(air, gap, state[X], state[Y])
        for start in (2, 16):
            for m in range(4):
                at = start + 3 * m
                affine[at] += affine[at + 1] * (x - affine[0]) + affine[at + 2] * (y - affine[1])
                affine[at + 1] = affine[at + 2] = 0.0


@compiled
def air_at(affine, x, y, t):
    """Air velocity and the acceleration by gravity and pressure at a point and time, from the loaded triangle."""
    dx, dy = x - affine[0], y - affine[1]
    ux = affine[2] + affine[3] * dx + affine[4] * dy
    uy = affine[5] + affine[6] * dx + affine[7] * dy
    ax = affine[8] + affine[9] * dx + affine[10] * dy
    ay = affine[11] + affine[12] * dx + affine[13] * dy
    if affine[15] != 0.0:
        w = (t - affine[14]) * affine[15]
        ux += w * (affine[16] + affine[17] * dx + affine[18] * dy)
        uy += w * (affine[19] + affine[20] * dx + affine[21] * dy)
        ax += w * (affine[22] + affine[23] * dx + affine[24] * dy)
        ay += w * (affine[25] + affine[26] * dx + affine[27] * dy)
    return ux, uy, ax, ay


@compiled
def _on_edge(air, gap, x, y):
    """Nearest point of a covered boundary edge, and where along it the foot lies (0..1 on it)."""
    tri, k = air.covered[gap, 0], air.covered[gap, 1]
    ax, ay = _corner(air, tri, (k + 1) % 3)
    bx, by = _corner(air, tri, (k + 2) % 3)
    ex, ey = bx - ax, by - ay
    w = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
    on = min(1.0, max(0.0, w))
    return ax + on * ex, ay + on * ey, w


@compiled
def _corner(air, tri, k):
    """Coordinates of corner k, from the first one and the gradients (their inverse), which are all the kernel
    carries.
    """
    g = air.geometry
    x, y = g[tri, 0], g[tri, 1]
    if k == 0:
        return x, y
    det = g[tri, 4] * g[tri, 7] - g[tri, 5] * g[tri, 6]
    if k == 1:
        return x + g[tri, 7] / det, y - g[tri, 6] / det
    return x - g[tri, 5] / det, y + g[tri, 4] / det


@compiled
def anywhere(geometry, x, y):
    """The triangle that holds a point, by looking at all of them; -1 for none. For granules that nothing else finds."""
    for tri in range(geometry.shape[0]):
        if (
            barycentric(geometry, tri, 0, x, y) >= INSIDE
            and barycentric(geometry, tri, 1, x, y) >= INSIDE
            and barycentric(geometry, tri, 2, x, y) >= INSIDE
        ):
            return tri
    return -1


@compiled
def _from_around(air, gap, x, y):
    """The triangle that holds a point, on foot from the covered edges on both sides of one; -1 for none."""
    before = after = gap
    for _ in range(AROUND):
        before = air.covered[before, 2] if before >= 0 else -1
        after = air.covered[after, 3] if after >= 0 else -1
        for edge in (before, after):
            if edge >= 0:
                found, code = walk(air.geometry, air.neighbours, air.covered[edge, 0], x, y)
                if code == 0:
                    return found
    return -1


@compiled
def reproject(state, ints, air, buried):
    """For a granule in the gap: move on to the nearest boundary edge, or back into the mesh. Returns that edge's
    length. ``buried``: it lies inside the outline at rest of a body, so that no triangle can hold it.
    """
    x, y = state[X], state[Y]
    gap, came = ints[GAP], NOBODY
    for _ in range(air.covered.shape[0]):
        _, _, w = _on_edge(air, gap, x, y)
        onward = air.covered[gap, 2] if w < 0.0 else (air.covered[gap, 3] if w > 1.0 else -1)
        if onward < 0 or onward == came:
            break
        came, gap = gap, onward
    tri, k = air.covered[gap, 0], air.covered[gap, 1]
    ax, ay = _corner(air, tri, (k + 1) % 3)
    bx, by = _corner(air, tri, (k + 2) % 3)
    ints[GAP], ints[TRI], ints[FRESH] = gap, tri, 0
    if barycentric(air.geometry, tri, k, x, y) > 1e-9:
        found, code = walk(air.geometry, air.neighbours, tri, x, y)
        if code == 0:
            ints[GAP], ints[TRI] = -1, found
            state[H_ERROR] = math.inf
        elif code <= -2:
            ints[GAP], ints[TRI] = -2 - code, found
    if ints[GAP] >= 0 and not buried:  # beside a corner the nearest edge and the walk from it may miss the mesh
        found = _from_around(air, gap, x, y)
        if found < 0 and ints[STEPS] % SELDOM == 0:
            found = anywhere(air.geometry, x, y)
        if found >= 0:
            ints[GAP], ints[TRI] = -1, found
            state[H_ERROR] = math.inf
    return math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
