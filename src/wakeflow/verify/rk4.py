"""A good explicit tracker to compare with: classical Runge-Kutta of order 4 at a fixed step, on the same triangles.

Linear interpolation, a cached triangle and a walk from it, the same drag table, granules in blocks on all cores. The
end of a track on the mesh's edge is found on the cubic Hermite interpolant of the step, a contact by a step that ends
there. It lacks what wakeflow's tracker adds: it loses its order at the field's kinks on the triangles' edges, it is
unstable for dust, and it does not know its error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.process import cores
from ..field import FlowField
from ..laws.collision import collide
from ..laws.constants import GRAVITY
from ..tracking.bodies import Body
from ..tracking.granules import Granules
from ..tracking.kernel import layout as at
from ..tracking.kernel.forces import drag_rate
from ..tracking.kernel.jit import compiled, entry, inlined
from ..tracking.kernel.locate import anywhere, barycentric, walk
from ..tracking.kernel.rebound import restitution_of
from ..tracking.kernel.walls import grasp, inside, overlap
from ..tracking.pack import pack_granules, pack_tables
from ..tracking.pack_surroundings import pack_air, pack_lines, pack_walls

Array = NDArray[np.float64]
Index = NDArray[np.int64]
BLOCK = 64
IMPACTS = 50  # below it the granule slides, which is not followed here
FLYING, LANDED, AIRBORNE, UNFINISHED = range(4)
TRI, END, TAKEN, STRUCK = range(4)  # columns of a granule's counts: triangle, how it ended, steps, impacts
_collide = compiled(collide)


@dataclass(frozen=True)
class ExplicitTracks:
    """``position`` (n, 2) m and ``time`` (n,) s where tracks ended, on the mesh's edge or not; steps, impacts."""

    position: Array
    time: Array
    landed: NDArray[np.bool_]
    steps: Index
    impacts: Index


@compiled
def _snapshots(air, t):
    """The two snapshots around time t and the weight of the second."""
    times, last = air.times, air.times.shape[0] - 1
    if last == 0:
        return 0, 0, 0.0
    period = air.period[0]
    if period > 0.0:
        t -= math.floor((t - times[0]) / period) * period
    elif t <= times[0] or t >= times[last]:
        return (0, 0, 0.0) if t <= times[0] else (last, last, 0.0)
    low, high = 0, last + 1
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= t:
            low = middle
        else:
            high = middle
    if low == last:
        return last, 0, (t - times[last]) / (times[0] + period - times[last])
    return low, low + 1, (t - times[low]) / (times[low + 1] - times[low])


@inlined
def _between(air, tri, one, two, a, b, w, m):
    """Value ``m`` of the nodes at barycentric coordinates ``one`` and ``two``, between snapshots a and b."""
    i, j, k = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    v, zero = air.values, 1.0 - one - two
    value = zero * v[a, i, m] + one * v[a, j, m] + two * v[a, k, m]
    if b != a:
        value += w * (zero * v[b, i, m] + one * v[b, j, m] + two * v[b, k, m] - value)
    return value


@compiled
def _acceleration(air, grain, table, tri, x, y, vx, vy, a, b, w):
    """Acceleration in triangle ``tri`` between snapshots a and b."""
    one, two = barycentric(air.geometry, tri, 1, x, y), barycentric(air.geometry, tri, 2, x, y)
    sx = _between(air, tri, one, two, a, b, w, at.NODE_U) - vx
    sy = _between(air, tri, one, two, a, b, w, at.NODE_V) - vy
    fx, fy = grain[at.GX], grain[at.GY]
    if grain[at.PRESSURE] != 0.0:
        fx += grain[at.PRESSURE] * _between(air, tri, one, two, a, b, w, at.NODE_PX)
        fy += grain[at.PRESSURE] * _between(air, tri, one, two, a, b, w, at.NODE_PY)
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    return fx + rate * sx, fy + rate * sy


@compiled
def _find(air, tri, x, y):
    """The triangle of a point, walking from ``tri``; also the code of the boundary the walk met, 0 for none."""
    found, code = walk(air.geometry, air.neighbours, tri, x, y)
    if code <= -2:  # a straight walk may run into a body that the granule passes beside
        other = anywhere(air.geometry, x, y)
        if other >= 0:
            return other, 0 * code
    return found, code


@compiled
def _rk4(air, grain, table, tri, x, y, vx, vy, t, h):
    """One step; returns the new state and the triangle its last stage lay in."""
    a, b, w = _snapshots(air, t)
    ax, ay = _acceleration(air, grain, table, tri, x, y, vx, vy, a, b, w)
    a, b, w = _snapshots(air, t + 0.5 * h)
    vx2, vy2 = vx + 0.5 * h * ax, vy + 0.5 * h * ay
    x2, y2 = x + 0.5 * h * vx, y + 0.5 * h * vy
    tri, _ = _find(air, tri, x2, y2)
    ax2, ay2 = _acceleration(air, grain, table, tri, x2, y2, vx2, vy2, a, b, w)
    vx3, vy3 = vx + 0.5 * h * ax2, vy + 0.5 * h * ay2
    x3, y3 = x + 0.5 * h * vx2, y + 0.5 * h * vy2
    tri, _ = _find(air, tri, x3, y3)
    ax3, ay3 = _acceleration(air, grain, table, tri, x3, y3, vx3, vy3, a, b, w)
    a, b, w = _snapshots(air, t + h)
    vx4, vy4 = vx + h * ax3, vy + h * ay3
    x4, y4 = x + h * vx3, y + h * vy3
    tri, _ = _find(air, tri, x4, y4)
    ax4, ay4 = _acceleration(air, grain, table, tri, x4, y4, vx4, vy4, a, b, w)
    return (
        x + h / 6.0 * (vx + 2.0 * (vx2 + vx3) + vx4),
        y + h / 6.0 * (vy + 2.0 * (vy2 + vy3) + vy4),
        vx + h / 6.0 * (ax + 2.0 * (ax2 + ax3) + ax4),
        vy + h / 6.0 * (ay + 2.0 * (ay2 + ay3) + ay4),
        tri,
    )


@compiled
def _hermite(s, h, x0, v0, x1, v1):
    """Cubic through positions and velocities at both ends of a step, at time s."""
    w = s / h
    return x0 + w * (h * v0 + w * (3.0 * (x1 - x0) - h * (2.0 * v0 + v1) + w * (2.0 * (x0 - x1) + h * (v0 + v1))))


@compiled
def _touches(walls, x, y, r):
    """The body that a granule at rest on (x, y) reaches into, and with which feature: (body, kind, which), -1: none."""
    for body in range(walls.bodies.shape[0]):
        b = walls.bodies
        if b[body, at.LOW_X] - r < x < b[body, at.HIGH_X] + r and b[body, at.LOW_Y] - r < y < b[body, at.HIGH_Y] + r:
            within, nearest = inside(walls, body, x, y)
            if within:
                return body, at.ON_EDGE, nearest
            depth, kind, which = overlap(walls, body, x, y, r)
            if depth > 0.0:
                return body, kind, which
    return -1, at.FREE, at.NOBODY


@compiled
def _first_touch(walls, r, h, x, y, vx, vy, x1, y1, vx1, vy1, kind, which):
    """When a step that ends in a wall first touches one, and with which feature (bisection on the Hermite cubic)."""
    low, high = 0.0, h
    for _ in range(50):
        s = 0.5 * (low + high)
        body, found, feature = _touches(walls, _hermite(s, h, x, vx, x1, vx1), _hermite(s, h, y, vy, y1, vy1), r)
        if body >= 0:
            high, kind, which = s, found, feature
        else:
            low = s
    return high, kind, which


@compiled
def _bounce(state, t, grain, walls, hold, kind, which):
    """Collide with a feature; returns whether the granule was moving into it."""
    body, off = grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], t)
    nx, ny = hold[at.NX], hold[at.NY]
    if state[at.VX] * nx + state[at.VY] * ny >= 0.0:
        return False
    state[at.X] -= off * nx
    state[at.Y] -= off * ny
    e, f = restitution_of(state, grain, walls, body, nx, ny, 0.0, 0.0), walls.bodies[body, at.BODY_FRICTION]
    f = grain[at.FRICTION] if f < 0.0 else f
    state[at.VX], state[at.VY], state[at.SPIN], _, _ = _collide(
        state[at.VX], state[at.VY], state[at.SPIN], nx, ny, 0.0, 0.0, e, f, grain[at.MOBILITY], grain[at.RADIUS]
    )
    return True


@entry
def fly_explicit_block(states, clocks, ints, grains, tables, table_of, air, walls, step, until, hold):
    """A block of granules; ``states`` begin as those of the tracker; ``ints`` see TRI."""
    for i in range(states.shape[0]):
        state, note, grain, table = states[i], ints[i], grains[i], tables[table_of[i]]
        r, t = grain[at.RADIUS], clocks[i]
        while note[END] == FLYING:
            h = min(step, until - t)
            x, y, vx, vy = state[at.X], state[at.Y], state[at.VX], state[at.VY]
            x1, y1, vx1, vy1, tri = _rk4(air, grain, table, note[TRI], x, y, vx, vy, t, h)
            note[TAKEN] += 1
            if not (math.isfinite(x1) and math.isfinite(y1)):
                note[END] = UNFINISHED
                break
            body, kind, which = _touches(walls, x1, y1, r)
            if body >= 0:
                high, kind, which = _first_touch(walls, r, h, x, y, vx, vy, x1, y1, vx1, vy1, kind, which)
                x2, y2, vx2, vy2, tri2 = _rk4(air, grain, table, note[TRI], x, y, vx, vy, t, high)
                state[at.X], state[at.Y], state[at.VX], state[at.VY] = x2, y2, vx2, vy2
                if _bounce(state, t, grain, walls, hold, kind, which):
                    t += high
                    note[STRUCK] += 1
                    note[TRI], _ = _find(air, tri2, state[at.X], state[at.Y])
                    if note[STRUCK] > IMPACTS:
                        note[END] = UNFINISHED
                    continue
            found, code = _find(air, tri, x1, y1)
            state[at.X], state[at.Y], state[at.VX], state[at.VY] = x1, y1, vx1, vy1
            t += h
            if code < 0:
                _end_at_edge(state, air, found, x, y, vx, vy, h)
                note[END] = LANDED
                t += state[at.T] - h
            note[TRI] = found
            if note[END] == FLYING and t >= until:
                note[END] = AIRBORNE
        clocks[i] = t


@compiled
def _end_at_edge(state, air, tri, x, y, vx, vy, h):
    """Put the end of the track where the step's Hermite cubic leaves the triangle; T becomes its time in
    the step.
    """
    edge, worst = 0, 0.0
    for k in range(3):
        value = barycentric(air.geometry, tri, k, state[at.X], state[at.Y])
        if value < worst:
            edge, worst = k, value
    x1, y1, vx1, vy1 = state[at.X], state[at.Y], state[at.VX], state[at.VY]
    low, high = 0.0, h
    for _ in range(60):
        s = 0.5 * (low + high)
        state[at.X], state[at.Y] = _hermite(s, h, x, vx, x1, vx1), _hermite(s, h, y, vy, y1, vy1)
        if barycentric(air.geometry, tri, edge, state[at.X], state[at.Y]) < 0.0:
            high = s
        else:
            low = s
    state[at.T] = high


def fly_explicit(
    field: FlowField,
    grains: Granules,
    *,
    until: float,
    step: float,
    forces: Sequence[str] = ("drag", "gravity"),
    drag: str = "brown-lawler",
    bodies: Sequence[Body] = (),
    length: float = 1.0,
    gravity: Sequence[float] = (0.0, -GRAVITY),
    workers: int | None = None,
) -> ExplicitTracks:
    """Follow ``grains`` past bodies at rest with steps of ``step`` (s) until each leaves the mesh or the clock shows
    ``until`` (s). Arguments as those of ``track``.
    """
    if field.coefficients is not None or field.motion is not None:
        raise SceneError("the explicit tracker knows steady fields and snapshots: field.snapshots()")
    count = len(grains)
    air = pack_air(field, bodies, 1e-6 * length, tuple(forces))
    walls = pack_walls(bodies, pack_lines(()), restitution=grains.restitution)
    tables, table_of = pack_tables(drag, grains.sphericity, grains.fraction)
    constants = pack_granules(grains, field, forces, gravity)
    states = np.zeros((count, at.T + 1))
    states[:, [at.X, at.Y]], states[:, [at.VX, at.VY]] = grains.position, grains.velocity
    states[:, at.SPIN] = grains.spin
    clocks = np.array(grains.time)
    ints = np.zeros((count, 4), dtype=np.int64)
    ints[:, TRI] = field.locate(grains.position)
    ints[ints[:, TRI] < 0, END] = UNFINISHED

    def fly(low: int) -> Any:
        part = slice(low, low + BLOCK)
        block = (states[part], clocks[part], ints[part], constants[part], tables, table_of[part])
        return fly_explicit_block(*block, air, walls, float(step), float(until), np.zeros(at.CONSTRAINT))

    with ThreadPoolExecutor(max_workers=workers or cores()) as pool:
        list(pool.map(fly, range(0, count, BLOCK)))
    return ExplicitTracks(
        states[:, at.X : at.Y + 1].copy(), clocks, ints[:, END] == LANDED, ints[:, TAKEN], ints[:, STRUCK]
    )
