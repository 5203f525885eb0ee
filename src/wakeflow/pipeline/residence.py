"""How long near wakes keep fine dust: a stage of its own, for tracers have to be flown for it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files import write_json
from ..core.store import content_key
from ..scene import Scene
from .cache import StageCache, code_of
from .realisations import Realisations

if TYPE_CHECKING:
    from ..tracking.residence import ResidenceTime

__all__ = ["residence_table"]


def residence_table(scene: Scene, cache: StageCache, airs: Mapping[str, tuple[str, Realisations]]) -> dict[str, Any]:
    """Value and interval of H = tau U / D behind the first body in each of ``airs``, by its name: the key of its fields
    and the fields. Null for what is longer than tracers are followed.
    """
    body, air = next(iter(scene.body.values())), scene.air
    assert air is not None
    where = body.outline(), air.direction, air.speed
    asked = [(key, found.cycles) for key, found in airs.values()]
    key = content_key("residence", asked, where[0].tolist(), *where[1:], code_of("residence"))

    def work(part: Path) -> None:
        from ..tracking.residence import residence_time

        rows = {}
        for which, (_, found) in airs.items():
            cache.tell("residence", f"fine dust in the near wake: {which.replace('_', '-')}")
            fields = [field for number in range(len(found)) if (field := found.make(number)) is not None]
            rows[which] = _row(residence_time(fields, *where, sheddings=found.cycles))
        write_json(part / "residence.json", rows)

    table: dict[str, Any] = json.loads((cache.make("residence", key, work) / "residence.json").read_text())
    return table


def _row(found: ResidenceTime) -> dict[str, float | None]:
    ends = {"value": found.value, "low": found.low, "high": found.high}
    return {name: number if math.isfinite(number) else None for name, number in ends.items()}
