"""How long a run may take: a quick answer, or the best one that a time allows.

An effort is a set of coarse settings of a scene. The finest is computed that is expected to end early enough for the
quickest to be computed in its place: where the expectation was wrong, it is given up at that time. Where the quickest
alone fits, it comes first, and what it leaves is spent in the same way.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..answer.result import Request, Result
from ..core.errors import SceneError
from ..core.process import cores
from ..core.quantities import duration, quantity
from ..core.record import JsonTable
from ..core.store import FinishedStages, NotFinished, cache_root
from ..flight.stages.machine_rates import on_this_machine
from ..flight.stages.pipeline import Pipeline
from ..planning.cost import REPORT, STARTED, begins, wall_seconds
from ..planning.plan import Plan
from ..planning.stage_cache import Listener
from ..planning.stages import StageCost, StageKey
from ..planning.terms import LOADING
from ..scene import Scene
from ..scene.changes import flat
from .planned import make_plan

STAGE = "budget"  # as the listener hears of it
CLOCK: ContextVar[Callable[[], float]] = ContextVar("clock", default=time.monotonic)  # what a budget is measured by, s
SOLVED = ("steady", "time-resolved")
OVERTIME = 1.15  # of a budget: where a round is given up that has another's answer behind it
LATEST = 1.25  # of a budget: when the answer is there in any case
# Of a whole channel, whose air takes several times as long as half of one: times a mesh's edges, up to the coarsest
# that a scene may ask for, and a part of the granules of a quick answer; chosen
WHOLE_CHANNEL, COARSEST, FEWER = 4.0 / 3.0, 4.0, 2
FEW_IN_FLIGHT, THINNEST = 500.0, 5.0  # granules in a thin slab; its depth in the coarsest granules, at least; chosen
ROUNDING = 1e-3
SURELY = 0.95  # of what is left: what a round is expected to take at most, as the rounds before it taught


@dataclass(frozen=True)
class Effort:
    """Settings no finer than these: ``granules`` of a fraction, cells' edges ``mesh`` times the usual, the tracker's
    ``tolerance``; without ``in_time`` no time-resolved wake. Where the granules' force on the air would take longer
    than ``force_within`` seconds it is solved for once, and not at all where that takes longer too; then a dense feed
    is flown in a thin slab, the beads of a funnel are not computed, and a whole channel gets half of the granules.
    None: as the scene says.
    """

    name: str
    granules: int | None = None
    mesh: float | None = None
    tolerance: float | None = None
    in_time: bool = True
    force_within: float | None = None

    def of(self, scene: Scene, request: Request) -> tuple[Scene, Request]:
        """The scene with these settings where its own are finer, and how to ask for it."""
        own, changes, request = scene.numerics, dict[str, object](), replace(request, effort=self.name)
        if self.granules is not None:
            changes["feed.count"] = min(self.granules, scene.feed.count)
        if self.tolerance is not None:
            changes["numerics.tolerance"] = max(self.tolerance, own.tolerance)
        if self.force_within is not None and scene.funnel is not None:
            changes["funnel.computed"] = False
        plan = _planned(scene, request)
        if plan.airflow.stepping in SOLVED:
            if not self.in_time:
                request = replace(request, rung="draft")
                plan = _planned(scene, request)
            if self.mesh is not None:
                whole = 1.0 if plan.airflow.half else WHOLE_CHANNEL  # whose solution takes several times as long
                changes["numerics.mesh_scale"] = max(min(whole * self.mesh, COARSEST), own.mesh_scale)
            if self.force_within is not None and self.granules is not None and not plan.airflow.half:
                changes["feed.count"] = min(self.granules // FEWER, scene.feed.count)
        scene = scene.replace(changes)
        return (scene, request) if self.force_within is None else _roughly(scene, request, self.force_within)


def _planned(scene: Scene, request: Request) -> Plan:
    return make_plan(scene, rung=request.rung, force=request.force, target_error=request.target_error)


def _roughly(scene: Scene, request: Request, seconds: float) -> tuple[Scene, Request]:
    """With the granules' force on the air solved for once where all passes take longer than ``seconds``; without it
    where one does too: its bound is then in the interval.
    """
    if LOADING not in request.force and _loading_seconds(scene, request) > seconds:
        once = scene.replace({"numerics.loading_passes": 1})
        if _loading_seconds(once, request) <= seconds:
            scene = once
        else:
            request = replace(request, force={**request.force, LOADING: False})
    return _thin(scene, request), request


def _loading_seconds(scene: Scene, request: Request) -> float:
    """What the granules' force on the air is expected to take."""
    stages = _planned(scene, request).stages
    return sum(one.whole for one in stages if one.key.heading == "air loading" or one.key.name == "loaded-airflow")


def _thin(scene: Scene, request: Request) -> Scene:
    """The scene with a slab no deeper than it takes for FEW_IN_FLIGHT granules: what that changes is measured."""
    crowd = _planned(scene, request).crowd
    many = 0.0 if crowd is None else sum(crowd.in_flight.values()) / FEW_IN_FLIGHT
    if crowd is None or many <= 1.0 + ROUNDING:
        return scene
    coarsest = max(float(one.diameters(np.array([0.5]))[0]) for one in scene.fraction.values())
    return scene.replace({"collisions.depth": min(crowd.depth, max(THINNEST * coarsest, crowd.depth / many))})


QUICK = Effort("quick", 256, 3.0, 1e-2, in_time=False, force_within=8.0)
EFFORTS = (
    QUICK,
    Effort("coarse", 1024, 2.0, 1e-2),
    Effort("medium", 2048, 1.4, 1e-2),
    Effort("the scene's own", None, None, None),
)


def seconds_of(given: float | str) -> float:
    """A budget in s, from a number or a text such as "3 min". Raises SceneError for anything else."""
    try:
        found = quantity(given, "s", "3 min") if isinstance(given, str) else float(given)
    except (TypeError, ValueError) as problem:
        raise SceneError(f"budget = {given!r}: {problem}") from None
    if not found > 0.0:
        raise SceneError(f"budget = {given!r}: must be above 0")
    return found


def expected(scene: Scene, plan: Plan) -> float:
    """Seconds that a plan of ``scene`` is expected to take on this machine, with the airflows that are in the cache."""
    return wall_seconds(_left(scene, plan), cores())


def beginnings(scene: Scene, plan: Plan) -> dict[str, float]:
    """When the stages that wait for one another are expected to begin, from the answer's airflow on: s after the start
    of the same run.
    """
    left = _left(scene, plan)
    dated = zip(left, begins(left, cores()), strict=True)
    return {one.name: begun for one, begun in dated if one.when in ("answer", "after")}


def _left(scene: Scene, plan: Plan) -> list[StageCost]:
    """What is left to do of a plan."""
    there = solved_before(scene, plan)
    return [one for one in on_this_machine(plan, cache_root())[0] if one.name not in there]


def solved_before(scene: Scene, plan: Plan) -> frozenset[str]:
    """The stages of a plan's airflows that are in the cache already, by their names."""
    if plan.airflow.stepping not in SOLVED:
        return frozenset()
    known = Pipeline(plan.airflow.flown(scene), plan, store=FinishedStages(cache_root()))
    try:
        for one in reversed(known.grids):
            _ = one.solution
    except NotFinished:  # perhaps after some of the passes of the granules' force, whose names are the same
        return frozenset(name for name in known.seconds if StageKey.of(name).heading != "air loading")
    return frozenset(known.seconds)


class OutOfTime(Exception):
    """A round has used up the budget."""


@dataclass
class Within:
    """Rounds within a ``budget`` (s): each by ``compute(scene, request, listener)``, which raises what its listener
    raises and keeps what it has computed.
    """

    budget: float
    scene: Scene
    request: Request
    compute: Callable[[Scene, Request, Listener], Result]
    listener: Listener
    clock: Callable[[], float] = field(default_factory=CLOCK.get)
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self.clock()

    @property
    def left(self) -> float:
        """Seconds of the budget that are left for rounds and the report."""
        return self.budget - (self.clock() - self.began)

    def best(self) -> tuple[Scene, Request]:
        """What to report: the settings of the finest round that ended. Raises SceneError where the budget does not pay
        for the quickest.
        """
        rounds = list(self._rounds())
        times = [expected(scene, plan) for scene, _, plan, _ in rounds]
        while times[1:] and times[1] <= times[0]:  # its airflow is in the cache
            times, rounds = times[1:], rounds[1:]
        quickest = times[0]
        if quickest > OVERTIME * self.budget:
            least = duration(quickest)
            raise SceneError(f"budget = {duration(self.budget)}: the quickest answer takes about {least}; give more")
        straight = self._finest(rounds, 1, LATEST * self.budget - quickest)
        if straight and self._ends(*rounds[straight], latest=LATEST, instead=quickest):
            done = straight
        else:
            done = 0
            self._ends(*rounds[0])
        while finer := self._finest(rounds, done + 1, self.left + STARTED):
            if not self._ends(*rounds[finer], latest=OVERTIME - REPORT / self.budget):
                break
            done = finer
        return rounds[done][:2]

    def _rounds(self) -> Iterator[tuple[Scene, Request, Plan, Effort]]:
        """The efforts that differ for this scene, the quickest first, with their plans."""
        seen: list[Any] = []
        for effort in EFFORTS:
            scene, request = effort.of(self.scene, self.request)
            plan = _planned(scene, request)
            what = scene.tables(), plan.rung
            if what not in seen:
                seen.append(what)
                yield scene, request, plan, effort

    def _finest(self, rounds: list[tuple[Scene, Request, Plan, Effort]], tried: int, seconds: float) -> int:
        """The finest round from ``tried`` on that is expected to take no longer than that; 0 where none is."""
        fits = [i for i in range(tried, len(rounds)) if expected(rounds[i][0], rounds[i][2]) <= SURELY * seconds]
        return max(fits, default=0)

    def _ends(
        self,
        scene: Scene,
        request: Request,
        plan: Plan,
        effort: Effort,
        *,
        latest: float = math.inf,
        instead: float = 0.0,
    ) -> bool:
        """Compute a round, and whether it ended; it is given up so that the answer is there at the ``latest`` (times
        the budget): when what is left of it takes too long, and another ``instead``, which is expected to take so many
        seconds, can only just be computed. How much slower than expected this machine is, the stages tell when they
        begin.
        """
        begun, slower, left = self.clock(), 1.0, math.inf
        due, whole = (beginnings(scene, plan), expected(scene, plan)) if instead else ({}, 0.0)

        def listener(stage: str, text: str) -> None:
            nonlocal slower, left
            if (at := due.pop(stage, None)) is not None:
                slower, left = max(slower, (self.clock() - begun) / at), whole - at
            if self.clock() > self.began + latest * self.budget - slower * min(instead, left):
                raise OutOfTime
            self.listener(stage, text)

        self.listener(STAGE, f"done {effort.name}: {duration(max(0.0, self.left))} left of {duration(self.budget)}")
        try:
            self.compute(scene, request, listener)
        except OutOfTime:
            self.listener(STAGE, f"done {effort.name} given up: it would not end within {duration(self.budget)}")
            return False
        return True


def affordable(
    scene: Scene,
    request: Request,
    compute: Callable[..., Result],
    listener: Listener,
    *,
    quick: bool,
    budget: float | str | None,
) -> tuple[Scene, Request]:
    """The settings of a ``quick`` answer, or the finest that a ``budget`` pays for, which are then computed: by
    ``compute(scene, request=..., listener=...)``. Raises SceneError where both are asked for, and as :class:`Within`.
    """
    if quick and budget is not None:
        raise SceneError("quick and budget: give one of them")
    if budget is None:
        return QUICK.of(scene, request)

    def computed(asked: Scene, how: Request, heard: Listener) -> Result:
        return compute(asked, request=how, listener=heard)

    return Within(seconds_of(budget), scene, request, computed, listener).best()


def quick_settings(scene: Scene, how: Mapping[str, Any]) -> tuple[Scene, dict[str, Any]]:
    """The scene of a quick answer and how to ask for it: ``rung``, ``force`` and ``target_error`` as of a plan."""
    request = Request.asked(None, how.get("rung"), how.get("force"), how.get("target_error"), None)
    coarse, asked = QUICK.of(scene, request)
    return coarse, {**how, "rung": asked.rung, "force": asked.force}


def quick_keys(scene: Scene) -> JsonTable:
    """What a quick answer changes of a scene, by dotted key."""
    coarse, asked = QUICK.of(scene, Request.asked())
    own, switches = flat(scene.tables()), {f"force.{term}": on for term, on in asked.force.items()}
    found = {key: value for key, value in flat(coarse.tables()).items() if own.get(key) != value}
    return {**found, **({} if asked.rung is None else {"numerics.rung": asked.rung}), **switches}
