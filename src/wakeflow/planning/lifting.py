"""What the air lifts, before anything is computed: each fraction's terminal velocity against the air at three places.

The places are the free channel, the narrowest gap beside the bodies, where continuity makes the air faster, and the
near wake, where it turns back. A granule that falls more slowly than the air rises is lifted there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..core.geometry import between_walls, edges, wall_edge
from ..core.graded import Notice, information, less_sure
from ..core.quantities import metres, say
from ..scene import Scene
from .plan import FractionPlan
from .uniform_fall import Array, UniformFall

TURNS_BACK = 1.0 / 3.0  # speed of the air that turns back behind a body, over that in the gap; chosen, good to a half
HOVERS = 0.05  # of a terminal velocity: air that differs by no more neither lifts nor lets fall; chosen
QUANTILES = np.array([0.05, 0.5, 0.95])  # by mass, of a fraction's terminal velocities
LEVEL_APART = 1e-9  # m: a corner's level is looked at from so far above and below
FALLS, HANGS, LIFTED = "falls", "hovers", "is lifted"
UNCOVERED = 1e-3  # of the channel's width: a shorter part of the floor without a bin is not worth a word


@dataclass(frozen=True)
class Gap:
    """The narrowest place beside the bodies: what is ``free`` (m) of the channel, the air's mean ``speed`` there (m/s)
    and the ``bodies`` beside it.
    """

    free: float
    speed: float
    bodies: tuple[str, ...]

    @property
    def where(self) -> str:
        """The bodies in words."""
        return " and ".join(self.bodies) if len(self.bodies) < 3 else "the bodies"


def narrowest_gap(scene: Scene) -> Gap | None:
    """The narrowest gap of a scene; None without bodies, or air that moves.

    Its speed is the flow over the free width: the wakes of bodies make it faster still.
    """
    if scene.air is None or scene.air.still or not scene.body:
        return None
    outlines = {name: body.outline() for name, body in scene.body.items()}
    corners = np.concatenate([outline[:, 1] for outline in outlines.values()])
    levels = np.concatenate([corners - LEVEL_APART, corners + LEVEL_APART])
    spans = {float(y): {name: span for name, one in outlines.items() if (span := _span(one, y))} for y in levels}
    level = max(spans, key=lambda y: _covered(list(spans[y].values())))
    width, beside = scene.channel.width, tuple(spans[level])
    free, slanting = width - _covered(list(spans[level].values())), between_walls(outlines.values(), width)
    if slanting < free:  # between bodies on both walls the way leads aside
        free, beside = slanting, tuple(name for name, one in outlines.items() if wall_edge(one, width / 2))
    return Gap(free, scene.air.speed * width / free, beside)


def _span(outline: Array, y: float) -> tuple[float, float] | None:
    """From where to where (m) an outline reaches at a level; None where it does not."""
    (x0, y0), (x1, y1) = (ends.T for ends in edges(outline))
    cut = (y0 - y) * (y1 - y) < 0.0
    if not cut.any():
        return None
    x = x0[cut] + (y - y0[cut]) / (y1[cut] - y0[cut]) * (x1[cut] - x0[cut])
    return float(x.min()), float(x.max())


def _covered(spans: list[tuple[float, float]]) -> float:
    """Length (m) of the union of some stretches."""
    total, reach = 0.0, -np.inf
    for low, high in sorted(spans):
        total += max(0.0, high - max(low, reach))
        reach = max(reach, high)
    return float(total)


def terminal_velocities(scene: Scene, name: str, plan: FractionPlan) -> Array:
    """Terminal velocities (3,) m/s in the scene's air at QUANTILES of a fraction's mass."""
    fraction = scene.fraction[name]
    measured = fraction.settling(QUANTILES)
    if measured is not None:
        return measured
    fine = fraction.diameters(QUANTILES)
    return np.sort([UniformFall.of(scene, fraction, plan.drag, plan.drag_scale, one).settling for one in fine])


def _verdict(falls: float, rises: float) -> str:
    """What granules of a terminal velocity do in air that rises (m/s, negative: sinks)."""
    if abs(falls - rises) <= HOVERS * falls:
        return HANGS
    return LIFTED if rises > falls else FALLS


def lifting_line(scene: Scene, fractions: Mapping[str, FractionPlan]) -> str:
    """The air in the narrowest gap, and what each fraction does in the air; empty in a vacuum."""
    if scene.air is None:
        return ""
    gap, air = narrowest_gap(scene), scene.air.blows
    if gap is not None:
        free = f"{metres(gap.free, 3)} of {metres(scene.channel.width, 3)} are free"
        air += f", {say(gap.speed, 'm/s', 2)} beside {gap.where} ({free})"
    fates = (_fate(scene, gap, name, terminal_velocities(scene, name, plan)) for name, plan in fractions.items())
    return f"{air}: {', '.join(fates)}"


def _fate(scene: Scene, gap: Gap | None, name: str, speeds: Array) -> str:
    """``"wheat (7.5 to 8.1 m/s) is lifted beside it"``, the body."""
    low, middle, high = (float(one) for one in speeds)
    spread = f"{low:.2g} to {high:.2g}" if f"{low:.2g}" != f"{high:.2g}" else f"{middle:.2g}"
    up = scene.airstream.rises
    middle *= math.cos(scene.channel.tilt)
    verdict, where = _verdict(middle, scene.airstream.speed if up else -scene.airstream.speed), ""
    if gap is not None and verdict == FALLS:
        rises, place = (gap.speed, " beside it") if up else (TURNS_BACK * gap.speed, " behind it")
        if (there := _verdict(middle, rises)) != FALLS:
            verdict, where = there, place.replace("it", "them", 1) if len(gap.bodies) > 1 else place
    return f"{name} ({spread} m/s) {verdict}{where}"


def lifting_notices(scene: Scene, fractions: Mapping[str, FractionPlan]) -> Iterator[Notice]:
    """Where the air lifts all or nothing, and where a target lies where the air does not take its fraction."""
    if scene.air is None or scene.air.still:
        return
    air, gap = scene.air, narrowest_gap(scene)
    fastest = air.speed if gap is None else gap.speed
    along = math.cos(scene.channel.tilt)  # of the air, whose axis is the channel's
    slow = {name: along * float(terminal_velocities(scene, name, plan)[1]) for name, plan in fractions.items()}
    blown = f"air of {say(air.speed, 'm/s', 3)} {air.direction}"
    if air.direction == "up" and len(slow) > 1:
        if all(_verdict(speed, air.speed) == LIFTED for speed in slow.values()):
            yield less_sure(f"the {blown} lifts every fraction; a lower air.speed lets the heavy ones fall")
        elif all(_verdict(speed, fastest) == FALLS for speed in slow.values()):
            yield less_sure(f"the {blown} lifts no fraction, not even in the narrowest gap; a higher air.speed does")
    for name, speed in slow.items():
        heights = [float(scene.bin[place].line(scene)[:, 1].mean()) for place in scene.fraction[name].targets]
        if not heights:
            continue
        key, rises = f"fraction.{name}.target", fastest if air.direction == "up" else -air.speed
        if min(heights) > scene.level and _verdict(speed, rises) == FALLS:
            yield less_sure(
                f"{key} lies above the feed, but {name} falls at {speed:.2g} m/s through the {blown}; name a bin below"
            )
        elif max(heights) < scene.level and _verdict(speed, air.speed) == LIFTED and air.direction == "up":
            yield less_sure(
                f"{key} lies below the feed, but the {blown} lifts {name}, which falls at {speed:.2g} m/s; name a bin "
                "on top, or lower air.speed"
            )


def floor_notices(scene: Scene) -> Iterator[Notice]:
    """Parts of the floor on which no bin lies: what lands there counts as elsewhere. A bin of points above a part
    covers it.
    """
    half, bins = scene.channel.width / 2, scene.bin.values()
    if not scene.on_sides("floor"):
        return  # a machine that collects elsewhere
    lines = [place.line(scene) for place in bins if place.lies_under]
    reach, bare = -half, []
    for low, high in sorted((float(line[:, 0].min()), float(line[:, 0].max())) for line in lines):
        bare.append((reach, low))
        reach = max(reach, high)
    bare.append((reach, half))
    for low, high in bare:
        if high - low > UNCOVERED * scene.channel.width:
            yield information(
                f"no bin on the floor from x = {metres(low, 4)} to {metres(high, 4)}: what lands there counts as "
                "elsewhere; a [bin.NAME] counts it"
            )
