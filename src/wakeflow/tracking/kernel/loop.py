"""The kernel: every granule flies on its own clock until a fate ends its track.

A granule's step is cut at the first of: leaving its triangle, touching a wall, crossing a line, the next snapshot,
the end. Each is found on the dense output of the step, so a cut costs neither evaluations nor order.
"""

from __future__ import annotations

import math

from .air import bracket, load
from .contact import ends_of_slide, friction_turn, grip, lets_go, rescue, settle, strike, takes_hold
from .dense_output import along, sway
from .dispersion import renew
from .events import CROSSED, EXIT, GRIPS, HALTED, LIFTED, NOTHING, SLID_OFF, WALL, displacement
from .jit import compiled, entry, inlined, merged
from .layout import (
    AIRBORNE,
    BINNED,
    BODY,
    CONTACT,
    ESCAPED,
    EVALUATIONS,
    FATE,
    FEATURE,
    FLYING,
    FREE,
    FRESH,
    GAP,
    GX,
    GY,
    H_ERROR,
    HOPS,
    IMPACTS,
    KIND,
    LINE,
    MAGNUS,
    NOBODY,
    NOISE,
    NX,
    NY,
    RADIUS,
    RESTING,
    ROLL,
    SEEN,
    STEPS,
    STOPPED,
    STORED,
    STRIDE,
    STUCK,
    SWING,
    T_END,
    T_NOISE,
    TRI,
    TURN,
    VX,
    VY,
    T,
    X,
    Y,
)
from .locate import barycentric, reproject, walk
from .step import free_force, spin_at
from .step_control import EDGE, HOP_LIMIT, confined_step, leap, leaves, longest_step
from .walls import constrain, crossing, first_contact, grasp, inside, overlap

__all__ = ["fly_block"]

PROGRESS = 1e-8  # of the step tried: less is none


@compiled
def _store(state, ints, record, last):
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
def _at_boundary(state, ints, air, walls, rules, k):
    """End the track on edge k of the mesh, or on the line that lies there."""
    tri, g = ints[TRI], air.geometry
    bx, by = g[tri, 2 + 2 * k], g[tri, 3 + 2 * k]
    off = barycentric(g, tri, k, state[X], state[Y]) / (bx * bx + by * by)
    state[X] -= off * bx
    state[Y] -= off * by
    ints[FATE] = ESCAPED
    near = 1e-9 * rules.extent + rules.allowance * rules.extent
    sx, sy, _, _, _, _ = displacement(walls.frame, 0, state[T])
    for i in range(walls.lines.shape[0]):
        x0, y0, x1, y1 = walls.lines[i, 0] + sx, walls.lines[i, 1] + sy, walls.lines[i, 2] + sx, walls.lines[i, 3] + sy
        ex, ey = x1 - x0, y1 - y0
        w = ((state[X] - x0) * ex + (state[Y] - y0) * ey) / (ex * ex + ey * ey)
        w = min(1.0, max(0.0, w))
        dx, dy = state[X] - x0 - w * ex, state[Y] - y0 - w * ey
        if math.sqrt(dx * dx + dy * dy) <= near:
            ints[FATE], ints[LINE] = BINNED, walls.line_ids[i]
            return


@compiled
def _cross(state, ints, air, walls, rules, k):
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
def _hop(state, ints, air, walls, rules):
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
def _begin(state, ints, hold, air, grain, walls, rules):
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
def _advance(end, s, h, state, ints, rules):
    """Move to time s of the step; clocks that were aimed at are met exactly."""
    t0 = state[T]
    state[X], state[Y], state[VX], state[VY] = end
    state[T] = t0 + s
    if s == h:
        if h == rules.until - t0:
            state[T] = rules.until
        elif h == state[T_END] - t0:
            state[T] = state[T_END]
        elif h == state[T_NOISE] - t0:
            state[T] = state[T_NOISE]
    if s > PROGRESS * h:
        ints[HOPS] = 0
        ints[STUCK] = 0


@inlined
def _refresh(state, ints, affine, air, grain, table, walls, rules, timed):
    """Find the snapshots, the noise and the boundary edge of the granule's clock and place; that edge's length."""
    edge = 0.0
    if ints[GAP] >= 0:
        buried = False
        for body in range(walls.bodies.shape[0]):
            buried = buried or inside(walls, body, state[X], state[Y])[0]
        edge = reproject(state, ints, air, buried)
    if timed and state[T] >= state[T_END]:
        bracket(state, ints, affine, air)
    if grain[NOISE] != 0.0 and state[T] >= state[T_NOISE]:
        renew(state, ints, affine, air, grain, table, rules)
    return edge


@merged
def _one_step(state, ints, path, affine, hold, air, grain, table, walls, rules, timed, edge, record):
    """One step and what ends it."""
    x, y, vx, vy, t0 = state[X], state[Y], state[VX], state[VY], state[T]
    fx, fy, rate, ux, uy = free_force(affine, grain, table, x, y, vx, vy, t0, state[TURN])
    ints[EVALUATIONS] += 1
    wind2 = ux * ux + uy * uy
    pull = math.sqrt(affine[8] ** 2 + affine[11] ** 2) + rules.shaken
    speed = math.sqrt(max(vx * vx + vy * vy, wind2 if rate > 0.0 else 0.0))
    if hold[KIND] != FREE:
        if grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed):
            ints[STEPS] += 1
            _store(state, ints, record, 0)
            return
        if hold[KIND] != FREE:
            fx, fy, _, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t0)
    path[0], path[1], path[2], path[3], path[4] = x, y, vx, vy, rate
    path[5], path[6], path[11], path[12] = fx + rate * vx, fy + rate * vy, ux, uy
    meshed = air.corners.shape[0] > 0 and ints[GAP] < 0
    blind = ints[HOPS] >= HOP_LIMIT
    longest, inside_cell = longest_step(state, ints, path, hold, air, grain, walls, rules, timed, speed, pull, edge)
    h = min(longest, inside_cell)
    wx = wy = px = py = 0.0
    if hold[KIND] == FREE:
        wx, wy, px, py = sway(path, affine, SWING, t0)
    else:
        path[15] = 0.0
    path[5], path[6], path[11], path[12] = path[5] + px + rate * wx, path[6] + py + rate * wy, ux + wx, uy + wy
    h = confined_step(path, h, state, ints, affine, grain, table, hold, rules, speed, pull)
    if not h > 0.0:
        ints[FATE] = STOPPED
        return
    s, event, kind, which, line = h, NOTHING, FREE, NOBODY, NOBODY
    if meshed and not blind:
        s, which = leaves(path, h, ints, air)
        event = EXIT if which >= 0 else NOTHING
    turn = (0.0, 0.0, 0.0)
    if hold[KIND] != FREE:
        turn = friction_turn(path, h, state, affine, grain, table, hold)
        s, let_go = lets_go(path, s, state, affine, grain, table, hold)
        event = let_go if let_go != NOTHING else event
        if let_go != LIFTED or s > PROGRESS * h:  # what lifts off at once does not grip first
            s, gripped = takes_hold(path, s, state, ints, hold, grain, walls, turn)
            event = GRIPS if gripped else event
        s, slid, next_kind, next_which = ends_of_slide(path, ints, hold, grain, walls, rules, s, t0)
        if slid != NOTHING:
            event, kind, which = slid, next_kind, next_which
    end = along(path, s)
    if walls.bodies.shape[0] > 0 and ints[STUCK] < HOP_LIMIT:
        found, hit_kind, hit = first_contact(path, s, end, t0, grain[RADIUS], rules.skin, walls, ints)
        if found >= 0.0:
            s, event, kind, which = found, WALL, hit_kind, hit
            end = along(path, s)
    found, line = crossing(path, s, end, t0, walls, rules.skin)
    if found >= 0.0:
        s, event = found, CROSSED
        end = along(path, s)
    ints[STEPS] += 1
    if hold[KIND] == FREE:
        if grain[MAGNUS] != 0.0:
            state[TURN] = spin_at(affine, grain, state[TURN], t0, s)
    elif hold[ROLL] == 0.0:
        state[TURN] += s * (turn[0] + s * (turn[1] + s * turn[2]))
    _advance(end, s, h, state, ints, rules)
    if hold[KIND] != FREE:
        settle(state, ints, hold, walls, hold[ROLL] != 0.0 or event == GRIPS)
    if event == CROSSED:
        ints[FATE], ints[LINE] = BINNED, line
        return
    if event == EXIT:
        if s <= PROGRESS * h:
            ints[HOPS] += 1
        _cross(state, ints, air, walls, rules, which)
    elif event == WALL:
        ints[STUCK] += 1
        strike(state, ints, hold, affine, grain, table, walls, rules, kind, which)
        slow = state[VX] ** 2 + state[VY] ** 2 <= 1e-8 * rules.length * pull
        if ints[STUCK] == HOP_LIMIT and slow and walls.bodies[ints[BODY], 6] == 0.0 and ints[CONTACT] != FREE:
            ints[FATE] = RESTING  # pressed into a corner
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
        rescue(state, ints, hold, affine, grain, table, walls, rules)
    if meshed and blind and ints[FATE] == FLYING:
        found_tri, code = walk(air.geometry, air.neighbours, ints[TRI], state[X], state[Y])
        ints[TRI], ints[FRESH] = found_tri, 0
        if code <= -2:
            ints[GAP] = -2 - code
        elif code == -1:
            ints[FATE] = ESCAPED
    _store(state, ints, record, 0)


@inlined
def _born(state, ints, affine, hold, air, grain, walls, rules, timed):
    """Scratch and state of a new granule."""
    affine[:] = 0.0
    hold[:] = 0.0
    ints[STRIDE] = 1
    state[T_END] = -math.inf if timed else math.inf
    state[H_ERROR] = math.inf
    state[T_NOISE] = -math.inf if grain[NOISE] != 0.0 else math.inf
    if air.corners.shape[0] == 0:
        affine[8], affine[11] = grain[GX], grain[GY]
        ints[FRESH] = 1
    _begin(state, ints, hold, air, grain, walls, rules)


@entry
def fly_block(states, counts, grains, tables, table_of, air, walls, rules, records, path, affine, hold):
    """Track a block of granules, each from birth to its fate; path, affine and hold are the block's scratch."""
    timed = (air.times.shape[0] > 1 or air.smooth[1] != 0.0) and air.corners.shape[0] > 0
    for i in range(states.shape[0]):
        state, ints, grain, table, record = states[i], counts[i], grains[i], tables[table_of[i]], records[i]
        _born(state, ints, affine, hold, air, grain, walls, rules, timed)
        _store(state, ints, record, 0)
        while ints[FATE] == FLYING:
            if state[T] >= rules.until:
                ints[FATE] = AIRBORNE
            elif ints[STEPS] >= rules.steps or ints[IMPACTS] >= rules.impacts:
                ints[FATE] = STOPPED
            else:
                edge = _refresh(state, ints, affine, air, grain, table, walls, rules, timed)
                meshed = air.corners.shape[0] > 0 and ints[GAP] < 0 and ints[HOPS] < HOP_LIMIT
                if meshed and _hop(state, ints, air, walls, rules):
                    continue
                drawn = record.shape[0] > 0
                if meshed and leap(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn) > 0:
                    _store(state, ints, record, 0)
                    continue
                if ints[FRESH] == 0:
                    load(state, ints, affine, air, grain)
                _one_step(state, ints, path, affine, hold, air, grain, table, walls, rules, timed, edge, record)
        _store(state, ints, record, 1)
