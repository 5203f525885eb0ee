"""What a plan holds: for the whole run and for each fraction, and how the granules are divided into samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from types import MappingProxyType
from typing import Any

from ..core.graded import Grade, Notice
from ..core.number import Most
from ..core.record import column, to_json
from ..laws.forces import forces
from .airflow_choice import AirflowPlan
from .collisions import CollisionPlan
from .coupling import Limit
from .stages import StageCost
from .terms import COLLISIONS, LeftOut
from .uniform_fall import Deflection

REPLICATES = 16  # independent randomised samples a fraction: 15 degrees of freedom for the interval
AT_ONCE = 2**17  # granules that are fed and flown at a time
KEPT = 2**20  # granules of a fraction whose landings are kept; of more, all are counted and so many kept
COMPARED = 4  # of the replicates fly again in each comparison with another airflow, step or mesh
INPUT_SAMPLES = 64  # flown draws of everything that is not known exactly: the landings' response is fitted to them
PASSING = 512  # the same in passes after which that of granules that meet is gathered: known to some 2 % of the force
GATHERED = 2048  # granules of a fraction whose force on the air is gathered. Chosen: a hundred pass every box there
SAME_AIR = 4  # draws that share one draw of the air, which costs more to make than they to fly: no worse than 2, tried


@dataclass(frozen=True)
class CostEstimate:
    """What the run was expected to cost; good to a factor of two."""

    seconds: float = column("s", "run time")
    memory: float = column("bytes", "memory")
    disk: float = column("bytes", "disk")

    def __getitem__(self, name: str) -> float:
        """Number by its name: ``plan.estimate["seconds"]``."""
        number: float = getattr(self, name)
        return number


class _Sendable:
    """A dataclass whose mappings are read-only, and are sent to another process, since pickle refuses them, as plain
    ones.
    """

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, Mapping):
                object.__setattr__(self, name, MappingProxyType(dict(value)))

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), tuple(dict(value) if isinstance(value, Mapping) else value for value in vars(self).values())


@dataclass(frozen=True)
class FractionPlan(_Sendable):
    """How one fraction is computed, and the scales that decide it, of the median size."""

    mode: str = column("", "injected or resolved")
    drag: str = column("", "name of the drag law")
    drag_scale: float = column(
        "1", "factor on the law that gives the measured terminal velocity; a granule's own slip correction divides it"
    )
    terminal_velocity: float | None = column("m/s", "terminal velocity in the scene's air; null in a vacuum")
    relaxation_time: Most = column("s", "relaxation time at the speed relative to the air on arrival; null in a vacuum")
    stokes: Most = column(
        "1", "approach Stokes number, relaxation time x arrival speed / half width; null without a body or air"
    )
    arrival_speed: float = column("m/s", "speed at the top of the body, drag included; negative where carried up")
    impaction: Deflection | None = column("", "null in a vacuum, in upward air and under a tilt", default=None)
    forces: tuple[str, ...] = column("", "the terms that it is flown with", default=())
    bounds: Mapping[str, Most] = column("as plan.unit", "how far each term could move it", default=dict)
    limit: Most = column("as plan.unit", "how far a term must be able to move it to be used", default=math.inf)

    @property
    def random(self) -> bool:
        """Whether its granules are moved by chance."""
        return any(forces[name].random for name in self.forces)

    @property
    def tracked(self) -> dict[str, Any]:
        """What its tracks depend on: everything but the bounds that chose the forces."""
        table = {key: value for key, value in vars(self).items() if key not in ("bounds", "limit", "impaction")}
        if self.mode == "injected" and self.impaction is not None:
            table["reach"] = self.impaction.diameters, self.impaction.reach
        return table


def whole_terms(airflow: AirflowPlan, collisions: CollisionPlan | None) -> frozenset[str]:
    """The terms among ``planning.terms`` that are computed for the run as a whole, of all fractions together."""
    return airflow.effects | ({COLLISIONS} if collisions is not None else set())


@dataclass(frozen=True)
class Plan(_Sendable):
    """What is computed and what is not: complete when it is made, and not changed afterwards."""

    airflow: AirflowPlan = column("", "how the airflow is computed")
    target_error: float = column("1", "error of a share that the bounds were compared with")
    force: Mapping[str, bool] = column("", "terms switched by hand")
    fractions: Mapping[str, FractionPlan] = column("", "every fraction")
    used: tuple[str, ...] = column("", "what is used, in words")
    left_out: tuple[LeftOut, ...] = column("", "what is left out")
    estimate: CostEstimate = column("", "expected cost")
    stages: tuple[StageCost, ...] = column("", "what was to be done, in order", default=())
    notices: tuple[Notice, ...] = column("", "what a user must know before the run, the gravest first", default=())
    validity: tuple[Limit, ...] = column("", "what the feed rate strains, and from which rate on", default=())
    unit: str = column("", "unit of lengths in this table: body widths or channel widths", default="body widths")
    collisions: CollisionPlan | None = column(
        "", "the slab in which granules meet; null where each flies alone", default=None
    )

    def __repr__(self) -> str:
        """What is flown how, and how much there is to read."""
        flown = ", ".join(f"{name} {fraction.mode}" for name, fraction in self.fractions.items())
        return f"<Plan rung {self.rung}: {flown}; {len(self.left_out)} terms left out, {len(self.notices)} notices>"

    def _repr_html_(self) -> str:
        """What a user must know, what is computed and what is left out, as a notebook shows it."""
        left = (f"{term.name}: {term.why}" for term in self.left_out)
        parts = (("notices", self.warnings), ("computed", self.used), ("left out", tuple(dict.fromkeys(left))))
        return "".join(
            f"<details{' open' if place == 0 else ''}><summary>{title}</summary><ul>"
            + "".join(f"<li>{escape(line)}</li>" for line in lines)
            + "</ul></details>"
            for place, (title, lines) in enumerate(parts)
            if lines
        )

    @property
    def crowd(self) -> CollisionPlan | None:
        """``collisions`` by its earlier name."""
        return self.collisions

    @property
    def rung(self) -> str:
        """none | analytic | draft | standard | reference | 3d | given"""
        return self.airflow.rung

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notices, without their grades."""
        return tuple(notice.text for notice in self.notices)

    @property
    def why_void(self) -> str:
        """Why the answer will be worth nothing, as far as that is known before it; empty where it is not."""
        return next((notice.text for notice in self.notices if notice.grade is Grade.VOID), "")

    def with_forces(self, forces: Sequence[str]) -> Plan:
        """This plan with every fraction flown with ``forces``, whatever their bounds: for comparisons."""
        fractions = {name: replace(fraction, forces=tuple(forces)) for name, fraction in self.fractions.items()}
        return replace(self, fractions=fractions)

    def summary(self) -> dict[str, object]:
        """The ``plan`` table of result.json and of ``wakeflow plan --json``."""
        table: dict[str, Any] = to_json(self)
        return table


def gathered(count: int, most: int = GATHERED) -> int:
    """Granules of a fraction whose force on the air is gathered in a scene of so many: no more than it asks for."""
    return min(most, REPLICATES * replicate_size(count))


def replicate_size(count: int) -> int:
    """Granules in each of the REPLICATES when ``count`` are asked for: the next power of two, since Sobol sets are
    balanced for these.
    """
    return int(2 ** max(0, math.ceil(math.log2(count / REPLICATES))))
