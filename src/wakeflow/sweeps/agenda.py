"""The agenda of a sweep: which stages its scenes share, what waits for what, what it will cost.

Where neighbours help an airflow waits for the one that it starts from (``neighbours``), and goes on from rest where
that one fails.
Scenes that fly in one airflow wait for it, and it is solved once. Of scenes whose flights are the same (they differ in
mass shares, targets or the feed's rate) one flies and the others wait for it. Both are told from plans alone, before
anything is computed. Where two stages turn out equal beyond that, the lock of the cache makes one wait for the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import wakeflow

from ..core.errors import SceneError
from ..core.lazy import cached_property
from ..core.record import to_json
from ..core.store import content_key, digest_files
from ..pipeline.airflow_kinds import CaseAir
from ..pipeline.cache import Listener, silent
from ..pipeline.pipeline import Pipeline
from ..planning.airflow_cost import ranks_for, typical_cells
from ..planning.cost import airflow_cost
from ..planning.make import make_plan
from ..planning.plan import Plan
from ..results.result import Request
from ..runs import versions
from ..scene import Scene
from .neighbours import starts
from .variant import TOLD_EVERY, Variant
from .work import Job, finished

__all__ = ["Agenda", "Step", "make_agenda"]

AIRFLOWS = "airflows"  # folder of the airflows' own results
WEIGHED = ("mass_share", "target")  # of a fraction: they weigh landings, and move none
FED = ("rate", "depth")  # of the feed: likewise
WORTH_A_CREW = 60.0  # s of flights, expected, from which several processes fly one scene


@dataclass(frozen=True)
class Step:
    """One job of the agenda: for a scene, or for the airflow of several, on so many MPI ``ranks``; ``needs`` the step
    of that name before it. One that ``helps`` flies part of the granules of another step's scene.
    """

    name: str
    job: Job
    airflow: bool
    needs: str | None
    seconds: float  # expected
    disk: float  # bytes, expected
    ranks: int = 1
    helps: bool = False


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
    stamp: str = ""

    @cached_property
    def airflow(self) -> str | None:
        """What tells its airflow from others; None where it costs nothing."""
        flown = Pipeline(self.plan.airflow.flown(self.scene), self.plan)
        if flown.kind.at_once:
            return None
        spec = repr(flown.kind.flow_spec) if isinstance(flown.kind, CaseAir) else repr(flown.scene.air)
        return content_key(repr(self.plan.airflow), spec)

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
        tables = self.scene.model_dump(mode="json", by_alias=True)
        for fraction in tables["fraction"].values():
            for key in WEIGHED:
                del fraction[key]
        for key in FED:
            del tables["feed"][key]
        del tables["picture"]
        how = {name: repr(row.tracked) for name, row in self.plan.fractions.items()}
        return content_key(tables, list(self.scene.bin), how)


def make_agenda(
    variants: Sequence[Variant],
    out: Path,
    request: Request,
    *,
    threads: int = 1,
    report: bool = False,
    workers: int = 1,
    neighbours: bool = False,
    listener: Listener = silent,
) -> Agenda:
    """What is still to be done for ``variants`` in the folder ``out``; scenes that are finished there need nothing.

    Where there are fewer scenes than ``workers`` several of these fly the granules of one. With ``neighbours`` an
    airflow starts from the nearest one that is there by then.
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
    planned = _stamped(_started(planned, out) if neighbours else planned)
    stamps = {one.variant.name: one.stamp for one in planned}
    open_ones = [one for one in planned if finished(out / one.variant.name, one.stamp) is None]
    jobs = _Jobs(out, threads, report, workers // max(1, len(open_ones)))
    airflows = list(_airflow_steps(open_ones, jobs))
    return Agenda((*airflows, *_flight_steps(open_ones, jobs)), stamps, problems)


def _stamped(planned: Iterable[_Planned]) -> list[_Planned]:
    """The scenes, each with the stamp of all that it is made for."""
    code, found = digest_files([Path(wakeflow.__file__).parent]), versions()

    def stamp(one: _Planned) -> str:
        order = [list(keyed) for keyed in (one.scene.body, one.scene.fraction, one.scene.bin)]
        return content_key(one.scene.tables(), order, to_json(one.request), code, found)

    return [replace(one, stamp=stamp(one)) for one in planned]


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


@dataclass(frozen=True)
class _Jobs:
    out: Path
    threads: int
    report: bool
    idle: int  # workers for each scene

    def of(self, one: _Planned, folder: str, *, report: bool, crew: int = 1) -> Job:
        tables, threads = one.scene.tables(), self.threads
        return Job(tables, one.request, self.out / folder, one.stamp, one.plan, threads, report, crew)

    def crew(self, seconds: float) -> int:
        """How many workers fly a scene that takes so long."""
        return max(1, self.idle) if seconds >= WORTH_A_CREW else 1


def _airflow_steps(planned: Iterable[_Planned], jobs: _Jobs) -> Iterable[Step]:
    """One step for each airflow, the longest first, so that none is left alone at the end."""
    first = _by_airflow(planned)
    folders = {str(jobs.out / _folder(key)): _folder(key) for key in first}
    steps = []
    for key, one in first.items():
        cost, folder = airflow_cost(one.scene, one.plan.airflow), _folder(key)
        job, needs = jobs.of(one, folder, report=False), folders.get(one.request.near or "")
        steps.append(Step(folder, job, True, needs, cost.seconds, cost.disk, one.ranks))
    return sorted(steps, key=lambda step: -step.seconds)


def _flight_steps(planned: Iterable[_Planned], jobs: _Jobs) -> Iterable[Step]:
    leaders: dict[tuple[str | None, str], str] = {}
    for one in planned:
        same, name = (one.airflow, one.flight), one.variant.name
        before = None if one.airflow is None else _folder(one.airflow)
        air = airflow_cost(one.scene, one.plan.airflow)
        needs, alone = leaders.get(same, before), sum(stage.whole for stage in one.plan.stages)
        leaders.setdefault(same, name)
        seconds, disk = alone - air.seconds, one.plan.estimate["disk"] - air.disk
        crew = jobs.crew(seconds)
        job = jobs.of(one, name, report=jobs.report, crew=crew)
        yield Step(name, job, False, needs, seconds / crew, disk)
        for number in range(2, crew + 1):
            yield Step(f"{name} ({number} of {crew})", job, False, needs, seconds / crew, 0.0, helps=True)
