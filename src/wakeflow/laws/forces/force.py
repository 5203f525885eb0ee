"""What a force is, the scales of a flight, and the bounds on landing shifts made of them.

A kick w (m/s) moves a granule of relaxation time tau by w tau (1 - exp(-T / tau)) in the time T; a steady acceleration
a moves it by a tau (T - tau (1 - exp(-T / tau))).

    (1 + chi) dv/dt = c f(Re) (u - v) / tau + g (1 - rho / rho_p) - grad p / rho_p + chi Du/Dt + lift + Magnus,
    chi = rho / (2 rho_p) with added mass, else 0; u the air's mean velocity plus, where computed, its fluctuation.

A record knows what its force needs, how far leaving it out could move a granule, which numbers the compiled tracker is
handed for it, and the same acceleration once more in plain Python for the reference integrator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.registry import Registry
from ..constants import GRAVITY
from ..drag import slip_correction
from ..gas import MEAN_FREE_PATH, TEMPERATURE

# -- The scales of a granule's flight ----------------------------------------------------------------------------------
# All chosen: round numbers with which the bounds hold for 95 % of the granules of cases/rhombus.toml, and are at most
# 30 times what these move (tests/unit/planning/test_plan_gate.py)
REACH = 3.0  # body widths: distance along which the body's own pressure and velocity field acts
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
    near: float  # s of it within REACH body widths
    beside: bool  # thrown out to the side in downward air: it crosses no shear layer but the wake's edge
    sideways_bins: bool  # a bin is on a wall or in the air: vertical shifts count in full
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
    driven: float = 0.0  # m/s, largest change of the air's velocity by the drag of all granules
    calm: bool = False  # no body: the air neither turns nor changes its speed
    shedding: bool = False  # the airflow is resolved in time
    kept: bool = False  # what touches a body stays there
    temperature: float = TEMPERATURE  # K, of the air
    mean_free_path: float = MEAN_FREE_PATH  # m, of the air; 0: no gas
    gravity: float = GRAVITY  # m/s2

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
        return min(self.slip, self.tau * (self.flow_acceleration + self.gravity))

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


ALWAYS = Bound(lambda _: math.inf, "it acts in every flight")


# -- What a force is ---------------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
Vector = tuple[float, float]
Slots = Mapping[str, Array | float]  # by the name of a slot in flight.kernel.layout
Needs = Literal["nothing", "air", "pressure", "turbulence"]


class Grains(Protocol):
    """What a force may ask of n granules: arrays (n,)."""

    @property
    def diameter(self) -> Array:
        """Diameter, m."""

    @property
    def density(self) -> Array:
        """Density, kg/m3."""

    @property
    def drag_scale(self) -> Array | None:
        """Factor on the drag law, slip correction included; None: that alone."""

    @property
    def sphericity(self) -> Array:
        """What drag goes by; 1: a ball."""

    @property
    def inertia(self) -> Array:
        """k = I / (m r^2); infinite for a point mass."""

    @property
    def spin_lift(self) -> Array:
        """Factor on the coefficient of spin lift."""

    @property
    def shape(self) -> Array:
        """Length, width, thickness over the diameter (n, 3)."""

    @property
    def flake(self) -> NDArray[np.bool_]:
        """Whether they are flakes."""

    def __len__(self) -> int: ...


class AirProperties(Protocol):
    """What a force may ask of the air as a whole."""

    @property
    def density(self) -> float:
        """Density, kg/m3."""

    @property
    def viscosity(self) -> float:
        """Dynamic viscosity, Pa s."""

    @property
    def temperature(self) -> float:
        """Temperature, K."""

    @property
    def mean_free_path(self) -> float:
        """The mean free path of its molecules, m; 0 in a liquid."""


def drag_scale(grains: Grains, air: AirProperties) -> Array:
    """Factor on the drag law of ``grains`` in ``air``: their own, or 1 / Cc of their slip between its molecules."""
    return (
        1.0 / slip_correction(grains.diameter, air.mean_free_path) if grains.drag_scale is None else grains.drag_scale
    )


@dataclass(frozen=True)
class Granule:
    """One granule and what surrounds it, for the reference integrator: plain floats (SI)."""

    diameter: float
    density: float
    drag_scale: float  # factor on the drag law, slip correction included
    inertia: float  # k = I / (m r^2)
    drag_factor: Callable[[float], float]  # f(Re) = Cd Re / 24
    air_density: float
    viscosity: float  # dynamic
    gravity: Vector
    sphericity: float = 1.0

    @property
    def ratio(self) -> float:
        """Density of the air over the granule's."""
        return self.air_density / self.density

    @property
    def kinematic(self) -> float:
        """Kinematic viscosity of the air (m2/s)."""
        return self.viscosity / self.air_density


class Instant(NamedTuple):
    """One moment of a granule's flight, as the reference integrator sees it: plain floats (SI)."""

    granule: Granule
    slip: Vector  # air's velocity less the granule's
    curl: float  # of the air's velocity, 1/s
    spin: float  # of the granule, 1/s
    air_acceleration: Vector  # Du/Dt
    pressure_gradient: Vector  # Pa/m; nan where the field has no pressure

    @property
    def reynolds(self) -> float:
        """Reynolds number |slip| d / nu."""
        return math.hypot(*self.slip) * self.granule.diameter / self.granule.kinematic

    def rotation_reynolds(self, rate: float) -> float:
        """Reynolds number |rate| d^2 / nu, of a rotation ``rate`` (1/s)."""
        return abs(rate) * (self.granule.diameter**2 / self.granule.kinematic)


@dataclass(frozen=True)
class Force:
    """One term of the equation of motion.

    ``needs`` says what a field must hold for it; ``bound`` how far leaving it out could move a granule (ALWAYS: it acts
    in every flight). What the compiled tracker is handed is one or more of these, each made of granules and air:
    ``acceleration`` (n, 2) m/s2, a constant acceleration, also of the gravity (2,) m/s2 in force;
    ``inertia`` (n,), the share chi of a granule's mass that the air adds to it;
    ``factors``, by the name of the kernel's slot (n,): of compiled accelerations, which that inertia divides;
    ``constants``, by the name of the kernel's slot (n,): further numbers, handed on as they are.
    ``reference`` and ``torque`` are the acceleration (m/s2, before inertia divides it) and the rate of change of the
    spin (1/s2) in the reference integrator; none for a force that is random. ``memory`` is what it has
    in place of them where it remembers the slip: pairs of a time tau (s) and a weight w (1/s), each of which adds
    w (slip - lag) with lag' = (slip - lag) / tau.
    """

    name: str
    means: str
    source: str
    needs: Needs = "air"
    bound: Bound = ALWAYS
    computed: bool = True  # False: only bounded
    calm: bool = False  # acts in uniform air without turbulence too
    turns: bool = False  # acts on granules that can spin only
    random: bool = False  # draws random numbers
    effort: float = 0.0  # run time that it adds to a flight, over that of a flight with drag and weight alone
    by_gradient: bool = False  # the kernel computes it from the gradient of the air's velocity
    acceleration: Callable[[Grains, AirProperties, Array], Array] = lambda grains, *_: np.zeros((len(grains), 2))
    inertia: Callable[[Grains, AirProperties], Array] = lambda grains, _: np.zeros(len(grains))
    factors: Callable[[Grains, AirProperties], Slots] = lambda *_: {}
    constants: Callable[[Grains, AirProperties], Slots] = lambda *_: {}
    reference: Callable[[Instant], Vector] = lambda _: (0.0, 0.0)
    reference_inertia: Callable[[Granule], float] = lambda _: 0.0
    torque: Callable[[Instant], float] = lambda _: 0.0
    memory: Callable[[Granule], tuple[tuple[float, float], ...]] = lambda _: ()

    @property
    def always(self) -> bool:
        """Whether it acts in every flight: nothing bounds what leaving it out would do."""
        return self.bound is ALWAYS

    @property
    def in_vacuum(self) -> bool:
        """Whether it acts where there is no air."""
        return self.needs == "nothing"

    def blocked(self, *, laminar: bool, point_mass: bool) -> str:
        """Why it cannot be computed for granules in a laminar airflow, or that are point masses; empty where it can."""
        if not self.computed:
            return "not computed in this version"
        if self.needs == "turbulence" and laminar:
            return "the airflow is laminar and brings no turbulence"
        if self.turns and point_mass:
            return "a point mass gets no spin at the body; impact = 'sphere' gives it one"
        return ""


forces: Registry[Force] = Registry("force")
