"""LIGGGHTS as the engine of beads: its stages in the cache, and what they take."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from ...core.record import load
from ...core.sources import code_key
from ...core.store import content_key
from ...planning.feed_funnel import FunnelSummary, Make
from ...scene import Funnel
from .engine import INSTALL, liggghts_version
from .pour import discharge, pour, steps_of

CODE = ("wakeflow.extras.funnel.pour",)  # with LIGGGHTS' own scripts beside it
SPEED = 4e6  # beads times steps a second of one core


def compute(funnel: Funnel, make: Make, tell: Callable[[str], None]) -> FunnelSummary:
    """Pour and discharge.

    ``make(stage, key, work)`` gives the folder of a finished stage, from the cache or by ``work(folder)``. The bed is a
    stage of its own, since every vibration starts from the same bed. Raises ProgramError when LIGGGHTS is missing or
    fails.
    """
    asked = {name: getattr(funnel, name) for name in type(funnel).model_fields}
    asked |= {"count": funnel.beads, "mass": None, "material": None, "gravity": funnel.gravity}
    if not funnel.amplitude:
        asked["frequency"] = None
    code = (code_key(*CODE), liggghts_version())
    still = {name: value for name, value in asked.items() if name not in ("frequency", "gamma")}
    bed_key = content_key("bed", still, code)
    bed = make("bed", bed_key, lambda part: pour(funnel, part, tell))
    done = make("funnel", content_key("funnel", bed_key, asked, code), lambda part: discharge(funnel, bed, part, tell))
    return load(FunnelSummary, done / "funnel.json")


def estimated_seconds(funnel: Funnel) -> float:
    """Core-seconds of pouring and discharge, by Beverloo's law; good to a factor 3."""
    time = 0.3 + (0.6 * funnel.total_mass / funnel.expected_rate if funnel.expected_rate else 1.0)
    return funnel.beads * time / steps_of(funnel).dt / SPEED


class Liggghts:
    """Computes beads with LIGGGHTS."""

    install: ClassVar[str] = INSTALL

    def compute(self, funnel: Funnel, make: Make, tell: Callable[[str], None]) -> FunnelSummary:
        return compute(funnel, make, tell)

    def seconds(self, funnel: Funnel) -> float:
        return estimated_seconds(funnel)

    def version(self) -> str:
        return liggghts_version()
