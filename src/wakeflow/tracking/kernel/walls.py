"""Bodies: first contact of a granule's surface with the outline on the dense output, and the constraint while it
slides.

A granule of radius r touches where its centre meets the outline offset by r: edges shifted outward, circles about
convex corners. Everything is done in the frame of the body, which may vibrate.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .dense_output import along
from .events import cubic, displacement, first_below, harmonic, interval, level
from .jit import compiled, inlined

__all__ = ["carry", "constrain", "crossing", "facing", "first_contact", "grasp", "inside", "overlap", "ride"]

STILL = 1e-13  # m/s, round-off: a granule that leaves a surface with it does not meet it again
BEND, BENDS = (
    0.05,
    64,
)  # sagitta over a granule's radius up to which its path by a corner counts as straight; pieces
TURN = 0.4  # rad of a body's vibration looked at in one piece; of samples: change of the acceleration over its peak


@compiled
def _overlaps(lo, hi, a, b, margin):
    return lo - margin <= b and hi + margin >= a


@compiled
def _edge_contact(path, t0, walls, e, r, skin, sa, sb, qa, qb, hull):
    """First contact with edge e within [sa, sb], or -1.0. q: position and velocity at both ends in the body's frame."""
    edges = walls.edges
    px, py, nx, ny, size = (
        edges[e, at.FROM_X],
        edges[e, at.FROM_Y],
        edges[e, at.OUT_X],
        edges[e, at.OUT_Y],
        edges[e, at.LENGTH],
    )
    fa = nx * (qa[0] - px) + ny * (qa[1] - py) - r
    fb = nx * (qb[0] - px) + ny * (qb[1] - py) - r
    ra, rb = nx * qa[2] + ny * qa[3], nx * qb[2] + ny * qb[3]
    if fa < -(r + skin) or (fb > 0.0 and fa > skin and not (ra < 0.0 and rb > 0.0)):
        return -1.0
    if not _overlaps(hull[0], hull[1], min(px, edges[e, at.TO_X]), max(px, edges[e, at.TO_X]), 1.01 * r + skin):
        return -1.0
    if not _overlaps(hull[2], hull[3], min(py, edges[e, at.TO_Y]), max(py, edges[e, at.TO_Y]), 1.01 * r + skin):
        return -1.0
    body = walls.edge_links[e, at.OWNER]
    ra = 0.0 if abs(ra) < STILL else ra
    s = first_below(path, t0, walls.bodies, body, events.PLANE, px, py, -r, nx, ny, sa, fa, ra, sb, fb, rb, skin)
    if s < 0.0:
        return -1.0
    x, y, vx, vy = along(path, s)
    dx, dy, wx, wy, _, _ = displacement(walls.bodies, body, t0 + s)
    foot = -ny * (x - dx - px) + nx * (y - dy - py)
    onward = -ny * (vx - wx) + nx * (vy - wy)
    near = 1e-3 * skin  # at the very end and on the way out it is the corner's
    return s if (0.0 if onward >= 0.0 else near) <= foot <= (size if onward <= 0.0 else size - near) else -1.0


@compiled
def _vertex_contact(path, t0, walls, v, r, skin, sa, sb, qa, qb, hull):
    """First contact with the circle about vertex v within [sa, sb], or -1.0."""
    px, py = walls.vertices[v, at.VERTEX_X], walls.vertices[v, at.VERTEX_Y]
    margin = 1.01 * r + skin
    if not (_overlaps(hull[0], hull[1], px, px, margin) and _overlaps(hull[2], hull[3], py, py, margin)):
        return -1.0
    ax, ay, bx, by = qa[0] - px, qa[1] - py, qb[0] - px, qb[1] - py
    da, db = math.sqrt(ax * ax + ay * ay), math.sqrt(bx * bx + by * by)
    if da == 0.0 or db == 0.0:
        return -1.0
    ra, rb = (ax * qa[2] + ay * qa[3]) / da, (bx * qb[2] + by * qb[3]) / db
    body = walls.vertex_links[v, at.OWNER]
    ra = 0.0 if abs(ra) < STILL else ra
    pieces = 1
    if ra >= 0.0 and rb >= 0.0:  # a path that bends may leave the circle, come back through it and leave again
        bend = math.hypot(qb[2] - qa[2], qb[3] - qa[3]) * (sb - sa) / 8.0
        pieces = min(BENDS, 1 + int(math.sqrt(bend / (BEND * r))))
    s0, f0, r0 = sa, da - r, ra
    for piece in range(1, pieces + 1):
        s1, f1, r1 = sb, db - r, rb
        if piece < pieces:
            s1 = sa + (sb - sa) * piece / pieces
            f1, r1 = level(path, s1, t0, walls.bodies, body, events.ROUND, px, py, r, 0.0, 0.0)
        s = first_below(path, t0, walls.bodies, body, events.ROUND, px, py, r, 0.0, 0.0, s0, f0, r0, s1, f1, r1, skin)
        if s >= 0.0:
            return s
        s0, f0, r0 = s1, f1, r1
    return -1.0


@compiled
def _seen_from(state, t, bodies, body):
    """Position and velocity in the frame of a body."""
    dx, dy, wx, wy, _, _ = displacement(bodies, body, t)
    return state[0] - dx, state[1] - dy, state[2] - wx, state[3] - wy


@compiled
def _hull(qa, qb, span):
    """Box of the four Bezier points of the cubic with these ends, grown by a tenth: holds the path."""
    third = span / 3.0
    x1, x2 = qa[0] + third * qa[2], qb[0] - third * qb[2]
    y1, y2 = qa[1] + third * qa[3], qb[1] - third * qb[3]
    xl, xh = min(qa[0], qb[0], x1, x2), max(qa[0], qb[0], x1, x2)
    yl, yh = min(qa[1], qb[1], y1, y2), max(qa[1], qb[1], y1, y2)
    gx, gy = 0.1 * (xh - xl), 0.1 * (yh - yl)
    return xl - gx, xh + gx, yl - gy, yh + gy


@inlined
def first_contact(path, span, end, t0, r, skin, walls, ints):
    """First contact within the step: (time, ON_EDGE or ON_VERTEX, which); time -1.0 for none.

    The feature the granule slides on, and those it is joined to, are left out.
    """
    bodies, members = walls.bodies, walls.members
    best, kind, which = -1.0, at.FREE, at.NOBODY
    edge_a, edge_b, vertex_a, vertex_b = at.NOBODY, at.NOBODY, at.NOBODY, at.NOBODY
    if ints[at.CONTACT] == at.ON_EDGE:
        edge_a = ints[at.FEATURE]
        vertex_a, vertex_b = walls.edge_links[edge_a, at.BEFORE], walls.edge_links[edge_a, at.AFTER]
    elif ints[at.CONTACT] == at.ON_VERTEX:
        vertex_a = ints[at.FEATURE]
        edge_a, edge_b = walls.vertex_links[vertex_a, at.BEFORE], walls.vertex_links[vertex_a, at.AFTER]
    start = (path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY])
    whole = _hull(start, end, span)
    for body in range(bodies.shape[0]):
        ax, ay, omega = abs(bodies[body, at.REACH_X]), abs(bodies[body, at.REACH_Y]), bodies[body, at.OMEGA]
        margin = 1.01 * r + skin
        if not (
            _overlaps(whole[0], whole[1], bodies[body, at.LOW_X] - ax, bodies[body, at.HIGH_X] + ax, margin)
            and _overlaps(whole[2], whole[3], bodies[body, at.LOW_Y] - ay, bodies[body, at.HIGH_Y] + ay, margin)
        ):
            continue
        pieces = 1 if omega == 0.0 else min(100000, 1 + int(omega * span / TURN))
        qa = _seen_from(start, t0, bodies, body)
        for piece in range(pieces):
            sa, sb = span * piece / pieces, span * (piece + 1) / pieces
            if best >= 0.0 and sa > best:
                break
            qb = _seen_from(end if piece == pieces - 1 else along(path, sb), t0 + sb, bodies, body)
            hull = _hull(qa, qb, sb - sa)
            found = -1.0
            if _overlaps(hull[0], hull[1], bodies[body, at.LOW_X], bodies[body, at.HIGH_X], margin) and _overlaps(
                hull[2], hull[3], bodies[body, at.LOW_Y], bodies[body, at.HIGH_Y], margin
            ):
                for e in range(members[body, at.FIRST_EDGE], members[body, at.LAST_EDGE]):
                    if e != edge_a and e != edge_b:
                        s = _edge_contact(path, t0, walls, e, r, skin, sa, sb, qa, qb, hull)
                        if s >= 0.0 and (found < 0.0 or s < found):
                            found = s
                            if best < 0.0 or s < best:
                                best, kind, which = s, at.ON_EDGE, e
                for v in range(members[body, at.FIRST_VERTEX], members[body, at.LAST_VERTEX]):
                    if v != vertex_a and v != vertex_b:
                        s = _vertex_contact(path, t0, walls, v, r, skin, sa, sb, qa, qb, hull)
                        if s >= 0.0 and (found < 0.0 or s < found):
                            found = s
                            if best < 0.0 or s < best:
                                best, kind, which = s, at.ON_VERTEX, v
            if found >= 0.0:
                break
            qa = qb
    return best, kind, which


@inlined
def crossing(path, span, end, t0, walls, skin):
    """First crossing of a line by the granule's centre within the step: (time, line id); time -1.0 for none.

    In the frame of the lines, which move where the mesh does.
    """
    best, which = -1.0, at.NOBODY
    lines, frame = walls.lines, walls.frame
    if lines.shape[0] == 0:
        return best, which
    start, moved = (path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY]), at.NOBODY
    if frame[0, at.OMEGA] != 0.0:
        start, end, moved = _seen_from(start, t0, frame, 0), _seen_from(end, t0 + span, frame, 0), at.NOBODY + 1
    hull = _hull(start, end, span)
    for i in range(lines.shape[0]):
        x0, y0, x1, y1 = lines[i, at.FROM_X], lines[i, at.FROM_Y], lines[i, at.TO_X], lines[i, at.TO_Y]
        if not (
            _overlaps(hull[0], hull[1], min(x0, x1), max(x0, x1), skin)
            and _overlaps(hull[2], hull[3], min(y0, y1), max(y0, y1), skin)
        ):
            continue
        ex, ey = x1 - x0, y1 - y0
        size = math.sqrt(ex * ex + ey * ey)
        nx, ny = ey / size, -ex / size
        fa = nx * (start[0] - x0) + ny * (start[1] - y0)
        if fa < 0.0:
            nx, ny, fa = -nx, -ny, -fa
        if fa == 0.0:  # born on the line
            continue
        fb = nx * (end[0] - x0) + ny * (end[1] - y0)
        ra, rb = nx * start[2] + ny * start[3], nx * end[2] + ny * end[3]
        s = span
        if fb != 0.0:
            s = first_below(
                path, t0, frame, moved, events.PLANE, x0, y0, 0.0, nx, ny, 0.0, fa, ra, span, fb, rb, 1e-6 * skin
            )
        if s < 0.0 or (best >= 0.0 and s >= best):
            continue
        x, y, _, _ = along(path, s)
        if moved >= 0:
            x, y, _, _ = _seen_from((x, y, 0.0, 0.0), t0 + s, frame, 0)
        foot = ((x - x0) * ex + (y - y0) * ey) / size
        if -skin <= foot <= size + skin:
            best, which = s, walls.line_ids[i]
    return best, which


@compiled
def inside(walls, body, x, y):
    """Whether a point (body frame) lies inside a closed body (even-odd rule), and the edge nearest to it."""
    bodies, edges = walls.bodies, walls.edges
    if walls.members[body, at.CLOSED] == 0 or not (
        bodies[body, at.LOW_X] < x < bodies[body, at.HIGH_X] and bodies[body, at.LOW_Y] < y < bodies[body, at.HIGH_Y]
    ):
        return False, at.NOBODY
    odd, nearest, least = False, at.NOBODY, math.inf
    for e in range(walls.members[body, at.FIRST_EDGE], walls.members[body, at.LAST_EDGE]):
        x0, y0, x1, y1 = edges[e, at.FROM_X], edges[e, at.FROM_Y], edges[e, at.TO_X], edges[e, at.TO_Y]
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            odd = not odd
        foot = -edges[e, at.OUT_Y] * (x - x0) + edges[e, at.OUT_X] * (y - y0)
        foot = min(edges[e, at.LENGTH], max(0.0, foot))
        dx, dy = x - x0 + edges[e, at.OUT_Y] * foot, y - y0 - edges[e, at.OUT_X] * foot
        if dx * dx + dy * dy < least:
            least, nearest = dx * dx + dy * dy, e
    return odd, nearest


@compiled
def overlap(walls, body, x, y, r):
    """How far a granule outside the body reaches into it (body frame), on which feature: (depth, kind, which); depth
    <= 0: no.
    """
    edges = walls.edges
    depth, kind, which = 0.0, at.FREE, at.NOBODY
    for e in range(walls.members[body, at.FIRST_EDGE], walls.members[body, at.LAST_EDGE]):
        nx, ny = edges[e, at.OUT_X], edges[e, at.OUT_Y]
        foot = -ny * (x - edges[e, at.FROM_X]) + nx * (y - edges[e, at.FROM_Y])
        height = nx * (x - edges[e, at.FROM_X]) + ny * (y - edges[e, at.FROM_Y])
        if 0.0 <= foot <= edges[e, at.LENGTH] and height >= 0.0 and r - height > depth:
            depth, kind, which = r - height, at.ON_EDGE, e
    for v in range(walls.members[body, at.FIRST_VERTEX], walls.members[body, at.LAST_VERTEX]):
        dx, dy = x - walls.vertices[v, at.VERTEX_X], y - walls.vertices[v, at.VERTEX_Y]
        height = math.sqrt(dx * dx + dy * dy)
        if r - height > depth:
            depth, kind, which = r - height, at.ON_VERTEX, v
    return depth, kind, which


@compiled
def grasp(hold, walls, kind, which, r, x, y, t):
    """Fill the constraint with a feature's geometry and motion for a granule at (x, y); returns body and overlap
    distance.

    The distance is that of the granule's surface from the feature, negative when it reaches in.
    """
    hold[at.KIND], hold[at.ARM] = kind, r
    if kind == at.ON_EDGE:
        hold[at.OX], hold[at.OY] = walls.edges[which, at.FROM_X], walls.edges[which, at.FROM_Y]
    else:
        hold[at.OX], hold[at.OY] = walls.vertices[which, at.VERTEX_X], walls.vertices[which, at.VERTEX_Y]
    body, nx, ny, height = facing(walls, kind, which, x, y, t)
    for i in range(4):
        hold[at.WX + i] = walls.bodies[body, at.REACH_X + i]
    hold[at.SAMPLED] = 1.0 if walls.bodies[body, at.SAMPLE_COUNT] != 0.0 else 0.0
    ride(hold, walls, body, t)
    hold[at.NX], hold[at.NY] = nx, ny
    return body, height - r


@compiled
def facing(walls, kind, which, x, y, t):
    """The body of a feature, the unit normal from it towards (x, y), and how far that point is from it."""
    if kind == at.ON_EDGE:
        body = walls.edge_links[which, at.OWNER]
        ox, oy = walls.edges[which, at.FROM_X], walls.edges[which, at.FROM_Y]
    else:
        body = walls.vertex_links[which, at.OWNER]
        ox, oy = walls.vertices[which, at.VERTEX_X], walls.vertices[which, at.VERTEX_Y]
    dx, dy, _, _, _, _ = displacement(walls.bodies, body, t)
    qx, qy = x - dx - ox, y - dy - oy
    if kind == at.ON_EDGE:
        nx, ny = walls.edges[which, at.OUT_X], walls.edges[which, at.OUT_Y]
        return body, nx, ny, nx * qx + ny * qy
    d = math.sqrt(qx * qx + qy * qy)
    nx, ny = (qx / d, qy / d) if d > 0.0 else (0.0, 1.0)
    return body, nx, ny, d


@compiled
def ride(hold, walls, body, t):
    """Take up the cubic that a body with samples follows from time t on."""
    if hold[at.SAMPLED] == 0.0:
        return
    bodies = walls.bodies
    ahead = events.SAME * bodies[body, at.SAMPLE_PERIOD]
    k, s = interval(bodies, body, t + ahead)
    hold[at.W_BEGIN] = t + ahead - s
    hold[at.W_END] = hold[at.W_BEGIN] + bodies[body, k + at.PER_SAMPLE] - bodies[body, k]
    hold[at.W_OUT], hold[at.W_SPEED] = bodies[body, k + at.SAMPLE_OUT], bodies[body, k + at.SAMPLE_SPEED]
    hold[at.W_PULL], hold[at.W_JERK] = bodies[body, k + at.SAMPLE_PULL], bodies[body, k + at.SAMPLE_JERK]


@compiled
def carry(hold, t):
    """Displacement, velocity and acceleration of the wall in hold."""
    if hold[at.WW] == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if hold[at.SAMPLED] == 0.0:
        return harmonic(hold[at.WX], hold[at.WY], hold[at.WW], hold[at.WP], t)
    s = t - hold[at.W_BEGIN]
    return cubic(hold[at.WX], hold[at.WY], hold[at.W_OUT], hold[at.W_SPEED], hold[at.W_PULL], hold[at.W_JERK], s)


@compiled
def constrain(hold, fx, fy, x, y, vx, vy, t):
    """Acceleration of a granule that slides on the surface under the free acceleration f, and what presses it on.

    Returns (ax, ay, pressing acceleration, free tangential acceleration, sliding speed), relative to the moving wall;
    friction mu times the pressing acceleration opposes sliding; while it rolls, friction is what turns it.
    """
    sx, sy, wx, wy, px, py = carry(hold, t)
    nx, ny = hold[at.NX], hold[at.NY]
    bend = 0.0
    tx, ty = -ny, nx
    if hold[at.KIND] == at.ON_VERTEX:
        qx, qy = x - sx - hold[at.OX], y - sy - hold[at.OY]
        d = math.sqrt(qx * qx + qy * qy)
        nx, ny = qx / d, qy / d
        tx, ty = -ny, nx
        slide = tx * (vx - wx) + ty * (vy - wy)
        bend = slide * slide / d
    else:
        slide = tx * (vx - wx) + ty * (vy - wy)
    press = -(nx * (fx - px) + ny * (fy - py)) - bend
    free = tx * (fx - px) + ty * (fy - py)
    tangential = tx * fx + ty * fy - hold[at.SIGN] * hold[at.MU] * max(press, 0.0) - hold[at.ROLL] * free
    normal = nx * px + ny * py - bend
    return tangential * tx + normal * nx, tangential * ty + normal * ny, press, free, slide
