"""What a search has found: every design at every level, what is expected of it at the finest, what may yet be best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.registry import did_you_mean
from ..results.quantities import TableQuantity
from .task import SearchTask

__all__ = ["DesignPoint", "Evaluation", "Expected", "History"]

Array = NDArray[np.float64]
DesignPoint = tuple[float, ...]  # of a design: 0 to 1 along every axis
TWO_SIGMA = 2.0


@dataclass(frozen=True)
class Evaluation:
    """One design at one level: its ``quantities`` by name, or the ``problem`` for which it has none; the core-seconds
    that it cost, stages that others had made before not counted.
    """

    seconds: float
    quantities: Mapping[str, TableQuantity] = field(default_factory=dict)
    problem: str = ""


class Expected(NamedTuple):
    """What is expected of a design at the finest level: ``losses`` (the goals, the less the better) with the ends of
    their intervals, and by how much each limit is broken, below 0 where it is kept.
    """

    losses: Array
    low: Array
    high: Array
    excess: Array


@dataclass
class History:
    """All evaluations of a search by level and place."""

    task: SearchTask
    found: list[dict[DesignPoint, Evaluation]] = field(init=False)

    def __post_init__(self) -> None:
        self.found = [{} for _ in self.task.levels]

    def add(self, level: int, made: Mapping[DesignPoint, Evaluation]) -> None:
        """Take in what was computed. Raises SceneError where it lacks a quantity that is asked for."""
        for evaluation in made.values():
            for name in self.task.asked:
                if not evaluation.problem and name not in evaluation.quantities:
                    hint = did_you_mean(name, list(evaluation.quantities))
                    raise SceneError(f"level {level + 1} has no quantity {name!r}{hint}")
        self.found[level] |= made

    def seconds(self, level: int) -> float:
        """Core-seconds that a level has taken."""
        return sum(one.seconds for one in self.found[level].values())

    def known(self) -> dict[DesignPoint, Expected]:
        """What is expected of every design that could be computed."""
        shifts = [self._shift(level) for level in range(len(self.found))]
        known: dict[DesignPoint, Expected] = {}
        for level, made in enumerate(self.found):  # finer ones last: they overwrite coarser ones
            for place, evaluation in made.items():
                if evaluation.problem:
                    known.pop(place, None)
                else:
                    known[place] = self._expected(evaluation, *shifts[level])
        return known

    def failed(self) -> list[DesignPoint]:
        """Designs that cannot be computed at some level."""
        return list(dict.fromkeys(place for made in self.found for place, one in made.items() if one.problem))

    def contenders(self, level: int) -> list[DesignPoint]:
        """Designs of the level before that are not computed at this one, and may be best as far as their intervals
        tell: none that keeps the limits is better even at the bad ends of its intervals. The likeliest come first.
        """
        known = self.known()
        ahead = [place for place in self.found[level - 1] if place in known and place not in self.found[level]]
        sure = [one.high for one in known.values() if np.all(one.excess <= 0.0)]
        able = [place for place in ahead if not any(_dominates(high, known[place].low) for high in sure)]
        return sorted(able, key=lambda place: self._rank(known[place], list(known.values())))

    def front(self, level: int = -1) -> list[DesignPoint]:
        """The designs of a level that keep the limits and that no other beats in all goals; where none keeps them, the
        one that comes nearest to that.
        """
        known = self.known()
        made = {place: known[place] for place in self.found[level] if place in known}
        kept = {place: one for place, one in made.items() if np.all(one.excess <= 0.0)}
        if not kept:
            nearest = sorted(made, key=lambda place: float(np.maximum(made[place].excess, 0.0).sum()))
            return nearest[:1]
        best = [a for a, one in kept.items() if not any(_dominates(b.losses, one.losses) for b in kept.values())]
        return sorted(best, key=lambda place: tuple(kept[place].losses))

    def recommended(self, level: int = -1) -> DesignPoint | None:
        """Of the front the design that is nearest to the best of every goal, each in units of its range on the front;
        None where nothing could be computed.
        """
        front, known = self.front(level), self.known()
        if not front:
            return None
        losses = np.array([known[place].losses for place in front])
        span = np.ptp(losses, axis=0)
        off = (losses - losses.min(axis=0)) / np.where(span > 0.0, span, 1.0)
        return front[int(np.argmin(np.linalg.norm(off, axis=1)))]

    def rivals(self) -> list[DesignPoint]:
        """Designs of the finest level that, within the intervals, may be as good as the recommended one."""
        best, known = self.recommended(), self.known()
        if best is None:
            return []
        others = [place for place in self.found[-1] if place in known and place != best]
        return [place for place in others if not _dominates(known[best].high, known[place].low)]

    def _rank(self, one: Expected, others: Sequence[Expected]) -> tuple[float, int, float]:
        broken = float(np.maximum(one.excess, 0.0).sum())
        return broken, sum(_dominates(other.losses, one.losses) for other in others), float(one.losses.sum())

    def _numbers(self, evaluation: Evaluation) -> tuple[Array, Array]:
        """Losses of the goals, and excesses of the limits, as computed."""
        quantities = evaluation.quantities
        losses = [-goal.sign * quantities[goal.quantity].value for goal in self.task.goals]
        excess = [limit.excess(quantities[limit.quantity].value) for limit in self.task.limits]
        return np.array(losses), np.array(excess)

    def _expected(self, evaluation: Evaluation, losses: Array, excess: Array, spread: Array) -> Expected:
        own, broken = self._numbers(evaluation)
        found = [(goal.sign, evaluation.quantities[goal.quantity]) for goal in self.task.goals]
        ends = [[-sign * (one.value if end is None else end) for end in one.ends] for sign, one in found]
        (best, worst), middle = np.sort(ends, axis=1).T, own + losses
        low, high = middle - np.hypot(own - best, spread), middle + np.hypot(worst - own, spread)
        return Expected(middle, low, high, broken + excess)

    def _shift(self, level: int) -> tuple[Array, Array, Array]:
        """What the finest level adds to the losses and excesses of this one, in the mean over designs that are known at
        neighbouring levels, and twice its standard deviation over them (of the losses).
        """
        goals, limits = len(self.task.goals), len(self.task.limits)
        losses, excess, variance = np.zeros(goals), np.zeros(limits), np.zeros(goals)
        for coarse, fine in zip(self.found[level:], self.found[level + 1 :], strict=False):
            both = [place for place in coarse if place in fine and not coarse[place].problem + fine[place].problem]
            if both:
                pairs = [(self._numbers(fine[place]), self._numbers(coarse[place])) for place in both]
                moved = np.array([a[0] - b[0] for a, b in pairs])
                losses, excess = losses + moved.mean(axis=0), excess + np.mean([a[1] - b[1] for a, b in pairs], axis=0)
                variance = variance + (moved.var(axis=0, ddof=1) if len(both) > 1 else 0.0)
        return losses, excess, TWO_SIGMA * np.sqrt(variance)


def _dominates(one: Array, other: Array) -> bool:
    """Whether losses are nowhere more than others, and somewhere less."""
    return bool(np.all(one <= other) and np.any(one < other))
