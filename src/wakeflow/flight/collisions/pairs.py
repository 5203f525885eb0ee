"""Two granules: when they meet on the ways that they go in a step, and what the meeting does to them."""

from __future__ import annotations

import math

import numpy as np

from ...laws.impaction import sphere_caught
from ..kernel import layout as at
from ..kernel.air import drag_rate
from ..kernel.dispersion import random_normals
from ..kernel.jit import called, compiled
from ..kernel.strike import spin_flung
from . import slab_layout as of
from .flight import PULLS, pair_law
from .neighbours import across

_caught = compiled(sphere_caught)
NEVER, MEETS, TOUCHES, OVERLAPS = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
LOOKS = 12  # Newton-like looks for the time of a meeting; each gains the digits of pull x time / speed
CLOSE = 1e-12  # of the sum of radii: nearer is contact
LAST_BIT = 1e-15  # of a step: no time is known better


@compiled
def _first_root(dd, du, uu, reach2):
    """The first time from 0 at which |d + u s| falls to the distance whose square is reach2; -1.0 if it does not."""
    if du >= 0.0:
        return -1.0
    under = du * du - uu * (dd - reach2)
    if under < 0.0:
        return -1.0
    return max((dd - reach2) / (-du + math.sqrt(under)), 0.0)


@compiled
def _relative(this, other, begin, depth):
    """Relative place, velocity and acceleration of two pieces of way at a time of the step."""
    s, t = begin - this[of.LEG_BEGIN], begin - other[of.LEG_BEGIN]
    ax, ay = this[of.LEG_AX] - other[of.LEG_AX], this[of.LEG_AY] - other[of.LEG_AY]
    az = this[of.LEG_AZ] - other[of.LEG_AZ]
    ux = this[of.LEG_VX] - other[of.LEG_VX] + s * this[of.LEG_AX] - t * other[of.LEG_AX]
    uy = this[of.LEG_VY] - other[of.LEG_VY] + s * this[of.LEG_AY] - t * other[of.LEG_AY]
    uz = this[of.LEG_VZ] - other[of.LEG_VZ] + s * this[of.LEG_AZ] - t * other[of.LEG_AZ]
    dx = this[of.LEG_X] - other[of.LEG_X] + s * (this[of.LEG_VX] + 0.5 * s * this[of.LEG_AX])
    dx -= t * (other[of.LEG_VX] + 0.5 * t * other[of.LEG_AX])
    dy = this[of.LEG_Y] - other[of.LEG_Y] + s * (this[of.LEG_VY] + 0.5 * s * this[of.LEG_AY])
    dy -= t * (other[of.LEG_VY] + 0.5 * t * other[of.LEG_AY])
    dz = this[of.LEG_Z] - other[of.LEG_Z] + s * (this[of.LEG_VZ] + 0.5 * s * this[of.LEG_AZ])
    dz = across(dz - t * (other[of.LEG_VZ] + 0.5 * t * other[of.LEG_AZ]), depth)
    return dx, dy, dz, ux, uy, uz, ax, ay, az


@compiled
def contact_time(this, other, r, depth, weight):
    """What two granules do on their pieces of way in this step: (MEETS, time), (OVERLAPS, time) where they overlap
    already and approach, (TOUCHES, 0) for contact that lasts, (NEVER, 0). ``this`` and ``other`` are rows of
    ``Colliding.extra``, ``r`` the sum of radii, ``weight`` (m/s2) what presses granules on each other that lie.

    Straight relative motion, as in a vacuum, is solved exactly; where the ways bend it is solved again from the time
    found, which converges like pull x step / speed.
    """
    begin, end = max(this[of.LEG_BEGIN], other[of.LEG_BEGIN]), min(this[of.LEG_END], other[of.LEG_END])
    if end < begin:
        return NEVER, 0.0
    dx, dy, dz, ux, uy, uz, ax, ay, az = _relative(this, other, begin, depth)
    span, pull = end - begin, math.sqrt(ax * ax + ay * ay + az * az)
    dd, du, uu = dx * dx + dy * dy + dz * dz, dx * ux + dy * uy + dz * uz, ux * ux + uy * uy + uz * uz
    way, r2 = r + span * (math.sqrt(uu) + 0.5 * span * pull), r * r
    if dd > way * way:
        return NEVER, 0.0
    now, slow = 0.0, (at.SLOW + PULLS * span * max(pull, weight)) * r
    if dd <= r2 * (1.0 + CLOSE):
        return (OVERLAPS, begin) if -du > slow else (TOUCHES, 0.0)
    for _ in range(LOOKS):
        root = _first_root(dd, du, uu, r2)
        if root < 0.0 or now + root > span:
            return NEVER, 0.0
        now += root
        if pull == 0.0 or root <= LAST_BIT * span:
            break
        half = 0.5 * now
        px, py, pz = dx + now * (ux + half * ax), dy + now * (uy + half * ay), dz + now * (uz + half * az)
        qx, qy, qz = ux + now * ax, uy + now * ay, uz + now * az
        dd, du, uu = px * px + py * py + pz * pz, px * qx + py * qy + pz * qz, qx * qx + qy * qy + qz * qz
        if dd <= r2 * (1.0 + CLOSE):
            break
    return (MEETS, begin + now) if -du > slow else (TOUCHES, 0.0)


@compiled
def roll_back(state, ints, extra, clock, when):
    """Put a granule where it was at a time of the step on its last piece of way."""
    s = when - extra[of.LEG_BEGIN]
    state[at.X] = extra[of.LEG_X] + s * (extra[of.LEG_VX] + 0.5 * s * extra[of.LEG_AX])
    state[at.Y] = extra[of.LEG_Y] + s * (extra[of.LEG_VY] + 0.5 * s * extra[of.LEG_AY])
    extra[of.Z] = extra[of.LEG_Z] + s * (extra[of.LEG_VZ] + 0.5 * s * extra[of.LEG_AZ])
    state[at.VX] = extra[of.LEG_VX] + s * extra[of.LEG_AX]
    state[at.VY] = extra[of.LEG_VY] + s * extra[of.LEG_AY]
    extra[of.VZ] = extra[of.LEG_VZ] + s * extra[of.LEG_AZ]
    extra[of.WX], extra[of.WY], state[at.SPIN] = extra[of.LEG_WX], extra[of.LEG_WY], extra[of.LEG_WZ]
    span = extra[of.LEG_END] - extra[of.LEG_BEGIN]
    kept = s / span if span > 0.0 else 0.0
    state[at.GAIN_X] = extra[of.LEG_GAIN_X] + kept * (state[at.GAIN_X] - extra[of.LEG_GAIN_X])
    state[at.GAIN_Y] = extra[of.LEG_GAIN_Y] + kept * (state[at.GAIN_Y] - extra[of.LEG_GAIN_Y])
    state[at.T] = clock[of.NOW] + when
    ints[at.FATE], ints[at.LINE] = at.FLYING, -1
    extra[of.ROOM] = 0.0


@compiled
def reach_of(this, other):
    """The distance (m) between centres at which two granules of random orientation meet: the radius of their mean
    section (``laws.flake``), of two balls the sum of their radii.
    """
    return math.sqrt(this[at.SECTION] + other[at.SECTION] + 2.0 * this[at.GIRTH] * other[at.GIRTH])


@called
def room_between(colliding, depth, i, j):
    """The room between the surfaces of i and j where they are now (m, negative: they overlap), and the unit normal from
    j to i.
    """
    dx, dy = (
        colliding.states[i, at.X] - colliding.states[j, at.X],
        colliding.states[i, at.Y] - colliding.states[j, at.Y],
    )
    dz = across(colliding.extra[i, of.Z] - colliding.extra[j, of.Z], depth)
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    room = d - reach_of(colliding.grains[i], colliding.grains[j])
    if d > 0.0:
        return room, dx / d, dy / d, dz / d
    return room, 0.0, 1.0, 0.0


@compiled
def _receive(state, ints, extra, grain, rules, mass, j, torque, normal, centre, draws):
    """What the impulse j (N s), with n x j = ``torque`` and the part ``normal``, does to a granule of inverse ``mass``:
    velocity and spin. A flake's spin is drawn by what it has lost seen from the ``centre`` of mass; where the contact
    lasts (``draws`` 0) it keeps it.
    """
    sx, sy, sz = state[at.VX] - centre[0], state[at.VY] - centre[1], extra[of.VZ] - centre[2]
    freed = sx * sx + sy * sy + sz * sz
    sx, sy, sz = sx + mass * j[0], sy + mass * j[1], sz + mass * j[2]
    freed -= sx * sx + sy * sy + sz * sz
    state[at.VX] += mass * j[0]
    state[at.VY] += mass * j[1]
    extra[of.VZ] += mass * j[2]
    extra[of.DRAG] = 0.0
    if grain[at.TOSS] == 0.0:
        turn = abs(mass) * grain[at.BLOW] / grain[at.RADIUS]
        extra[of.WX] -= turn * torque[0]
        extra[of.WY] -= turn * torque[1]
        state[at.SPIN] -= turn * torque[2]
    elif draws != 0.0:
        xi, _ = random_normals(ints, rules)
        size = abs(mass)
        state[at.SPIN] = spin_flung(state[at.SPIN], grain[at.TOSS], size * normal, size * torque[2], freed, xi)


@called
def collide(colliding, laws, rules, depth, i, j, rebounds):
    """The collision of i and j where they are now; ``rebounds`` 0: contact that lasts, without. Returns whether they
    approached. A tracer takes the other for a wall.
    """
    this, other, state, its = colliding.extra[i], colliding.extra[j], colliding.states[i], colliding.states[j]
    first, second = colliding.grains[i], colliding.grains[j]
    _, nx, ny, nz = room_between(colliding, depth, i, j)
    q1, q2 = first[at.BLOW], second[at.BLOW]
    arm1, arm2 = (first[at.RADIUS] if q1 > 0.0 else 0.0), (second[at.RADIUS] if q2 > 0.0 else 0.0)
    light = this[of.LIGHT]
    heavy = 0.0 if colliding.tally[i, of.TRACER] == 1 else other[of.LIGHT]
    a, b = colliding.tally[i, of.FRACTION], colliding.tally[j, of.FRACTION]
    ux, uy, uz = state[at.VX] - its[at.VX], state[at.VY] - its[at.VY], this[of.VZ] - other[of.VZ]
    jx, jy, jz, jn = pair_law(
        ux, uy, uz, arm1 * this[of.WX] + arm2 * other[of.WX], arm1 * this[of.WY] + arm2 * other[of.WY],
        arm1 * state[at.SPIN] + arm2 * its[at.SPIN], nx, ny, nz, light, heavy, q1, q2,
        rebounds * laws.restitution[a, b], laws.friction[a, b], laws.tangential[a, b],
    )  # fmt: skip
    if jn <= 0.0:
        return False
    torque = ny * jz - nz * jy, nz * jx - nx * jz, nx * jy - ny * jx
    share = heavy / (light + heavy)
    centre = its[at.VX] + share * ux, its[at.VY] + share * uy, other[of.VZ] + share * uz
    _receive(state, colliding.counts[i], this, first, rules, light, (jx, jy, jz), torque, jn, centre, rebounds)
    _receive(its, colliding.counts[j], other, second, rules, -heavy, (jx, jy, jz), torque, jn, centre, rebounds)
    return True


@called
def part(colliding, depth, i, j):
    """Push two granules that overlap apart, each by the other's share of their mass."""
    this, other, state, its = colliding.extra[i], colliding.extra[j], colliding.states[i], colliding.states[j]
    room, nx, ny, nz = room_between(colliding, depth, i, j)
    deep = -room
    if deep <= 0.0:
        return
    share = this[of.LIGHT] / (this[of.LIGHT] + other[of.LIGHT])
    state[at.X] += share * deep * nx
    state[at.Y] += share * deep * ny
    this[of.Z] += share * deep * nz
    its[at.X] -= (1.0 - share) * deep * nx
    its[at.Y] -= (1.0 - share) * deep * ny
    other[of.Z] -= (1.0 - share) * deep * nz
    this[of.ROOM] -= deep
    other[of.ROOM] -= deep


@called
def hit_tracer(colliding, tables, i, j, rules):
    """Whether a tracer i on the way to a granule j meets it: it does with the probability of impaction."""
    state, its, grain = colliding.states[i], colliding.states[j], colliding.grains[i]
    ux, uy = state[at.VX] - its[at.VX], state[at.VY] - its[at.VY]
    uz = colliding.extra[i, of.VZ] - colliding.extra[j, of.VZ]
    uu = ux * ux + uy * uy + uz * uz
    rate = drag_rate(grain, tables[colliding.table_of[i]], uu)
    if rate <= 0.0:
        return True
    xi, eta = random_normals(colliding.counts[i], rules)
    uniform = math.exp(-0.5 * (xi * xi + eta * eta))  # of two normal numbers (Box & Muller)
    other = colliding.grains[j]
    return uniform < _caught(math.sqrt(uu) / (rate * 2.0 * other[at.RADIUS]), math.sqrt(other[at.REYNOLDS2] * uu))
