"""How a fraction's granules rebound: restitution as a law of the approach speed, coefficients spread over granules."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import NormalDist
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..core.errors import SceneError, known
from ..laws.restitution import Restitution, restitution_laws
from ..laws.size import sizes, within
from .table import Array, PositiveSpeed, Table

CUT = 0.05  # of a normal distribution: where more lies outside what a coefficient can be, it is not one


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


class Coefficient(Table):
    """A coefficient of restitution or friction that each granule has of its own."""

    distribution: Literal["normal", "uniform"] = Field(
        "normal", description="normal: mean and std, cut off where no coefficient is; uniform: low and high"
    )
    mean: Annotated[float, Field(ge=0, le=10)] | None = None
    std: Annotated[float, Field(ge=0, le=5)] | None = None
    low: Annotated[float, Field(ge=0, le=10)] | None = None
    high: Annotated[float, Field(ge=0, le=10)] | None = None

    @classmethod
    def means(cls, table: Mapping[str, object] | Table) -> bool:
        """Whether a table, of which other kinds may be in its place, is of this one by its keys."""
        if not isinstance(table, Mapping):
            return isinstance(table, cls)
        return "law" not in table and not table.keys().isdisjoint(cls.model_fields)

    @model_validator(mode="after")
    def _is_complete(self) -> Coefficient:
        wanted = ("mean", "std") if self.distribution == "normal" else ("low", "high")
        given = [name for name in ("mean", "std", "low", "high") if getattr(self, name) is not None]
        if sorted(given) != sorted(wanted):
            found = ", ".join(given) or "nothing"
            raise SceneError(f"a {self.distribution} distribution takes {' and '.join(wanted)}, not {found}")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise SceneError(f"low = {self.low:g} must be below high = {self.high:g}")
        return self

    def quantile(self, p: Array, most: float) -> Array:
        """Coefficients below which the shares ``p`` of the granules lie; none is larger than ``most``.

        Raises SceneError where the distribution goes beyond what the coefficient can be.
        """
        if self.distribution == "uniform":
            if known(self.high) > most:
                raise SceneError(f"high = {known(self.high):g} is more than {most:g}")
            return sizes["uniform"](p, low=known(self.low), high=known(self.high))
        assert self.mean is not None
        assert self.std is not None
        if self.mean > most:
            raise SceneError(f"mean = {self.mean:g} is more than {most:g}")
        if self.std > 0.0:
            law = NormalDist(self.mean, self.std)
            lost = law.cdf(0.0) + (0.0 if math.isinf(most) else 1.0 - law.cdf(most))
            if lost > CUT:
                raise SceneError(f"std = {self.std:g} puts {lost:.0%} outside 0 to {most:g}; use uniform, low and high")
        return within(p, mean=self.mean, std=self.std, low=0.0, high=most)
