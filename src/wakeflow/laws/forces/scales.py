"""The scales of a granule's flight, and bounds on landing shifts made of them; docs/model.md derives them.

A kick w (m/s) moves a granule of relaxation time tau by w tau (1 - exp(-T / tau)) in the time T; a steady acceleration
a moves it by a tau (T - tau (1 - exp(-T / tau))).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..constants import GRAVITY

# All chosen: round numbers with which the bounds hold for 95 % of the granules of cases/rhombus.toml, and are at most
# 30 times what these move (tests/planning/test_plan_gate.py)
NEAR = 3.0  # body widths: distance along which the body's own pressure and velocity field acts
TURNED_BESIDE = (
    3.4  # rad: integral of |curl u| over time for a granule thrown out of the wake, or past its edge; 3.3 met
)
TURNED_WITHIN = 30.0  # rad: the same for a granule that the air turns aside, or that falls through the wake
STRETCH = 6.0  # how much further a steady wake's strain carries two neighbours apart that follow the air
STRETCH_SHEDDING = 40.0  # the same in a wake that sheds: 35 met (tests/proofs/studies gates, scene wake)
SIDEWAYS = 0.75  # of the air speed U: change of the air's sideways speed along a flight past the body
SPREADING = 0.35  # sideways over vertical speed of the air that leaves the body; 0.34 met in the wake that sheds
SERIES_BELOW = 1e-4  # time over relaxation time below which two terms of the series are exact to round-off


@dataclass(frozen=True)
class FlightScales:
    """Scales of one granule's flight that the bounds are made of (SI)."""

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
    meetings: float  # with granules as heavy or heavier, lighter ones by their share
    knock: float  # m/s, the change of velocity that one of these brings at most
    given: float = 0.0  # m/s, velocity that drag gives it in the curtain, on its way to the body
    slowed: float = 0.0  # largest change of the air's velocity by the drag of all granules, over the air speed
    calm: bool = False  # no body: the air neither turns nor changes its speed
    shedding: bool = False  # the airflow is resolved in time

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
    def turned(self) -> float:
        """Angle (rad) through which the air turns across the shear layers that are met: integral of |curl u| dt."""
        return 0.0 if self.calm else TURNED_BESIDE if self.beside else TURNED_WITHIN

    @property
    def slope(self) -> float:
        """Shift along the floor or the top for a vertical shift: sideways over vertical speed at the end, at most 1."""
        return 1.0 if self.sideways_bins else min(1.0, max(SPREADING, self.thrown / self.landing))

    @property
    def gain(self) -> float:
        """How much the wake's strain stretches a shift: 1 for grain, up to 1 + STRETCH for what follows the air."""
        stretch = STRETCH_SHEDDING if self.shedding else STRETCH
        if self.calm:
            return 1.0
        stokes = self.tau * max(self.air_speed, self.arrival) / self.width
        return 1.0 + stretch / (1.0 + stokes**2)

    def reach(self, time: float) -> float:
        """Way (m) per unit of an initial velocity in ``time`` (s) against drag: tau (1 - exp(-t / tau))."""
        return -self.tau * math.expm1(-time / self.tau)

    def steady(self, acceleration: float, time: float) -> float:
        """Way (m) of a steady acceleration (m/s2) over ``time``: a t^2 / 2 in free flight, a tau t with the air."""
        x = time / self.tau
        exact = self.tau * (time - self.reach(time))
        return acceleration * (0.5 * time**2 * (1.0 - x / 3.0) if x < SERIES_BELOW else exact)

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
    """A bound on what leaving something out could move: ``shift`` makes a landing shift (body widths) of the scales of
    a flight, ``why`` says what it is made of.
    """

    shift: Callable[[FlightScales], float]
    why: str
