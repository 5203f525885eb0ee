"""Print what a search finds at equal cost: both levels, either level alone, and balanced points without any search.

.venv/bin/python cases/studies/search_gain.py [--seeds 3] [--budget 20] [--only rhombus]

Shipped scenes without their air, which the chain flies in parts of a second: a design's levels differ in how many
granules are flown, and its cost is their number, so that the table is the same on every machine. What each way
recommends is flown once more with many granules. A recommendation that then breaks a limit by more than half a
point counts as 0.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import wakeflow as wf
from wakeflow.results.landing_results import Separation
from wakeflow.results.quantities import TableQuantity
from wakeflow.searching.history import DesignPoint, Evaluation
from wakeflow.searching.loop import explore
from wakeflow.searching.proposals import Proposer, at_random, by_estimator
from wakeflow.searching.task import Goal, QuantityLimit, SearchTask
from wakeflow.sweeps.axis import Axis

CASES = Path(__file__).parents[1]
COARSE, FINE, JUDGE = 256, 1024, 2**13  # granules of each fraction
SLACK = 0.005  # of a limit, for the granules that judge it


@dataclass(frozen=True)
class Problem:
    """A shipped scene, what may change of it, what should be large, and limits."""

    scene: str
    within: tuple[Axis, ...]
    goal: str
    limits: tuple[QuantityLimit, ...] = ()


def between(key: str, low: float, high: float, unit: str) -> Axis:
    return Axis(key, (f"{low} {unit}", f"{high} {unit}"), (low, high), unit)


OUTER = between(
    "bin.inner-right.to = bin.outer-right.from = -bin.inner-left.from = -bin.outer-left.to", 90.0, 180.0, "mm"
)
PROBLEMS = (
    Problem(
        "vacuum",
        (
            between("body.prism.slope_angle", 30.0, 60.0, "deg"),
            between("feed.height", 60.0, 140.0, "mm"),
            between("vibration.frequency", 15.0, 30.0, "Hz"),
            between("bin.near.to = bin.far.from", 60.0, 200.0, "mm"),
        ),
        "recovery.hard",
        (QuantityLimit("recovery.soft", least=0.98),),
    ),
    Problem(
        "rhombus",
        (
            between("body.rhombus.slope_angle", 35.0, 55.0, "deg"),
            between("feed.height", 60.0, 140.0, "mm"),
            between("vibration.frequency", 20.0, 45.0, "Hz"),
            OUTER,
        ),
        "recovery.wheat",
        (QuantityLimit("purity.outer-left.wheat", least=0.98), QuantityLimit("purity.outer-right.wheat", least=0.98)),
    ),
    Problem(
        "wheat-straw-dust",
        (
            between("body.rhombus.slope_angle", 35.0, 55.0, "deg"),
            between("feed.height", 60.0, 140.0, "mm"),
            between("vibration.frequency", 20.0, 45.0, "Hz"),
            between(
                "bin.middle.to = bin.inner-right.from = -bin.middle.from = -bin.inner-left.to", 10.0, 85.0, "mm"
            ),
            OUTER,
        ),
        "recovery.straw",
        (QuantityLimit("recovery.wheat", least=0.9),),
    ),
)  # fmt: skip
WAYS: dict[str, tuple[tuple[int, ...], Proposer]] = {
    "both levels": ((COARSE, FINE), by_estimator),
    "fine level alone": ((FINE,), by_estimator),
    "coarse level alone": ((COARSE,), by_estimator),
    "balanced points": ((FINE,), at_random),
}


def flown(problem: Problem, place: DesignPoint, count: int) -> Evaluation:
    """A design without its air; its cost in granules of each fraction."""
    changes = {
        key: one
        for axis, at in zip(problem.within, place, strict=True)
        for key, one in axis.changes(axis.at(at)).items()
    }
    try:
        scene = wf.Scene.load(CASES / f"{problem.scene}.toml", changes).without_air()
        return Evaluation(count, numbers(problem, wf.chain(scene, count=count).shares))
    except wf.SceneError as reason:
        return Evaluation(1.0, problem=str(reason))


def numbers(problem: Problem, found: Separation) -> dict[str, TableQuantity]:
    """What the goal and the limits ask for; the purity of a bin that stays empty is 0."""
    named = {}
    for name in (problem.goal, *(limit.quantity for limit in problem.limits)):
        kind, *where = name.split(".")
        one = found.recovery[where[0]] if kind == "recovery" else (found.purity[where[0]] or {}).get(where[1])
        if one is None or one.value is None:
            named[name] = TableQuantity(0.0, 0.0, 1.0, name=name, unit="1")
        else:
            named[name] = TableQuantity(one.value, one.low, one.high, name=name, unit="1")
    return named


def searched(problem: Problem, levels: Sequence[int], propose: Proposer, budget: float, seed: int) -> tuple[float, int]:
    """What the recommended design is worth to the judge, and how many designs were tried."""
    scene = wf.Scene.load(CASES / f"{problem.scene}.toml")
    task = SearchTask(
        scene, problem.within, (Goal(problem.goal),), budget, problem.limits, tuple({} for _ in levels), seed
    )
    history = explore(task, lambda level, places: [flown(problem, place, levels[level]) for place in places], propose)
    best, tried = history.recommended(), sum(map(len, history.found))
    if best is None:
        return 0.0, tried
    judged = flown(problem, best, JUDGE).quantities
    kept = all(limit.excess(judged[limit.quantity].value) <= SLACK for limit in problem.limits)
    return (judged[problem.goal].value if kept else 0.0), tried


def main(
    names: Sequence[str], seeds: int, designs: float, tell: Callable[[str], object] = print
) -> dict[tuple[str, str], list[float]]:
    """Print the table; the judged goals by scene and way, a number a seed. ``designs``: at the fine level, that the
    budget pays for.
    """
    tell("| scene | way | designs | best kept, mean % | worst % | lost against the best of all, points |")
    tell("|---|---|---|---|---|---|")
    found: dict[tuple[str, str], list[float]] = {}
    for problem in (one for one in PROBLEMS if one.scene in names):
        tried = {}
        for way, (levels, propose) in WAYS.items():
            runs = [searched(problem, levels, propose, designs * FINE, seed) for seed in range(seeds)]
            found[problem.scene, way] = [value for value, _ in runs]
            tried[way] = np.mean([count for _, count in runs])
        top = max(max(found[problem.scene, way]) for way in WAYS)
        for way in WAYS:
            values = 100.0 * np.array(found[problem.scene, way])
            lost = 100.0 * top - values.mean()
            tell(
                f"| {problem.scene} | {way} | {tried[way]:.0f} | {values.mean():.1f} | {values.min():.1f} "
                f"| {lost:.1f} |"
            )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=float, default=20.0, help="designs at the fine level that it pays for")
    parser.add_argument("--only", choices=[one.scene for one in PROBLEMS], help="one of the scenes")
    asked = parser.parse_args()
    main([asked.only] if asked.only else [one.scene for one in PROBLEMS], asked.seeds, asked.budget)
