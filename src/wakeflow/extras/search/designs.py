"""A search carried out: designs become scenes, scenes are swept, and the answer is a table, a front and a design.

Every level gets the same part of the budget, as in successive halving (Li et al. 2018, J. Mach. Learn. Res. 18, 185):
many designs are tried where that is cheap, and few are known well. What finer levels were seen to change, in the mean
over the designs that are known at both, is expected of the others too; how much it varies widens their intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...answer.result import VOID, Result
from ...answer.result_table import Entry, TableQuantity
from ...core.errors import SceneError
from ...core.files import made_folder, path_of
from ...core.process import check_workers, cores
from ...core.quantities import duration
from ...core.record import JsonMapping, JsonTable
from ...many.axis import changes_at
from ...many.compute import Sweep, executor_on, sweep
from ...many.variant import Variant, named
from ...planning.stage_cache import Listener
from ...runs.planned import make_plan
from ...runs.progress import as_listener
from ...runs.time_budget import quick_keys
from ...scene import Scene
from .search_history import DesignPoint, Evaluation, Expected, History, Proposer, by_estimator
from .task import FAN, SearchTask, read_search_file

if TYPE_CHECKING:
    import distributed


# -- search() ----------------------------------------------------------------------------------------------------------
Price = Callable[[int], float]  # of a design of a level, core-seconds
FIRST_LOOK = 0.5  # of what is left of the budget: what a first batch of a level may take as expected; chosen
# (level, places) to what was found at each of them
Evaluator = Callable[[int, Sequence[DesignPoint]], Sequence[Evaluation]]


def explore(
    task: SearchTask, evaluate: Evaluator, propose: Proposer = by_estimator,
    tell: Callable[[str], None] = lambda _: None, price: Price = lambda _: 0.0,
) -> History:  # fmt: skip
    """Search as :class:`SearchTask` says. The next step follows from what was found alone, so that a search whose
    evaluations are kept goes on where it was ended. ``price``: what one design of a level is expected to cost before
    any is computed there.

    Raises SceneError as ``evaluate`` and :meth:`History.add` do.
    """
    history = History(task)

    def compute(level: int, places: Sequence[DesignPoint]) -> None:
        spent = sum(history.seconds(number) for number in range(len(task.levels)))
        tell(
            f"level {level + 1} of {len(task.levels)}: {len(places)} designs; {spent:.0f} of {task.budget:.0f} s spent"
        )
        history.add(level, dict(zip(places, evaluate(level, places), strict=True)))

    while (batch := _next(history, propose, price))[1]:
        compute(*batch)
    for level in range(1, len(task.levels)):  # an answer is of the finest level: its price was set aside
        if not history.evaluations[level]:
            compute(level, history.contenders(level)[:1])
    return history


def _next(history: History, propose: Proposer, price: Price) -> tuple[int, Sequence[DesignPoint]]:
    """The level that is furthest behind its part of the budget and has something to compute, with designs for it; none
    where what is left of the budget would not pay for them, with one design of each level that has none set aside.
    """
    task, levels = history.task, range(len(history.task.levels))
    left = task.budget - sum(history.seconds(level) for level in levels)
    for level in sorted(levels, key=history.seconds):
        made = history.evaluations[level]
        free = left - sum(price(other) for other in levels if other != level and not history.evaluations[other])
        each = history.seconds(level) / len(made) if made else price(level)
        most = task.at_a_time if each == 0.0 else min(task.at_a_time, int(free / each))
        if not made and each > 0.0:  # a first look at what it costs
            most = max(1, min(most, int(FIRST_LOOK * free / each)))
        if level == 0:
            return 0, propose(history, most) if most > 0 and left > 0.0 else ()
        few = max(1, min(most, task.at_a_time // 4))
        ready = len(history.evaluations[level - 1]) >= task.at_a_time or history.evaluations[level]
        if most > 0 and left > 0.0 and ready and (able := _ahead(history, level, few)):
            return level, able
    return 0, ()


def _ahead(history: History, level: int, few: int) -> list[DesignPoint]:
    """A few contenders of a level, before them the scene as it is: what every design is measured by."""
    unchanged, able = history.task.as_it_stands, history.contenders(level)[:few]
    if unchanged not in history.expectations() or unchanged in history.evaluations[level]:
        return able
    return [unchanged, *(place for place in able if place != unchanged)]


# -- A search carried out ----------------------------------------------------------------------------------------------
OVERSPENT = 1.3  # times the budget, at most
MIN_DESIGN_TIME = 1.0  # s that a design costs, at least: planning, reading, writing


@dataclass(frozen=True)
class FoundDesign:
    """One design at the finest level: the ``changes`` of the scene that make it, its ``quantities`` by name, its folder
    in the sweep of that level, and whether it keeps all limits.
    """

    name: str
    changes: JsonMapping
    quantities: Mapping[str, TableQuantity]
    folder: Path
    allowed: bool


@dataclass(frozen=True)
class Search:
    """What a search found: the ``recommended`` design; the ``front`` of those that no other is clearly better than in
    all goals, each difference with its interval, and the ``rivals`` on it beside the recommended one; the scene
    ``as_it_stands``, where it lies within the axes and could be computed; ``tried`` designs and core-seconds spent by
    level.
    """

    task: SearchTask
    folder: Path
    recommended: FoundDesign
    front: tuple[FoundDesign, ...]
    rivals: tuple[FoundDesign, ...]
    tried: tuple[int, ...]
    seconds: tuple[float, ...]
    as_it_stands: FoundDesign | None = None

    def __repr__(self) -> str:
        """What is recommended, out of how many."""
        best = ", ".join(f"{key} = {value}" for key, value in self.recommended.changes.items())
        return f"<Search {self.folder}: {best}; {len(self.front)} on the front, {len(self.rivals)} rivals>"

    @property
    def result(self) -> Result:
        """The whole result of the recommended design."""
        return Result.load(self.recommended.folder)


def search(
    task: SearchTask | Path | str, out: Path | str = Path("runs", "search"), *,
    scheduler: str | distributed.Client | Executor | None = None, workers: int | None = None,
    listener: Listener | None = None,
) -> Search:  # fmt: skip
    """Find the best design of a search, or of the search file at a path, and write its tables to the folder ``out``.

    ``scheduler`` and ``workers`` as of :func:`wakeflow.sweep`. The same call goes on where an interrupted or killed one
    ended: what was computed is kept, and each step follows from what was found before.

    Raises SceneError where the task is none, a level lacks a quantity that is asked for, or no design can be computed.
    """
    given = task if isinstance(task, SearchTask) else read_search_file(task)
    check_workers(workers)
    folder, (listener, _) = made_folder(path_of(out, "out")), as_listener(listener)
    given, price = affordable(given, partial(listener, "search"))
    refuse_void(given)
    with executor_on(scheduler, workers or cores(), folder) as executor:
        scenes = _Scenes(given, folder, partial(sweep, scheduler=executor, listener=listener))
        history = explore(given, scenes.evaluate, tell=partial(listener, "search"), price=price)
        best = history.recommended()
        if not best:
            raise SceneError(_nothing_found(history, scenes))
        for level, made in enumerate(history.evaluations):  # the tables and figures of all designs, nothing is computed
            scenes.compute([scenes.variant(level, place) for place in made], scenes.folder(level))
    known = history.expectations()
    design = partial(scenes.design, history.evaluations[-1], known)
    tried = tuple(len(made) for made in history.evaluations)
    seconds = tuple(history.seconds(level) for level in range(len(given.levels)))
    front = tuple(map(design, history.front()))
    rivals = tuple(design_ for design_ in front if design_.name != design(best).name)
    present = given.as_it_stands
    unchanged = design(present) if present in history.evaluations[-1] and present in known else None
    return Search(given, folder, design(best), front, rivals, tried, seconds, unchanged)


def affordable(task: SearchTask, tell: Callable[[str], None]) -> tuple[SearchTask, Price]:
    """The task without the finest levels of which the budget does not pay for one design, and what a design of each
    level is expected to cost; says what is left out. Where every answer of the levels that stay would be void, or none
    stays, the finest is one of quick answers.

    Raises SceneError where the budget does not pay for a single design.
    """
    levels = task.levels
    prices = [_expected_price(_at(task, level)) for level in levels]
    kept = _paid(prices, task.budget) or int(prices[0] <= OVERSPENT * task.budget)
    if kept == len(levels):
        return task, prices.__getitem__
    shortened = (
        f"done the budget of {duration(task.budget)} does not pay for the finest {len(levels) - kept} of {len(levels)} "
        f"levels, where a design takes about {duration(prices[-1])}: the answer is of "
    )
    if kept and not make_plan(_at(task, levels[kept - 1])).why_void:
        tell(f"{shortened}level {kept}")
        return replace(task, levels=levels[:kept]), prices.__getitem__
    quick = {**levels[-1], **quick_keys(_at(task, levels[-1]))}
    price = _expected_price(_at(task, quick))
    if price > OVERSPENT * task.budget:
        raise SceneError(
            f"search.budget = {duration(task.budget)}: one design takes about {duration(min(price, prices[0]))} of one "
            "core; give more, or coarser settings in [[search.level]]"
        )
    kept = _paid(prices[:kept], task.budget - price)
    tell(f"{shortened}quick settings, about {duration(price)} a design")
    return replace(task, levels=(*levels[:kept], quick)), [*prices[:kept], price].__getitem__


def _paid(prices: Sequence[float], budget: float) -> int:
    """Number of levels, the coarsest first, for which a ``budget`` pays a design of each."""
    return sum(sum(prices[: level + 1]) <= budget for level in range(len(prices)))


def _at(task: SearchTask, level: JsonMapping) -> Scene:
    return task.scene.replace(level)


def refuse_void(task: SearchTask) -> None:
    """Raise SceneError where plans say that the finest level's answer is void of the scene as it is, and wherever keys
    are at an end of their bounds, each alone and all together: no design could be recommended.
    """
    finest, lows, highs = _at(task, task.levels[-1]), dict[str, Any](), dict[str, Any]()
    tried: list[dict[str, Any]] = [{}, lows, highs]
    for axis in task.within:
        ends = [axis.changes(axis.at(place)) for place in (0.0, 1.0)]
        lows.update(ends[0])
        highs.update(ends[1])
        tried += ends
    first = ""
    for changes in tried:
        try:
            why = make_plan(finest.replace(changes)).why_void
        except SceneError:  # no scene, as some designs within the bounds
            continue
        if not why:
            return
        first = first or why
    if first:
        raise SceneError(f"search: every answer of the finest level would be void, so that none is computed: {first}")


def _expected_price(scene: Scene) -> float:
    """Core-seconds of a scene alone, on hardware as a plan takes it."""
    return max(MIN_DESIGN_TIME, sum(stage.whole for stage in make_plan(scene).stages if stage.name != "report"))


@dataclass
class _Scenes:
    """Designs as scenes of a task, swept in folders below ``out``; ``problems`` of those that cannot be computed."""

    task: SearchTask
    out: Path
    compute: Any  # sweep, with where it computes
    problems: dict[DesignPoint, str] = field(default_factory=dict)
    counted: set[tuple[str, float]] = field(default_factory=set)

    def folder(self, level: int) -> Path:
        """The folder of a level's sweep."""
        return self.out / f"level-{level + 1}"

    def changes(self, place: DesignPoint) -> JsonTable:
        """What a design changes of the scene."""
        return changes_at(self.task.within, place)

    def variant(self, level: int, place: DesignPoint) -> Variant:
        """A design at a level, as a scene of a sweep."""
        changes = self.changes(place)
        return named([Variant.of(lambda: self.task.scene.replace({**self.task.levels[level], **changes}), changes)])[0]

    def evaluate(self, level: int, places: Sequence[DesignPoint]) -> list[Evaluation]:
        """Sweep designs at a level."""
        variants = [self.variant(level, place) for place in places]
        made: Sweep = self.compute(variants, self.folder(level), figures=False)
        return [self._evaluation(place, entry, made) for place, entry in zip(places, made.table.entries, strict=True)]

    def design(
        self, made: Mapping[DesignPoint, Evaluation], known: Mapping[DesignPoint, Expected], place: DesignPoint
    ) -> FoundDesign:
        """A design of the finest level as it is handed out."""
        last = len(self.task.levels) - 1
        name = self.variant(last, place).name
        allowed = bool((known[place].excess <= 0.0).all())
        return FoundDesign(name, self.changes(place), made[place].quantities, self.folder(last) / name, allowed)

    def _evaluation(self, place: DesignPoint, entry: Entry, made: Sweep) -> Evaluation:
        if not entry.quantities:
            self.problems[place] = entry.reason
            return Evaluation(MIN_DESIGN_TIME, problem=entry.reason)
        spent = {(stage, time.seconds) for stage, time in made.result(entry.name).seconds.items()}
        new = spent - self.counted  # a stage that took the very same time is the same one, from the cache
        self.counted |= new
        spent_here = max(MIN_DESIGN_TIME, sum(seconds for _, seconds in new))
        quantities = with_fan(entry.by_name)
        whole = replace(entry, quantities=tuple(quantities.values()))
        return Evaluation(spent_here, quantities, void=entry.reason == VOID, entry=whole)


def _nothing_found(history: History, scenes: _Scenes) -> str:
    """Why a search recommends nothing."""
    void = [place for place, evaluation in history.evaluations[-1].items() if evaluation.void]
    if not void:
        return f"no design could be computed; the first: {next(iter(scenes.problems.values()))}"
    last = len(history.task.levels) - 1
    folder = scenes.folder(last) / scenes.variant(last, void[0]).name
    why = Result.load(folder).why_void
    return f"every answer of the finest level is void, so that no design can be recommended; the first: {why}"


def with_fan(quantities: Mapping[str, TableQuantity]) -> Mapping[str, TableQuantity]:
    """The quantities with the power that the air takes, W per metre of depth: pressure drop times flow rate."""
    drop, rate = quantities.get("airflow.pressure_drop"), quantities.get("airflow.flow_rate")
    if drop is None or rate is None:
        return quantities
    return {**quantities, FAN: TableQuantity(*drop.times(rate.value), name=FAN, unit="W/m")}
