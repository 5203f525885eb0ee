"""The slab in which granules meet: the ``slab`` table of result.json."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.errors import known
from ..core.record import column
from ..pipeline.crowd_stage import SlabFound
from ..pipeline.landings import Landings
from ..planning.plan import Plan
from ..tracking import Fate

__all__ = ["CrowdSummary", "crowd_of"]


@dataclass(frozen=True)
class CrowdSummary:
    """The slab of hard spheres that the shares with collisions come from."""

    depth: float = column("m", "of the slab across the picture, periodic")
    replicates: int = column("1", "independent runs of the slab")
    start_up: float = column("s", "dropped at the beginning of each")
    granules: dict[str, int] = column("1", "granules, or tracers, of each fraction that landed and count")
    tracers: dict[str, float] = column("1", "share of each fraction's mass, its finest granules, that flew as tracers")
    meetings: dict[str, float] = column("1", "with other granules on a flight, mean over each fraction's mass")
    fates: dict[str, dict[str, int]] = column("1", "granules of each fraction by how their track ended")
    step: float = column("s", "of its clock")
    step_error: float | None = column(
        "as plan.unit", "how far nine of ten granules that meet nobody land from where shorter steps put them, at most"
    )
    jammed: int = column("1", "replicates in which granules that lie still became more as long as it was fed")


def crowd_of(plan: Plan, crowd: SlabFound) -> CrowdSummary:
    """What the slab was, and what granules met in it."""
    landings = crowd.landings
    return CrowdSummary(
        depth=crowd.depth,
        replicates=crowd.replicates,
        start_up=crowd.start_up,
        granules={name: len(found.bin) for name, found in landings.items()},
        tracers=dict(known(plan.crowd).tracers),
        meetings={name: _mean_meetings(found) for name, found in landings.items()},
        fates={
            name: {fate.name.lower(): int(np.sum(found.fate == fate)) for fate in Fate}
            for name, found in landings.items()
        },
        step=crowd.step,
        step_error=None if np.isnan(crowd.step_error) else crowd.step_error,
        jammed=crowd.jammed,
    )


def _mean_meetings(found: Landings) -> float:
    return float(known(found.meetings) @ found.mass_shares)
