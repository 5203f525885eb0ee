"""A search carried out: designs become scenes, scenes are swept, and the answer is a table, a front and a design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import SceneError
from ..core.files import made_folder, path_of
from ..core.process import check_workers, cores
from ..pipeline.cache import Listener
from ..progress import heard
from ..results.quantities import TableQuantity
from ..results.result import Result
from ..results.table import Entry
from ..sweeps.compute import Sweep, executor_on, sweep
from ..sweeps.variant import Variant, named
from .history import DesignPoint, Evaluation, Expected
from .loop import explore
from .task import FAN, SearchTask, read_search_file

if TYPE_CHECKING:
    import distributed

__all__ = ["FoundDesign", "Search", "search"]

LEAST = 1.0  # s that a design costs, at least: planning, reading, writing


@dataclass(frozen=True)
class FoundDesign:
    """One design at the finest level: the ``changes`` of the scene that make it, its ``quantities`` by name, its folder
    in the sweep of that level, and whether it keeps all limits.
    """

    name: str
    changes: Mapping[str, Any]
    quantities: Mapping[str, TableQuantity]
    folder: Path
    allowed: bool


@dataclass(frozen=True)
class Search:
    """What a search found: the ``recommended`` design, the ``front`` of those that no other beats in all goals, and
    ``rivals``, which within the intervals may be as good; the scene ``as_it_stands``, where it lies within the axes and
    could be computed; ``tried`` designs and core-seconds spent by level.
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
    task: SearchTask | Path | str,
    out: Path | str = Path("runs", "search"),
    *,
    scheduler: str | distributed.Client | Executor | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
) -> Search:
    """Find the best design of a search, or of the search file at a path, and write its tables to the folder ``out``.

    ``scheduler`` and ``workers`` as of :func:`wakeflow.sweep`. The same call goes on where an interrupted or killed one
    ended: what was computed is kept, and each step follows from what was found before.

    Raises SceneError where the task is none, a level lacks a quantity that is asked for, or no design can be computed.
    """
    asked = task if isinstance(task, SearchTask) else read_search_file(task)
    check_workers(workers)
    folder, (listener, _) = made_folder(path_of(out, "out")), heard(listener)
    with executor_on(scheduler, workers or cores(), folder) as executor:
        scenes = _Scenes(asked, folder, partial(sweep, scheduler=executor, listener=listener))
        history = explore(asked, scenes.evaluate, tell=partial(listener, "search"))
        best = history.recommended()
        if best is None:
            raise SceneError(f"no design could be computed; the first: {next(iter(scenes.problems.values()))}")
        for level, made in enumerate(history.found):  # the tables and figures of all designs, nothing is computed
            scenes.compute([scenes.variant(level, place) for place in made], scenes.folder(level))
    known = history.known()
    design = partial(scenes.design, history.found[-1], known)
    tried = tuple(len(made) for made in history.found)
    seconds = tuple(history.seconds(level) for level in range(len(asked.levels)))
    front, rivals = (tuple(map(design, places)) for places in (history.front(), history.rivals()))
    own = asked.as_it_stands
    stands = None if own is None or own not in history.found[-1] or own not in known else design(own)
    return Search(asked, folder, design(best), front, rivals, tried, seconds, stands)


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

    def changes(self, place: DesignPoint) -> dict[str, Any]:
        """What a design changes of the scene."""
        found: dict[str, Any] = {}
        for axis, along in zip(self.task.within, place, strict=True):
            found |= axis.changes(axis.at(along))
        return found

    def variant(self, level: int, place: DesignPoint) -> Variant:
        """A design at a level, as a scene of a sweep."""
        changes = self.changes(place)
        try:
            scene = self.task.scene.replace({**self.task.levels[level], **changes})
        except SceneError as problem:
            return named([Variant("", changes, None, str(problem))])[0]
        return named([Variant("", changes, scene)])[0]

    def evaluate(self, level: int, places: Sequence[DesignPoint]) -> list[Evaluation]:
        """Sweep designs at a level."""
        variants = [self.variant(level, place) for place in places]
        found: Sweep = self.compute(variants, self.folder(level), figures=False)
        return [self._evaluation(place, entry, found) for place, entry in zip(places, found.table.entries, strict=True)]

    def design(
        self, made: Mapping[DesignPoint, Evaluation], known: Mapping[DesignPoint, Expected], place: DesignPoint
    ) -> FoundDesign:
        """A design of the finest level as it is handed out."""
        last = len(self.task.levels) - 1
        name = self.variant(last, place).name
        allowed = bool((known[place].excess <= 0.0).all())
        return FoundDesign(name, self.changes(place), made[place].quantities, self.folder(last) / name, allowed)

    def _evaluation(self, place: DesignPoint, entry: Entry, found: Sweep) -> Evaluation:
        if not entry.quantities:
            self.problems[place] = entry.reason
            return Evaluation(LEAST, problem=entry.reason)
        spent = {(stage, time.seconds) for stage, time in found.result(entry.name).seconds.items()}
        new = spent - self.counted  # a stage that took the very same time is the same one, from the cache
        self.counted |= new
        return Evaluation(max(LEAST, sum(seconds for _, seconds in new)), _with_fan(entry.by_name))


def _with_fan(quantities: Mapping[str, TableQuantity]) -> Mapping[str, TableQuantity]:
    """The quantities with the power that the air takes, W per metre of depth: pressure drop times flow rate."""
    drop, rate = quantities.get("airflow.pressure_drop"), quantities.get("airflow.flow_rate")
    if drop is None or rate is None:
        return quantities
    return {**quantities, FAN: TableQuantity(*drop.times(rate.value), name=FAN, unit="W/m")}
