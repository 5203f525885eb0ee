"""What the falling stream does to the first body: mass flow, forces and power on each slope, by first impacts.

Computed from the scene and the plan by the laws that injection uses, at points spread evenly over the curtain, the
sizes and the vibration's period; no granule is tracked. Granules that the air carries round the body
(``planning.uniform_fall``) are left out. Later bounces on the same body are not counted, nor how the air bends the way
of those that do meet it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import edges, normals
from ...core.record import JsonTable, column
from ...laws.streams import Load, load_on_wall
from ...planning.plan import FractionPlan, Plan
from ...planning.uniform_fall import axis, fall_speeds
from ...scene import Scene
from .feedstock import contact_points, granules_of
from .first_contact import first_contact, motion_of

Array = NDArray[np.float64]
# How finely the stream is sampled; chosen
SIZES = 8  # equal shares of a fraction's mass
PLACES = 24  # of each half of the curtain, others for every size
PHASES = 64  # of the vibration's period
HALVINGS = 30  # of a piece of it: 4e-10 rad, far below what the samples know of the sums
UPWARD = 1e-12  # part of a unit normal above which a face looks up: round-off


@dataclass(frozen=True, kw_only=True)
class ImpactForces:
    """Mass flow, forces and power of first impacts, per metre of depth of the feed as given."""

    mass_flow: float = column("kg/s", "mass that meets the slope")
    normal: float = column("N", "force into the slope")
    tangential: float = column("N", "force down the slope")
    force: tuple[float, ...] = column("N", "force on the body, x and y")
    power: float = column("W", "what the vibration gives to the stream")
    velocity: tuple[float, ...] | None = column("m/s", "mean velocity by mass after the impact, x and y; null of none")


@dataclass(frozen=True, kw_only=True)
class SlopeImpact(ImpactForces):
    """All fractions on one slope."""

    start: tuple[float, ...] = column("m", "left end of the slope, x and y", key="from")
    end: tuple[float, ...] = column("m", "right end of the slope, x and y", key="to")


@dataclass(frozen=True, kw_only=True)
class StreamImpact(ImpactForces):
    """One fraction's stream on one slope, or on all."""

    fall_speed: float | None = column("m/s", "mean speed of fall on arrival; null of none")


@dataclass(frozen=True)
class FractionImpact:
    """One fraction's stream on the body."""

    mode: str = column("", "injected or resolved")
    slopes: dict[str, StreamImpact] = column("", "every slope that it meets")
    total: StreamImpact = column("", "all slopes together")


@dataclass(frozen=True)
class ImpactSummary:
    """First impacts on the first body, from left to right."""

    body: str = column("", "name of the body")
    slopes: dict[str, SlopeImpact] = column("", "every slope that is met, by name")
    fractions: dict[str, FractionImpact] = column("", "every fraction")
    total: ImpactForces = column("", "all fractions on all slopes")


def impact_loads(scene: Scene, plan: Plan) -> ImpactSummary | None:
    """What the stream does to the first body; None where there is none, another may be met before it, or gravity is at
    an angle to the channel.
    """
    if not scene.body or scene.obstacles or not scene.plumb.upright:
        return None
    name, body = next(iter(scene.body.items()))
    outline = body.outline()
    slopes = _slopes(outline)
    fractions: dict[str, FractionImpact] = {}
    totals: dict[str, list[Load]] = {slope: [] for slope in slopes}
    for fraction, fraction_plan in plan.fractions.items():
        stream = _sample(scene, fraction, fraction_plan, outline)
        by_slope, loads = {}, []
        for number, slope in enumerate(slopes):
            on_slope, fall = _on_slope(scene, fraction, stream, number)
            if on_slope.mass_flow > 0.0:
                by_slope[slope] = StreamImpact(fall_speed=fall, **_sum([on_slope]))
                totals[slope].append(on_slope)
                loads.append(on_slope)
        arrival = float(np.mean(stream.fall, where=stream.fall > 0.0)) if loads else None
        total = StreamImpact(fall_speed=arrival, **_sum(loads))
        fractions[fraction] = FractionImpact(fraction_plan.mode, by_slope, total)
    places = {
        slope: SlopeImpact(start=tuple(start.tolist()), end=tuple(end.tolist()), **_sum(totals[slope]))
        for slope, (start, end) in slopes.items()
        if totals[slope]
    }
    everything = _sum([load for part in totals.values() for load in part])
    return ImpactSummary(name, places, fractions, ImpactForces(**everything))


def _middles(count: int) -> Array:
    """Middles of ``count`` equal parts of 0 to 1."""
    return (np.arange(count) + 0.5) / count


def _slopes(outline: Array) -> dict[str, tuple[Array, Array]]:
    """The edges that look up, by name, each from its left end to its right."""
    starts, ends = edges(outline)
    up = [(end, start) for start, end, n in zip(starts, ends, normals(outline), strict=True) if n[1] > UPWARD]
    up.sort(key=lambda edge: float(edge[0][0] + edge[1][0]))
    names = {1: ["top"], 2: ["left", "right"]}.get(len(up)) or [f"slope-{i + 1}" for i in range(len(up))]
    return dict(zip(names, up, strict=True))


@dataclass(frozen=True, eq=False)
class _Stream:
    """Equal parts of a fraction's stream as they touch the first body."""

    slope: NDArray[np.int64]  # (n,) number of the slope below them
    fall: Array  # (n,) m/s, speed of their fall; NaN where they pass the body
    normal: Array  # (n, 2) unit outward normal there
    wall: Array  # (n, 2) m/s, velocity of the body


def _sample(scene: Scene, name: str, plan: FractionPlan, outline: Array) -> _Stream:
    """The stream of fraction ``name``, spread evenly over sizes, places and the vibration's period."""
    release, motion = scene.level + scene.release[0], motion_of(scene)
    swing = float(np.linalg.norm(scene.motion[0]))
    fraction, middles, parts = scene.fraction[name], _middles(SIZES), []
    settling = fraction.settling(np.roll(middles, 3))
    grains = granules_of(scene, name, plan, fraction.diameters(middles), settling)
    lates = np.roll(middles[::-1], 3)
    for shift, late, diameter, factor in zip(middles, lates, grains.diameter, grains.drag_scale, strict=True):
        half = (np.arange(PLACES) + shift) / PLACES
        at = (np.arange(PHASES) + late) / PHASES
        place, phase = (each.ravel() for each in np.meshgrid(0.5 + 0.5 * np.append(-half, half), at))
        x = scene.feed.places(place)
        height, normal = contact_points(outline, x, np.full(len(x), diameter / 2))
        meets = np.isfinite(height)
        if plan.impaction is not None:
            meets &= plan.impaction.meets(np.full(len(x), diameter), x - axis(scene))
        fall, later, wall = np.full(len(x), np.nan), np.full(len(x), np.nan), np.zeros((len(x), 2))
        if meets.any():
            drop = np.maximum(release - height[meets], 0.0)
            drops = np.concatenate([drop, drop + swing])
            speeds = fall_speeds(scene, name, plan.drag, float(factor), float(diameter), drops)
            fall[meets], later[meets] = speeds.reshape(2, -1)
        meets = fall > 0.0
        if scene.vibration is not None and meets.any():
            passing = scene.vibration.period * phase[meets]
            pull = np.nan_to_num((later[meets] ** 2 - fall[meets] ** 2) / (2.0 * swing), nan=0.0)
            touched = np.stack([x, height], axis=1)[meets] - 0.5 * diameter * normal[meets]
            time, wall[meets] = first_contact(fall[meets], normal[meets], passing, motion, pull, HALVINGS, touched)
            fall[meets] += pull * (time - passing)
        parts.append((_slope_below(outline, x), fall, normal, wall))
    slopes, *columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Stream(slopes, *columns)


def _slope_below(outline: Array, x: Array) -> NDArray[np.int64]:
    """Number of the slope that is highest at x (n,): a granule that touches a corner, or hangs over an outer one,
    counts to the slope below its centre, or the next.
    """
    x = np.clip(x, outline[:, 0].min(), np.nextafter(outline[:, 0].max(), -np.inf))
    highest, below = np.full(len(x), -np.inf), np.zeros(len(x), dtype=np.int64)
    for number, (a, b) in enumerate(_slopes(outline).values()):
        y = a[1] + (x - a[0]) * (b[1] - a[1]) / (b[0] - a[0])
        higher = (x >= a[0]) & (x < b[0]) & (y > highest)
        highest[higher], below[higher] = y[higher], number
    return below


def _on_slope(scene: Scene, name: str, stream: _Stream, number: int) -> tuple[Load, float]:
    """What the ``stream`` of a fraction does to a slope, and its mean fall speed (m/s) there."""
    fraction = scene.fraction[name]
    granule = fraction.properties
    here = np.flatnonzero((stream.fall > 0.0) & (stream.slope == number))
    flow = scene.feed.mass_flow * scene.mass_shares()[name] * len(here) / len(stream.fall)
    fall = stream.fall[here]
    on_slope = load_on_wall(
        flow, fall, stream.normal[here], stream.wall[here], granule.restitution, granule.friction,
        1.0 / fraction.inertia,
    )  # fmt: skip
    return on_slope, float(fall.mean()) if len(here) else 0.0


def _sum(parts: list[Load]) -> JsonTable:
    """ImpactForces by name: forces and power add up, the centre of mass has the mass-weighted velocity."""
    flow = sum((load.mass_flow for load in parts), 0.0)
    force = sum((load.force for load in parts), np.zeros(2))
    moving = sum((load.mass_flow * load.velocity for load in parts), np.zeros(2))
    return {
        "mass_flow": flow,
        "normal": sum((load.normal for load in parts), 0.0),
        "tangential": sum((load.tangential for load in parts), 0.0),
        "force": tuple(force.tolist()),
        "power": sum((load.power for load in parts), 0.0),
        "velocity": tuple((moving / flow).tolist()) if flow > 0.0 else None,
    }
