"""What a force is: one record for each term of a granule's equation of motion, and the registry that holds them.

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
from .scales import Bound

Array = NDArray[np.float64]
Vector = tuple[float, float]
Slots = Mapping[str, Array | float]  # by the name of a slot in tracking.kernel.layout
Needs = Literal["nothing", "air", "pressure", "turbulence"]


class Grains(Protocol):
    """What a force may ask of n granules: arrays (n,)."""

    @property
    def diameter(self) -> Array:
        """m"""

    @property
    def density(self) -> Array:
        """kg/m3"""

    @property
    def drag_scale(self) -> Array:
        """Factor on the drag law, slip correction included."""

    @property
    def inertia(self) -> Array:
        """k = I / (m r^2); infinite for a point mass."""

    def __len__(self) -> int: ...


class AirProperties(Protocol):
    """What a force may ask of the air as a whole."""

    @property
    def density(self) -> float:
        """kg/m3"""

    @property
    def viscosity(self) -> float:
        """Dynamic viscosity, Pa s."""


class Field(Protocol):
    """What tells whether a field has what a force needs of it."""

    @property
    def pressure_gradient(self) -> Array | None:
        """Pa/m; None without pressure."""

    @property
    def k(self) -> Array | None:
        """Turbulent kinetic energy, m2/s2; None in laminar air."""

    @property
    def dissipation(self) -> Array | None:
        """Its dissipation, m2/s3; None in laminar air."""


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
    pressure_gradient: Vector | None  # Pa/m; None where the field has no pressure

    @property
    def reynolds(self) -> float:
        """|slip| d / nu"""
        return math.hypot(*self.slip) * self.granule.diameter / self.granule.kinematic

    def rotation_reynolds(self, rate: float) -> float:
        """|rate| d^2 / nu, of a rotation ``rate`` (1/s)."""
        return abs(rate) * (self.granule.diameter**2 / self.granule.kinematic)


@dataclass(frozen=True)
class Force:
    """One term of the equation of motion.

    ``needs`` says what a field must hold for it; ``bound`` how far leaving it out could move a granule (None: it always
    acts). What the compiled tracker is handed is one or more of these, each made of granules and air:
    ``acceleration`` (n, 2) m/s2, a constant acceleration, also of the gravity (2,) m/s2 in force;
    ``inertia`` (n,), the share chi of a granule's mass that the air adds to it;
    ``factors``, by the name of the kernel's slot (n,): of compiled accelerations, which that inertia divides;
    ``constants``, by the name of the kernel's slot (n,): further numbers, handed on as they are.
    ``reference`` and ``torque`` are the acceleration (m/s2, before inertia divides it) and the rate of change of the
    spin (1/s2) in the reference integrator; None for a force that has none or that is random. ``memory`` is what it has
    in place of them where it remembers the slip: pairs of a time tau (s) and a weight w (1/s), each of which adds
    w (slip - lag) with lag' = (slip - lag) / tau.
    """

    name: str
    means: str
    source: str
    needs: Needs = "air"
    bound: Bound | None = None
    computed: bool = True  # False: only bounded
    calm: bool = False  # acts in uniform air without turbulence too
    turns: bool = False  # acts on granules that can spin only
    random: bool = False  # draws random numbers
    effort: float = 0.0  # run time that it adds to a flight, over that of a flight with drag and weight alone
    by_gradient: bool = False  # the kernel computes it from the gradient of the air's velocity
    acceleration: Callable[[Grains, AirProperties | None, Array], Array] | None = None
    inertia: Callable[[Grains, AirProperties], Array] | None = None
    factors: Callable[[Grains, AirProperties], Slots] | None = None
    constants: Callable[[Grains, AirProperties], Slots] | None = None
    reference: Callable[[Instant], Vector] | None = None
    reference_inertia: Callable[[Granule], float] | None = None
    torque: Callable[[Instant], float] | None = None
    memory: Callable[[Granule], tuple[tuple[float, float], ...]] | None = None

    @property
    def always(self) -> bool:
        """Whether it acts in every flight: nothing bounds what leaving it out would do."""
        return self.bound is None

    @property
    def in_vacuum(self) -> bool:
        """Whether it acts where there is no air."""
        return self.needs == "nothing"

    def lacks(self, field: Field) -> str | None:
        """What ``field`` lacks for it, in words; None where it has all."""
        if self.needs == "pressure" and field.pressure_gradient is None:
            return "a field with pressure"
        if self.needs == "turbulence" and (field.k is None or field.dissipation is None):
            return "a field with k and dissipation; a laminar airflow has none"
        return None

    def blocked(self, *, laminar: bool, point_mass: bool) -> str | None:
        """Why it cannot be computed for granules in a laminar airflow, or that are point masses; None where it can."""
        if not self.computed:
            return "not computed in this version"
        if self.needs == "turbulence" and laminar:
            return "the airflow is laminar and brings no turbulence"
        if self.turns and point_mass:
            return "a point mass gets no spin at the body; impact = 'sphere' gives it one"
        return None


forces: Registry[Force] = Registry("force")
