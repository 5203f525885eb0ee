"""[limit] and [price]: what the answer is held to, and what it is worth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ..core.errors import SceneError
from ..core.registry import did_you_mean
from .table import RESERVED_BIN, AirFlow, Drop, Name, Portion, Shorthand, Table, WithUnit, rise

TARGET = "target"  # of a price: all bins where the fraction should land
Price = Annotated[float, Field(ge=-1e7, le=1e7), WithUnit("EUR/t", "220 EUR/t")]
PowerPrice = Annotated[float, Field(ge=0, le=100), WithUnit("EUR/kWh", "0.25 EUR/kWh")]


class FanEfficiency(Table):
    """What part of the electricity a fan, its drive and its motor turn into pressure and flow, over the flow."""

    flow: list[AirFlow] = Field(description="rising")
    efficiency: list[Annotated[float, Field(gt=0, le=1), WithUnit("1", "55 %")]] = Field(description="at each flow")

    @model_validator(mode="after")
    def _paired(self) -> FanEfficiency:
        if not self.flow or len(self.flow) != len(self.efficiency) or not rise(self.flow):
            raise SceneError("needs as many efficiencies as flows, and flows that rise")
        return self

    def at(self, flow: float) -> float:
        """At a flow (m3/s); beyond the ends that of the end."""
        return float(np.interp(flow, self.flow, self.efficiency))


class LimitTable(Table):
    """[limit]: what the answer is held to, loss.FRACTION = "0.5 %" or dirt.BIN = "2 %": met, not met or open."""

    loss: dict[Name, Portion] = Field({}, description="of a fraction outside its targets, at most, by fraction")
    dirt: dict[Name, Portion] = Field(
        {}, description="of a bin's mass that is of fractions whose target it is not, at most, by bin"
    )

    @property
    def asked(self) -> dict[str, float]:
        """The limits by the names of what they limit: loss.FRACTION and dirt.BIN."""
        return {f"loss.{name}": most for name, most in self.loss.items()} | {
            f"dirt.{place}": most for place, most in self.dirt.items()
        }

    def mistakes(self, wanted: list[str], products: list[str]) -> Iterator[str]:
        """What is limited that no answer has: the loss of what is not among the fractions ``wanted`` in a bin, the dirt
        of what is no product.
        """
        for kind, given, known, lacks in (
            ("loss", self.loss, wanted, "no fraction with a target"),
            ("dirt", self.dirt, products, "no bin that is a fraction's target"),
        ):
            for name in given:
                if name not in known:
                    named = f"known: {', '.join(known)}" if known else "give fraction.NAME.target, a bin"
                    yield f"limit.{kind}.{name}: {lacks}{did_you_mean(name, known)} ({named})"


class PriceTable(Table):
    """[price]: what a tonne of each fraction is worth where it lands, and what the fan's electricity costs."""

    value: dict[Name, Annotated[dict[Name, Price], Shorthand(str | float, lambda price: {TARGET: price})]] = Field(
        {},
        description="EUR/t of a fraction in its targets, or by bin, { target = 220, middle = 90 }; nothing elsewhere",
    )
    electricity: PowerPrice | None = Field(None, description="of the fan")
    fan_efficiency: (
        Annotated[FanEfficiency, Shorthand(str | float, lambda share: {"flow": [0.0], "efficiency": [share]})] | None
    ) = Field(None, description="of fan, drive and motor together, or a curve: { flow = [...], efficiency = [...] }")
    other_drop: Drop = Field(0.0, description="pressure that the fan gives beside the channel: ducts, filter, cyclone")

    @property
    def asked(self) -> bool:
        """Whether anything has a price."""
        return bool(self.value) or self.electricity is not None

    def by_bin(self, targets: Mapping[str, tuple[str, ...]]) -> dict[str, dict[str, float]]:
        """EUR/t of each fraction by bin, of fractions with these ``targets``; a bin's own price goes first."""
        return {
            name: {place: row[TARGET] for place in targets[name] if TARGET in row}
            | {place: price for place, price in row.items() if place != TARGET}
            for name, row in self.value.items()
        }

    def fan_power(self, drop: float | None, flow: float | None, depth: float) -> float | None:
        """W of a fan that gives the pressure ``drop`` (Pa) of a channel of this ``depth`` (m), and the other drop, to
        its air, whose ``flow`` (m2/s) is by depth; None where drop or flow is not known.
        """
        if drop is None or flow is None or self.fan_efficiency is None:
            return None
        return max(0.0, drop + self.other_drop) * flow * depth / self.fan_efficiency.at(flow * depth)

    def mistakes(self, targets: Mapping[str, tuple[str, ...]], bins: list[str]) -> Iterator[str]:
        """What is priced that there is not, among fractions with these ``targets`` and ``bins``."""
        for name, row in self.value.items():
            if name not in targets:
                hint = did_you_mean(name, list(targets))
                yield f"price.value.{name}: no fraction{hint} (known: {', '.join(targets)})"
                continue
            for place in row:
                known = [*bins, RESERVED_BIN, TARGET]
                if place not in known:
                    yield f"price.value.{name}.{place}: no bin{did_you_mean(place, known)} (known: {', '.join(known)})"
            if TARGET in row and not targets[name]:
                yield f"price.value.{name}: it has no target; give fraction.{name}.target, or a price by bin"
        if (self.electricity is None) != (self.fan_efficiency is None):
            lacking = "electricity" if self.electricity is None else "fan_efficiency"
            yield f"price.{lacking}: missing; the fan's cost takes electricity and fan_efficiency"
