"""[fraction.NAME]: a class of granules, its sizes, rebound and terminal velocity."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from statistics import NormalDist
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from ..core.errors import SceneError
from ..core.registry import Registry
from ..laws.collision import impact_models
from ..laws.drag import drag_laws
from ..laws.flake import shape_of
from ..laws.material import Material, materials
from ..laws.restitution import Restitution, restitution_laws
from ..laws.size import sizes, within
from .table import (
    SHARE,
    UNSET,
    Array,
    Diameter,
    LawTable,
    MassDensity,
    Portion,
    PositiveSpeed,
    ScatterAngle,
    Shorthand,
    Table,
    WithUnit,
    made_by,
    parameters,
)

# -- How granules rebound: a law of the approach speed, or how a coefficient spreads over them -------------------------
CUT = 0.05  # of a normal distribution: where more lies outside what a coefficient can be, it is not one


@parameters(
    value=(Annotated[float, Field(ge=0, le=1)], "restitution measured at one speed"),
    at=(PositiveSpeed, "speed of that, normal to the wall"),
    exponent=(Annotated[float, Field(ge=1e-3, le=2)], "power: 0.25"),
    most=(Annotated[float, Field(ge=1e-3, le=1)], "power, elastic-plastic: largest value, 0.99"),
    speeds=(list[PositiveSpeed], "table: approach speeds, rising"),
    values=(list[Annotated[float, Field(ge=0, le=1)]], "table: restitution at each"),
)
class Rebound(LawTable):
    """A restitution law of the normal approach speed: ``law`` and its parameters."""

    law: str = Field(description="one of: " + ", ".join(restitution_laws))

    @model_validator(mode="after")
    def _is_a_law(self) -> Rebound:
        assert self.of_speed is not None
        return self

    @property
    def of_speed(self) -> Restitution:
        """The law itself. Raises SceneError for parameters that are missing, that the law does not have, or that are
        out of range.
        """
        return Restitution(self.law, **self.given)


@parameters(
    mean=Annotated[float, Field(ge=0, le=10)],
    std=Annotated[float, Field(ge=0, le=5)],
    low=Annotated[float, Field(ge=0, le=10)],
    high=Annotated[float, Field(ge=0, le=10)],
)
class Coefficient(LawTable):
    """A coefficient of restitution or friction that each granule has of its own."""

    distribution: Literal["normal", "uniform"] = Field(
        "normal", description="normal: mean and std, cut off where no coefficient is; uniform: low and high"
    )

    @classmethod
    def means(cls, table: Mapping[str, object] | Table) -> bool:
        """Whether a table, of which other kinds may be in its place, is of this one by its keys."""
        if not isinstance(table, Mapping):
            return isinstance(table, cls)
        return "law" not in table and not table.keys().isdisjoint(cls.model_fields)

    @model_validator(mode="after")
    def _is_complete(self) -> Coefficient:
        wanted = ("mean", "std") if self.distribution == "normal" else ("low", "high")
        given = self.given
        if tuple(given) != wanted:
            result = ", ".join(given) or "nothing"
            raise SceneError(f"a {self.distribution} distribution takes {' and '.join(wanted)}, not {result}")
        if "low" in given and not given["low"] < given["high"]:
            raise SceneError(f"low = {given['low']:g} must be below high = {given['high']:g}")
        return self

    def quantile(self, p: Array, most: float) -> Array:
        """Coefficients below which the shares ``p`` of the granules lie; none is larger than ``most``.

        Raises SceneError where the distribution goes beyond what the coefficient can be.
        """
        given = self.given
        largest = "high" if self.distribution == "uniform" else "mean"
        if given[largest] > most:
            raise SceneError(f"{largest} = {given[largest]:g} is more than {most:g}")
        if self.distribution == "uniform":
            return sizes["uniform"](p, **given)
        if (std := given["std"]) > 0.0:
            law = NormalDist(given["mean"], std)
            lost = law.cdf(0.0) + (0.0 if math.isinf(most) else 1.0 - law.cdf(most))
            if lost > CUT:
                raise SceneError(f"std = {std:g} puts {lost:.0%} outside 0 to {most:g}; use uniform, low and high")
        return within(p, **given, low=0.0, high=most)


# -- How sizes and measured terminal velocities spread over the mass of a fraction -------------------------------------
OF_SPEEDS = {"low", "high", "mean", "std", "median", "geometric_std"}  # parameters that mean the same for any quantity
spreads: Registry[Callable[..., Array]] = Registry("distribution of terminal velocities")
for _name in sizes:
    if {p.name for p in signature(sizes[_name]).parameters.values() if p.kind is p.KEYWORD_ONLY} <= OF_SPEEDS:
        spreads.add(_name, sizes[_name])


Factor = Annotated[float, Field(gt=1, le=10)]


class SpreadTable(LawTable):
    """How a quantity of the granules spreads over their mass: one of the ``laws``, and its parameters."""

    laws: ClassVar[Registry[Callable[..., Array]]]
    distribution: str

    @model_validator(mode="after")
    def _has_quantiles(self) -> Self:
        self.quantile(np.array([0.5]))
        return self

    def quantile(self, p: Array) -> Array:
        """What the quantity (SI) is below in the mass fractions ``p``."""
        return made_by(self.laws, self.distribution, p, **self.given)


@parameters(
    diameter=Diameter,
    **dict.fromkeys(("low", "high", "mean", "std", "median"), Diameter),
    geometric_std=Factor,
    scale=(Diameter, "rosin-rammler: 63.2 % of the mass is finer"),
    spread=(Annotated[float, Field(ge=0.5, le=50)], "rosin-rammler: its exponent"),
    diameters=(list[Diameter], "table: the sieves, finest first"),
    passing=(
        list[Annotated[float, Field(ge=0, le=1), SHARE]], "table: mass fraction finer than each sieve, from 0 to 1"
    ),
)  # fmt: skip
class Size(SpreadTable):
    """A size distribution by mass: ``distribution`` and its parameters."""

    laws: ClassVar = sizes
    distribution: str = Field(description="one of: " + ", ".join(sizes))
    file: Annotated[str, UNSET] = Field("", description="a CSV file of a sieve analysis, instead of all other keys")


@parameters(**dict.fromkeys(("low", "high", "mean", "std", "median"), PositiveSpeed), geometric_std=Factor)
class Speeds(SpreadTable):
    """Terminal velocities as they were measured, spread over the granules by mass, whatever their sizes."""

    laws: ClassVar = spreads
    distribution: str = Field(description="one of: " + ", ".join(spreads))


# -- [fraction.NAME] ---------------------------------------------------------------------------------------------------
COEFFICIENTS: tuple[Literal["restitution"], Literal["friction"]] = ("restitution", "friction")
PAPER = "paper"  # the impact model whose granules are alike
UNNAMED = Material(math.nan, math.nan, None, math.nan, math.nan, "given", "scene", impact=PAPER)  # all is in the scene
MAX_COEFFICIENT = {"restitution": 1.0, "friction": math.inf}  # coefficients lie between 0 and these


def _number_or_table(value: object) -> str:
    """The tag that tells a number from a table; its brackets keep it out of the places that messages name."""
    return "[table]" if isinstance(value, Mapping | Table) else "[number]"


def _number_law_or_table(value: object) -> str:
    """The tag that tells a restitution's number, law and table apart: a ``law`` is one of the approach speed."""
    if isinstance(value, Mapping | Rebound) and not Coefficient.means(value):
        return "[law]"
    return _number_or_table(value)


class Fraction(Table):
    """[fraction.NAME]: a class of granules; what is not given comes from its material."""

    material: Annotated[str, UNSET] = Field("", description="one of: " + ", ".join(materials))
    size: (
        Annotated[Size, Shorthand(Diameter, lambda diameter: {"distribution": "single", "diameter": diameter})] | None
    ) = Field(None, description="one diameter, or a distribution by mass")
    density: MassDensity | None = None
    sphericity: Annotated[float, Field(gt=0.05, le=1), UNSET] = Field(
        0.0, description="surface of the equal sphere over surface"
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
    drag: Annotated[str, UNSET] = Field("", description="drag law, one of: " + ", ".join(drag_laws))
    restitution: (
        Annotated[
            Annotated[float, Field(ge=0, le=1), SHARE, Tag("[number]")]
            | Annotated[Rebound, Tag("[law]")]
            | Annotated[Coefficient, Tag("[table]")],
            Discriminator(_number_law_or_table),
        ]
        | None
    ) = Field(
        None, description="a number for all, a law of the normal approach speed, or how it spreads over the granules"
    )
    friction: (
        Annotated[
            Annotated[float, Field(ge=0, le=10), Tag("[number]")] | Annotated[Coefficient, Tag("[table]")],
            Discriminator(_number_or_table),
        ]
        | None
    ) = Field(None, description="a number for all, or how it spreads over the granules")
    rebound_scatter: ScatterAngle | None = Field(
        None, description="rms angle by which its shape turns the wall's normal at an impact; 0 of spheres"
    )
    tangential_restitution: Annotated[float, Field(ge=0, le=1), SHARE] | None = Field(
        None, description="part of its slip that a contact which sticks gives back, of granules that turn"
    )
    capture_speed: Annotated[PositiveSpeed, UNSET] = Field(
        0.0, description="granules that come to a wall with a slower normal velocity stay there; default: all rebound"
    )
    sticks: Annotated[float, Field(ge=0, le=1), SHARE] | None = Field(
        None, description="part of those that stays, at each impact, where it is not all; without capture_speed: of all"
    )
    impact: Annotated[str, UNSET] = Field(
        "",
        description="how a blow turns it, one of: " + ", ".join(impact_models) + "; default that of its material, else "
        "paper: a point mass, all granules alike but for what the fraction itself spreads",
    )
    own_inertia: Annotated[float, Field(ge=0.01, le=1), UNSET] = Field(
        0.0, alias="inertia", description="I / (m r^2), instead of impact: 0.4 sphere, 0.5 disc"
    )
    dimensions: Annotated[list[Diameter], Field(min_length=3, max_length=3), UNSET] = Field(
        [],
        description="length, width and thickness, of which the proportions count: by them granules meet each other "
        "(default a ball) and a flake is thrown",
    )
    mass_share: Annotated[Portion, UNSET] = Field(0.0, description="share of feed; they add up to 1; default: equal")
    target: Annotated[str | Annotated[list[str], Field(min_length=1)], UNSET] = Field(
        "", description="the bin, or bins, where it should land"
    )

    moisture: Annotated[float, Field(gt=0, lt=1), WithUnit("1", "14 %"), UNSET] = Field(
        0.0, description="share of water, of the whole mass, of a material of which that was measured"
    )

    @model_validator(mode="after")
    def _complete(self) -> Fraction:
        self._check_source()
        if self.sphericity and self.terminal_velocity is not None:
            raise SceneError("give sphericity or terminal_velocity, not both")
        if self.impact:
            impact_models[self.impact]
            if self.own_inertia:
                raise SceneError("give impact or inertia, not both")
        for name in COEFFICIENTS:
            self._middle(name)
        if self.flake and not self._dimensions:
            raise SceneError("impact = 'flake' needs dimensions = [length, width, thickness]")
        if self.tangential_restitution and math.isinf(self.inertia):
            raise SceneError("tangential_restitution is of granules that turn; give an impact model or inertia too")
        if self.drag and drag_laws[self.drag].uses_sphericity != (self.sphericity > 0.0):
            verb = "has no" if self.sphericity else "needs a"
            raise SceneError(f"drag = {self.drag!r} {verb} sphericity")
        return self

    def _check_source(self) -> None:
        """Raise SceneError where neither a material nor the fraction says what its granules are."""
        if not self.material:
            if self.moisture:
                raise SceneError("moisture changes what a material says; without one give the numbers at your moisture")
            missing = [k for k in ("size", "density", "restitution", "friction") if getattr(self, k) is None]
            if missing:
                raise SceneError(f"without a material give also: {', '.join(missing)}")
            return
        try:
            _ = self._source
        except SceneError as problem:
            about = f"moisture = {100 * self.moisture:g} %: " if self.moisture else ""
            raise SceneError(f"{about}{problem}") from None

    @property
    def _source(self) -> Material:
        """Material of the fraction, as it is at its moisture; UNNAMED without one."""
        result = materials[self.material] if self.material else UNNAMED
        return result.at_moisture(self.moisture) if self.moisture else result

    def _or_material(self, name: str) -> Any:
        value = getattr(self, name)
        return getattr(self._source, name) if value is None else value

    @property
    def properties(self) -> Material:
        """The fraction's own values where given, its material's elsewhere; diameter is the mass median, coefficients of
        rebound are the middle ones.
        """
        value, source = self.terminal_velocity, self._source
        terminal = float(value.quantile(np.array([0.5]))[0]) if isinstance(value, Speeds) else value
        if terminal is None and not self.sphericity:
            terminal = source.terminal_velocity
        return Material(
            diameter=float(self.diameters(np.array([0.5]))[0]),
            density=self._or_material("density"),
            terminal_velocity=terminal,
            restitution=self._middle("restitution"),
            friction=self._middle("friction"),
            confidence=source.confidence,
            source=source.source,
            rebound_scatter=self._of_shape("rebound_scatter"),
            tangential_restitution=self._of_shape("tangential_restitution") if math.isfinite(self.inertia) else 0.0,
            impact=self.impact_model,
        )

    def _gives(self, name: str) -> bool:
        """Whether it says a number of a key ``name`` itself."""
        return name in self.model_fields_set and getattr(self, name) is not None

    def confidence_in(self, name: str) -> str:
        """How well one of its numbers, of a key ``name``, is known: that of its material's, or given."""
        if self._gives(name):
            return UNNAMED.confidence
        return self._source.confidence_in({"size": "diameter"}.get(name, name))

    def _middle(self, name: str) -> Any:
        """A coefficient of rebound: the number or the law of all granules, or that of the middle one."""
        value = self._or_material(name)
        if isinstance(value, Coefficient):
            return float(value.quantile(np.array([0.5]), MAX_COEFFICIENT[name])[0])
        return value.of_speed if isinstance(value, Rebound) else value

    def _of_shape(self, name: str) -> float:
        """What a granule has of its shape: given, or its material's; nothing where granules are alike."""
        value = getattr(self, name)
        return float(getattr(self.spread_material, name) if value is None else value)

    def evidence(self, name: str) -> tuple[str, str]:
        """How far to trust a property of its granules, called as a material's, and where it is from."""
        if not self.material or self._gives("size" if name == "diameter" else name):
            return "given", "the scene"
        material = materials[self.material]
        evidence = material.evidence.get(name, material)
        return evidence.confidence, f"{self.material}: {evidence.source}"

    @property
    def spread_material(self) -> Material:
        """The material whose granules this fraction has, one unlike the other; UNNAMED where all are alike: of no
        material, or the paper's.
        """
        return UNNAMED if self.impact == PAPER else self._source

    def coefficients(self, name: Literal["restitution", "friction"], p: Array) -> Array | None:
        """Coefficients below which the shares ``p`` of the granules lie; None where all have the same one, or law."""
        value = getattr(self, name)
        if isinstance(value, Coefficient):
            return value.quantile(p, MAX_COEFFICIENT[name])
        source = self.spread_material
        std = getattr(source, f"{name}_std")
        if value is not None or not std:
            return None
        return within(p, mean=getattr(source, name), std=std, low=0.0, high=MAX_COEFFICIENT[name])

    @property
    def varies(self) -> bool:
        """Whether its granules differ in more than place, time, size and a terminal velocity given for each."""
        middle = np.array([0.5])
        drawn = not isinstance(self.terminal_velocity, Speeds) and self.settling(middle) is not None
        differing = (self.coefficients(name, middle) is not None for name in COEFFICIENTS)
        return drawn or any(differing) or self.properties.rebound_scatter > 0.0

    @property
    def impact_model(self) -> str:
        """Name of the impact model: as given, else that of the material, else the paper's."""
        return self.impact or self._source.impact

    @property
    def inertia(self) -> float:
        """I / (m r^2): given, or its impact model's; infinite for a point mass, which does not turn."""
        return self.own_inertia or impact_models[self.impact_model].inertia

    @property
    def flake(self) -> bool:
        """Whether its granules are thin plates, whose spin after a blow is drawn."""
        return not self.own_inertia and impact_models[self.impact_model].flake

    @property
    def _dimensions(self) -> Sequence[float]:
        return self.dimensions or self._source.dimensions

    @property
    def shape(self) -> Array:
        """Length, width and thickness (3,) over the diameter of the ball of equal volume; ones of a ball."""
        return shape_of(self._dimensions, flake=self.flake) if self._dimensions else np.ones(3)

    @property
    def roundness(self) -> float:
        """Sphericity by which its drag goes: as given, else that of a flake's box, else of a ball."""
        length, width, thickness = self.shape
        box = math.pi / (2.0 * (length * width + width * thickness + thickness * length))
        return self.sphericity or (float(box) if self.flake else 1.0)

    @property
    def drag_law(self) -> str:
        """Name of the drag law: as given, else Haider & Levenspiel's of flakes and with a sphericity, else Brown &
        Lawler's.
        """
        return self.drag or ("haider-levenspiel" if self.sphericity or self.flake else "brown-lawler")

    @property
    def targets(self) -> tuple[str, ...]:
        """The bins where this fraction should land; empty when none was named."""
        named = [self.target] if isinstance(self.target, str) else self.target
        return tuple(filter(None, named))

    @property
    def measured_settling(self) -> tuple[float, float, float] | None:
        """Diameter (m), density (kg/m3) and terminal velocity (m/s) of the granule that was measured; None where none
        was.

        The material's own granule when the material brings the velocity: a scene's other size or density does not
        change what was measured, it changes how fast its granules fall.
        """
        value, source = self.properties, self._source
        if value.terminal_velocity is None:
            return None
        if self.terminal_velocity is None:
            return source.diameter, source.density, value.terminal_velocity
        return value.diameter, value.density, value.terminal_velocity

    def settling(self, p: Array) -> Array | None:
        """Measured terminal velocities (m/s) below which the mass fractions ``p`` lie; None where all granules of one
        size have the same.

        The spread of a material is that of its own granules, of all sizes that they have: a fraction with a size, a
        density or a velocity of its own does not take it over.
        """
        if isinstance(self.terminal_velocity, Speeds):
            return self.terminal_velocity.quantile(p)
        source = self.spread_material
        if source.terminal_velocity is None or source.terminal_velocity_std == 0.0:
            return None
        if self.sphericity or any(value is not None for value in (self.size, self.density, self.terminal_velocity)):
            return None
        return sizes["normal"](p, mean=source.terminal_velocity, std=source.terminal_velocity_std)

    def diameters(self, p: Array) -> Array:
        """Diameters (m) below which the mass fractions ``p`` lie."""
        if self.size is not None:
            return self.size.quantile(p)
        return sizes["single"](p, diameter=self._source.diameter)
