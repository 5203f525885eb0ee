"""What a plan says of a scene before anything is computed: air that lifts, bodies, the fan and money, strange numbers.

What the air lifts is each fraction's terminal velocity against the air at three places: the free channel, the narrowest
gap beside the bodies, where continuity makes the air faster, and the near wake, where it turns back. A granule that
falls more slowly than the air rises is lifted there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ..core.geometry import ON_WALL, between_walls, distance_between, edges, normals, wall_edge
from ..core.graded import Notice, information, less_sure
from ..core.quantities import metres, say
from ..laws.best_estimate import DRAG, apart, slower_behind
from ..laws.operating_point import HOUR, bluff_loss
from ..scene import Scene
from ..scene.fan_speed import blocked
from .collision_rates import ejection_speed
from .plan import FractionPlan
from .uniform_fall import Array, UniformFall

# -- What the air lifts ------------------------------------------------------------------------------------------------
TURNS_BACK = 1.0 / 3.0  # speed of the air that turns back behind a body, over that in the gap; chosen, good to a half
HOVERS = 0.05  # of a terminal velocity: air that differs by no more neither lifts nor lets fall; chosen
QUANTILES = np.array([0.05, 0.5, 0.95])  # by mass, of a fraction's terminal velocities
LEVEL_APART = 1e-9  # m: a corner's level is looked at from so far above and below
FALLS, HANGS, LIFTED = "falls", "hovers", "is lifted"
UNCOVERED = 1e-3  # of the channel's width: a shorter part of the floor without a bin is not worth a word


@dataclass(frozen=True)
class Gap:
    """The narrowest place beside the bodies: what is ``free`` (m) of the channel, the air's mean ``speed`` there (m/s)
    and the ``bodies`` beside it, none where air moves past none.
    """

    free: float
    speed: float
    bodies: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """The bodies in words."""
        return " and ".join(self.bodies) if len(self.bodies) < 3 else "the bodies"


def narrowest_gap(scene: Scene) -> Gap:
    """The narrowest gap of a scene: the whole channel without bodies, or air that moves.

    Its speed is the flow over the free width: the wakes of bodies make it faster still.
    """
    if scene.air is None or scene.air.still or not scene.body:
        return Gap(scene.channel.width, 0.0 if scene.air is None else scene.air.speed)
    outlines = {name: body.outline() for name, body in scene.body.items()}
    corners = np.concatenate([outline[:, 1] for outline in outlines.values()])
    levels = np.concatenate([corners - LEVEL_APART, corners + LEVEL_APART])
    spans = {float(y): {name: span for name, line in outlines.items() if (span := _span(line, y))} for y in levels}
    level = max(spans, key=lambda y: _covered(list(spans[y].values())))
    width, beside = scene.channel.width, tuple(spans[level])
    free, slanting = width - _covered(list(spans[level].values())), between_walls(outlines.values(), width)
    if slanting < free:  # between bodies on both walls the way leads aside
        free, beside = slanting, tuple(name for name, outline in outlines.items() if wall_edge(outline, width / 2))
    return Gap(free, scene.air.speed * width / free, beside)


def _span(outline: Array, y: float) -> tuple[float, ...]:
    """Ends (m) between which an outline reaches at a level; empty where it does not."""
    (x0, y0), (x1, y1) = (ends.T for ends in edges(outline))
    cut = (y0 - y) * (y1 - y) < 0.0
    if not cut.any():
        return ()
    x = x0[cut] + (y - y0[cut]) / (y1[cut] - y0[cut]) * (x1[cut] - x0[cut])
    return float(x.min()), float(x.max())


def _covered(spans: list[tuple[float, ...]]) -> float:
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
    return np.sort([UniformFall.of(scene, fraction, plan.drag, plan.drag_scale, d).granule.settling for d in fine])


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
    if gap.bodies:
        free = f"{metres(gap.free, 3)} of {metres(scene.channel.width, 3)} are free"
        air += f", {say(gap.speed, 'm/s', 2)} beside {gap.where} ({free})"
    fates = (_fate(scene, gap, name, terminal_velocities(scene, name, plan)) for name, plan in fractions.items())
    return f"{air}: {', '.join(fates)}"


def _fate(scene: Scene, gap: Gap, name: str, speeds: Array) -> str:
    """``"wheat (7.5 to 8.1 m/s) is lifted beside it"``, the body."""
    low, middle, high = (float(speed) for speed in speeds)
    spread = f"{low:.2g} to {high:.2g}" if f"{low:.2g}" != f"{high:.2g}" else f"{middle:.2g}"
    up = scene.airstream.rises
    middle *= math.cos(scene.channel.tilt)
    verdict, where = _verdict(middle, scene.airstream.speed if up else -scene.airstream.speed), ""
    if gap.bodies and verdict == FALLS:
        rises, place = (gap.speed, " beside it") if up else (TURNS_BACK * gap.speed, " behind it")
        if (there := _verdict(middle, rises)) != FALLS:
            verdict, where = there, place.replace("it", "them", 1) if len(gap.bodies) > 1 else place
    return f"{name} ({spread} m/s) {verdict}{where}"


def lifting_notices(scene: Scene, fractions: Mapping[str, FractionPlan]) -> Iterator[Notice]:
    """Where the air lifts all or nothing, and where a target lies where the air does not take its fraction."""
    if scene.air is None or scene.air.still:
        return
    air, gap = scene.air, narrowest_gap(scene)
    along = math.cos(scene.channel.tilt)  # of the air, whose axis is the channel's
    slow = {name: along * float(terminal_velocities(scene, name, plan)[1]) for name, plan in fractions.items()}
    blown = f"air of {say(air.speed, 'm/s', 3)} {air.direction}"
    if air.direction == "up" and len(slow) > 1:
        if all(_verdict(speed, air.speed) == LIFTED for speed in slow.values()):
            yield less_sure(f"the {blown} lifts every fraction; a lower air.speed lets the heavy ones fall")
        elif all(_verdict(speed, gap.speed) == FALLS for speed in slow.values()):
            yield less_sure(f"the {blown} lifts no fraction, not even in the narrowest gap; a higher air.speed does")
    for name, speed in slow.items():
        heights = [float(scene.bin[place].line(scene)[:, 1].mean()) for place in scene.fraction[name].targets]
        if not heights:
            continue
        key, rises = f"fraction.{name}.target", gap.speed if air.direction == "up" else -air.speed
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


# -- Bodies one below the other ----------------------------------------------------------------------------------------
# Both are bounds for a plan to tell. A run computes every impact on every body, and the air of all bodies together.
def cascade_lines(scene: Scene, *, blown: bool) -> Iterator[str]:
    """A line for each body that granules of one above can come to, and for each that the wake of another reaches, with
    how much slower its air is at most; ``blown``: granules fly in air that moves.
    """
    seen = {name: scene.plumb.seen(body.outline()) for name, body in scene.body.items()}
    for lower, under in seen.items():
        above = [name for name, outline in seen.items() if outline[:, 1].mean() > under[:, 1].mean()]
        throws = {name: [_thrown(scene, kind, seen[name], under) for kind in scene.fraction] for name in above}
        feed = [name for name in above if max(throws[name]) > apart(seen[name], under)]
        if feed:
            far = zip(scene.fraction, np.max([throws[name] for name in feed], axis=0), strict=True)
            thrown = ", ".join(f"{kind} {metres(float(reach), 2)}" for kind, reach in far)
            yield f"cascade: {lower} is met by what leaves {', '.join(feed)}, thrown up to ({thrown}) aside"
    along = -1.0 if scene.air is not None and scene.air.direction == "down" else 1.0
    outlines = {name: body.outline() for name, body in scene.body.items()} if blown else {}
    for front, behind in permutations(outlines, 2):
        slower = slower_behind(outlines[front], outlines[behind], along)
        if slower > 0.0:
            yield (
                f"wake: that of {front} reaches {behind}, with air up to {100.0 * slower:.0f} % slower (a far wake at "
                f"Cd {DRAG:g}); both are in one airflow"
            )


def _thrown(scene: Scene, name: str, upper: Array, lower: Array) -> float:
    """How far (m) aside granules of a fraction come at most that fall from their release onto the ``upper`` outline,
    before they are past the ``lower`` one: without air, thrown up as fast as aside from the upper one's top.
    """
    above, start = scene.release
    top = float(upper[:, 1].max())
    arrival = math.sqrt(start**2 + 2.0 * scene.gravity * max(0.0, scene.level + above - float(upper[:, 1].min())))
    aside = ejection_speed(scene, scene.fraction[name], arrival) * arrival
    drop = top - float(lower[:, 1].min())
    return aside * (aside + math.sqrt(aside**2 + 2.0 * scene.gravity * drop)) / scene.gravity


# -- What the plan warns of at the bodies ------------------------------------------------------------------------------
SEAM = 0.1  # of a record's peak acceleration: a larger jump from its end to its beginning is warned of; chosen


def body_checks(scene: Scene) -> Iterator[Notice]:
    """Notices of gaps too narrow for granules, level faces, faces that friction alone makes a granule stay on, a record
    with a jump.
    """
    yield from _narrow_gaps(scene)
    for name, body in scene.body.items():
        if name in scene.all_kept:  # they stay anyway
            continue
        across, up = normals(scene.plumb.seen(body.outline())).T
        slopes = np.unique(np.round(np.abs(across[up > 0]) / up[up > 0], 9))  # tangents
        if slopes[0] == 0.0:
            yield information(
                f"body.{name} has a level face: granules come to rest on it unless [vibration] throws them off"
            )
        for kind, fraction in scene.fraction.items():
            friction = fraction.properties.friction
            held = slopes[(slopes > 0.0) & (slopes <= friction)]
            if len(held) and (math.isinf(fraction.inertia) or fraction.flake):  # what can roll, does
                angle = math.degrees(math.atan(float(held[-1])))
                yield less_sure(
                    f"body.{name}: friction {friction:g} holds {kind} on its faces of up to {angle:.3g} deg unless "
                    "[vibration] shakes it off"
                )
    vibration = scene.vibration
    if vibration is not None and vibration.samples is not None and vibration.record.seam > SEAM:
        yield less_sure(
            "vibration.samples: from the record's end to its beginning the acceleration jumps by "
            f"{vibration.record.seam:.0%} of its peak; give a whole number of periods"
        )


def _narrow_gaps(scene: Scene) -> Iterator[Notice]:
    """The coarsest granules do not pass the narrowest gap."""
    outlines = {f"body.{name}": body.outline() for name, body in scene.body.items()}
    half = 0.5 * scene.channel.width
    gaps = [
        (off, f"{name} and the {side} wall")
        for name, outline in outlines.items()
        for side, off in (("left", half + float(outline[:, 0].min())), ("right", half - float(outline[:, 0].max())))
        if off > ON_WALL * half
    ]
    for (name, outline), (other_name, other) in combinations(outlines.items(), 2):
        gaps.append((distance_between(outline, other), f"{name} and {other_name}"))
    gap, where = min(gaps, default=(math.inf, ""))
    size, kind = max((float(grain.diameters(np.array([0.99]))[0]), name) for name, grain in scene.fraction.items())
    if size > gap:
        yield less_sure(
            f"{kind}: granules of {metres(size, 3)} do not pass the gap of {metres(gap, 3)} between {where}"
        )


# -- Numbers that no machine has ---------------------------------------------------------------------------------------
AIRY = (0.1, 10.0)  # kg/m3: hot or thin air to heavy gases
FASTEST = 500.0  # Hz: no sieve or feeder shakes so fast; 3000 rpm are 50 Hz
LIGHTEST, HEAVIEST = 25.0, 23000.0  # kg/m3 of granules: foam beads, and no matter is denser


def magnitude_lines(scene: Scene) -> Iterator[Notice]:
    """A notice of each number of the fan, the air, the vibration and the granules that is beyond what machines have."""
    yield from fan_notices(scene)
    air, vibration = scene.air, scene.vibration
    if air is not None and "density" in air.model_fields_set and not AIRY[0] <= air.density <= AIRY[1]:
        yield less_sure(f"air.density = {air.density:.4g} kg/m3, of air about 1.2: unit forgotten? Check air.density")
    if vibration is not None and (often := vibration.given.get("frequency", 0.0)) > FASTEST:
        yield less_sure(f"{often:.4g} Hz is faster than machines shake; vibration.frequency = '{often:.4g} rpm'?")
    for name, fraction in scene.fraction.items():
        density = float(fraction.properties.density)
        if scene.air is not None and density < scene.air.density <= AIRY[1]:
            why = f"lighter than the air ({scene.air.density:.3g}), so that it rises"
        elif not LIGHTEST <= density <= HEAVIEST:
            why = "lighter than foam" if density < LIGHTEST else "denser than any matter"
        else:
            continue
        meant = f" ('{density:.3g} g/cm3' if that was meant)" if density < LIGHTEST else ""
        yield less_sure(f"{name}: {density:.3g} kg/m3, {why}; check fraction.{name}.density{meant}")


# -- A fan and money ---------------------------------------------------------------------------------------------------
TONNE, KILO = 1e3, 1e3


def trade_lines(scene: Scene) -> Iterator[tuple[str, str]]:
    """Label and text of each line of a scene that has a fan or prices."""
    point = "" if scene.air is None or scene.air.point is None else scene.air.point.words
    yield from ((label, text) for label, text in (("fan", point), ("money", _money(scene))) if text)


def fan_notices(scene: Scene) -> Iterator[Notice]:
    """Notice of a fan's curve that meets the machine's more than once."""
    point = None if scene.air is None else scene.air.point
    if point is not None and point.others:
        yield less_sure(
            f"the fan's curve meets the machine's pressure drop at {point.others} lower flow"
            f"{'s' if point.others > 1 else ''} too: the air may come to rest there; less feed.rate, or another air.fan"
        )


def _money(scene: Scene) -> str:
    """What the feed is worth at most, and what the fan's electricity costs; empty in a scene without prices."""
    price, feed = scene.price, scene.feed
    if not price.given:
        return ""
    values = price.by_bin({name: tuple(fraction.targets) for name, fraction in scene.fraction.items()})
    shares, hourly = scene.mass_shares(), HOUR / TONNE * feed.mass_flow
    most = sum(hourly * shares[name] * max(0.0, *row.values()) for name, row in values.items())
    lines = [f"at most {most:.3g} EUR/h, with every fraction where it is worth most"] if values else []
    if price.electricity is not None and scene.air is not None and not scene.air.still:
        air, point = scene.air, scene.air.point
        loss, about = bluff_loss(blocked(scene)), "about " if point is not None or not scene.body else "some "
        drop = 0.5 * air.density * loss * air.speed**2 if point is None else point.pressure
        flow = air.speed * scene.channel.width if point is None else point.flow / feed.depth
        watts = price.fan_power(drop, flow, feed.depth) or 0.0
        lines.append(f"the fan draws {about}{say(watts, 'W', 2)}, {price.electricity * watts / KILO:.2g} EUR/h")
    return "; ".join(lines)
