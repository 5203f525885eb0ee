"""The first contact of a granule's surface with a wall, and the first crossing of a line by its centre, in a step.

A granule of radius r touches where its centre meets the outline offset by r: edges shifted outward, circles about
convex corners. Everything is done on the dense output, in the frame of the body, which may vibrate.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .dense_output import along
from .events import first_below, level, seen_from
from .jit import called, compiled
from .walls import GROWN, STILL, members_of

BEND = 0.05  # sagitta over a granule's radius up to which its path by a corner counts as straight
BENDS = 64  # pieces of such a path at most
TURN = 0.4  # rad of a body's vibration looked at in one piece; of samples: change of the acceleration over its peak
MAX_PIECES = 100_000  # of a step past a body that vibrates
MARGIN = 0.1  # of a hull's size: the cubic with the same ends holds the path but for the step's own error
CLOSE = 1e-6  # of the skin: a line is crossed when the centre is that near


@compiled
def _near(hull, low_x, high_x, low_y, high_y, margin):
    """Whether a hull (low x, high x, low y, high y) comes as near as ``margin`` to a box."""
    left, right, bottom, top = hull
    across = left - margin <= high_x and right + margin >= low_x
    return across and bottom - margin <= high_y and top + margin >= low_y


@compiled
def _edge_contact(path, t0, walls, e, r, skin, sa, sb, qa, qb, hull):
    """First contact with edge e within [sa, sb], or -1.0. q: position and velocity at both ends in the body's frame."""
    edges = walls.edges
    px, py, nx, ny = edges[e, at.FROM_X], edges[e, at.FROM_Y], edges[e, at.OUT_X], edges[e, at.OUT_Y]
    (ax, ay, avx, avy), (bx, by, bvx, bvy), size = qa, qb, edges[e, at.LENGTH]
    fa = nx * (ax - px) + ny * (ay - py) - r
    fb = nx * (bx - px) + ny * (by - py) - r
    ra, rb = nx * avx + ny * avy, nx * bvx + ny * bvy
    if fa < -(r + skin) or (fb > 0.0 and fa > skin and not (ra < 0.0 and rb > 0.0)):
        return -1.0
    ex, ey = edges[e, at.TO_X], edges[e, at.TO_Y]
    if not _near(hull, min(px, ex), max(px, ex), min(py, ey), max(py, ey), GROWN * r + skin):
        return -1.0
    body = walls.edge_links[e, at.OWNER]
    ra = 0.0 if abs(ra) < STILL else ra
    s = first_below(path, t0, walls.bodies, body, events.PLANE, px, py, -r, nx, ny, sa, fa, ra, sb, fb, rb, skin)
    if s < 0.0:
        return -1.0
    x, y, vx, vy = along(path, s)
    x, y, vx, vy = seen_from(walls.bodies, body, t0 + s, x, y, vx, vy)
    foot, onward = -ny * (x - px) + nx * (y - py), -ny * vx + nx * vy
    near = 1e-3 * skin  # at the very end and on the way out it is the corner's
    return s if (0.0 if onward >= 0.0 else near) <= foot <= (size if onward <= 0.0 else size - near) else -1.0


@compiled
def _vertex_contact(path, t0, walls, v, r, skin, sa, sb, qa, qb, hull):
    """First contact with the circle about vertex v within [sa, sb], or -1.0."""
    px, py = walls.vertices[v, at.VERTEX_X], walls.vertices[v, at.VERTEX_Y]
    if not _near(hull, px, px, py, py, GROWN * r + skin):
        return -1.0
    (ax, ay, avx, avy), (bx, by, bvx, bvy) = qa, qb
    ax, ay, bx, by = ax - px, ay - py, bx - px, by - py
    da, db = math.sqrt(ax * ax + ay * ay), math.sqrt(bx * bx + by * by)
    if da == 0.0 or db == 0.0:
        return -1.0
    ra, rb = (ax * avx + ay * avy) / da, (bx * bvx + by * bvy) / db
    body = walls.vertex_links[v, at.OWNER]
    ra = 0.0 if abs(ra) < STILL else ra
    pieces = 1
    if ra >= 0.0 and rb >= 0.0:  # a path that bends may leave the circle, come back through it and leave again
        bend = math.hypot(bvx - avx, bvy - avy) * (sb - sa) / 8.0
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
def _hull(qa, qb, span):
    """Box of the four Bezier points of the cubic with these ends, grown by a tenth: holds the path."""
    (xa, ya, ua, va), (xb, yb, ub, vb) = qa, qb
    third = span / 3.0
    x1, x2 = xa + third * ua, xb - third * ub
    y1, y2 = ya + third * va, yb - third * vb
    xl, xh = min(xa, xb, x1, x2), max(xa, xb, x1, x2)
    yl, yh = min(ya, yb, y1, y2), max(ya, yb, y1, y2)
    gx, gy = MARGIN * (xh - xl), MARGIN * (yh - yl)
    return xl - gx, xh + gx, yl - gy, yh + gy


@compiled
def _joined(ints, walls):
    """The feature that the granule slides on and those it is joined to: two edges, two vertices; NOBODY for none."""
    feature = ints[at.FEATURE]
    if ints[at.CONTACT] == at.ON_EDGE:
        return feature, at.NOBODY, walls.edge_links[feature, at.BEFORE], walls.edge_links[feature, at.AFTER]
    if ints[at.CONTACT] == at.ON_VERTEX:
        return walls.vertex_links[feature, at.BEFORE], walls.vertex_links[feature, at.AFTER], feature, at.NOBODY
    return at.NOBODY, at.NOBODY, at.NOBODY, at.NOBODY


@compiled
def _near_part(hull, parts, part, margin):
    """Whether a hull comes as near as ``margin`` to the box of a part of an outline."""
    low_x, high_x = parts[part, at.LOW_X], parts[part, at.HIGH_X]
    return _near(hull, low_x, high_x, parts[part, at.LOW_Y], parts[part, at.HIGH_Y], margin)


@compiled
def _first_in_piece(path, t0, walls, body, r, skin, sa, sb, qa, qb, hull, joined):
    """First contact with a feature of a body in a piece [sa, sb] of the step, whose hull is near to its box."""
    parts, margin = walls.parts, GROWN * r + skin
    edge_a, edge_b, vertex_a, vertex_b = joined
    met, kind, which = -1.0, at.FREE, at.NOBODY
    first, last = walls.members[body, at.FIRST_PART], walls.members[body, at.LAST_PART]
    part = first
    while part < last:
        near = part == first or _near_part(hull, parts, part, margin)
        part, low, high = members_of(parts, part, near, at.FIRST_EDGE)
        for e in range(low, high):
            if e != edge_a and e != edge_b:
                s = _edge_contact(path, t0, walls, e, r, skin, sa, sb, qa, qb, hull)
                if s >= 0.0 and (met < 0.0 or s < met):
                    met, kind, which = s, at.ON_EDGE, e
    part = first
    while part < last:
        near = part == first or _near_part(hull, parts, part, margin)
        part, low, high = members_of(parts, part, near, at.FIRST_VERTEX)
        for v in range(low, high):
            if v != vertex_a and v != vertex_b:
                s = _vertex_contact(path, t0, walls, v, r, skin, sa, sb, qa, qb, hull)
                if s >= 0.0 and (met < 0.0 or s < met):
                    met, kind, which = s, at.ON_VERTEX, v
    return met, kind, which


@compiled
def _first_on_body(path, span, start, end, t0, r, skin, walls, body, joined, best):
    """First contact with a body; looked for till ``best`` (s), unless that is negative."""
    bodies = walls.bodies
    omega = bodies[body, at.OMEGA]
    pieces = 1 if omega == 0.0 else min(MAX_PIECES, 1 + int(omega * span / TURN))
    qa = seen_from(bodies, body, t0, *start)
    met, kind, which = -1.0, at.FREE, at.NOBODY
    for piece in range(pieces):
        sa, sb = span * piece / pieces, span * (piece + 1) / pieces
        if best >= 0.0 and sa > best:
            break
        qb = end if piece == pieces - 1 else along(path, sb)
        qb = seen_from(bodies, body, t0 + sb, *qb)
        hull = _hull(qa, qb, sb - sa)
        if _near_part(hull, walls.parts, walls.members[body, at.FIRST_PART], GROWN * r + skin):
            met, kind, which = _first_in_piece(path, t0, walls, body, r, skin, sa, sb, qa, qb, hull, joined)
        if met >= 0.0:
            break
        qa = qb
    return met, kind, which


@compiled
def first_wall(path, span, end, t0, r, skin, walls, ints):
    """First contact within the step: (time, ON_EDGE or ON_VERTEX, which); time -1.0 for none.

    The feature the granule slides on, and those it is joined to, are left out.
    """
    bodies = walls.bodies
    best, kind, which = -1.0, at.FREE, at.NOBODY
    joined = _joined(ints, walls)
    start = (path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY])
    whole, margin = _hull(start, end, span), GROWN * r + skin
    for body in range(bodies.shape[0]):
        ax, ay = abs(bodies[body, at.REACH_X]), abs(bodies[body, at.REACH_Y])
        low_x, high_x = bodies[body, at.LOW_X] - ax, bodies[body, at.HIGH_X] + ax
        low_y, high_y = bodies[body, at.LOW_Y] - ay, bodies[body, at.HIGH_Y] + ay
        if not _near(whole, low_x, high_x, low_y, high_y, margin):
            continue
        s, its_kind, its = _first_on_body(path, span, start, end, t0, r, skin, walls, body, joined, best)
        if s >= 0.0 and (best < 0.0 or s < best):
            best, kind, which = s, its_kind, its
    return best, kind, which


@called
def _line_crossed(path, span, start, end, t0, frame, moved, lines, i, skin):
    """When the centre first crosses the straight line through segment i, and how far along it (m); time -1.0: never."""
    x0, y0 = lines[i, at.FROM_X], lines[i, at.FROM_Y]
    ex, ey = lines[i, at.TO_X] - x0, lines[i, at.TO_Y] - y0
    (xa, ya, ua, va), (xb, yb, ub, vb) = start, end
    size = math.sqrt(ex * ex + ey * ey)
    nx, ny = ey / size, -ex / size
    fa = nx * (xa - x0) + ny * (ya - y0)
    if fa < 0.0:
        nx, ny, fa = -nx, -ny, -fa
    if fa == 0.0:  # born on the line
        return -1.0, 0.0, size
    fb = nx * (xb - x0) + ny * (yb - y0)
    ra, rb = nx * ua + ny * va, nx * ub + ny * vb
    s, close = span, CLOSE * skin
    if fb != 0.0:
        s = first_below(path, t0, frame, moved, events.PLANE, x0, y0, 0.0, nx, ny, 0.0, fa, ra, span, fb, rb, close)
    if s < 0.0:
        return s, 0.0, size
    x, y, _, _ = along(path, s)
    if moved >= 0:
        x, y, _, _ = seen_from(frame, 0, t0 + s, x, y, 0.0, 0.0)
    return s, ((x - x0) * ex + (y - y0) * ey) / size, size


@compiled
def first_line(path, span, end, t0, walls, skin):
    """First crossing of a line by the granule's centre within the step: (time, line id); time -1.0 for none.

    In the frame of the lines, which move where the mesh does.
    """
    best, which = -1.0, at.NOBODY
    lines, frame = walls.lines, walls.frame
    if lines.shape[0] == 0:
        return best, which
    start, moved = (path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY]), at.NOBODY
    if frame[0, at.OMEGA] != 0.0:
        start, end, moved = seen_from(frame, 0, t0, *start), seen_from(frame, 0, t0 + span, *end), at.NOBODY + 1
    hull = _hull(start, end, span)
    for i in range(lines.shape[0]):
        x0, y0, x1, y1 = lines[i, at.FROM_X], lines[i, at.FROM_Y], lines[i, at.TO_X], lines[i, at.TO_Y]
        if _near(hull, min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1), skin):
            s, foot, size = _line_crossed(path, span, start, end, t0, frame, moved, lines, i, skin)
            if s >= 0.0 and not (best >= 0.0 and s >= best) and -skin <= foot <= size + skin:
                best, which = s, walls.line_ids[i]
    return best, which
