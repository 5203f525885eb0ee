"""[feed] and [collisions]: the falling curtain, and how its granules meet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ..core.errors import SceneError
from ..core.quantities import quantity
from ..laws.profile import crowding, profiles
from .table import (
    AnyAngle,
    Array,
    Coordinate,
    Length,
    MassRate,
    ScatterAngle,
    Shorthand,
    Speed,
    Table,
    Weighed,
    made_by,
)

EVEN = 1e-9  # of the curtain's width: what is so near is the same
PARTS = np.linspace(0.05, 0.45, 5)  # of the curtain's mass, at which its two sides are compared


# -- [feed]: the falling curtain ---------------------------------------------------------------------------------------
class Profile(Table):
    """How the curtain's mass is spread over its width: ``distribution`` and its parameters."""

    distribution: str = Field(description="one of: " + ", ".join(profiles))
    std: Length | None = Field(None, description="normal: standard deviation; default a quarter of the width")
    positions: list[Coordinate] | None = Field(None, description="table: from the curtain's middle, increasing")
    weights: list[Annotated[float, Field(ge=0)]] | None = Field(
        None, description="table: mass per width at each position, in any unit"
    )

    def quantile(self, p: Array, width: float) -> Array:
        """Places (m from the curtain's middle) left of which the shares ``p`` of its mass fall."""
        given = self.model_dump(exclude_none=True, exclude={"distribution"})
        return made_by(profiles, self.distribution, p, width, **given)


def _one_word(value: object) -> object:
    """``profile = "triangular"`` is short for a table with that distribution alone."""
    return {"distribution": value} if isinstance(value, str) else value


class Feed(Weighed):
    """[feed]: the falling curtain."""

    start: Literal["falling", "resting"] = Field(
        "falling", description="resting: granules lie still on the body when its vibration begins"
    )
    height: Length | None = Field(
        None, description="of free fall from rest down to the top of the body; without a body down to level"
    )
    speed: Speed | None = Field(None, description="instead of height: speed at the top of the body, or at level")
    level: Coordinate | None = Field(
        None, description="only without a body: y where the curtain enters the air; default the channel's top"
    )
    direction: AnyAngle | None = Field(
        None, description="only without a body: of speed at level, from the x axis; default: along gravity"
    )
    scatter: ScatterAngle = Field(
        0.0, description="only without a body: rms angle between a granule's direction and the feed's"
    )
    width: Length
    position: Coordinate = Field(0.0, description="x of the curtain's middle")
    profile: Annotated[Profile, Shorthand(str, _one_word)] = Field(
        Profile(distribution="uniform"), description="of the mass across the width: a name, or a table"
    )
    rate: MassRate | None = Field(
        None, description="mass flow of all fractions, or by depth, '800 kg/h/m'; default 1 kg/s per metre of depth"
    )
    depth: Length = Field(1.0, description="of the machine, across the plane")
    count: Annotated[int, Field(ge=16, le=10_000_000)] = Field(16384, description="granules tracked per fraction")
    seed: Annotated[int, Field(ge=0)] = 0
    mode: Literal["auto", "injected", "resolved"] = Field(
        "auto",
        description="injected: eq. (1)-(2) at the slope, granules that the air carries round the body apart; resolved: "
        "by the tracker; auto: by what injection would miss",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_the_depth(cls, given: object) -> object:
        """The rate of the whole depth where it is said by depth, "800 kg/h/m"."""
        if not isinstance(given, Mapping) or not isinstance(given.get("rate"), str):
            return given
        try:
            by_depth = quantity(given["rate"], "kg/s/m", "")
        except ValueError:
            return given
        depth = given.get("depth", 1.0)
        try:
            return {**given, "rate": by_depth * (quantity(depth, "m", "") if isinstance(depth, str) else depth)}
        except (TypeError, ValueError):
            return {**given, "rate": None}  # what is wrong is the depth

    @model_validator(mode="after")
    def _one_start(self) -> Feed:
        if self.start == "resting":
            if self.height is not None or self.speed is not None or self.mode == "injected":
                raise SceneError("granules that start resting take neither height nor speed, and are not injected")
        elif (self.height is None) == (self.speed is None):
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
        return math.sqrt(2 * self.gravity * (self.height or 0.0))

    @property
    def mass_flow(self) -> float:
        """kg/s of all fractions together."""
        return self.rate if self.rate is not None else self.depth * 1.0


# -- [collisions] ------------------------------------------------------------------------------------------------------
class CollisionTable(Table):
    """[collisions]: granules among themselves; whether their meetings are computed the plan decides, or --force."""

    depth: Length | None = Field(
        None, description="of the slab across the picture, periodic; default 15 of the coarsest granules' diameters"
    )
    count: Annotated[int, Field(ge=16, le=10_000_000)] | None = Field(
        None, description="granules of a fraction that count in the slab; default what numerics.target_error needs"
    )
    restitution: Annotated[float, Field(ge=0, le=1)] = Field(0.5, description="of one granule on another")
    friction: Annotated[float, Field(ge=0, le=10)] = Field(0.3, description="of one granule on another")
