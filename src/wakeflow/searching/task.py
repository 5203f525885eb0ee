"""What a search is asked for: goals, limits, bounds, levels from coarse to fine, and a budget; read from a file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..core.errors import SceneError
from ..core.quantities import quantity
from ..scene import Scene
from ..scene.changes import flat
from ..sweeps.axis import Axis, axes_of

__all__ = ["Goal", "QuantityLimit", "SearchTask", "read_search_file"]

KNOWN = ("scene", "maximise", "minimise", "where", "within", "set", "level", "budget", "seed", "at_a_time")
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
    least: float | None = None
    most: float | None = None

    def excess(self, value: float) -> float:
        """By how much a value breaks the limit; 0 or less where it keeps it."""
        below = [] if self.least is None else [self.least - value]
        above = [] if self.most is None else [value - self.most]
        return max(below + above)


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
    levels: tuple[Mapping[str, Any], ...] = field(default_factory=lambda: ({},))
    seed: int = 0
    at_a_time: int = AT_A_TIME

    @property
    def asked(self) -> list[str]:
        """Names of the quantities of goals and limits, each once."""
        names = [goal.quantity for goal in self.goals] + [limit.quantity for limit in self.limits]
        return list(dict.fromkeys(names))


def read_search_file(path: Path | str) -> SearchTask:
    """The search of a file with a [search] table: docs/search.md. Raises SceneError where it is none."""
    path = Path(path)
    try:
        whole = tomllib.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, IsADirectoryError):
        raise SceneError(f"no search file {str(path)!r}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise SceneError(f"{path}: not valid TOML: {problem}") from None
    table = whole.get("search")
    if not isinstance(table, Mapping) or set(whole) != {"search"}:
        raise SceneError(f"{path}: a search file holds a [search] table and nothing beside it")
    try:
        return _task(table, path.parent)
    except SceneError as problem:
        raise SceneError(f"{path}: {problem}") from None


def _task(table: Mapping[str, Any], folder: Path) -> SearchTask:
    if unknown := [key for key in table if key not in KNOWN]:
        raise SceneError(f"search.{unknown[0]}: unknown key (known: {', '.join(KNOWN)})")
    if not isinstance(table.get("scene"), str):
        raise SceneError("search.scene is missing: name the scene file, relative to this one")
    scene = Scene.load(folder / table["scene"], flat(table.get("set", {})))
    goals = [Goal(name, sign) for key, sign in (("maximise", 1), ("minimise", -1)) for name in _names(table, key)]
    if not goals:
        raise SceneError("search.maximise or search.minimise: name at least one quantity, such as 'recovery.wheat'")
    within = axes_of(table.get("within", {}), "search.within")
    if not within:
        raise SceneError("search.within is missing: give the keys that may change, with from and to")
    if fixed := [axis.key for axis in within if len(axis.values) < 2]:
        raise SceneError(f"search.within.{fixed[0]}: needs from and to, or several values; what is fixed is for set")
    levels = tuple(flat(level) for level in table.get("level", [{}]))
    seed, at_a_time = table.get("seed", 0), table.get("at_a_time", AT_A_TIME)
    if not all(isinstance(value, int) and value >= least for value, least in ((seed, 0), (at_a_time, 1))):
        raise SceneError("search.seed and search.at_a_time are whole numbers")
    limits = tuple(_limit(name, ends) for name, ends in table.get("where", {}).items())
    return SearchTask(scene, tuple(within), tuple(goals), _seconds(table), limits, levels, seed, at_a_time)


def _names(table: Mapping[str, Any], key: str) -> Sequence[str]:
    found = table.get(key, [])
    names = [found] if isinstance(found, str) else found
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SceneError(f"search.{key}: name quantities, such as 'recovery.wheat'")
    return names


def _limit(name: str, ends: Any) -> QuantityLimit:
    numbers = isinstance(ends, Mapping) and ends and all(isinstance(end, int | float) for end in ends.values())
    if not numbers or not set(ends) <= {"least", "most"}:
        raise SceneError(f"search.where.'{name}': write {{ least = 0.9 }} or {{ most = ... }}, the name in quotes")
    return QuantityLimit(name, ends.get("least"), ends.get("most"))


def _seconds(table: Mapping[str, Any]) -> float:
    given = table.get("budget")
    if given is None:
        raise SceneError("search.budget is missing: the time of one core that may be spent, such as '2 hour'")
    try:
        budget = quantity(given, "s", "2 hour") if isinstance(given, str) else float(given)
    except (TypeError, ValueError) as problem:
        raise SceneError(f"search.budget = {given!r}: {problem}") from None
    if budget <= 0.0:
        raise SceneError(f"search.budget = {given!r}: must be above 0")
    return budget
