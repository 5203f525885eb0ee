"""What a search finds at equal cost: both levels, either level alone, and evenly spread points without any search.

Shipped scenes without their air, which fly in parts of a second: a design's levels differ in how many granules are
flown, and its cost is their number, so that the table does not depend on the machine. What each way recommends is flown
once more with many granules. A recommendation that then breaks a limit by more than half a point counts as 0. The
budget pays for so many designs at the fine level. docs/extras.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import wakeflow as wf
from support import shipped
from wakeflow.answer.result_table import TableQuantity
from wakeflow.answer.shares import Separation
from wakeflow.extras.search.designs import explore
from wakeflow.extras.search.search_history import DesignPoint, Evaluation, Proposer, at_random, by_estimator
from wakeflow.extras.search.task import Goal, QuantityLimit, SearchTask
from wakeflow.many.axis import Axis

from .common import Row, show

COARSE, FINE, JUDGE = 256, 1024, 2**13  # granules of each fraction
SLACK = 0.005  # of a limit, for the granules that judge it
COLUMNS = {
    "scene": "{scene}", "way": "{way}", "designs": "{designs:.0f}", "best kept, mean %": "{mean:.1f*100}",
    "worst %": "{worst:.1f*100}", "lost against the best of all, points": "{lost:.1f*100}",
}  # fmt: skip


def between(key: str, low: float, high: float, unit: str) -> Axis:
    """What may change of a scene."""
    return Axis(key, (f"{low} {unit}", f"{high} {unit}"), (low, high), unit)


@dataclass(frozen=True)
class Problem:
    """A shipped scene, what may change of it, what should be large, and limits."""

    scene: str
    within: tuple[Axis, ...]
    goal: str
    limits: tuple[QuantityLimit, ...] = ()

    def flown(self, place: DesignPoint, count: int) -> Evaluation:
        """A design without its air; its cost in granules of each fraction."""
        changes = {
            key: one
            for axis, at in zip(self.within, place, strict=True)
            for key, one in axis.changes(axis.at(at)).items()
        }
        try:
            scene = shipped(self.scene, changes).without_air()
            found = wf.chain(scene, count=count).shares
        except wf.SceneError as reason:
            return Evaluation(1.0, problem=str(reason))
        names = (self.goal, *(limit.quantity for limit in self.limits))
        return Evaluation(count, {name: number(name, found) for name in names})


def number(name: str, found: Separation) -> TableQuantity:
    """What a goal or a limit asks for; the purity of a bin that stays empty is 0."""
    kind, *where = name.split(".")
    one = found.recovery[where[0]] if kind == "recovery" else (found.purity[where[0]] or {}).get(where[1])
    if one is None or one.value is None:
        return TableQuantity(0.0, 0.0, 1.0, name=name, unit="1")
    return TableQuantity(one.value, one.low, one.high, name=name, unit="1")


def shaken(body: str, angles: tuple[float, float], frequencies: tuple[float, float]) -> tuple[Axis, ...]:
    """The body's slope, the height of the feed and the vibration."""
    return (
        between(f"body.{body}.slope_angle", *angles, "deg"),
        between("feed.height", 60.0, 140.0, "mm"),
        between("vibration.frequency", *frequencies, "Hz"),
    )


RHOMBUS = shaken("rhombus", (35.0, 55.0), (20.0, 45.0))
INNER = between("bin.middle.to = bin.inner-right.from = -bin.middle.from = -bin.inner-left.to", 10.0, 85.0, "mm")
OUTER = between(
    "bin.inner-right.to = bin.outer-right.from = -bin.inner-left.from = -bin.outer-left.to", 90.0, 180.0, "mm"
)
NEAR = between("bin.near.to = bin.far.from", 60.0, 200.0, "mm")
PROBLEMS = (
    Problem(
        "vacuum", (*shaken("prism", (30.0, 60.0), (15.0, 30.0)), NEAR), "recovery.hard",
        (QuantityLimit("recovery.soft", least=0.98),),
    ),
    Problem(
        "rhombus", (*RHOMBUS, OUTER), "recovery.wheat",
        tuple(QuantityLimit(f"purity.outer-{side}.wheat", least=0.98) for side in ("left", "right")),
    ),
    Problem(
        "wheat-straw-dust", (*RHOMBUS, INNER, OUTER), "recovery.straw", (QuantityLimit("recovery.wheat", least=0.9),)
    ),
)  # fmt: skip
WAYS: dict[str, tuple[tuple[int, ...], Proposer]] = {
    "both levels": ((COARSE, FINE), by_estimator),
    "fine level alone": ((FINE,), by_estimator),
    "coarse level alone": ((COARSE,), by_estimator),
    "evenly spread points": ((FINE,), at_random),
}


def searched(problem: Problem, way: str, budget: float, seed: int) -> tuple[float, int]:
    """What the recommended design is worth to the judge, and how many designs were tried."""
    levels, propose = WAYS[way]
    goals, every = (Goal(problem.goal),), tuple({} for _ in levels)
    task = SearchTask(shipped(problem.scene), problem.within, goals, budget, problem.limits, every, seed)
    history = explore(task, lambda level, places: [problem.flown(place, levels[level]) for place in places], propose)
    best, tried = history.recommended(), sum(map(len, history.evaluations))
    if best is None:
        return 0.0, tried
    judged = problem.flown(best, JUDGE).quantities
    kept = all(limit.excess(judged[limit.quantity].value) <= SLACK for limit in problem.limits)
    return (judged[problem.goal].value if kept else 0.0), tried


def rows(problem: Problem, seeds: int, budget: float) -> Iterator[Row]:
    """A row a way."""
    found = {way: np.array([searched(problem, way, budget, seed) for seed in range(seeds)]) for way in WAYS}
    top = max(float(runs[:, 0].max()) for runs in found.values())
    for way, runs in found.items():
        worth, designs = runs.T
        yield {
            "scene": problem.scene, "way": way, "designs": designs.mean(), "mean": worth.mean(), "worst": worth.min(),
            "lost": top - worth.mean(), "worth": worth,
        }  # fmt: skip


def main(*scenes: str, seeds: int = 3, budget: float = 20.0) -> list[Row]:
    """What a search finds at equal cost: vacuum, rhombus, wheat-straw-dust."""
    chosen = [problem for problem in PROBLEMS if problem.scene in scenes or not scenes]
    return show(COLUMNS, (row for problem in chosen for row in rows(problem, seeds, budget * FINE)))
