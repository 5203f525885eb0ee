"""What a page can ask for beside a run: many scenes, a search, what to weigh. Each is read before it waits."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from ...answer.result_table import is_part
from ...core.errors import SceneError
from ...core.registry import did_you_mean
from ...many.axis import axis_of_text
from ...many.compute import Sweep, sweep
from ...many.variant import variants
from ...runs.time_budget import quick_keys
from ...scene import Scene
from ..search.designs import refuse_void, search
from ..search.task import SearchTask, read_search_file, search_of
from ..studies.operating import RATE, SPEED, TURNS, capacity, met_lines, met_up_to, operating_map
from ..trays.protocol import protocol, wanted_share
from .stored import inside, said, scene_of

# (folder, how, listener and rung and force among it): does it, and says what came out
Work = Callable[[Path, Mapping[str, Any]], str]
Task = Callable[
    [Scene, str, Path], Work
]  # (scene, what is typed, folder of files): raises SceneError where it is wrong


class SearchForm(BaseModel, extra="forbid"):
    """What the page's form of a search holds, as it is typed: names of quantities, keys to change, limits, a time."""

    maximise: list[str]
    minimise: list[str]
    within: dict[str, dict[Literal["from", "to"], str]]
    where: dict[str, dict[Literal["least", "most"], str]]
    budget: str


def _swept(scene: Scene, typed: str, _: Path) -> Work:
    scenes = variants(scene, _parts(typed))
    return lambda folder, how: _outcome(sweep(scenes, folder, **how))


def _mapped(scene: Scene, typed: str, _: Path) -> Work:
    blower = SPEED if scene.air is None or scene.air.fan is None else TURNS
    axes = _axes(scene, typed, (blower, RATE))
    air, feed = axes.get(blower, ()), axes.get(RATE, ())
    return lambda folder, how: _outcome(operating_map(scene, folder, air=air, feed=feed, **how)[0])


def _capacity(scene: Scene, typed: str, _: Path) -> Work:
    axes, limits = _axes(scene, typed, (RATE,)), scene.limit.by_name

    def work(folder: Path, how: Mapping[str, Any]) -> str:
        curve, _ = capacity(scene, folder, feed=axes.get(RATE, ()), **how)
        return "; ".join([_outcome(curve), *met_lines(met_up_to(curve.table, limits), limits)])

    return work


def _searched(scene: Scene, typed: str, base: Path) -> Work:
    task = filled_in(scene, typed) if typed.startswith("{") else read_search_file(inside(base, typed))
    refuse_void(task)

    def work(folder: Path, how: Mapping[str, Any]) -> str:
        result = search(task, folder, listener=how["listener"])
        best = said(result.recommended.changes, scene_of(result.recommended.folder))
        kept = "" if result.recommended.allowed else "; no design keeps the limits, this one comes nearest"
        return f"recommended: {best}{kept}; within the intervals {len(result.rivals)} others may be as good"

    return work


def filled_in(scene: Scene, typed: str) -> SearchTask:
    """The search of the page's form: a [search] table as JSON, its limits in percent where they are shares. Designs are
    computed with the settings of a quick answer first.
    """
    form = SearchForm.model_validate_json(typed)
    table = form.model_dump() | {
        "within": {key: {end: _pointed(value) for end, value in ends.items()} for key, ends in form.within.items()},
        "where": {name: {end: _limit(name, value) for end, value in ends.items()} for name, ends in form.where.items()},
        "level": [quick_keys(scene), {}],
    }
    return search_of(table, scene)


def _pointed(typed: str) -> str:
    """What is typed with a decimal comma, such as "3,5 m/s", with a point."""
    return re.sub(r"^(\s*-?\d+),(\d+)", r"\1.\2", typed)


def _limit(name: str, typed: str) -> float:
    try:
        return percent_typed(typed) if is_part(name) else float(_pointed(typed))
    except ValueError as problem:
        raise SceneError(f"{name}: {problem}") from None


def percent_typed(typed: str) -> float:
    """A share from what is typed as percent, with a point or a comma, with or without the sign. Raises ValueError.

    >>> percent_typed("26,5"), percent_typed("26.5 %")
    (0.265, 0.265)
    """
    match = re.fullmatch(r"\s*(\d+(?:[.,]\d*)?|[.,]\d+)\s*%?\s*", typed, re.ASCII)
    if match is None:
        raise ValueError(f"{typed!r} is no percent; write a number such as 26.5 or 26,5")
    part = float(match[1].replace(",", "."))
    if part > 100.0:
        raise ValueError(f"{typed!r}: a share is at most 100 %")
    return part / 100.0


def _protocol(scene: Scene, typed: str, _: Path) -> Work:
    wanted_share(scene, typed)
    share = typed or None
    return lambda folder, how: protocol(scene, folder, of=share, planned=how["listener"].planned, **how).sentence


TASKS: Mapping[str, Task] = {
    "sweep": _swept, "map": _mapped, "capacity": _capacity, "search": _searched, "protocol": _protocol,
}  # fmt: skip


def task_of(kind: str, scene: Scene, typed: str, base: Path) -> Work:
    """What does a ``kind`` of task; ``typed``: axes of a sweep, a map or a capacity curve as of ``--set``, between
    semicolons, the search file in the folder ``base``, or the share that a protocol is for. Raises SceneError.
    """
    if kind not in TASKS:
        raise SceneError(f"unknown task {kind!r}{did_you_mean(kind, list(TASKS))} (known: {', '.join(TASKS)})")
    return TASKS[kind](scene, typed.strip(), base)


def _parts(typed: str) -> list[str]:
    return [part.strip() for part in typed.split(";") if part.strip()]


def _axes(scene: Scene, typed: str, known: Sequence[str]) -> dict[str, Sequence[object]]:
    air = scene.air
    given = {RATE: scene.feed.rate, SPEED: air and air.speed, TURNS: air and air.fan and air.fan.speed_ratio}
    if lacking := [key for key in known if not given[key]]:
        raise SceneError(f"the scene has no {lacking[0]} to vary: give it one")
    axes: dict[str, Sequence[object]] = {axis.key: axis.values for axis in map(axis_of_text, _parts(typed))}
    if wrong := [key for key in axes if key not in known]:
        raise SceneError(f"{wrong[0]}: write {' or '.join(known)}, as in {known[-1]}='200:800:4 kg/hour'")
    return axes


def _outcome(made: Sweep) -> str:
    failed = "; ".join(f"{name}: {why}" for name, why in made.failed.items())
    return f"{made.table!r}" + (f"; {failed}" if failed else "")
