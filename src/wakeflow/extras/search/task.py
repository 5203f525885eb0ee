"""What a search is asked for: goals, limits, bounds, levels from coarse to fine, and a budget; read from a file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...answer.result_table import is_part, names_for
from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.quantities import quantity, split_quantity
from ...core.record import JsonMapping
from ...core.registry import did_you_mean
from ...many.axis import Axis, axes_of
from ...many.variant import TaskFile
from ...scene import Scene
from ...scene.changes import flat
from ...scene.schema import described, refuse_unknown, unit_and_example

KNOWN = ("scene", "maximise", "minimise", "where", "within", "set", "level", "budget", "seed", "at_a_time")
DIRECTIONS = {"maximise": 1, "minimise": -1}
FAN = "airflow.fan_power"  # made of the pressure drop and the flow rate
AT_A_TIME = 8  # designs that are proposed and computed together, unless the file says otherwise


@dataclass(frozen=True)
class Goal:
    """A quantity of a result, named as in the tables of a sweep, that should be large, or small (``sign`` -1)."""

    quantity: str
    sign: int = 1

    def __str__(self) -> str:
        return f"{'most' if self.sign > 0 else 'least'} {self.quantity}"


@dataclass(frozen=True)
class QuantityLimit:
    """What a quantity must not fall below (``least``) or exceed (``most``)."""

    quantity: str
    least: float = -math.inf
    most: float = math.inf

    def excess(self, value: float) -> float:
        """Amount by which a value breaks the limit; 0 or less where it keeps it."""
        return max(self.least - value, value - self.most)


@dataclass(frozen=True)
class SearchTask:
    """A search: the ``scene`` and the axes ``within`` which it may change; ``goals`` and ``limits``; ``levels`` of
    fidelity from coarse to fine, each a set of changes; a ``budget`` of core-seconds; the ``seed`` of what is drawn.
    """

    scene: Scene
    within: tuple[Axis, ...]
    goals: tuple[Goal, ...]
    budget: float
    limits: tuple[QuantityLimit, ...] = ()
    levels: tuple[JsonMapping, ...] = field(default_factory=lambda: ({},))
    seed: int = 0
    at_a_time: int = AT_A_TIME

    @cached_property
    def as_it_stands(self) -> tuple[float, ...]:
        """Where the scene as it is lies along the axes; empty where it lies outside of them."""
        tables = flat(json.loads(self.scene.model_dump_json(by_alias=True)))
        places = tuple(axis.where(tables) for axis in self.within)
        return () if any(map(math.isnan, places)) else places

    @property
    def quantities(self) -> list[str]:
        """Names of the quantities of goals and limits, each once."""
        names = [goal.quantity for goal in self.goals] + [limit.quantity for limit in self.limits]
        return list(dict.fromkeys(names))


def read_search_file(
    path: Path | str, fixed: Mapping[str, object] = {}, budget: str | float | None = None
) -> SearchTask:
    """The search of a file with a [search] table: docs/extras.md. ``fixed``: keys of the scene that are the same in all
    designs at all levels, those to be searched too; ``budget``: instead of the file's own. The scene's own [limit]
    holds too, where [search.where] does not say another.

    Raises SceneError where the file is no search, and where it names quantities or keys that its scene does not have.
    """
    with TaskFile.open(path, "search", KNOWN) as file:
        scene = Scene.load(file.scene, {**flat(file.inside("set")), **fixed})
        return _task(file, scene, fixed, file.table.get("budget") if budget is None else budget)


def search_of(table: Mapping[str, object], scene: Scene) -> SearchTask:
    """The search of a ``scene`` that a [search] ``table`` asks for. Raises SceneError as :func:`read_search_file`."""
    return _task(TaskFile(Path(), "search", table), scene, {}, table.get("budget"))


def _task(file: TaskFile, scene: Scene, held: Mapping[str, object], budget: object) -> SearchTask:
    goals = [Goal(name, sign) for key, sign in DIRECTIONS.items() for name in _names(file.table, key)]
    if not goals:
        raise SceneError("search.maximise or search.minimise: name at least one quantity, such as 'recovery.wheat'")
    where = {name: _limit(name, ends) for name, ends in file.inside("where").items()}
    limits = {name: QuantityLimit(name, most=most) for name, most in scene.limit.by_name.items()}
    task = SearchTask(
        scene, tuple(_within(file, held)), tuple(goals), _seconds(budget), tuple({**limits, **where}.values()),
        _levels(file.table.get("level", [{}]), held), file.whole_number("seed"),
        file.whole_number("at_a_time", least=1) or AT_A_TIME,
    )  # fmt: skip
    _check_names(task)
    return task


def quantities_to_seek(scene: Scene) -> list[str]:
    """Every quantity that a search of a scene may have as a goal or a limit."""
    return names_for(scene) + ([FAN] if scene.air is not None else [])


def _check_names(task: SearchTask) -> None:
    """Raise SceneError where a goal, a limit or a key to change is none of the scene: before anything is computed."""
    known = quantities_to_seek(task.scene)
    for name in task.quantities:
        if name not in known:
            example = f"recovery.{next(iter(task.scene.fraction))}"
            raise SceneError(f"no quantity {name!r}{did_you_mean(name, known) or f' (as {example!r} is one)'}")
    goals = [goal.quantity for goal in task.goals]
    if twice := [name for name in goals if goals.count(name) > 1]:
        raise SceneError(f"search: {twice[0]!r} is named twice; maximise or minimise it, once")
    tables, within = task.scene.tables(), {key for axis in task.within for key in axis.keys}
    for key in within:
        refuse_unknown(key, tables, f"search.within.{key}")
    for level in task.levels:
        for key in level:
            refuse_unknown(key, tables, f"search.level.{key}")
            if key in within:
                raise SceneError(f"search.level.{key}: search.within changes it too; take it out of one")
    for key, value in (pair for axis in task.within for end in axis.values for pair in axis.changes(end).items()):
        _check_unit(key, value, tables)


def _check_unit(key: str, value: object, tables: JsonMapping) -> None:
    """Raise SceneError for a value in a unit of another kind than that of its key: every design would have it."""
    measure = unit_and_example(described(tuple(key.split(".")), tables))
    if measure is None or not isinstance(value, str) or split_quantity(value) is None:
        return
    try:
        quantity(value, *measure)
    except ValueError as problem:
        raise SceneError(f"search.within.{key} = {value!r}: {problem}") from None


def _within(file: TaskFile, held: Mapping[str, object]) -> list[Axis]:
    """The axes of a search, without those whose keys are ``held``."""
    axes = axes_of(file.inside("within"), "search.within")
    keys = [key for axis in axes for key in axis.keys]
    if twice := [key for key in keys if keys.count(key) > 1]:
        raise SceneError(f"search.within: {twice[0]} is there twice; change it once")
    if fixed := [axis.key for axis in axes if len(axis.values) < 2]:
        raise SceneError(f"search.within.{fixed[0]}: needs from and to, or values; what is fixed is for search.set")
    if down := [axis.key for axis in axes if axis.ends and axis.ends[0] > axis.ends[1]]:
        raise SceneError(f"search.within.{down[0]}: from must be below to")
    if parted := [axis.key for axis in axes if 0 < len(held.keys() & set(axis.keys)) < len(axis.keys)]:
        raise SceneError(f"{parted[0]}: keys that are tied are held together or not at all")
    free = [axis for axis in axes if not held.keys() & set(axis.keys)]
    if not free:
        raise SceneError("search.within is missing: give the keys that may change, with from and to")
    return free


def _levels(given: Any, held: Mapping[str, object]) -> tuple[JsonMapping, ...]:
    """What each level changes of the scene, without keys that are ``held``."""
    if not isinstance(given, list) or not given or not all(isinstance(level, Mapping) for level in given):
        raise SceneError("search.level: write [[search.level]], in two brackets, and keys of the scene below it")
    return tuple({key: value for key, value in flat(level).items() if key not in held} for level in given)


def _names(table: Mapping[str, object], key: str) -> Sequence[str]:
    given = table.get(key, [])
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SceneError(f"search.{key}: name quantities, such as 'recovery.wheat'")
    return names


def _limit(name: str, ends: Any) -> QuantityLimit:
    where = f"search.where.'{name}'"
    if not isinstance(ends, Mapping) or not ends or not set(ends) <= {"least", "most"}:
        raise SceneError(f"{where}: write {{ least = 0.9 }} or {{ most = ... }}, the name in quotes")
    for key, end in ends.items():
        if isinstance(end, bool) or not isinstance(end, int | float) or not math.isfinite(end):
            raise SceneError(f"{where}.{key} = {end!r}: give a number without a unit, such as 0.9")
        if is_part(name) and not 0.0 <= end <= 1.0:
            raise SceneError(f"{where}.{key} = {end!r}: a share is from 0 to 1; write 0.9 for 90 %")
    limit = QuantityLimit(name, **ends)
    if limit.least > limit.most:
        raise SceneError(f"{where}: least = {ends['least']!r} is above most = {ends['most']!r}; swap them")
    return limit


def _seconds(given: Any) -> float:
    if given is None:
        raise SceneError("search.budget is missing: the time of one core that may be spent, such as '2 hour'")
    try:
        budget = quantity(given, "s", "2 hour") if isinstance(given, str) else float(given)
    except (TypeError, ValueError, OverflowError) as problem:
        raise SceneError(f"search.budget = {given!r}: {problem}") from None
    if isinstance(given, bool) or not 0.0 < budget < math.inf:
        raise SceneError(f"search.budget = {given!r}: give a time above 0 that ends, such as '2 hour'")
    return budget
