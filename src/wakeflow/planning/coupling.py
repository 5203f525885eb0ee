"""Feed and loading: how dense curtain and layer are, and up to which feed rate one granule does not feel the others.

The tracker flies granules alone through air that does not feel them. Each row of ``limits`` is a number that grows with
the feed rate, the value up to which that holds, and the feed rate at which it is reached.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.graded import Notice, less_sure, void
from ..core.number import Most
from ..core.record import column
from ..laws.collision import impact
from ..laws.forces import FlightScales
from ..scene import Scene
from .collision_rates import Encounters, shifted, slope_of, time_down

Array = NDArray[np.float64]

COUPLING, INDEPENDENT, TURBULENCE = "one-way coupling", "independent granules", "the air's own turbulence"
COLLIDING = 1e-3  # volume fraction above which granules of a suspension collide: "four-way" in Elghobashi 1994
MODULATING = 1e-6  # volume fraction above which granules change the turbulence: "two-way" there
LOADED = 0.1  # of the air's own flow of mass or momentum, and of the slope covered: chosen, what passes as small
MIN_HELD_SPEED = 0.1  # m/s: taken for the speed of granules that the air holds in the curtain; chosen
SHADE = 1.5  # area that a sphere covers, times its diameter, over its volume: (pi d^2 / 4) d / (pi d^3 / 6)
MAX_EXCEEDANCE = 10.0  # limits: beyond, nothing is left of what is taken for granted; chosen
PLACES = 500  # of the curtain, to tell which share of it falls on a body
ELGHOBASHI = "Elghobashi 1994, Appl. Sci. Res. 52, 309"


@dataclass(frozen=True)
class Limit:
    """A number that grows with the feed rate, and the feed rate up to which its assumption holds."""

    name: str = column("", "name of the number")
    about: str = column("", "which assumption it checks")
    value: Most = column("1", "the number; null where it has no bound")
    limit: Most = column("1", "number up to which it holds; null for a scale without limit")
    feed_rate: Most = column("kg/h", "feed that reaches the limit")
    why: str = column("", "what the number is, with its source")

    @property
    def holds(self) -> bool:
        """Whether the value stays within its limit."""
        return self.value <= self.limit


def limits(
    scene: Scene,
    arrivals: Mapping[str, float],
    scales: Mapping[str, Sequence[FlightScales]],
    met: Mapping[str, Encounters],
    shift: float,
) -> Iterator[Limit]:
    """Every row, from the speeds of ``arrivals`` (m/s) at the body, the ``scales`` of each fraction's flight (nothing
    in a vacuum) and what it has ``met``; ``shift``: the landing shift (body widths) that the accuracy asked for allows.
    """
    rate = 3600.0 * scene.feed.mass_flow

    def row(name: str, about: str, value: float, limit: float, why: str) -> Limit:
        return _limit(name, about, value, limit, why, rate)

    speeds = {name: max(abs(speed), MIN_HELD_SPEED) for name, speed in arrivals.items()}
    dense = scene.feed.crowding * _packing(scene, speeds)
    why = "solid volume in the curtain at the body, at each fraction's own speed"
    yield row("curtain", INDEPENDENT, dense, COLLIDING, f"{why} ({ELGHOBASHI})")
    number, bearable, why = _meetings(scene, scales, met, shift)
    if number > 0.0:
        yield row("meetings", INDEPENDENT, number, bearable, why)
    layer = _layer(scene, speeds)
    if layer.height:
        why = "share of the slope under granules that have bounced and not left it yet"
        yield row("slope-covered", INDEPENDENT, layer.covered, LOADED, why)
        size = f"{layer.sizes:.2g} granule sizes, {layer.solid:.2g} of it solid"
        why = f"m, height to which granules bounce off the slope: {size}"
        yield Limit("layer", INDEPENDENT, layer.height, math.inf, math.inf, why)
    if scene.air is not None:
        yield from _of_the_air(_taken_from_the_air(scene, scales), rate, min(speeds.values()))
        why = f"solid volume in the curtain: more than this damps or feeds the air's turbulence ({ELGHOBASHI})"
        yield row("turbulence", TURBULENCE, dense, MODULATING, why)


def _limit(name: str, about: str, value: float, limit: float, why: str, rate: float, power: float = 1.0) -> Limit:
    """A row whose ``value`` grows with that ``power`` of the feed rate, which is now ``rate`` (kg/h)."""
    reached = math.inf if value == 0.0 else 0.0 if math.isinf(value) else rate * (limit / value) ** (1.0 / power)
    return Limit(name, about, value, limit, reached, why)


def _of_the_air(taken: _TakenFromTheAir, rate: float, slowest: float) -> Iterator[Limit]:
    """The rows of what the granules' drag does to the air; ``slowest``: the slowest fraction's fall speed (m/s)."""
    if taken.speed == 0.0:
        why = (
            f"{taken.driven:.2g} m/s that drag gives the curtain's air at rest, over the slowest fraction's fall speed"
        )
        yield _limit("air-driven", COUPLING, taken.driven / slowest, LOADED, why, rate, 0.5)
        return
    why = "mass flow of granules in the curtain over that of the air in it"
    yield _limit("mass-loading", COUPLING, taken.mass, LOADED, why, rate)
    why = "momentum that drag takes from the air in the curtain, down to the body, over that of this air"
    yield _limit("air-momentum", COUPLING, taken.momentum, LOADED, why, rate)


def _meetings(
    scene: Scene, scales: Mapping[str, Sequence[FlightScales]], met: Mapping[str, Encounters], shift: float
) -> tuple[float, float, str]:
    """Meetings of a granule, how many are bearable, and what they are, of the fraction whose granules bear fewest."""
    every = []
    for name, encounter in met.items():
        moved = shifted(scene, encounter, scales.get(name, ()))
        by_one = moved / min(1.0, encounter.heavier) if encounter.heavier > 0.0 else 0.0
        bearable = shift / by_one if by_one > 0.0 else math.inf
        why = f"of a granule of {name} with others as heavy or heavier, each a kick of up to {encounter.knock:.2g} m/s"
        every.append((encounter.heavier, bearable, why))
    return max(every, key=lambda row: row[0] / row[1])


def _packing(scene: Scene, speeds: Mapping[str, float]) -> float:
    """Solid volume fraction of the curtain at the body, mean over its width, each fraction at its own speed (m/s)."""
    feed, packing = scene.feed, 0.0
    for name, share in scene.mass_shares().items():
        density = scene.fraction[name].properties.density
        packing += feed.mass_flow * share / density / (feed.width * feed.depth * speeds[name])
    return packing


class _TakenFromTheAir(NamedTuple):
    """What the curtain's granules do to the air in its stream tube: their ``mass`` flow over its own, the momentum that
    they give it or take from it on their way to the body, over its density and the tube's section (``push``, m2/s2),
    and its ``speed`` (m/s); ``fastest`` (m/s): the speed that granules come to.
    """

    mass: float
    push: float
    speed: float
    fastest: float

    @property
    def momentum(self) -> float:
        """The momentum over the air's own."""
        return self.push / self.speed**2

    @property
    def driven(self) -> float:
        """Largest change of the air's velocity (m/s): all momentum comes from this stream tube, and none from a
        pressure that builds up before the curtain: U - sqrt(U^2 - 2 push), and sqrt(2 push) of air at rest, which
        becomes no faster than the granules.
        """
        if self.speed == 0.0:
            return min(math.sqrt(2.0 * self.push), self.fastest)
        return self.speed * (1.0 - math.sqrt(max(0.0, 1.0 - 2.0 * self.momentum)))


def _taken_from_the_air(scene: Scene, scales: Mapping[str, Sequence[FlightScales]]) -> _TakenFromTheAir:
    """Estimate it by what drag gives each fraction's median granule down to the body; without a body, in a jet, no more
    than at the largest slip all the way. The curtain is as dense as about one of its granules in the mean.
    """
    air, feed = scene.airstream, scene.feed
    tilt = abs(scene.channel.tilt)  # air that comes across the curtain passes it over all of its height
    wide = feed.width * math.cos(tilt) + (scene.drop * math.sin(tilt) if tilt else 0.0)
    section = min(wide, scene.channel.width) * feed.depth
    dense = feed.crowding * feed.mass_flow / (air.density * section)  # m/s
    shares = scene.mass_shares().items()
    given = sum(share * abs(scales[name][len(scales[name]) // 2].given) for name, share in shares)
    fastest = max(max(flight.arrival, flight.landing) for flights in scales.values() for flight in flights)
    return _TakenFromTheAir(math.inf if air.still else dense / air.speed, dense * given, air.speed, fastest)


def with_driven_air(scene: Scene, scales: Mapping[str, Sequence[FlightScales]]) -> Mapping[str, Sequence[FlightScales]]:
    """The ``scales`` of all fractions with what their drag together takes from the air; as they are in a scene without
    feed.rate, which says nothing of how dense its curtain is.
    """
    if scene.air is None or not scene.feed.rate:
        return scales
    driven = _taken_from_the_air(scene, scales).driven
    return {name: [replace(flight, driven=driven) for flight in flights] for name, flights in scales.items()}


@dataclass(frozen=True)
class _Layer:
    """The layer of granules on the first body's slopes."""

    covered: float = 0.0  # share of the slopes under granules
    height: float = 0.0  # m, to which the fraction that bounces highest does
    sizes: float = 0.0  # the same in that fraction's granule sizes
    solid: float = 0.0  # share of the layer's volume


def _layer(scene: Scene, speeds: Mapping[str, float]) -> _Layer:
    """The layer on the first body's slopes: nothing without a body, and where its top is level.

    A granule that meets the slope goes half its length at the tangential speed of eq. (2), and faster by gravity
    less friction, until it leaves: t = (sqrt(v^2 + a L) - v) / a. It bounces to v_n^2 / (2 g cos b). Without vibration.
    """
    if not scene.body or (slope := slope_of(scene))[0] <= 0.0:
        return _Layer()
    beta, length = slope
    on_slope = scene.feed.mass_flow * _share_on(scene, scene.outline) / scene.feed.depth
    covered = solid = height = sizes = 0.0
    for name, share in scene.mass_shares().items():
        granule = scene.fraction[name].properties
        after = impact(beta, speeds[name], 0.0, granule.restitution, granule.friction, scene.fraction[name].inertia)
        along, out = float(after.tangential), float(after.normal)
        pull = scene.gravity * (math.sin(beta) - granule.friction * math.cos(beta))
        volume = on_slope * share / granule.density * time_down(0.5 * length, along, pull) / length
        covered += SHADE * volume / granule.diameter
        solid += volume
        bounce = 0.5 * out**2 / (scene.gravity * math.cos(beta))
        if bounce + granule.diameter > height:
            height, sizes = bounce + granule.diameter, bounce / granule.diameter + 1.0
    return _Layer(covered, height, sizes, solid / height)


def _share_on(scene: Scene, outline: Array) -> float:
    """Share of the curtain that falls within the width of ``outline``."""
    x = scene.plumb.seen(outline)[:, 0]
    places = scene.feed.places((np.arange(PLACES) + 0.5) / PLACES)
    return float(np.mean((places > x.min()) & (places < x.max())))


def strained(rows: Sequence[Limit], lifted: Collection[str] = ()) -> Iterator[Notice]:
    """A notice of each assumption that the feed rate strains: the numbers, and the rate below which it holds; none for
    those that are ``lifted``, since what they leave out is computed.
    """
    for about in (COUPLING, INDEPENDENT):
        beyond = [row for row in rows if row.about == about and about not in lifted and not row.holds]
        if beyond:
            numbers = ", ".join(f"{row.name} {row.value:.2g} (limit {row.limit:.2g})" for row in beyond)
            least = min(row.feed_rate for row in beyond)
            grade = void if any(row.value > MAX_EXCEEDANCE * row.limit for row in beyond) else less_sure
            yield grade(
                f"the feed is too dense for {about}: {numbers}; with feed.rate below {least:.2g} kg/h it is not"
            )
