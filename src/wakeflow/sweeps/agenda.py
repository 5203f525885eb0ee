"""The agenda of a sweep: which stages its scenes share, what waits for what, what it will cost.

Where neighbours help an airflow waits for the one that it starts from (``neighbours``), and goes on from rest where
that one fails.
Scenes that fly in one airflow wait for it, and it is solved once. Of scenes whose flights are the same (they differ in
mass shares, targets or the feed's rate) one flies and the others wait for it. Both are told from plans alone, before
anything is computed. Where two stages turn out equal beyond that, the lock of the cache makes one wait for the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.errors import SceneError
from ..core.lazy import cached_property
from ..core.store import content_key
from ..pipeline.airflow_kinds import CaseAir
from ..pipeline.cache import Listener, silent
from ..pipeline.pipeline import Pipeline
from ..pipeline.track_stage import unweighed
from ..planning.airflow_cost import ranks_for, typical_cells
from ..planning.cost import airflow_cost
from ..planning.make import make_plan
from ..planning.plan import Plan
from ..results.result import Request
from ..runs import answer_key
from ..scene import Scene
from .neighbours import starts
from .variant import TOLD_EVERY, Variant
from .work import Job, finished

__all__ = ["Agenda", "Step", "make_agenda"]

AIRFLOWS = "airflows"  # folder of the airflows' own results


@dataclass(frozen=True)
class Step:
    """One job of the agenda: for a scene, or for the airflow of several, on so many MPI ``ranks``; ``needs`` the step
    of that name before it.
    """

    name: str
    job: Job
    airflow: bool
    needs: str | None
    seconds: float  # expected
    disk: float  # bytes, expected
    ranks: int = 1


@dataclass(frozen=True)
class Agenda:
    """All steps in the order in which they are begun, the folders of the scenes by name with their stamps, and what
    cannot be planned with the reason.
    """

    steps: tuple[Step, ...]
    stamps: Mapping[str, str]
    problems: Mapping[str, str]

    @property
    def seconds(self) -> float:
        """Expected core-seconds of all steps."""
        return sum(step.seconds for step in self.steps)

    @property
    def disk(self) -> float:
        """Expected bytes that all steps leave."""
        return sum(step.disk for step in self.steps)


@dataclass(frozen=True)
class _Planned:
    """One scene under its plan."""

    variant: Variant
    scene: Scene
    plan: Plan
    request: Request

    @cached_property
    def stamp(self) -> str:
        """What its answer is made for."""
        return answer_key(self.scene, self.request)

    @cached_property
    def airflow(self) -> str | None:
        """What tells its airflow from others; None where it costs nothing."""
        flown = Pipeline(self.plan.airflow.flown(self.scene), self.plan)
        if flown.kind.at_once:
            return None
        spec = repr(flown.kind.flow_spec) if isinstance(flown.kind, CaseAir) else repr(flown.scene.air)
        return content_key(repr(self.plan.airflow), spec)

    def job(self, folder: Path, threads: int, *, report: bool = False) -> Job:
        """What a worker does for it in a folder."""
        return Job(self.scene.tables(), self.request, folder, self.stamp, self.plan, threads, report)

    @property
    def ranks(self) -> int:
        """MPI processes of its airflow for which a cluster must have cores. The two that a large airflow in two
        dimensions takes unasked are not counted: any worker may run it.
        """
        asked, airflow = self.scene.numerics.ranks, self.plan.airflow
        if asked != "auto":
            return asked
        return 1 if airflow.span is None else ranks_for(round(typical_cells(self.scene, airflow)))[0]

    @cached_property
    def flight(self) -> str:
        """What tells its flights from others in the same airflow."""
        how = {name: repr(row.tracked) for name, row in self.plan.fractions.items()}
        return content_key(unweighed(self.scene), list(self.scene.bin), how)


def make_agenda(
    variants: Sequence[Variant],
    out: Path,
    request: Request,
    *,
    threads: Callable[[int], int] = lambda _: 1,
    report: bool = False,
    neighbours: bool = False,
    listener: Listener = silent,
) -> Agenda:
    """What is still to be done for ``variants`` in the folder ``out``; scenes that are finished there need nothing.

    ``threads(scenes)``: on how many each of so many scenes is flown. With ``neighbours`` an airflow starts from the
    nearest one that is there by then.
    """
    planned: list[_Planned] = []
    problems: dict[str, str] = {}
    for number, variant in enumerate(variants, 1):
        if number % TOLD_EVERY == 0:
            listener("sweep", f"planning scene {number} of {len(variants)}")
        if variant.scene is None:
            problems[variant.name] = variant.problem
            continue
        try:
            plan = make_plan(variant.scene, rung=request.rung, force=request.force, target_error=request.target_error)
        except SceneError as problem:
            problems[variant.name] = str(problem)
            continue
        planned.append(_Planned(variant, variant.scene, plan, request))
    planned = _started(planned, out) if neighbours else planned
    stamps = {one.variant.name: one.stamp for one in planned}
    open_ones = [one for one in planned if finished(out / one.variant.name, one.stamp) is None]
    count = threads(len(open_ones))
    steps = *_airflow_steps(open_ones, out, count), *_flight_steps(open_ones, out, count, report=report)
    return Agenda(steps, stamps, problems)


def _started(planned: Sequence[_Planned], out: Path) -> list[_Planned]:
    """The scenes, each asked for near the one whose airflow its own starts from."""
    first = _by_airflow(planned)
    keys = list(first)
    places = starts([one.variant.inputs for one in first.values()])
    near = {key: str(out / _folder(keys[place])) for key, place in zip(keys, places, strict=True) if place is not None}
    return [replace(one, request=replace(one.request, near=near.get(one.airflow or ""))) for one in planned]


def _by_airflow(planned: Iterable[_Planned]) -> dict[str, _Planned]:
    """The first scene of each airflow that costs something, by what tells that airflow from others."""
    first: dict[str, _Planned] = {}
    for one in planned:
        if one.airflow is not None:
            first.setdefault(one.airflow, one)
    return first


def _folder(airflow: str) -> str:
    """Where the own result of an airflow stands, in the sweep's folder."""
    return f"{AIRFLOWS}/{airflow[:12]}"


def _airflow_steps(planned: Iterable[_Planned], out: Path, threads: int) -> Iterable[Step]:
    """One step for each airflow, the longest first, so that none is left alone at the end."""
    first = _by_airflow(planned)
    folders = {str(out / _folder(key)): _folder(key) for key in first}
    steps = []
    for key, one in first.items():
        cost, folder = airflow_cost(one.scene, one.plan.airflow), _folder(key)
        job, needs = one.job(out / folder, threads), folders.get(one.request.near or "")
        steps.append(Step(folder, job, True, needs, cost.seconds, cost.disk, one.ranks))
    return sorted(steps, key=lambda step: -step.seconds)


def _flight_steps(planned: Iterable[_Planned], out: Path, threads: int, *, report: bool) -> Iterable[Step]:
    leaders: dict[tuple[str | None, str], str] = {}
    for one in planned:
        same, name = (one.airflow, one.flight), one.variant.name
        before = None if one.airflow is None else _folder(one.airflow)
        air = airflow_cost(one.scene, one.plan.airflow)
        needs, alone = leaders.get(same, before), sum(stage.whole for stage in one.plan.stages)
        leaders.setdefault(same, name)
        seconds, disk = alone - air.seconds, one.plan.estimate["disk"] - air.disk
        yield Step(name, one.job(out / name, threads, report=report), False, needs, seconds, disk)
