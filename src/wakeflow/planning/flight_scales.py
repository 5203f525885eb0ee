"""The scales of a fraction's flight, which the bounds are made of: times, speeds, meetings, before anything is flown.

Falls through the channel's uniform air with the fraction's own drag (``uniform_fall``); meetings as given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity, slip_correction
from ..laws.forces import FlightScales
from ..laws.forces.force import REACH
from ..scene import Fraction, Scene
from .collision_rates import RECIRCULATION, Encounters, ejection_speed
from .uniform_fall import FallTimes, UniformFall

Array = NDArray[np.float64]
SIZES = (0.05, 0.5, 0.95)  # mass quantiles of the granules that the bounds are taken over: 90 % lie between
NEARLY = 1.001  # of the air speed: terminal velocity of a granule that hangs in upward air for long; chosen


def flights(
    scene: Scene,
    name: str,
    law: str,
    scale: float,
    met: Encounters,
    *,
    straight: bool,
    turbulent: bool,
    shedding: bool = False,
) -> list[FlightScales]:
    """The scales of a fraction's flight in the scene's air, for a small, a median and a large granule.

    ``law`` of drag times ``scale``; ``met``: which others it meets; ``straight``: it meets the body nearly as if there
    were no air; ``shedding``: the airflow is resolved in time. One-dimensional falls through uniform air with the
    fraction's drag: from the feed to the body, and from rest at the body (an impact may take all of its speed) to the
    channel's end.
    """
    air, fraction = scene.airstream, scene.fraction[name]
    density, phi = fraction.properties.density, fraction.roundness
    _, omega = scene.motion
    kept = bool(scene.body) and set(scene.all_kept) == scene.body.keys()
    upward, aside = air.rises, 0.0 if kept else abs(float(scene.entry @ scene.plumb.across))
    aside += 2.0 * math.sin(scene.feed.scatter) * scene.feed.fall_speed
    scales = []
    for diameter, factor in _granules(scene, fraction, law, scale):
        fall = UniformFall(scene, air, diameter, density, law, phi, factor)
        times = fall.times()
        arrival = max(times.arrival, scene.feed.fall_speed)
        slip = max(abs(complex(arrival - fall.along, fall.across)), air.speed, abs(times.landing) - abs(fall.along))
        stays = 0.0
        if scene.body and upward and abs(fall.settling) < air.speed:  # it falls into the wake, and leaves with the air
            stays = REACH * scene.width / (RECIRCULATION * air.speed) / (1.0 + times.tau * air.speed / scene.width)
        thrown = ejection_speed(scene, fraction, arrival) * arrival if scene.body and not kept else aside
        scales.append(FlightScales(
            diameter=diameter, density=density, tau=times.tau, calm=not scene.body or air.still,
            arrival=arrival, thrown=thrown, slip=slip, settling=abs(fall.settling),
            landing=times.landing, whole=times.whole + stays, time=times.time + stays, near=times.near + stays,
            beside=straight and not upward,
            sideways_bins=_sideways_bins(scene),
            air_density=air.density, viscosity=air.viscosity, air_speed=air.speed, width=scene.width,
            intensity=air.turbulence, turbulent=turbulent, shaking=float(np.linalg.norm(scene.shaking)),
            omega=omega, meetings=met.heavier, knock=met.knock, shedding=shedding, kept=kept,
            given=_given_by_drag(scene, times, density, slip),
            temperature=air.temperature, mean_free_path=air.mean_free_path, gravity=scene.gravity,
        ))  # fmt: skip
    return scales


def _sideways_bins(scene: Scene) -> bool:
    """Whether shifts along the air count in full: a bin is on a wall or in the air, or granules come to the walls."""
    return any(place.stands for place in scene.bin.values()) or not (scene.body and scene.plumb.upright)


def _given_by_drag(scene: Scene, times: FallTimes, density: float, slip: float) -> float:
    """Velocity (m/s) that drag gives a granule on its way to the body; without one no more than it would at the largest
    ``slip`` all the way.
    """
    if not scene.body:
        return float(-slip * np.expm1(-times.whole / times.tau))
    weight = scene.gravity * (1.0 - scene.airstream.density / density)
    return float(times.arrival - scene.release[1] - weight * (times.whole - times.time))


def _granules(scene: Scene, fraction: Fraction, law: str, scale: float) -> Iterator[tuple[float, float]]:
    """Diameters (m) and factors on the drag law, slip correction included, of small, median and large granules; where
    measured terminal velocities spread, of slow and fast ones of each size, and of those that hang in the air longest.
    """
    density, speeds = fraction.properties.density, fraction.settling(np.array(SIZES))
    if speeds is not None and not scene.body and scene.air is not None:
        speeds = np.append(speeds, np.clip(NEARLY * scene.air.speed, speeds[0], speeds[-1]))
    for diameter in dict.fromkeys(fraction.diameters(np.array(SIZES)).tolist()):
        slip = float(slip_correction(diameter, scene.airstream.mean_free_path))
        if speeds is None:
            yield diameter, scale / slip
            continue
        own = *STANDARD_AIR, GRAVITY, law, fraction.roundness
        for factor in drag_factor_for_terminal_velocity(diameter, density, speeds, *own):
            yield diameter, float(factor * slip_correction(diameter)) / slip
