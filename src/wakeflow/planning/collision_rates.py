"""How often granules of a fed stream meet each other, and what that does to them: estimates before anything is flown.

Kinetic theory of two streams: a granule i meets n_j sigma v_rel granules of fraction j in a second, where sigma is
the mean section of two bodies of random orientation (laws/flake.py) and n_j the number in a volume. Four ways of
meeting count: granules of one fraction overtake those of another on their fall; one that leaves the body crosses the
curtain that still falls; one that falls passes through those that leave; and those that slide and hop down a slope meet
in the layer that they are there. Only partners as heavy or heavier turn a granule out of its way: each counts with the
share 2 m_j / (m_i + m_j), one at most.

The wake of a body in upward air is above it, where the feed is, and shelters what falls: the air in it flows up as much
as down, and light fractions that fall faster than it recirculates come down with the heavy ones, as through air at
rest, and leave the body with them before the air beside it takes them away.
docs/model.md sets the numbers beside those counted in slabs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import edges, normals
from ..laws.flake import section
from ..laws.forces import FlightScales
from ..laws.restitution import restitution_at
from ..scene import Fraction, Scene
from ..scene.fraction import COEFFICIENTS
from .terms import COLLISIONS, bounds
from .uniform_fall import FallRoom, UniformFall

Array = NDArray[np.float64]
SIZES = (1 / 6, 1 / 2, 5 / 6)  # mass quantiles whose falls represent a fraction's, a third of its mass each
RARE = 0.05  # of the granules rebound beyond what a throw is taken for
MIN_FALL_SPEED = (
    0.1  # m/s: the slowest fall that is believed of a curtain, which would be infinitely dense at rest; chosen
)
LEVEL = 1e-9  # upward part of a unit normal below which a face does not look up: round-off
MAX_STREAMS = 25  # fractions whose meetings are estimated pair by pair: of 25 they take half a second
STEPS = 400  # of a fall in a vacuum
ENTRIES, PLACES = 24, 96  # on a slope, of the sums over where granules came down and where they meet
SHELTER = 3.0  # body widths from y = 0: a closed wake is at least as long; chosen
RECIRCULATION = 0.2  # of the air speed U: how fast air that granules fall into leaves the wake; chosen
CALM = 1e-3  # of the air speed: the wake's mean, zero but for round-off
MAX_STAY = 1.0  # s: the longest that a granule is taken to lie in the curtain's way where nothing moves it out; chosen


@dataclass(frozen=True)
class Encounters:
    """What a granule of one fraction meets on its flight: how many granules of each fraction (``by`` its name),
    ``heavier`` those as heavy or heavier, lighter ones by their share, and ``knock`` (m/s), the change of velocity that
    one of these brings at most, mean over them.
    """

    by: Mapping[str, float]
    heavier: float
    knock: float

    @property
    def number(self) -> float:
        """Number of granules in all."""
        return sum(self.by.values())


class _Fall(NamedTuple):
    """A granule's fall from the feed to the body, or through a channel without one."""

    time: Array  # s
    way: Array  # m, downward
    speed: Array  # m/s, downward


class _Slope(NamedTuple):
    """How a fraction goes down a face that looks up: horizontal speeds, as the curtain's width is."""

    within: float  # m, width of the curtain over the face
    beyond: float  # m, from there to the face's end
    start: float  # m/s, speed after the impact
    pull: float  # m/s2, of gravity less friction
    shaken: float  # m/s, rms of the start by the body's vibration
    hop: float  # m/s, rebound off the face
    high: float  # m, how high that is

    def speed(self, way: Array) -> Array:
        """Speed after a ``way`` (m) on the face."""
        return np.sqrt(self.start**2 + 2.0 * self.pull * np.maximum(way, 0.0))


NO_SLOPE = _Slope(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Stream:
    """One fraction in the feed."""

    mass: float  # kg, of the median granule
    diameter: float  # m
    section: float  # m2, mean area of its projections over pi
    girth: float  # m, mean perimeter of its projections over 2 pi
    flux: float  # 1/(m2 s), of granules in the curtain about one of them
    falls: tuple[_Fall, ...]
    arrival: float  # m/s at the body, of the median granule; 0 where it does not come there
    thrown: float  # m/s, sideways speed with which it leaves the body
    crossing: float  # s, for which it is in the curtain's way after that
    slope: _Slope  # how it goes down the first body's faces, NO_SLOPE where none comes there


def encounters(scene: Scene, laws: Mapping[str, tuple[str, float]]) -> dict[str, Encounters]:
    """The meetings of every fraction at the scene's feed rate; ``laws``: its drag law and the factor on it.

    They grow in proportion to the rate. Granules fall alone, one-dimensional, through the channel's uniform air. Of
    more than MAX_STREAMS fractions those that come down alike meet others alike: one of them tells for all.
    """
    streams = {name: _stream(scene, name, *laws[name]) for name in scene.fraction}
    known_by = _known_by(streams)
    pairs = product(dict.fromkeys(known_by.values()), repeat=2)
    ways = {(first, second): tuple(_ways(streams[first], streams[second])) for first, second in pairs}
    bounce = 1.0 + scene.collisions.restitution
    rates = {}
    for name, stream in streams.items():
        by, heavier, knocks = dict.fromkeys(streams, 0.0), 0.0, 0.0
        for partner, other in streams.items():
            share = other.mass / (stream.mass + other.mass)
            alike = known_by[partner]
            part = 1.0 if alike == partner else other.flux / streams[alike].flux
            for meetings, closing in ways[known_by[name], alike]:
                by[partner] += part * meetings
                weighed = part * meetings * min(1.0, 2.0 * share)
                heavier += weighed
                knocks += weighed * bounce * share * closing
        rates[name] = Encounters(by, heavier, knocks / heavier if heavier > 0.0 else 0.0)
    return rates


def _known_by(streams: Mapping[str, _Stream]) -> dict[str, str]:
    """The fraction that tells for each: itself, or of more than MAX_STREAMS one that is like it, first by how fast it
    comes down, then by its size.
    """
    if len(streams) <= MAX_STREAMS:
        return {name: name for name in streams}
    side = math.isqrt(MAX_STREAMS)
    known_by: dict[str, str] = {}
    for rows in np.array_split(sorted(streams, key=lambda name: float(streams[name].falls[-1].speed[-1])), side):
        for group in np.array_split(sorted(rows.tolist(), key=lambda name: streams[name].diameter), side):
            if len(group):
                known_by |= dict.fromkeys(group.tolist(), str(group[len(group) // 2]))
    return known_by


def shifted(scene: Scene, met: Encounters, scales: Sequence[FlightScales]) -> float:
    """Landing shift (body widths) by meetings, at most: the largest over the ``scales`` of a fraction's flight, nothing
    in a vacuum, where a kick lasts for a fall to the floor. The mean over the granules: most may meet none.
    """
    if scales:
        return max(bounds[COLLISIONS].shift(flight) for flight in scales)
    fall = math.sqrt(2.0 * scene.drop / scene.gravity)
    return min(1.0, met.heavier) * met.knock * fall / scene.width


def _ways(stream: _Stream, other: _Stream) -> Iterator[tuple[float, float]]:
    """(number of meetings of a granule, closing speed in m/s) of every way in which two fractions meet."""
    sigma = math.pi * (stream.section + other.section + 2.0 * stream.girth * other.girth)
    pairs = [_overtaking(fall, crossed) for fall in stream.falls for crossed in other.falls]
    met, closing = np.mean(pairs, axis=0).tolist()
    yield sigma * other.flux * met, closing / met if met > 0.0 else 0.0
    if stream.crossing > 0.0 and other.arrival > 0.0:
        closing = math.hypot(stream.thrown, other.arrival)
        yield sigma * other.flux / max(other.arrival, MIN_FALL_SPEED) * closing * stream.crossing, closing
    if other.crossing > 0.0 and stream.arrival > 0.0:
        closing = math.hypot(other.thrown, stream.arrival)
        yield sigma * other.flux * other.crossing * closing / max(stream.arrival, MIN_FALL_SPEED), closing
    if stream.slope.within and other.slope.within:
        thick = max(stream.slope.high, other.slope.high, sigma / (stream.diameter + other.diameter))
        met, closing = _side_by_side(stream.slope, other.slope)
        yield sigma / thick * other.flux * met, closing


def _side_by_side(slope: _Slope, partner: _Slope) -> tuple[float, float]:
    """Meetings of ``slope`` with ``partner`` in the layer on a face, per flux and width of what sweeps it (m s); the
    mean closing speed (m/s).

    Both come down evenly over the curtain's width. Where ``slope`` passes a place, those of ``partner`` that came down
    higher up pass too, at speeds that differ by where they came down, by the body's phase when they did, and by their
    hops.
    """
    came = (np.arange(ENTRIES) + 0.5) / ENTRIES * slope.within
    ends = slope.within + slope.beyond
    width = ends / PLACES
    places = (np.arange(PLACES) + 0.5) * width
    mine, theirs = (np.maximum(layer.speed(places - came[:, None]), MIN_FALL_SPEED) for layer in (slope, partner))
    above = (places > came[:, None]).astype(float)  # (entries, places): who came down higher up than the place
    jitter = slope.shaken**2 + partner.shaken**2 + (slope.hop**2 + partner.hop**2) / 3.0
    closing = np.sqrt((mine[:, None] - theirs[None]) ** 2 + jitter)  # (entries of slope, of partner, places)
    rate = above[:, None] * above[None] * closing / (mine[:, None] * theirs[None]) * width * slope.within / ENTRIES
    met = rate.sum(axis=(1, 2))
    whole = rate.sum()  # 0 where all go at one speed: none meets another
    return float(met.mean()), float((rate * closing).sum() / whole) if whole > 0.0 else 0.0


def _overtaking(fall: _Fall, partner: _Fall) -> tuple[float, float]:
    """int |v1 - v2| / |v2| dt (s) on the way of ``fall`` where ``partner`` falls too, and that times |v1 - v2| (m)."""
    steps = np.diff(fall.time, prepend=fall.time[0])
    down = partner.way[: int(partner.way.argmax()) + 1], partner.speed[: int(partner.way.argmax()) + 1]
    beside = np.interp(fall.way, *down, left=np.nan, right=np.nan)
    closing = np.nan_to_num(np.abs(fall.speed - beside), nan=0.0)
    slow = np.maximum(np.abs(np.nan_to_num(beside, nan=np.inf)), MIN_FALL_SPEED)
    rate = closing / slow
    return float(rate @ steps), float((rate * closing) @ steps)


def _stream(scene: Scene, name: str, law: str, scale: float) -> _Stream:
    fraction, feed = scene.fraction[name], scene.feed
    granule, mass_flow = fraction.properties, feed.mass_flow * scene.mass_shares()[name]
    falls = tuple(_fall(scene, fraction, law, scale, float(d)) for d in fraction.diameters(np.array(SIZES)))
    middle = falls[len(falls) // 2]
    comes = bool(scene.body) and middle.way[-1] >= scene.release[0] * (1.0 - LEVEL)
    arrival = max(float(middle.speed[-1]), scene.feed.fall_speed if scene.air is None else 0.0) if comes else 0.0
    thrown = arrival * ejection_speed(scene, fraction, arrival) if arrival > 0.0 else 0.0
    mass = math.pi / 6.0 * granule.density * granule.diameter**3
    flux = feed.crowding * mass_flow / (mass * feed.width * feed.depth)
    crossing = _crossing(scene, thrown) if arrival > 0.0 else 0.0
    slope = _slope(scene, fraction, arrival, thrown) if arrival > 0.0 else NO_SLOPE
    radius, (area, perimeter) = 0.5 * granule.diameter, section(fraction.shape[None], np.array([fraction.flake]))
    wide = float(area[0]) * radius**2, float(perimeter[0]) * radius
    return _Stream(mass, granule.diameter, *wide, flux, falls, arrival, thrown, crossing, slope)


def _slope(scene: Scene, fraction: Fraction, arrival: float, thrown: float) -> _Slope:
    """How a fraction goes down the first body's faces; NO_SLOPE where the curtain does not fall on them."""
    beta, _ = slope_of(scene)
    half, away = 0.5 * scene.feed.width, abs(scene.feed.position)
    near = max(away - half, 0.0)  # the wider side of the curtain, from the body's middle
    ends = 0.5 * scene.width - near
    within = min(away + half - near, ends)
    if within <= 0.0:
        return NO_SLOPE
    friction = fraction.properties.friction
    pull = scene.gravity * math.cos(beta) * max(math.sin(beta) - friction * math.cos(beta), 0.0)
    shaking = 0.0 if scene.vibration is None else float(np.linalg.norm(scene.vibration.speed)) / math.sqrt(2.0)
    bounce = float(restitution_at(fraction.properties.restitution, arrival * math.cos(beta)))
    hop = bounce * arrival * math.cos(beta)
    high = 0.5 * hop**2 / (scene.gravity * math.cos(beta))
    return _Slope(within, ends - within, thrown, pull, shaking * thrown / arrival, hop, high)


def _fall(scene: Scene, fraction: Fraction, law: str, scale: float, diameter: float) -> _Fall:
    """Fall from the feed to the body; without one to the channel's end."""
    above, speed = scene.release
    down = above if scene.body else scene.drop
    if down <= 0.0:
        return _Fall(np.zeros(1), np.zeros(1), np.array([scene.feed.fall_speed]))
    if scene.air is None:
        whole = (math.sqrt(speed**2 + 2.0 * scene.gravity * down) - speed) / scene.gravity
        time = np.linspace(0.0, whole, STEPS)
        return _Fall(time, speed * time + 0.5 * scene.gravity * time**2, speed + scene.gravity * time)
    fall = UniformFall.of(scene, fraction, law, scale, diameter)
    if _sheltered(scene) and abs(fall.granule.settling) > RECIRCULATION * scene.air.speed:
        fall = UniformFall.of(scene, fraction, law, scale, diameter, part=CALM)
    room = FallRoom(down, max(scene.channel.top - scene.level - above, scene.width)) if scene.body else fall.room
    rows = np.array([(0.0, 0.0, speed), *fall.points(speed, room)])
    return _Fall(*rows.T)


def _sheltered(scene: Scene) -> bool:
    """Whether the curtain falls through the first body's wake, all the way from the feed: in upward air, no wider than
    the body and no higher than its wake is long.
    """
    if not scene.body or scene.air is None or not scene.air.rises or not scene.plumb.upright:
        return False
    high = scene.level + scene.release[0]
    return abs(scene.feed.position) + 0.5 * scene.feed.width <= 0.5 * scene.width and high <= SHELTER * scene.width


def _rows(scene: Scene) -> int:
    """Rows of bodies that a granule comes past one after the other: those at one height, to half a width, are one."""
    heights = np.sort([body.outline()[:, 1].mean() for body in scene.body.values()])
    return 1 + int(np.count_nonzero(np.diff(heights) > 0.5 * scene.width))


def _crossing(scene: Scene, thrown: float) -> float:
    """Seconds for which a granule that leaves a body is in the way of those that fall after it, all bodies together.

    Across half of the curtain, at first ``thrown`` (m/s) sideways and then faster, as one that slides down the slope
    without friction; twice the mean way to the curtain's edge, for those that bounce on the slope more than once. The
    first body parts the curtain: each further row of bodies is met by streams half as dense.
    """
    pull = scene.gravity * 0.5 * math.sin(2.0 * slope_of(scene)[0])
    way = 0.5 * scene.feed.width
    return 0.5 * (1 + _rows(scene)) * min(time_down(way, thrown, pull), MAX_STAY)


def time_down(way: float, speed: float, pull: float) -> float:
    """Seconds for a ``way`` (m) at first with ``speed`` (m/s), under ``pull`` (m/s2); infinite where it ends before."""
    square = speed**2 + 2.0 * pull * way
    if square < 0.0 or speed == square == 0.0:
        return math.inf
    return 2.0 * way / (math.sqrt(square) + speed)


def slope_of(scene: Scene) -> tuple[float, float]:
    """Angle (rad) to gravity of the first body's faces that granules fall on, less a right one, mean over their
    projected width; their length (m) together.
    """
    outline = scene.plumb.seen(scene.outline)
    start, end = edges(outline)
    up = normals(outline)[:, 1] > LEVEL
    across, length = np.abs(end - start)[up, 0], np.linalg.norm(end - start, axis=1)[up]
    beta = np.arccos(np.clip(across / length, 0.0, 1.0))
    return float(np.average(beta, weights=across)), float(length.sum())


def ejection_speed(scene: Scene, fraction: Fraction, arrival: float) -> float:
    """Largest sideways speed after an impact over the fall speed before it: (1 + R) n_y (n_x - f n_y) on any face.

    Of nearly all granules: with a high restitution and a low friction where these spread, on faces that a shape turns
    by twice the rms angle; friction is at most what makes a granule roll.
    """
    granule, ends = fraction.properties, np.array([1.0 - RARE, RARE])
    restitutions, frictions = (fraction.coefficients(name, ends) for name in COEFFICIENTS)
    tilt = 2.0 * granule.rebound_scatter * np.array([[-1.0], [0.0], [1.0]])
    across, up = np.abs(np.concatenate([normals(scene.plumb.seen(body.outline())) for body in scene.body.values()])).T
    slope = np.clip(np.arctan2(across, up) + tilt, 0.0, 0.5 * np.pi)
    across, up = np.sin(slope), np.cos(slope)
    middle = restitution_at(granule.restitution, arrival * up)
    kick = (1.0 + (middle if restitutions is None else restitutions[0])) * up
    slowed = kick * up * (granule.friction if frictions is None else frictions[1])
    if math.isfinite(fraction.inertia):
        slowed = np.minimum(slowed, across * up / (1.0 + 1.0 / fraction.inertia))
    return float(np.maximum(kick * across - slowed, 0.0).max())
