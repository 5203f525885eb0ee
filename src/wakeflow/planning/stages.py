"""The stages of a run as objects: what computes each, what kind of work it is, what it costs, how it is shown.

The program's own are registered in :mod:`.cost`; another module registers one by adding it to ``stages``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, NamedTuple, Protocol

from ..core.registry import Registry
from ..scene import Scene
from .airflow_choice import AirflowPlan
from .collisions import CollisionPlan

FLIGHTS, OTHER_MESHES = "flights", "other meshes"


class AirLabel(NamedTuple):
    """Which airflow of a run a stage belongs to: the answer's own, that on another ``grid`` (its cell edges over the
    usual ones), the steady ``draft`` of either, or one of the ``neighbour`` run.
    """

    neighbour: bool = False
    grid: float = 0.0
    draft: bool = False

    def __str__(self) -> str:
        grid = f"grid x {self.grid:.2g} " if self.grid else ""
        return f"{'neighbour ' * self.neighbour}{grid}{'draft ' * self.draft}"


OWN = AirLabel()


class Scaling(Enum):
    """What the run time of a stage goes with when the settings of a scene change."""

    ONCE = "nothing: it is made once"
    AIR = "the solver's steps"
    CELLS = "the cells of the mesh"
    FLIGHTS = "the granules that fly and their steps"
    SLAB = "the granules in the slab"


@dataclass(frozen=True)
class StageCost:
    """What a stage is expected to take: its ``name`` as a run's listener hears it, ``seconds`` each of the ``times``
    that it is done, and ``when``: before the answer's own airflow on the run's core (first) or on another one
    (meanwhile), in that airflow (answer), on another core at the same time, or after it; ``memory`` (bytes) that the
    run holds in it at most, with the program that the stage starts.
    """

    ORDER: ClassVar[tuple[str, ...]] = ("meanwhile", "first", "answer", "beside", "after")

    name: str
    seconds: float
    when: str
    times: int = 1
    memory: float = 0.0

    @property
    def whole(self) -> float:
        """Seconds of all times together."""
        return self.times * self.seconds

    @property
    def key(self) -> StageKey:
        """Key of the stage."""
        return StageKey.of(self.name)


class Workload(NamedTuple):
    """What the stages of a run have to do: the ``scene``, its airflow and slab, how many ``fractions`` fly, and the
    ``effort`` of one granule of each, 1 a fraction with weight and drag alone.
    """

    scene: Scene
    airflow: AirflowPlan
    collisions: CollisionPlan | None
    fractions: int
    effort: float


@dataclass(frozen=True)
class Stage:
    """A stage by its ``name``; as it is by default, one in which granules fly again.

    ``work``: the kind of work, whose pace is learned; ``scaling``: what its run time goes with; ``heading``: under
    which its run time is shown; ``cost``: each time that a run makes it, with what that is expected to take.
    """

    name: str
    work: str = FLIGHTS
    scaling: Scaling = Scaling.FLIGHTS
    heading: str = "companions"
    cost: Callable[[Workload], Iterable[StageCost]] = lambda _: ()


stages: Registry[Stage] = Registry("stage")


class StageKey(str):
    """A stage by ``name`` of the airflow with a ``label``; its text is both, as a listener and result.json have it."""

    label: AirLabel
    name: str

    def __new__(cls, label: AirLabel, name: str) -> StageKey:
        """The key with its text."""
        made = super().__new__(cls, f"{label}{name}")
        made.label, made.name = label, name
        return made

    def __getnewargs__(self) -> tuple[AirLabel, str]:  # type: ignore[override]
        return self.label, self.name

    @classmethod
    def of(cls, name: str) -> StageKey:
        """The key itself, or that of a stage of the answer's own airflow by its name."""
        return name if isinstance(name, StageKey) else cls(OWN, name)

    @property
    def stage(self) -> Stage:
        """What is registered under the name; granules fly again in any other."""
        return stages[self.name] if self.name in stages else Stage(self.name)

    @property
    def heading(self) -> str:
        """Heading under which its run time is shown."""
        return OTHER_MESHES if self.label.grid else self.stage.heading


class FliesAgain(Protocol):
    """What the plan asks of a source of error: its ``place`` among them, and what it costs to fly granules again."""

    place: ClassVar[int]

    def costs(self, work: Workload) -> Iterable[StageCost]:
        """Cost of each stage that a run makes for it."""
