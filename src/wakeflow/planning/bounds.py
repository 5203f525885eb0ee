"""A-priori bounds on what each term of a granule's equation of motion could move; docs/model.md derives them.

All are landing shifts in body widths, made of a few scales of one fraction's flight. They hold for granules that meet
the same walls in the same order with and without the term; the two that rest on an estimate of the turbulence or of
the curtain's density say so. A kick w (m/s) moves a granule of relaxation time tau by w tau (1 - exp(-T / tau)) in T.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.registry import Registry
from ..laws.constants import GRAVITY
from ..laws.drag import relaxation_time, slip_correction
from ..laws.lift import lift_coefficient
from ..laws.rotation import magnus_factor, spin_rate
from ..laws.turbulence import brownian_diffusivity, crossing_times

__all__ = ["Bound", "Flight", "bounds", "history_kernel", "history_time", "moved_by_air"]

NEAR = 3.0  # body widths along which the body's own pressure and velocity field acts
SHEAR = 20.0  # U / D: vorticity of a wake's shear layer
TURNED_BESIDE = 3.0  # integral of |curl u| over time for a granule that is thrown out of the wake, or past its edge
TURNED_WITHIN = 30.0  # the same for one that the air turns aside, or that falls through the wake
WAKE_INTENSITY = 0.3  # u' / U behind a bluff body
EDDY = 0.2  # integral length of the turbulence in the wake, in body widths
SLOWEST = 0.1  # of the largest slip: what the slip seldom falls below
STRETCH = 6.0  # how much further the wake's strain carries two neighbours apart that follow the air
SIDEWAYS = 0.75  # of U: how much the air's sideways speed changes along a flight past the body
SPREADING = 0.3  # sideways over vertical speed of the air that leaves the body
TWO_SIGMA = 2.0  # 95 % of a random shift


@dataclass(frozen=True)
class Flight:
    """Scales of one fraction's flight that the bounds are made of (SI)."""

    diameter: float
    density: float  # of the granule
    tau: float  # relaxation time, its mean after the body
    arrival: float  # fall speed at the body
    thrown: float  # sideways speed after an impact
    slip: float  # largest speed relative to the air
    settling: float  # terminal speed in calm air
    landing: float  # vertical speed at the end, from rest at the body
    whole: float  # s, from the release to the end
    time: float  # s, from rest at the body to the end
    near: float  # s of it within NEAR body widths
    beside: bool  # thrown out to the side in downward air: it crosses no shear layer but the wake's edge
    sideways_bins: bool  # a bin stands on a wall or in the air: vertical shifts count in full
    air_density: float
    viscosity: float
    air_speed: float
    width: float
    intensity: float  # u' / U at the inlet
    turbulent: bool
    shaking: float  # peak speed of the body, m/s
    omega: float  # of the vibration, rad/s
    meetings: float  # with other granules, weighted by the share of its momentum that each takes away
    calm: bool = False  # no body: the air neither turns nor changes its speed

    @property
    def flow_acceleration(self) -> float:
        """Largest sustained acceleration of the air near the body, U^2 / D (m/s2)."""
        return 0.0 if self.calm else self.air_speed**2 / self.width

    @property
    def ratio(self) -> float:
        """Density of the air over the granule's."""
        return self.air_density / self.density

    @property
    def typical_slip(self) -> float:
        """Slip (m/s) near the body: the arrival's, or for granules that follow the air what keeps them with it."""
        return min(self.slip, self.tau * (self.flow_acceleration + GRAVITY))

    @property
    def slope(self) -> float:
        """Shift along the floor or the top for a vertical shift: sideways over vertical speed at the end, at most 1."""
        return 1.0 if self.sideways_bins else min(1.0, max(SPREADING, self.thrown / self.landing))

    @property
    def gain(self) -> float:
        """How much the wake's strain stretches a shift: 1 for grain, up to 1 + STRETCH for what follows the air."""
        if self.calm:
            return 1.0
        stokes = self.tau * max(self.air_speed, self.arrival) / self.width
        return 1.0 + STRETCH / (1.0 + stokes**2)

    def reach(self, time: float) -> float:
        """Way (m) per unit of an initial velocity in ``time`` (s) against drag: tau (1 - exp(-t / tau))."""
        return -self.tau * math.expm1(-time / self.tau)

    def steady(self, acceleration: float, time: float) -> float:
        """Way (m) of a steady acceleration (m/s2) over ``time``: a t^2 / 2 in free flight, a tau t with the air."""
        x = time / self.tau
        exact = self.tau * (time - self.reach(time))
        return acceleration * (0.5 * time**2 * (1.0 - x / 3.0) if x < 1e-4 else exact)

    def passage(self, acceleration: float, lasting: float) -> float:
        """Way (m) until the end of an acceleration (m/s2) that acts for ``lasting`` (s) only."""
        acts = min(lasting, self.time)
        kick = acceleration * self.reach(acts)
        return self.steady(acceleration, acts) + kick * self.reach(self.time - acts)

    def widths(self, way: float) -> float:
        """A way (m) as a landing shift in body widths, stretched by the wake."""
        return self.gain * way / self.width


@dataclass(frozen=True)
class Bound:
    """A bound on one term: ``shift`` (body widths) of a flight, and ``why`` it is what it is."""

    shift: Callable[[Flight], float]
    why: str


bounds: Registry[Bound] = Registry("bounded term")


def _bound(name: str, why: str) -> Callable[[Callable[[Flight], float]], Callable[[Flight], float]]:
    def add(shift: Callable[[Flight], float]) -> Callable[[Flight], float]:
        bounds.add(name, Bound(shift, why))
        return shift

    return add


@_bound("buoyancy", "g rho/rho_p over the whole flight, times the slope of the track at its end")
def _buoyancy(f: Flight) -> float:
    return f.slope * f.widths(f.steady(f.ratio * GRAVITY, f.whole))


@_bound("pressure-gradient", "rho/rho_p U^2/D within 3 D of the body")
def _pressure_gradient(f: Flight) -> float:
    return f.widths(f.passage(f.ratio * f.flow_acceleration, f.near))


@_bound("added-mass", "rho/2rho_p times U^2/D within 3 D of the body and the granule's own change of velocity")
def _added_mass(f: Flight) -> float:
    own = max(f.landing, f.arrival) * f.reach(f.whole)
    return f.widths(0.5 * f.ratio * (f.passage(f.flow_acceleration, f.near) + own))


@_bound("lift", "Saffman-Mei: slip times the angle through which the air turns across the shear layers that are met")
def _lift(f: Flight) -> float:
    shear = SHEAR * f.air_speed / f.width
    scale = f.air_density * f.diameter / f.viscosity
    coefficient = lift_coefficient(scale * f.typical_slip, scale * f.diameter * shear)
    return f.widths(f.ratio * coefficient * f.typical_slip * _turned(f) * f.reach(f.time))


def _turned(f: Flight) -> float:
    return 0.0 if f.calm else TURNED_BESIDE if f.beside else TURNED_WITHIN


@_bound("magnus", "Loth: spin of a sphere that leaves the slope rolling, and half the air's turning")
def _magnus(f: Flight) -> float:
    spin = (f.thrown if f.calm else f.arrival) / (0.5 * f.diameter)  # without a body only walls beside give any
    scale = f.air_density * f.diameter / f.viscosity
    lift = 0.75 * f.ratio * magnus_factor(scale * f.typical_slip, scale * f.diameter * spin)
    lasting = 1.0 / float(spin_rate(f.diameter, f.density, f.viscosity))
    own = f.passage(lift * spin * f.typical_slip, lasting)
    air = 0.75 * f.ratio * f.typical_slip * 0.5 * _turned(f) * f.reach(f.time)
    return f.widths(own + air)


@_bound("dispersion", "an estimate: 2 sqrt(2 u'^2 T_L T) at u' = 0.3 U near the body, less for granules slow to follow")
def _dispersion(f: Flight) -> float:
    rms = (max(f.intensity, WAKE_INTENSITY) if f.turbulent else f.intensity) * f.air_speed
    if rms == 0.0:
        return 0.0
    lifetime = crossing_times(EDDY * f.width / rms, f.typical_slip, rms)[0]
    follows = f.reach(f.time) / f.tau
    return TWO_SIGMA * math.sqrt(2.0 * rms**2 * lifetime * f.near) * follows / f.width


@_bound("brownian", "2 sqrt(2 D T), D = k_B T Cc / (3 pi mu d)")
def _brownian(f: Flight) -> float:
    diffusivity = brownian_diffusivity(f.diameter, f.viscosity, slip_correction=float(slip_correction(f.diameter)))
    return f.widths(TWO_SIGMA * math.sqrt(2.0 * diffusivity * f.whole))


def history_kernel(time: np.ndarray, radius: float, speed: float, kinematic: float) -> np.ndarray:
    """K(t) of the history force 6 pi mu a int K(t - s) d(u - v)/ds ds; ``time`` s, ``radius`` m, slip ``speed`` m/s.

    K = {[pi t nu / a^2]^(1/4) + [pi U^3 t^2 / (2 a nu f_H^3)]^(1/2)}^-2, f_H = 0.75 + 0.105 Re, Re = 2 a U / nu: Mei,
    R. & Adrian, R.J. 1992, J. Fluid Mech. 237, 323, for Re up to about 100; Basset's sqrt(a^2 / pi nu t) at first,
    falling as 1 / t^2 later. ``kinematic`` viscosity m2/s.
    """
    factor = 0.75 + 0.105 * 2.0 * radius * speed / kinematic
    early = (math.pi * time * kinematic / radius**2) ** 0.25
    late = np.sqrt(0.5 * math.pi * speed**3 / (radius * kinematic * factor**3)) * time
    return 1.0 / (early + late) ** 2


def history_time(time: float, radius: float, speed: float, kinematic: float) -> float:
    """Integral (s) of :func:`history_kernel` from 0 to ``time`` (s), to 1e-4."""
    z = np.linspace(0.0, time**0.25, 2001)  # t = z^4 takes the singularity out
    middle = 0.5 * (z[1:] + z[:-1])
    return float(np.sum(history_kernel(middle**4, radius, speed, kinematic) * 4.0 * middle**3 * np.diff(z)))


@_bound("basset-history", "Mei & Adrian's kernel, an inertia of its integral over tau, times the change of slip")
def _basset(f: Flight) -> float:
    stokes = float(relaxation_time(f.diameter, f.density, f.viscosity))
    slowest = max(SLOWEST * f.typical_slip, min(f.settling, f.typical_slip))
    memory = history_time(f.whole, 0.5 * f.diameter, slowest, f.viscosity / f.air_density)
    last = min(f.time, f.tau)  # after a step of the air's velocity the shift grows as t exp(-t / tau)
    air = 0.0 if f.calm else f.air_speed
    sideways, along = max(SIDEWAYS * air, f.thrown), max(air, f.landing)  # the air's or its own change
    change = min(math.hypot(sideways, f.slope * along), f.typical_slip)
    return f.widths(memory / stokes * change * last * math.exp(-last / f.tau))


@_bound("vibration-of-the-air", "an estimate: the air near the body swings with up to twice the body's peak speed")
def _vibration(f: Flight) -> float:
    if f.shaking == 0.0:
        return 0.0
    return f.widths(2.0 * f.shaking * min(f.near, 2.0 / f.omega) * f.reach(f.time) / f.tau)


@_bound("collisions-between-granules", "kinetic theory: meetings in the curtain, each taking up to the arrival speed")
def _collisions(f: Flight) -> float:
    return min(1.0, f.meetings) * f.arrival * f.reach(f.time) / f.width


def moved_by_air(flight: Flight) -> float:
    """Landing shift (body widths) where drag is left out altogether: an estimate for rung none.

    Air that a granule slips through at w moves it by w (T - tau (1 - exp(-T / tau))) in a time T from the feed to
    the end: sideways at the speed it is thrown at plus what the air turns aside by, along at the largest slip, which
    counts by the slope of the track where all bins lie on the floor.
    """
    left = flight.whole - flight.tau * (1.0 - math.exp(-flight.whole / flight.tau))
    slope = 1.0 if flight.sideways_bins else min(1.0, flight.thrown / max(flight.landing, 1e-9))
    return (flight.thrown + SIDEWAYS * flight.air_speed + flight.slip * slope) * left / flight.width
