"""The search's loop on problems whose answer is known: what it finds, what it spends, what it promotes."""

from collections.abc import Sequence

import numpy as np
import pytest

from support import shipped
from wakeflow.answer.table import TableQuantity
from wakeflow.batch.axis import Axis
from wakeflow.batch.designs import explore
from wakeflow.batch.history import DesignPoint, Evaluation, History, at_random
from wakeflow.batch.task import Goal, QuantityLimit, SearchTask
from wakeflow.core.errors import SceneError

BEST = np.array([0.3, 0.7])
COST = (1.0, 20.0)  # s of a design, coarse and fine


def task(budget: float, **how: object) -> SearchTask:
    axes = tuple(Axis(key, (0.0, 1.0), (0.0, 1.0)) for key in ("a", "b"))
    given = {"goals": (Goal("good"),), "levels": ({}, {"fine": 1}), **how}
    return SearchTask(shipped("vacuum"), axes, budget=budget, **given)  # type: ignore[arg-type]


def hill(level: int, places: Sequence[DesignPoint]) -> list[Evaluation]:
    """Best at BEST; the coarse level is lower by a half, waves a little, and knows less well."""
    found = []
    for place in places:
        off = np.array(place) - BEST
        wave = 0.02 * np.sin(9.0 * np.sum(place)) - 0.5 if level == 0 else 0.0
        half, value = (0.05, 0.01)[level], 1.0 - float(off @ off) + wave
        numbers = {"good": value, "cheap": 1.0 - place[0]}
        quantities = {
            name: TableQuantity(one, one - half, one + half, name=name, unit="1") for name, one in numbers.items()
        }
        found.append(Evaluation(COST[level], quantities))
    return found


def lost(history: History, level: int = -1) -> float:
    """How far the recommended design is below the best one there is."""
    place = history.recommended(level)
    assert place is not None
    return 1.0 - hill(1, [place])[0].quantities["good"].value


def test_it_finds_the_best_within_its_budget_and_says_what_may_be_as_good() -> None:
    history = explore(task(400.0), hill)
    spent = [history.seconds(level) for level in (0, 1)]
    assert sum(spent) <= 400.0
    assert min(spent) >= 0.3 * sum(spent)
    assert lost(history) < 0.01
    known = history.known()
    coarse = [place for place in history.found[0] if place not in history.found[1]]
    truth = {place: -hill(1, [place])[0].quantities["good"].value for place in coarse}
    inside = [known[place].low[0] <= truth[place] <= known[place].high[0] for place in coarse]
    assert np.mean(inside) > 0.9
    for place in history.rivals():
        assert -known[place].low[0] >= -known[history.recommended()].high[0]  # type: ignore[index]


def test_at_equal_cost_two_levels_beat_one_and_random_points() -> None:
    """Mean over seeds of what is lost against the best."""
    found: dict[str, list[float]] = {"both": [], "fine": [], "random": []}
    for seed in range(6):
        alone = {"levels": ({"fine": 1},), "seed": seed}
        found["both"].append(lost(explore(task(240.0, seed=seed), hill)))
        found["fine"].append(lost(explore(task(240.0, **alone), lambda _, places: hill(1, places))))
        found["random"].append(lost(explore(task(240.0, **alone), lambda _, places: hill(1, places), at_random)))
    mean = {name: float(np.mean(values)) for name, values in found.items()}
    assert mean["both"] < 0.5 * min(mean["fine"], mean["random"]), mean


def test_the_scene_as_it_stands_is_the_first_design_at_every_level() -> None:
    scene = shipped("vacuum")
    axes = tuple(
        Axis(key, (0.0, 2.0 * own), (0.0, 2.0 * own))
        for key, own in (("feed.height", scene.feed.height), ("feed.width", scene.feed.width))
    )
    history = explore(SearchTask(scene, axes, (Goal("good"),), 300.0, levels=({}, {"fine": 1})), hill)
    assert [next(iter(made)) for made in history.found] == [pytest.approx((0.5, 0.5))] * 2
    few = SearchTask(scene, axes, (Goal("good"),), 300.0, levels=({}, {"fine": 1}), at_a_time=4)
    own, *others = explore(few, hill, lambda history, count: at_random(history, count)).found[1]
    assert own == pytest.approx((0.5, 0.5))
    assert others  # it does not take the place of the likeliest one
    low = tuple(Axis(axis.key, axis.values, (0.0, 0.5 * axis.values[1] - 1e-3)) for axis in axes)
    outside = SearchTask(scene, low, (Goal("good"),), 300.0)
    assert outside.as_it_stands is None


def test_the_same_search_takes_the_same_steps() -> None:
    once, again = (explore(task(200.0), hill) for _ in range(2))
    assert [list(made) for made in once.found] == [list(made) for made in again.found]


def test_limits_are_kept_and_designs_that_fail_are_left_alone() -> None:
    def evaluate(level: int, places: Sequence[DesignPoint]) -> list[Evaluation]:
        made = hill(level, places)
        return [Evaluation(1.0, problem="no") if p[1] > 0.9 else one for p, one in zip(places, made, strict=True)]

    history = explore(task(400.0, limits=(QuantityLimit("cheap", least=0.8),)), evaluate)
    best = history.recommended()
    assert 0.12 < best[0] <= 0.2  # as near to 0.3 as the limit allows
    assert best not in history.failed()
    assert history.failed()
    impossible = explore(task(200.0, limits=(QuantityLimit("cheap", least=2.0),)), evaluate)
    (nearest,) = impossible.front()
    assert nearest[0] < 0.15


def test_several_goals_have_a_front_and_a_middle() -> None:
    history = explore(task(600.0, goals=(Goal("good"), Goal("cheap"))), hill)
    front, best = history.front(), history.recommended()
    assert len(front) >= 3
    known = history.known()
    losses = np.array([known[place].losses for place in front])
    assert np.all(np.diff(losses[:, 0]) >= 0.0)
    assert np.all(np.diff(losses[:, 1]) <= 0.0)
    assert best in front


def test_a_quantity_that_is_not_there_is_named() -> None:
    with pytest.raises(SceneError, match=r"level 1 has no quantity 'god'; did you mean 'good'"):
        explore(task(100.0, goals=(Goal("god"),)), hill)
