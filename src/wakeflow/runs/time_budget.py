"""What a run's time is spent on, and the one choice of it: before a run within seconds, after one to a target error.

A knob is one number of a scene. All of them together are :class:`RefinedSettings`; a number is None where the scene has
no such knob: no mesh without a solver, no averaging where nothing sheds, no slab where granules do not meet.

Settings are chosen step by step (:func:`bought`): always the step whose second takes most error away. To a target error
a step is one knob turned finer; what a later step has made needless is taken back in the end. Within seconds, before
anything was computed, the steps lead to efforts, sets of coarse settings: to the finest that is expected to end early
enough for the quickest to be computed in its place: where the expectation was wrong, it is given up at that time. Where
the quickest alone fits, it comes first, and what it leaves is spent in the same way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from math import ceil, inf, log, log2, nan, sqrt
from operator import attrgetter
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from ..answer.budget.budget import numerical
from ..answer.budget.source import landed, limited_again, source_of
from ..answer.budget.steps import FINER, FINER_STEPS
from ..answer.provenance import RefinedSettings
from ..answer.result import Request, Result
from ..answer.shares import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow
from ..core.errors import SceneError
from ..core.process import cores
from ..core.quantities import duration, quantity
from ..core.record import JsonTable
from ..core.registry import Registry
from ..core.store import FinishedStages, NotFinished, cache_root
from ..flight.stages.machine_rates import on_this_machine
from ..flight.stages.pipeline import Pipeline
from ..planning.cost import REPORT, STARTED, begins, wall_seconds
from ..planning.plan import COMPARED, REPLICATES, Plan, replicate_size
from ..planning.stage_cache import Listener, StageTime
from ..planning.stages import Scaling, StageCost, StageKey
from ..planning.terms import LOADING
from ..planning.unknowns import SIGMAS
from ..scene import Scene
from ..scene.changes import flat
from .planned import make_plan

State = TypeVar("State")

# -- The knobs ---------------------------------------------------------------------------------------------------------
COARSER_MESH = 2.0  # of the cheapest pass, times the scene's own cells: an eighth of the time
COARSEST = 4.0  # largest numerics.mesh_scale of a scene
LOOSER = 0.1  # of the target: a landing error that moves few granules over a bin's end
MIN_PASS_GRANULES = 256  # granules of the cheapest pass: 16 a replicate
# Granules of the cheapest pass times the target: what any answer needs, since the limit on a term left out of which
# nothing was found among them is SIGMAS^2 over their number
IN_FIRST = SIGMAS**2


@dataclass(frozen=True)
class Setting:
    """One knob: the ``field`` of :class:`RefinedSettings` that holds it, the ``key`` of a scene, the factor ``step`` of
    its next finer value, and the ``finest`` that a scene may ask for; ``name`` in words.
    """

    name: str
    field: str
    key: str
    step: float
    finest: float

    def at(self, settings: RefinedSettings, value: float) -> RefinedSettings:
        """The settings with the knob at a value."""
        change: dict[str, Any] = {self.field: round(value) if self.step > 1.0 else value}
        return replace(settings, **change)

    def next(self, settings: RefinedSettings) -> RefinedSettings:
        """One step finer; the same at the finest."""
        then = values(settings)[self.name] * self.step
        return settings if (then - self.finest) * (self.step - 1.0) > 0.0 else self.at(settings, then)

    def finer(self, *two: float) -> float:
        """The finer of two values."""
        return max(two) if self.step > 1.0 else min(two)

    def coarser(self, *two: float) -> float:
        """The coarser of two values."""
        return min(two) if self.step > 1.0 else max(two)


knobs: Registry[Setting] = Registry("knob")
for _knob in (
    Setting("granules", "granules", "feed.count", 2.0, 2**23),
    Setting("tolerance", "tolerance", "numerics.tolerance", 10**-0.5, 1e-9),
    Setting("mesh", "mesh_scale", "numerics.mesh_scale", sqrt(0.5), 0.2),
    Setting("averaging", "averaging", "numerics.averaging", sqrt(0.5), 0.002),
    Setting("slab", "slab", "collisions.count", 2.0, 2**17),
):
    knobs.add(_knob.name, _knob)


def values(settings: RefinedSettings) -> dict[str, float]:
    """Where the knobs are that the scene has, by their names."""
    every = {name: getattr(settings, knobs[name].field) for name in knobs}
    return {name: value for name, value in every.items() if value is not None}


def settings_of(scene: Scene, plan: Plan) -> RefinedSettings:
    """What the scene itself asks for, under its ``plan``."""
    solved = plan.airflow.stepping and not plan.airflow.span
    sheds = solved and plan.airflow.stepping == "time-resolved"
    return RefinedSettings(
        granules=REPLICATES * replicate_size(scene.feed.count),
        tolerance=scene.numerics.tolerance,
        mesh_scale=scene.numerics.mesh_scale if solved else None,
        averaging=plan.airflow.accuracy if sheds else None,
        slab=None if plan.collisions is None else plan.collisions.count,
    )


def cheapest(settings: RefinedSettings, target: float) -> RefinedSettings:
    """Settings of the first pass, which measures how the errors stand: never finer than the scene's ``settings``."""
    count, numbers = max(MIN_PASS_GRANULES, 2 ** ceil(log2(IN_FIRST / target))), values(settings)
    pass_at = {"granules": count, "tolerance": LOOSER * target, "slab": count}
    if "mesh" in numbers:
        pass_at["mesh"] = min(COARSER_MESH * numbers["mesh"], COARSEST)
    for name in pass_at.keys() & numbers.keys():
        settings = knobs[name].at(settings, knobs[name].coarser(numbers[name], pass_at[name]))
    return settings


def finer(first: RefinedSettings, second: RefinedSettings) -> RefinedSettings:
    """Every knob at the finer of two settings of one scene."""
    for name, value in values(second).items():
        first = knobs[name].at(first, knobs[name].finer(values(first)[name], value))
    return first


def finest_of(settings: RefinedSettings) -> RefinedSettings:
    """Every knob at the end of its steps."""
    for name in values(settings):
        while (further := knobs[name].next(settings)) != settings:
            settings = further
    return settings


def applied(scene: Scene, settings: RefinedSettings) -> Scene:
    """The scene with the settings in it."""
    return scene.replace({knobs[name].key: value for name, value in values(settings).items()})


# -- The efforts: coarse settings for little time ----------------------------------------------------------------------
SOLVED = ("steady", "time-resolved")
# Of a whole channel, whose air takes several times as long as half of one: times a mesh's edges, up to the coarsest
# that a scene may ask for, and a part of the granules of a quick answer; chosen
WHOLE_CHANNEL, FEWER = 4.0 / 3.0, 2
FEW_IN_FLIGHT, THINNEST = 500.0, 5.0  # granules in a thin slab; its depth in the coarsest granules, at least; chosen
ROUNDING = 1e-3


@dataclass(frozen=True)
class Effort:
    """Settings no finer than these: ``at``, where knobs are by their names (of the mesh for half of a channel); without
    ``in_time`` no time-resolved wake. Where the granules' force on the air would take longer than ``force_within``
    seconds it is solved for once, and not at all where that takes longer too; then a dense feed is flown in a thin
    slab, the beads of a funnel are not computed, and a whole channel gets half of the granules.
    """

    name: str
    at: Mapping[str, float] = field(default_factory=dict)
    in_time: bool = True
    force_within: float = inf

    def of(self, scene: Scene, request: Request) -> tuple[Scene, Request]:
        """The scene with these settings where its own are finer, and how to ask for it."""
        request, rough, limits = replace(request, effort=self.name), self.force_within < inf, dict(self.at)
        changes: dict[str, object] = {"funnel.computed": False} if rough and scene.funnel is not None else {}
        airflow = _planned(scene, request).airflow
        if airflow.stepping in SOLVED and not self.in_time:
            request = replace(request, rung="draft")
            airflow = _planned(scene, request).airflow
        if airflow.stepping not in SOLVED:
            limits.pop("mesh", None)
        elif limits and not airflow.half:
            limits["mesh"] = min(WHOLE_CHANNEL * limits["mesh"], COARSEST)
            limits["granules"] //= FEWER if rough else 1
        for knob, value in ((knobs[name], value) for name, value in limits.items()):
            changes[knob.key] = knob.coarser(value, attrgetter(knob.key)(scene))
        scene = scene.replace(changes)
        return _roughly(scene, request, self.force_within) if rough else (scene, request)


def _planned(scene: Scene, request: Request) -> Plan:
    return make_plan(scene, rung=request.rung, force=request.force, target_error=request.target_error)


def _roughly(scene: Scene, request: Request, seconds: float) -> tuple[Scene, Request]:
    """Have the granules' force on the air solved for once where all passes take longer than ``seconds``; left out where
    one does too: its bound is then in the interval.
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
    return sum(cost.whole for cost in stages if cost.key.heading == "air loading" or cost.key.name == "loaded-airflow")


def _thin(scene: Scene, request: Request) -> Scene:
    """The scene with a slab no deeper than it takes for FEW_IN_FLIGHT granules: what that changes is measured."""
    collisions = _planned(scene, request).collisions
    many = 0.0 if collisions is None else sum(collisions.in_flight.values()) / FEW_IN_FLIGHT
    if collisions is None or many <= 1.0 + ROUNDING:
        return scene
    coarsest = max(float(fraction.diameters(np.array([0.5]))[0]) for fraction in scene.fraction.values())
    return scene.replace({"collisions.depth": min(collisions.depth, max(THINNEST * coarsest, collisions.depth / many))})


QUICK = Effort("quick", {"granules": 256, "mesh": 3.0, "tolerance": 1e-2}, in_time=False, force_within=8.0)
EFFORTS = (
    QUICK,
    Effort("coarse", {"granules": 1024, "mesh": 2.0, "tolerance": 1e-2}),
    Effort("medium", {"granules": 2048, "mesh": 1.4, "tolerance": 1e-2}),
    Effort("the scene's own"),
)


def quick_settings(scene: Scene, how: Mapping[str, Any]) -> tuple[Scene, dict[str, Any]]:
    """The scene of a quick answer and how to ask for it: ``rung``, ``force`` and ``target_error`` as of a plan."""
    request = Request.of(None, how.get("rung"), how.get("force"), how.get("target_error"), None)
    coarse, quick = QUICK.of(scene, request)
    return coarse, {**how, "rung": quick.rung, "force": quick.force}


def quick_keys(scene: Scene) -> JsonTable:
    """What a quick answer changes of a scene, by dotted key."""
    coarse, quick = QUICK.of(scene, Request.of())
    before, switches = flat(scene.tables()), {f"force.{term}": on for term, on in quick.force.items()}
    changed = {key: value for key, value in flat(coarse.tables()).items() if before.get(key) != value}
    return {**changed, **({} if quick.rung is None else {"numerics.rung": quick.rung}), **switches}


# -- What a round costs: as its plan expects, or as the stages of another took, by how each goes with the knobs --------
OVERHEAD = 0.4  # s of a stage in which granules fly, however few they are
MIN_POWER, MAX_POWER = 0.02, 0.34  # of a flight's time with its tolerance: from one step a cell to order three


@dataclass(frozen=True)
class RoundPrices:
    """What the ``stages`` of a round take with its ``settings``, which begins after ``started`` (s); ``power``: of a
    flight's time with its tolerance.
    """

    stages: Sequence[StageCost]
    settings: RefinedSettings
    started: float = STARTED
    power: float = MIN_POWER

    @classmethod
    def planned(cls, scene: Scene, plan: Plan) -> RoundPrices:
        """What a plan of ``scene`` expects on this machine, with the airflows that are in the cache."""
        there = solved_before(scene, plan)
        stages = [stage for stage in on_this_machine(plan, cache_root())[0] if stage.name not in there]
        return cls(stages, settings_of(scene, plan))

    @classmethod
    def measured(cls, spent: Mapping[str, StageTime], settings: RefinedSettings) -> RoundPrices:
        """What the stages of a round took, one after another; all of them are in the cache."""
        stages = [StageCost(name, stage.seconds, "after") for name, stage in spent.items()]
        return cls(stages, settings, 0.0, _power(spent))

    @property
    def seconds(self) -> float:
        """Run time (s) of the round."""
        return wall_seconds(self.stages, cores(), self.started)

    @property
    def beginnings(self) -> dict[str, float]:
        """When the stages that wait for one another begin, from the answer's airflow on: s after the round's start."""
        dated = zip(self.stages, begins(self.stages, cores(), self.started), strict=True)
        return {stage.name: begun for stage, begun in dated if stage.when in ("answer", "after")}

    def at(self, then: RefinedSettings) -> RoundPrices:
        """The prices of a round with the settings ``then``, after this one: of what comes out otherwise."""
        if then == self.settings:
            return replace(self, stages=())
        stages = [replace(stage, seconds=self._seconds(stage, then)) for stage in self.stages]
        return replace(self, stages=stages, settings=then)

    def _seconds(self, stage: StageCost, then: RefinedSettings) -> float:
        """Time (s) of a stage: steps go with the cells' edges, averages with the square of what they are known to."""
        now = self.settings
        finer = (now.mesh_scale or 1.0) / (then.mesh_scale or 1.0)  # and cells on a granule's way
        longer = (now.averaging or 1.0) / (then.averaging or 1.0)
        same_air = (then.mesh_scale, then.averaging) == (now.mesh_scale, now.averaging)
        same_flights = same_air and (then.granules, then.tolerance) == (now.granules, now.tolerance)
        match stage.key.stage.scaling:
            case Scaling.CELLS if not same_air:
                return stage.seconds * finer**2
            case Scaling.AIR if not same_air:
                return stage.seconds * (finer**3 * longer**2)
            case Scaling.SLAB:
                return stage.seconds * (then.slab or 1) / (now.slab or 1)
            case Scaling.FLIGHTS if not same_flights:
                more: float = then.granules / now.granules * (now.tolerance / then.tolerance) ** self.power * finer
                return OVERHEAD + max(0.0, stage.seconds - OVERHEAD) * more
        return 0.0


def solved_before(scene: Scene, plan: Plan) -> frozenset[str]:
    """The stages of a plan's airflows that are in the cache already, by their names."""
    if plan.airflow.stepping not in SOLVED:
        return frozenset()
    known = Pipeline(plan.airflow.flown(scene), plan, store=FinishedStages(cache_root()))
    try:
        for grid in reversed(known.grids):
            _ = grid.air.in_case.solution
    except NotFinished:  # perhaps after some of the passes of the granules' force, whose names are the same
        return frozenset(name for name in known.seconds if StageKey.of(name).heading != "air loading")
    return frozenset(known.seconds)


def _power(spent: Mapping[str, StageTime]) -> float:
    """Power of the tolerance that a flight's time goes with, as the companion with finer steps shows it."""
    flown, finer = spent.get("tracks"), spent.get(FINER_STEPS)
    if flown is None or finer is None or min(flown.seconds, finer.seconds) <= 2.0 * OVERHEAD:
        return MIN_POWER
    slower = finer.seconds / flown.seconds * REPLICATES / COMPARED
    return min(max(log(max(slower, 1.0)) / log(1.0 / FINER), MIN_POWER), MAX_POWER)


# -- The one choice ----------------------------------------------------------------------------------------------------
MIN_GAIN = 1e-12  # error that a step takes away in a second: less is nothing


class Offer(NamedTuple, Generic[State]):
    """What a step leads ``to``, the ``seconds`` that it costs, and its ``gain``: what it takes away of the error."""

    to: State
    seconds: float
    gain: float


def bought(start: State, steps: Callable[[State], Iterable[Offer[State]]]) -> list[State]:
    """The way from the ``start`` by the ``steps`` that are possible from each place on it: always the one whose second
    takes most error away, as long as any does.
    """
    way = [start]
    while True:
        best = max(steps(way[-1]), key=lambda step: step.gain / step.seconds, default=Offer(start, 1.0, 0.0))
        if best.gain / best.seconds <= MIN_GAIN:
            return way
        way.append(best.to)


# -- To a target error, by what a round has found ----------------------------------------------------------------------
MARGIN = 0.9  # of the target that is aimed at: what is expected is itself an estimate
QUICKEST = 1e-3  # s: a step that costs nothing still costs that


@dataclass(frozen=True)
class Choice:
    """The ``settings`` of the next round, the largest ``half`` width by computing that is expected of the rows that can
    meet the target, and the run time expected (s).
    """

    settings: RefinedSettings
    half: float = nan
    seconds: float = nan

    @classmethod
    def of(cls, rows: Sequence[BudgetRow], prices: RoundPrices, then: RefinedSettings) -> Choice:
        """Choice of the settings ``then``; the rest as of :func:`choose`."""
        half = max((expected_half(row, prices.settings, then) for row in rows), default=0.0)
        return cls(then, half, prices.at(then).seconds)


def expected_half(row: BudgetRow, now: RefinedSettings, then: RefinedSettings) -> float:
    """Half of the 95 % interval of a ``row`` by computing alone, expected with the settings ``then``, from parts that
    were found with those of ``now``.
    """
    return numerical(replace(part, error=expected_part(part, now, then)) for part in row.parts)


def expected_part(part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float | None:
    """The error of one part, likewise; None where it is unknown."""
    if part.error is None:
        return None
    if part.kind in (LEFT_OUT, NOT_COMPUTED):
        return limited_again(part.error, landed(now), landed(then))
    return source_of(part).expected(part, now, then)


def reachable(rows: Sequence[BudgetRow], now: RefinedSettings, target: float) -> list[BudgetRow]:
    """The rows that settings can bring below the target, found with those of ``now``."""
    finest = finest_of(now)
    return [row for row in rows if expected_half(row, now, finest) <= target]


def choose(rows: Sequence[BudgetRow], prices: RoundPrices, target: float) -> Choice:
    """The cheapest settings, from those on with which the ``rows`` were found, with which every one of them is expected
    to meet the ``target``; ``prices`` of the round that found them.
    """
    now = prices.settings

    def turned(at: tuple[RefinedSettings, str]) -> Iterator[Offer[tuple[RefinedSettings, str]]]:
        price, before = prices.at(at[0]).seconds, _excess(rows, now, at[0], target)
        for name in values(at[0]):
            then = knobs[name].next(at[0])
            seconds = max(prices.at(then).seconds - price, QUICKEST)
            yield Offer((then, name), seconds, before - _excess(rows, now, then, target))

    way = bought((now, ""), turned)
    chosen = way[-1][0]
    met = _excess(rows, now, chosen, target) <= 0.0
    for _, name in reversed(way[1:] if met else ()):  # steps that are needless beside the others
        back = knobs[name].at(chosen, values(chosen)[name] / knobs[name].step)
        if _excess(rows, now, back, target) <= 0.0:
            chosen = back
    return Choice.of(rows, prices, chosen)


def choose_surely(rows: Sequence[BudgetRow], prices: RoundPrices, target: float) -> Choice:
    """The cheapest settings, from those of now on, that are expected to stay within MARGIN of the ``target``; where
    what no setting lowers comes too near to it for that, to meet the target itself, and not whatever could be bought.
    """
    sure = choose(rows, prices, MARGIN * target)
    return sure if sure.half <= MARGIN * target else choose(rows, prices, target)


def _excess(rows: Sequence[BudgetRow], now: RefinedSettings, then: RefinedSettings, target: float) -> float:
    """Sum over the rows of how far the squares of their errors lie beyond the target's."""
    return sum(max(0.0, expected_half(row, now, then) ** 2 - target**2) for row in rows)


# -- Within seconds, by the plans of rounds ----------------------------------------------------------------------------
STAGE = "budget"  # as the listener hears of it
CLOCK: ContextVar[Callable[[], float]] = ContextVar("clock", default=time.monotonic)  # what a budget is measured by, s
OVERTIME = 1.15  # of a budget: where a round is given up that has another's answer behind it
LATEST = 1.25  # of a budget: when the answer is there in any case
SURELY = 0.95  # of what is left: what a round is expected to take at most, as the rounds before it taught


def seconds_of(given: float | str) -> float:
    """A budget in s, from a number or a text such as "3 min". Raises SceneError for anything else."""
    try:
        seconds = quantity(given, "s", "3 min") if isinstance(given, str) else float(given)
    except (TypeError, ValueError) as problem:
        raise SceneError(f"budget = {given!r}: {problem}") from None
    if not seconds > 0.0:
        raise SceneError(f"budget = {given!r}: must be above 0")
    return seconds


Round = tuple[Scene, Request, Plan]


def _finest(rounds: Sequence[Round], done: int, seconds: float) -> int:
    """The place of the round that is chosen next, with no more ``seconds`` than that; ``done`` where none is. What a
    finer effort takes away of the error is not known before it is computed: each counts alike.
    """

    def finer_ones(at: int) -> Iterator[Offer[int]]:
        for place in range(at + 1, len(rounds)):
            if (price := RoundPrices.planned(rounds[place][0], rounds[place][2]).seconds) <= SURELY * seconds:
                yield Offer(place, price, float(place - at))

    return bought(done, finer_ones)[-1]


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
        times = [RoundPrices.planned(scene, plan).seconds for scene, _, plan in rounds]
        while times[1:] and times[1] <= times[0]:  # its airflow is in the cache
            times, rounds = times[1:], rounds[1:]
        quickest = times[0]
        if quickest > OVERTIME * self.budget:
            least = duration(quickest)
            raise SceneError(f"budget = {duration(self.budget)}: the quickest answer takes about {least}; give more")
        done = _finest(rounds, 0, LATEST * self.budget - quickest)
        if not (done and self._ends(*rounds[done], latest=LATEST, instead=quickest)):
            done = 0
            self._ends(*rounds[0])
        while (further := _finest(rounds, done, self.left + STARTED)) > done:
            if not self._ends(*rounds[further], latest=OVERTIME - REPORT / self.budget):
                break
            done = further
        return rounds[done][:2]

    def _rounds(self) -> Iterator[Round]:
        """The efforts that differ for this scene, the quickest first, with their plans."""
        seen: list[Any] = []
        for effort in EFFORTS:
            scene, request = effort.of(self.scene, self.request)
            plan = _planned(scene, request)
            what = scene.tables(), plan.rung
            if what not in seen:
                seen.append(what)
                yield scene, request, plan

    def _ends(self, scene: Scene, request: Request, plan: Plan, *, latest: float = inf, instead: float = 0.0) -> bool:
        """Compute a round, and whether it ended; it is given up so that the answer is there at the ``latest`` (times
        the budget): when what is left of it takes too long, and another ``instead``, which is expected to take so many
        seconds, can only just be computed. How much slower than expected this machine is, the stages tell when they
        begin.
        """
        begun, slower, left = self.clock(), 1.0, inf
        prices = RoundPrices.planned(scene, plan)
        due, whole = prices.beginnings if instead else {}, prices.seconds

        def listener(stage: str, text: str) -> None:
            nonlocal slower, left
            if (at := due.pop(stage, None)) is not None:
                slower, left = max(slower, (self.clock() - begun) / at), whole - at
            if self.clock() > self.began + latest * self.budget - slower * min(instead, left):
                raise OutOfTime
            self.listener(stage, text)

        self.listener(STAGE, f"done {request.effort}: {duration(max(0.0, self.left))} left of {duration(self.budget)}")
        try:
            self.compute(scene, request, listener)
        except OutOfTime:
            self.listener(STAGE, f"done {request.effort} given up: it would not end within {duration(self.budget)}")
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
    rounds = Within(
        seconds_of(budget), scene, request, lambda tried, how, to: compute(tried, request=how, listener=to), listener
    )
    return rounds.best()
