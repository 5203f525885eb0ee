"""How fast the air of a scene is that a fan blows: where its curve meets the machine's pressure drop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Protocol

import numpy as np

from ..core.errors import SceneError
from ..core.number import Number
from ..laws.drag import terminal_velocity
from ..laws.operating_point import FLOWS, OFF, FanPoint, OfFlow, bluff_loss, borne, meeting
from .bins import Machine as BinPlace
from .feed import Feed
from .fraction import Fraction
from .machine import Air, Fan
from .table import Array

FASTEST = 100.0  # m/s: air.speed ends there
NEAREST = 1e-6  # m to the floor, of a feed that the scene's checks refuse
PARTS = np.array([0.1, 0.3, 0.5, 0.7, 0.9])  # of a fraction's mass, whose granules stand for it


class Blown(BinPlace, Protocol):
    """What the air and the feed pass: a scene."""

    @property
    def gravity(self) -> float: ...

    @property
    def airstream(self) -> Air: ...

    @property
    def feed(self) -> Feed: ...

    @property
    def fraction(self) -> Mapping[str, Fraction]: ...

    @property
    def level(self) -> float: ...

    @property
    def release(self) -> tuple[float, float]: ...

    def mass_shares(self) -> Mapping[str, float]: ...


def blocked(scene: Blown) -> Array:
    """The part (k,) of the channel's width that each body takes, less than all of it."""
    widths = np.array([np.ptp(body.outline()[:, 0]) for body in scene.body.values()])
    return np.minimum(widths / scene.channel.width, 0.99)


def fan_point(scene: Blown, fan: Fan) -> FanPoint:
    """Where the fan's curve meets the pressure drop of the scene's machine. Raises SceneError where it does not."""
    channel, air, depth = scene.channel, scene.airstream, scene.feed.depth
    section, beside = channel.width * depth, depth * sum(i.width * i.velocity for i in channel.inlet.values())
    laminar = 12.0 * air.viscosity / channel.width**2 * (channel.top - channel.bottom)
    linear = laminar if air.profile == "parabolic" and not scene.body else 0.0
    loss = bluff_loss(blocked(scene)) if fan.channel_loss is None else fan.channel_loss
    flows = np.linspace(0.0, fan.most, FLOWS)
    load = _feed_load(scene, np.maximum(flows - beside, 0.0) / section) / section

    def speed(flow: Array) -> Array:
        return np.maximum(flow - beside, 0.0) / section

    def rest(flow: Array) -> Array:
        drop = fan.rest_drop / fan.rest_flow**2 if fan.rest_flow else 0.0
        return np.asarray(drop * flow**2 + 0.5 * air.density * fan.rest_loss * speed(flow) ** 2)

    def through(flow: Array, part: float = 1.0) -> Array:
        return np.asarray(part * 0.5 * air.density * loss * speed(flow) ** 2 + linear * speed(flow))

    def takes(part: float) -> OfFlow:
        return lambda flow: through(flow, part) + rest(flow) + np.interp(flow, flows, load)

    try:
        flow, others = meeting(fan.gives, takes(1.0), fan.most)
    except ValueError as problem:
        raise SceneError(f"air.fan: its curve does not meet the machine's pressure drop: {problem}") from None
    air_speed = float(speed(np.array(flow)))
    if not 0.0 < air_speed <= FASTEST:
        raise SceneError(
            f"air.fan: the air would blow at {air_speed:.3g} m/s (allowed: above 0, up to {FASTEST:g} m/s)"
        )
    ends = [air_speed, air_speed]
    if fan.channel_loss is None and scene.body:
        ends = [_speed_or(end, fan, takes(part), speed) for end, part in ((0.0, OFF), (FASTEST, 1.0 / OFF))]
    at = np.array(flow)
    return FanPoint(
        Number(air_speed, *ends), flow, float(fan.gives(at)), float(through(at)), float(rest(at)),
        float(np.interp(flow, flows, load)), others,
    )  # fmt: skip


def _speed_or(end: float, fan: Fan, takes: OfFlow, speed: OfFlow) -> float:
    """The air's speed (m/s) where the machine ``takes`` more or less, or that ``end`` where the curves do not meet."""
    try:
        return float(speed(np.array(meeting(fan.gives, takes, fan.most)[0])))
    except ValueError:
        return end


def _feed_load(scene: Blown, speeds: Array) -> Array:
    """Weight (N) of the feed that air of ``speeds`` (n,) m/s bears, what granules take to come to their speed taken
    off; negative in downward air, where it drives. None without a feed.rate, and of what gravity pulls across.
    """
    along = scene.gravity * math.cos(scene.channel.tilt)
    if not scene.feed.rate or along < 1e-6:
        return np.zeros(len(speeds))
    above, start = scene.release
    channel, begins = scene.channel, scene.level + above
    room = max(begins - channel.bottom, NEAREST), max(channel.top - begins, channel.width)
    sign, total = (1.0 if scene.airstream.direction == "up" else -1.0), np.zeros(len(speeds))
    for name, share in scene.mass_shares().items():
        settling = _settling(scene, scene.fraction[name]) * math.sqrt(math.cos(scene.channel.tilt))
        given = _borne(tuple(settling.tolist()), tuple((-sign * speeds).tolist()), start, *room, along)
        total += sign * scene.feed.rate * share * given
    return total


@lru_cache(maxsize=64)  # a scene is read more than once
def _borne(settling: tuple[float, ...], air: tuple[float, ...], *rest: float) -> Array:
    return np.asarray(borne(np.array(settling), np.array(air), *rest).mean(axis=1))


def _settling(scene: Blown, fraction: Fraction) -> Array:
    """Terminal velocities (m/s) of granules at the PARTS of a fraction's mass: as measured, else by its drag law."""
    measured = fraction.settling(PARTS)
    if measured is not None:
        return measured
    if fraction.measured_settling is not None:
        return np.array([fraction.measured_settling[-1]])
    air, law = scene.airstream, (fraction.drag_law, fraction.roundness)
    sizes, density = fraction.diameters(PARTS), fraction.properties.density
    return np.abs(terminal_velocity(sizes, density, air.density, air.viscosity, scene.gravity, *law))
