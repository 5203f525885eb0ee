"""The scene: what is asked. TOML tables with units, validated before anything starts.

Origin at the first body's centre, y up. Numbers are SI; a string with a unit ("50 mm", "60 deg", "30 Hz") is converted.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from .errors import SceneError
from .geometry import is_simple
from .laws.material import Material, materials
from .laws.shape import shapes
from .laws.size import sizes
from .quantities import (
    Angle,
    AnyAngle,
    Coordinate,
    Density,
    Diameter,
    Frequency,
    Length,
    Point,
    PositiveSpeed,
    Rate,
    Share,
    Speed,
    Viscosity,
)  # fmt: skip
from .registry import nearest

__all__ = [
    "STANDARD_AIR",
    "Air",
    "Bin",
    "Body",
    "Channel",
    "Feed",
    "Fraction",
    "Numerics",
    "Scene",
    "Size",
    "Vibration",
]

GRAVITY = 9.81  # m/s2
STANDARD_AIR = (1.204, 1.825e-5)  # kg/m3 and Pa s at 20 C: where terminal velocities are measured
RESERVED_BIN = "elsewhere"
Array = NDArray[np.float64]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Body(_Table):
    """[body.NAME]: a solid in the flow."""

    shape: str = Field(description="one of: " + ", ".join(shapes))
    width: Length | None = Field(None, description="horizontal extent; not for polygon")
    slope_angle: Angle | None = Field(None, description="of the faces, from the horizontal")
    height: Length | None = Field(None, description="instead of slope_angle")
    apex: Literal["up", "down"] | None = Field(None, description="prism only")
    points: list[Point] | None = Field(None, description="polygon only: corners in the body's own frame")
    at: Point = Field([0.0, 0.0], description="where the body's centre is")

    @model_validator(mode="after")
    def _has_an_outline(self) -> Body:
        if not is_simple(self.outline()):
            raise SceneError("the outline crosses itself")
        return self

    def outline(self) -> Array:
        """Corners (k, 2) in the scene's frame (m), counter-clockwise."""
        given = self.model_dump(exclude_none=True, exclude={"shape", "at"})
        try:
            return shapes[self.shape](**given) + np.asarray(self.at)
        except TypeError as problem:  # the shape function's signature knows what it needs
            raise SceneError(f"shape {self.shape!r}: {str(problem).split('() ')[-1]}") from None


class Channel(_Table):
    """[channel]: the vertical duct, centred on x = 0, from ``bottom`` (the floor) to ``top``."""

    width: Length
    top: Coordinate
    bottom: Coordinate
    walls: Literal["slip", "no-slip"] = Field("slip", description="for the air; granules bounce off either")


class Air(_Table):
    """[air]: leave the table out for a vacuum."""

    speed: PositiveSpeed
    direction: Literal["down", "up"] = "down"
    density: Density = STANDARD_AIR[0]
    viscosity: Viscosity = STANDARD_AIR[1]
    turbulence: Annotated[float, Field(ge=0.001, le=0.5)] = Field(0.05, description="inlet intensity, u'/U")


class Vibration(_Table):
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


class Feed(_Table):
    """[feed]: the falling curtain."""

    height: Length | None = Field(None, description="of free fall from rest down to the top of the body")
    speed: Speed | None = Field(None, description="instead of height: fall speed at the top of the body")
    width: Length
    position: Coordinate = Field(0.0, description="x of the curtain's middle")
    rate: Rate | None = Field(None, description="mass flow of all fractions; default 1 kg/s per metre of depth")
    depth: Length = Field(1.0, description="of the machine, across the plane")
    count: Annotated[int, Field(ge=16, le=10_000_000)] = Field(16384, description="granules tracked per fraction")
    seed: Annotated[int, Field(ge=0)] = 0
    mode: Literal["auto", "injected", "resolved"] = Field(
        "auto",
        description="injected: eq. (1)-(2) at the slope; resolved: the tracker does the impact; auto: by Stokes number",
    )

    @model_validator(mode="after")
    def _one_start(self) -> Feed:
        if (self.height is None) == (self.speed is None):
            raise SceneError("give either height or speed")
        return self

    @property
    def fall_speed(self) -> float:
        """Fall speed (m/s) at the top of the body, by free fall without air: the paper's V0."""
        if self.speed is not None:
            return self.speed
        assert self.height is not None
        return math.sqrt(2 * GRAVITY * self.height)

    @property
    def mass_flow(self) -> float:
        """kg/s of all fractions together."""
        return self.rate if self.rate is not None else self.depth * 1.0


class Size(_Table):
    """A size distribution by mass: ``distribution`` and its parameters."""

    distribution: str = Field(description="one of: " + ", ".join(sizes))
    diameter: Diameter | None = None
    low: Diameter | None = None
    high: Diameter | None = None
    mean: Diameter | None = None
    std: Diameter | None = None
    median: Diameter | None = None
    geometric_std: Annotated[float, Field(gt=1, le=10)] | None = None

    @model_validator(mode="after")
    def _has_quantiles(self) -> Size:
        self.quantile(np.array([0.5]))
        return self

    def quantile(self, p: Array) -> Array:
        """Diameters (m) below which the mass fractions ``p`` lie."""
        given = self.model_dump(exclude_none=True, exclude={"distribution"})
        try:
            return sizes[self.distribution](p, **given)
        except TypeError as problem:
            raise SceneError(f"size distribution {self.distribution!r}: {str(problem).split('() ')[-1]}") from None


def _one_diameter(value: Any) -> Any:
    """``size = "4 mm"`` is short for a distribution of one diameter."""
    return value if isinstance(value, Mapping) else {"distribution": "single", "diameter": value}


class Fraction(_Table):
    """[fraction.NAME]: a class of granules; what is not given comes from its material."""

    material: str | None = Field(None, description="one of: " + ", ".join(materials))
    size: Annotated[Size, BeforeValidator(_one_diameter)] | None = Field(
        None, description="one diameter, or a distribution by mass"
    )
    density: Density | None = None
    sphericity: Annotated[float, Field(gt=0.05, le=1)] | None = Field(
        None, description="surface of the equal sphere over surface"
    )
    terminal_velocity: PositiveSpeed | None = Field(
        None, description="measured in air at 20 C, of the median size; drag is calibrated to it"
    )
    restitution: Annotated[float, Field(ge=0, le=1)] | None = None
    friction: Annotated[float, Field(ge=0, le=10)] | None = None
    mass_share: Share | None = Field(None, description="of the feed; shares add up to 1; default: equal")
    target: str | list[str] | None = Field(None, description="the bin, or bins, where it should land")

    @model_validator(mode="after")
    def _complete(self) -> Fraction:
        if self.material is not None:
            materials[self.material]
        else:
            missing = [k for k in ("size", "density", "restitution", "friction") if getattr(self, k) is None]
            if missing:
                raise SceneError(f"without a material give also: {', '.join(missing)}")
        if self.sphericity is not None and self.terminal_velocity is not None:
            raise SceneError("give sphericity or terminal_velocity, not both")
        return self

    def _or_material(self, name: str) -> Any:
        own = getattr(self, name)
        if own is not None:
            return own
        assert self.material is not None
        return getattr(materials[self.material], name)

    @property
    def properties(self) -> Material:
        """The fraction's own values where given, its material's elsewhere; diameter is the mass median."""
        terminal = self.terminal_velocity
        if terminal is None and self.sphericity is None and self.material is not None:
            terminal = materials[self.material].terminal_velocity
        return Material(
            diameter=float(self.diameters(np.array([0.5]))[0]),
            density=self._or_material("density"),
            terminal_velocity=terminal,
            restitution=self._or_material("restitution"),
            friction=self._or_material("friction"),
            confidence="given" if self.material is None else materials[self.material].confidence,
            source="scene" if self.material is None else materials[self.material].source,
        )

    @property
    def targets(self) -> tuple[str, ...]:
        """The bins where this fraction should land; empty when none was named."""
        if self.target is None:
            return ()
        return (self.target,) if isinstance(self.target, str) else tuple(self.target)

    @property
    def calibration_diameter(self) -> float:
        """The diameter (m) that the terminal velocity belongs to: the material's own when the material brings it."""
        if self.terminal_velocity is None and self.material is not None:
            return materials[self.material].diameter
        return float(self.diameters(np.array([0.5]))[0])

    def diameters(self, p: Array) -> Array:
        """Diameters (m) below which the mass fractions ``p`` lie."""
        if self.size is not None:
            return self.size.quantile(p)
        return sizes["single"](p, diameter=materials[str(self.material)].diameter)


class Bin(_Table):
    """[bin.NAME]: a collector, a stretch of the channel's boundary or a line of points."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)
    start: Coordinate | None = Field(None, alias="from", description="x on the floor or top, y on a side")
    to: Coordinate | None = None
    on: Literal["floor", "left", "right", "top"] = "floor"
    points: list[Point] | None = Field(None, description="a polyline anywhere in the channel, instead of from and to")

    @model_validator(mode="after")
    def _one_place(self) -> Bin:
        if self.points is not None:
            if self.start is not None or self.to is not None:
                raise SceneError("give either points, or from and to")
            if len(self.points) < 2:
                raise SceneError("points needs at least two [x, y] pairs")
        elif self.start is None or self.to is None:
            raise SceneError("give from and to (or points)")
        elif not self.start < self.to:
            raise SceneError(f"from = {self.start:g} m must be below to = {self.to:g} m")
        return self

    def line(self, channel: Channel) -> Array:
        """The collector as a polyline, (k, 2) in metres."""
        if self.points is not None:
            return np.asarray(self.points, dtype=float)
        assert self.start is not None
        assert self.to is not None
        along = np.array([self.start, self.to])
        fixed = {"floor": channel.bottom, "top": channel.top, "left": -channel.width / 2, "right": channel.width / 2}[
            self.on
        ]
        across = np.full(2, fixed)
        return np.stack([along, across] if self.on in ("floor", "top") else [across, along], axis=1)


class Numerics(_Table):
    """[numerics]: how it is computed."""

    rung: Literal["auto", "none", "draft", "standard", "reference"] = "auto"
    tolerance: Annotated[float, Field(gt=0, le=0.1)] = Field(1e-4, description="landing error in body widths")
    keep: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        2000, description="granules kept in granules.npz per fraction"
    )


class Scene(_Table):
    """Everything that is asked, in SI units. Frozen: ``replace`` gives a changed copy."""

    body: Annotated[dict[str, Body], Field(min_length=1)]
    channel: Channel
    air: Air | None = None
    vibration: Vibration | None = None
    feed: Feed
    fraction: Annotated[dict[str, Fraction], Field(min_length=1)]
    bin: Annotated[dict[str, Bin], Field(min_length=1)]
    numerics: Numerics = Numerics()

    @classmethod
    def parse(cls, data: Mapping[str, Any], name: str = "scene") -> Scene:
        """Validate plain tables. Raises SceneError with one line per mistake: field, value, what is allowed."""
        try:
            scene = cls.model_validate(data)
        except ValidationError as problem:
            raise SceneError("\n".join(_explain(problem, name))) from None
        for check in _CHECKS:
            for message in check(scene):
                raise SceneError(f"{name}: {message}")
        return scene

    @classmethod
    def load(cls, path: Path | str, changes: Mapping[str, Any] | None = None) -> Scene:
        """Read a scene file, with ``changes`` (dotted key to value) applied before validation."""
        path = Path(path)
        try:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise SceneError(f"no scene file {str(path)!r}; make one with: wakeflow new rhombus {path.name}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, IsADirectoryError) as problem:
            raise SceneError(f"{path}: not valid TOML: {problem}") from None
        return cls.parse(_changed(data, changes or {}), path.name)

    def replace(self, changes: Mapping[str, Any]) -> Scene:
        """A copy with dotted keys changed, validated anew: ``{"fraction.chaff.restitution": 0.2}``."""
        return self.parse(_changed(self.tables(), changes))

    def tables(self) -> dict[str, Any]:
        """The scene as plain tables, only what was set, in SI numbers: what ``save`` writes and keys are made of."""
        return json.loads(self.model_dump_json(exclude_unset=True, exclude_none=True, by_alias=True))

    def save(self, path: Path | str) -> None:
        """Write the scene as TOML in SI numbers; loading it gives an equal scene."""
        import tomlkit

        from .files import atomic_write

        with atomic_write(path) as stream:
            stream.write(tomlkit.dumps(self.tables()))

    @property
    def width(self) -> float:
        """Width of the first body (m): the unit of length of every reported error."""
        return float(np.ptp(next(iter(self.body.values())).outline()[:, 0]))

    @property
    def reynolds(self) -> float | None:
        """Re = rho U D / mu on the first body's width; None in a vacuum."""
        return None if self.air is None else self.air.density * self.air.speed * self.width / self.air.viscosity

    @property
    def motion(self) -> tuple[Array, float]:
        """Amplitude vector (2,) m and angular frequency (rad/s) of the bodies; zeros when at rest."""
        return (np.zeros(2), 0.0) if self.vibration is None else (self.vibration.displacement, self.vibration.omega)

    def mass_shares(self) -> dict[str, float]:
        """Share of every fraction in the feed, by mass; they add up to 1."""
        given = {name: f.mass_share for name, f in self.fraction.items()}
        return {name: share if share is not None else 1.0 / len(given) for name, share in given.items()}


def _changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A deep copy of ``data`` with dotted keys set; a table on the way is made when it is missing."""
    result: dict[str, Any] = json.loads(json.dumps(data, default=str))
    for key, value in changes.items():
        *tables, last = key.split(".")
        node = result
        for i, table in enumerate(tables):
            node = node.setdefault(table, {})
            if not isinstance(node, dict):
                raise SceneError(f"{key}: {'.'.join(tables[: i + 1])} is a value, not a table")
        node[last] = value
    return result


def _explain(problem: ValidationError, name: str) -> Iterator[str]:
    """One line per mistake: where, the value given, what is wrong, what is allowed."""
    for error in problem.errors():
        where = [str(part) for part in error["loc"] if "[" not in str(part)]  # drop pydantic's names of validators
        value, text = error["input"], error["msg"].removeprefix("Value error, ")
        key = ".".join(where)
        if error["type"] == "extra_forbidden":
            known = _known_keys(where[:-1])
            yield f"{name}: {key}: unknown key{nearest(where[-1], known)} (known: {', '.join(known)})"
        elif error["type"] == "missing":
            yield f"{name}: {key}: missing{_allowed(where)}"
        elif isinstance(value, Mapping | BaseModel):
            yield f"{name}: {key}: {text}"
        else:
            yield f"{name}: {key} = {value!r}: {text[0].lower()}{text[1:]}{_allowed(where)}"


def _allowed(where: list[str]) -> str:
    """The range and unit of a field, from its JSON schema."""
    model = _model_at(where[:-1])
    field = model.model_json_schema(by_alias=True)["properties"].get(where[-1], {}) if model else {}
    field = {**field.get("anyOf", [{}])[0], **field}
    limits = [
        f"{sign} {field[word]:.6g}"
        for word, sign in (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
        if word in field
    ]
    unit = field.get("unit", "")
    if not limits and not unit:
        return ""
    hint = "; a string may carry another unit, such as '60 deg'" if unit == "rad" else ""
    return f" (allowed: {' and '.join(limits)} {unit}".rstrip() + f"{hint})"


def _model_at(where: list[str]) -> type[BaseModel] | None:
    """The table that a dotted place belongs to; None inside keyed tables before their name."""
    keyed: dict[str, type[BaseModel]] = {"body": Body, "fraction": Fraction, "bin": Bin}
    plain: dict[str, type[BaseModel]] = {
        "channel": Channel, "air": Air, "vibration": Vibration, "feed": Feed, "numerics": Numerics,
    }  # fmt: skip
    if not where:
        return Scene
    if where[0] not in keyed:
        return plain.get(where[0])
    if where[2:3] == ["size"]:
        return Size
    return keyed[where[0]] if len(where) > 1 else None


def _known_keys(where: list[str]) -> list[str]:
    model = _model_at(where)
    return [] if model is None else [field.alias or key for key, field in model.model_fields.items()]


def _one_body(scene: Scene) -> Iterator[str]:
    if len(scene.body) > 1:
        yield f"body: {len(scene.body)} bodies given, this version computes one"


def _body_fits(scene: Scene) -> Iterator[str]:
    channel = scene.channel
    if not channel.bottom < channel.top:
        yield f"channel.bottom = {channel.bottom:g} m must be below channel.top = {channel.top:g} m"
    for name, body in scene.body.items():
        (left, low), (right, high) = body.outline().min(0), body.outline().max(0)
        if max(-left, right) >= 0.49 * channel.width:
            reach = max(-left, right)
            yield f"body.{name} reaches x = {reach:g} m: no room beside it in channel.width = {channel.width:g} m"
        if low <= channel.bottom or high >= channel.top:
            yield f"body.{name} reaches from y = {low:g} to {high:g} m, outside channel.bottom .. channel.top"


def _feed_fits(scene: Scene) -> Iterator[str]:
    feed, half = scene.feed, scene.channel.width / 2
    if abs(feed.position) + feed.width / 2 > half:
        yield f"feed.width = {feed.width:g} m at feed.position = {feed.position:g} m is wider than the channel"


def _shares_add_up(scene: Scene) -> Iterator[str]:
    given = [f.mass_share for f in scene.fraction.values()]
    if any(s is not None for s in given) and any(s is None for s in given):
        yield "fraction: give mass_share for every fraction or for none"
    total = sum(scene.mass_shares().values())
    if abs(total - 1.0) > 1e-6:
        yield f"fraction: mass_share values add up to {total:g}, they must add up to 1"


def _bins_exist(scene: Scene) -> Iterator[str]:
    if RESERVED_BIN in scene.bin:
        yield f"bin.{RESERVED_BIN}: this name is reserved for granules that reach no bin"
    for name, fraction in scene.fraction.items():
        known = list(scene.bin)
        for target in fraction.targets:
            if target not in known:
                hint = f"no such bin{nearest(target, known)} (known: {', '.join(known)})"
                yield f"fraction.{name}.target = {target!r}: {hint}"
    for name, collector in scene.bin.items():
        half, slack = scene.channel.width / 2, 1e-9 * scene.channel.width
        x, y = collector.line(scene.channel).T
        if (
            np.abs(x).max() > half + slack
            or y.min() < scene.channel.bottom - slack
            or y.max() > scene.channel.top + slack
        ):
            yield f"bin.{name} lies outside the channel"


def _bins_apart(scene: Scene) -> Iterator[str]:
    placed = [(n, b) for n, b in scene.bin.items() if b.points is None]
    for i, (name, one) in enumerate(placed):
        for other_name, other in placed[i + 1 :]:
            assert one.start is not None and one.to is not None and other.start is not None and other.to is not None  # noqa: PT018
            if one.on == other.on and min(one.to, other.to) - max(one.start, other.start) > 1e-9:
                yield f"bin.{name} and bin.{other_name} overlap"


def _rung_fits(scene: Scene) -> Iterator[str]:
    if scene.air is None and scene.numerics.rung not in ("auto", "none"):
        yield f"numerics.rung = {scene.numerics.rung!r} needs an [air] table"


_CHECKS = (_one_body, _body_fits, _feed_fits, _shares_add_up, _bins_exist, _bins_apart, _rung_fits)
