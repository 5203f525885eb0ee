"""Rows of walls and places of birth: vibration, slopes, restitution, walls touched at birth, lines that touch."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.extremes.flying import TOLERANCE, against_answer, timed_flight, what_happened
from proofs.extremes.matrix import Happened, add_row
from proofs.problems.exact import G, Setting, box, field_on, of_tau
from proofs.problems.flights import two_modes
from support import without_slip
from wakeflow.flight import Body, Fate, Granules, Motion

Array = NDArray[np.float64]
RADIUS = 1e-3  # m
FREQUENCY = 30.0  # Hz, of the table
SCAN = 500  # looks a period for the moment at which a ball meets the table
FLOOR = np.array([[-9.0, -0.5], [9.0, -0.5], [9.0, 0.0], [-9.0, 0.0]])  # m, its top is y = 0
VACUUM: dict[str, Any] = {"forces": ("gravity",), "length": 1.0}


def _point_masses(position: Any, velocity: Any, restitution: float, friction: float) -> Granules:
    return without_slip(position, velocity, 2 * RADIUS, 1000.0, restitution=restitution, friction=friction)


# -- vibration ---------------------------------------------------------------------------------------------------------


def _on_a_table(gamma: float) -> Happened:
    """A ball of no restitution on a table that shakes: thrown, caught, held, thrown again."""
    omega, until = 2 * math.pi * FREQUENCY, 2.0
    size = gamma * G / omega**2
    ball = _point_masses([[0.0, RADIUS]], [[0.0, size * omega]], 0.0, 0.0)  # moves with the table, which rises
    table = Body(FLOOR, motion=Motion((0.0, size), FREQUENCY))
    height = RADIUS + _thrown_and_caught(size, omega, until)
    return against_answer(Setting(None, ball, until, VACUUM | {"bodies": (table,)}), np.array([[0.0, height]]))


def _thrown_and_caught(size: float, omega: float, until: float) -> float:
    """Height (m) above the table's middle at ``until`` (s), from one event to the next."""
    from scipy.optimize import brentq

    t = 0.0
    while True:
        lift = math.asin(1.0 / (size * omega**2 / G))  # where the table falls away faster than g
        phase = omega * t % (2 * math.pi)
        if not lift - 1e-12 <= phase <= math.pi - lift:  # held until then
            t += ((lift - phase) % (2 * math.pi)) / omega
        if t >= until:
            return size * math.sin(omega * until)
        y, v, born = size * math.sin(omega * t), size * omega * math.cos(omega * t), t

        def above(s: float, y: float = y, v: float = v, born: float = born) -> float:
            return y + v * (s - born) - 0.5 * G * (s - born) ** 2 - size * math.sin(omega * s)

        step = 2 * math.pi / omega / SCAN
        looks = born + step * np.arange(2, int((until - born) / step) + 2)
        below = np.flatnonzero(np.array([above(s) for s in looks]) < 0.0)
        if not len(below) or (looks[below[0]] > until and above(until) > 0.0):
            return size * math.sin(omega * until) + above(until)
        t = float(brentq(above, looks[below[0]] - step, looks[below[0]], xtol=1e-15))


for _gamma in (1.001, 10.0, 50.0):
    add_row("Gamma", f"{_gamma:g}, a ball of no restitution", partial(_on_a_table, _gamma),
         "parabolas from event to event, roots by scipy")  # fmt: skip


# -- slopes ------------------------------------------------------------------------------------------------------------


def _on_a_slope(degrees: float, friction: float = 0.3) -> Happened:
    """Thrown at a slope without restitution, it slides: eq. (2), then gravity less friction, until it stops."""
    b, gap, until = math.radians(degrees), 0.02, 0.25
    along, out = np.array([math.cos(b), -math.sin(b)]), np.array([math.sin(b), math.cos(b)])
    slope = Body(np.stack([20 * along, -20 * along]), open=True)  # solid below
    ball = _point_masses([(RADIUS + gap) * out], [0.2 * along - 0.5 * out], 0.0, friction)
    down, press = G * math.sin(b), G * math.cos(b)
    into = math.sqrt(0.25 + 2 * press * gap)
    hit = (into - 0.5) / press
    slip = max(0.0, 0.2 + down * hit - friction * into)
    pull, left = down - friction * press, until - hit
    left = min(left, -slip / pull) if pull < 0.0 else left
    place = 0.2 * hit + 0.5 * down * hit**2 + slip * left + 0.5 * pull * left**2
    end = RADIUS * out + place * along
    return against_answer(Setting(None, ball, until, VACUUM | {"bodies": (slope,)}), end[None])


for _degrees in (0.0, 0.01, 45.0, 89.0):
    add_row("slope", f"{_degrees:g} deg", partial(_on_a_slope, _degrees), "eq. (2) and uniform acceleration")


def _touching(degrees: float, friction: float) -> Happened:
    """Born at rest, its surface on a slope's: it slides, or lies where friction holds it."""
    b, until = math.radians(degrees), 0.3
    along, out = np.array([math.cos(b), -math.sin(b)]), np.array([math.sin(b), math.cos(b)])
    slope = Body(np.stack([20 * along, -20 * along]), open=True)
    ball = _point_masses([RADIUS * out], [[0.0, 0.0]], 0.5, friction)
    way = 0.5 * G * max(0.0, math.sin(b) - friction * math.cos(b)) * until**2
    return against_answer(Setting(None, ball, until, VACUUM | {"bodies": (slope,)}), (RADIUS * out + way * along)[None])


# -- restitution -------------------------------------------------------------------------------------------------------


def _dropped(restitution: float) -> Happened:
    """Dropped on a floor, again and again; where it is after 3 s, or where it rests."""
    height, until = 0.3, 3.0
    ball = _point_masses([[0.0, RADIUS + height]], [[0.0, 0.0]], restitution, 0.3)
    y = 0.0
    if restitution == 1.0:
        fall = math.sqrt(2 * height / G)
        away = (until + fall) % (2 * fall) - fall  # from the last time at the top
        y = height - 0.5 * G * away**2
    setting = Setting(None, ball, until, VACUUM | {"bodies": (Body(FLOOR),)})
    return against_answer(setting, np.array([[0.0, RADIUS + y]]))


for _restitution in (0.0, 1.0):
    add_row("restitution", f"{_restitution:g}", partial(_dropped, _restitution), "parabolas")


def _for_ever() -> Happened:
    """Elastic, from 10 um: it would bounce for ever, and is stopped at the most impacts that a track may have."""
    ball = _point_masses([[0.0, RADIUS + 1e-5]], [[0.0, 0.0]], 1.0, 0.0)
    tracks, seconds = timed_flight(None, ball, until=1e4, bodies=[Body(FLOOR)], **VACUUM)
    return what_happened(tracks, seconds, None, f"{tracks.impacts[0]} impacts")


add_row(
    "restitution", "1, for 1e4 s", _for_ever, stops="an elastic ball bounces for ever; a track may have 5000 impacts"
)


# -- places of birth ---------------------------------------------------------------------------------------------------

for _degrees, _friction, _what in (
    (0.0, 0.0, "no friction"), (30.0, 0.1, "slides"), (30.0, 0.6, "is held"), (89.0, 0.3, "slides"),
):  # fmt: skip
    add_row("born on a wall", f"slope of {_degrees:g} deg, {_what}", partial(_touching, _degrees, _friction),
         "uniform acceleration")  # fmt: skip


def _overlapping() -> Happened:
    """Reaching into the floor by half of its radius: pushed out, and it lies there."""
    ball = _point_masses([[0.0, 0.5 * RADIUS]], [[0.0, 0.0]], 0.0, 0.3)
    return against_answer(Setting(None, ball, 0.5, VACUUM | {"bodies": (Body(FLOOR),)}), np.array([[0.0, RADIUS]]))


def _inside() -> Happened:
    """Born inside a body: stopped where it is, at once."""
    tracks, seconds = timed_flight(None, _point_masses([[0.0, -0.2]], [[0.0, 0.0]], 0.5, 0.3), until=1.0,
                            bodies=[Body(FLOOR)], **VACUUM)  # fmt: skip
    return what_happened(tracks, seconds, float(np.linalg.norm(tracks.position - [0.0, -0.2])) / TOLERANCE)


def _outside() -> Happened:
    """Born outside the mesh: it escapes with no step."""
    tracks, seconds = timed_flight(field_on(box(2), np.zeros_like), of_tau(0.1, [[3.0, 0.0]], [[-1.0, 0.0]]), until=1.0)
    left = tracks.fate[0] == Fate.ESCAPED and tracks.steps[0] == 0
    return what_happened(tracks, seconds, 0.0 if left else 1.0)


def _on_corners() -> Happened:
    """Born on every node inside the mesh and in the middle of every edge of its triangles, in air that turns."""
    omega, until, tau = 5.0, 0.1, 1e-3
    points, cells = box(6)
    nodes = points[(np.abs(points) < 0.6).all(axis=1)]
    middles = 0.5 * (points[cells] + points[np.roll(cells, 1, axis=1)]).reshape(-1, 2)
    start = np.concatenate([nodes, middles[(np.abs(middles) < 0.6).all(axis=1)]])
    z = start[:, 0] + 1j * start[:, 1]
    end, _ = two_modes(1j * omega, np.full(len(z), tau), z, 1j * omega * z, until)
    speed = omega * np.stack([-start[:, 1], start[:, 0]], axis=1)
    field = field_on((points, cells), lambda p: omega * np.stack([-p[:, 1], p[:, 0]], axis=1))
    setting = Setting(field, of_tau(tau, start, speed), until, {"forces": ("drag",), "drag": "stokes"})
    return against_answer(setting, np.stack([end.real, end.imag], axis=1))


add_row("born on a wall", "half inside it", _overlapping, "pushed out, it lies on the floor")
add_row("born", "inside a body", _inside, "where it was born", stops="born inside a body")
add_row("born", "outside the mesh", _outside, "escapes without a step", unit="granules", allowed=0.0)
add_row("born", "on nodes and edges of the mesh", _on_corners, "closed form")


# -- lines that touch --------------------------------------------------------------------------------------------------


def _between_bins() -> Happened:
    """Three lines that touch; granules fall on the ends that they share and a nanometre beside: each into one bin."""
    ends = np.array([-0.1, 0.0, 0.1, 0.2])
    lines = [np.array([[a, 0.0], [b, 0.0]]) for a, b in pairwise(ends)]
    x = (np.array([[0.0], [0.1]]) + np.array([-1e-9, 0.0, 1e-9])).ravel()
    ball = _point_masses(np.stack([x, np.full(len(x), 0.3)], axis=1), np.zeros((len(x), 2)), 0.5, 0.3)
    tracks, seconds = timed_flight(None, ball, until=5.0, lines=lines, **VACUUM)
    low, high = (np.searchsorted(ends, x, side=side) - 1 for side in ("left", "right"))
    known = (tracks.fate == Fate.BINNED) & ((tracks.line == low) | (tracks.line == high))
    return what_happened(tracks, seconds, float(np.mean(~known)))


add_row("bins", "ends that touch", _between_bins, "one of the two bins at that place", unit="granules", allowed=0.0)


# -- how many ----------------------------------------------------------------------------------------------------------


def _many(count: int) -> Happened:
    """Thrown by chance into a stream, with linear drag: every one of them beside its closed form."""
    rng, until, tau = np.random.default_rng(0), 0.2, 0.05
    start, speed = rng.uniform(-0.2, 0.2, (count, 2)), rng.normal(0.0, 0.5, (count, 2))
    air, down = np.array([0.3, -0.2]), np.array([0.0, -G])
    gone = tau * -math.expm1(-until / tau)
    final = air + tau * down
    end = start + final * until + (speed - final) * gone
    mesh = box(6)
    field = field_on(mesh, np.tile(air, (len(mesh[0]), 1)))
    return against_answer(Setting(field, of_tau(tau, start, speed), until, {"drag": "stokes"}), end)


add_row("granules", "1", partial(_many, 1), "closed form")
add_row("granules", "1e5", partial(_many, 100_000), "closed form, every granule")
add_row("granules", "1e7", partial(_many, 10_000_000), "closed form, every granule", slow=True)
