"""The scales of a fraction's flight, which the bounds are made of: times, speeds, meetings, before anything is flown.

Falls through the channel's uniform air with the fraction's own drag (``uniform_fall``); kinetic theory for meetings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import normals
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity, slip_correction
from ..laws.forces import FlightScales
from ..laws.forces.scales import NEAR
from ..laws.material import Material
from ..laws.restitution import restitution_at
from ..scene import Fraction, Scene
from .uniform_fall import UniformFall

__all__ = ["CROSSED", "flights", "meetings", "packing"]

Array = NDArray[np.float64]
SIZES = (0.05, 0.5, 0.95)  # mass quantiles of the granules that the bounds are taken over: 90 % lie between
# Chosen, as the round numbers of the bounds are
RECIRCULATION = 0.2  # of the air speed U: how fast air that granules fall into leaves the wake
CROSSED = 3.0  # curtain's widths of way across other granules: in, out again, and among those that linger on the slope
NEARLY = 1.001  # of the air speed: terminal velocity of a granule that hangs in upward air for long
SLOWEST_FEED = 0.1  # m/s: least fall speed of the curtain, which would be infinitely dense at rest


def flights(scene: Scene, name: str, law: str, scale: float, *, straight: bool, turbulent: bool) -> list[FlightScales]:
    """The scales of a fraction's flight in the scene's air, for a small, a median and a large granule.

    ``law`` of drag times ``scale``; ``straight``: it meets the body nearly as if there were no air. One-dimensional
    falls through uniform air with the fraction's drag: from the feed to the body, and from rest at the body (an impact
    may take all of its speed) to the channel's end.
    """
    air, fraction = scene.air, scene.fraction[name]
    assert air is not None
    density, phi = fraction.properties.density, fraction.sphericity or 1.0
    _, omega = scene.motion
    upward = air.direction == "up"
    sideways = not scene.body or any(b.points is not None or b.on in ("left", "right") for b in scene.bin.values())
    scales = []
    for diameter, factor in _granules(scene, fraction, law, scale):
        fall = UniformFall(scene, air, diameter, density, law, phi, factor)
        times = fall.times()
        arrival = max(times.arrival, scene.feed.fall_speed)
        slip = max(abs(arrival - fall.along), air.speed, abs(times.landing) - abs(fall.along))
        stays = 0.0
        if scene.body and upward and fall.settling < air.speed:  # it falls into the wake, and leaves with the air
            stays = NEAR * scene.width / (RECIRCULATION * air.speed) / (1.0 + times.tau * air.speed / scene.width)
        pull = GRAVITY * (1.0 - air.density / density)
        given = times.arrival - scene.release[1] - pull * (times.whole - times.time)
        if not scene.body:  # no more than drag at the largest slip all the way
            given = -slip * np.expm1(-times.whole / times.tau)
        thrown = arrival * _thrown(scene, fraction, arrival) if scene.body else abs(float(scene.entry[0]))
        scales.append(FlightScales(
            diameter=diameter, density=density, tau=times.tau, calm=not scene.body,
            arrival=arrival, thrown=thrown, slip=slip, settling=fall.settling,
            landing=times.landing, whole=times.whole + stays, time=times.time + stays, near=times.near + stays,
            beside=straight and not upward,
            sideways_bins=sideways,
            air_density=air.density, viscosity=air.viscosity, air_speed=air.speed, width=scene.width,
            intensity=air.turbulence, turbulent=turbulent, shaking=float(np.linalg.norm(scene.shaking)),
            omega=omega, meetings=meetings(scene, diameter, density), given=float(given),
        ))  # fmt: skip
    return scales


def _granules(scene: Scene, fraction: Fraction, law: str, scale: float) -> Iterator[tuple[float, float]]:
    """Diameters (m) and factors on the drag law, slip correction included, of small, median and large granules; where
    measured terminal velocities spread, of slow and fast ones of each size, and of those that hang in the air longest.
    """
    density, speeds = fraction.properties.density, fraction.settling(np.array(SIZES))
    if speeds is not None and not scene.body and scene.air is not None:
        speeds = np.append(speeds, np.clip(NEARLY * scene.air.speed, speeds[0], speeds[-1]))
    for diameter in dict.fromkeys(fraction.diameters(np.array(SIZES)).tolist()):
        if speeds is None:
            yield diameter, scale / float(slip_correction(diameter))
            continue
        for factor in drag_factor_for_terminal_velocity(diameter, density, speeds, *STANDARD_AIR, GRAVITY, law):
            yield diameter, float(factor)


def _thrown(scene: Scene, fraction: Fraction, arrival: float) -> float:
    """Largest sideways speed after an impact over the fall speed before it: (1 + R) n_y (n_x - f n_y) on any face."""
    granule = fraction.properties
    across, up = np.abs(np.concatenate([normals(body.outline()) for body in scene.body.values()])).T
    kick = (1.0 + restitution_at(granule.restitution, arrival * up)) * up
    return float((kick * np.maximum(across - granule.friction * up, 0.0)).max())


def meetings(scene: Scene, diameter: float, density: float) -> float:
    """How many granules one of ``diameter`` (m) and ``density`` (kg/m3) meets as it crosses the curtain, each counted
    by the share of momentum that it takes, m_j / (m_i + m_j).

    Kinetic theory: number density n_j times pi/4 (d_i + d_j)^2 times a relative way of CROSSED curtain's widths.
    """
    feed, total = scene.feed, 0.0
    for share, other in packing(scene):
        cross = 1.5 * share * (diameter + other.diameter) ** 2 / other.diameter**3
        mass, its = density * diameter**3, other.density * other.diameter**3
        total += cross * CROSSED * feed.width * its / (mass + its)
    return feed.crowding * total


def packing(scene: Scene, speeds: Mapping[str, float] | None = None) -> Iterator[tuple[float, Material]]:
    """Volume fraction of every fraction in the curtain at the body, mean over its width, and the fraction's properties.

    ``speeds`` (m/s) of the fractions there; without, that of free fall for all.
    """
    feed = scene.feed
    for name, share in scene.mass_shares().items():
        granule = scene.fraction[name].properties
        speed = max(feed.fall_speed, SLOWEST_FEED) if speeds is None else speeds[name]
        yield feed.mass_flow * share / granule.density / (feed.width * feed.depth * speed), granule
