"""What a plan says of a fan and of money before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator

from ..core.graded import Notice, less_sure
from ..core.quantities import say
from ..laws.operating_point import HOUR, bluff_loss
from ..scene import Scene
from ..scene.fan_speed import blocked

TONNE, KILO = 1e3, 1e3


def trade_lines(scene: Scene) -> Iterator[tuple[str, str]]:
    """Label and text of each line of a scene that has a fan or prices."""
    point = "" if scene.air is None or scene.air.point is None else scene.air.point.words
    yield from ((label, text) for label, text in (("fan", point), ("money", _money(scene))) if text)


def fan_notices(scene: Scene) -> Iterator[Notice]:
    """Of a fan's curve that meets the machine's more than once."""
    point = None if scene.air is None else scene.air.point
    if point is not None and point.others:
        yield less_sure(
            f"the fan's curve meets the machine's pressure drop at {point.others} lower flow"
            f"{'s' if point.others > 1 else ''} too: the air may come to rest there; less feed.rate, or another air.fan"
        )


def _money(scene: Scene) -> str:
    """What the feed is worth at most, and what the fan's electricity costs; empty in a scene without prices."""
    price, feed = scene.price, scene.feed
    if not price.asked:
        return ""
    values = price.by_bin({name: tuple(one.targets) for name, one in scene.fraction.items()})
    shares, hourly = scene.mass_shares(), HOUR / TONNE * feed.mass_flow
    most = sum(hourly * shares[name] * max(0.0, *row.values()) for name, row in values.items())
    told = [f"at most {most:.3g} EUR/h, with every fraction where it is worth most"] if values else []
    if price.electricity is not None and scene.air is not None and not scene.air.still:
        air, point = scene.air, scene.air.point
        loss, about = bluff_loss(blocked(scene)), "about " if point is not None or not scene.body else "some "
        drop = 0.5 * air.density * loss * air.speed**2 if point is None else point.pressure
        flow = air.speed * scene.channel.width if point is None else point.flow / feed.depth
        watts = price.fan_power(drop, flow, feed.depth) or 0.0
        told.append(f"the fan draws {about}{say(watts, 'W', 2)}, {price.electricity * watts / KILO:.2g} EUR/h")
    return "; ".join(told)
