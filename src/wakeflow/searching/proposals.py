"""Which designs to try next: the scene as it stands and balanced points first, then those that optuna's estimators of
what is good propose.

The tree-structured Parzen estimator (Bergstra et al. 2011, NIPS 24, 2546; of several goals: Ozaki et al. 2022, J.
Artif. Intell. Res. 73, 1209) takes goals in any number, limits, and designs that are being computed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

from ..core.errors import SceneError
from .history import DesignPoint, History
from .task import SearchTask

__all__ = ["Proposer", "at_random", "by_estimator"]

# (history, how many) to places that are not in the history
Proposer = Callable[[History, int], list[DesignPoint]]
FIRST = 3  # balanced points an axis before the estimator is asked, at least those of one batch
HOPELESS = 1e6  # excess of a design that cannot be computed


def at_random(history: History, count: int) -> list[DesignPoint]:
    """Points of a scrambled Sobol' sequence, from where the history ends; the first is the scene as it stands."""
    task, before = history.task, len(history.found[0])
    own = [] if task.as_it_stands is None else [task.as_it_stands]
    if before < len(own):
        return own + _balanced(task, 0, count - len(own))
    return _balanced(task, before - len(own), count)


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
        raise SceneError("a search needs optuna: pip install 'wakeflow[search]'") from None
    task = history.task
    if len(history.found[0]) < max(task.at_a_time, FIRST * len(task.within)):
        return at_random(history, count)
    names = [axis.key for axis in task.within]
    unit: dict[str, optuna.distributions.BaseDistribution] = dict.fromkeys(
        names, optuna.distributions.FloatDistribution(0.0, 1.0)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(
            n_startup_trials=0, multivariate=True, constant_liar=True, seed=task.seed + len(history.found[0])
        )
        study = optuna.create_study(directions=["minimize"] * len(task.goals), sampler=sampler)
        for place, values, excess in _told(history):
            limits = {str(number): value for number, value in enumerate(excess)}
            params = dict(zip(names, place, strict=True))
            study.add_trial(
                optuna.trial.create_trial(params=params, distributions=unit, values=values, constraints=limits)
            )
        trials = [study.ask(unit) for _ in range(count)]
    return [tuple(trial.params[name] for name in names) for trial in trials]


def _told(history: History) -> list[tuple[DesignPoint, list[float], list[float]]]:
    """Every design with its losses and excesses; one that cannot be computed is as bad as the worst, and hopeless."""
    known = history.known()
    if not known:
        return []
    worst = [max(one.losses[goal] for one in known.values()) for goal in range(len(history.task.goals))]
    told = [(place, one.losses.tolist(), [*one.excess.tolist(), 0.0]) for place, one in known.items()]
    bad = [*[HOPELESS] * (len(history.task.limits) + 1)]
    return told + [(place, [float(value) for value in worst], bad) for place in history.failed()]
