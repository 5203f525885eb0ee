"""[funnel]: a vibrated conical funnel full of beads, whose discharge is computed bead by bead."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from ..core.errors import SceneError
from ..core.quantities import metres
from ..laws.material import Material, materials
from ..laws.restitution import restitution_at
from ..laws.streams import beverloo
from .table import Diameter, Frequency, Length, Mass, MassDensity, Modulus, SlopeAngle, Weighed

LOOSE = 0.60  # packing of poured spheres (0.58 to 0.61), before it is measured in the bed
MAX_BEADS = 50_000  # beads: hours
USUAL = 0.5  # m/s of beads that meet in a funnel: where a material's restitution is taken


class Funnel(Weighed):
    """[funnel]: beads in a cone with an open outlet, after the paper's Figs. 8-10.

    The paper gives beads, mass, frequencies and Gamma, not the orifice, the cone's angle or the wall's friction: those
    defaults are this program's.
    """

    computed: bool = Field(
        True, description="bead by bead, with LIGGGHTS; false: the rate is that of Beverloo's law, at rest"
    )
    orifice: Length = Field(0.010, description="inner diameter of the outlet")
    half_angle: SlopeAngle = Field(math.radians(30), description="of the cone, its wall from the vertical")
    width: Length | None = Field(
        None, description="inner diameter of the straight part above the cone; default: as needed"
    )
    material: str = Field("glass-beads", description="one of: " + ", ".join(materials))
    low: Diameter = Field(1.1e-3, description="smallest bead; sizes are uniform between low and high")
    high: Diameter = Field(1.3e-3, description="largest bead")
    density: MassDensity | None = Field(None, description="of a bead; default: the material's")
    mass: Mass | None = Field(None, description="of all beads; default 35 g")
    count: Annotated[int, Field(ge=10, le=MAX_BEADS)] | None = Field(None, description="of beads, instead of mass")
    restitution: Annotated[float, Field(gt=0.05, le=1)] | None = Field(None, description="default: the material's")
    friction: Annotated[float, Field(ge=0, le=10)] | None = Field(None, description="bead on bead")
    wall_friction: Annotated[float, Field(ge=0, le=10)] = Field(0.3, description="bead on the cone: a matte print")
    rolling_friction: Annotated[float, Field(ge=0, le=1)] = 0.0
    youngs_modulus: Modulus = Field(5e6, description="of beads and wall; softened: glass has 6e10 Pa")
    frequency: Frequency | None = Field(None, description="of the vertical vibration")
    gamma: Annotated[float, Field(ge=0, le=50)] = Field(0.0, description="peak acceleration over g; 0: at rest")
    steps_per_contact: Annotated[int, Field(ge=10, le=500)] = Field(
        25, description="time steps in the duration of a collision"
    )
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _consistent(self) -> Funnel:
        if not self.low <= self.high:
            raise SceneError(f"low = {metres(self.low)} must not be above high = {metres(self.high)}")
        if self.high > 2 * self.low:
            raise SceneError(
                f"high = {metres(self.high)} is over twice low = {metres(self.low)}: give a narrower range"
            )
        if self.mass is not None and self.count is not None:
            raise SceneError("give either mass or count")
        if self.gamma > 0 and self.frequency is None:
            raise SceneError(f"gamma = {self.gamma:g} needs a frequency")
        if self.orifice < 2 * self.high:
            raise SceneError(f"orifice = {metres(self.orifice)}: no two beads of {metres(self.high)} pass side by side")
        if self.width is not None and self.width < 1.5 * self.orifice:
            raise SceneError(
                f"width = {metres(self.width)} must be at least 1.5 times orifice = {metres(self.orifice)}"
            )
        if not 10 <= self.beads <= MAX_BEADS:
            raise SceneError(f"mass is that of {self.beads} beads (allowed: 10 to {MAX_BEADS})")
        return self

    @property
    def _material(self) -> Material:
        return materials[self.material]

    @property
    def bead_density(self) -> float:
        """kg/m3."""
        return self._material.density if self.density is None else self.density

    @property
    def bead_restitution(self) -> float:
        """Restitution of beads with each other and with the wall."""
        return float(
            restitution_at(self._material.restitution if self.restitution is None else self.restitution, USUAL)
        )

    @property
    def bead_friction(self) -> float:
        """Coulomb's coefficient between beads."""
        return self._material.friction if self.friction is None else self.friction

    @property
    def diameter(self) -> float:
        """Mean diameter (m)."""
        return 0.5 * (self.low + self.high)

    @property
    def bead_mass(self) -> float:
        """Mean mass of a bead (kg), of diameters uniform between low and high: pi/6 rho <d^3>."""
        cube = 0.25 * (self.low + self.high) * (self.low**2 + self.high**2)
        return self.bead_density * math.pi / 6 * cube

    @property
    def beads(self) -> int:
        """How many beads there are."""
        if self.count is not None:
            return self.count
        return round((0.035 if self.mass is None else self.mass) / self.bead_mass)

    @property
    def total_mass(self) -> float:
        """kg, on average over seeds."""
        return self.beads * self.bead_mass

    @property
    def amplitude(self) -> float:
        """Amplitude (m) of the wall's motion amplitude sin(2 pi f t): Gamma g / omega^2; 0 at rest."""
        if self.frequency is None or self.gamma == 0:
            return 0.0
        return self.gravity * self.gamma / (2 * math.pi * self.frequency) ** 2

    @property
    def expected_rate(self) -> float:
        """Mass flow (kg/s) by Beverloo's law for the poured bed at rest: the rate that a plan uses."""
        return beverloo(self.orifice, self.diameter, LOOSE * self.bead_density, gravity=self.gravity)
