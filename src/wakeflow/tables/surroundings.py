"""[body.NAME], [channel], [air] and [vibration]: what stands in the air, and the air."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ..errors import SceneError
from ..geometry import is_simple, rounded
from ..laws.shape import shapes
from ..quantities import (
    AnyAngle,
    Coordinate,
    Density,
    Frequency,
    Length,
    Name,
    Point,
    PositiveSpeed,
    SlopeAngle,
    Viscosity,
)  # fmt: skip
from .common import GRAVITY, STANDARD_AIR, Array, Table, takes

__all__ = ["Air", "Body", "Channel", "Inlet", "Vibration"]


class Body(Table):
    """[body.NAME]: a solid in the flow."""

    shape: str = Field(description="one of: " + ", ".join(shapes))
    width: Length | None = Field(None, description="horizontal extent; not for polygon")
    slope_angle: SlopeAngle | None = Field(None, description="of the faces, from the horizontal: 10 to 80 deg")
    height: Length | None = Field(None, description="instead of slope_angle")
    apex: Literal["up", "down"] | None = Field(None, description="prism only")
    length: Length | None = Field(None, description="plate only: along its faces")
    thickness: Length | None = Field(None, description="plate only")
    descends: Literal["left", "right"] | None = Field(None, description="plate only: to which side it falls; right")
    points: list[Point] | None = Field(None, description="polygon only: corners in the body's own frame")
    corners: Annotated[int, Field(ge=16, le=720)] | None = Field(None, description="circle only: of its polygon; 120")
    rounding: Length | None = Field(
        None, description="radius of all edges; width and height are those of the sharp shape"
    )
    at: Point = Field([0.0, 0.0], description="where the body's centre is")

    @model_validator(mode="after")
    def _has_an_outline(self) -> Body:
        if not is_simple(self.outline()):
            raise SceneError("the outline crosses itself")
        return self

    def outline(self) -> Array:
        """Corners (k, 2) in the scene's frame (m), counter-clockwise."""
        given = self.model_dump(exclude_none=True, exclude={"shape", "at", "rounding"})
        try:
            sharp = shapes[self.shape](**given)
        except TypeError:
            raise SceneError(takes("shape", self.shape, shapes[self.shape], given)) from None
        return (sharp if self.rounding is None else rounded(sharp, self.rounding)) + np.asarray(self.at)


class Inlet(Table):
    """[channel.inlet.NAME]: a secondary air stream through an opening in a wall, normal to it; granules that reach the
    opening leave the channel there.
    """

    side: Literal["left", "right"]
    position: Coordinate = Field(description="y of its middle")
    width: Length = Field(description="of the opening, along the wall")
    velocity: PositiveSpeed = Field(description="into the channel, uniform")

    @property
    def span(self) -> tuple[float, float]:
        """y of its lower and upper end (m)."""
        return self.position - self.width / 2, self.position + self.width / 2


class Channel(Table):
    """[channel]: the vertical duct, centred on x = 0, from ``bottom`` (the floor) to ``top``."""

    width: Length
    top: Coordinate
    bottom: Coordinate
    walls: Literal["slip", "no-slip"] = Field("slip", description="for the air; granules bounce off either")
    extend: bool = Field(True, description="compute the air in a longer channel where an end is too near to a body")
    inlet: dict[Name, Inlet] = Field({}, description="secondary air streams through the walls")


class Air(Table):
    """[air]: leave the table out for a vacuum.

    With ``case`` the air of a user's own OpenFOAM case, already solved; what the case says of speed, direction and
    viscosity need not be given, what is given is checked against it.
    """

    speed: PositiveSpeed
    direction: Literal["down", "up"] = "down"
    density: Density = STANDARD_AIR[0]
    viscosity: Viscosity = STANDARD_AIR[1]
    turbulence: Annotated[float, Field(ge=0.001, le=0.5)] = Field(0.05, description="inlet intensity, u'/U")
    profile: Literal["uniform", "parabolic"] = Field(
        "uniform", description="at the inlet; parabolic: fully developed laminar flow, speed is its mean"
    )
    case: str | None = Field(None, description="folder of a solved OpenFOAM case, relative to the scene file")
    time: Literal["latest", "mean", "all"] | None = Field(
        None, description="of the case: its last time (default), the mean of its times, or all of them"
    )

    @model_validator(mode="after")
    def _case_alone(self) -> Air:
        if self.case is None and self.time is not None:
            raise SceneError("time is for a case of your own: give case as well")
        if self.case is not None and self.profile != "uniform":
            raise SceneError("profile does not go with case: the case has its own inlet")
        return self


class Vibration(Table):
    """[vibration]: harmonic motion of the bodies, displacement = amplitude sin(2 pi f t) along ``direction``."""

    frequency: Frequency
    amplitude: Length | None = None
    gamma: Annotated[float, Field(gt=0, le=50)] | None = Field(None, description="peak acceleration over g")
    direction: AnyAngle = Field(math.pi / 2, description="from the x axis; 90 deg is vertical")

    @model_validator(mode="after")
    def _one_strength(self) -> Vibration:
        if (self.amplitude is None) == (self.gamma is None):
            raise SceneError("give either amplitude or gamma")
        return self

    @property
    def omega(self) -> float:
        """Angular frequency (rad/s)."""
        return 2 * math.pi * self.frequency

    @property
    def displacement(self) -> Array:
        """Amplitude vector (m), shape (2,). From Gamma = a w^2 / g when gamma is given."""
        if self.amplitude is not None:
            size = self.amplitude
        else:
            assert self.gamma is not None
            size = self.gamma * GRAVITY / self.omega**2
        return size * np.array([math.cos(self.direction), math.sin(self.direction)])
