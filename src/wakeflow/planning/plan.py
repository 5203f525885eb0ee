"""What a plan holds: for the whole run and for each fraction, and how the granules are divided into samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from html import escape
from types import MappingProxyType
from typing import Any, ClassVar

from ..core.graded import Notice
from .airflow import AirflowPlan
from .bounds import COLLISIONS
from .coupling import Limit
from .crowd import CrowdPlan
from .impaction import Deflection
from .terms import LeftOut

__all__ = [
    "AT_ONCE",
    "COMPARED",
    "DRAWS",
    "GATHERED",
    "REPLICATES",
    "SAME_AIR",
    "FractionPlan",
    "Plan",
    "StageCost",
    "replicate_size",
    "whole_terms",
]

REPLICATES = 16  # independent randomised samples a fraction: 15 degrees of freedom for the interval
AT_ONCE = 2**17  # granules that are fed and flown at a time, or one replicate where it has more
COMPARED = 4  # of the replicates fly again in each comparison with another airflow, step or mesh
DRAWS = 64  # of everything that is not known exactly; their regression has some forty degrees of freedom
GATHERED = 2048  # granules of a fraction whose force on the air is gathered. Chosen: a hundred pass every box there
SAME_AIR = 2  # draws that share one draw of the air, whose fields cost more to make than granules to fly


class _Sendable:
    """A dataclass whose read-only mappings, which pickle refuses, are sent to another process as plain ones."""

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        values = (getattr(self, one.name) for one in fields(self))  # type: ignore[arg-type]
        return type(self), tuple(dict(one) if isinstance(one, MappingProxyType) else one for one in values)


@dataclass(frozen=True)
class FractionPlan(_Sendable):
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
    bounds: Mapping[str, float] = field(default_factory=dict)  # body widths each term could move it by
    limit: float | None = None  # body widths: what a term must be able to move to be used

    def __post_init__(self) -> None:
        object.__setattr__(self, "bounds", MappingProxyType(dict(self.bounds)))

    @property
    def tracked(self) -> dict[str, Any]:
        """What its tracks depend on: everything but the bounds that chose the forces."""
        table = {key: value for key, value in _table(self).items() if key not in ("bounds", "limit", "impaction")}
        if self.mode == "injected" and self.impaction is not None:
            table["reach"] = self.impaction.diameters, self.impaction.reach
        return table


def whole_terms(airflow: AirflowPlan, crowd: CrowdPlan | None) -> frozenset[str]:
    """The terms among ``planning.bounds`` that are computed for the run as a whole, of all fractions together."""
    return airflow.effects | ({COLLISIONS} if crowd is not None else set())


@dataclass(frozen=True)
class StageCost:
    """What a stage is expected to take: its ``name`` as a run's listener hears it, ``seconds`` each of the ``times``
    that it is done, and ``when``: first, in the answer's own airflow, beside that on another core, or after it.
    """

    ORDER: ClassVar[tuple[str, ...]] = ("first", "answer", "beside", "after")

    name: str
    seconds: float
    when: str
    times: int = 1

    @property
    def whole(self) -> float:
        """Seconds of all times together."""
        return self.times * self.seconds


@dataclass(frozen=True)
class Plan(_Sendable):
    """What will be computed and what will not: complete when it is made, and not changed afterwards."""

    airflow: AirflowPlan
    target_error: float  # of a bin's share: what the bounds were compared with
    force: Mapping[str, bool]  # terms switched by hand
    fractions: Mapping[str, FractionPlan]
    used: tuple[str, ...]  # what is computed, in words
    left_out: tuple[LeftOut, ...]
    estimate: Mapping[str, float]  # seconds, memory (bytes), disk (bytes)
    stages: tuple[StageCost, ...] = ()  # what is done, in order, and what it is expected to take
    notices: tuple[Notice, ...] = ()  # what a user must know before the run, the gravest first
    validity: tuple[Limit, ...] = ()  # what the feed rate strains, and from which rate on
    unit: str = "body widths"  # of lengths; channel widths where nothing stands
    crowd: CrowdPlan | None = None  # the slab in which granules meet; None: each flies alone

    def __post_init__(self) -> None:
        for name in ("force", "fractions", "estimate"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __repr__(self) -> str:
        """What is flown how, and how much there is to read."""
        flown = ", ".join(f"{name} {fraction.mode}" for name, fraction in self.fractions.items())
        return f"<Plan rung {self.rung}: {flown}; {len(self.left_out)} terms left out, {len(self.notices)} notices>"

    def _repr_html_(self) -> str:
        """What a user must know, what is computed and what is left out, as a notebook shows it."""
        left = (f"{one.name}: {one.why}" for one in self.left_out)
        parts = (("notices", self.warnings), ("computed", self.used), ("left out", tuple(dict.fromkeys(left))))
        return "".join(
            f"<details{' open' if place == 0 else ''}><summary>{title}</summary><ul>"
            + "".join(f"<li>{escape(line)}</li>" for line in lines)
            + "</ul></details>"
            for place, (title, lines) in enumerate(parts)
            if lines
        )

    @property
    def rung(self) -> str:
        """none | analytic | draft | standard | reference | 3d | given"""
        return self.airflow.rung

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notices, without their grades."""
        return tuple(notice.text for notice in self.notices)

    def with_forces(self, forces: Sequence[str]) -> Plan:
        """The same plan with every fraction flown with ``forces``, whatever their bounds: for comparisons."""
        fractions = {name: replace(fraction, forces=tuple(forces)) for name, fraction in self.fractions.items()}
        return replace(self, fractions=fractions)

    def as_computed(self) -> Plan:
        """The same plan in the airflow as it is computed, where the answer would be a best estimate, and without
        granules that drag on it: for comparisons with what is published of such airflows.
        """
        return replace(self, airflow=replace(self.airflow, wake=None, loaded=False))

    def summary(self) -> dict[str, Any]:
        """The ``plan`` table of result.json and of ``wakeflow plan --json``."""
        table = _table(self)
        table = {**table.pop("airflow"), **table}
        del table["notices"]
        table |= {"warnings": list(self.warnings), "grades": [notice.grade.value for notice in self.notices]}
        for row in [*table["fractions"].values(), *table["validity"]]:
            row.update({key: None for key, value in row.items() if isinstance(value, float) and math.isinf(value)})
        return table


def _table(value: Any) -> Any:
    """Records and mappings as plain dictionaries, sequences as lists, through all levels."""
    if is_dataclass(value):
        return {part.name: _table(getattr(value, part.name)) for part in fields(value)}
    if isinstance(value, Mapping):
        return {key: _table(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_table(part) for part in value]
    return value


def replicate_size(count: int) -> int:
    """Granules in each of the REPLICATES when ``count`` are asked for: the next power of two, since Sobol sets are
    balanced for these.
    """
    return int(2 ** max(0, math.ceil(math.log2(count / REPLICATES))))
