"""What the falling stream does to the first body: mass flow, forces and power on each slope, by first impacts.

Computed from the scene and the plan by the laws that injection uses, at points spread evenly over the curtain, the
sizes and the vibration's period; no granule is tracked. Granules that the air carries round the body (``deflection``)
are left out. Later bounces on the same body are not counted, nor how the air bends the way of those that do meet it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import edges, normals
from ..laws.granule_layer import Load, load_on_wall
from ..planning.impaction import axis
from ..planning.plan import FractionPlan, Plan
from ..planning.uniform_fall import fall_speeds
from ..scene import Scene
from .feed import contact_points, granules_of
from .first_contact import first_contact, motion_of

__all__ = ["impact_loads"]

Array = NDArray[np.float64]
SIZES = 8  # equal shares of a fraction's mass
PLACES = 24  # of each half of the curtain, others for every size
PHASES = 64  # of the vibration's period


def impact_loads(scene: Scene, plan: Plan) -> dict[str, Any] | None:
    """The ``impact`` table of result.json, of the first body; None where none stands, or another may be met before
    it. Per slope that is met, from left
    to right, per fraction, and in total, in SI units: ``mass_flow``; ``fall_speed`` of arrival; ``normal`` force into
    the slope and ``tangential`` force down it; ``force`` on the body (x, y); ``power`` that the vibration gives to the
    stream; ``velocity`` of the centre of mass after the impact.
    """
    if not scene.body or scene.obstacles:
        return None
    name, body = next(iter(scene.body.items()))
    outline = body.outline()
    slopes = _slopes(outline)
    fractions: dict[str, Any] = {}
    totals: dict[str, list[Load]] = {slope: [] for slope in slopes}
    for fraction, how in plan.fractions.items():
        met = _sample(scene, fraction, how, outline)
        rows, parts = {}, []
        for number, slope in enumerate(slopes):
            found, fall = _on_slope(scene, fraction, met, number)
            if found.mass_flow > 0.0:
                rows[slope] = {"fall_speed": fall, **_sum([found])}
                totals[slope].append(found)
                parts.append(found)
        arrival = float(np.mean(met["fall"], where=met["fall"] > 0.0)) if parts else None
        fractions[fraction] = {"mode": how.mode, "slopes": rows, "total": {"fall_speed": arrival, **_sum(parts)}}
    places = {
        slope: {"from": start.tolist(), "to": end.tolist(), **_sum(totals[slope])}
        for slope, (start, end) in slopes.items()
        if totals[slope]
    }
    everything = _sum([one for part in totals.values() for one in part])
    return {"body": name, "slopes": places, "fractions": fractions, "total": everything}


def _middles(count: int) -> Array:
    """Middles of ``count`` equal parts of 0 to 1."""
    return (np.arange(count) + 0.5) / count


def _slopes(outline: Array) -> dict[str, tuple[Array, Array]]:
    """The edges that look up, by name, each from its left end to its right."""
    starts, ends = edges(outline)
    up = [(end, start) for start, end, n in zip(starts, ends, normals(outline), strict=True) if n[1] > 1e-12]
    up.sort(key=lambda edge: float(edge[0][0] + edge[1][0]))
    names = {1: ["top"], 2: ["left", "right"]}.get(len(up)) or [f"slope-{i + 1}" for i in range(len(up))]
    return dict(zip(names, up, strict=True))


def _sample(scene: Scene, name: str, how: FractionPlan, outline: Array) -> dict[str, Array]:
    """Equal parts of a fraction's stream (n,): ``slope`` number below them, ``fall`` speed m/s when they touch the body
    (NaN: they do not), unit ``normal`` (n, 2) and velocity of the ``wall`` (n, 2) m/s there.
    """
    release, motion = scene.level + scene.release[0], motion_of(scene)
    swing = 0.0 if scene.vibration is None else float(np.linalg.norm(scene.vibration.displacement))
    fraction, middles, parts = scene.fraction[name], _middles(SIZES), []
    settling = fraction.settling(np.roll(middles, 3))
    grains = granules_of(fraction, how, fraction.diameters(middles), settling)
    lates = np.roll(middles[::-1], 3)
    for shift, late, diameter, factor in zip(middles, lates, grains.diameter, grains.drag_scale, strict=True):
        half = (np.arange(PLACES) + shift) / PLACES
        at = (np.arange(PHASES) + late) / PHASES
        place, phase = (each.ravel() for each in np.meshgrid(0.5 + 0.5 * np.append(-half, half), at))
        x = scene.feed.places(place)
        height, normal = contact_points(outline, x, np.full(len(x), diameter / 2))
        met = np.isfinite(height)
        if how.impaction is not None:
            met &= how.impaction.meets(np.full(len(x), diameter), x - axis(scene))
        fall, later, wall = np.full(len(x), np.nan), np.full(len(x), np.nan), np.zeros((len(x), 2))
        if met.any():
            drop = np.maximum(release - height[met], 0.0)
            drops = np.concatenate([drop, drop + swing])
            speeds = fall_speeds(scene, name, how.drag, float(factor), float(diameter), drops)
            fall[met], later[met] = speeds.reshape(2, -1)
        met = fall > 0.0
        if scene.vibration is not None and met.any():
            passing = scene.vibration.period * phase[met]
            pull = np.nan_to_num((later[met] ** 2 - fall[met] ** 2) / (2.0 * swing), nan=0.0)
            time, wall[met] = first_contact(fall[met], normal[met], passing, motion, pull)
            fall[met] += pull * (time - passing)
        parts.append((_slope_below(outline, x), fall, normal, wall))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return dict(zip(("slope", "fall", "normal", "wall"), columns, strict=True))


def _slope_below(outline: Array, x: Array) -> NDArray[np.int64]:
    """Number of the slope that is highest at x (n,): a granule that touches a corner, or hangs over an outer one,
    counts to the slope below its centre, or the next.
    """
    x = np.clip(x, outline[:, 0].min(), np.nextafter(outline[:, 0].max(), -np.inf))
    highest, found = np.full(len(x), -np.inf), np.zeros(len(x), dtype=np.int64)
    for number, (a, b) in enumerate(_slopes(outline).values()):
        y = a[1] + (x - a[0]) * (b[1] - a[1]) / (b[0] - a[0])
        higher = (x >= a[0]) & (x < b[0]) & (y > highest)
        highest[higher], found[higher] = y[higher], number
    return found


def _on_slope(scene: Scene, name: str, met: dict[str, Array], number: int) -> tuple[Load, float]:
    """What a fraction does to a slope, and its mean fall speed (m/s) there."""
    fraction = scene.fraction[name]
    granule, inertia = fraction.properties, fraction.inertia
    here = np.flatnonzero((met["fall"] > 0.0) & (met["slope"] == number))
    flow = scene.feed.mass_flow * scene.mass_shares()[name] * len(here) / len(met["fall"])
    fall = met["fall"][here]
    found = load_on_wall(
        flow, fall, met["normal"][here], met["wall"][here], granule.restitution, granule.friction,
        0.0 if inertia is None else 1.0 / inertia,
    )  # fmt: skip
    return found, float(fall.mean()) if len(here) else 0.0


def _sum(parts: list[Load]) -> dict[str, Any]:
    """Forces and power add up, the centre of mass has the mass-weighted velocity."""
    flow = sum((one.mass_flow for one in parts), 0.0)
    force = sum((one.force for one in parts), np.zeros(2))
    moving = sum((one.mass_flow * one.velocity for one in parts), np.zeros(2))
    return {
        "mass_flow": flow,
        "normal": sum((one.normal for one in parts), 0.0),
        "tangential": sum((one.tangential for one in parts), 0.0),
        "force": force.tolist(),
        "power": sum((one.power for one in parts), 0.0),
        "velocity": (moving / flow).tolist() if flow > 0.0 else None,
    }
