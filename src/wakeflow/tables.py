"""The tables of a scene, each on its own: what their keys mean, their units and ranges. TOML in, SI numbers out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from .errors import SceneError
from .geometry import is_simple
from .laws.drag import drag_laws
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
    Name,
    Point,
    PositiveSpeed,
    Rate,
    Share,
    Speed,
    Viscosity,
)  # fmt: skip

__all__ = [
    "STANDARD_AIR",
    "Air",
    "Bin",
    "Body",
    "Channel",
    "Feed",
    "Fraction",
    "Numerics",
    "SceneTables",
    "Size",
    "Table",
    "Vibration",
]

GRAVITY = 9.81  # m/s2
STANDARD_AIR = (1.204, 1.825e-5)  # kg/m3 and Pa s at 20 C: where terminal velocities are measured
Array = NDArray[np.float64]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def _takes(kind: str, name: str, function: Callable[..., Any], given: Mapping[str, Any]) -> str:
    """What a registered function needs, from its signature, after it refused ``given``."""
    wanted = {p.name: p.default for p in signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY}
    missing = [key for key, default in wanted.items() if default is Parameter.empty and key not in given]
    unknown = [key for key in given if key not in wanted]
    parts = [f"{word} {', '.join(keys)}" for word, keys in (("lacks", missing), ("has no", unknown)) if keys]
    return f"{kind} {name!r} {' and '.join(parts)} (takes: {', '.join(wanted)})"


class Body(Table):
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
        except TypeError:
            raise SceneError(_takes("shape", self.shape, shapes[self.shape], given)) from None


class Channel(Table):
    """[channel]: the vertical duct, centred on x = 0, from ``bottom`` (the floor) to ``top``."""

    width: Length
    top: Coordinate
    bottom: Coordinate
    walls: Literal["slip", "no-slip"] = Field("slip", description="for the air; granules bounce off either")


class Air(Table):
    """[air]: leave the table out for a vacuum."""

    speed: PositiveSpeed
    direction: Literal["down", "up"] = "down"
    density: Density = STANDARD_AIR[0]
    viscosity: Viscosity = STANDARD_AIR[1]
    turbulence: Annotated[float, Field(ge=0.001, le=0.5)] = Field(0.05, description="inlet intensity, u'/U")


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


class Feed(Table):
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
        description="injected: eq. (1)-(2) at the slope; resolved: by the tracker; auto: by Stokes number",
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


class Size(Table):
    """A size distribution by mass: ``distribution`` and its parameters."""

    distribution: str = Field(description="one of: " + ", ".join(sizes))
    diameter: Diameter | None = None
    low: Diameter | None = None
    high: Diameter | None = None
    mean: Diameter | None = None
    std: Diameter | None = None
    median: Diameter | None = None
    geometric_std: Annotated[float, Field(gt=1, le=10)] | None = None
    scale: Diameter | None = Field(None, description="rosin-rammler: 63.2 % of the mass is finer")
    spread: Annotated[float, Field(ge=0.5, le=50)] | None = Field(None, description="rosin-rammler: its exponent")
    diameters: list[Diameter] | None = Field(None, description="table: the sieves, finest first")
    passing: list[Annotated[float, Field(ge=0, le=1)]] | None = Field(
        None, description="table: mass fraction finer than each sieve, from 0 to 1"
    )

    @model_validator(mode="after")
    def _has_quantiles(self) -> Size:
        self.quantile(np.array([0.5]))
        return self

    def quantile(self, p: Array) -> Array:
        """Diameters (m) below which the mass fractions ``p`` lie."""
        given = self.model_dump(exclude_none=True, exclude={"distribution"})
        try:
            return sizes[self.distribution](p, **given)
        except TypeError:
            kind = "size distribution"
            raise SceneError(_takes(kind, self.distribution, sizes[self.distribution], given)) from None


def _one_diameter(value: Any) -> Any:
    """``size = "4 mm"`` is short for a distribution of one diameter."""
    return value if isinstance(value, Mapping) else {"distribution": "single", "diameter": value}


class Fraction(Table):
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
    drag: str | None = Field(None, description="drag law, one of: " + ", ".join(drag_laws))
    restitution: Annotated[float, Field(ge=0, le=1)] | None = None
    friction: Annotated[float, Field(ge=0, le=10)] | None = None
    inertia: Annotated[float, Field(ge=0.01, le=1)] | None = Field(
        None, description="I / (m r^2): 0.4 sphere, 0.5 disc; default: a point mass, as in the paper, gets no spin"
    )
    mass_share: Share | None = Field(None, description="of the feed; shares add up to 1; default: equal")
    target: str | Annotated[list[str], Field(min_length=1)] | None = Field(
        None, description="the bin, or bins, where it should land"
    )

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
        if self.drag is not None and drag_laws[self.drag].uses_sphericity != (self.sphericity is not None):
            verb = "has no" if self.sphericity is not None else "needs a"
            raise SceneError(f"drag = {self.drag!r} {verb} sphericity")
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
    def drag_law(self) -> str:
        """Its name: the one given, else Haider & Levenspiel's with a sphericity, Brown & Lawler's without."""
        return self.drag or ("brown-lawler" if self.sphericity is None else "haider-levenspiel")

    @property
    def targets(self) -> tuple[str, ...]:
        """The bins where this fraction should land; empty when none was named."""
        if self.target is None:
            return ()
        return (self.target,) if isinstance(self.target, str) else tuple(self.target)

    @property
    def measured_settling(self) -> tuple[float, float, float] | None:
        """Diameter (m), density (kg/m3) and terminal velocity (m/s) of the granule that was measured; None without.

        The material's own granule when the material brings the velocity: a scene's other size or density does not
        change what was measured, it changes how fast its granules fall.
        """
        own = self.properties
        if own.terminal_velocity is None:
            return None
        if self.terminal_velocity is None and self.material is not None:
            source = materials[self.material]
            return source.diameter, source.density, own.terminal_velocity
        return own.diameter, own.density, own.terminal_velocity

    def diameters(self, p: Array) -> Array:
        """Diameters (m) below which the mass fractions ``p`` lie."""
        if self.size is not None:
            return self.size.quantile(p)
        return sizes["single"](p, diameter=materials[str(self.material)].diameter)


class Bin(Table):
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
            if not np.all(np.linalg.norm(np.diff(self.points, axis=0), axis=1) > 0):
                raise SceneError("points repeats a point")
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


class Numerics(Table):
    """[numerics]: how it is computed."""

    rung: Literal["auto", "none", "draft", "standard", "reference"] = "auto"
    tolerance: Annotated[float, Field(gt=0, le=0.1)] = Field(1e-4, description="landing error in body widths")
    target_error: Annotated[float, Field(gt=0, le=0.5)] = Field(
        0.01, description="error of a bin's share that is asked for: terms that could not move so much are left out"
    )
    keep: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        2000, description="granules kept in granules.npz per fraction"
    )


class SceneTables(Table):
    """All tables of a scene, and what follows from them."""

    body: Annotated[dict[Name, Body], Field(min_length=1)]
    channel: Channel
    air: Air | None = None
    vibration: Vibration | None = None
    feed: Feed
    fraction: Annotated[dict[Name, Fraction], Field(min_length=1)]
    bin: Annotated[dict[Name, Bin], Field(min_length=1)]
    numerics: Numerics = Numerics()

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
