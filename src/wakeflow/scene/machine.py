"""[body.NAME], [channel], [air], [vibration] and [bin.NAME]: the machine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import ConfigDict, Field, PrivateAttr, model_validator

from ..core.errors import SceneError, known
from ..core.geometry import is_simple, rounded
from ..core.quantities import metres, say
from ..core.record import JsonTable
from ..laws.constants import GRAVITY
from ..laws.gas import PRESSURE, TEMPERATURE, air_density, air_viscosity, mean_free_path
from ..laws.shape import shapes
from ..laws.vibration import Record, integrated
from .table import (
    SHARE,
    AnyAngle,
    Array,
    Coordinate,
    FreePath,
    Frequency,
    Length,
    MassDensity,
    Name,
    Point,
    PositiveSpeed,
    Pressure,
    RockAngle,
    SlopeAngle,
    Table,
    Temperature,
    TiltAngle,
    Viscosity,
    Weighed,
    WithUnit,
    made_by,
)

# -- [body.NAME], [channel], [air] and [vibration] ---------------------------------------------------------------------
MAX_GAMMA = 50.0  # peak acceleration over g
SLOWEST_AIR = 1e-6  # m/s, of air that is not at rest


def _shape_or_drawing(schema: JsonTable) -> None:
    """A drawing is read before the tables are validated: in the schema either will do."""
    schema["anyOf"] = [{"required": [key]} for key in (*schema.pop("required"), "outline")]


class Body(Table):
    """[body.NAME]: a solid in the flow."""

    model_config = ConfigDict(json_schema_extra=_shape_or_drawing)
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
    drawing: str | None = Field(
        None,
        alias="outline",
        description="instead of shape: a DXF file with one closed outline, in the body's own frame",
    )
    outline_layer: str | None = Field(None, description="of the DXF file that the outline is on; default: all")
    outline_unit: str | None = Field(None, description="of the DXF file's numbers, such as mm; default: the file's own")
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
        sharp = made_by(shapes, self.shape, **given)
        return np.asarray((sharp if self.rounding is None else rounded(sharp, self.rounding)) + np.asarray(self.at))


class Inlet(Table):
    """[channel.inlet.NAME]: a secondary air stream through an opening in a wall, normal to it; granules that reach the
    opening leave the channel there.
    """

    side: Literal["left", "right"] = Field(description="the wall that it comes through")
    position: Coordinate = Field(description="y of its middle")
    width: Length = Field(description="of the opening, along the wall")
    velocity: PositiveSpeed = Field(description="into the channel, uniform")

    @property
    def span(self) -> tuple[float, float]:
        """y of its lower and upper end (m)."""
        return self.position - self.width / 2, self.position + self.width / 2


class Channel(Table):
    """[channel]: the duct along y, centred on x = 0, from ``bottom`` (the floor) to ``top``; vertical without tilt."""

    width: Length
    top: Coordinate
    bottom: Coordinate
    walls: Literal["slip", "no-slip"] = Field("slip", description="for the air; granules bounce off either")
    tilt: TiltAngle = Field(
        0.0, description="-90 to 90 deg, of a machine that does not stand upright: from -y towards +x gravity points"
    )
    extend: bool = Field(True, description="compute the air in a longer channel where an end is too near to a body")
    inlet: dict[Name, Inlet] = Field({}, description="secondary air streams through the walls")


def _speed_or_case(schema: JsonTable) -> None:
    """A case's speed is read before the tables are validated: in the schema either will do."""
    schema["anyOf"] = [{"required": [key]} for key in (*schema.pop("required"), "case")]


class Air(Table):
    """[air]: leave the table out for a vacuum.

    With ``case`` the air of a user's own OpenFOAM case, already solved; what the case says of speed, direction and
    viscosity need not be given, what is given is checked against it.
    """

    model_config = ConfigDict(json_schema_extra=_speed_or_case)
    speed: Annotated[float, Field(ge=0, le=100), WithUnit("m/s", "5 m/s")] = Field(description="0: air at rest")
    direction: Literal["down", "up"] = Field("down", description="to which the air blows")
    temperature: Temperature = TEMPERATURE
    pressure: Pressure = Field(PRESSURE, description="absolute")
    density: MassDensity = Field(
        default_factory=lambda air: air_density(air["temperature"], air["pressure"]),
        description="default: of air of that temperature and pressure",
    )
    viscosity: Viscosity = Field(
        default_factory=lambda air: air_viscosity(air["temperature"]),
        description="dynamic; default: of air of that temperature",
    )
    mean_free_path: FreePath = Field(
        default_factory=lambda air: mean_free_path(
            air["density"], air["viscosity"], air["temperature"], air["pressure"]
        ),
        description="of its molecules, between which fine granules slip; default: of a gas of that density, viscosity, "
        "temperature and pressure, 0 for a liquid",
    )
    turbulence: Annotated[float, Field(ge=0.0, le=0.5), WithUnit("1", "5 %")] = Field(
        0.05, description="inlet intensity, u'/U; 0 only where the air is laminar"
    )
    profile: Literal["uniform", "parabolic"] = Field(
        "uniform", description="at the inlet; parabolic: fully developed laminar flow, speed is its mean"
    )
    case: str | None = Field(None, description="folder of a solved OpenFOAM case, relative to the scene file")
    time: Literal["latest", "mean", "all"] | None = Field(
        None, description="of the case: its last time (default), the mean of its times, or all of them"
    )

    @property
    def still(self) -> bool:
        """Whether the air is at rest."""
        return self.speed == 0.0

    @property
    def rises(self) -> bool:
        """Whether the air blows up."""
        return self.direction == "up" and not self.still

    @property
    def blows(self) -> str:
        """In words: "5 m/s down", or "at rest"."""
        return "at rest" if self.still else f"{say(self.speed, 'm/s', 3)} {self.direction}"

    @model_validator(mode="after")
    def _moves_or_rests(self) -> Air:
        if 0.0 < self.speed < SLOWEST_AIR:
            raise SceneError(f"speed = {self.speed:g} m/s: at least {SLOWEST_AIR:g} m/s, or 0 for air at rest")
        if self.still and self.case is not None:
            raise SceneError("speed = 0 does not go with case: the case says how fast its air is")
        if self.still and self.profile != "uniform":
            raise SceneError("speed = 0 does not go with profile: air at rest has none")
        return self

    @model_validator(mode="after")
    def _case_alone(self) -> Air:
        if self.case is None and self.time is not None:
            raise SceneError("time is for a case of your own: give case as well")
        if self.case is not None and self.profile != "uniform":
            raise SceneError("profile does not go with case: the case has its own inlet")
        return self


def _or_a_file(schema: JsonTable) -> None:
    """The name of a file is read before the tables are validated, and allowed in the schema only."""
    given = schema.pop("anyOf", None) or [{"$ref": schema.pop("$ref")}]
    schema["anyOf"] = [*given, {"type": "string"}]


class Samples(Table):
    """A measured acceleration along the vibration's direction: one period, which repeats."""

    time: list[float] = Field(description="s, increasing; the last sample is the first of the next period")
    acceleration: list[float] = Field(description="m/s2; its mean is taken off")


class Vibration(Weighed):
    """[vibration]: motion of the bodies: harmonic, displacement = amplitude sin(2 pi f t), along ``direction`` or as
    one piece about a ``pivot``; or by measured samples of the acceleration.
    """

    frequency: Frequency | None = None
    amplitude: Length | None = None
    gamma: Annotated[float, Field(gt=0, le=MAX_GAMMA)] | None = Field(None, description="peak acceleration over g")
    direction: AnyAngle = Field(math.pi / 2, description="from the x axis; 90 deg is vertical")
    samples: Samples | None = Field(
        None,
        description="instead of frequency and strength: a CSV file (time s, acceleration m/s2), or both as lists",
        json_schema_extra=_or_a_file,
    )
    pivot: Point | None = Field(None, description="all bodies rock about it as one piece, by angle")
    angle: RockAngle | None = Field(None, description="about the pivot, to either side: up to 30 deg")
    _arms: tuple[float, float] = PrivateAttr((0.0, 0.0))

    @model_validator(mode="before")
    @classmethod
    def _along_a_line_or_about_a_pivot(cls, given: object) -> object:
        if isinstance(given, Mapping) and given.get("pivot") is not None:
            for key in ("amplitude", "gamma", "samples", "direction"):
                if given.get(key) is not None:
                    raise SceneError(f"{key} is of a motion along a line; about a pivot give frequency and angle")
        return given

    def told_arms(self, bodies: Mapping[str, Body]) -> None:
        """Take how far (m) from the pivot, along x and along y, the scene's bodies reach."""
        if self.pivot is not None and bodies:
            corners = np.concatenate([body.outline() for body in bodies.values()])
            x, y = np.abs(corners - np.asarray(self.pivot)).max(axis=0).tolist()
            self._arms = x, y

    @model_validator(mode="after")
    def _one_motion(self) -> Vibration:
        if self.samples is not None:
            if (self.frequency, self.amplitude, self.gamma) != (None, None, None):
                raise SceneError("samples say how fast and how far it moves: leave out frequency, amplitude and gamma")
            if (found := self.record.peak_acceleration / GRAVITY) > MAX_GAMMA:
                raise SceneError(f"samples: peak acceleration of {found:.3g} g, allowed {MAX_GAMMA:g} g")
        elif (self.pivot is None) != (self.angle is None):
            raise SceneError("pivot and angle go together: the place it rocks about, and how far to either side")
        elif self.frequency is None:
            raise SceneError("give frequency, and either amplitude or gamma, or pivot and angle; or samples")
        elif self.pivot is not None:
            return self
        elif (self.amplitude is None) == (self.gamma is None):
            raise SceneError("give either amplitude or gamma")
        return self

    @cached_property
    def record(self) -> Record:
        """The motion that the samples make. Only where there are samples."""
        return integrated(known(self.samples).time, known(self.samples).acceleration)

    @property
    def period(self) -> float:
        """Seconds after which the motion repeats."""
        if self.samples is not None:
            return self.record.period
        return 1.0 / known(self.frequency)

    @property
    def omega(self) -> float:
        """Angular frequency (rad/s); for samples that of their period."""
        return 2 * math.pi / self.period

    @property
    def along(self) -> Array:
        """Unit vector (2,) of the direction."""
        return np.array([math.cos(self.direction), math.sin(self.direction)])

    @property
    def displacement(self) -> Array:
        """Amplitude vector (m), shape (2,); from Gamma = a w^2 / g when gamma is given; for samples the largest
        displacement; about a pivot of the body's farthest places along x and along y, to first order in the angle.
        """
        if self.pivot is not None:
            return known(self.angle) * np.array(self._arms[::-1])
        if self.samples is not None:
            return self.record.reach * self.along
        if self.amplitude is not None:
            return self.amplitude * self.along
        return known(self.gamma) * self.gravity / self.omega**2 * self.along

    @property
    def speed(self) -> Array:
        """Peak velocity vector (m/s), shape (2,)."""
        return self.displacement * self.omega if self.samples is None else self.record.peak_speed * self.along

    @property
    def strength(self) -> float:
        """Gamma: peak acceleration over g."""
        if self.samples is not None:
            return self.record.peak_acceleration / self.gravity
        return float(np.linalg.norm(self.displacement)) * self.omega**2 / self.gravity


# -- [bin.NAME]: the collectors ----------------------------------------------------------------------------------------
class BinPlace(Protocol):
    """What a bin lies on: a scene."""

    @property
    def channel(self) -> Channel: ...

    @property
    def body(self) -> Mapping[str, Body]: ...


SIDES = ("floor", "top", "left", "right")  # of the channel


class Bin(Table):
    """[bin.NAME]: a collector: an opening in the channel's boundary, a line of points, or a wall that keeps what
    touches it, or a part of that: a body, or a stretch of a side.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)
    start: Coordinate | None = Field(None, alias="from", description="x on the floor or top, y on a side")
    to: Coordinate | None = None
    on: Literal["floor", "left", "right", "top"] | Name = Field(
        "floor", description="the side of the channel it lies on; or a body, which then keeps what touches it"
    )
    keeps: Annotated[float, Field(ge=0, le=1), SHARE] | None = Field(
        None,
        description="part of what meets the wall, at each impact, that stays there: a side is then a wall, not an "
        "opening; of a body all by default. 0: only what stays by sticks or capture_speed of its fraction",
    )
    points: list[Point] | None = Field(None, description="a polyline anywhere in the channel, instead of from and to")

    @model_validator(mode="after")
    def _one_place(self) -> Bin:
        if self.on_body:
            if (self.start, self.to, self.points) != (None, None, None):
                raise SceneError(f"on = {self.on!r} is the whole body of that name: leave out from, to and points")
        elif self.points is not None:
            if self.keeps is not None:
                raise SceneError("keeps is of a wall, on a body or a side of the channel; a line of points takes all")
            if self.start is not None or self.to is not None:
                raise SceneError("give either points, or from and to")
            if len(self.points) < 2:
                raise SceneError("points needs at least two [x, y] pairs")
            if not np.all(np.linalg.norm(np.diff(self.points, axis=0), axis=1) > 0):
                raise SceneError("points repeats a point")
        elif self.start is None or self.to is None:
            raise SceneError("give from and to (or points)")
        elif not self.start < self.to:
            raise SceneError(f"from = {metres(self.start)} must be below to = {metres(self.to)}")
        return self

    @property
    def on_body(self) -> bool:
        """Whether it is a body, all of it."""
        return self.on not in SIDES

    @property
    def stretch(self) -> str | None:
        """The side of the channel that it is a stretch of; None for a line of points and for a body."""
        return None if self.on_body or self.points is not None else self.on

    @property
    def side(self) -> str | None:
        """The side of the channel in which it is an opening; None for a line of points and for what is a wall."""
        return self.stretch if self.keeps is None else None

    @property
    def keeps_part(self) -> float | None:
        """Part of the impacts on it that it keeps, where it is a wall; None for what takes all that comes to it."""
        return 1.0 if self.on_body and self.keeps is None else self.keeps

    def line(self, scene: BinPlace) -> Array:
        """The collector as a polyline, (k, 2) in metres; of a body its outline, closed."""
        channel = scene.channel
        if self.points is not None:
            return np.asarray(self.points, dtype=float)
        if self.on_body:
            outline = scene.body[self.on].outline()
            return np.vstack([outline, outline[:1]])
        along = np.array([known(self.start), known(self.to)])
        fixed = {"floor": channel.bottom, "top": channel.top, "left": -channel.width / 2, "right": channel.width / 2}[
            self.on
        ]
        across = np.full(2, fixed)
        return np.stack([along, across] if self.on in ("floor", "top") else [across, along], axis=1)
