"""The air velocity that a granule sees beyond the mean field: eddies (a Langevin process) and molecules' kicks.

Time is cut into intervals of noise. Over one, the fluctuation is held: the deviation at the granule's place, linear in
a triangle, times a number drawn where the interval begins. So the air stays affine in a triangle, and steps keep their
order and may be cut anywhere. How long an interval is depends on the place alone, and changes slowly from place to
place (``pack_surroundings.evenness``): an interval that ended where its own number led, or leapt to other turbulence,
would gather granules in calm air. Draws are numbered by seed, granule and interval: they depend on nothing else.
"""

from __future__ import annotations

import math

from ...laws import turbulence
from ...laws.random_numbers import normal_pair
from . import layout as at
from .air import drag_rate, mesh_velocity
from .jit import compiled
from .locate import barycentric, on_edge
from .nodes import look_at

_crossing = compiled(turbulence.crossing_times)
_held = compiled(turbulence.held)
_normals = compiled(normal_pair)
# An interval of noise is ``rules.noise`` of the time in which the fluctuation may carry the granule elsewhere: of the
# eddies' lifetime as it sees them and its own response time, but at most of so many lifetimes
LONGEST = 5.0
MIN_INTERVALS = 64  # of a flight
EARLY = 1e-6  # of a beat: round-off
PASSAGE = 0.02  # of the time air or granule need for a body's length: an interval of Brownian motion
# Of that: the least interval of eddies, but for where these are uneven; and of those that are briefer since it slips
BRIEFEST, CROSSED = 0.05, 0.25


@compiled
def random_normals(ints, rules):
    """The next two random numbers of the granule's stream."""
    ints[at.DRAWS] += 1
    return _normals(rules.seed, ints[at.STREAM], ints[at.DRAWS])


@compiled
def _interval_normals(ints, grain, rules):
    """The two numbers of an interval; of one that lasts as long as two, the sum of theirs: one Brownian path."""
    xi, eta = random_normals(ints, rules)
    if rules.noises > 1:
        later = 2 if grain[at.DISPERSION] != 0.0 and grain[at.DIFFUSIVITY] != 0.0 else 1  # two numbers an interval
        a, b = _normals(rules.seed, ints[at.STREAM], ints[at.DRAWS] + later)
        xi, eta = math.sqrt(0.5) * (xi + a), math.sqrt(0.5) * (eta + b)
    return xi, eta


@compiled
def _on_beat(span, rest, beat):
    """The least interval that is no shorter than ``span`` and ends ``rest`` from now, or whole beats later."""
    if beat == 0.0:
        return span
    return rest + beat * max(0.0, math.ceil((span - rest) / beat - EARLY))


@compiled
def _eddies(state, ints, grain, table, rules, seen, passage, rest, beat):
    """Renew the fluctuation for an interval, and return its length; ``passage`` (s): see PASSAGE.

    The fluctuation over the deviation s = sqrt(2 k / 3) obeys  dw = (-w / T_i + grad s / (1 + St)) dt + sqrt(2 / T_i)
    dW, T_i along and across the slip: what keeps tracers well mixed (Thomson 1987, J. Fluid Mech. 180, 529; for
    granules with inertia Bocksell & Loth 2006, Int. J. Multiphase Flow 32, 1234). Flight, half of the drift, renewal,
    half of the drift, flight: second order, and tracers' flight in a lasting eddy is exact where s is linear.
    """
    ux, uy, life, rms, sx, sy, even = seen
    wx, wy = rms * state[at.MEAN_X], rms * state[at.MEAN_Y]
    ex, ey = ux - state[at.VX], uy - state[at.VY]
    rate = drag_rate(grain, table, (ex + wx) ** 2 + (ey + wy) ** 2)
    stokes = life * rate
    drift = stokes / (1.0 + stokes) if stokes < 1e100 else 1.0  # 1 / (1 + St), St = 1 / (rate x lifetime)
    # Eddies are crossed by the mean slip. Of the fluctuation that it sees a granule has this part in the mean, and
    # spreads about it by this variance (Tchen): what is left of its slip is no crossing
    ex, ey = ex + drift * wx, ey + drift * wy
    slip2 = ex * ex + ey * ey
    slip = math.sqrt(max(0.0, slip2 - 2.0 * rms * rms * drift * (1.0 - drift)))
    ex, ey = (ex / math.sqrt(slip2), ey / math.sqrt(slip2)) if slip > 0.0 else (1.0, 0.0)
    along, across = _crossing(life, slip, rms)
    brief = min(along, across)
    least = max(BRIEFEST * passage, min(CROSSED * passage, rules.noise * life))
    span = max(rules.noise * min(brief + (1.0 / rate if rate > 0.0 else math.inf), LONGEST * brief), least)
    if drift > 0.0:
        span = min(span, rules.noise * even / drift)
    born = ints[at.DRAWS] == 0
    if born:  # the process is stationary, its first interval under way: a random part of it is left
        state[at.SEEN_X], state[at.SEEN_Y] = random_normals(ints, rules)
        xi, eta = random_normals(ints, rules)
        span *= math.exp(-0.5 * (xi * xi + eta * eta))
    span = _on_beat(span, rest, beat)
    xi, eta = _interval_normals(ints, grain, rules)
    px = py = mx = my = 0.0
    for side in range(2):
        dx, dy, draw = (ex, ey, xi) if side == 0 else (-ey, ex, eta)
        stays, fresh, size = _held(span / max(along if side == 0 else across, 1e-300))
        w = dx * state[at.SEEN_X] + dy * state[at.SEEN_Y]
        if not born:
            lean = 0.5 * size * drift * span * (dx * sx + dy * sy)
            w = stays * (w + lean) + fresh * draw + lean
        px, py, mx, my = px + w * dx, py + w * dy, mx + size * w * dx, my + size * w * dy
    state[at.SEEN_X], state[at.SEEN_Y], state[at.MEAN_X], state[at.MEAN_Y] = px, py, mx, my
    return span


@compiled
def renew(state, ints, affine, air, grain, table, rules):
    """Begin an interval of noise at the granule's clock: draw what it sees until the next."""
    tri, x, y = ints[at.TRI], state[at.X], state[at.Y]
    if ints[at.GAP] >= 0:
        tri = air.covered[ints[at.GAP], at.COVER_TRI]
        x, y, _ = on_edge(air, ints[at.GAP], x, y)
    look = look_at(ints, affine, air, grain, tri, x, y, state[at.T])
    renew_at(look, tri, x, y, state, ints, air, grain, table, rules)


@compiled
def renew_at(look, tri, x, y, state, ints, air, grain, table, rules):
    """Begin an interval of noise in air that was looked at there, in triangle ``tri``."""
    ux, uy, wind, even = look.ux, look.uy, max(abs(look.ux), abs(look.uy)), 0.0
    if grain[at.DISPERSION] != 0.0:
        for k in range(3):
            even += barycentric(air.geometry, tri, k, x, y) * air.even[air.corners[tri, k]]
    if air.swing[at.SWING_OMEGA] != 0.0:
        wx, wy, _, _ = mesh_velocity(air.swing, at.SWING_X, state[at.T])
        ux, uy = ux - wx, uy - wy
    renew_in(state, ints, grain, table, rules, wind, (ux, uy, look.life, look.rms, look.sx, look.sy, even), 0.0, 0.0)


@compiled
def renew_in(state, ints, grain, table, rules, wind, seen, rest, beat):
    """Begin an interval of noise where the air's speed is about ``wind`` (m/s); ``seen``: the air's mean velocity (m/s,
    seen from the mesh), the eddies' lifetime (s), their deviation (m/s) and its gradient (1/s), and how even they are
    (s). For those that share a clock the interval ends ``rest`` (s) from now, with a step, or whole steps (``beat``, s;
    0: none) later.
    """
    speed = max(math.sqrt(state[at.VX] ** 2 + state[at.VY] ** 2), wind)
    span = (rules.until - state[at.BORN]) / MIN_INTERVALS
    if speed > 0.0:
        span = min(span, PASSAGE * rules.length / speed)
    if grain[at.DISPERSION] != 0.0:
        span = _eddies(state, ints, grain, table, rules, seen, span, rest, beat)
    else:
        span = _on_beat(span, rest, beat)
    if grain[at.DIFFUSIVITY] != 0.0:
        size = math.sqrt(2.0 * grain[at.DIFFUSIVITY] / span)
        xi, eta = _interval_normals(ints, grain, rules)
        state[at.KICK_X], state[at.KICK_Y] = size * xi, size * eta
    if rules.noises > 1:  # on to the next two intervals
        ints[at.DRAWS] += 2 if grain[at.DISPERSION] != 0.0 and grain[at.DIFFUSIVITY] != 0.0 else 1
    state[at.T_NOISE] = state[at.T] + span
    ints[at.FRESH] = 0


@compiled
def mirror(state, ints, nx, ny):
    """Turn round the fluctuations into a wall with outward normal n: no eddy blows through it."""
    for slot in (at.MEAN_X, at.SEEN_X, at.KICK_X):
        into = nx * state[slot] + ny * state[slot + 1]
        if into < 0.0:
            state[slot] -= 2.0 * into * nx
            state[slot + 1] -= 2.0 * into * ny
            ints[at.FRESH] = 0
