"""search(): designs on the coarse level, those that may be best on finer ones, until the budget is spent.

Every level gets the same part of the budget, as in successive halving (Li et al. 2018, J. Mach. Learn. Res. 18, 185):
many designs are tried where that is cheap, and few are known well. What finer levels were seen to change, in the mean
over the designs that are known at both, is expected of the others too; how much it varies widens their intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .history import DesignPoint, Evaluation, History
from .proposals import Proposer, by_estimator
from .task import SearchTask

__all__ = ["Evaluator", "explore"]

# (level, places) to what was found at each of them
Evaluator = Callable[[int, Sequence[DesignPoint]], Sequence[Evaluation]]


def explore(
    task: SearchTask,
    evaluate: Evaluator,
    propose: Proposer = by_estimator,
    tell: Callable[[str], None] = lambda _: None,
) -> History:
    """Search as :class:`SearchTask` says. The next step follows from what was found alone, so that a search whose
    evaluations are kept goes on where it was ended.

    Raises SceneError as ``evaluate`` and :meth:`History.add` do.
    """
    history = History(task)

    def compute(level: int, places: Sequence[DesignPoint]) -> None:
        spent = sum(history.seconds(one) for one in range(len(task.levels)))
        tell(
            f"level {level + 1} of {len(task.levels)}: {len(places)} designs; {spent:.0f} of {task.budget:.0f} s spent"
        )
        history.add(level, dict(zip(places, evaluate(level, places), strict=True)))

    while (batch := _next(history, propose)) is not None:
        compute(*batch)
    for level in range(1, len(task.levels)):  # an answer is of the finest level, at whatever cost
        if not history.found[level]:
            compute(level, history.contenders(level)[:1])
    return history


def _next(history: History, propose: Proposer) -> tuple[int, Sequence[DesignPoint]] | None:
    """The level that is furthest behind its part of the budget and has something to compute, with designs for it; None
    where what is left of the budget would not pay for them.
    """
    task, levels = history.task, range(len(history.task.levels))
    left = task.budget - sum(history.seconds(level) for level in levels)
    for level in sorted(levels, key=history.seconds):
        made = history.found[level]
        each = history.seconds(level) / len(made) if made else 0.0
        most = task.at_a_time if each == 0.0 else min(task.at_a_time, int(left / each))
        if level == 0:
            return (0, propose(history, most)) if most > 0 and left > 0.0 else None
        few = max(1, min(most, task.at_a_time // 4))
        ready = len(history.found[level - 1]) >= task.at_a_time or history.found[level]
        if most > 0 and left > 0.0 and ready and (able := _ahead(history, level, few)):
            return level, able
    return None


def _ahead(history: History, level: int, few: int) -> list[DesignPoint]:
    """A few contenders of a level, before them the scene as it stands: what every design is measured by."""
    own, able = history.task.as_it_stands, history.contenders(level)[:few]
    if own is None or own not in history.known() or own in history.found[level]:
        return able
    return [own, *(place for place in able if place != own)]
