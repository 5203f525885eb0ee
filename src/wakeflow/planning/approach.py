"""A fraction before its forces are chosen: the scales of its flight, which the bounds are made of, and whether the air
feels it.

Falls through the channel's uniform air with the fraction's own drag (``uniform_fall``); meetings as given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core.errors import SceneError
from ..laws.constants import GRAVITY, STANDARD_AIR
from ..laws.drag import drag_factor_for_terminal_velocity, slip_correction, terminal_velocity
from ..laws.driven_jet import ENERGY
from ..laws.forces import FlightScales
from ..laws.forces.force import REACH
from ..scene import Fraction, Scene
from .airflow_choice import AirflowPlan
from .carried_round import Deflection, deflection
from .collision_rates import RECIRCULATION, Encounters, ejection_speed, encounters
from .coupling import with_driven_air
from .terms import LOADING, bounds, limit_of
from .uniform_fall import FallTimes, UniformFall

# -- The scales of a flight -------------------------------------------------------------------------------------------
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
    density = fraction.properties.density
    kept = bool(scene.body) and set(scene.all_kept) == scene.body.keys()
    upward, aside = air.rises, 0.0 if kept else abs(float(scene.entry @ scene.plumb.across))
    aside += 2.0 * math.sin(scene.feed.scatter) * scene.feed.fall_speed
    scales = []
    for diameter, factor in _granules(scene, fraction, law, scale):
        fall = UniformFall.by_factor(scene, fraction, law, factor, diameter)
        times = fall.times()
        arrival = max(times.arrival, scene.feed.fall_speed)
        along, settling = fall.granule.along, abs(fall.granule.settling)
        slip = max(abs(complex(arrival - along, fall.granule.across)), air.speed, abs(times.landing) - abs(along))
        stays = 0.0
        if scene.body and upward and settling < air.speed:  # it falls into the wake, and leaves with the air
            stays = REACH * scene.width / (RECIRCULATION * air.speed) / (1.0 + times.tau * air.speed / scene.width)
        thrown = ejection_speed(scene, fraction, arrival) * arrival if scene.body and not kept else aside
        scales.append(FlightScales(
            diameter=diameter, density=density, tau=times.tau, calm=not scene.body or air.still,
            arrival=arrival, thrown=thrown, slip=slip, settling=settling,
            landing=times.landing, whole=times.whole + stays, time=times.time + stays, near=times.near + stays,
            beside=straight and not upward,
            sideways_bins=_sideways_bins(scene),
            air_density=air.density, viscosity=air.viscosity, air_speed=air.speed, width=scene.width,
            intensity=air.turbulence, turbulent=turbulent, shaking=float(np.linalg.norm(scene.shaking)),
            omega=scene.motion[1], meetings=met.heavier, knock=met.knock, shedding=shedding, kept=kept,
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


# -- A fraction before its forces are chosen ---------------------------------------------------------------------------
JET_RMS = math.sqrt(2.0 / 3.0 * ENERGY)  # rms of the velocity in a jet, over that on its axis
RARE = 1e-3  # share of the mass below and above which a measured terminal velocity may be anything
CALIBRATED = (0.5, 100.0)  # factor on a sphere's drag that is believed: irregular granules have more, none much less


@dataclass(frozen=True)
class Approach:
    """What is known of a fraction before its forces are chosen; without ``scales`` and ``turned`` in a vacuum."""

    law: str
    scale: float
    met: Encounters
    turned: Deflection | None = None
    scales: Sequence[FlightScales] = ()

    @property
    def driven(self) -> Approach:
        """The same in the jet of air that the granules drive, as fast and as turbulent as it may be."""
        return replace(self, scales=[replace(one, air_speed=one.driven, intensity=JET_RMS) for one in self.scales])


def approaches(scene: Scene, airflow: AirflowPlan) -> dict[str, Approach]:
    """Of every fraction: its drag, which others it meets, and the scales of its flight."""
    laws = {name: (scene.fraction[name].drag_law, _drag_scale(scene, name)) for name in scene.fraction}
    met = encounters(scene, laws)
    if scene.air is None:
        return {name: Approach(*laws[name], met[name]) for name in laws}
    found = {}
    for name, law in laws.items():
        turned = deflection(scene, name, *law)
        straight = turned is not None and turned.straight and not scene.obstacles
        scales = flights(
            scene,
            name,
            *law,
            met[name],
            straight=straight,
            turbulent=airflow.turbulent,
            shedding=airflow.stepping == "time-resolved",
        )
        found[name] = Approach(*law, met[name], turned, scales)
    driven = with_driven_air(scene, {name: one.scales for name, one in found.items()})
    return {name: replace(one, scales=driven[name]) for name, one in found.items()}


def _drag_scale(scene: Scene, name: str) -> float:
    """The factor on the fraction's drag law; every terminal velocity that was measured must be one that can be."""
    fraction = scene.fraction[name]
    if fraction.measured_settling is None:
        return 1.0
    granule, law = fraction.properties, (fraction.drag_law, fraction.roundness)
    scale = _calibration(name, law, *fraction.measured_settling)
    ends = fraction.settling(np.array([RARE, 1.0 - RARE]))
    if ends is not None:
        for speed in ends.tolist():
            _calibration(name, law, granule.diameter, granule.density, speed)
    return scale


def _calibration(name: str, law: tuple[str, float], diameter: float, density: float, speed: float) -> float:
    """The factor on a drag law and its sphericity that gives a measured terminal velocity. Raises SceneError where it
    would be too much of a sphere's drag, or too little.
    """
    if density <= STANDARD_AIR[0]:
        raise SceneError(f"fraction.{name}.density = {density:g} kg/m3: lighter than air, it has no terminal velocity")
    measured = diameter, density, speed, *STANDARD_AIR, GRAVITY
    slip = float(slip_correction(diameter))  # the granule that was measured slipped as well
    scale = slip * float(drag_factor_for_terminal_velocity(*measured))
    if not CALIBRATED[0] <= scale <= CALIBRATED[1]:
        sphere = float(terminal_velocity(diameter, density, *STANDARD_AIR, GRAVITY))
        raise SceneError(
            f"fraction.{name}.terminal_velocity = {speed:g} m/s needs {scale:.2g} times a sphere's drag: a sphere of "
            f"{diameter:.3g} m and {density:g} kg/m3 falls at {sphere:.3g} m/s; check size, density and velocity"
        )
    return slip * float(drag_factor_for_terminal_velocity(*measured, *law))


class BodyArrival(NamedTuple):
    """The median granule of a fraction at the top of the body."""

    settling: float  # m/s, terminal velocity; nan in a vacuum
    tau: float  # s, relaxation time at the slip it arrives with
    stokes: float  # tau times the arrival speed over the body's half width; inf without a body
    speed: float  # m/s, downward


def arrival_at_body(scene: Scene, name: str, law: str, scale: float) -> BodyArrival:
    """Of a fraction, with its drag ``law`` and the factor on it; in a vacuum it comes as fast as it was fed."""
    if scene.air is None:
        return BodyArrival(math.nan, math.inf, math.inf, scene.feed.fall_speed)
    fraction = scene.fraction[name]
    fall = UniformFall.of(scene, fraction, law, scale, fraction.properties.diameter)
    speed = fall.arrival().speed
    tau = float(fall.granule.tau(np.array([abs(speed - fall.granule.along)]))[0])
    stokes = tau * max(speed, 0.0) / (0.5 * scene.width) if scene.body else math.inf
    return BodyArrival(fall.granule.settling, tau, stokes, speed)


# -- Whether the air feels the granules --------------------------------------------------------------------------------
# Of airflows that a steady one which OpenFOAM solves is part of
KINDS = ("steady", "time-resolved", "best-estimate", "three-dimensional")


def feels_granules(
    scene: Scene,
    airflow: AirflowPlan,
    approaches: Mapping[str, Approach],
    target: float,
    switches: Mapping[str, bool],
) -> bool:
    """Whether the airflow is computed with the granules' force on it: where that could move one of the fractions that
    come by ``approaches`` farther than the accuracy ``target`` (of a share) allows, or as it is switched by hand.
    Raises SceneError where it is asked for and cannot be had.
    """
    switched = switches.get(LOADING)
    if switched is False:
        return False
    if obstacle := _obstacle(scene, airflow):
        if switched:
            raise SceneError(f"--force {LOADING}=on: {obstacle}")
        return False
    limit, scales = limit_of(scene, target), (flight for one in approaches.values() for flight in one.scales)
    return bool(switched) or any(bounds[LOADING].shift(flight) > limit for flight in scales)


def _obstacle(scene: Scene, airflow: AirflowPlan) -> str:
    """Why the granules' force cannot be given to the air; empty where it can."""
    if airflow.kind == "analytic" and scene.airstream.still:
        if scene.body:
            return "air at rest, and what granules drive round a body in it is not computed"
        if not (scene.plumb.upright and scene.feed.falls):
            return "granules that do not fall straight along the channel drive no jet that is known"
    elif airflow.kind not in KINDS:
        return f"rung {airflow.rung} has no steady airflow that OpenFOAM could solve on; use draft or standard"
    if scene.feed.rate is None:
        return "the scene has no feed.rate, which says how dense the curtain is"
    return ""
