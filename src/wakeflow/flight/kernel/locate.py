"""Where a granule is in the mesh: walking from triangle to triangle, and the gap beside a body that moved away."""

from __future__ import annotations

import math

from . import layout as at
from .jit import called, compiled
from .walls import inside

INSIDE = -1e-12
AROUND = 3  # covered edges on each side of the nearest one that are tried
FAR = 1.0  # cells of the grid, from which on a point is looked for in its cell
SELDOM = 32  # steps in the gap: then all triangles are looked at


@compiled
def barycentric(geometry, tri, k, x, y):
    """Barycentric coordinate k of a point in triangle ``tri``."""
    value = geometry[tri, at.B0X + 2 * k] * (x - geometry[tri, at.CORNER_X]) + geometry[tri, at.B0Y + 2 * k] * (
        y - geometry[tri, at.CORNER_Y]
    )
    return value + 1.0 if k == 0 else value


@compiled
def farthest(geometry, tri, x, y):
    """The edge of a triangle that a point is farthest beyond, and its barycentric coordinate there."""
    least, edge = barycentric(geometry, tri, 0, x, y), 0
    for k in range(1, 3):
        value = barycentric(geometry, tri, k, x, y)
        if value < least:
            least, edge = value, k
    return least, edge


@compiled
def cell_size(geometry, tri):
    """The side (m) of a square of twice the triangle's area."""
    return 1.0 / math.sqrt(
        abs(geometry[tri, at.B1X] * geometry[tri, at.B2Y] - geometry[tri, at.B1Y] * geometry[tri, at.B2X])
    )


@compiled
def walk(geometry, neighbours, tri, x, y):
    """Triangle that holds the point, from ``tri`` across the edge it lies farthest beyond; also the last boundary code.

    Returns (triangle, 0) when found, else (last triangle, code < 0) where the straight walk meets the boundary.
    """
    for _ in range(neighbours.shape[0] + 10):
        beyond, edge = farthest(geometry, tri, x, y)
        if not beyond < INSIDE:
            return tri, at.NOBODY + 1
        onward = neighbours[tri, edge]
        if onward < 0:
            return tri, onward
        tri = onward
    return tri, at.NOBODY + 1


@compiled
def find(air, tri, x, y):
    """Triangle of the point, walked to from near to it where it is far from ``tri``; from ``tri`` where that fails."""
    p, g = air.places, air.geometry
    far = abs(x - g[tri, at.CORNER_X]) * p[at.PER_X] + abs(y - g[tri, at.CORNER_Y]) * p[at.PER_Y] > FAR
    column, row = math.floor((x - p[at.GRID_X]) * p[at.PER_X]), math.floor((y - p[at.GRID_Y]) * p[at.PER_Y])
    if far and 0.0 <= column < p[at.IN_ROW] and 0.0 <= row < p[at.IN_ROW]:
        triangle, code = walk(g, air.neighbours, air.grid[int(row * p[at.IN_ROW] + column)], x, y)
        if code == 0:
            return triangle, code
    return walk(g, air.neighbours, tri, x, y)


@compiled
def on_edge(air, gap, x, y):
    """Nearest point of a covered boundary edge, and where along it the foot lies (0..1 on it)."""
    tri, k = air.covered[gap, at.COVER_TRI], air.covered[gap, at.COVER_EDGE]
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
    x, y = g[tri, at.CORNER_X], g[tri, at.CORNER_Y]
    if k == 0:
        return x, y
    det = g[tri, at.B1X] * g[tri, at.B2Y] - g[tri, at.B1Y] * g[tri, at.B2X]
    if k == 1:
        return x + g[tri, at.B2Y] / det, y - g[tri, at.B2X] / det
    return x - g[tri, at.B1Y] / det, y + g[tri, at.B1X] / det


@called
def anywhere(geometry, x, y):
    """The triangle that holds a point, by looking at all of them; -1 for none. For granules that nothing else finds."""
    for tri in range(geometry.shape[0]):
        least, _ = farthest(geometry, tri, x, y)
        if least >= INSIDE:
            return tri
    return -1


@compiled
def _from_around(air, gap, x, y):
    """The triangle that holds a point, on foot from the covered edges on both sides of one; -1 for none."""
    before = after = gap
    for _ in range(AROUND):
        before = air.covered[before, at.COVER_BEFORE] if before >= 0 else -1
        after = air.covered[after, at.COVER_AFTER] if after >= 0 else -1
        for edge in (before, after):
            if edge >= 0:
                triangle, code = walk(air.geometry, air.neighbours, air.covered[edge, at.COVER_TRI], x, y)
                if code == 0:
                    return triangle
    return -1


@called
def reproject(state, ints, air, walls):
    """Move a granule in the gap on to the nearest boundary edge, or back into the mesh. Returns that edge's
    length. No triangle can hold one that lies inside the outline at rest of a body.
    """
    x, y = state[at.X], state[at.Y]
    gap, came = ints[at.GAP], at.NOBODY
    for _ in range(air.covered.shape[0]):
        _, _, w = on_edge(air, gap, x, y)
        onward = air.covered[gap, at.COVER_BEFORE] if w < 0.0 else (air.covered[gap, at.COVER_AFTER] if w > 1.0 else -1)
        if onward < 0 or onward == came:
            break
        came, gap = gap, onward
    tri, k = air.covered[gap, at.COVER_TRI], air.covered[gap, at.COVER_EDGE]
    ax, ay = _corner(air, tri, (k + 1) % 3)
    bx, by = _corner(air, tri, (k + 2) % 3)
    ints[at.GAP], ints[at.TRI], ints[at.FRESH] = gap, tri, 0
    if barycentric(air.geometry, tri, k, x, y) > 1e-9:
        triangle, code = walk(air.geometry, air.neighbours, tri, x, y)
        if code == 0:
            ints[at.GAP], ints[at.TRI] = -1, triangle
            state[at.H_ERROR] = math.inf
        elif code <= -2:
            ints[at.GAP], ints[at.TRI] = -2 - code, triangle
    buried = False
    for body in range(walls.bodies.shape[0]):
        buried = buried or inside(walls, body, x, y)[0]
    if ints[at.GAP] >= 0 and not buried:  # beside a corner the nearest edge and the walk from it may miss the mesh
        triangle = _from_around(air, gap, x, y)
        if triangle < 0 and ints[at.STEPS] % SELDOM == 0:
            triangle = anywhere(air.geometry, x, y)
        if triangle >= 0:
            ints[at.GAP], ints[at.TRI] = -1, triangle
            state[at.H_ERROR] = math.inf
    return math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
