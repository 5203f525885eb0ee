"""How far an input may be off where nobody says it: defaults by quantity and confidence, with their sources.

The data stand in uncertainties.toml, with the words for them at its head.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ..core.errors import SceneError

__all__ = ["DefaultMargin", "default_margins"]

STATUSES = ("read", "derived", "chosen")
CONFIDENCES = ("measured", "typical", "low", "given", "all")


@dataclass(frozen=True)
class DefaultMargin:
    """Half of a 95 % interval of one quantity: ``relative`` to the number, ``absolute`` in its unit, by confidence, or
    ``in_widths`` of the first body.
    """

    relative: Mapping[str, float]
    absolute: Mapping[str, float]
    in_widths: float | None
    source: str
    status: str

    def half(self, value: float, confidence: str, width: float) -> float:
        """Half of the interval in the quantity's unit: of a ``value`` known with a ``confidence``, in a scene whose
        first body is ``width`` (m) wide.
        """
        if self.in_widths is not None:
            return self.in_widths * width
        table, scale = (self.relative, abs(value)) if self.relative else (self.absolute, 1.0)
        return scale * table.get("all", table.get(confidence, 0.0))


@cache
def default_margins() -> Mapping[str, DefaultMargin]:
    """Every entry of uncertainties.toml by its name."""
    text = (Path(__file__).parent / "uncertainties.toml").read_text(encoding="utf-8")
    return {name: _entry(name, table) for name, table in tomllib.loads(text).items()}


def _entry(name: str, table: dict[str, Any]) -> DefaultMargin:
    ways = [table[key] for key in ("relative", "absolute", "absolute_in_widths") if key in table]
    named = all(set(way) <= set(CONFIDENCES) for way in ways if isinstance(way, dict))
    if len(ways) != 1 or not named or table.get("status") not in STATUSES or not table.get("source"):
        raise SceneError(f"uncertainties.toml: {name}: breaks the rules at the head of the file")
    return DefaultMargin(
        table.get("relative", {}), table.get("absolute", {}), table.get("absolute_in_widths"), table["source"],
        table["status"],
    )  # fmt: skip
