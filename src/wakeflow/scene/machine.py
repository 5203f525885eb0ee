"""[body.NAME], [channel], [air] and [vibration]: the machine, and where down is in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, PrivateAttr, model_validator

from ..core.errors import SceneError
from ..core.geometry import is_simple, rounded
from ..core.quantities import say
from ..core.record import JsonTable
from ..laws.constants import GRAVITY
from ..laws.gas import PRESSURE, TEMPERATURE, air_density, air_viscosity, mean_free_path
from ..laws.operating_point import FanPoint
from ..laws.shape import shapes
from ..laws.vibration import Record, integrated
from .table import (
    UNSET,
    AirFlow,
    AnyAngle,
    Array,
    Coordinate,
    Drop,
    FreePath,
    Frequency,
    LawTable,
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
    parameters,
    rise,
)

Loss = Annotated[float, Field(ge=0, le=1e6)]

# -- [body.NAME], [channel], [air] and [vibration] ---------------------------------------------------------------------
MAX_GAMMA = 50.0  # peak acceleration over g
SLOWEST_AIR = 1e-6  # m/s, of air that is not at rest


def _shape_or_drawing(schema: JsonTable) -> None:
    """A drawing is read before the tables are validated: in the schema either will do."""
    schema["anyOf"] = [{"required": [key]} for key in (*schema.pop("required"), "outline")]


@parameters(
    width=(Length, "horizontal extent; not for polygon"),
    slope_angle=(SlopeAngle, "angle of the faces, from the horizontal: 10 to 80 deg"),
    height=(Length, "instead of slope_angle"),
    apex=(Literal["up", "down"], "prism only"),
    length=(Length, "plate only: length along its faces"),
    thickness=(Length, "plate only"),
    descends=(Literal["left", "right"], "plate only: to which side it falls; right"),
    points=(list[Point], "polygon only: corners in the body's own frame"),
    corners=(Annotated[int, Field(ge=16, le=720)], "circle only: corners of its polygon; 120"),
    drawing=(str, "instead of shape: a DXF file with one closed outline, in the body's own frame", "outline"),
    outline_layer=(str, "layer of the DXF file that the outline is on; default: all"),
    outline_unit=(str, "unit of the DXF file's numbers, such as mm; default: the file's own"),
)
class Body(LawTable):
    """[body.NAME]: a solid in the flow."""

    model_config = ConfigDict(json_schema_extra=_shape_or_drawing)
    shape: str = Field(description="one of: " + ", ".join(shapes))
    rounding: Annotated[Length, UNSET] = Field(
        0.0, description="radius of all edges; width and height are those of the sharp shape"
    )
    at: Point = Field([0.0, 0.0], description="where the body's centre is")

    @model_validator(mode="after")
    def _has_an_outline(self) -> Body:
        if not is_simple(self.outline()):
            raise SceneError("the outline crosses itself")
        return self

    def outline(self) -> Array:
        """Corners (k, 2) in the scene's frame (m), counter-clockwise."""
        sharp = made_by(shapes, self.shape, **self.given)
        return np.asarray((rounded(sharp, self.rounding) if self.rounding else sharp) + np.asarray(self.at))


class Inlet(Table):
    """[channel.inlet.NAME]: a secondary air stream through an opening in a wall, normal to it; granules that reach the
    opening leave the channel there.
    """

    side: Literal["left", "right"] = Field(description="the wall that it comes through")
    position: Coordinate = Field(description="y of its middle")
    width: Length = Field(description="width of the opening, along the wall")
    velocity: PositiveSpeed = Field(description="velocity into the channel, uniform")

    @property
    def span(self) -> tuple[float, float]:
        """y of its lower and upper end (m)."""
        return self.position - self.width / 2, self.position + self.width / 2


class Channel(Table):
    """[channel]: the duct along y, centred on x = 0, from ``bottom`` (the floor) to ``top``; vertical without tilt."""

    width: Length
    top: Coordinate
    bottom: Coordinate
    walls: Literal["slip", "no-slip"] = Field("slip", description="kind for the air; granules bounce off either")
    tilt: TiltAngle = Field(
        0.0, description="-90 to 90 deg, of a machine that does not stand upright: from -y towards +x gravity points"
    )
    extend: bool = Field(True, description="compute the air in a longer channel where an end is too near to a body")
    inlet: dict[Name, Inlet] = Field({}, description="secondary air streams through the walls")

    @property
    def sides(self) -> dict[str, float]:
        """Where each side lies: y of the floor and the top, x of the walls (m)."""
        return {"floor": self.bottom, "top": self.top, "left": -self.width / 2, "right": self.width / 2}

    def span(self, side: str) -> tuple[float, float]:
        """Ends between which a side reaches (m): x of the floor and the top, y of the walls."""
        return (-self.width / 2, self.width / 2) if side in ("floor", "top") else (self.bottom, self.top)


@parameters(
    flow=(list[AirFlow], "flows of the curve's points, rising; straight lines between them"),
    pressure=(list[Drop], "pressure that the fan gives at each flow"),
    p0=(Drop, "instead of points: pressure at no flow"),
    k=(Annotated[float, Field(gt=0, le=1e9)], "pressure = p0 - k flow^2, in Pa/(m3/s)^2"),
)
class Fan(LawTable):
    """[air.fan]: instead of air.speed, the fan's curve and what the air passes beside the channel."""

    speed_ratio: Annotated[float, Field(gt=0, le=4)] = Field(
        1.0, description="turns over those of the curve: flow grows with it, pressure with its square"
    )
    rest_drop: Drop = Field(0.0, description="drop of ducts, filter, cyclone and damper together at rest_flow")
    rest_flow: Annotated[AirFlow, UNSET] = Field(
        0.0, description="flow at which rest_drop was measured; it grows with the square"
    )
    rest_loss: Loss = Field(0.0, description="instead: their drop over density speed^2 / 2 of the channel's mean speed")
    channel_loss: Loss | None = Field(
        None, description="loss of channel and bodies alike, at first; default estimated. A run computes it"
    )

    @model_validator(mode="after")
    def _one_curve(self) -> Fan:
        given = self.given
        if ("p0" in given) != ("k" in given) or ("flow" in given) != ("pressure" in given):
            raise SceneError("give flow and pressure together, or p0 and k")
        if ("p0" in given) == ("flow" in given):
            raise SceneError("give the curve, either as flow and pressure or as p0 and k")
        flow = given.get("flow", (0.0, 1.0))
        if len(flow) != len(given.get("pressure", flow)) or len(flow) < 2 or flow[0] != 0.0 or not rise(flow):
            raise SceneError("the curve needs as many pressures as flows, two at least; flows rise from 0")
        if (self.rest_drop > 0.0) != (self.rest_flow > 0.0):
            raise SceneError("rest_drop is that at rest_flow: give both, above 0")
        return self

    @property
    def most(self) -> float:
        """The flow (m3/s) at which the curve ends."""
        given = self.given
        return float(self.speed_ratio * (given["flow"][-1] if "flow" in given else math.sqrt(given["p0"] / given["k"])))

    def gives(self, flow: Array) -> Array:
        """Pressure (Pa) at flows (n,) m3/s, by the affinity laws at other turns than those of the curve."""
        as_drawn, given = flow / self.speed_ratio, self.given
        if "flow" in given:
            result = np.interp(as_drawn, given["flow"], given["pressure"])
        else:
            result = given["p0"] - given["k"] * as_drawn**2
        return np.asarray(self.speed_ratio**2 * result)


def _speed_or_case(schema: JsonTable) -> None:
    """A case's speed is read before the tables are validated, a fan's found after: in the schema each will do."""
    schema["anyOf"] = [{"required": [key]} for key in (*schema.pop("required"), "case", "fan")]


class Air(Table):
    """[air]: leave the table out for a vacuum.

    With ``case`` the air of a user's own OpenFOAM case, already solved; what the case says of speed, direction and
    viscosity need not be given, what is given is checked against it. With ``fan`` the speed is where the fan's curve
    meets the machine's pressure drop, which the scene finds.
    """

    model_config = ConfigDict(json_schema_extra=_speed_or_case)
    speed: Annotated[float, Field(ge=0, le=100), WithUnit("m/s", "5 m/s")] = Field(description="0: air at rest")
    direction: Literal["down", "up"] = Field("down", description="way that the air blows")
    temperature: Temperature = TEMPERATURE
    pressure: Pressure = Field(PRESSURE, description="absolute")
    density: MassDensity = Field(
        default_factory=lambda air: air_density(air["temperature"], air["pressure"]),
        description="default: that of air of that temperature and pressure",
    )
    viscosity: Viscosity = Field(
        default_factory=lambda air: air_viscosity(air["temperature"]),
        description="dynamic; default: that of air of that temperature",
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
        "uniform", description="profile at the inlet; parabolic: fully developed laminar flow, speed is its mean"
    )
    case: Annotated[str, UNSET] = Field("", description="folder of a solved OpenFOAM case, relative to the scene file")
    time: Literal["latest", "mean", "all"] | None = Field(
        None, description="time of the case: its last time (default), the mean of its times, or all of them"
    )

    fan: Fan | None = Field(None, description="instead of speed: a fan's curve, and what else it blows the air through")
    _point: FanPoint | None = PrivateAttr(None)

    @property
    def point(self) -> FanPoint | None:
        """Where the fan's curve meets the machine's pressure drop; None without a fan."""
        return self._point

    def blown(self, point: FanPoint) -> None:
        """Take the speed at which the fan blows; it stays none that was given."""
        self._point = point
        self.__dict__["speed"] = point.speed.value
        self.model_fields_set.discard("speed")

    @model_validator(mode="before")
    @classmethod
    def _fan_alone(cls, given: Any) -> Any:
        if not isinstance(given, Mapping) or given.get("fan") is None:
            return given
        if wrong := [key for key in ("speed", "case") if key in given]:
            raise SceneError(f"{wrong[0]} does not go with fan, whose curve says how fast the air is")
        return {**given, "speed": SLOWEST_AIR}  # until the scene finds it

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
        """Speed and direction in words: "5 m/s down", or "at rest"."""
        return "at rest" if self.still else f"{say(self.speed, 'm/s', 3)} {self.direction}"

    @model_validator(mode="after")
    def _moves_or_rests(self) -> Air:
        if 0.0 < self.speed < SLOWEST_AIR:
            raise SceneError(f"speed = {self.speed:g} m/s: at least {SLOWEST_AIR:g} m/s, or 0 for air at rest")
        if self.still and self.case:
            raise SceneError("speed = 0 does not go with case: the case says how fast its air is")
        if self.still and self.profile != "uniform":
            raise SceneError("speed = 0 does not go with profile: air at rest has none")
        return self

    @model_validator(mode="after")
    def _case_alone(self) -> Air:
        if self.time and not self.case:
            raise SceneError("time is for a case of your own: give case as well")
        if self.case and self.profile != "uniform":
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


@parameters(
    frequency=Frequency,
    amplitude=Length,
    gamma=(Annotated[float, Field(gt=0, le=MAX_GAMMA)], "peak acceleration over g"),
    angle=(RockAngle, "angle about the pivot, to either side: up to 30 deg"),
)
class Vibration(Weighed, LawTable):
    """[vibration]: motion of the bodies: harmonic, displacement = amplitude sin(2 pi f t), along ``direction`` or as
    one piece about a ``pivot``; or by measured samples of the acceleration.
    """

    direction: AnyAngle = Field(math.pi / 2, description="angle from the x axis; 90 deg is vertical")
    samples: Samples | None = Field(
        None,
        description="instead of frequency and strength: a CSV file (time s, acceleration m/s2), or both as lists",
        json_schema_extra=_or_a_file,
    )
    pivot: Point | None = Field(None, description="all bodies rock about it as one piece, by angle")
    _arms: tuple[float, float] = PrivateAttr((0.0, 0.0))

    @model_validator(mode="before")
    @classmethod
    def _along_a_line_or_about_a_pivot(cls, given: object) -> object:
        if isinstance(given, Mapping) and given.get("pivot") is not None:
            for key in ("amplitude", "gamma", "samples", "direction"):
                if given.get(key) is not None:
                    raise SceneError(f"{key} is of a motion along a line; about a pivot give frequency and angle")
        return given

    def take_arms(self, bodies: Mapping[str, Body]) -> None:
        """Take how far (m) from the pivot, along x and along y, the scene's bodies reach."""
        if self.pivot is not None and bodies:
            corners = np.concatenate([body.outline() for body in bodies.values()])
            x, y = np.abs(corners - np.asarray(self.pivot)).max(axis=0).tolist()
            self._arms = x, y

    @model_validator(mode="after")
    def _one_motion(self) -> Vibration:
        given = self.given.keys()
        if self.samples is not None:
            if given & {"frequency", "amplitude", "gamma"}:
                raise SceneError("samples say how fast and how far it moves: leave out frequency, amplitude and gamma")
            if (result := self.record.peak_acceleration / GRAVITY) > MAX_GAMMA:
                raise SceneError(f"samples: peak acceleration of {result:.3g} g, allowed {MAX_GAMMA:g} g")
        elif (self.pivot is None) != ("angle" not in given):
            raise SceneError("pivot and angle go together: the place it rocks about, and how far to either side")
        elif "frequency" not in given:
            raise SceneError("give frequency, and either amplitude or gamma, or pivot and angle; or samples")
        elif self.pivot is None and len(given & {"amplitude", "gamma"}) != 1:
            raise SceneError("give either amplitude or gamma")
        return self

    @cached_property
    def record(self) -> Record:
        """The motion that the samples make. Only where there are samples."""
        assert self.samples is not None
        return integrated(self.samples.time, self.samples.acceleration)

    @property
    def period(self) -> float:
        """Seconds after which the motion repeats."""
        if self.samples is not None:
            return self.record.period
        return float(1.0 / self.given["frequency"])

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
            return np.asarray(self.given["angle"] * np.array(self._arms[::-1]))
        if self.samples is not None:
            return self.record.reach * self.along
        given = self.given
        reach = given["amplitude"] if "amplitude" in given else given["gamma"] * self.gravity / self.omega**2
        return np.asarray(reach * self.along)

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


# -- Where down is: gravity at an angle to the channel, and the feed, which hangs with it ------------------------------
# Coordinates are the channel's, which stands upright in them; a tilt turns gravity. The feed is described as in an
# upright channel, as a curtain that falls along -y, and turns with gravity about the curtain's middle at the feed's
# level. An upright channel's points and velocities are given back as they are, to the last bit.
CLEAR = 1e-3  # of its radius: how far from the wall beside it a granule may begin at the least
ALONG = 1e-9  # sine of the angle to a border below which a line never comes to it: round-off


@dataclass(frozen=True)
class Plumb:
    """Gravity turned by ``tilt`` (rad) from -y towards +x; ``pivot`` (m): the point about which the feed turns;
    ``left``, ``right``, ``low``, ``high`` (m) of the channel; ``strength`` of gravity (m/s2).
    """

    tilt: float
    pivot: tuple[float, float]
    left: float
    right: float
    low: float
    high: float
    strength: float = GRAVITY

    @property
    def upright(self) -> bool:
        """Whether gravity points down the channel's axis."""
        return self.tilt == 0.0

    @property
    def down(self) -> Array:
        """Unit vector (2,) of gravity."""
        return np.array([math.sin(self.tilt), -math.cos(self.tilt)])

    @property
    def across(self) -> Array:
        """Unit vector (2,) at a right angle to gravity; +x in an upright channel."""
        return np.array([math.cos(self.tilt), math.sin(self.tilt)])

    @property
    def gravity(self) -> tuple[float, float]:
        """Gravity (x, y), m/s2."""
        return self.strength * float(self.down[0]), self.strength * float(self.down[1])

    def turned(self, velocity: Array) -> Array:
        """Velocities (..., 2) of a feed that falls along -y, as they are in the channel."""
        return velocity if self.upright else velocity @ np.array([self.across, -self.down])

    def placed(self, points: Array) -> Array:
        """Points (..., 2) m of a feed that falls along -y, where they are in the channel."""
        return points if self.upright else self.turned(points - self.pivot) + self.pivot

    def hung(self, velocity: Array) -> Array:
        """Velocities (..., 2) in the channel as they are where gravity points along -y: undoes :meth:`turned`."""
        return velocity if self.upright else velocity @ np.array([self.across, -self.down]).T

    def seen(self, points: Array) -> Array:
        """Points (..., 2) m in the channel as they are where gravity points along -y: undoes :meth:`placed`."""
        return points if self.upright else self.hung(points - self.pivot) + self.pivot

    def way(self, direction: Array) -> float:
        """How far (m) it is from the pivot to the channel's border along a unit vector (2,)."""
        (x, y), (right, up) = self.pivot, direction.tolist()
        ends = (self.left if right < 0.0 else self.right) - x, (self.low if up < 0.0 else self.high) - y
        ways = [end / part for end, part in zip(ends, (right, up), strict=True) if abs(part) > ALONG]
        return max(0.0, float(min(ways)))

    def highest(self, x: Array, radius: Array, slack: float) -> Array:
        """Height y (n,) m of the upright feed up to which its granules at ``x`` (n,) m, of ``radius`` (n,) m, lie in
        the channel, ``slack`` (m) below its top and clear of the wall that gravity leads away from.
        """
        top = self.high - slack
        if self.upright:
            return np.full(len(x), top)
        (sine, cosine), off = self.down * (1.0, -1.0), x - self.pivot[0]
        room = np.full(len(x), np.inf)
        if cosine > ALONG:
            room = (top - self.pivot[1] - off * sine) / cosine
        wall = self.pivot[0] - self.left if sine > 0.0 else self.right - self.pivot[0]
        side = wall - (1.0 + CLEAR) * radius + math.copysign(1.0, sine) * off * cosine
        if abs(sine) > ALONG:
            room = np.minimum(room, side / abs(sine))
        return self.pivot[1] + room
