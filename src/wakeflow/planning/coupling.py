"""Feed and loading: how dense curtain and layer are, and up to which feed rate one granule does not feel the others.

The tracker flies granules alone through air that does not feel them. Each row of ``limits`` is a number that grows with
the feed rate, the value up to which that holds, and the feed rate at which it is reached.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import edges, normals
from ..laws.collision import impact
from ..laws.constants import GRAVITY
from ..scene import Scene
from .bounds import Flight, bounds
from .flight_scales import CROSSED, meetings, packing

Array = NDArray[np.float64]
__all__ = ["COUPLING", "INDEPENDENT", "TURBULENCE", "Limit", "limits", "strained"]

COUPLING, INDEPENDENT, TURBULENCE = "one-way coupling", "independent granules", "the air's own turbulence"
COLLIDING = 1e-3  # volume fraction above which granules of a suspension collide: "four-way" in Elghobashi 1994
MODULATING = 1e-6  # volume fraction above which granules change the turbulence: "two-way" there
LOADED = 0.1  # of the air's own flow of mass or momentum, and of the slope covered: what is let pass as small
SLOWEST = 0.1  # m/s: granules that the air holds in the curtain
ELGHOBASHI = "Elghobashi 1994, Appl. Sci. Res. 52, 309"


@dataclass(frozen=True)
class Limit:
    """A number ``value`` that tells whether ``about`` holds; it does up to ``limit`` (None: a scale, no limit), which a
    feed of ``feed_rate`` (kg/h) reaches; ``why`` says what the number is.
    """

    name: str
    about: str
    value: float
    limit: float | None
    feed_rate: float | None
    why: str

    @property
    def holds(self) -> bool:
        return self.limit is None or self.value <= self.limit


def limits(scene: Scene, arrivals: Mapping[str, float], found: Mapping[str, list[Flight]], shift: float) -> list[Limit]:
    """Every row, from the speeds of ``arrivals`` (m/s) at the body and the scales ``found`` of each fraction's flight
    (nothing in a vacuum); ``shift``: the landing shift (body widths) that the accuracy asked for allows.
    """
    rate = 3600.0 * scene.feed.mass_flow

    def row(name: str, about: str, value: float, limit: float, why: str) -> Limit:
        reached = 0.0 if math.isinf(value) else rate * limit / value
        return Limit(name, about, value, limit, reached, why)

    speeds = {name: max(abs(speed), SLOWEST) for name, speed in arrivals.items()}
    dense = scene.feed.crowding * sum(share for share, _ in packing(scene, speeds))
    why = "solid volume in the curtain at the body, at each fraction's own speed"
    rows = [row("curtain", INDEPENDENT, dense, COLLIDING, f"{why} ({ELGHOBASHI})")]
    rows.append(row("meetings", INDEPENDENT, *_meetings(scene, speeds, found, shift)))
    layer = _layer(scene, speeds)
    if layer is not None:
        cover, thickness, sizes, solid = layer
        why = "share of the slope under granules that have bounced and not left it yet"
        rows.append(row("slope-covered", INDEPENDENT, cover, LOADED, why))
        why = f"m, height to which granules bounce off the slope: {sizes:.2g} granule sizes, {solid:.2g} of it solid"
        rows.append(Limit("layer", INDEPENDENT, thickness, None, None, why))
    if scene.air is not None:
        taken, loading = _on_the_air(scene, found)
        why = "mass of granules through the channel over that of the air"
        rows.append(row("mass-loading", COUPLING, loading, LOADED, why))
        why = "momentum that drag takes from the air over that of the air"
        rows.append(row("air-momentum", COUPLING, taken, LOADED, why))
        why = f"solid volume in the curtain: more than this damps or feeds the air's turbulence ({ELGHOBASHI})"
        rows.append(row("turbulence", TURBULENCE, dense, MODULATING, why))
    return rows


def _meetings(
    scene: Scene, speeds: Mapping[str, float], found: Mapping[str, list[Flight]], shift: float
) -> tuple[float, float, str]:
    """Meetings of a granule of the fraction that bears the fewest, how many those are, and what they are."""
    rows = []
    for name, fraction in scene.fraction.items():
        own, shift_of = fraction.properties, bounds["collisions-between-granules"].shift
        each = [(flight.meetings, shift_of(replace(flight, meetings=1.0))) for flight in found.get(name, [])]
        for met, moves in each or [(meetings(scene, own.diameter, own.density), _free_shift(scene, speeds[name]))]:
            path = CROSSED * scene.feed.width / met * 1e3
            why = f"of {name} with others in the curtain, by the momentum they take: one every {path:.3g} mm of way"
            rows.append((met, shift / moves, why))
    return max(rows, key=lambda row: row[0] / row[1])


def _free_shift(scene: Scene, speed: float) -> float:
    """Widths that a granule of ``speed`` (m/s) goes while it falls from the body to the floor, without air."""
    return speed * math.sqrt(2.0 * (scene.level - scene.channel.bottom) / GRAVITY) / scene.width


def _on_the_air(scene: Scene, found: Mapping[str, list[Flight]]) -> tuple[float, float]:
    """Momentum that granules take from the air over the air's own flow of it, and the same of mass."""
    assert scene.air is not None
    air = scene.air.density * scene.air.speed * scene.channel.width * scene.feed.depth
    taken = 0.0
    for name, share in scene.mass_shares().items():
        flight = found[name][len(found[name]) // 2]
        taken += share * flight.slip * flight.reach(flight.whole) / flight.tau
    return scene.feed.mass_flow * taken / (air * scene.air.speed), scene.feed.mass_flow / air


def _layer(scene: Scene, speeds: Mapping[str, float]) -> tuple[float, float, float, float] | None:
    """The layer on the first body's slopes: share of them covered; height (m) to which the fraction that bounces
    highest does, in its own sizes; solid volume in the layer. None where the slopes' face is level or away.

    A granule that meets the slope goes half its length at the tangential speed of eq. (2), and faster by gravity
    less friction, until it leaves: t = (sqrt(v^2 + a L) - v) / a. It bounces to v_n^2 / (2 g cos b). Without vibration.
    """
    if scene.first_outline is None:
        return None
    beta, length = _slope(scene.first_outline)
    if beta <= 0.0:
        return None
    on_slope = scene.feed.mass_flow * _share_on(scene, scene.first_outline) / scene.feed.depth
    cover = solid = 0.0
    highest, sizes = 0.0, 0.0
    for name, share in scene.mass_shares().items():
        own = scene.fraction[name].properties
        after = impact(beta, speeds[name], 0.0, own.restitution, own.friction, scene.fraction[name].inertia)
        along, out = float(after.tangential), float(after.normal)
        pull = GRAVITY * (math.sin(beta) - own.friction * math.cos(beta))
        volume = on_slope * share / own.density * _stay(along, pull, length) / length
        cover += 1.5 * volume / own.diameter
        solid += volume
        if (height := 0.5 * out**2 / (GRAVITY * math.cos(beta))) + own.diameter > highest:
            highest, sizes = height + own.diameter, height / own.diameter + 1.0
    return cover, highest, sizes, solid / highest


def _stay(along: float, pull: float, length: float) -> float:
    """Seconds on a slope of ``length`` (m), from its middle on, at first ``along`` (m/s), under ``pull`` (m/s2)."""
    if along**2 + pull * length < 0.0 or along == pull == 0.0:
        return math.inf
    return length / (math.sqrt(along**2 + pull * length) + along)


def _slope(outline: Array) -> tuple[float, float]:
    """Angle (rad) of the faces that granules fall on, mean over their projected width; their length (m) together."""
    start, end = edges(outline)
    up = normals(outline)[:, 1] > 1e-9
    across, length = np.abs(end - start)[up, 0], np.linalg.norm(end - start, axis=1)[up]
    beta = np.arccos(np.clip(across / length, 0.0, 1.0))
    return float(np.average(beta, weights=across)), float(length.sum())


def _share_on(scene: Scene, outline: Array) -> float:
    """Share of the curtain that falls within the width of ``outline``."""
    x = outline[:, 0]
    places = scene.feed.places((np.arange(500) + 0.5) / 500)
    return float(np.mean((places > x.min()) & (places < x.max())))


def strained(rows: list[Limit]) -> Iterator[str]:
    """A line for each assumption that the feed rate strains: the numbers, and the rate below which it holds."""
    for about in (COUPLING, INDEPENDENT):
        beyond = [row for row in rows if row.about == about and not row.holds]
        if beyond:
            numbers = ", ".join(f"{row.name} {row.value:.2g} (limit {row.limit:.2g})" for row in beyond)
            least = min(row.feed_rate or 0.0 for row in beyond)
            yield f"{about} strained by the feed rate: {numbers}; below {least:.2g} kg/h all of these hold"
