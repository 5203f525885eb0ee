"""[limit] and [price]: what the answer is held to, and what it is worth."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from ..core.registry import did_you_mean
from .table import Name, Portion, Table


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
