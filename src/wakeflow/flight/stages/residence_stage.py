"""How long near wakes keep fine dust: a stage of its own, for tracers have to be flown for it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...air.kinds.airflow_table import ResidenceTimes
from ...air.kinds.realisations import Realisations
from ...core.number import Number
from ...core.record import load, save
from ...core.store import content_key
from ...planning.stage_cache import StageCache, code_of
from ...scene import Scene


def residence_times(scene: Scene, cache: StageCache, airs: Mapping[str, tuple[str, Realisations]]) -> ResidenceTimes:
    """H = tau U / D behind the first body in each of ``airs``, by its name: the key of its fields and the fields."""
    body, air = next(iter(scene.body.values())), scene.airstream
    where = body.outline(), air.direction, air.speed
    asked = [(key, found.cycles) for key, found in airs.values()]
    key = content_key("residence", asked, where[0].tolist(), *where[1:], code_of("flight.residence"))

    def work(part: Path) -> None:
        from ..residence import residence_time

        rows = {}
        for which, (_, found) in airs.items():
            cache.tell("residence", f"fine dust in the near wake: {which.replace('_', '-')}")
            fields = [field for number in range(len(found)) if (field := found.make(number)) is not None]
            time = residence_time(fields, *where, sheddings=found.cycles)
            rows[which] = Number(time.value, time.low, time.high)
        save(part / "residence.json", ResidenceTimes(**rows))

    return load(ResidenceTimes, cache.make("residence", key, work) / "residence.json")
