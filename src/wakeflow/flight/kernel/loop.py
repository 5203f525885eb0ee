"""The kernel: every granule flies on its own clock until a fate ends its track.

A granule's step is cut at the first of: leaving its triangle, touching a wall, crossing a line, the next snapshot,
the end. Each is found on the dense output of the step, so a cut costs neither evaluations nor order.
"""

from __future__ import annotations

import math

from . import events
from . import layout as at
from .air import bracket, free_force, load_triangle, spin_at
from .contact import ends_of_slide, friction_turn, grip, lets_go, rescue, settle, strike, takes_hold
from .crossings import first_line, first_wall
from .dense_output import along, sway
from .dispersion import renew
from .events import wall_motion
from .history import begin_memory, remember
from .jit import called, compiled, entry, merged
from .locate import reproject
from .step import HOP_LIMIT, PROGRESS, confined_step, cross_edge, hop, leaves, longest_step, relocate
from .strides import multi_cell_step
from .track_start import begin_track, store_point
from .walls import constrain, grasp

PRESSED = 1e-8  # of the square of the speed that a body's length of the pull gives: slower is at rest in a corner


@compiled
def _advance(end, s, h, state, ints, rules):
    """Move to time s of the step; clocks that were aimed at are met exactly."""
    t0 = state[at.T]
    state[at.X], state[at.Y], state[at.VX], state[at.VY] = end
    state[at.T] = t0 + s
    if s == h:
        if h == rules.until - t0:
            state[at.T] = rules.until
        elif h == state[at.T_END] - t0:
            state[at.T] = state[at.T_END]
        elif h == state[at.T_NOISE] - t0:
            state[at.T] = state[at.T_NOISE]
    if s > PROGRESS * h:
        ints[at.HOPS] = 0
        ints[at.STUCK] = 0


@compiled
def _refresh(state, ints, affine, air, grain, table, walls, rules, timed):
    """Find the snapshots, the noise and the boundary edge of the granule's clock and place; that edge's length."""
    edge = 0.0
    if ints[at.GAP] >= 0:
        edge = reproject(state, ints, air, walls)
    if timed and state[at.T] >= state[at.T_END]:
        bracket(state, ints, affine, air)
    if grain[at.NOISE] != 0.0 and state[at.T] >= state[at.T_NOISE]:
        renew(state, ints, affine, air, grain, table, rules)
    return edge


@compiled
def _start(state, ints, path, affine, hold, grain, table, walls, rules, timed):
    """Begin a step: the force where the granule is, in contact what the wall leaves of it, and the path from there.

    Returns the scales of its speed (m/s) and acceleration (m/s2), whether it moves (else it was dealt with), and the
    force per mass without walls (m/s2).
    """
    x, y, vx, vy, t0 = state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T]
    fx, fy, rate, ux, uy = free_force(affine, grain, table, x, y, vx, vy, t0, state[at.SPIN])
    free_x, free_y = fx, fy
    ints[at.EVALUATIONS] += 1
    wind2 = ux * ux + uy * uy
    pull = math.sqrt(affine[at.AX0] ** 2 + affine[at.AY0] ** 2) + rules.shaken
    speed = math.sqrt(max(vx * vx + vy * vy, wind2 if rate > 0.0 else 0.0))
    moves = True
    if hold[at.KIND] != at.FREE:
        moves = not grip(state, ints, hold, affine, grain, table, fx, fy, walls, rules, timed)
        if moves and hold[at.KIND] != at.FREE:
            fx, fy, _, _, _, _ = constrain(hold, fx, fy, x, y, vx, vy, t0)
    if grain[at.FORGET] != 0.0:
        ax, ay = begin_memory(path, state, ints, grain, hold, ux, uy, ux - vx, uy - vy)
        fx, fy = fx + ax, fy + ay
    path[at.START_X], path[at.START_Y], path[at.START_VX], path[at.START_VY], path[at.RATE] = x, y, vx, vy, rate
    path[at.N0X], path[at.N0Y], path[at.AIR_X], path[at.AIR_Y] = fx + rate * vx, fy + rate * vy, ux, uy
    return speed, pull, moves, free_x, free_y


@compiled
def _to_lab(state, path, affine, hold):
    """Let N and the air's velocity of the path be the lab's, for free flight seen from a mesh that swings."""
    wx = wy = px = py = 0.0
    if hold[at.KIND] == at.FREE:
        wx, wy, px, py = sway(path, affine, at.SWING, state[at.T])
    else:
        path[at.MESH_OMEGA] = 0.0
    rate = path[at.RATE]
    path[at.N0X], path[at.N0Y] = path[at.N0X] + px + rate * wx, path[at.N0Y] + py + rate * wy
    path[at.AIR_X], path[at.AIR_Y] = path[at.AIR_X] + wx, path[at.AIR_Y] + wy


@called
def _end_of_contact(path, h, s, event, which, state, ints, affine, grain, table, hold, walls, rules):
    """What ends the sliding or rolling of a granule before time s of the step, if anything does; and how it turns."""
    kind = at.FREE
    turn = friction_turn(path, h, state, affine, grain, table, hold)
    s, let_go = lets_go(path, s, state, affine, grain, table, hold)
    event = let_go if let_go != events.NOTHING else event
    if let_go != events.LIFTED or s > PROGRESS * h:  # what lifts off at once does not grip first
        s, gripped = takes_hold(path, s, state, hold, grain, turn)
        event = events.GRIPS if gripped else event
    s, slid, next_kind, next_which = ends_of_slide(path, ints, hold, grain, walls, rules, s, state[at.T])
    if slid != events.NOTHING:
        event, kind, which = slid, next_kind, next_which
    return s, event, kind, which, turn


@compiled
def _first_event(path, h, in_cell, state, ints, affine, air, grain, table, hold, walls, rules):
    """The first of: leaving the triangle, the end of a contact, a wall, a line. Returns place and velocity there, its
    time in the step, what it is, with which feature or edge or line, and the coefficients of friction's turning.
    """
    s, event, kind, which, line, t0 = h, events.NOTHING, at.FREE, at.NOBODY, at.NOBODY, state[at.T]
    turn = (0.0, 0.0, 0.0)
    if in_cell:
        s, which = leaves(path, h, ints, air)
        event = events.EXIT if which >= 0 else events.NOTHING
    if hold[at.KIND] != at.FREE:
        s, event, kind, which, turn = _end_of_contact(
            path, h, s, event, which, state, ints, affine, grain, table, hold, walls, rules
        )
    end = along(path, s)
    if walls.bodies.shape[0] > 0 and ints[at.STUCK] < HOP_LIMIT:
        met, hit_kind, hit = first_wall(path, s, end, t0, grain[at.RADIUS], rules.skin, walls, ints)
        if met >= 0.0:
            s, event, kind, which = met, events.WALL, hit_kind, hit
            end = along(path, s)
    met, line = first_line(path, s, end, t0, walls, rules.skin)
    if met >= 0.0:
        s, event = met, events.CROSSED
        end = along(path, s)
    return end, s, event, kind, which, line, turn


@compiled
def _move(path, end, s, h, event, turn, state, ints, affine, grain, hold, walls, rules):
    """Move to time s of the step, with the spin that the air or friction gives, and what is remembered of the slip."""
    if hold[at.KIND] == at.FREE:
        if grain[at.MAGNUS] != 0.0:
            state[at.SPIN] = spin_at(affine, grain, state[at.SPIN], state[at.T], s)
    elif hold[at.ROLL] == 0.0:
        state[at.SPIN] += s * (turn[0] + s * (turn[1] + s * turn[2]))
    kick_x = kick_y = 0.0
    if grain[at.FORGET] != 0.0:
        kick_x, kick_y = remember(path, state, grain, hold, s)
    _advance(end, s, h, state, ints, rules)
    if grain[at.FORGET] != 0.0:
        state[at.VX] += kick_x
        state[at.VY] += kick_y
    if hold[at.KIND] != at.FREE:
        settle(state, ints, hold, walls, hold[at.ROLL] != 0.0 or event == events.GRIPS)


@compiled
def _hit(state, ints, hold, affine, grain, table, walls, rules, kind, which, pull):
    """Strike a wall; a slow granule that strikes walls again and again is pressed into a corner and rests."""
    ints[at.STUCK] += 1
    strike(state, ints, hold, affine, grain, table, walls, rules, kind, which)
    slow = state[at.VX] ** 2 + state[at.VY] ** 2 <= PRESSED * rules.length * pull
    still = walls.bodies[ints[at.BODY], at.OMEGA] == 0.0 and ints[at.CONTACT] != at.FREE
    if ints[at.STUCK] == HOP_LIMIT and slow and still:
        ints[at.FATE] = at.RESTING


@compiled
def _slide_off(state, ints, hold, grain, walls, kind, which):
    """Pass from one feature of a body to the next, or into the air where there is none."""
    ints[at.CONTACT], ints[at.FEATURE] = kind, which
    ints[at.STUCK] += 1
    if kind == at.FREE:
        hold[at.KIND] = at.FREE
    else:
        grasp(hold, walls, kind, which, grain[at.RADIUS], state[at.X], state[at.Y], state[at.T])


@compiled
def _react(event, kind, which, no_progress, pull, state, ints, affine, hold, air, grain, table, walls, rules):
    """What an event makes of the granule."""
    if event == events.EXIT:
        if no_progress:
            ints[at.HOPS] += 1
        cross_edge(state, ints, air, walls, rules, which)
    elif event == events.WALL:
        _hit(state, ints, hold, affine, grain, table, walls, rules, kind, which, pull)
    elif event == events.HALTED:
        x, y = state[at.X], state[at.Y]
        state[at.VX], state[at.VY], _, _, _ = wall_motion(walls.bodies, ints[at.BODY], state[at.T], x, y, 0.0, 0.0)
    elif event == events.LIFTED:
        ints[at.CONTACT] = hold[at.KIND] = at.FREE
    elif event == events.SLID_OFF:
        _slide_off(state, ints, hold, grain, walls, kind, which)
    if ints[at.FATE] == at.FLYING and walls.bodies.shape[0] > 0 and event != events.WALL and hold[at.KIND] == at.FREE:
        rescue(state, ints, hold, affine, grain, table, walls, rules)


@compiled
def _gain(begun, vx, vy, fx, fy, state, affine, hold, grain, table):
    """Add up what all but walls gave a granule in a step that ``begun`` at that time (s) with velocity (vx, vy) and
    force per mass (fx, fy): in flight the change of its velocity; in contact, where the wall takes part of it, the
    force of the air and its weight, by the trapezoidal rule.
    """
    if hold[at.KIND] == at.FREE:
        state[at.GAIN_X] += state[at.VX] - vx
        state[at.GAIN_Y] += state[at.VY] - vy
        return
    ex, ey, _, _, _ = free_force(
        affine, grain, table, state[at.X], state[at.Y], state[at.VX], state[at.VY], state[at.T], state[at.SPIN]
    )
    half = 0.5 * (state[at.T] - begun)
    state[at.GAIN_X] += half * (fx + ex)
    state[at.GAIN_Y] += half * (fy + ey)


@merged
def _one_step(state, ints, path, affine, hold, air, grain, table, walls, rules, timed, edge, record):
    """One step and what ends it."""
    begun, vx, vy, kept = state[at.T], state[at.VX], state[at.VY], record.shape[0] > 0
    speed, pull, moves, fx, fy = _start(state, ints, path, affine, hold, grain, table, walls, rules, timed)
    if not moves:
        ints[at.STEPS] += 1
        if grain[at.FORGET] != 0.0:
            remember(path, state, grain, hold, state[at.T] - begun)
        if kept:
            _gain(begun, vx, vy, fx, fy, state, affine, hold, grain, table)
        store_point(state, ints, record, 0)
        return
    meshed = air.corners.shape[0] > 0 and ints[at.GAP] < 0
    blind = ints[at.HOPS] >= HOP_LIMIT
    longest, inside_cell = longest_step(state, ints, path, hold, air, grain, walls, rules, timed, speed, pull, edge)
    _to_lab(state, path, affine, hold)
    h = min(longest, inside_cell)
    h = confined_step(path, h, state, ints, affine, grain, table, hold, rules, speed, pull)
    if not h > 0.0:
        ints[at.FATE] = at.STOPPED
        return
    end, s, event, kind, which, line, turn = _first_event(
        path, h, meshed and not blind, state, ints, affine, air, grain, table, hold, walls, rules
    )
    ints[at.STEPS] += 1
    _move(path, end, s, h, event, turn, state, ints, affine, grain, hold, walls, rules)
    if kept:
        _gain(begun, vx, vy, fx, fy, state, affine, hold, grain, table)
    if event == events.CROSSED:
        ints[at.FATE], ints[at.LINE] = at.BINNED, line
        return
    no_progress = s <= PROGRESS * h
    _react(event, kind, which, no_progress, pull, state, ints, affine, hold, air, grain, table, walls, rules)
    if meshed and blind and ints[at.FATE] == at.FLYING:
        ints[at.FRESH] = 0
        relocate(state, ints, air)
    store_point(state, ints, record, 0)


@entry
def fly_block(states, counts, grains, tables, table_of, air, walls, rules, records, path, affine, hold):
    """Track a block of granules, each from birth to its fate; path, affine and hold are the block's scratch."""
    timed = (air.times.shape[0] > 1 or air.smooth[at.KNOT_RATE] != 0.0) and air.corners.shape[0] > 0
    for i in range(states.shape[0]):
        state, ints, grain, table, record = states[i], counts[i], grains[i], tables[table_of[i]], records[i]
        begin_track(state, ints, affine, hold, air, grain, walls, timed)
        store_point(state, ints, record, 0)
        while ints[at.FATE] == at.FLYING:
            if state[at.T] >= rules.until:
                ints[at.FATE] = at.AIRBORNE
            elif ints[at.STEPS] >= rules.steps or ints[at.IMPACTS] >= rules.impacts:
                ints[at.FATE] = at.STOPPED
            else:
                edge = _refresh(state, ints, affine, air, grain, table, walls, rules, timed)
                meshed = air.corners.shape[0] > 0 and ints[at.GAP] < 0 and ints[at.HOPS] < HOP_LIMIT
                if meshed and hop(state, ints, air, walls, rules):
                    continue
                drawn, vx, vy = record.shape[0] > 0, state[at.VX], state[at.VY]
                if meshed and multi_cell_step(path, state, ints, hold, affine, air, grain, table, walls, rules, drawn):
                    state[at.GAIN_X] += state[at.VX] - vx
                    state[at.GAIN_Y] += state[at.VY] - vy
                    store_point(state, ints, record, 0)
                    continue
                if ints[at.FRESH] == 0:
                    load_triangle(state, ints, affine, air, grain)
                _one_step(state, ints, path, affine, hold, air, grain, table, walls, rules, timed, edge, record)
        store_point(state, ints, record, 1)
