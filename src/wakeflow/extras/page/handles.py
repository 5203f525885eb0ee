"""What can be dragged in the drawing of a machine, and which keys of its scene follow."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from ...core.quantities import converted, split_quantity
from ...core.record import JsonTable
from ...scene import Body, Scene
from ...scene.bins import Grip
from ...scene.messages import unit_of, units_in
from ...scene.schema import at

STEPS = 400.0  # of a drag over the width of the channel, and so the length that the arrow keys move by
ASIDE = 0.14  # in widths of the channel: where its ends are taken hold of, between most dividers
TURN = math.radians(0.5)  # of a drag that turns
Changes = dict[str, object]  # dotted keys, SI
Move = Callable[[float, float], Changes]


@dataclass(frozen=True)
class Handle:
    """A point (m) that is dragged along ``ways`` (x, y or xy); ``move`` says which keys take which values with it."""

    name: str
    label: str
    key: str  # the first that follows: where it stands in the form
    point: tuple[float, float]
    ways: str
    move: Move

    def table(self) -> dict[str, object]:
        """Table of the handle for the page."""
        return {"name": self.name, "label": self.label, "key": self.key, "at": self.point, "ways": self.ways}


def step_of(scene: Scene) -> float:
    """The length (m) that drags are rounded to: 1, 2 or 5 times a power of ten."""
    wanted = scene.channel.width / STEPS
    power = 10.0 ** math.floor(math.log10(wanted))
    return min((power * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda step: abs(math.log(step / wanted)))


def handles_of(scene: Scene) -> dict[str, Handle]:
    """All handles of a machine by name."""
    parts = (_channel(scene), _bodies(scene), _feed(scene), _bins(scene), _inlets(scene))
    return {handle.name: handle for part in parts for handle in part}


def dragged(handle: Handle, scene: Scene, data: JsonTable, x: float, y: float) -> dict[str, str]:
    """What is to be typed at which key of a scene's ``data`` when a handle is dragged to (x, y) m: rounded, in the
    units that it is written in.
    """
    step, units = step_of(scene), {"m": "mm", "rad": "deg"} | units_in(data)
    moved = {key: _rounded(value, step if unit_of(key) == "m" else TURN) for key, value in handle.move(x, y).items()}
    return {key: _typed(value, key, at(data, tuple(key.split("."))), units) for key, value in moved.items()}


def _rounded(value: object, step: float) -> object:
    if isinstance(value, list):
        return [_rounded(part, step) for part in value]
    assert isinstance(value, float)
    return step * round(value / step)


def _typed(value: object, key: str, before: object, units: Mapping[str, str]) -> str:
    """A value as TOML: in the unit that was written there before, else in the one that the file writes most."""
    if isinstance(value, list):
        inner = before if isinstance(before, list) else []
        typed = [_typed(item, key, inner[i] if i < len(inner) else "", units) for i, item in enumerate(value)]
        return f"[{', '.join(typed)}]"
    assert isinstance(value, float)
    if isinstance(before, int | float):
        return f"{value:.6g}"
    unit = unit_of(key)
    written = split_quantity(before) if isinstance(before, str) else None
    spoken = written[1] if written and written[1] else units.get(unit, unit)
    shown = value if spoken == unit else converted(value, unit, spoken)
    return f'"{float(f"{shown:.6g}"):g} {spoken}"'


def _channel(scene: Scene) -> Iterator[Handle]:
    channel, middle = scene.channel, (scene.channel.top + scene.channel.bottom) / 2
    yield Handle("channel right", "right wall: width of the channel", "channel.width", (channel.width / 2, middle), "x",
                 partial(_width, "channel.width", 0.0))  # fmt: skip
    for end, y in (("top", channel.top), ("bottom", channel.bottom)):
        yield Handle(f"channel {end}", f"{end} of the channel", f"channel.{end}", (ASIDE * channel.width, y), "y",
                     partial(_coordinate, f"channel.{end}", 1))  # fmt: skip


def _coordinate(key: str, which: int, x: float, y: float) -> Changes:
    return {key: (x, y)[which]}


def _bodies(scene: Scene) -> Iterator[Handle]:
    for name, body in scene.body.items():
        key, centre = f"body.{name}", (float(body.at[0]), float(body.at[1]))
        yield Handle(f"{key} place", f"{name}: where it is", f"{key}.at", centre, "xy",
                     partial(_place, f"{key}.at"))  # fmt: skip
        outline, given = body.outline(), body.given
        if "points" in given:
            for i, (a, b) in enumerate(given["points"]):
                yield Handle(f"{key} corner {i + 1}", f"{name}: corner {i + 1}", f"{key}.points",
                             (centre[0] + a, centre[1] + b), "xy", partial(_corner, key, body, i))  # fmt: skip
        elif "length" in given:
            half, side = given["length"] / 2, -1.0 if given.get("descends") == "left" else 1.0
            x, y = side * half * math.cos(given["slope_angle"]), -half * math.sin(given["slope_angle"])
            point = centre[0] + x, centre[1] + y
            yield Handle(f"{key} end", f"{name}: length and slope", f"{key}.length", point, "xy",
                         partial(_plate, key, body))  # fmt: skip
        else:
            right = float(outline[:, 0].max())
            yield Handle(f"{key} width", f"{name}: width", f"{key}.width", (right, float(_level(body, right))), "x",
                         partial(_width, f"{key}.width", centre[0]))  # fmt: skip
        if ("slope_angle" in given and "length" not in given) or "height" in given:
            field = f"{key}.{'height' if 'height' in given else 'slope_angle'}"
            yield Handle(f"{key} slope", f"{name}: slope", field, (centre[0], float(outline[:, 1].max())), "y",
                         partial(_slope, key, body))  # fmt: skip


def _width(key: str, middle: float, x: float, _: float) -> Changes:
    return {key: 2.0 * abs(x - middle)}


def _place(key: str, x: float, y: float) -> Changes:
    return {key: [x, y]}


def _level(body: Body, right: float) -> float:
    """y (m) of the corner at its right end."""
    outline = body.outline()
    return float(outline[outline[:, 0] >= right - 1e-12][0, 1])


def _corner(key: str, body: Body, which: int, x: float, y: float) -> Changes:
    points = [[float(a), float(b)] for a, b in body.given["points"]]
    points[which] = [x - body.at[0], y - body.at[1]]
    return {f"{key}.points": points}


def _plate(key: str, body: Body, x: float, y: float) -> Changes:
    """Length and slope of a plate whose lower end is dragged: half of its length and its fall from the middle."""
    right, down = abs(x - body.at[0]), body.at[1] - y
    return {f"{key}.length": 2.0 * math.hypot(right, down), f"{key}.slope_angle": math.atan2(down, right)}


def _slope(key: str, body: Body, _: float, y: float) -> Changes:
    """Height or slope of a body whose top is dragged: what stands over the centre is a fixed part of its height."""
    grown = max(y - body.at[1], 1e-9) / (float(body.outline()[:, 1].max()) - body.at[1])
    given = body.given
    if "height" in given:
        return {f"{key}.height": given["height"] * grown}
    return {f"{key}.slope_angle": math.atan(math.tan(given["slope_angle"]) * grown)}


def _feed(scene: Scene) -> Iterator[Handle]:
    feed, level = scene.feed, scene.level
    top = level + (scene.release[0] if scene.plumb.upright else 0.0)
    yield Handle("feed place", "feed: its middle", "feed.position", (feed.position, top), "x",
                 partial(_coordinate, "feed.position", 0))  # fmt: skip
    yield Handle("feed width", "feed: its width", "feed.width", (feed.position + feed.width / 2, top), "x",
                 partial(_width, "feed.width", feed.position))  # fmt: skip
    if feed.height and scene.body and scene.plumb.upright:
        yield Handle("feed height", "feed: its height over the body", "feed.height",
                     (feed.position - feed.width / 2, top), "y",
                     lambda _, y: {"feed.height": max(y - level, 0.0)})  # fmt: skip


def _bins(scene: Scene) -> Iterator[Handle]:
    """A divider moves the ends of the bins on both of its sides; corners of a line of points move alone."""
    joined: dict[tuple[str, float], list[tuple[str, tuple[float, float], Grip]]] = {}
    for name, bin_ in scene.bin.items():
        for grip in bin_.grips(scene):
            key, at = f"bin.{name}.{grip.key}", (round(float(grip.at[0]), 9), round(float(grip.at[1]), 9))
            if grip.joins is not None:
                joined.setdefault(grip.joins, []).append((key, at, grip))
                continue
            yield Handle(f"bin.{name} {grip.label}", f"bin {name}: {grip.label}", key, at, grip.axis,
                         partial(_moved, (key,), grip))  # fmt: skip
    for _, parts in sorted(joined.items()):
        keys, (_, at, grip) = tuple(key for key, *_ in parts), parts[0]
        label = f"divider {' | '.join(dict.fromkeys(key.split('.')[1] for key in keys))}"
        yield Handle(f"divider {keys[0]}", label, keys[0], at, grip.axis, partial(_moved, keys, grip))


def _moved(keys: tuple[str, ...], grip: Grip, x: float, y: float) -> Changes:
    return dict.fromkeys(keys, grip.moved(x, y))


def _inlets(scene: Scene) -> Iterator[Handle]:
    half = scene.channel.width / 2
    for name, inlet in scene.channel.inlet.items():
        key = f"channel.inlet.{name}.position"
        yield Handle(key, f"stream {name}: its place", key, (-half if inlet.side == "left" else half, inlet.position),
                     "y", partial(_coordinate, key, 1))  # fmt: skip
