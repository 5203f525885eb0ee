"""Classical Runge-Kutta of order 4 at a fixed step, on the tracker's own triangles: the explicit tracker to compare
with, and, with steps that end at every kink, the reference of the benchmark.

Linear interpolation, a cached triangle and a walk from it, the same drag table, granules in blocks on all cores. What
ends a track, and a contact, is found by halving the step until it ends there. The explicit tracker lacks what
wakeflow's adds: it loses its order at the field's kinks on the triangles' edges, it is unstable for dust, and it does
not know its error. Steps that are ``confined`` to one triangle and to the time between two snapshots meet no kinks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from wakeflow.air.field import FlowField
from wakeflow.core.code_key import kernel_folder
from wakeflow.core.errors import SceneError
from wakeflow.core.process import cores
from wakeflow.core.store import digest_files
from wakeflow.flight.bodies import Body
from wakeflow.flight.granules import Granules
from wakeflow.flight.kernel import layout as at
from wakeflow.flight.kernel.air import drag_rate, shares
from wakeflow.flight.kernel.jit import OPTIONS, compiled
from wakeflow.flight.kernel.locate import anywhere, barycentric, walk
from wakeflow.flight.kernel.strike import restitution_of
from wakeflow.flight.kernel.walls import grasp, inside, overlap
from wakeflow.flight.pack import pack_granules, pack_tables
from wakeflow.flight.pack_surroundings import pack_air, pack_lines, pack_walls
from wakeflow.laws.collision import collide
from wakeflow.laws.constants import GRAVITY

Array = NDArray[np.float64]
Index = NDArray[np.int64]
BLOCK, ONE_BY_ONE = 64, 1  # granules that a core takes at a time
IMPACTS = 50  # below it the granule slides, which is not followed here
HALVINGS = 50  # of a step, to end it at an event
MAX_STEPS = 20_000_000  # of a granule
OUTSIDE = -1e-10  # barycentric coordinate from which a point is beyond an edge
NEAR = 1e-12  # of times: a clock that is so close below a snapshot has reached it
SKIN = 1e-13  # m: a granule that reaches no further into a wall has only just left it
CROSSED = -1  # an event that is no contact: the step leaves a triangle
KNOWN_FORCES = {"drag", "gravity", "buoyancy"}
FLYING, LANDED, AIRBORNE, UNFINISHED = range(4)
TRI, END, TAKEN, STRUCK = range(4)  # columns of a granule's counts: triangle, how it ended, steps, impacts
_collide = compiled(collide)


def _entry(function: Any) -> Any:
    """Compiled once for these sources and the tracker's, as ``kernel.jit.entry`` compiles the package's own."""
    before, tracker = numba.config.CACHE_DIR, kernel_folder("wakeflow.flight.driver")
    numba.config.CACHE_DIR = str(tracker.with_name(f"{tracker.name}-{digest_files([Path(__file__)])[:12]}"))
    try:
        return numba.njit(cache=True, **OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = before


@dataclass(frozen=True)
class Ends:
    """Where granules ended: ``position`` (n, 2) m and ``time`` (n,) s, on the mesh's edge where they ``landed`` (n,);
    impacts (n,) and steps (n,), None where they are not known.
    """

    position: Array
    time: Array
    landed: NDArray[np.bool_]
    impacts: Index | None
    steps: Index | None = None


@compiled
def _interval(air, t):
    """The two snapshots, or the knots, around time t, when the first of them is, the rate of the second's weight, and
    when the second is; a time this close below one has reached it.
    """
    times, last, period, turn = air.times, air.times.shape[0] - 1, air.period[0], 0.0
    if air.smooth[at.KNOT_RATE] != 0.0:
        t0, per, count = air.smooth[at.KNOT_FIRST], air.smooth[at.KNOT_RATE], air.smooth[at.KNOT_COUNT]
        n = math.floor((t + NEAR * (abs(t) + count / per) - t0) * per)
        low = int(n - math.floor(n / count) * count)
        return low, low + 1, t0 + n / per, per, t0 + (n + 1.0) / per
    if last == 0:
        return 0, 0, 0.0, 0.0, math.inf
    t += NEAR * (abs(t) + times[last] - times[0])
    if period > 0.0:
        turn = math.floor((t - times[0]) / period) * period
    elif t <= times[0] or t >= times[last]:
        return (0, 0, 0.0, 0.0, times[0]) if t <= times[0] else (last, last, 0.0, 0.0, math.inf)
    low = int(np.searchsorted(times, t - turn, side="right")) - 1
    begin, end, onward = times[low] + turn, times[0] + period + turn, 0
    if low < last:
        end, onward = times[low + 1] + turn, low + 1
    return low, onward, begin, 1.0 / (end - begin), end


@compiled
def _on_knots(air, c, a, w, m):
    """Value ``m`` of node c at part w of the interval that begins with knot a."""
    s0, s1, s2, s3 = shares(w)
    v = air.values
    return s0 * v[c, a, m] + s1 * v[c, a + 1, m] + s2 * v[c, a + 2, m] + s3 * v[c, a + 3, m]


@compiled
def _between(air, tri, one, two, a, b, w, m):
    """Value ``m`` of the nodes at barycentric coordinates ``one`` and ``two``, between snapshots, or knots, a and b."""
    i, j, k = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    v, zero = air.values, 1.0 - one - two
    if air.smooth[at.KNOT_RATE] != 0.0:
        return zero * _on_knots(air, i, a, w, m) + one * _on_knots(air, j, a, w, m) + two * _on_knots(air, k, a, w, m)
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
    rate = drag_rate(grain, table, sx * sx + sy * sy)
    return grain[at.GX] + rate * sx, grain[at.GY] + rate * sy


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
def _stage(air, grain, table, tri, x, y, vx, vy, t, t0, look):
    """Acceleration at time t of a step that began at t0, and the triangle that it is of: where not to ``look``, the one
    that is given, and the snapshots around t0.
    """
    if look:
        tri, _ = _find(air, tri, x, y)
    a, b, begin, rate, _ = _interval(air, t if look else t0)
    ax, ay = _acceleration(air, grain, table, tri, x, y, vx, vy, a, b, (t - begin) * rate)
    return ax, ay, tri


@compiled
def _rk4(air, grain, table, tri, x, y, vx, vy, t, h, look):
    """One step from triangle ``tri``; returns the new state and the triangle of its last stage."""
    ax, ay, tri = _stage(air, grain, table, tri, x, y, vx, vy, t, t, False)
    vx2, vy2, x2, y2 = vx + 0.5 * h * ax, vy + 0.5 * h * ay, x + 0.5 * h * vx, y + 0.5 * h * vy
    ax2, ay2, tri = _stage(air, grain, table, tri, x2, y2, vx2, vy2, t + 0.5 * h, t, look)
    vx3, vy3, x3, y3 = vx + 0.5 * h * ax2, vy + 0.5 * h * ay2, x + 0.5 * h * vx2, y + 0.5 * h * vy2
    ax3, ay3, tri = _stage(air, grain, table, tri, x3, y3, vx3, vy3, t + 0.5 * h, t, look)
    vx4, vy4, x4, y4 = vx + h * ax3, vy + h * ay3, x + h * vx3, y + h * vy3
    ax4, ay4, tri = _stage(air, grain, table, tri, x4, y4, vx4, vy4, t + h, t, look)
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
    """With which feature a granule at rest on (x, y) reaches into a body: (kind, which), FREE for none."""
    for body in range(walls.bodies.shape[0]):
        b = walls.bodies
        if b[body, at.LOW_X] - r < x < b[body, at.HIGH_X] + r and b[body, at.LOW_Y] - r < y < b[body, at.HIGH_Y] + r:
            within, nearest = inside(walls, body, x, y)
            if within:
                return at.ON_EDGE, nearest
            depth, kind, which = overlap(walls, body, x, y, r)
            if depth > SKIN:
                return kind, which
    return at.FREE, at.NOBODY


@compiled
def _crossed(air, tri, x, y, confined):
    """The edge of a triangle that a point is farthest beyond, of all edges or, where steps are not ``confined``, of
    those of the mesh; NOBODY for none, and in no triangle.
    """
    worst, edge = OUTSIDE, at.NOBODY
    for k in range(3 if tri >= 0 else 0):
        value = barycentric(air.geometry, tri, k, x, y)
        if value < worst and (confined or air.neighbours[tri, k] < 0):
            worst, edge = value, k
    return edge


@compiled
def _event(air, walls, tri, x, y, r, confined):
    """What a granule on (x, y) has come to: a body's feature (kind, which), CROSSED and an edge of ``tri``, or FREE."""
    kind, which = _touches(walls, x, y, r)
    if kind == at.FREE:
        which = _crossed(air, tri, x, y, confined)
        kind = CROSSED if which >= 0 else at.FREE
    return kind, which


@compiled
def _first(air, walls, tri, r, confined, h, x, y, vx, vy, x1, y1, vx1, vy1, kind, which):
    """When a step that ends beyond an event comes to the first one, and that event (bisection on the Hermite cubic)."""
    low, high = 0.0, h
    for _ in range(HALVINGS):
        s = 0.5 * (low + high)
        found, feature = _event(
            air, walls, tri, _hermite(s, h, x, vx, x1, vx1), _hermite(s, h, y, vy, y1, vy1), r, confined
        )
        if found == at.FREE:
            low = s
        else:
            high, kind, which = s, found, feature
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


@compiled
def _step(state, note, t, grain, table, air, walls, h, confined, hold):
    """One step of at most ``h``; how long it was."""
    x, y, vx, vy, r, tri = state[at.X], state[at.Y], state[at.VX], state[at.VY], grain[at.RADIUS], note[TRI]
    if confined:
        h = min(h, _interval(air, t)[4] - t)
    x1, y1, vx1, vy1, last = _rk4(air, grain, table, tri, x, y, vx, vy, t, h, not confined)
    note[TAKEN] += 1
    if not (math.isfinite(x1) and math.isfinite(y1)) or note[TAKEN] > MAX_STEPS:
        note[END] = UNFINISHED
        return h
    onward, code = _find(air, last, x1, y1)
    watched = tri if confined else onward if code < 0 else at.NOBODY
    kind, which = _event(air, walls, watched, x1, y1, r, confined)
    if kind != at.FREE:
        watched = watched if confined or kind == CROSSED else at.NOBODY  # a step that is not may begin beyond an edge
        s, kind, which = _first(air, walls, watched, r, confined, h, x, y, vx, vy, x1, y1, vx1, vy1, kind, which)
        x2, y2, vx2, vy2, _ = _rk4(air, grain, table, tri, x, y, vx, vy, t, s, not confined)
        state[at.X], state[at.Y], state[at.VX], state[at.VY] = x2, y2, vx2, vy2
        if kind == CROSSED:
            note[TRI] = air.neighbours[watched, which]
            note[END] = LANDED if note[TRI] < 0 else FLYING
            return s
        if _bounce(state, t, grain, walls, hold, kind, which):
            note[TRI], _ = _find(air, tri, state[at.X], state[at.Y])
            note[STRUCK] += 1
            note[END] = UNFINISHED if note[STRUCK] > IMPACTS else FLYING
            return s
    state[at.X], state[at.Y], state[at.VX], state[at.VY] = x1, y1, vx1, vy1
    note[TRI] = onward
    return h


@_entry
def fly_explicit_block(states, clocks, ints, grains, tables, table_of, air, walls, steps, until, confined, hold):
    """A block of granules; ``states`` begin as those of the tracker; ``ints`` see TRI."""
    for i in range(states.shape[0]):
        note, table = ints[i], tables[table_of[i]]
        while note[END] == FLYING:
            h = min(steps[i], until - clocks[i])
            clocks[i] += _step(states[i], note, clocks[i], grains[i], table, air, walls, h, confined, hold)
            if note[END] == FLYING and clocks[i] >= until:
                note[END] = AIRBORNE


def fly_explicit(
    field: FlowField,
    grains: Granules,
    *,
    until: float,
    step: float | Array,
    confined: bool = False,
    seconds: float = math.inf,
    forces: Sequence[str] = ("drag", "gravity"),
    drag: str = "brown-lawler",
    bodies: Sequence[Body] = (),
    length: float = 1.0,
    gravity: Sequence[float] = (0.0, -GRAVITY),
) -> Ends:
    """Follow ``grains`` past bodies at rest with steps of ``step`` (s), of each or of all, until each leaves the mesh
    or the clock shows ``until`` (s); no more are begun after so many ``seconds``. Arguments as those of ``track``, and
    as there neighbours fly one after the other, since they look at the same nodes.
    """
    if field.motion or not set(forces) <= KNOWN_FORCES:
        raise SceneError("the explicit tracker knows drag, gravity and buoyancy, in fields that do not move")
    count, begun = len(grains), time.monotonic()
    order = np.argsort(grains.position[:, 0], kind="stable")
    steps, grains = np.broadcast_to(step, count)[order].astype(float), grains[order]
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
    block = ONE_BY_ONE if confined else BLOCK

    def fly(low: int) -> Any:
        part = slice(low, low + block)
        own = (states[part], clocks[part], ints[part], constants[part], tables, table_of[part])
        if time.monotonic() - begun <= seconds:
            fly_explicit_block(*own, air, walls, steps[part], float(until), confined, np.zeros(at.CONSTRAINT))

    with ThreadPoolExecutor(max_workers=cores()) as pool:
        list(pool.map(fly, range(0, count, block)))
    states, clocks, ints = (np.ascontiguousarray(rows[np.argsort(order)]) for rows in (states, clocks, ints))
    return Ends(states[:, at.X : at.Y + 1].copy(), clocks, ints[:, END] == LANDED, ints[:, STRUCK], ints[:, TAKEN])
