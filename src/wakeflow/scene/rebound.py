"""How a fraction's granules rebound: restitution as a law of the approach speed, coefficients spread over granules."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import NormalDist
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..core.errors import SceneError
from ..laws.restitution import Restitution, restitution_laws
from ..laws.size import sizes, within
from .table import Array, LawTable, PositiveSpeed, Table, parameters

CUT = 0.05  # of a normal distribution: where more lies outside what a coefficient can be, it is not one


@parameters(
    value=(Annotated[float, Field(ge=0, le=1)], "restitution measured at one speed"),
    at=(PositiveSpeed, "that speed, normal to the wall"),
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
