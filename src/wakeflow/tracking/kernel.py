"""The kernel: every granule flies on its own clock until a fate ends its track.

A granule's step is cut at the first of: leaving its triangle, touching a wall, crossing a line, the next snapshot, the end. Each
is found on the dense output of the step, so a cut costs neither evaluations nor order.
"""

from __future__ import annotations

import math

from ..laws.collision import collide
from .events import PLANE, SPEED, SPIN, displacement, first_below
from .exponential import along
from .jit import compiled, entry, inlined
from .locate import air_at, barycentric, bracket, load, reproject, walk
from .state import (
    AIRBORNE,
    ARM,
    BINNED,
    BODY,
    CAPTURED,
    CONTACT,
    ESCAPED,
    FATE,
    FEATURE,
    FLYING,
    FREE,
    FRESH,
    FRICTION,
    GAP,
    GX,
    GY,
    H_ERROR,
    HELD,
    HOPS,
    IMPACTS,
    KIND,
    LINE,
    MOBILITY,
    MU,
    NOBODY,
    NX,
    NY,
    ON_EDGE,
    ON_VERTEX,
    OX,
    OY,
    RADIUS,
    RESTING,
    RESTITUTION,
    SEEN,
    SIGN,
    STEPS,
    STOPPED,
    STORED,
    STRIDE,
    STUCK,
    T_END,
    TRI,
    VX,
    VY,
    WW,
    T,
    X,
    Y,
)  # fmt: skip
from .state import (
    SPIN as TURN,
)
from .step import attempt, drag_rate, exit_time, free_force
from .walls import constrain, crossing, first_contact, grasp, inside, overlap

__all__ = ["fly_block"]

_collide = compiled(collide)
EDGE = 1e-11  # barycentric distance below which a granule is on an edge
SLOW = 1e-6  # m/s, rebounds slower than this are sliding
STATIC = 1e-12  # round-off of a friction coefficient: what is exactly balanced is held
PROGRESS = 1e-8  # of the step tried: less is none
HOP_LIMIT = 60  # crossings of edges or contacts in a row without progress
NOTHING, EXIT, WALL, CROSSED, SLID_OFF, HALTED, LIFTED = range(7)


@compiled
def _store(state, ints, record, last):  # type: ignore[no-untyped-def]
    """Keep a point of the track; when the room is full every second one goes and the stride doubles."""
    room = record.shape[0]
    if room == 0:
        return
    if last == 0 and ints[SEEN] % ints[STRIDE] != 0:
        ints[SEEN] += 1
        return
    if ints[STORED] == room - 1 and last == 0:
        half = (room - 1) // 2
        for i in range(half):
            for j in range(5):
                record[i, j] = record[2 * i, j]
        ints[STORED] = half
        ints[STRIDE] *= 2
    i = ints[STORED]
    record[i, 0] = state[T]
    record[i, 1], record[i, 2], record[i, 3], record[i, 4] = state[X], state[Y], state[VX], state[VY]
    ints[STORED] = i + 1
    ints[SEEN] += 1


@compiled
def _at_boundary(state, ints, air, walls, rules, k):  # type: ignore[no-untyped-def]
    """End the track on edge k of the mesh, or on the line that lies there."""
    tri, g = ints[TRI], air.geometry
    bx, by = g[tri, 2 + 2 * k], g[tri, 3 + 2 * k]
    off = barycentric(g, tri, k, state[X], state[Y]) / (bx * bx + by * by)
    state[X] -= off * bx
    state[Y] -= off * by
    ints[FATE] = ESCAPED
    near = 1e-9 * rules.extent + rules.allowance * rules.extent
    for i in range(walls.lines.shape[0]):
        x0, y0, x1, y1 = walls.lines[i, 0], walls.lines[i, 1], walls.lines[i, 2], walls.lines[i, 3]
        ex, ey = x1 - x0, y1 - y0
        w = ((state[X] - x0) * ex + (state[Y] - y0) * ey) / (ex * ex + ey * ey)
        w = min(1.0, max(0.0, w))
        dx, dy = state[X] - x0 - w * ex, state[Y] - y0 - w * ey
        if math.sqrt(dx * dx + dy * dy) <= near:
            ints[FATE], ints[LINE] = BINNED, walls.line_ids[i]
            return


@compiled
def _cross(state, ints, air, walls, rules, k):  # type: ignore[no-untyped-def]
    """Go over edge k of the current triangle."""
    onward = air.neighbours[ints[TRI], k]
    ints[FRESH] = 0
    if onward >= 0:
        ints[TRI] = onward
    elif onward == -1:
        _at_boundary(state, ints, air, walls, rules, k)
    else:
        ints[GAP] = -2 - onward


@inlined
def _hop(state, ints, air, walls, rules):  # type: ignore[no-untyped-def]
    """Cross at once an edge the granule stands on and moves out through. Returns whether it did."""
    tri, worst, edge = ints[TRI], 0.0, NOBODY
    for k in range(3):
        if barycentric(air.geometry, tri, k, state[X], state[Y]) <= EDGE:
            bx, by = air.geometry[tri, 2 + 2 * k], air.geometry[tri, 3 + 2 * k]
            rate = (bx * state[VX] + by * state[VY]) / math.sqrt(bx * bx + by * by)
            if rate < worst:
                worst, edge = rate, k
    if edge < 0:
        return False
    ints[HOPS] += 1
    _cross(state, ints, air, walls, rules, edge)
    return True


@compiled
def _settle(state, ints, hold, walls):  # type: ignore[no-untyped-def]
    """Put a sliding granule exactly on its surface, moving along it."""
    _, off = grasp(hold, walls, ints[CONTACT], ints[FEATURE], hold[ARM], state[X], state[Y], state[T])
    nx, ny = hold[NX], hold[NY]
    state[X] -= off * nx
    state[Y] -= off * ny
    _, _, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], state[T])
    vn = (state[VX] - wx) * nx + (state[VY] - wy) * ny
    state[VX] -= vn * nx
    state[VY] -= vn * ny


@compiled
def _strike(state, ints, hold, affine, grain, table, walls, rules, kind, which):  # type: ignore[no-untyped-def]
    """The granule touches a feature: collision, and sliding from then on where no bounce worth following is left."""
    body, off = grasp(hold, walls, kind, which, grain[RADIUS], state[X], state[Y], state[T])
    nx, ny = hold[NX], hold[NY]
    state[X] -= off * nx
    state[Y] -= off * ny
    ints[CONTACT] = FREE
    if walls.members[body, 5] == 1:
        ints[FATE] = CAPTURED
        hold[KIND] = FREE
        return
    e, f = walls.bodies[body, 8], walls.bodies[body, 9]
    e = grain[RESTITUTION] if e < 0.0 else e
    f = grain[FRICTION] if f < 0.0 else f
    _, _, wx, wy, px, py = displacement(walls.bodies, body, state[T])
    vx, vy, spin, normal, _ = _collide(
        state[VX], state[VY], state[TURN], nx, ny, wx, wy, e, f, grain[MOBILITY], grain[RADIUS]
    )
    if normal > 0.0:
        ints[IMPACTS] += 1
    state[VX], state[VY], state[TURN] = vx, vy, spin
    fx, fy, _, _ = free_force(affine, grain, table, state[X], state[Y], vx, vy, state[T])
    rebound = (vx - wx) * nx + (vy - wy) * ny
    slide = -ny * (vx - wx) + nx * (vy - wy)
    lift = (fx - px) * nx + (fy - py) * ny
    if kind == ON_VERTEX:
        lift += slide * slide / grain[RADIUS]
    if lift < 0.0 and (rebound <= SLOW or rebound * rebound <= -2.0 * lift * rules.tiny):
        ints[CONTACT], ints[FEATURE], ints[BODY] = kind, which, body
        hold[MU] = f
        state[VX] -= rebound * nx
        state[VY] -= rebound * ny
        state[H_ERROR] = math.inf
    else:
        hold[KIND] = FREE


@compiled
def _carried(state, ints, hold, affine, grain, table, walls, dt):  # type: ignore[no-untyped-def]
    """Whether friction still holds after riding with the wall for dt, and where and how fast the granule is then."""
    t = state[T]
    x0, y0, _, _, _, _ = displacement(walls.bodies, ints[BODY], t)
    x1, y1, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], t + dt)
    x, y = state[X] + x1 - x0, state[Y] + y1 - y0
    fx, fy, _, _ = free_force(affine, grain, table, x, y, wx, wy, t + dt)
    _, _, press, free, _ = constrain(hold, fx, fy, x, y, wx, wy, t + dt)
    return press > 0.0 and abs(free) <= (hold[MU] + STATIC) * press, x, y, wx, wy


@compiled
def _hold_still(state, ints, hold, affine, grain, table, walls, rules, timed):  # type: ignore[no-untyped-def]
    """A granule at rest on a wall that friction holds: it rests for good, or rides on with the wall while it does."""
    moving = hold[WW] != 0.0
    if not moving and not timed:
        ints[FATE] = RESTING
        return
    dt = rules.until - state[T]
    if moving:
        dt = min(dt, 0.05 / hold[WW])
    if timed:
        dt = min(dt, 0.25 / affine[15] if affine[15] != 0.0 else dt, state[T_END] - state[T])
    end = state[T] + dt
    held, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, dt)
    if not held:  # let go within: find out when
        low, high = 0.0, dt
        for _ in range(60):
            middle = 0.5 * (low + high)
            held, _, _, _, _ = _carried(state, ints, hold, affine, grain, table, walls, middle)
            if held:
                low = middle
            else:
                high = middle
        _, x, y, vx, vy = _carried(state, ints, hold, affine, grain, table, walls, high)
        dt, end = high, state[T] + high
    state[HELD] += dt
    if state[HELD] > rules.rest:
        ints[FATE] = RESTING
        return
    state[X], state[Y], state[VX], state[VY], state[T] = x, y, vx, vy, end


@compiled
def _grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed):  # type: ignore[no-untyped-def]
    """For a granule in contact: lifted off, held by static friction, or sliding. Returns whether it was dealt with."""
    hold[SIGN] = 0.0
    _, _, press, free, slide = constrain(hold, fx, fy, state[X], state[Y], state[VX], state[VY], state[T])
    if press <= 0.0:
        state[HELD] = 0.0
        ints[CONTACT] = FREE
        hold[KIND] = FREE
        return False
    if abs(slide) <= 1e-13 * (rules.length + abs(free)):
        if abs(free) <= (hold[MU] + STATIC) * press:
            _hold_still(state, ints, hold, affine, grain, table, walls, rules, timed)
            return True
        slide = free
    hold[SIGN] = 1.0 if slide > 0.0 else -1.0
    state[HELD] = 0.0
    return False


@compiled
def _ends_of_slide(path, ints, hold, walls, rules, s, t0):  # type: ignore[no-untyped-def]
    """The first of: sliding stops, or the end of the face or corner is reached. Returns (time, event, next kind, next feature)."""
    bodies, body, skin = walls.bodies, ints[BODY], 1e-3 * rules.skin
    event, kind, which = NOTHING, FREE, NOBODY
    x, y, vx, vy = along(path, 0.0)
    dx, dy, wx, wy, _, _ = displacement(bodies, body, t0)
    qx, qy, rx, ry = x - dx - hold[OX], y - dy - hold[OY], vx - wx, vy - wy
    x, y, vx, vy = along(path, s)
    dx, dy, wx, wy, _, _ = displacement(bodies, body, t0 + s)
    ex, ey, ux, uy = x - dx - hold[OX], y - dy - hold[OY], vx - wx, vy - wy
    sign, feature = hold[SIGN], ints[FEATURE]
    if hold[KIND] == ON_EDGE:
        tx, ty, size = -hold[NY], hold[NX], walls.edges[feature, 6]
        wa, wb = sign * (tx * rx + ty * ry), sign * (tx * ux + ty * uy)
        if wa > 0.0 and wb < 0.0:
            s = first_below(
                path, t0, bodies, body, SPEED, 0.0, 0.0, 0.0, sign * tx, sign * ty, 0.0, wa, 0.0, s, wb, 0.0, 0.0
            )
            event = HALTED
        for end in range(2):
            q0 = 0.0 if end == 0 else size
            dx, dy = (tx, ty) if end == 0 else (-tx, -ty)
            fa, fb = q0 + dx * qx + dy * qy, q0 + dx * ex + dy * ey
            ra, rb = dx * rx + dy * ry, dx * ux + dy * uy
            if fa < -rules.skin and ra >= 0.0:
                continue
            found = first_below(
                path, t0, bodies, body, PLANE, hold[OX], hold[OY], q0, dx, dy, 0.0, fa, ra, s, fb, rb, skin
            )
            if 0.0 <= found <= s and (fb < 0.0 or found < s):
                s, event = found, SLID_OFF
                which = walls.edge_links[feature, 1 + end]
                kind = ON_VERTEX if which >= 0 else FREE
        return s, event, kind, which
    wa, wb = sign * (qx * ry - qy * rx), sign * (ex * uy - ey * ux)
    if wa > 0.0 and wb < 0.0:
        s = first_below(path, t0, bodies, body, SPIN, hold[OX], hold[OY], sign, 0.0, 0.0, 0.0, wa, 0.0, s, wb, 0.0, 0.0)
        event = HALTED
    for end in range(2):  # beyond the direction of the edge that ends here, before that of the edge that starts here
        e = walls.vertex_links[feature, 1 + end]
        if e < 0:
            continue
        tx, ty = -walls.edges[e, 5], walls.edges[e, 4]
        dx, dy = (tx, ty) if end == 0 else (-tx, -ty)
        fa, fb = dx * qx + dy * qy, dx * ex + dy * ey
        ra, rb = dx * rx + dy * ry, dx * ux + dy * uy
        found = first_below(
            path, t0, bodies, body, PLANE, hold[OX], hold[OY], 0.0, dx, dy, 0.0, fa, ra, s, fb, rb, skin
        )
        if 0.0 <= found <= s and (fb < 0.0 or found < s):
            s, event, kind, which = found, SLID_OFF, ON_EDGE, e
    return s, event, kind, which


@compiled
def _pressed(path, s, t0, affine, grain, table, hold):  # type: ignore[no-untyped-def]
    x, y, vx, vy = along(path, s)
    fx, fy, _, _ = free_force(affine, grain, table, x, y, vx, vy, t0 + s)
    _, _, press, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t0 + s)
    return press


@compiled
def _begin(state, ints, hold, air, grain, walls, rules):  # type: ignore[no-untyped-def]
    """The start of a track: inside a body it stops, reaching into one it is pushed out, outside the mesh it ends."""
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = displacement(walls.bodies, body, state[T])
        within, _ = inside(walls, body, state[X] - dx, state[Y] - dy)
        if within:
            ints[FATE] = STOPPED
            return
    moved = False
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = displacement(walls.bodies, body, state[T])
        depth, kind, which = overlap(walls, body, state[X] - dx, state[Y] - dy, grain[RADIUS])
        if depth > 0.0:
            _, off = grasp(hold, walls, kind, which, grain[RADIUS], state[X], state[Y], state[T])
            state[X] -= off * hold[NX]
            state[Y] -= off * hold[NY]
            hold[KIND] = FREE
            moved = True
    if air.corners.shape[0] == 0:
        return
    if ints[TRI] < 0 and ints[GAP] < 0:
        ints[FATE] = ESCAPED
    elif moved and ints[TRI] >= 0:
        found, code = walk(air.geometry, air.neighbours, ints[TRI], state[X], state[Y])
        ints[TRI] = found
        if code <= -2:
            ints[GAP] = -2 - code
        elif code == -1:
            ints[FATE] = ESCAPED


@inlined
def _longest(state, ints, path, hold, air, grain, walls, rules, timed, speed, pull, edge):  # type: ignore[no-untyped-def]
    """The longest step worth trying: end, snapshot, triangle, last error, and nearly straight where there are walls."""
    h = min(rules.until - state[T], state[H_ERROR])
    if timed:
        h = min(h, state[T_END] - state[T])
    if air.corners.shape[0] > 0:
        if ints[GAP] >= 0:
            if speed > 0.0:
                h = min(h, 0.5 * edge / speed)
        else:
            h = min(h, exit_time(air.geometry, ints[TRI], path, 1e-3))
    if walls.bodies.shape[0] > 0:  # nearly straight where bodies may be met
        x, y = state[X], state[Y]
        away = max(rules.left - x, x - rules.right, rules.bottom - y, y - rules.top, 0.0) - grain[RADIUS]
        half = 0.5 * rules.length + max(away, 0.0)
        slow = speed + math.sqrt(half * pull)
        if slow > 0.0:
            h = min(h, half / slow)
    if ints[STUCK] >= HOP_LIMIT:  # too many contacts in no time: a step too short to reach into a wall, without looking
        h = min(h, math.sqrt(rules.skin / (pull + 1e-3 * rules.length)))
    if hold[KIND] != FREE:
        if hold[WW] != 0.0:
            h = min(h, 0.2 / hold[WW])
        if hold[KIND] == ON_VERTEX:
            h = min(h, 0.2 * hold[ARM] / (speed + math.sqrt(hold[ARM] * pull)))
    return h


@inlined
def _accept(path, h, state, affine, grain, table, hold, rules, speed, pull):  # type: ignore[no-untyped-def]
    """Try steps from h down until the estimated error is within the allowance; returns the step, 0.0 when none is."""
    shortest = 1e-13 * rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300)
    for rejected in range(60):
        horizon = min(rules.until - state[T], rules.extent / (speed + math.sqrt(rules.extent * pull) + 1e-300))
        error, fast = attempt(path, h, state[T], affine, grain, table, hold, horizon)
        allowed = rules.allowance * h * max(speed, math.sqrt(fast)) + 1e-15 * rules.extent
        if error <= allowed or (h <= shortest and math.isfinite(error)):
            state[H_ERROR] = h * min(5.0, 0.9 * (allowed / error) ** (1.0 / 3.0)) if error > 0.0 else math.inf
            return h
        # a velocity transient shorter than the step shrinks the error no faster than the step: then go down quickly
        most = 0.9 if rejected == 0 else (0.5 if rejected < 4 else 0.1)
        h *= max(0.1, most * min(1.0, (allowed / error) ** (1.0 / 3.0))) if math.isfinite(error) else 0.1
    return 0.0


@inlined
def _leaves(path, h, ints, air):  # type: ignore[no-untyped-def]
    """When and across which edge the step leaves the triangle: (time, edge), edge -1 when it does not."""
    g, tri = air.geometry, ints[TRI]
    x, y, vx, vy = along(path, h)
    s, edge = h, NOBODY
    for k in range(3):
        bx, by = g[tri, 2 + 2 * k], g[tri, 3 + 2 * k]
        fb, rb = barycentric(g, tri, k, x, y), bx * vx + by * vy
        ra = bx * path[2] + by * path[3]
        if fb > 0.0 and not (ra < 0.0 and rb > 0.0):
            continue
        fa = barycentric(g, tri, k, path[0], path[1])
        q0 = 1.0 if k == 0 else 0.0
        found = first_below(path, 0.0, g, NOBODY, PLANE, g[tri, 0], g[tri, 1], q0, bx, by, 0.0, fa, ra, h, fb, rb, EDGE)
        if found >= 0.0 and (found < s or (found == s and fb <= 0.0)):
            s, edge = found, k
    return s, edge


@compiled
def _lift(path, s, t0, affine, grain, table, hold):  # type: ignore[no-untyped-def]
    """When the wall stops pressing within [0, s] (bisection); s when it presses to the end."""
    if _pressed(path, s, t0, affine, grain, table, hold) > 0.0:
        return s, False
    low, high = 0.0, s
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _pressed(path, middle, t0, affine, grain, table, hold) > 0.0:
            low = middle
        else:
            high = middle
    return high, True


@inlined
def _advance(end, s, h, state, ints, rules):  # type: ignore[no-untyped-def]
    """Move to time s of the step; clocks that were aimed at are met exactly."""
    t0 = state[T]
    state[X], state[Y], state[VX], state[VY] = end
    state[T] = t0 + s
    if s == h:
        if h == rules.until - t0:
            state[T] = rules.until
        elif h == state[T_END] - t0:
            state[T] = state[T_END]
    if s > PROGRESS * h:
        ints[HOPS] = 0
        ints[STUCK] = 0


@inlined
def _rescue(state, ints, hold, affine, grain, table, walls, rules):  # type: ignore[no-untyped-def]
    """No centre is ever left inside a body: put it back on the nearest edge, as a contact."""
    for body in range(walls.bodies.shape[0]):
        dx, dy, _, _, _, _ = displacement(walls.bodies, body, state[T])
        within, nearest = inside(walls, body, state[X] - dx, state[Y] - dy)
        if within:
            _strike(state, ints, hold, affine, grain, table, walls, rules, ON_EDGE, nearest)


@inlined
def _refresh(state, ints, affine, air, grain, timed):  # type: ignore[no-untyped-def]
    """Load the affine field of the current place and snapshot interval where they changed; length of a boundary edge."""
    edge = 0.0
    if ints[GAP] >= 0:
        edge = reproject(state, ints, air)
    if timed and state[T] >= state[T_END]:
        bracket(state, ints, affine, air.times, air.period[0])
    if ints[FRESH] == 0:
        load(state, ints, affine, air, grain)
    return edge


@inlined
def _one_step(state, ints, path, affine, hold, air, grain, table, walls, rules, timed, edge, record):  # type: ignore[no-untyped-def]
    """One step and what ends it."""
    x, y, vx, vy, t0 = state[X], state[Y], state[VX], state[VY], state[T]
    ux, uy, ax, ay = air_at(affine, x, y, t0)
    rate = drag_rate(grain, table, (ux - vx) ** 2 + (uy - vy) ** 2)
    fx, fy, wind2 = rate * (ux - vx) + ax, rate * (uy - vy) + ay, ux * ux + uy * uy
    pull = math.sqrt(affine[8] ** 2 + affine[11] ** 2)
    speed = math.sqrt(max(vx * vx + vy * vy, wind2 if rate > 0.0 else 0.0))
    if hold[KIND] != FREE:
        if _grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed):
            return
        if hold[KIND] != FREE:
            fx, fy, _, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t0)
    path[0], path[1], path[2], path[3], path[4] = x, y, vx, vy, rate
    path[5], path[6], path[11], path[12] = fx + rate * vx, fy + rate * vy, ux, uy
    h = _longest(state, ints, path, hold, air, grain, walls, rules, timed, speed, pull, edge)
    h = _accept(path, h, state, affine, grain, table, hold, rules, speed, pull)
    if not h > 0.0:
        ints[FATE] = STOPPED
        return
    s, event, kind, which, line = h, NOTHING, FREE, NOBODY, NOBODY
    meshed = air.corners.shape[0] > 0 and ints[GAP] < 0
    blind = ints[HOPS] >= HOP_LIMIT
    if meshed and not blind:
        s, which = _leaves(path, h, ints, air)
        event = EXIT if which >= 0 else NOTHING
    if hold[KIND] != FREE:
        s, lifted = _lift(path, s, t0, affine, grain, table, hold)
        event = LIFTED if lifted else event
        s, slid, next_kind, next_which = _ends_of_slide(path, ints, hold, walls, rules, s, t0)
        if slid != NOTHING:
            event, kind, which = slid, next_kind, next_which
    end = along(path, s)
    if walls.bodies.shape[0] > 0 and ints[STUCK] < HOP_LIMIT:
        found, hit_kind, hit = first_contact(path, s, end, t0, grain[RADIUS], rules.skin, walls, ints)
        if found >= 0.0:
            s, event, kind, which = found, WALL, hit_kind, hit
            end = along(path, s)
    found, line = crossing(path, s, end, walls.lines, walls.line_ids, rules.skin)
    if found >= 0.0:
        s, event = found, CROSSED
        end = along(path, s)
    ints[STEPS] += 1
    _advance(end, s, h, state, ints, rules)
    if hold[KIND] != FREE:
        _settle(state, ints, hold, walls)
    if event == CROSSED:
        ints[FATE], ints[LINE] = BINNED, line
        return
    if event == EXIT:
        if s <= PROGRESS * h:
            ints[HOPS] += 1
        _cross(state, ints, air, walls, rules, which)
    elif event == WALL:
        ints[STUCK] += 1
        _strike(state, ints, hold, affine, grain, table, walls, rules, kind, which)
        if ints[STUCK] == HOP_LIMIT and walls.bodies[ints[BODY], 6] == 0.0 and ints[CONTACT] != FREE:
            if state[VX] ** 2 + state[VY] ** 2 <= 1e-8 * rules.length * pull:  # pressed into a corner
                ints[FATE] = RESTING
    elif event == HALTED:
        _, _, wx, wy, _, _ = displacement(walls.bodies, ints[BODY], state[T])
        state[VX], state[VY] = wx, wy
    elif event == LIFTED:
        ints[CONTACT] = hold[KIND] = FREE
    elif event == SLID_OFF:
        ints[CONTACT] = kind
        ints[FEATURE] = which
        ints[STUCK] += 1
        if kind == FREE:
            hold[KIND] = FREE
        else:
            grasp(hold, walls, kind, which, grain[RADIUS], state[X], state[Y], state[T])
    if ints[FATE] == FLYING and walls.bodies.shape[0] > 0 and event != WALL and hold[KIND] == FREE:
        _rescue(state, ints, hold, affine, grain, table, walls, rules)
    if meshed and blind and ints[FATE] == FLYING:
        found_tri, code = walk(air.geometry, air.neighbours, ints[TRI], state[X], state[Y])
        ints[TRI], ints[FRESH] = found_tri, 0
        if code <= -2:
            ints[GAP] = -2 - code
        elif code == -1:
            ints[FATE] = ESCAPED
    _store(state, ints, record, 0)


@inlined
def _born(state, ints, affine, hold, air, grain, walls, rules, timed):  # type: ignore[no-untyped-def]
    """Scratch and state of a new granule."""
    affine[:] = 0.0
    hold[:] = 0.0
    ints[STRIDE] = 1
    state[T_END] = -math.inf if timed else math.inf
    state[H_ERROR] = math.inf
    if air.corners.shape[0] == 0:
        affine[8], affine[11] = grain[GX], grain[GY]
        ints[FRESH] = 1
    _begin(state, ints, hold, air, grain, walls, rules)


@entry
def fly_block(states, counts, grains, tables, table_of, air, walls, rules, records, path, affine, hold):  # type: ignore[no-untyped-def]
    """Track a block of granules, each from birth to its fate; path, affine and hold are the block's scratch."""
    timed = air.times.shape[0] > 1 and air.corners.shape[0] > 0
    for i in range(states.shape[0]):
        state, ints, grain, table, record = states[i], counts[i], grains[i], tables[table_of[i]], records[i]
        _born(state, ints, affine, hold, air, grain, walls, rules, timed)
        _store(state, ints, record, 0)
        while ints[FATE] == FLYING:
            if state[T] >= rules.until:
                ints[FATE] = AIRBORNE
            elif ints[STEPS] >= rules.steps:
                ints[FATE] = STOPPED
            else:
                edge = _refresh(state, ints, affine, air, grain, timed)
                if air.corners.shape[0] > 0 and ints[GAP] < 0 and ints[HOPS] < HOP_LIMIT:
                    if _hop(state, ints, air, walls, rules):
                        continue
                _one_step(state, ints, path, affine, hold, air, grain, table, walls, rules, timed, edge, record)
        _store(state, ints, record, 1)
