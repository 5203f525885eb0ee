"""Bodies: what a point lies in or near, and the constraint of a granule that touches one.

A granule of radius r touches where its centre meets the outline offset by r: edges shifted outward, circles about
convex corners. Everything is done in the frame of the body, which may vibrate.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .events import angle_of, cubic, harmonic, interval, rocking, seen_from, turned_by, turning
from .jit import compiled

STILL = 1e-13  # m/s, round-off: a granule that leaves a surface with it does not meet it again
GROWN = 1.01  # of a granule's radius: boxes that are farther apart than this cannot touch, round-off or not


# -- Parts of an outline -----------------------------------------------------------------------------------------------
# The edges of a body are halved till few are left. Each part is a row of ``walls.parts``, followed by its halves. Who
# looks for something goes from row to row, and over the halves of a part whose box is too far away.
@compiled
def away(parts, part, x, y):
    """Square of the distance of a point (body frame) from the box of a part; 0: inside."""
    dx = max(parts[part, at.LOW_X] - x, x - parts[part, at.HIGH_X], 0.0)
    dy = max(parts[part, at.LOW_Y] - y, y - parts[part, at.HIGH_Y], 0.0)
    return dx * dx + dy * dy


@compiled
def members_of(parts, part, near, first):
    """The part to look at after this one, and from which to which edge (``first`` FIRST_EDGE) or vertex (FIRST_VERTEX)
    to look now: at none of a part that is not ``near``, or whose halves come next.
    """
    beyond = int(parts[part, at.BEYOND])
    if not near:
        return beyond, 0, 0
    if beyond != part + 1:
        return part + 1, 0, 0
    return beyond, int(parts[part, first]), int(parts[part, first + 1])


@compiled
def inside(walls, body, x, y):
    """Whether a point (body frame) lies inside a closed body (even-odd rule), and then the edge nearest to it."""
    bodies, edges, parts = walls.bodies, walls.edges, walls.parts
    if walls.members[body, at.CLOSED] == 0 or not (
        bodies[body, at.LOW_X] < x < bodies[body, at.HIGH_X] and bodies[body, at.LOW_Y] < y < bodies[body, at.HIGH_Y]
    ):
        return False, at.NOBODY
    odd, nearest, least = False, at.NOBODY, math.inf
    part, last = walls.members[body, at.FIRST_PART], walls.members[body, at.LAST_PART]
    while part < last:
        level = parts[part, at.LOW_Y] <= y <= parts[part, at.HIGH_Y]
        part, low, high = members_of(parts, part, level, at.FIRST_EDGE)
        for e in range(low, high):
            x0, y0, x1, y1 = edges[e, at.FROM_X], edges[e, at.FROM_Y], edges[e, at.TO_X], edges[e, at.TO_Y]
            if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
                odd = not odd
    part = walls.members[body, at.FIRST_PART] if odd else last
    while part < last:
        part, low, high = members_of(parts, part, away(parts, part, x, y) <= least, at.FIRST_EDGE)
        for e in range(low, high):
            x0, y0 = edges[e, at.FROM_X], edges[e, at.FROM_Y]
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
    edges, parts = walls.edges, walls.parts
    depth, kind, which, reach = 0.0, at.FREE, at.NOBODY, GROWN * r * GROWN * r
    part, last = walls.members[body, at.FIRST_PART], walls.members[body, at.LAST_PART]
    while part < last:
        part, low, high = members_of(parts, part, away(parts, part, x, y) <= reach, at.FIRST_EDGE)
        for e in range(low, high):
            nx, ny = edges[e, at.OUT_X], edges[e, at.OUT_Y]
            foot = -ny * (x - edges[e, at.FROM_X]) + nx * (y - edges[e, at.FROM_Y])
            height = nx * (x - edges[e, at.FROM_X]) + ny * (y - edges[e, at.FROM_Y])
            if 0.0 <= foot <= edges[e, at.LENGTH] and height >= 0.0 and r - height > depth:
                depth, kind, which = r - height, at.ON_EDGE, e
    part = walls.members[body, at.FIRST_PART]
    while part < last:
        part, low, high = members_of(parts, part, away(parts, part, x, y) <= reach, at.FIRST_VERTEX)
        for v in range(low, high):
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
    for i in range(3):
        hold[at.ROCKS + i] = walls.bodies[body, at.ROCK + i]
    hold[at.LEANED] = angle_of(walls.bodies, body, t)
    hold[at.SAMPLED] = 1.0 if walls.bodies[body, at.SAMPLE_COUNT] != 0.0 else 0.0
    ride(hold, walls, body, t)
    hold[at.NX], hold[at.NY] = nx, ny
    return body, height - r


@compiled
def facing(walls, kind, which, x, y, t):
    """The body of a feature, the unit normal from it towards (x, y), and how far that point is from it; in the lab."""
    if kind == at.ON_EDGE:
        body = walls.edge_links[which, at.OWNER]
        ox, oy = walls.edges[which, at.FROM_X], walls.edges[which, at.FROM_Y]
    else:
        body = walls.vertex_links[which, at.OWNER]
        ox, oy = walls.vertices[which, at.VERTEX_X], walls.vertices[which, at.VERTEX_Y]
    x, y, _, _ = seen_from(walls.bodies, body, t, x, y, 0.0, 0.0)
    qx, qy, angle = x - ox, y - oy, angle_of(walls.bodies, body, t)
    if kind == at.ON_EDGE:
        nx, ny = walls.edges[which, at.OUT_X], walls.edges[which, at.OUT_Y]
        d = nx * qx + ny * qy
    else:
        d = math.sqrt(qx * qx + qy * qy)
        nx, ny = (qx / d, qy / d) if d > 0.0 else (0.0, 1.0)
    nx, ny = turned_by(angle, nx, ny)
    return body, nx, ny, d


@compiled
def ride(hold, walls, body, t):
    """Take up the cubic that a body with samples follows from time t on."""
    if hold[at.SAMPLED] == 0.0:
        return
    bodies = walls.bodies
    ahead = events.PERIOD_ROUNDING * bodies[body, at.SAMPLE_PERIOD]
    k, s = interval(bodies, body, t + ahead)
    hold[at.W_BEGIN] = t + ahead - s
    hold[at.W_END] = hold[at.W_BEGIN] + bodies[body, k + at.PER_SAMPLE] - bodies[body, k]
    hold[at.W_OUT], hold[at.W_SPEED] = bodies[body, k + at.SAMPLE_OUT], bodies[body, k + at.SAMPLE_SPEED]
    hold[at.W_PULL], hold[at.W_JERK] = bodies[body, k + at.SAMPLE_PULL], bodies[body, k + at.SAMPLE_JERK]


@compiled
def _swing(hold, t):
    """How far out the wall in hold is at time t, over its amplitude, and the first two derivatives."""
    if hold[at.WW] == 0.0:
        return 0.0, 0.0, 0.0
    if hold[at.SAMPLED] == 0.0:
        return harmonic(hold[at.WW], hold[at.WP], t)
    return cubic(hold[at.W_OUT], hold[at.W_SPEED], hold[at.W_PULL], hold[at.W_JERK], t - hold[at.W_BEGIN])


@compiled
def leans(hold, t):
    """The angle by which the wall in hold has turned since its normals were taken."""
    return hold[at.ROCKS] * _swing(hold, t)[0] - hold[at.LEANED] if hold[at.ROCKS] != 0.0 else 0.0


@compiled
def carry(hold, x, y, vx, vy, t):
    """What the wall in hold does at time t for a granule at (x, y) with velocity v: the way from the constraint's
    origin to it, velocity and acceleration as of ``wall_motion``, and the rate at which it turns, with its derivative.
    """
    out, rate, pull = _swing(hold, t)
    rock = hold[at.ROCKS]
    if rock == 0.0:
        ax, ay = hold[at.WX], hold[at.WY]
        x, y = x - ax * out - hold[at.OX], y - ay * out - hold[at.OY]
        return x, y, ax * rate, ay * rate, ax * pull, ay * pull, 0.0, 0.0
    px, py = hold[at.AT_X], hold[at.AT_Y]
    dx, dy = turning(rock * out, hold[at.OX] - px, hold[at.OY] - py)
    wx, wy, ax, ay = rocking(rock * rate, rock * pull, x - px, y - py, vx, vy)
    return x - hold[at.OX] - dx, y - hold[at.OY] - dy, wx, wy, ax, ay, rock * rate, rock * pull


@compiled
def constrain(hold, fx, fy, x, y, vx, vy, t):
    """Acceleration of a granule that slides on the surface under the free acceleration f, and what presses it on.

    Returns (ax, ay, pressing acceleration, free tangential acceleration, sliding speed), relative to the moving wall,
    and the rate at which that turns; friction mu times the pressing acceleration opposes sliding; while it rolls,
    friction is what turns it, and the free acceleration is that of its contact point.
    """
    qx, qy, wx, wy, px, py, turn, growth = carry(hold, x, y, vx, vy, t)
    bend = 0.0
    if hold[at.KIND] == at.ON_VERTEX:
        d = math.sqrt(qx * qx + qy * qy)
        nx, ny = qx / d, qy / d
        tx, ty = -ny, nx
        slide = tx * (vx - wx) + ty * (vy - wy)
        bend = slide * slide / d
    else:
        nx, ny = turned_by(leans(hold, t), hold[at.NX], hold[at.NY])
        tx, ty = -ny, nx
        slide = tx * (vx - wx) + ty * (vy - wy)
    press = -(nx * (fx - px) + ny * (fy - py)) - bend
    free = tx * (fx - px) + ty * (fy - py) + hold[at.TURNS] * growth
    tangential = tx * fx + ty * fy - hold[at.SIGN] * hold[at.MU] * max(press, 0.0) - hold[at.ROLL] * free
    normal = nx * px + ny * py - bend
    return tangential * tx + normal * nx, tangential * ty + normal * ny, press, free, slide, turn


# -- How far the nearest wall or line is at least ----------------------------------------------------------------------
@compiled
def clearance(walls, x, y, radius, enough):
    """A lower bound on the way to the nearest wall or line, wherever the wall is; at most ``enough``."""
    free = enough
    edges, lines, parts = walls.edges, walls.lines, walls.parts
    for body in range(walls.bodies.shape[0]):
        box, swing = walls.bodies[body], radius
        if box[at.OMEGA] != 0.0:
            swing += math.sqrt(box[at.REACH_X] ** 2 + box[at.REACH_Y] ** 2)
        part, last = walls.members[body, at.FIRST_PART], walls.members[body, at.LAST_PART]
        if away(parts, part, x, y) >= (free + swing) ** 2:
            continue
        nearest = part
        while parts[nearest, at.BEYOND] != nearest + 1:  # who begins at the nearest leaf looks at few others
            half, other = nearest + 1, int(parts[nearest + 1, at.BEYOND])
            nearest = half if away(parts, half, x, y) <= away(parts, other, x, y) else other
        for e in range(int(parts[nearest, at.FIRST_EDGE]), int(parts[nearest, at.LAST_EDGE])):
            free = min(free, distance(edges, e, x, y) - swing)
        if nearest == part:  # a body of few edges
            continue
        while part < last:
            near = part != nearest and away(parts, part, x, y) < (free + swing) ** 2
            part, low, high = members_of(parts, part, near, at.FIRST_EDGE)
            for e in range(low, high):
                free = min(free, distance(edges, e, x, y) - swing)
    frame, moved = walls.frame, 0.0
    if frame[0, at.OMEGA] != 0.0:
        moved = math.sqrt(frame[0, at.REACH_X] ** 2 + frame[0, at.REACH_Y] ** 2)
    for i in range(lines.shape[0]):
        free = min(free, distance(lines, i, x, y) - moved)
    return free


@compiled
def distance(segments, i, x, y):
    """Distance of a point from a segment."""
    x0, y0 = segments[i, at.FROM_X], segments[i, at.FROM_Y]
    ex, ey, dx, dy = segments[i, at.TO_X] - x0, segments[i, at.TO_Y] - y0, x - x0, y - y0
    w = min(1.0, max(0.0, (dx * ex + dy * ey) / (ex * ex + ey * ey)))
    dx -= w * ex
    dy -= w * ey
    return math.sqrt(dx * dx + dy * dy)
