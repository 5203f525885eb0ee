"""[feed], [funnel] and [collisions]: the falling curtain, what pours it, and how its granules meet."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from ..core.errors import SceneError
from ..core.quantities import metres, quantity
from ..laws.material import materials
from ..laws.profile import crowding, profiles
from ..laws.restitution import restitution_at
from ..laws.streams import beverloo
from .table import (
    UNSET,
    AnyAngle,
    Array,
    Coordinate,
    Diameter,
    Frequency,
    LawTable,
    Length,
    Mass,
    MassDensity,
    MassRate,
    Modulus,
    ScatterAngle,
    Shorthand,
    SlopeAngle,
    Speed,
    Table,
    Weighed,
    made_by,
    parameters,
)

EVEN = 1e-9  # of the curtain's width: what is so near is the same
PARTS = np.linspace(0.05, 0.45, 5)  # of the curtain's mass, at which its two sides are compared


# -- [feed]: the falling curtain ---------------------------------------------------------------------------------------
@parameters(
    std=(Length, "normal: standard deviation; default a quarter of the width"),
    positions=(list[Coordinate], "table: places from the curtain's middle, increasing"),
    weights=(list[Annotated[float, Field(ge=0)]], "table: mass per width at each position, in any unit"),
)
class Profile(LawTable):
    """How the curtain's mass is spread over its width: ``distribution`` and its parameters."""

    distribution: str = Field(description="one of: " + ", ".join(profiles))

    def quantile(self, p: Array, width: float) -> Array:
        """Places (m from the curtain's middle) left of which the shares ``p`` of its mass fall."""
        return made_by(profiles, self.distribution, p, width, **self.given)


class Feed(Weighed):
    """[feed]: the falling curtain."""

    start: Literal["falling", "resting"] = Field(
        "falling", description="resting: granules lie still on the body when its vibration begins"
    )
    height: Annotated[Length, UNSET] = Field(
        0.0, description="height of free fall from rest down to the top of the body; without a body down to level"
    )
    speed: Speed | None = Field(None, description="instead of height: speed at the top of the body, or at level")
    level: Coordinate | None = Field(
        None, description="only without a body: y where the curtain enters the air; default the channel's top"
    )
    direction: AnyAngle | None = Field(
        None, description="only without a body: direction of speed at level, from the x axis; default: along gravity"
    )
    scatter: ScatterAngle = Field(
        0.0, description="only without a body: rms angle between a granule's direction and the feed's"
    )
    width: Length
    position: Coordinate = Field(0.0, description="x of the curtain's middle")
    profile: Annotated[Profile, Shorthand(str, lambda x: {"distribution": x} if isinstance(x, str) else x)] = Field(
        Profile(distribution="uniform"), description="spread of the mass across the width: a name, or a table"
    )
    depth: Length = Field(1.0, description="depth of the machine, across the plane")
    rate: Annotated[MassRate, UNSET] = Field(
        0.0, description="mass flow of all fractions, or by depth, '800 kg/h/m'; default 1 kg/s per metre of depth"
    )
    count: Annotated[int, Field(ge=16, le=10_000_000)] = Field(16384, description="granules tracked per fraction")
    seed: Annotated[int, Field(ge=0)] = 0
    mode: Literal["auto", "injected", "resolved"] = Field(
        "auto",
        description="injected: eq. (1)-(2) at the slope, granules that the air carries round the body apart; resolved: "
        "by the tracker; auto: by what injection would miss",
    )

    @field_validator("rate", mode="before")
    @classmethod
    def _of_the_depth(cls, given: object, before: ValidationInfo) -> object:
        """The rate of the whole depth where it is said by depth, "800 kg/h/m"."""
        if not isinstance(given, str):
            return given
        try:
            return quantity(given, "kg/s/m", "800 kg/h/m") * before.data.get("depth", 1.0)  # a wrong one is told itself
        except ValueError as problem:
            if "needs a number" in str(problem):  # it tells no cure: a rate of the whole depth, or none
                return given
            raise

    @model_validator(mode="after")
    def _one_start(self) -> Feed:
        if self.start == "resting":
            if self.height or self.speed is not None or self.mode == "injected":
                raise SceneError("granules that start resting take neither height nor speed, and are not injected")
        elif (self.height > 0.0) == (self.speed is not None):
            raise SceneError("give either height or speed")
        self.profile.quantile(np.array([0.5]), self.width)
        if (self.direction is not None or self.scatter > 0.0) and self.speed is None:
            raise SceneError("direction and scatter go with speed; granules that fall from a height come straight down")
        return self

    def places(self, p: Array) -> Array:
        """x (m) left of which the shares ``p`` of the curtain's mass fall."""
        return self.position + self.profile.quantile(p, self.width)

    @property
    def falls(self) -> bool:
        """Whether the curtain comes straight down the channel's axis."""
        return self.direction is None or abs(math.cos(self.direction)) < EVEN

    @property
    def symmetric(self) -> bool:
        """Whether the curtain falls straight down, and is its own mirror image about x = 0."""
        left, right = (self.profile.quantile(part, 1.0) for part in (PARTS, 1.0 - PARTS))
        return self.falls and self.position == 0.0 and bool(np.allclose(left, -right, atol=EVEN))

    @property
    def crowding(self) -> float:
        """How much denser the curtain is about a granule, in the mean, than one of uniform density over its width."""
        return crowding(lambda p: self.profile.quantile(p, self.width), self.width)

    @property
    def fall_speed(self) -> float:
        """Fall speed (m/s) at the top of the body, or at level, by free fall without air: the paper's V0."""
        if self.speed is not None:
            return self.speed
        return math.sqrt(2 * self.gravity * self.height)

    @property
    def mass_flow(self) -> float:
        """kg/s of all fractions together."""
        return self.rate or self.depth * 1.0


# -- [collisions] ------------------------------------------------------------------------------------------------------
class CollisionTable(Table):
    """[collisions]: granules among themselves; whether their meetings are computed the plan decides, or --force."""

    depth: Annotated[Length, UNSET] = Field(
        0.0, description="depth of slab across the picture, periodic; default 15 of the coarsest granules' diameters"
    )
    count: Annotated[int, Field(ge=16, le=10_000_000), UNSET] = Field(
        0, description="granules of a fraction that count in the slab; default what numerics.target_error needs"
    )
    restitution: Annotated[float, Field(ge=0, le=1)] = Field(0.5, description="restitution of one granule on another")
    friction: Annotated[float, Field(ge=0, le=10)] = Field(0.3, description="friction of one granule on another")


# -- [funnel]: a vibrated conical funnel full of beads, whose discharge is computed bead by bead -----------------------
LOOSE = 0.60  # packing of poured spheres (0.58 to 0.61), before it is measured in the bed
MAX_BEADS = 50_000  # beads: hours
USUAL = 0.5  # m/s of beads that meet in a funnel: where a material's restitution is taken


class Funnel(Weighed):
    """[funnel]: beads in a cone with an open outlet, after the paper's Figs. 8-10.

    The paper gives beads, mass, frequencies and Gamma, not the orifice, the cone's angle or the wall's friction: those
    defaults are this program's.
    """

    computed: bool = Field(
        True, description="whether bead by bead, with LIGGGHTS; false: the rate is that of Beverloo's law, at rest"
    )
    orifice: Length = Field(0.010, description="inner diameter of the outlet")
    half_angle: SlopeAngle = Field(math.radians(30), description="half angle of the cone, its wall from the vertical")
    width: Annotated[Length, UNSET] = Field(
        0.0, description="inner diameter of the straight part above the cone; default: as needed"
    )
    material: str = Field("glass-beads", description="one of: " + ", ".join(materials))
    low: Diameter = Field(1.1e-3, description="smallest bead; sizes are uniform between low and high")
    high: Diameter = Field(1.3e-3, description="largest bead")
    density: MassDensity = Field(
        default_factory=lambda given: materials[given["material"]].density,
        description="density of a bead; default: the material's",
    )
    mass: Annotated[Mass, UNSET] = Field(0.0, description="mass of all beads; default 35 g")
    count: Annotated[int, Field(ge=10, le=MAX_BEADS), UNSET] = Field(0, description="number of beads, instead of mass")
    restitution: Annotated[float, Field(gt=0.05, le=1)] = Field(
        default_factory=lambda given: float(restitution_at(materials[given["material"]].restitution, USUAL)),
        description="default: the material's",
    )
    friction: Annotated[float, Field(ge=0, le=10)] = Field(
        default_factory=lambda given: materials[given["material"]].friction, description="friction of bead on bead"
    )
    wall_friction: Annotated[float, Field(ge=0, le=10)] = Field(0.3, description="friction on the cone: a matte print")
    rolling_friction: Annotated[float, Field(ge=0, le=1)] = 0.0
    youngs_modulus: Modulus = Field(5e6, description="Young's modulus of beads and wall; softened: glass has 6e10 Pa")
    frequency: Annotated[Frequency, UNSET] = Field(0.0, description="frequency of the vertical vibration")
    gamma: Annotated[float, Field(ge=0, le=50)] = Field(0.0, description="peak acceleration over g; 0: at rest")
    steps_per_contact: Annotated[int, Field(ge=10, le=500)] = Field(
        25, description="time steps in the duration of a collision"
    )
    seed: Annotated[int, Field(ge=0)] = 0

    @field_validator("material")
    @classmethod
    def _of_the_list(cls, value: str) -> str:
        """Check the material before the numbers that are its own by default."""
        _ = materials[value]
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Funnel:
        if not self.low <= self.high:
            raise SceneError(f"low = {metres(self.low)} must not be above high = {metres(self.high)}")
        if self.high > 2 * self.low:
            raise SceneError(
                f"high = {metres(self.high)} is over twice low = {metres(self.low)}: give a narrower range"
            )
        if self.mass and self.count:
            raise SceneError("give either mass or count")
        if self.gamma > 0 and not self.frequency:
            raise SceneError(f"gamma = {self.gamma:g} needs a frequency")
        if self.orifice < 2 * self.high:
            raise SceneError(f"orifice = {metres(self.orifice)}: no two beads of {metres(self.high)} pass side by side")
        if self.width and self.width < 1.5 * self.orifice:
            raise SceneError(
                f"width = {metres(self.width)} must be at least 1.5 times orifice = {metres(self.orifice)}"
            )
        if not 10 <= self.beads <= MAX_BEADS:
            raise SceneError(f"mass is that of {self.beads} beads (allowed: 10 to {MAX_BEADS})")
        return self

    @property
    def diameter(self) -> float:
        """Mean diameter (m)."""
        return 0.5 * (self.low + self.high)

    @property
    def bead_mass(self) -> float:
        """Mean mass of a bead (kg), of diameters uniform between low and high: pi/6 rho <d^3>."""
        cube = 0.25 * (self.low + self.high) * (self.low**2 + self.high**2)
        return self.density * math.pi / 6 * cube

    @property
    def beads(self) -> int:
        """How many beads there are."""
        return self.count or round((self.mass or 0.035) / self.bead_mass)

    @property
    def total_mass(self) -> float:
        """kg, on average over seeds."""
        return self.beads * self.bead_mass

    @property
    def shaken_at(self) -> float:
        """Frequency (Hz) of the wall's motion; 0 at rest."""
        return self.frequency if self.gamma else 0.0

    @property
    def amplitude(self) -> float:
        """Amplitude (m) of the wall's motion amplitude sin(2 pi f t): Gamma g / omega^2; 0 at rest."""
        return self.gravity * self.gamma / (2 * math.pi * self.shaken_at) ** 2 if self.shaken_at else 0.0

    @property
    def expected_rate(self) -> float:
        """Mass flow (kg/s) by Beverloo's law for the poured bed at rest: the rate that a plan uses."""
        return beverloo(self.orifice, self.diameter, LOOSE * self.density, gravity=self.gravity)
