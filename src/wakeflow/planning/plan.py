"""What a plan holds: for the whole run and for each fraction, and how the granules are divided into samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from .airflow import AirflowPlan
from .coupling import Limit
from .impaction import Deflection
from .terms import LeftOut

__all__ = ["AT_ONCE", "COMPARED", "REPLICATES", "FractionPlan", "LeftOut", "Plan", "replicate_size"]

REPLICATES = 16  # independent randomised samples a fraction: 15 degrees of freedom for the interval
AT_ONCE = 2**17  # granules that are fed and flown at a time, or one replicate where it has more
COMPARED = 4  # of the replicates fly again in each comparison with another airflow, step or mesh


@dataclass(frozen=True)
class FractionPlan:
    """How one fraction is computed, and the scales that decide it (SI units, of the median size)."""

    mode: str  # injected | resolved
    drag: str  # name of the drag law
    drag_scale: float  # factor on the law that gives the measured terminal velocity; 1 without one. A granule's own
    # slip correction divides it
    terminal_velocity: float | None  # m/s in the scene's air, of the median; None in a vacuum
    relaxation_time: float  # s, at the speed relative to the air on arrival; inf in a vacuum
    stokes: float  # approach Stokes number: relaxation time x arrival speed / half width; inf without a body or air
    arrival_speed: float  # m/s at the top of the body, drag included; negative where the air carries it up
    impaction: Deflection | None = None  # what the air does before the body; None in a vacuum and in upward air
    forces: tuple[str, ...] = ()  # the terms it is flown with
    bounds: dict[str, float] = field(default_factory=dict)  # body widths each term could move it by
    limit: float | None = None  # body widths: what a term must be able to move to be used

    @property
    def tracked(self) -> dict[str, Any]:
        """What its tracks depend on: everything but the bounds that chose the forces."""
        table = {key: value for key, value in asdict(self).items() if key not in ("bounds", "limit", "impaction")}
        if self.mode == "injected" and self.impaction is not None:
            table["reach"] = self.impaction.diameters, self.impaction.reach
        return table


@dataclass(frozen=True)
class Plan:
    """What will be computed and what will not."""

    airflow: AirflowPlan
    target_error: float  # of a bin's share: what the bounds were compared with
    force: dict[str, bool]  # terms switched by hand
    fractions: dict[str, FractionPlan]
    used: list[str]
    left_out: list[LeftOut]
    estimate: dict[str, float]  # seconds, memory (bytes), disk (bytes)
    warnings: list[str] = field(default_factory=list)
    flown_by: str = "tracker"  # tracker | chain (rung none of a scene with air: impacts and parabolas in closed form)
    validity: list[Limit] = field(default_factory=list)  # what the feed rate strains, and from which rate on
    unit: str = "body widths"  # of lengths: of the channel where nothing stands

    @property
    def rung(self) -> str:
        """none | analytic | draft | standard | reference | given"""
        return self.airflow.rung

    def with_forces(self, forces: Sequence[str]) -> Plan:
        """The same plan with every fraction flown with ``forces``, whatever their bounds: for comparisons."""
        rows = {name: replace(how, forces=tuple(forces)) for name, how in self.fractions.items()}
        return replace(self, fractions=rows)

    def summary(self) -> dict[str, Any]:
        """The ``plan`` table of result.json and of ``wakeflow plan --json``."""
        table = asdict(self)
        table = {**table.pop("airflow"), **table}
        for row in [*table["fractions"].values(), *table["validity"]]:
            row.update({key: None for key, value in row.items() if isinstance(value, float) and math.isinf(value)})
        return table


def replicate_size(count: int) -> int:
    """Granules in each of the REPLICATES when ``count`` are asked for: the next power of two, since Sobol sets are
    balanced for these.
    """
    return int(2 ** max(0, math.ceil(math.log2(count / REPLICATES))))
