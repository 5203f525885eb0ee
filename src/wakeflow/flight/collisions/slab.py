"""The crowd's steps, compiled: everybody flies to the end of the step, then those that meet are dealt with."""

from __future__ import annotations

import math

from ..kernel import layout as at
from ..kernel.events import wall_motion
from ..kernel.jit import called, compiled, entry
from ..kernel.track_start import begin_track, store_point
from . import slab_layout as of
from .contacts import collide_all, fly_some, foretell, settle_all
from .neighbours import keep_lists, unlist
from .slab_air import refresh

LULL = 100.0  # steps for which a granule that leans on others must be slow before it counts as lying still
CALM = 2.0  # steps of a pull: slower among others is at rest
LEANS = 20.0  # the same: slower among others, which push, it gets nowhere
EARLY = 1e-9  # of a step: a birth this near to its end is the next step's


@called
def _enter(crowd, counts, clock, air, walls, room, timed):
    """Let those be born whose time comes in this step."""
    h = clock[of.UNTIL] - clock[of.NOW]
    while counts[of.BORN] < crowd.waiting.shape[0]:
        i = crowd.waiting[counts[of.BORN]]
        state, ints, own = crowd.states[i], crowd.counts[i], crowd.own[i]
        if state[at.BORN] >= clock[of.UNTIL] - EARLY * h:
            break
        counts[of.BORN] += 1
        begin_track(state, ints, room.affine, room.hold, air, crowd.grains[i], walls, timed)
        store_point(state, ints, crowd.records[i], 0)
        own[of.ROOM] = 0.0
        if ints[at.FATE] == at.FLYING:
            crowd.living[counts[of.LIVING]] = i
            counts[of.LIVING] += 1


@compiled
def _lies_still(state, ints, own, walls, clock, rest):
    """Count how long a granule has been at rest on a wall or among others; whether that is long enough, and whether it
    is slow there.
    """
    h = clock[of.UNTIL] - clock[of.NOW]
    if own[of.TOUCHED] == of.LOOSE:
        state[at.HELD] = 0.0
        return False, False
    if own[of.TOUCHED] == of.HELD_BY_WALL:
        state[at.HELD] += h
        return state[at.HELD] > rest, True
    vx, vy = state[at.VX], state[at.VY]
    if ints[at.CONTACT] != at.FREE:
        wx, wy, _, _, _ = wall_motion(walls.bodies, ints[at.BODY], state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
        vx, vy = vx - wx, vy - wy
    speed, pull = math.sqrt(vx * vx + vy * vy + own[of.VZ] ** 2), h * clock[of.PULL]
    state[at.HELD] = state[at.HELD] + h if speed <= CALM * pull else 0.0
    return state[at.HELD] > rest + LULL * h, speed <= LEANS * pull


@called
def _close(crowd, cells, counts, clock, walls, rules):
    """End the step: who lies still, who has ended, where across the slab."""
    living, kept, standing, leaning, depth = counts[of.LIVING], 0, 0, 0, clock[of.DEPTH]
    for k in range(living):
        i = crowd.living[k]
        state, ints, own = crowd.states[i], crowd.counts[i], crowd.own[i]
        own[of.Z] -= depth * math.floor(own[of.Z] / depth)
        own[of.MET] = 0.0
        if ints[at.FATE] == at.FLYING:
            lies, leans = _lies_still(state, ints, own, walls, clock, rules.rest)
            standing += lies
            leaning += leans
            store_point(state, ints, crowd.records[i], 0)
            crowd.living[kept] = i
            kept += 1
        else:
            store_point(state, ints, crowd.records[i], 1)
            unlist(cells, counts, i)
    counts[of.FLOWN] += living
    counts[of.LIVING], counts[of.STANDING], counts[of.LEANING] = kept, standing, leaning
    counts[of.STEPS] += 1
    clock[of.NOW] = clock[of.UNTIL]


@called
def _begin(crowd, counts, clock, air, nodes, walls, rules, room, timed, stop):
    """Set the clock for the next step; an empty slab goes on with the next birth. Whether there is anything to do."""
    if counts[of.LIVING] == 0:
        if counts[of.BORN] == crowd.waiting.shape[0]:
            clock[of.NOW] = stop
            return False
        clock[of.NOW] = max(clock[of.NOW], crowd.states[crowd.waiting[counts[of.BORN]], at.BORN])
    if not clock[of.NOW] < stop:
        return False
    clock[of.UNTIL] = min(clock[of.NOW] + clock[of.STEP], stop)
    if stop - clock[of.UNTIL] < EARLY * clock[of.STEP]:
        clock[of.UNTIL] = stop
    refresh(air, nodes, clock, room, timed)
    _enter(crowd, counts, clock, air, walls, room, timed)
    return True


@called
def _finish(crowd, laws, air, nodes, walls, rules, clock, room, cells, counts):
    """What follows the flight of a step: meetings, contact that lasts, ends."""
    keep_lists(crowd, cells, clock, counts)
    foretell(crowd, cells, counts, clock)
    collide_all(crowd, laws, air, nodes, walls, rules, clock, room, cells, counts)
    settle_all(crowd, laws, walls, rules, clock, room, cells, counts)
    _close(crowd, cells, counts, clock, walls, rules)


@entry
def march_slab(crowd, laws, air, nodes, walls, rules, clock, room, cells, counts, stop, steps, timed, final):
    """Up to ``steps`` steps of the clock, until it shows ``stop`` (s), or, when nobody is to come any more (``final``),
    all lie still. Whether that is so.
    """
    for _ in range(steps):
        if not _begin(crowd, counts, clock, air, nodes, walls, rules, room, timed, stop):
            return True
        fly_some(crowd, laws, air, nodes, walls, rules, clock, room, crowd.living, counts[of.LIVING])
        _finish(crowd, laws, air, nodes, walls, rules, clock, room, cells, counts)
        if final and counts[of.STANDING] == counts[of.LIVING] and counts[of.BORN] == crowd.waiting.shape[0]:
            return True
    return not clock[of.NOW] < stop
