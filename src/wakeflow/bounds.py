"""A-priori bounds on what the terms that are not computed could move; where one is only an estimate it says so.

With acceleration a over the flight time T of a granule with relaxation time tau,  shift <= min(a T^2 / 2, a tau T):
free flight, and drag that lets nothing move faster than a tau.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from .registry import Registry
from .scene import GRAVITY

__all__ = ["Flight", "neglected"]

WAKE_INTENSITY = 0.3  # u'/U behind a bluff body
BOLTZMANN = 1.380649e-23  # J/K
TEMPERATURE = 293.15  # K


@dataclass(frozen=True)
class Flight:
    """Scales of one fraction's flight that the bounds are made of (SI)."""

    diameter: float
    density: float  # of the granule
    tau: float  # relaxation time at the arrival slip
    settling: float  # terminal velocity
    arrival: float  # speed at the body
    slip: float  # speed relative to the air at the body
    time: float  # from the body to the floor or the top, an upper estimate
    air_density: float
    viscosity: float
    air_speed: float
    width: float
    intensity: float

    def shift(self, acceleration: float) -> float:
        """Landing shift (body widths) of a steady acceleration (m/s2) that acts over the whole flight."""
        return min(0.5 * acceleration * self.time**2, acceleration * self.tau * self.time) / self.width

    def kick(self, acceleration: float) -> float:
        """Landing shift (body widths) of an acceleration (m/s2) that acts over three body widths of the way."""
        passage = 3.0 * self.width / max(self.arrival, self.air_speed)
        return acceleration * passage * min(self.tau, self.time) / self.width

    @property
    def flow_acceleration(self) -> float:
        """Largest sustained acceleration of the air near the body, U^2/D (m/s2)."""
        return self.air_speed**2 / self.width

    @property
    def drag_acceleration(self) -> float:
        """Drag per mass (m/s2): the initial slip's, or for small tau what keeps the granule with the air."""
        return min(self.slip / self.tau, self.flow_acceleration + GRAVITY)


Bound = Callable[[Flight], float]
neglected: Registry[tuple[Bound, str]] = Registry("neglected term")


def _neglect(name: str, why: str) -> Callable[[Bound], Bound]:
    def add(bound: Bound) -> Bound:
        neglected.add(name, (bound, why))
        return bound

    return add


@_neglect("added-mass", "half the displaced air's mass times the difference of accelerations")
def _added_mass(f: Flight) -> float:
    half = 0.5 * f.air_density / f.density
    return f.kick(half * f.flow_acceleration) + f.shift(half * GRAVITY)


@_neglect(
    "basset-history", "at most 2.4 sqrt(rho/rho_p) of Stokes drag over one relaxation time; decays faster at finite Re"
)
def _basset(f: Flight) -> float:
    return f.shift(2.4 * math.sqrt(f.air_density / f.density) * f.drag_acceleration)


@_neglect("saffman-lift", "Saffman (1965), 1.615 d^2 sqrt(mu rho G) u_rel, in a shear layer of G = 20 U/D")
def _saffman(f: Flight) -> float:
    shear = 20.0 * f.air_speed / f.width
    slip = min(f.slip, f.tau * (f.flow_acceleration + GRAVITY))
    force = 1.615 * f.diameter**2 * math.sqrt(f.viscosity * f.air_density * shear) * slip
    return f.kick(force / (f.density * math.pi / 6 * f.diameter**3))


@_neglect(
    "magnus-lift", "Rubinow & Keller (1961), lift coefficient at most 0.6, spin of a sphere rolling off the slope"
)
def _magnus(f: Flight) -> float:
    spin = 5.0 / 7.0 * f.arrival / (0.5 * f.diameter)
    slip = min(f.slip, f.tau * (f.flow_acceleration + GRAVITY))
    creeping = 0.75 * f.air_density / f.density * spin * slip
    finite = 0.6 * 0.75 * f.air_density / f.density * slip**2 / f.diameter
    return f.shift(min(creeping, finite))


@_neglect(
    "turbulent-dispersion",
    "Taylor (1921), an estimate: sqrt(2 u'^2 T_L T) at u' = 0.3 U, less for granules slower to follow",
)
def _dispersion(f: Flight) -> float:
    rms = max(f.intensity, WAKE_INTENSITY) * f.air_speed
    lifetime = 0.2 * f.width / rms
    return math.sqrt(2 * rms**2 * lifetime * f.time) * min(1.0, f.time / f.tau) / f.width


@_neglect("brownian-motion", "sqrt(2 D T), D = k_B T / (3 pi mu d)")
def _brownian(f: Flight) -> float:
    diffusivity = BOLTZMANN * TEMPERATURE / (3 * math.pi * f.viscosity * f.diameter)
    return math.sqrt(2 * diffusivity * f.time) / f.width
