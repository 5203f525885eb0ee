"""Marching: many triangles in one go where no wall is near, at one or two evaluations of the air a triangle.

In a triangle the air is affine, at its faces continuous. An exponential step from face to face therefore loses no order
at the kinks, and can take the force at a face from the step before; what the confined steps spend on events, on loading
triangles and on a third-order step with an error of its own is left out, or done for one triangle in a few.
"""

from __future__ import annotations

import math

from . import layout as at
from .air import shares, swinging
from .dense_output import phis
from .jit import compiled, inlined
from .locate import barycentric
from .step import drag_rate

__all__ = ["BOOLE", "ODD", "clearance", "excess", "march", "way_out"]

SAMPLED = 4  # the error is looked at in every so many triangles
LONGER = 1.3  # than in the last triangle looked at: look again
STIFF = 0.2  # of the drag rate times the time in a triangle: from here on velocity may relax within it
SAFE = 0.2  # of the allowance: errors grow on their way through a sheared wake
AHEAD = 10.0  # triangles for which a clearance is looked up
KEEP = 0.1  # of the error allowed: with less bend than that the next march begins linear
BOOLE = 32.0 / 90.0  # mean of a quartic that is zero at 0, 1/2 and 1 over its sum at 1/4 and 3/4
ODD = 0.18  # first moment of a cubic with these zeros over its difference there, twice
ON_FACE = 1e-7  # barycentric distance at which a face is met
BEYOND = -1e-4  # barycentric distance at which a triangle does not hold a point any more
END, MIDDLE, EARLY, LATE, REFUSE = range(5)  # where in a triangle the force is looked at
MOVED = 2.0  # allowances: more than that off the place foretold, the force is looked up anew
FLAT = 1e-9  # of the extent: a shorter way through a triangle is a corner cut


@compiled
def clearance(walls, x, y, radius, enough):
    """A lower bound on the way to the nearest wall or line, wherever the wall is; no more than ``enough`` is told."""
    free = enough
    for body in range(walls.bodies.shape[0]):
        box, swing = walls.bodies[body], radius
        if box[at.OMEGA] != 0.0:
            swing += math.sqrt(box[at.REACH_X] ** 2 + box[at.REACH_Y] ** 2)
        dx, dy = max(box[at.LOW_X] - x, x - box[at.HIGH_X], 0.0), max(box[at.LOW_Y] - y, y - box[at.HIGH_Y], 0.0)
        if dx * dx + dy * dy >= (free + swing) ** 2:
            continue
        for e in range(walls.members[body, at.FIRST_EDGE], walls.members[body, at.LAST_EDGE]):
            d = (
                _distance(
                    walls.edges[e, at.FROM_X],
                    walls.edges[e, at.FROM_Y],
                    walls.edges[e, at.TO_X],
                    walls.edges[e, at.TO_Y],
                    x,
                    y,
                )
                - swing
            )
            free = min(free, d)
    moved = (
        math.sqrt(walls.frame[0, at.REACH_X] ** 2 + walls.frame[0, at.REACH_Y] ** 2)
        if walls.frame[0, at.OMEGA] != 0.0
        else 0.0
    )
    for i in range(walls.lines.shape[0]):
        d = _distance(
            walls.lines[i, at.FROM_X], walls.lines[i, at.FROM_Y], walls.lines[i, at.TO_X], walls.lines[i, at.TO_Y], x, y
        )
        free = min(free, d - moved)
    return free


@compiled
def _distance(x0, y0, x1, y1, x, y):
    """Distance of a point from a segment."""
    ex, ey, dx, dy = x1 - x0, y1 - y0, x - x0, y - y0
    w = min(1.0, max(0.0, (dx * ex + dy * ey) / (ex * ex + ey * ey)))
    dx -= w * ex
    dy -= w * ey
    return math.sqrt(dx * dx + dy * dy)


@compiled
def _smooth(values, smooth, c0, c1, c2, q0, q1, q2, t, pressed, stirred):
    """Velocity, pressure gradient, deviation at a point of the triangle of nodes c, in a field of splines in time."""
    w = (t - smooth[at.KNOT_FIRST]) * smooth[at.KNOT_RATE]
    n = math.floor(w)
    j = int(n - math.floor(n / smooth[at.KNOT_COUNT]) * smooth[at.KNOT_COUNT])
    s = shares(w - n)
    ux = uy = px = py = rms = 0.0
    for i in range(4):
        a, b, c = s[i] * q0, s[i] * q1, s[i] * q2
        ux += a * values[c0, j + i, at.NODE_U] + b * values[c1, j + i, at.NODE_U] + c * values[c2, j + i, at.NODE_U]
        uy += a * values[c0, j + i, at.NODE_V] + b * values[c1, j + i, at.NODE_V] + c * values[c2, j + i, at.NODE_V]
        if pressed:
            px += (
                a * values[c0, j + i, at.NODE_PX]
                + b * values[c1, j + i, at.NODE_PX]
                + c * values[c2, j + i, at.NODE_PX]
            )
            py += (
                a * values[c0, j + i, at.NODE_PY]
                + b * values[c1, j + i, at.NODE_PY]
                + c * values[c2, j + i, at.NODE_PY]
            )
        if stirred:
            rms += (
                a * values[c0, j + i, at.NODE_RMS]
                + b * values[c1, j + i, at.NODE_RMS]
                + c * values[c2, j + i, at.NODE_RMS]
            )
    return ux, uy, px, py, rms


@inlined
def excess(state, ints, affine, air, grain, table, tri, x, y, vx, vy, t, rate0, mx, my, gain):
    """N = F + B0 v and the drag rate at a point of a triangle, straight from its corners; and v.

    The velocity was made with a foretold N of (mx, my), whose excess ``gain`` times is missing from it: in stiff flight
    it must not pass for slip.
    """
    ints[at.EVALUATIONS] += 1
    g, values = air.geometry, air.values
    dx, dy = x - g[tri, at.CORNER_X], y - g[tri, at.CORNER_Y]
    q1 = g[tri, at.B1X] * dx + g[tri, at.B1Y] * dy
    q2 = g[tri, at.B2X] * dx + g[tri, at.B2Y] * dy
    q0 = 1.0 - q1 - q2
    c0, c1, c2 = air.corners[tri, 0], air.corners[tri, 1], air.corners[tri, 2]
    ux = uy = px = py = rms = 0.0
    pressed, stirred = grain[at.PRESSURE] != 0.0, grain[at.DISPERSION] != 0.0
    if air.smooth[at.KNOT_RATE] != 0.0:
        ux, uy, px, py, rms = _smooth(values, air.smooth, c0, c1, c2, q0, q1, q2, t, pressed, stirred)
    else:
        a, b = ints[at.SNAP_A], ints[at.SNAP_B]
        ux = q0 * values[a, c0, at.NODE_U] + q1 * values[a, c1, at.NODE_U] + q2 * values[a, c2, at.NODE_U]
        uy = q0 * values[a, c0, at.NODE_V] + q1 * values[a, c1, at.NODE_V] + q2 * values[a, c2, at.NODE_V]
        if pressed:
            px = q0 * values[a, c0, at.NODE_PX] + q1 * values[a, c1, at.NODE_PX] + q2 * values[a, c2, at.NODE_PX]
            py = q0 * values[a, c0, at.NODE_PY] + q1 * values[a, c1, at.NODE_PY] + q2 * values[a, c2, at.NODE_PY]
        if stirred:
            rms = q0 * values[a, c0, at.NODE_RMS] + q1 * values[a, c1, at.NODE_RMS] + q2 * values[a, c2, at.NODE_RMS]
        if a != b:
            w = (t - affine[at.T_BEGIN]) * affine[at.PER_DT]
            ux += w * (
                q0 * values[b, c0, at.NODE_U] + q1 * values[b, c1, at.NODE_U] + q2 * values[b, c2, at.NODE_U] - ux
            )
            uy += w * (
                q0 * values[b, c0, at.NODE_V] + q1 * values[b, c1, at.NODE_V] + q2 * values[b, c2, at.NODE_V] - uy
            )
            if pressed:
                px += w * (
                    q0 * values[b, c0, at.NODE_PX]
                    + q1 * values[b, c1, at.NODE_PX]
                    + q2 * values[b, c2, at.NODE_PX]
                    - px
                )
                py += w * (
                    q0 * values[b, c0, at.NODE_PY]
                    + q1 * values[b, c1, at.NODE_PY]
                    + q2 * values[b, c2, at.NODE_PY]
                    - py
                )
            if stirred:
                rms += w * (
                    q0 * values[b, c0, at.NODE_RMS]
                    + q1 * values[b, c1, at.NODE_RMS]
                    + q2 * values[b, c2, at.NODE_RMS]
                    - rms
                )
    if grain[at.NOISE] != 0.0:
        ux += rms * state[at.MEAN_X] + state[at.KICK_X]
        uy += rms * state[at.MEAN_Y] + state[at.KICK_Y]
    px, py = grain[at.PRESSURE] * px + grain[at.GX], grain[at.PRESSURE] * py + grain[at.GY]
    wx = wy = 0.0
    if air.swing[at.SWING_OMEGA] != 0.0:  # v is seen from the mesh, N the lab's
        wx, wy, _, _ = swinging(air.swing, at.SWING_X, t)
        ux, uy, px, py = ux - wx, uy - wy, px + rate0 * wx, py + rate0 * wy
    nx = ny = rate = 0.0
    for again in range(2):
        sx, sy = ux - vx, uy - vy
        rate = drag_rate(grain, table, sx * sx + sy * sy)
        nx, ny = rate * sx + px + rate0 * vx, rate * sy + py + rate0 * vy
        if again == 1 or rate0 * gain < STIFF:
            break
        vx += gain * (nx - mx)
        vy += gain * (ny - my)
    return nx, ny, rate, vx, vy


@compiled
def way_out(geometry, tri, x, y, vx, vy, nx, ny, rate):
    """About when which face is reached: along the velocity, then twice along the mean velocity till there."""
    time, edge, wx, wy = math.inf, at.NOBODY, vx, vy
    for turn in range(3):
        soonest, which = math.inf, at.NOBODY
        for k in range(3):
            speed = geometry[tri, at.B0X + 2 * k] * wx + geometry[tri, at.B0Y + 2 * k] * wy
            if speed < 0.0:
                time_there = max(barycentric(geometry, tri, k, x, y), 0.0) / -speed
                if time_there < soonest:
                    soonest, which = time_there, k
        if which < 0:
            break
        time, edge = soonest, which
        if turn < 2:
            _, p1, p2, _, _ = phis(-rate * time)
            wx, wy = p1 * vx + time * p2 * nx, p1 * vy + time * p2 * ny
    return time, edge


@compiled
def _holds(geometry, tri, x, y):
    """Whether a triangle holds a point, or nearly."""
    least = 1.0
    for k in range(3):
        q = barycentric(geometry, tri, k, x, y)
        least = q if not q >= least else least  # NaN stays
    return least >= BEYOND


@inlined
def march(state, ints, affine, air, grain, table, walls, rules, most):
    """Go from face to face up to the next snapshot or interval of noise, the mesh's end, until a wall or line may be
    met, or as long as the estimated error is within the allowance. The state is that of the last face. Returns how
    many triangles were left behind.

    With B the drag rate at the last face, N = F + B v is linear through a triangle, its slope foretold by that in the
    last one; or quadratic, once its middle was found too far off that. What is left at 1/4 and 3/4 then gives the
    error, of which a cubic part, whose mean is zero, has none. ``most``: triangles of this march.
    """
    t0 = state[at.T]
    clock = min(rules.until, state[at.T_NOISE], state[at.T_END] if air.smooth[at.KNOT_RATE] == 0.0 else math.inf)
    x, y, vx, vy = state[at.X], state[at.Y], state[at.VX], state[at.VY]
    speed2 = vx * vx + vy * vy
    fall = math.sqrt(rules.extent * math.sqrt(grain[at.GX] ** 2 + grain[at.GY] ** 2))
    s = free = bend = fx = fy = rate = ux = uy = checked = 0.0
    tri, left, cut, quadratic = ints[at.TRI], 0, 0, ints[at.QUADRATIC] == 1
    for cell in range(-1, most):
        dt, edge, last = 0.0, at.NOBODY, False
        if cell >= 0:
            dt, edge = way_out(air.geometry, tri, x, y, vx, vy, fx + rate * vx, fy + rate * vy, rate)
            last = not t0 + s + dt < clock
            dt = clock - t0 - s if last else dt
            if edge < 0 and not last:
                break
            if dt > rules.coarse:  # in time; confined steps end at knots
                break
            if dt * dt * speed2 <= FLAT * rules.extent * FLAT * rules.extent:
                cut += 1
                if cut > 6 or last:
                    break
                tri = air.neighbours[tri, edge]
                if tri < 0:
                    break
                ints[at.TRI] = tri
                continue
        cut = 0
        sampled = cell % SAMPLED == 0 or last or dt > LONGER * checked
        checked = dt if sampled else checked
        nx, ny = fx + rate * vx, fy + rate * vy
        gx, gy, kx, ky = ux * dt, uy * dt, 0.0, 0.0  # rise and bend: N = n + g w + k w (1 - w), 0 <= w <= 1
        ox = oy = hx = hy = zx = zy = onward = 0.0
        e = p1 = p2 = p3 = 0.0
        if cell >= 0 and not last:  # meet the face on the path foretold
            for _ in range(4):
                e, p1, p2, p3, _ = phis(-rate * dt)
                px = x + dt * (p1 * vx + dt * (p2 * nx + p3 * gx))
                py = y + dt * (p1 * vy + dt * (p2 * ny + p3 * gy))
                off = barycentric(air.geometry, tri, edge, px, py)
                if abs(off) <= ON_FACE:
                    break
                bx, by = air.geometry[tri, at.B0X + 2 * edge], air.geometry[tri, at.B0Y + 2 * edge]
                speed = bx * (e * vx + dt * (p1 * nx + p2 * gx)) + by * (e * vy + dt * (p1 * ny + p2 * gy))
                dt = dt - off / speed if speed < 0.0 else -1.0
                gx, gy = ux * dt, uy * dt
                if not dt > 0.0:
                    break
            if not dt > 0.0:
                break
            last = not t0 + s + dt < clock
            dt = clock - t0 - s if last else dt
            gx, gy = ux * dt, uy * dt
        stage = MIDDLE if quadratic and cell >= 0 else END
        again, bent, tries = cell == 0, stage == MIDDLE, 0
        for _ in range(9):
            part = 1.0 if stage == END else (0.5 if stage == MIDDLE else (0.25 if stage == EARLY else 0.75))
            g = part * dt
            cx, cy, lx, ly = part * (gx + kx), part * (gy + ky), 2.0 * part * part * kx, 2.0 * part * part * ky
            e, p1, p2, p3, p4 = phis(-rate * g)
            wx = e * vx + g * (p1 * nx + p2 * cx - p3 * lx)
            wy = e * vy + g * (p1 * ny + p2 * cy - p3 * ly)
            px = x + g * (p1 * vx + g * (p2 * nx + p3 * cx - p4 * lx))
            py = y + g * (p1 * vy + g * (p2 * ny + p3 * cy - p4 * ly))
            mx, my, now, wx, wy = excess(
                state, ints, affine, air, grain, table, tri, px, py, wx, wy, t0 + s + g, rate,
                nx + cx - 0.5 * lx, ny + cy - 0.5 * ly, g * p2,
            )  # fmt: skip
            if cell < 0:
                fx, fy, rate = mx, my, now
                break
            mx -= nx
            my -= ny
            if stage == END:
                gx, gy, zx, zy, onward = mx, my, wx, wy, now
                kx, ky = (4.0 * hx - 2.0 * gx, 4.0 * hy - 2.0 * gy) if bent else (0.0, 0.0)
                # the end moves with what was found there; the force is of the place foretold
                qx = dt * (p1 * vx + dt * (p2 * nx + p3 * (gx + kx) - 2.0 * p4 * kx)) - (px - x)
                qy = dt * (p1 * vy + dt * (p2 * ny + p3 * (gy + ky) - 2.0 * p4 * ky)) - (py - y)
                if qx * qx + qy * qy > (MOVED * rules.allowance * dt) ** 2 * max(speed2, zx * zx + zy * zy):
                    tries += 1
                    if tries > 2:
                        stage = REFUSE
                        break
                    continue
                if rate * dt > STIFF:  # B frozen over a velocity transient that the stages step over
                    passed = rate * dt / (rate * dt + 4.0)
                    change = math.sqrt((zx - vx) ** 2 + (zy - vy) ** 2) * abs(1.0 / rate - 1.0 / onward)
                    if change * passed**3 > rules.allowance * dt * math.sqrt(max(speed2, zx * zx + zy * zy)):
                        stage = REFUSE
                        break
                if not sampled:
                    break
                stage = EARLY if bent else MIDDLE
                continue
            if stage == MIDDLE:
                hx, hy = mx, my
                if bent:  # before the end
                    gx, gy, kx, ky = 2.0 * mx, 2.0 * my, 0.0, 0.0
                    stage = MIDDLE if again else END
                    again = False
                    continue
                kx, ky = 4.0 * mx - 2.0 * gx, 4.0 * my - 2.0 * gy
            elif stage == EARLY:
                ox, oy = mx - 0.25 * gx - 0.1875 * kx, my - 0.25 * gy - 0.1875 * ky
                stage = LATE
                continue
            else:
                mx -= 0.75 * gx + 0.1875 * kx
                my -= 0.75 * gy + 0.1875 * ky
            # displaced per time: by the mean of a parabola, or of a quartic zero at 0, 1/2 and 1, and by a cubic
            horizon = min(rules.until - t0, rules.extent / (math.sqrt(speed2) + fall))
            _, p1, p2, _, _ = phis(-rate * dt)
            carried = dt * p2 + p1 * min(1.0 / rate, horizon)
            allowed = SAFE * rules.allowance * math.sqrt(max(speed2, zx * zx + zy * zy))
            off = carried * math.sqrt(kx * kx + ky * ky) / 6.0
            bend = max(bend, off / allowed)
            if stage == LATE:
                even, odd = math.sqrt((ox + mx) ** 2 + (oy + my) ** 2), math.sqrt((ox - mx) ** 2 + (oy - my) ** 2)
                if BOOLE * carried * even + ODD * dt / (1.0 + rate * dt) * odd > allowed:
                    stage = REFUSE
                break
            if off <= allowed:
                break
            quadratic = bent = True
            stage = END
        if cell < 0:
            continue
        if stage == REFUSE:
            break
        for met in range(2):  # the end of the step, and once more where it is not the face
            e, p1, p2, p3, p4 = phis(-rate * dt)
            cx, cy = gx + kx, gy + ky
            px = x + dt * (p1 * vx + dt * (p2 * nx + p3 * cx - 2.0 * p4 * kx))
            py = y + dt * (p1 * vy + dt * (p2 * ny + p3 * cy - 2.0 * p4 * ky))
            wx = e * vx + dt * (p1 * nx + p2 * cx - 2.0 * p3 * kx)
            wy = e * vy + dt * (p1 * ny + p2 * cy - 2.0 * p3 * ky)
            if last or met == 1:
                break
            off = barycentric(air.geometry, tri, edge, px, py)
            if abs(off) <= ON_FACE:
                break
            speed = air.geometry[tri, at.B0X + 2 * edge] * wx + air.geometry[tri, at.B0Y + 2 * edge] * wy
            part = 1.0 - off / (speed * dt) if speed < 0.0 else 1.0
            if not 0.9 < part < 1.1:
                stage = REFUSE
                break
            last = not t0 + s + part * dt < clock
            part = (clock - t0 - s) / dt if last else part
            dt *= part
            gx, gy, kx, ky = part * (cx - part * kx), part * (cy - part * ky), part * part * kx, part * part * ky
        if stage == REFUSE or not _holds(air.geometry, tri, px, py):
            break
        after2 = wx * wx + wy * wy
        way = 1.01 * dt * math.sqrt(max(speed2, after2))
        if free > way:
            free -= way
        else:  # nothing is met if the distances before and after add up to more than the way
            before = clearance(walls, x, y, grain[at.RADIUS], way)
            free = clearance(walls, px, py, grain[at.RADIUS], AHEAD * way)
            if not before + min(free, way) > way:
                break
        ux, uy = cx / dt, cy / dt
        # the force at the velocity reached, from that at the one foretold
        fx, fy = nx + gx - rate * wx + (onward - rate) * (zx - wx), ny + gy - rate * wy + (onward - rate) * (zy - wy)
        x, y, vx, vy, rate, speed2 = px, py, wx, wy, onward, after2
        s += dt
        left += 1
        state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T] = x, y, vx, vy, t0 + s
        ints[at.TRI] = tri
        if last:
            state[at.T] = clock
            break
        tri = air.neighbours[tri, edge]
        if tri < 0:
            break
        ints[at.TRI] = tri
    ints[at.QUADRATIC] = 1 if bend > KEEP else 0
    return left
