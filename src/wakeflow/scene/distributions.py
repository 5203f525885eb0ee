"""How sizes and measured terminal velocities spread over the mass of a fraction."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ..core.errors import SceneError
from ..core.registry import Registry
from ..laws.size import sizes
from .table import Array, Table, takes
from .units import SHARE, Diameter, PositiveSpeed

__all__ = ["Size", "Speeds"]

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
