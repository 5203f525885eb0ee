"""The common steps, compiled: every granule flies to the end of the step, then those that meet are dealt with.

The meetings of a step are foretold on the ways that granules go, dealt with in the order of time, each followed by a
new flight of the two to the end of the step; then contact that lasts. A granule that meets more than ``MAX_CONTACTS``
others in a step, pairs that touch slowly, and overlaps (at birth, after a jam) are left to the end of the step, where
impulses and displacements go over all touching pairs until nothing approaches: Moreau's time stepping, as on walls
(``strikes``).
"""

from __future__ import annotations

import math

from ..kernel import layout as at
from ..kernel.events import wall_motion
from ..kernel.jit import called, compiled, entry
from ..kernel.track_start import begin_track, store_point
from ..kernel.walls import clearance
from . import slab_layout as of
from .flight import PULLS, fly_on, press
from .neighbours import keep_lists, near, relist, unlist
from .pairs import MEETS, OVERLAPS, TOUCHES, collide, contact_time, hit_tracer, part, reach_of, roll_back, room_between
from .slab_air import refresh

# -- Meetings, and contact that lasts ----------------------------------------------------------------------------------
MAX_CONTACTS = 8  # meetings of one granule in a step that are followed one by one
CHATTER = 2  # steps: two that meet again so soon, and nobody between, have not parted
SWEEPS = 12  # over the pairs that touch, at most
TOUCH = 1e-6  # of the smaller radius: nearer is contact
MAX_OVERLAP = 1e-3  # of the smaller radius: overlaps below it need no further sweep


@called
def _note(colliding, cells, counts, clock, i, j):
    """Look whether i and j meet or touch in this step, and note it."""
    this, other = colliding.extra[i], colliding.extra[j]
    r = reach_of(colliding.grains[i], colliding.grains[j])
    what, when = contact_time(this, other, r, clock[of.DEPTH], clock[of.PULL])
    tracer = colliding.tally[i, of.TRACER] == 1  # inside another granule it passes it: it was not caught
    if (what == MEETS or (what == OVERLAPS and not tracer)) and counts[of.EVENTS] < cells.when.shape[0]:
        k = counts[of.EVENTS]
        cells.when[k] = when
        cells.who[k, of.FIRST], cells.who[k, of.SECOND] = i, j
        cells.who[k, of.FIRST_STAMP] = colliding.tally[i, of.STAMP]
        cells.who[k, of.SECOND_STAMP] = colliding.tally[j, of.STAMP]
        counts[of.EVENTS] = k + 1
    elif what == TOUCHES and not tracer and counts[of.NEAR] < cells.near.shape[0]:
        cells.near[counts[of.NEAR], 0], cells.near[counts[of.NEAR], 1] = i, j
        counts[of.NEAR] += 1


@called
def foretell(colliding, cells, counts, clock):
    """Note all meetings of the step on the ways as they are, and drop the pairs that no longer hold."""
    counts[of.EVENTS] = counts[of.NEAR] = kept = 0
    pairs, stamps = cells.pairs, cells.stamps
    for k in range(counts[of.PAIRS]):
        i, j, a, b = pairs[k, of.FIRST], pairs[k, of.SECOND], pairs[k, of.FIRST_STAMP], pairs[k, of.SECOND_STAMP]
        if stamps[i] != a or stamps[j] != b:
            continue
        if kept < k:
            pairs[kept, of.FIRST], pairs[kept, of.SECOND] = i, j
            pairs[kept, of.FIRST_STAMP], pairs[kept, of.SECOND_STAMP] = a, b
        kept += 1
        if near(cells.balls, i, j, clock[of.DEPTH]):
            _note(colliding, cells, counts, clock, i, j)
    counts[of.PAIRS] = kept


@called
def _foretell_of(colliding, cells, counts, clock, i):
    """Note the meetings of a granule that was struck with all about it."""
    before = counts[of.PAIRS]
    relist(colliding, cells, clock, counts, i)
    for k in range(before, counts[of.PAIRS]):
        this, other = cells.pairs[k, of.FIRST], cells.pairs[k, of.SECOND]
        if near(cells.balls, this, other, clock[of.DEPTH]):
            _note(colliding, cells, counts, clock, this, other)


@compiled
def _earliest(cells, counts):
    """Take the earliest meeting out of the queue: (time, first, second, stamps)."""
    best = 0
    for k in range(1, counts[of.EVENTS]):
        if cells.when[k] < cells.when[best]:
            best = k
    when, who, last = cells.when[best], cells.who, counts[of.EVENTS] - 1
    i, j, a, b = who[best, 0], who[best, 1], who[best, 2], who[best, 3]
    cells.when[best] = cells.when[last]
    for m in range(of.EVENT):
        who[best, m] = who[last, m]
    counts[of.EVENTS] = last
    return when, i, j, a, b


@called
def fly_some(colliding, laws, air, nodes, walls, rules, clock, room, rows, count):
    """Fly the first ``count`` granules of ``rows`` to the end of the step."""
    for k in range(count):
        i = rows[k]
        fly_on(
            colliding.states[i], colliding.counts[i], colliding.extra[i], colliding.tally[i], colliding.grains[i],
            laws.tables[colliding.table_of[i]], air, nodes, walls, rules, clock, room,
        )  # fmt: skip


@compiled
def _leave_to_the_end(colliding, cells, counts, i, j):
    """Whether the pair has met so often in this step that the rest is contact that lasts."""
    if colliding.extra[i, of.MET] < MAX_CONTACTS and colliding.extra[j, of.MET] < MAX_CONTACTS:
        return False
    if counts[of.NEAR] < cells.near.shape[0] and colliding.tally[i, of.TRACER] == 0:
        cells.near[counts[of.NEAR], 0], cells.near[counts[of.NEAR], 1] = i, j
        counts[of.NEAR] += 1
    return True


@compiled
def _copy(row, to):
    """Number by number: the kernel makes no arrays, and a slice might."""
    for m in range(row.shape[0]):
        to[m] = row[m]


@called
def _strike_tracer(colliding, laws, rules, clock, room, i, j, when):
    """Let a tracer i meet the granule j where that was at the time, if it is caught; j does not notice. Whether."""
    if not hit_tracer(colliding, laws.tables, i, j, rules):
        return False
    state, ints, extra = colliding.states[j], colliding.counts[j], colliding.extra[j]
    _copy(state, room.kept_state)
    _copy(ints, room.kept_ints)
    _copy(extra, room.kept_extra)
    roll_back(colliding.states[i], colliding.counts[i], colliding.extra[i], clock, when)
    roll_back(state, ints, extra, clock, when)
    if collide(colliding, laws, rules, clock[of.DEPTH], i, j, 1.0):
        colliding.tally[i, of.MEETINGS] += 1
    _copy(room.kept_state, state)
    _copy(room.kept_ints, ints)
    _copy(room.kept_extra, extra)
    return True


@compiled
def _count(colliding, counts, i, j):
    """Count a meeting of two granules. Two that chatter, one between the other and a wall, have met once."""
    this, other, now = colliding.tally[i], colliding.tally[j], counts[of.STEPS]
    last = this[of.PARTNER] == j and other[of.PARTNER] == i
    if not last or now - this[of.MET_IN] > CHATTER:
        this[of.MEETINGS] += 1
        other[of.MEETINGS] += 1
    this[of.PARTNER], other[of.PARTNER] = j, i
    this[of.MET_IN] = other[of.MET_IN] = now


@called
def _strike_pair(colliding, laws, rules, clock, counts, i, j, when):
    """The meeting of two granules of the same right."""
    roll_back(colliding.states[i], colliding.counts[i], colliding.extra[i], clock, when)
    roll_back(colliding.states[j], colliding.counts[j], colliding.extra[j], clock, when)
    if collide(colliding, laws, rules, clock[of.DEPTH], i, j, 1.0):
        _count(colliding, counts, i, j)


@called
def collide_all(colliding, laws, air, nodes, walls, rules, clock, room, cells, counts):
    """Deal with the meetings that ``foretell`` noted, and with those that come of them."""
    while counts[of.EVENTS] > 0:
        when, i, j, a, b = _earliest(cells, counts)
        stale = colliding.tally[i, of.STAMP] != a or colliding.tally[j, of.STAMP] != b
        if stale or _leave_to_the_end(colliding, cells, counts, i, j):
            continue
        both = colliding.tally[i, of.TRACER] == 0
        if both:
            _strike_pair(colliding, laws, rules, clock, counts, i, j, when)
        elif not _strike_tracer(colliding, laws, rules, clock, room, i, j, when):
            continue
        colliding.extra[i, of.MET] += 1.0
        struck = 1
        if both:
            colliding.extra[j, of.MET] += 1.0
            struck = 2
        room.struck[0], room.struck[1] = i, j
        fly_some(colliding, laws, air, nodes, walls, rules, clock, room, room.struck, struck)
        _foretell_of(colliding, cells, counts, clock, i)
        if both:
            _foretell_of(colliding, cells, counts, clock, j)


@compiled
def _settle_pair(colliding, laws, rules, clock, counts, i, j, sweep):
    """Impulse and displacement of a pair that touches at the end of the step; how deep it was over the smaller
    radius.
    """
    if colliding.counts[i, at.FATE] != at.FLYING or colliding.counts[j, at.FATE] != at.FLYING:
        return 0.0
    least = min(colliding.grains[i, at.RADIUS], colliding.grains[j, at.RADIUS])
    room, nx, ny, nz = room_between(colliding, clock[of.DEPTH], i, j)
    if room >= TOUCH * least:
        return 0.0
    closing = (colliding.states[j, at.VX] - colliding.states[i, at.VX]) * nx
    closing += (colliding.states[j, at.VY] - colliding.states[i, at.VY]) * ny
    closing += (colliding.extra[j, of.VZ] - colliding.extra[i, of.VZ]) * nz
    colliding.extra[i, of.TOUCHED] = colliding.extra[j, of.TOUCHED] = of.TOUCHES_OTHERS
    if closing > 0.0:
        slow = closing <= at.SLOW + PULLS * clock[of.PULL] * (clock[of.UNTIL] - clock[of.NOW])
        if collide(colliding, laws, rules, clock[of.DEPTH], i, j, 0.0 if slow else 1.0) and not slow and sweep == 0:
            _count(colliding, counts, i, j)
    part(colliding, clock[of.DEPTH], i, j)
    return max(-room, 0.0) / least


@called
def _lean(colliding, walls, rules, clock, room, i, h):
    """Take a granule that others pushed out of the walls again."""
    state, ints, extra, grain = colliding.states[i], colliding.counts[i], colliding.extra[i], colliding.grains[i]
    extra[of.ROOM] = clearance(walls, state[at.X], state[at.Y], grain[at.RADIUS], rules.length)
    if extra[of.ROOM] <= 0.0:
        press(state, ints, extra, grain, walls, rules, room.hold, h, clock[of.PULL])
        extra[of.ROOM] = 0.0


@called
def settle_all(colliding, laws, walls, rules, clock, room, cells, counts):
    """Contact that lasts at the end of the step, over all pairs that touch and the walls that they lean on."""
    h = clock[of.UNTIL] - clock[of.NOW]
    for sweep in range(SWEEPS):
        worst = 0.0
        for k in range(counts[of.NEAR]):
            i, j = cells.near[k, 0], cells.near[k, 1]
            deep = _settle_pair(colliding, laws, rules, clock, counts, i, j, sweep)
            worst = max(worst, deep)
            if deep > 0.0:
                for side in range(2):
                    g = i if side == 0 else j
                    if walls.bodies.shape[0] > 0 and colliding.extra[g, of.ROOM] <= 0.0:
                        _lean(colliding, walls, rules, clock, room, g, h)
        if worst <= MAX_OVERLAP:
            break


# -- The steps ---------------------------------------------------------------------------------------------------------
LULL = 100.0  # steps for which a granule that leans on others must be slow before it counts as lying still
CALM = 2.0  # steps of a pull: slower among others is at rest
LEANS = 20.0  # the same: slower among others, which push, it gets nowhere
EARLY = 1e-9  # of a step: a birth this near to its end is the next step's


@called
def _enter(colliding, counts, clock, air, walls, room, timed):
    """Let those be born whose time comes in this step."""
    h = clock[of.UNTIL] - clock[of.NOW]
    while counts[of.BORN] < colliding.waiting.shape[0]:
        i = colliding.waiting[counts[of.BORN]]
        state, ints, extra = colliding.states[i], colliding.counts[i], colliding.extra[i]
        if state[at.BORN] >= clock[of.UNTIL] - EARLY * h:
            break
        counts[of.BORN] += 1
        begin_track(state, ints, room.affine, room.hold, air, colliding.grains[i], walls, timed)
        store_point(state, ints, colliding.records[i], 0)
        extra[of.ROOM] = 0.0
        if ints[at.FATE] == at.FLYING:
            colliding.living[counts[of.LIVING]] = i
            counts[of.LIVING] += 1


@compiled
def _lies_still(state, ints, extra, walls, clock, rest):
    """Count how long a granule has been at rest on a wall or among others; whether that is long enough, and whether it
    is slow there.
    """
    h = clock[of.UNTIL] - clock[of.NOW]
    if extra[of.TOUCHED] == of.LOOSE:
        state[at.HELD] = 0.0
        return False, False
    if extra[of.TOUCHED] == of.HELD_BY_WALL:
        state[at.HELD] += h
        return state[at.HELD] > rest, True
    vx, vy = state[at.VX], state[at.VY]
    if ints[at.CONTACT] != at.FREE:
        wx, wy, _, _, _ = wall_motion(walls.bodies, ints[at.BODY], state[at.T], state[at.X], state[at.Y], 0.0, 0.0)
        vx, vy = vx - wx, vy - wy
    speed, pull = math.sqrt(vx * vx + vy * vy + extra[of.VZ] ** 2), h * clock[of.PULL]
    state[at.HELD] = state[at.HELD] + h if speed <= CALM * pull else 0.0
    return state[at.HELD] > rest + LULL * h, speed <= LEANS * pull


@called
def _close(colliding, cells, counts, clock, walls, rules):
    """End the step: who lies still, who has ended, where across the slab."""
    living, kept, standing, leaning, depth = counts[of.LIVING], 0, 0, 0, clock[of.DEPTH]
    for k in range(living):
        i = colliding.living[k]
        state, ints, extra = colliding.states[i], colliding.counts[i], colliding.extra[i]
        extra[of.Z] -= depth * math.floor(extra[of.Z] / depth)
        extra[of.MET] = 0.0
        if ints[at.FATE] == at.FLYING:
            lies, leans = _lies_still(state, ints, extra, walls, clock, rules.rest)
            standing += lies
            leaning += leans
            store_point(state, ints, colliding.records[i], 0)
            colliding.living[kept] = i
            kept += 1
        else:
            store_point(state, ints, colliding.records[i], 1)
            unlist(cells, counts, i)
    counts[of.FLOWN] += living
    counts[of.LIVING], counts[of.STANDING], counts[of.LEANING] = kept, standing, leaning
    counts[of.STEPS] += 1
    clock[of.NOW] = clock[of.UNTIL]


@called
def _begin(colliding, counts, clock, air, nodes, walls, rules, room, timed, stop):
    """Set the clock for the next step; an empty slab goes on with the next birth. Whether there is anything to do."""
    if counts[of.LIVING] == 0:
        if counts[of.BORN] == colliding.waiting.shape[0]:
            clock[of.NOW] = stop
            return False
        clock[of.NOW] = max(clock[of.NOW], colliding.states[colliding.waiting[counts[of.BORN]], at.BORN])
    if not clock[of.NOW] < stop:
        return False
    clock[of.UNTIL] = min(clock[of.NOW] + clock[of.STEP], stop)
    if stop - clock[of.UNTIL] < EARLY * clock[of.STEP]:
        clock[of.UNTIL] = stop
    refresh(air, nodes, clock, room, timed)
    _enter(colliding, counts, clock, air, walls, room, timed)
    return True


@called
def _finish(colliding, laws, air, nodes, walls, rules, clock, room, cells, counts):
    """What follows the flight of a step: meetings, contact that lasts, ends."""
    keep_lists(colliding, cells, clock, counts)
    foretell(colliding, cells, counts, clock)
    collide_all(colliding, laws, air, nodes, walls, rules, clock, room, cells, counts)
    settle_all(colliding, laws, walls, rules, clock, room, cells, counts)
    _close(colliding, cells, counts, clock, walls, rules)


@entry
def march_slab(colliding, laws, air, nodes, walls, rules, clock, room, cells, counts, stop, steps, timed, final):
    """March up to ``steps`` steps of the clock, until it shows ``stop`` (s), or, when nobody is to come any more
    (``final``), all lie still. Returns whether that is so.
    """
    for _ in range(steps):
        if not _begin(colliding, counts, clock, air, nodes, walls, rules, room, timed, stop):
            return True
        fly_some(colliding, laws, air, nodes, walls, rules, clock, room, colliding.living, counts[of.LIVING])
        _finish(colliding, laws, air, nodes, walls, rules, clock, room, cells, counts)
        if final and counts[of.STANDING] == counts[of.LIVING] and counts[of.BORN] == colliding.waiting.shape[0]:
            return True
    return not clock[of.NOW] < stop
