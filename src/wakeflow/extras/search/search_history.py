"""What a search has found, and which designs it tries next.

The tree-structured Parzen estimator (Bergstra et al. 2011, NIPS 24, 2546; of several goals: Ozaki et al. 2022, J.
Artif. Intell. Res. 73, 1209) takes goals in any number, limits, and designs that are being computed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...answer.result_table import Entry, TableQuantity, difference_of
from ...core.errors import SceneError
from ...core.registry import did_you_mean
from .task import SearchTask

# -- What a search has found -------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
DesignPoint = tuple[float, ...]  # of a design: 0 to 1 along every axis
TWO_SIGMA = 2.0


@dataclass(frozen=True)
class Evaluation:
    """One design at one level: its ``quantities`` by name, or the ``problem`` for which it has none; the core-seconds
    that it cost, stages that others had made before not counted. ``void``: the answer is worth nothing; such numbers
    order designs for a finer level, and none of them is recommended. ``entry``: in the table of its level.
    """

    seconds: float
    quantities: Mapping[str, TableQuantity] = field(default_factory=dict)
    problem: str = ""
    void: bool = False
    entry: Entry | None = None


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
    evaluations: list[dict[DesignPoint, Evaluation]] = field(init=False)

    def __post_init__(self) -> None:
        self.evaluations = [{} for _ in self.task.levels]

    def add(self, level: int, made: Mapping[DesignPoint, Evaluation]) -> None:
        """Take in what was computed. Raises SceneError where it lacks a quantity that is asked for."""
        for evaluation in made.values():
            for name in self.task.quantities:
                if not evaluation.problem and name not in evaluation.quantities:
                    hint = did_you_mean(name, list(evaluation.quantities))
                    raise SceneError(f"level {level + 1} has no quantity {name!r}{hint}")
        self.evaluations[level] |= made

    def seconds(self, level: int) -> float:
        """Core-seconds that a level has taken."""
        return sum(evaluation.seconds for evaluation in self.evaluations[level].values())

    def expectations(self) -> dict[DesignPoint, Expected]:
        """What is expected of every design that could be computed."""
        shifts = [self._shift(level) for level in range(len(self.evaluations))]
        known: dict[DesignPoint, Expected] = {}
        for level, made in enumerate(self.evaluations):  # finer ones last: they overwrite coarser ones
            for place, evaluation in made.items():
                if evaluation.problem:
                    known.pop(place, None)
                else:
                    known[place] = self._expected(evaluation, *shifts[level])
        return known

    def failed(self) -> list[DesignPoint]:
        """Designs that cannot be computed at some level."""
        return list(dict.fromkeys(place for made in self.evaluations for place, tried in made.items() if tried.problem))

    def contenders(self, level: int) -> list[DesignPoint]:
        """Designs of the level before that are not computed at this one, and may be best as far as their intervals
        tell: none that keeps the limits is better even at the bad ends of its intervals. The likeliest come first.
        """
        known = self.expectations()
        ahead = [
            place for place in self.evaluations[level - 1] if place in known and place not in self.evaluations[level]
        ]
        sure = [expected.high for expected in known.values() if np.all(expected.excess <= 0.0)]
        able = [place for place in ahead if not any(_dominates(high, known[place].low) for high in sure)]
        return sorted(able, key=lambda place: self._rank(known[place], list(known.values())))

    def front(self, level: int = -1) -> list[DesignPoint]:
        """The designs of a level that keep the limits and that no other is clearly better than; where none keeps them,
        the one that comes nearest to that.
        """
        kept, known = self._kept(level), self.expectations()
        able = [place for place in kept if not any(self._clearly_better(other, place, level) for other in kept)]
        return sorted(able, key=lambda place: tuple(known[place].losses))

    def recommended(self, level: int = -1) -> DesignPoint:
        """Design, of those that no other beats by its values, that is nearest to the best of every goal, each in units
        of its range over them; empty where nothing could be computed.
        """
        kept = self._kept(level)
        best = [a for a, known in kept.items() if not any(_dominates(b.losses, known.losses) for b in kept.values())]
        if not best:
            return ()
        losses = np.array([kept[place].losses for place in best])
        span = np.ptp(losses, axis=0)
        off = (losses - losses.min(axis=0)) / np.where(span > 0.0, span, 1.0)
        return best[int(np.argmin(np.linalg.norm(off, axis=1)))]

    def _kept(self, level: int) -> dict[DesignPoint, Expected]:
        """The designs of a level that are worth something and keep the limits, or come nearest to that."""
        known = self.expectations()
        made = {
            place: known[place] for place, tried in self.evaluations[level].items() if place in known and not tried.void
        }
        kept = {place: expected for place, expected in made.items() if np.all(expected.excess <= 0.0)}
        nearest = sorted(made, key=lambda place: float(np.maximum(made[place].excess, 0.0).sum()))
        return kept or {place: made[place] for place in nearest[:1]}

    def _clearly_better(self, design: DesignPoint, other: DesignPoint, level: int) -> bool:
        """Whether a design is better than another by more than is not known of their difference, in every goal: each
        draw of what both do not know the same in both.
        """
        a, b = (self.evaluations[level][place] for place in (design, other))
        if a.entry is None or b.entry is None:
            known = self.expectations()
            return _dominates(known[design].high, known[other].low)
        gains = [(goal.sign, difference_of(b.entry, a.entry, goal.quantity)) for goal in self.task.goals]
        return all(gain is not None and gain.clear and sign * gain.value > 0.0 for sign, gain in gains)

    def _rank(self, expected: Expected, others: Sequence[Expected]) -> tuple[float, int, float]:
        broken = float(np.maximum(expected.excess, 0.0).sum())
        return broken, sum(_dominates(other.losses, expected.losses) for other in others), float(expected.losses.sum())

    def _numbers(self, evaluation: Evaluation) -> tuple[Array, Array]:
        """Losses of the goals, and excesses of the limits, as computed."""
        quantities = evaluation.quantities
        losses = [-goal.sign * quantities[goal.quantity].value for goal in self.task.goals]
        excess = [limit.excess(quantities[limit.quantity].value) for limit in self.task.limits]
        return np.array(losses), np.array(excess)

    def _expected(self, evaluation: Evaluation, losses: Array, excess: Array, spread: Array) -> Expected:
        computed, broken = self._numbers(evaluation)
        numbers = [(goal.sign, evaluation.quantities[goal.quantity]) for goal in self.task.goals]
        ends = [[-sign * (goal.value if end is None else end) for end in goal.ends] for sign, goal in numbers]
        (best, worst), middle = np.sort(ends, axis=1).T, computed + losses
        low, high = middle - np.hypot(computed - best, spread), middle + np.hypot(worst - computed, spread)
        if evaluation.void:  # as good or as bad as anything
            low, high = np.full_like(low, -np.inf), np.full_like(high, np.inf)
        return Expected(middle, low, high, broken + excess)

    def _shift(self, level: int) -> tuple[Array, Array, Array]:
        """What the finest level adds to the losses and excesses of this one, in the mean over designs that are known at
        neighbouring levels, and twice its standard deviation over them (of the losses).
        """
        goals, limits = len(self.task.goals), len(self.task.limits)
        losses, excess, variance = np.zeros(goals), np.zeros(limits), np.zeros(goals)
        for coarse, fine in zip(self.evaluations[level:], self.evaluations[level + 1 :], strict=False):
            both = [place for place in coarse if place in fine and not coarse[place].problem + fine[place].problem]
            if both:
                pairs = [(self._numbers(fine[place]), self._numbers(coarse[place])) for place in both]
                moved = np.array([a[0] - b[0] for a, b in pairs])
                losses, excess = losses + moved.mean(axis=0), excess + np.mean([a[1] - b[1] for a, b in pairs], axis=0)
                variance = variance + (moved.var(axis=0, ddof=1) if len(both) > 1 else 0.0)
        return losses, excess, TWO_SIGMA * np.sqrt(variance)


def _dominates(losses: Array, other: Array) -> bool:
    """Whether losses are nowhere more than others, and somewhere less."""
    return bool(np.all(losses <= other) and np.any(losses < other))


# -- Which designs to try next -----------------------------------------------------------------------------------------
# (history, how many) to places that are not in the history
Proposer = Callable[[History, int], list[DesignPoint]]
FIRST = 3  # balanced points an axis before the estimator is asked, at least those of one batch
HOPELESS = 1e6  # excess of a design that cannot be computed


def at_random(history: History, count: int) -> list[DesignPoint]:
    """Points of a scrambled Sobol' sequence, from where the history ends; the first is the scene as it is."""
    task, before = history.task, len(history.evaluations[0])
    first = [task.as_it_stands] if task.as_it_stands else []
    if before < len(first):
        return first + _balanced(task, 0, count - len(first))
    return _balanced(task, before - len(first), count)


def _balanced(task: SearchTask, before: int, count: int) -> list[DesignPoint]:
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(task.within), rng=task.seed)
    if before:
        sequence.fast_forward(before)
    with warnings.catch_warnings():  # batches need not be powers of two
        warnings.simplefilter("ignore", UserWarning)
        return [tuple(place) for place in sequence.random(count).tolist()]


def by_estimator(history: History, count: int) -> list[DesignPoint]:
    """Points where good designs are likelier than others. The same history gives the same points.

    Raises SceneError where optuna is not installed.
    """
    try:
        import optuna
    except ModuleNotFoundError:
        raise SceneError("a search needs optuna: pip install optuna") from None
    task = history.task
    if len(history.evaluations[0]) < max(task.at_a_time, FIRST * len(task.within)):
        return at_random(history, count)
    names = [axis.key for axis in task.within]
    unit: dict[str, optuna.distributions.BaseDistribution] = dict.fromkeys(
        names, optuna.distributions.FloatDistribution(0.0, 1.0)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(
            n_startup_trials=0, multivariate=True, constant_liar=True, seed=task.seed + len(history.evaluations[0])
        )
        study = optuna.create_study(directions=["minimize"] * len(task.goals), sampler=sampler)
        for place, values, excess in _as_trials(history):
            limits = {str(number): value for number, value in enumerate(excess)}
            params = dict(zip(names, place, strict=True))
            study.add_trial(
                optuna.trial.create_trial(params=params, distributions=unit, values=values, constraints=limits)
            )
        trials = [study.ask(unit) for _ in range(count)]
    return [tuple(trial.params[name] for name in names) for trial in trials]


def _as_trials(history: History) -> list[tuple[DesignPoint, list[float], list[float]]]:
    """Every design with its losses and excesses; one that cannot be computed is as bad as the worst, and hopeless."""
    known = history.expectations()
    if not known:
        return []
    worst = [max(expected.losses[goal] for expected in known.values()) for goal in range(len(history.task.goals))]
    trials = [(place, expected.losses.tolist(), [*expected.excess.tolist(), 0.0]) for place, expected in known.items()]
    bad = [*[HOPELESS] * (len(history.task.limits) + 1)]
    return trials + [(place, [float(value) for value in worst], bad) for place in history.failed()]
