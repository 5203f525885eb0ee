"""[fraction.NAME]: a class of granules, its sizes, rebound and terminal velocity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from ..core.errors import SceneError
from ..core.registry import Registry
from ..laws.collision import impact_models
from ..laws.drag import drag_laws
from ..laws.material import Material, materials
from ..laws.restitution import Restitution, restitution_laws
from ..laws.size import sizes
from .table import Array, Shorthand, Table, takes
from .units import SHARE, Diameter, MassDensity, Portion, PositiveSpeed

__all__ = ["Fraction", "Rebound", "Size", "Speeds"]

OF_SPEEDS = {"low", "high", "mean", "std", "median", "geometric_std"}  # parameters that mean the same for any quantity
spreads: Registry[Callable[..., Array]] = Registry("distribution of terminal velocities")
for _name in sizes:
    if {p.name for p in signature(sizes[_name]).parameters.values() if p.kind is p.KEYWORD_ONLY} <= OF_SPEEDS:
        spreads.add(_name, sizes[_name])


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
    passing: list[Annotated[float, Field(ge=0, le=1), SHARE]] | None = Field(
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
            raise SceneError(takes(kind, self.distribution, sizes[self.distribution], given)) from None


class Speeds(Table):
    """Terminal velocities as they were measured, spread over the granules by mass, whatever their sizes."""

    distribution: str = Field(description="one of: " + ", ".join(spreads))
    low: PositiveSpeed | None = None
    high: PositiveSpeed | None = None
    mean: PositiveSpeed | None = None
    std: PositiveSpeed | None = None
    median: PositiveSpeed | None = None
    geometric_std: Annotated[float, Field(gt=1, le=10)] | None = None

    @model_validator(mode="after")
    def _has_quantiles(self) -> Speeds:
        self.quantile(np.array([0.5]))
        return self

    def quantile(self, p: Array) -> Array:
        """Terminal velocities (m/s) below which the mass fractions ``p`` lie."""
        given = self.model_dump(exclude_none=True, exclude={"distribution"})
        law = spreads[self.distribution]
        try:
            return law(p, **given)
        except TypeError:
            raise SceneError(takes(spreads.kind, self.distribution, law, given)) from None


def _number_or_table(value: Any) -> str:
    """The tag that tells a number from a table; its brackets keep it out of the places that messages name."""
    return "[table]" if isinstance(value, Mapping | Table) else "[number]"


def _one_diameter(value: Any) -> Any:
    """``size = "4 mm"`` is short for a distribution of one diameter."""
    return value if isinstance(value, Mapping) else {"distribution": "single", "diameter": value}


class Rebound(Table):
    """A restitution law of the normal approach speed: ``law`` and its parameters."""

    law: str = Field(description="one of: " + ", ".join(restitution_laws))
    value: Annotated[float, Field(ge=0, le=1)] | None = Field(None, description="restitution measured at one speed")
    at: PositiveSpeed | None = Field(None, description="that speed, normal to the wall")
    exponent: Annotated[float, Field(ge=1e-3, le=2)] | None = Field(None, description="power: 0.25")
    most: Annotated[float, Field(ge=1e-3, le=1)] | None = Field(
        None, description="power, elastic-plastic: largest value, 0.99"
    )
    speeds: list[PositiveSpeed] | None = Field(None, description="table: approach speeds, rising")
    values: list[Annotated[float, Field(ge=0, le=1)]] | None = Field(None, description="table: restitution at each")

    @model_validator(mode="after")
    def _is_a_law(self) -> Rebound:
        assert self.of_speed is not None
        return self

    @property
    def of_speed(self) -> Restitution:
        """The law itself. Raises SceneError for parameters that are missing, that the law does not have, or that are
        out of range.
        """
        return Restitution(**self.model_dump(exclude_none=True))


class Fraction(Table):
    """[fraction.NAME]: a class of granules; what is not given comes from its material."""

    material: str | None = Field(None, description="one of: " + ", ".join(materials))
    size: Annotated[Size, Shorthand(Diameter, _one_diameter)] | None = Field(
        None, description="one diameter, or a distribution by mass"
    )
    density: MassDensity | None = None
    sphericity: Annotated[float, Field(gt=0.05, le=1)] | None = Field(
        None, description="surface of the equal sphere over surface"
    )
    terminal_velocity: (
        Annotated[
            Annotated[PositiveSpeed, Tag("[number]")] | Annotated[Speeds, Tag("[table]")],
            Discriminator(_number_or_table),
        ]
        | None
    ) = Field(
        None,
        description="measured in air at 20 C, drag is calibrated to it: a number is that of the median size, a table "
        "spreads it over the granules whatever their sizes",
    )
    drag: str | None = Field(None, description="drag law, one of: " + ", ".join(drag_laws))
    restitution: (
        Annotated[
            Annotated[float, Field(ge=0, le=1), Tag("[number]")] | Annotated[Rebound, Tag("[table]")],
            Discriminator(_number_or_table),
        ]
        | None
    ) = Field(None, description="a number, or a law of the normal approach speed")
    friction: Annotated[float, Field(ge=0, le=10)] | None = None
    impact: str | None = Field(
        None, description="how a blow turns it, one of: " + ", ".join(impact_models) + "; default paper: a point mass"
    )
    own_inertia: Annotated[float, Field(ge=0.01, le=1)] | None = Field(
        None, alias="inertia", description="I / (m r^2), instead of impact: 0.4 sphere, 0.5 disc"
    )
    mass_share: Portion | None = Field(None, description="of the feed; shares add up to 1; default: equal")
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
        if self.impact is not None:
            impact_models[self.impact]
            if self.own_inertia is not None:
                raise SceneError("give impact or inertia, not both")
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
        own = self.terminal_velocity
        terminal = float(own.quantile(np.array([0.5]))[0]) if isinstance(own, Speeds) else own
        if terminal is None and self.sphericity is None and self.material is not None:
            terminal = materials[self.material].terminal_velocity
        return Material(
            diameter=float(self.diameters(np.array([0.5]))[0]),
            density=self._or_material("density"),
            terminal_velocity=terminal,
            restitution=self.restitution.of_speed
            if isinstance(self.restitution, Rebound)
            else self._or_material("restitution"),
            friction=self._or_material("friction"),
            confidence="given" if self.material is None else materials[self.material].confidence,
            source="scene" if self.material is None else materials[self.material].source,
        )

    @property
    def inertia(self) -> float | None:
        """I / (m r^2): given, or its impact model's; None for a point mass, which does not turn."""
        return self.own_inertia if self.impact is None else impact_models[self.impact].inertia

    @property
    def drag_law(self) -> str:
        """Name of the drag law: as given, else Haider & Levenspiel's with a sphericity, Brown & Lawler's without."""
        return self.drag or ("brown-lawler" if self.sphericity is None else "haider-levenspiel")

    @property
    def targets(self) -> tuple[str, ...]:
        """The bins where this fraction should land; empty when none was named."""
        if self.target is None:
            return ()
        return (self.target,) if isinstance(self.target, str) else tuple(self.target)

    @property
    def measured_settling(self) -> tuple[float, float, float] | None:
        """Diameter (m), density (kg/m3) and terminal velocity (m/s) of the granule that was measured; None where none
        was.

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

    def settling(self, p: Array) -> Array | None:
        """Measured terminal velocities (m/s) below which the mass fractions ``p`` lie; None where no distribution was
        given.
        """
        return self.terminal_velocity.quantile(p) if isinstance(self.terminal_velocity, Speeds) else None

    def diameters(self, p: Array) -> Array:
        """Diameters (m) below which the mass fractions ``p`` lie."""
        if self.size is not None:
            return self.size.quantile(p)
        return sizes["single"](p, diameter=materials[str(self.material)].diameter)
