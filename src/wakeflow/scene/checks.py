"""What the tables of a scene must agree on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.geometry import distance_between, runs_into, wall_edge
from ..core.quantities import metres, say, spoken
from ..core.registry import did_you_mean
from .measured import Measured
from .pictures import STANDARD_FIGURES, Streamlines
from .rungs import rungs
from .scene_tables import SceneTables
from .table import RESERVED_BIN
from .uncertainty import NEVER_ABOVE, OF_FRACTION, OF_SCENE, TOGETHER, margins_of, wrong_ties

APART = 0.02  # widths of the first body: bodies that are nearer to each other, or to an opening, cannot be meshed
STAYING = ("capture_speed", "sticks")  # of a fraction: what stays at a wall
OVER_THE_TOP = "top"  # the bin of what upward air carries out of the channel, where the scene has none up there
FLOWN_APART = ("collisions.restitution", "collisions.friction")  # at either end, not drawn with the other numbers
Array = NDArray[np.float64]


def _bodies_apart(scene: SceneTables) -> Iterator[str]:
    outlines = [(name, body.outline()) for name, body in scene.body.items()]
    for (name, item), (other_name, other) in itertools.combinations(outlines, 2):
        gap = distance_between(item, other)
        if gap < APART * scene.width:
            how = "touch each other" if gap == 0.0 else f"are only {metres(gap, 3)} apart"
            yield f"body.{name} and body.{other_name} {how} (allowed: at least {metres(APART * scene.width, 3)})"


def _channel_stands(scene: SceneTables) -> Iterator[str]:
    channel = scene.channel
    if not channel.bottom < channel.top:
        yield f"channel.bottom = {metres(channel.bottom)} must be below channel.top = {metres(channel.top)}"


def _body_fits(scene: SceneTables) -> Iterator[str]:
    channel = scene.channel
    swing_x, swing_y = np.abs(scene.motion[0])
    for name, body in scene.body.items():
        (left, low), (right, high) = body.outline().min(0), body.outline().max(0)
        standing = wall_edge(body.outline(), channel.width / 2)
        reach = max(
            0.0 if standing and standing.side == side else off for side, off in (("left", -left), ("right", right))
        )
        if reach >= 0.49 * channel.width:
            yield (
                f"body.{name} reaches x = {metres(reach)}: no room beside it in channel.width = "
                f"{metres(channel.width)}; leave a gap to the wall (allowed: x below {metres(0.49 * channel.width)}), "
                f"or one edge on it (x = {metres(channel.width / 2)})"
            )
        elif standing and scene.vibration is not None:
            yield f"body.{name} stands on the {standing.side} wall, and [vibration] moves all bodies; leave either out"
        elif low <= channel.bottom or high >= channel.top:
            inside = f"{metres(channel.bottom)} to {metres(channel.top)}"
            yield f"body.{name} reaches from y = {metres(low)} to {metres(high)}, out of the channel, {inside}"
        elif swing_x > 0.5 * (channel.width / 2 - reach) or swing_y > 0.5 * min(
            low - channel.bottom, channel.top - high
        ):
            amplitude = math.hypot(swing_x, swing_y)
            yield f"vibration: an amplitude of {metres(amplitude, 3)} brings body.{name} too near to the channel's ends"


def _standing_bodies_leave_room(scene: SceneTables) -> Iterator[str]:
    """Bins and streams on a wall keep off the bodies that stand on it."""
    taken = [
        *((f"bin.{name}", item.on, *item.ends) for name, item in scene.on_sides().items()),
        *((f"channel.inlet.{name}", item.side, *item.span) for name, item in scene.channel.inlet.items()),
    ]
    for name, body in scene.body.items():
        edge = wall_edge(body.outline(), scene.channel.width / 2)
        for key, side, low, high in taken:
            if edge is not None and side == edge.side and min(high, edge.high) > max(low, edge.low):
                reach = f"from y = {metres(edge.low)} to {metres(edge.high)}"
                yield f"{key} is where body.{name} stands on the {side} wall, {reach}; move either"


def _feed_fits(scene: SceneTables) -> Iterator[str]:
    feed, half = scene.feed, scene.channel.width / 2
    sizes_of = {name: float(fraction.diameters(np.array([0.99]))[0]) for name, fraction in scene.fraction.items()}
    for name, size in sizes_of.items():
        if size > scene.width:
            what = "body" if scene.body else "channel"
            yield f"fraction.{name}: granules of {metres(size, 3)} are wider than the {what} ({metres(scene.width, 3)})"
    if scene.plumb.upright and abs(feed.position) + feed.width / 2 + 0.5 * max(sizes_of.values()) > half:
        place = f"feed.position = {metres(feed.position)}"
        yield f"feed.width = {metres(feed.width)} at {place} touches the channel's walls"
    if not scene.body:
        return
    if feed.mode == "injected" and scene.obstacles:
        names = ", ".join(f"body.{name}" for name in scene.obstacles)
        yield f"feed.mode = 'injected': {names} may be met before the first body; choose auto or resolved"
    x = scene.plumb.seen(next(iter(scene.body.values())).outline())[:, 0]
    left, right = feed.position - feed.width / 2, feed.position + feed.width / 2
    if feed.start == "resting" and (left < x.min() or right > x.max()):
        reach = f"from {metres(x.min())} to {metres(x.max())}"
        yield f"feed: granules lie from x = {metres(left)} to {metres(right)}, the body reaches {reach}"
    level = min(scene.level + scene.release[0], scene.channel.top)
    starts = scene.plumb.highest(np.array([left, right]), np.zeros(2), 0.0)
    curtain = scene.plumb.placed(np.stack([[left, right], np.minimum(scene.level + scene.release[0], starts)], axis=1))
    for name, body in list(scene.body.items())[1 if scene.plumb.upright else 0 :]:
        if runs_into(curtain, body.outline()):
            yield f"feed: the curtain begins at y = {metres(level, 3)}, inside body.{name}; move either"
    if feed.position - feed.width / 2 > x.max() or feed.position + feed.width / 2 < x.min():
        reach = f"x from {metres(x.min())} to {metres(x.max())}"
        yield f"feed.position = {metres(feed.position)}: the curtain falls past the body ({reach})"


def _turned_feed_fits(scene: SceneTables) -> Iterator[str]:
    """What a feed that hangs at an angle to the channel cannot be, and that it comes into the channel at all."""
    plumb, feed = scene.plumb, scene.feed
    if plumb.upright:
        return
    for key, value in (("start", "resting"), ("mode", "injected")):
        if getattr(feed, key) == value:
            yield f"feed.{key} = {value!r} is for a channel that stands upright; leave it out, or channel.tilt"
    reach = 0.5 * feed.width + 0.5 * max(float(f.diameters(np.array([0.99]))[0]) for f in scene.fraction.values())
    x, y = plumb.placed(np.array([[feed.position + side * reach, scene.level] for side in (-1, 1)])).T
    if np.any(np.abs(x) > scene.channel.width / 2) or np.any(y < scene.channel.bottom):
        hangs = f"from x = {metres(x[0], 3)}, y = {metres(y[0], 3)} to {metres(x[1], 3)}, {metres(y[1], 3)}"
        keys = "feed.position" if scene.body else "feed.position or feed.level"
        yield f"feed.width = {metres(feed.width)}: the curtain hangs {hangs}, out of the channel; change {keys}"
    elif plumb.way(plumb.down) <= 2.0 * reach - feed.width:
        yield f"feed.position = {metres(feed.position)}: gravity leads from there straight out of the channel; move it"


def _tracked_impact(scene: SceneTables) -> Iterator[str]:
    """Refuse what stays at a wall, a bin on the first body and a pivot where the first impact is no tracked one."""
    if scene.vibration is not None and scene.vibration.pivot is not None and scene.feed.mode == "injected":
        yield "vibration.pivot: feed.mode = 'injected' is of bodies that do not turn; choose auto or resolved"
    first = next(iter(scene.body), None)
    for name in (name for name, item in scene.bin.items() if item.body is not None and item.body == first):
        if scene.feed.mode == "injected":
            yield f"bin.{name}.on = {first!r}: feed.mode = 'injected' lets all rebound; choose auto or resolved"
        if scene.feed.start == "resting":
            yield f"bin.{name}.on = {first!r}: granules that lie on the body would not leave it; let them fall"
    keys = [(f"fraction.{name}.{key}", getattr(item, key)) for name, item in scene.fraction.items() for key in STAYING]
    for key in (key for key, given in keys if given):
        if scene.feed.mode == "injected":
            yield f"{key}: feed.mode = 'injected' lets all rebound; choose auto or resolved"
        if scene.feed.start == "resting":
            yield f"{key}: of granules that lie on the body none would leave it; leave it out"


def _rate_can_fall(scene: SceneTables) -> Iterator[str]:
    """Refuse a curtain that would be denser than its granules: the rate of another unit than was meant."""
    feed, speed = scene.feed, scene.feed.fall_speed
    if not feed.rate or feed.start == "resting" or speed == 0.0:
        return
    densest = max(fraction.properties.density for fraction in scene.fraction.values())
    most = densest * speed * feed.width * feed.depth
    if feed.rate > most:
        alone = not spoken("kg/s") and feed.rate / 3600 <= most
        hint = f"; '{str(feed.rate).removesuffix('.0')} kg/hour' meant?" if alone else ""
        curtain = f"a curtain of {metres(feed.width)} x {metres(feed.depth)} that falls at {say(speed, 'm/s', 3)}"
        allowed = f"(allowed: at most {say(most, 'kg/s', 3)})"
        yield f"feed.rate = {say(feed.rate, 'kg/s')}: {curtain} would be denser than its granules {allowed}{hint}"


def _body_needed(scene: SceneTables) -> Iterator[str]:
    """Check the keys that go only with a body, or only without one."""
    if not scene.body:
        yield from _goes_without_a_body(scene)
        yield from _air_is_known_without_a_body(scene)
        return
    for key, given in (("level", None), ("direction", None), ("scatter", 0.0)):
        if getattr(scene.feed, key) != given:
            first = next(iter(scene.body))
            yield f"feed.{key}: for a channel without a body; here the curtain falls onto body.{first}"


def _goes_without_a_body(scene: SceneTables) -> Iterator[str]:
    feed, channel = scene.feed, scene.channel
    if not channel.bottom < scene.level <= channel.top:
        yield f"feed.level = {metres(scene.level)} lies outside channel.bottom .. channel.top"
    if feed.start == "resting":
        yield "feed.start = 'resting': there is no body to lie on; add one, or leave start out"
    if feed.mode == "injected":
        yield "feed.mode = 'injected': there is no body to meet; choose auto or resolved"
    if scene.vibration is not None:
        yield "vibration: there is no body that could vibrate; add one, or leave the table out"


def _air_is_known_without_a_body(scene: SceneTables) -> Iterator[str]:
    air, channel = scene.air, scene.channel
    if channel.inlet:
        yield "channel.inlet: secondary streams are computed only round a body; add one, or leave them out"
    if air is not None and air.case:
        yield "air.case: give the bodies of the case; without one the air is known and needs no case"
    elif air is not None and not air.still and (air.profile == "parabolic") != (channel.walls == "no-slip"):
        yield (
            f"air.profile = {air.profile!r} with channel.walls = {channel.walls!r}: without a body the air is uniform "
            "between slip walls, or parabolic (laminar) between no-slip walls"
        )


def _shares_add_up(scene: SceneTables) -> Iterator[str]:
    given = [f.mass_share for f in scene.fraction.values()]
    if any(given) and not all(given):
        yield "fraction: give mass_share for every fraction or for none"
    total = sum(scene.mass_shares().values())
    if abs(total - 1.0) > 1e-6:
        yield f"fraction: mass_share values add up to {total:g}, they must add up to 1"


def _bins_exist(scene: SceneTables) -> Iterator[str]:
    if RESERVED_BIN in scene.bin:
        yield f"bin.{RESERVED_BIN}: this name is reserved for granules that reach no bin"
    for name, fraction in scene.fraction.items():
        known = list(scene.bin)
        if len(set(fraction.targets)) < len(fraction.targets):
            yield f"fraction.{name}.target names a bin twice"
        for target in fraction.targets:
            if target not in known:
                hint = f"no such bin{did_you_mean(target, known)} (known: {', '.join(known)})"
                yield f"fraction.{name}.target = {target!r}: {hint}"
    for name, collector in scene.bin.items():
        if wrong := [f"bin.{name}{text}" for text in collector.wrong(scene)]:
            yield from wrong
            continue
        half, slack = scene.channel.width / 2, 1e-9 * scene.channel.width
        x, y = collector.line(scene).T
        if (
            np.abs(x).max() > half + slack
            or y.min() < scene.channel.bottom - slack
            or y.max() > scene.channel.top + slack
        ):
            reach = f"x from {metres(x.min())} to {metres(x.max())}, y from {metres(y.min())} to {metres(y.max())}"
            duct = f"x within {metres(half)} of 0, y from {metres(scene.channel.bottom)} to {metres(scene.channel.top)}"
            yield f"bin.{name} lies outside the channel: {reach} (allowed: {duct})"


def _bins_apart(scene: SceneTables) -> Iterator[str]:
    collecting: dict[str, str] = {}
    for name, bin_ in scene.bin.items():
        if bin_.body is not None and (other := collecting.setdefault(bin_.body, name)) != name:
            yield f"bin.{other} and bin.{name} are both on body.{bin_.body}"
    placed = ((item.on, *item.ends, name) for name, item in scene.on_sides().items())
    reached: tuple[str, float, float, str] | None = None  # of those before on its side, the bin that reaches farthest
    for item in sorted(placed):
        if reached is None or item[0] != reached[0]:
            reached = item
            continue
        low, high = item[1], min(item[2], reached[2])
        if high - low > 1e-9:
            yield f"bin.{reached[3]} and bin.{item[3]} overlap from {metres(low)} to {metres(high)}"
        reached = max(reached, item, key=lambda bin_: bin_[2])


def _inlets_fit(scene: SceneTables) -> Iterator[str]:
    channel, placed = scene.channel, list(scene.channel.inlet.items())
    if placed and (scene.air is None or scene.air.still):
        yield "channel.inlet: secondary air streams need an [air] table with a speed above 0"
    for name, item in placed:
        low, high = item.span
        if low <= channel.bottom or high >= channel.top:
            reach = f"from y = {metres(low)} to {metres(high)}"
            yield f"channel.inlet.{name} reaches {reach}, outside channel.bottom .. channel.top"
    for (name, item), (other_name, other) in itertools.combinations(placed, 2):
        if item.side == other.side and abs(item.position - other.position) < (item.width + other.width) / 2:
            yield f"channel.inlet.{name} and channel.inlet.{other_name} overlap"
    for name, item in placed:
        low, high = item.span
        for bin_name, bin_ in scene.on_sides(item.side).items():
            if min(high, bin_.to) - max(low, bin_.start) > 1e-9:
                yield f"bin.{bin_name} overlaps channel.inlet.{name}"


def _pictures_fit(scene: SceneTables) -> Iterator[str]:
    known = list(scene.fraction)
    for name, picture in scene.picture.items():
        key = f"picture.{name}"
        if name in STANDARD_FIGURES:
            yield f"{key}: every run draws one of this name; choose another"
        for item in picture.fractions:
            if item not in known:
                yield f"{key}.fractions: no fraction {item!r}{did_you_mean(item, known)} (known: {', '.join(known)})"
        if isinstance(picture, Streamlines) and (scene.air is None or scene.air.still or not scene.body):
            what = "an [air] table" if scene.air is None else "air that moves" if scene.air.still else "a body"
            yield f"{key}: streamlines need {what}"
        low, high = scene.channel.bottom, scene.channel.top
        for level in (y for y in getattr(picture, "levels", ()) if not low < y < high):
            yield f"{key}.levels: y = {metres(level)} is not in the channel, {metres(low)} to {metres(high)}"
        wanted, most = getattr(picture, "body_speed", None), abs(float(scene.shaking[1]))
        if wanted is not None and wanted > most:
            peak = f"the body rises by at most {say(most, 'm/s', 3)}"
            yield f"{key}.body_speed = {say(wanted, 'm/s')}: {peak}; change [vibration]"


def _rung_fits(scene: SceneTables) -> Iterator[str]:
    if scene.air is None and rungs[scene.numerics.rung].needs_air:
        yield f"numerics.rung = {scene.numerics.rung!r} needs an [air] table"


def _uncertain_numbers_exist(scene: SceneTables) -> Iterator[str]:
    units = {f"fraction.{name}.{key}": unit for name in scene.fraction for key, unit in OF_FRACTION.items()} | OF_SCENE
    for key in margins_of(scene.uncertainty):
        if key not in units:
            hint = did_you_mean(key, [*units, TOGETHER, NEVER_ABOVE])
            able = f"{', '.join(OF_SCENE)}, and of a fraction {', '.join(OF_FRACTION)}"
            yield f"uncertainty.{key}: no number that takes an uncertainty{hint} (which do: {able})"
    yield from wrong_ties(scene.uncertainty, {key: unit for key, unit in units.items() if key not in FLOWN_APART})


def _limits_exist(scene: SceneTables) -> Iterator[str]:
    yield from scene.limit.mistakes([name for name, item in scene.fraction.items() if item.targets], scene.products)


def _prices_exist(scene: SceneTables) -> Iterator[str]:
    targets = {name: tuple(item.targets) for name, item in scene.fraction.items()}
    over = [OVER_THE_TOP] if scene.air is not None and scene.air.rises else []
    yield from scene.price.mistakes(targets, list(dict.fromkeys([*scene.bin, *over])))
    if scene.air is not None and scene.air.fan is not None and scene.price.other_drop:
        yield "price.other_drop: the fan's pressure is known from its curve; write the other drop as air.fan.rest_drop"


def _trays_known(scene: SceneTables) -> Iterator[str]:
    """Trays are of the scene's fractions and bins, and those of one fraction are given in one way."""
    known = [(name, place) for name in scene.fraction for place in (*scene.bin, RESERVED_BIN)]
    try:
        Measured.of(scene.measured).weights(known, dict.fromkeys(scene.fraction, 1.0))
    except SceneError as problem:
        yield str(problem)


CHECKS: tuple[Callable[[SceneTables], Iterator[str]], ...] = (
    _bodies_apart,
    _channel_stands,
    _body_fits,
    _standing_bodies_leave_room,
    _feed_fits,
    _turned_feed_fits,
    _rate_can_fall,
    _tracked_impact,
    _body_needed,
    _shares_add_up,
    _bins_exist,
    _bins_apart,
    _inlets_fit,
    _pictures_fit,
    _rung_fits,
    _uncertain_numbers_exist,
    _limits_exist,
    _prices_exist,
    _trays_known,
)
