"""How long a run may take: a quick answer, or the best one that a time allows.

An effort is a set of coarse settings of a scene. The quickest is computed first, and is an answer of its own, with its
interval. Then the finest whose expected time fits into what is left is tried under a deadline: where the expectation
was wrong, what was found before stays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..answer.result import Request, Result
from ..core.errors import SceneError
from ..core.process import cores
from ..core.quantities import duration, quantity
from ..core.store import cache_root
from ..pipeline.cache import Listener
from ..planning.cost import REPORT, wall_seconds
from ..planning.machine_rates import on_this_machine
from ..planning.make import make_plan
from ..planning.plan import Plan
from ..planning.terms import LOADING
from ..scene import Scene

STAGE = "budget"  # as the listener hears of it
SOLVED = ("steady", "time-resolved")
OVERTIME = 1.15  # of a budget: where a round that took longer than expected is given up
# Of a whole channel, whose air takes several times as long as half of one: times a mesh's edges, up to the coarsest
# that a scene may ask for, and a part of the granules of a quick answer; chosen
WHOLE_CHANNEL, COARSEST, FEWER = 4.0 / 3.0, 4.0, 2
SURELY = 0.7  # of what is left: what a round is expected to take at most; expectations are good to a factor of two


@dataclass(frozen=True)
class Effort:
    """Settings no finer than these: ``granules`` of a fraction, cells' edges ``mesh`` times the usual, the tracker's
    ``tolerance``; without ``in_time`` no time-resolved wake; from ``unloaded_from`` seconds on that solving
    for it would take, without the granules' force on the air, and half of the granules where the whole channel is
    solved. None: as the scene says.
    """

    name: str
    granules: int | None = None
    mesh: float | None = None
    tolerance: float | None = None
    in_time: bool = False
    unloaded_from: float | None = None

    def of(self, scene: Scene, request: Request) -> tuple[Scene, Request]:
        """The scene with these settings where its own are finer, and how to ask for it."""
        own, changes = scene.numerics, dict[str, object]()
        if self.granules is not None:
            changes["feed.count"] = min(self.granules, scene.feed.count)
        if self.tolerance is not None:
            changes["numerics.tolerance"] = max(self.tolerance, own.tolerance)
        plan = make_plan(scene, rung=request.rung, force=request.force, target_error=request.target_error)
        if plan.airflow.stepping in SOLVED:
            if not self.in_time:
                request = replace(request, rung="draft")
                plan = make_plan(scene, rung="draft", force=request.force, target_error=request.target_error)
            if self.mesh is not None:
                whole = 1.0 if plan.airflow.half else WHOLE_CHANNEL  # whose solution takes several times as long
                changes["numerics.mesh_scale"] = max(min(whole * self.mesh, COARSEST), own.mesh_scale)
            if self.unloaded_from is not None:
                request = self._unloaded(scene.replace(changes), request)
                if self.granules is not None and not plan.airflow.half:
                    changes["feed.count"] = min(self.granules // FEWER, scene.feed.count)
        return scene.replace(changes), request

    def _unloaded(self, scene: Scene, request: Request) -> Request:
        """The request without the granules' force on the air where solving for it takes too long: its bound is then in
        the interval.
        """
        plan = make_plan(scene, rung=request.rung, force=request.force, target_error=request.target_error)
        takes = sum(
            one.whole for one in plan.stages if one.key.heading == "air loading" or one.key.name == "loaded-airflow"
        )
        if LOADING in request.force or takes <= (self.unloaded_from or 0.0):
            return request
        return replace(request, force={**request.force, LOADING: False})


QUICK = Effort("quick", 256, 3.0, 1e-3, unloaded_from=11.0)
EFFORTS = (
    QUICK,
    Effort("coarse", 1024, 2.0, 1e-3),
    Effort("draft", 2048, 1.4, 3e-4),
    Effort("fine draft", None, None, None),
    Effort("the scene's own", None, None, None, in_time=True),
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


def expected(plan: Plan) -> float:
    """Seconds that a plan is expected to take on this machine, with nothing in the cache."""
    return wall_seconds(on_this_machine(plan, cache_root())[0], cores())


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
    clock: Callable[[], float] = time.monotonic
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self.clock()

    @property
    def left(self) -> float:
        """Seconds of the budget that are left for rounds: the report is drawn after them."""
        return self.budget - REPORT - (self.clock() - self.began)

    def best(self) -> tuple[Scene, Request]:
        """What to report: the settings of the finest round that ended. Raises SceneError where the budget does not pay
        for the quickest.
        """
        rounds = list(self._rounds())
        quickest = expected(rounds[0][2])
        if quickest > OVERTIME * self.budget:
            least = duration(quickest)
            raise SceneError(f"budget = {duration(self.budget)}: the quickest answer takes about {least}; give more")
        done = self._computed(*rounds[0][:2], rounds[0][3], deadline=None)
        assert done is not None
        tried = 1
        while (found := self._next(rounds, tried)) is not None:
            tried = found + 1
            scene, request, _, effort = rounds[found]
            ended = self._computed(scene, request, effort, deadline=self.began + OVERTIME * self.budget - REPORT)
            if ended is None:
                break
            done = ended
        return done

    def _rounds(self) -> Iterator[tuple[Scene, Request, Plan, Effort]]:
        """The efforts that differ for this scene, the quickest first, with their plans."""
        seen: list[Any] = []
        for effort in EFFORTS:
            scene, request = effort.of(self.scene, self.request)
            plan = make_plan(scene, rung=request.rung, force=request.force, target_error=request.target_error)
            what = scene.tables(), plan.rung
            if what not in seen:
                seen.append(what)
                yield scene, request, plan, effort

    def _next(self, rounds: list[tuple[Scene, Request, Plan, Effort]], tried: int) -> int | None:
        """The finest round from ``tried`` on that is expected to fit; None where none is."""
        able = [place for place in range(tried, len(rounds)) if expected(rounds[place][2]) <= SURELY * self.left]
        return max(able, default=None)

    def _computed(
        self, scene: Scene, request: Request, effort: Effort, deadline: float | None
    ) -> tuple[Scene, Request] | None:
        """A round that ended; None where its time was up."""

        def listener(stage: str, text: str) -> None:
            if deadline is not None and self.clock() > deadline:
                raise OutOfTime
            self.listener(stage, text)

        self.listener(STAGE, f"done {effort.name}: {duration(max(0.0, self.left))} left of {duration(self.budget)}")
        try:
            self.compute(scene, request, listener)
        except OutOfTime:
            self.listener(STAGE, f"done {effort.name} given up: it would not end within {duration(self.budget)}")
            return None
        return scene, request


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
    return coarse, {**how, "rung": asked.rung}
