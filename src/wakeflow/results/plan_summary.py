"""What the plan decided: the ``plan`` table of result.json and of ``wakeflow plan --json``."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.graded import GRADES
from ..core.record import Partial, column, from_json
from ..planning.plan import Plan
from .airflow_summary import BestEstimate

__all__ = [
    "CostEstimate",
    "FractionSummary",
    "ImpactionSummary",
    "LeftOutSummary",
    "PlanSummary",
    "PlannedSlab",
    "PlannedStage",
    "ValidityLimit",
    "summary_of",
]


@dataclass(frozen=True)
class ImpactionSummary:
    """What the air does to a fraction before the first body."""

    efficiency: float = column("1", "mass that meets the body over mass that would, falling straight")
    missed: float = column("1", "share of the mass that would fall on the body and is carried round it")
    shift: float = column("body widths", "95 % of those that meet it land within that of where they would otherwise")
    diameters: tuple[float, ...] = column("m", "sizes for which reach is given")
    reach: tuple[float, ...] = column("m", "how far off the axis granules of each size still meet the body")


@dataclass(frozen=True)
class FractionSummary:
    """How a fraction is computed, and the scales that decide it, of the median size."""

    mode: str = column("", "injected or resolved")
    drag: str = column("", "name of the drag law")
    drag_scale: float = column("1", "factor on the law that gives the measured terminal velocity")
    terminal_velocity: float | None = column("m/s", "in the scene's air; null in a vacuum")
    relaxation_time: float | None = column("s", "at the speed relative to the air on arrival; null in a vacuum")
    stokes: float | None = column("1", "approach Stokes number; null without a body or air")
    arrival_speed: float = column("m/s", "at the top of the body, drag included; negative where carried up")
    impaction: ImpactionSummary | None = column("", "null in a vacuum and in upward air")
    forces: tuple[str, ...] = column("", "the terms that it is flown with")
    bounds: dict[str, float] = column("as plan.unit", "how far each term could move it")
    limit: float | None = column("as plan.unit", "how far a term must be able to move it to be used")


@dataclass(frozen=True)
class PlannedStage:
    """What a stage was expected to take."""

    name: str = column("", "of the stage, as in the table seconds")
    seconds: float = column("s", "run time, each time")
    when: str = column("", "first, in the answer's own airflow (answer), beside that, or after it")
    times: int = column("1", "how often")


@dataclass(frozen=True)
class LeftOutSummary:
    """A term that is not computed."""

    name: str = column("", "name of the term")
    bound: float | None = column("as plan.unit", "how far it could move a granule; null where that is no shift")
    why: str = column("", "why it is left out")
    fraction: str | None = column("", "for which fraction; null for all", default=None)


@dataclass(frozen=True)
class CostEstimate:
    """What the run was expected to cost; good to a factor of two."""

    seconds: float = column("s", "run time")
    memory: float = column("bytes", "memory")
    disk: float = column("bytes", "disk")


@dataclass(frozen=True)
class ValidityLimit:
    """A number that grows with the feed rate, and up to where what it stands for holds."""

    name: str = column("", "name of the number")
    about: str = column("", "what it stands for")
    value: float | None = column("1", "the number; null where it has no bound")
    limit: float | None = column("1", "up to where it holds; null for a scale without limit")
    feed_rate: float | None = column("kg/h", "feed that reaches the limit")
    why: str = column("", "what the number is, with its source")


@dataclass(frozen=True)
class PlannedSpan:
    """The third dimension of an airflow, where it is resolved."""

    depth: float = column("body widths", "length of the periodic span")
    layers: int = column("1", "layers of cells over it")
    sheddings: float = column("1", "usual sheddings recorded after the start-up")


@dataclass(frozen=True)
class PlannedSlab:
    """The slab in which granules meet."""

    depth: float = column("m", "of the slab across the picture, periodic")
    tracers: dict[str, float] = column("1", "share of each fraction's mass, its finest granules, that fly as tracers")
    in_flight: dict[str, float] = column("1", "granules of each fraction that are simulated one by one, at a time")
    replicates: int = column("1", "independent runs of the slab")
    start_up: float = column("s", "of each, estimated; dropped")
    operation: float = column("s", "of each, that counts; at least")
    count: int = column("1", "tracers of a fraction that count, over all replicates")
    seconds: float = column("s", "run time expected, on two cores")
    memory: float = column("bytes", "memory expected")


@dataclass(frozen=True)
class PlanSummary(Partial):
    """What is computed and what is not."""

    rung: str = column("", "none, analytic, draft, standard, reference, 3d or given", default="")
    why: str | None = column("", "why this rung", default=None)
    stepping: str | None = column("", "steady or time-resolved; null without a solver", default=None)
    turbulence: str | None = column("", "turbulence model", default=None)
    symmetric: bool | None = column("", "whether the geometry is its own mirror image", default=None)
    half: bool | None = column("", "whether only half of the channel is solved", default=None)
    scales: tuple[float, ...] | None = column("1", "cell edges over the rung's own, one a grid", default=None)
    brackets: bool | None = column("", "whether steady and time-resolved wake bracket the truth", default=None)
    moving: bool | None = column("", "whether the mesh vibrates with the body", default=None)
    loaded: bool | None = column("", "whether the air feels the granules", default=None)
    accuracy: float | None = column("1", "relative half width at which a time-resolved run may end", default=None)
    wake: BestEstimate | None = column("", "how much of the time-resolved wake the answer is flown in", default=None)
    span: PlannedSpan | None = column("", "the third dimension; null where the airflow is plane", default=None)
    target_error: float | None = column("1", "error of a share that the bounds were compared with", default=None)
    force: dict[str, bool] | None = column("", "terms switched by hand", default=None)
    fractions: dict[str, FractionSummary] | None = column("", "every fraction", default=None)
    used: tuple[str, ...] = column("", "what is used, in words", default=())
    left_out: tuple[LeftOutSummary, ...] = column("", "what is left out", default=())
    estimate: CostEstimate | None = column("", "expected cost", default=None)
    stages: tuple[PlannedStage, ...] = column("", "what was to be done, in order", default=())
    warnings: tuple[str, ...] | None = column(
        "", "what a user must know before the run, the gravest first", default=None
    )
    grades: tuple[str, ...] | None = column("", GRADES, default=None)
    flown_by: str | None = column("", "of results of version 1: tracker or chain; not written any more", default=None)
    validity: tuple[ValidityLimit, ...] | None = column("", "what the feed rate strains", default=None)
    unit: str = column("", "of lengths in this table: body widths or channel widths", default="body widths")
    crowd: PlannedSlab | None = column("", "the slab in which granules meet; null where each flies alone", default=None)


def summary_of(plan: Plan) -> PlanSummary:
    """What a plan decided, as result.json holds it."""
    return from_json(PlanSummary, plan.summary(), "plan")
