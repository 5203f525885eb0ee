"""Streams of granules: what they do to the slope they fall on, and their discharge through an orifice.

The momentum theorem for a layer (Spade, Vaicis, Vutukuru & Irbe 2020, doi 10.22616/ERDev.2020.19.TF365, eq. (1)): in
the time dt the slope meets the mass m = W cos(b) dt A rho, each part of which takes the impulses of the one collision
function; forces are mass flow times impulse per mass:

    N = (1 + R) rho A W^2 cos^2(b),     F = f N  (slip),   rho A W^2 sin(b) cos(b)  (stick),   / (1 + 1/k)  (rolling)

rho is the mass of granules in a volume of the stream (not the density of their material), A the slope's own area, W
the closing speed. Range: dilute streams, whose granules do not meet each other; first impacts only.

An empirical law for dry, free-flowing, nearly equal granules. Range: orifice wider than about 6 granules (narrower ones
jam), container wider than about 2.5 orifices, filled higher than about one orifice, granules above 0.5 mm (finer ones
are held back by the air). Vibration is outside the range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arrays import numbers
from ..core.errors import SceneError
from .collision import approach_speed, collide, impact
from .constants import GRAVITY
from .restitution import Restitution, restitution_at

# -- What a stream of granules does to the slope it falls on -----------------------------------------------------------
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Layer:
    """A layer on a slope at one moment; arrays of the broadcast shape. Forces are those on the slope."""

    mass_flow: Array  # kg/s onto the slope
    normal: Array  # N, into the slope
    tangential: Array  # N, down the slope: the granules' friction
    power: Array  # W that the body's motion gives to the stream; negative: the stream drives the body
    velocity: Array  # (..., 2) m/s of the granules after the impact, lab frame
    sticks: NDArray[np.bool_]  # the granules' contact points come to rest


def layer(
    slope_angle: ArrayLike,
    fall_speed: ArrayLike,
    body_speed: ArrayLike,
    density: ArrayLike,
    area: ArrayLike,
    restitution: ArrayLike | Restitution,
    friction: ArrayLike,
    inertia: ArrayLike | None = None,
) -> Layer:
    """A stream of ``density`` (kg/m3 of stream) falls at ``fall_speed`` (m/s) on a slope of ``area`` (m2).

    Further arguments as in :func:`wakeflow.impact`; all broadcast. W = fall_speed + body_speed <= 0: nothing arrives.
    While the body's peak speed is below the fall speed, means over equal steps of time of a vibration are the means of
    forces and power: the mass flow itself weights the phases by W / V0. Raises SceneError for negative density or area.

    >>> now = layer(0.7854, 1.4, 0.3, density=2.0, area=0.01, restitution=0.5, friction=0.3)
    >>> float(now.mass_flow.round(4)), float(now.normal.round(4)), float(now.power.round(4))
    (0.024, 0.0433, 0.012)
    """
    slope, fall = numbers("slope_angle", slope_angle, "rad"), numbers("fall_speed", fall_speed, "m/s")
    body, stream = numbers("body_speed", body_speed, "m/s"), numbers("density", density, "kg/m^3")
    face = numbers("area", area, "m^2")
    for name, given in (("density", stream), ("area", face)):
        if not np.all(given >= 0.0):
            raise SceneError(f"{name} = {given.tolist()}: must not be negative")
    hit = impact(slope, fall, body, restitution, friction, inertia)
    b, closing, flow = np.broadcast_arrays(slope, np.maximum(fall + body, 0.0), stream * face)
    flow = closing * np.cos(b) * flow
    normal, tangential = flow * hit.normal_impulse, -flow * hit.tangential_impulse
    power = (normal * np.cos(b) + tangential * np.sin(b)) * body
    return Layer(flow, normal, tangential, power, hit.velocity, hit.sticks)


@dataclass(frozen=True)
class Layers:
    """Layers of one stream on a slope. ``parts``: each layer's share, arrays (k, ...); else all of them together."""

    parts: Layer
    mass_flow: Array  # kg/s
    normal: Array  # N, into the slope
    tangential: Array  # N, down the slope
    power: Array  # W, given by the body
    velocity: Array  # (..., 2) m/s of the centre of mass after the impact, lab frame

    def centre(self, time: ArrayLike, gravity: float = GRAVITY) -> Array:
        """Where the centre of mass is a ``time`` (s) after the impact, (..., 2) m from there: V t - g t^2 / 2.

        Free fall, without air: forces between the layers, if they met, would not move it.
        """
        return _fallen(self.velocity, numbers("time", time, "s"), gravity)

    def places(self, time: ArrayLike, gravity: float = GRAVITY) -> Array:
        """Where each layer is, (k, ..., 2) m: how far they have come apart."""
        return _fallen(self.parts.velocity, numbers("time", time, "s"), gravity)


def _fallen(velocity: Array, time: Array, gravity: float) -> Array:
    return np.asarray(velocity * time[..., None] - 0.5 * gravity * np.square(time)[..., None] * np.array([0.0, 1.0]))


def layers(
    slope_angle: ArrayLike,
    fall_speed: ArrayLike,
    body_speed: ArrayLike,
    density: Sequence[float],
    thickness: Sequence[float],
    area: ArrayLike,
    restitution: Sequence[float | Restitution],
    friction: Sequence[float],
    inertia: Sequence[float | None] | None = None,
) -> Layers:
    """A stream of k layers, each with its own ``density`` (kg/m3), ``thickness`` (m; any unit will do), restitution and
    friction: forces by superposition. The other arguments as in :func:`layer`.

    The layers meet the slope one after the other, again and again, each for its share of the thickness; so layer i is
    in the mean a stream of density rho_i h_i / sum(h), and so are fractions that fall mixed. Forces and power add up;
    the centre of mass leaves with the mass-weighted velocity. Raises SceneError where numbers of layers differ.
    """
    turning = [None] * len(density) if inertia is None else inertia
    properties = (density, thickness, restitution, friction, turning)
    if len({len(each) for each in properties}) != 1 or not len(density):
        counts = ", ".join(str(len(each)) for each in properties)
        raise SceneError(f"density, thickness, restitution, friction, inertia of {counts} layers; give one each")
    shares, density = numbers("thickness", thickness, "m"), numbers("density", density, "kg/m^3")  # type: ignore[assignment]
    if not (np.all(shares >= 0.0) and shares.sum() > 0.0):
        raise SceneError(f"thickness = {thickness}: must not be negative, nor all zero")
    shares = shares / shares.sum()
    each = [
        layer(slope_angle, fall_speed, body_speed, rho * share, area, e, f, k)
        for rho, share, e, f, k in zip(density, shares, restitution, friction, turning, strict=True)
    ]
    parts = Layer(*(np.stack([getattr(part, name) for part in each]) for name in Layer.__dataclass_fields__))
    mass = np.broadcast_to(
        (np.asarray(density) * shares).reshape(-1, *[1] * (parts.velocity.ndim - 1)), parts.velocity.shape
    )
    centre = (mass * parts.velocity).sum(axis=0) / mass.sum(axis=0)
    return Layers(
        parts, parts.mass_flow.sum(axis=0), parts.normal.sum(axis=0), parts.tangential.sum(axis=0),
        parts.power.sum(axis=0), centre,
    )  # fmt: skip


@dataclass(frozen=True)
class Load:
    """Means over samples of a stream: what it does to the walls it meets."""

    mass_flow: float  # kg/s
    normal: float  # N, into the wall
    tangential: float  # N, down the slope
    force: Array  # (2,) N on the body, lab frame
    power: float  # W that the body's motion gives to the stream
    velocity: Array  # (2,) m/s of the centre of mass after the impact, lab frame


def load_on_wall(
    mass_flow: float,
    fall_speed: Array,
    normal: Array,
    wall: Array,
    restitution: ArrayLike | Restitution,
    friction: float,
    mobility: float = 0.0,
) -> Load:
    """The load of ``mass_flow`` (kg/s) in n samples that represent equal masses: falling straight down at
    ``fall_speed`` (n,) m/s they meet walls of unit outward ``normal`` (n, 2) that move with ``wall`` (n, 2) m/s.

    The samples carry the phases in the right proportion (``flight.feed.first_contact``), so this holds for any
    vibration. ``mobility`` 1 / k. Without samples the load is zero.
    """
    if not len(fall_speed):
        return Load(0.0, 0.0, 0.0, np.zeros(2), 0.0, np.zeros(2))
    ways = normal[:, 0], normal[:, 1], wall[:, 0], wall[:, 1]
    e = restitution_at(restitution, approach_speed(0.0, -fall_speed, *ways))
    vx, vy, _, pressed, dragged = collide(0.0, -fall_speed, 0.0, *ways, e, friction, mobility, 1.0)
    change = np.stack([vx, vy + fall_speed], axis=1)
    return Load(
        mass_flow=mass_flow,
        normal=mass_flow * float(np.mean(pressed)),
        tangential=mass_flow * float(np.mean(dragged * np.sign(normal[:, 0]))),
        force=-mass_flow * change.mean(axis=0),
        power=mass_flow * float(np.mean(np.sum(change * wall, axis=1))),
        velocity=np.array([np.mean(vx), np.mean(vy)]),
    )


# -- Mass flow of granules through an orifice under gravity, without vibration -----------------------------------------
BEVERLOO_C = 0.58  # Beverloo, Leniger & van de Velde (1961); later authors: 0.55 to 0.65
BEVERLOO_K = 1.4  # spheres; the same source: 1.3 to 2.9 with the shape
STAGNANT_ANGLE = math.radians(45)  # angle of the stagnant zone's edge to the horizontal, where it is not measured


def beverloo(
    orifice: float,
    diameter: float,
    bulk_density: float,
    *,
    gravity: float = GRAVITY,
    c: float = BEVERLOO_C,
    k: float = BEVERLOO_K,
) -> float:
    """Mass flow (kg/s), W = C rho_b sqrt(g) (D - k d)^(5/2); 0 for an orifice narrower than k granules.

    ``orifice`` D and ``diameter`` d in m, ``bulk_density`` rho_b in kg/m3 (of the bed, not of a granule). A round
    orifice in a flat floor. Source: Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260.
    """
    value: float = c * bulk_density * math.sqrt(gravity) * max(0.0, orifice - k * diameter) ** 2.5
    return value


def cone_factor(half_angle: float, stagnant: float = STAGNANT_ANGLE) -> float:
    """Factor (tan(alpha) tan(phi))^-0.35 on Beverloo's rate for a cone of ``half_angle`` alpha (rad, to the vertical).

    phi is the angle of the stagnant zone's edge to the horizontal, 45 degrees where it is not known. Range: alpha < 90
    deg - phi; wider cones flow as a flat floor, factor 1. Source: Rose & Tanaka (1959), The Engineer 208, 465, as
    quoted by Nedderman (1992), Statics and Kinematics of Granular Materials; taken from secondary literature.
    """
    if half_angle >= math.pi / 2 - stagnant:
        return 1.0
    value: float = (math.tan(half_angle) * math.tan(stagnant)) ** -0.35
    return value
