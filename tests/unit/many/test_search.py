"""A search from its file to its answer, and its loop on problems whose answer is known."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from support import CASES, Here, shipped
from wakeflow.answer.result_table import TableQuantity
from wakeflow.cli import app  # noqa: F401 - it imports the commands of extras, show_search among them
from wakeflow.core.errors import SceneError
from wakeflow.core.graded import Grade
from wakeflow.extras.search.designs import affordable, explore, refuse_void, search, with_fan
from wakeflow.extras.search.search_commands import show_search
from wakeflow.extras.search.search_history import DesignPoint, Evaluation, History, at_random
from wakeflow.extras.search.task import Goal, QuantityLimit, SearchTask, read_search_file
from wakeflow.extras.studies.operating import operating_map
from wakeflow.extras.trays.calibration import calibrate
from wakeflow.many.axis import Axis, axis_of_text
from wakeflow.runs.planned import make_plan

FILE = f"""
[search]
scene = "{CASES / "rhombus.toml"}"
maximise = "recovery.wheat"
minimise = ["airflow.fan_power"]
budget = "2 hour"

[search.within]
air.speed = {{ from = "3 m/s", to = "7 m/s" }}
body.rhombus.slope_angle = {{ from = "35 deg", to = "50 deg" }}

[search.where]
"purity.outer-left.wheat" = {{ least = 0.95 }}

[[search.level]]
numerics.rung = "none"
feed.count = 256

[[search.level]]
numerics.rung = "draft"
"""


def test_a_file_says_goals_bounds_limits_levels_and_budget(tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(FILE)
    task = read_search_file(path)
    assert task.goals == (Goal("recovery.wheat"), Goal("airflow.fan_power", -1))
    assert task.limits == (QuantityLimit("purity.outer-left.wheat", least=0.95),)
    assert task.limits[0].excess(0.97) == pytest.approx(-0.02)
    assert [axis.key for axis in task.within] == ["air.speed", "body.rhombus.slope_angle"]
    assert task.levels == ({"numerics.rung": "none", "feed.count": 256}, {"numerics.rung": "draft"})
    assert task.budget == 7200.0


def test_what_is_held_is_not_searched_at_any_level(tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(FILE)
    task = read_search_file(path, {"air.speed": "5 m/s", "numerics.rung": "none"}, "20 s")
    assert [axis.key for axis in task.within] == ["body.rhombus.slope_angle"]
    assert task.scene.air.speed == 5.0
    assert task.scene.numerics.rung == "none"
    assert task.levels == ({"feed.count": 256}, {})
    assert task.budget == 20.0
    with pytest.raises(SceneError, match="may change"):
        read_search_file(path, {"air.speed": "5 m/s", "body.rhombus.slope_angle": "45 deg"})


def test_the_shipped_search_is_read() -> None:
    """Half of a tied pair of dividers cannot be held."""
    file = CASES / "search-splitters.toml"
    task = read_search_file(file)
    assert [goal.quantity for goal in task.goals] == ["recovery.wheat", "recovery.dust"]
    assert set(task.scene.fraction) == {"dust", "straw", "wheat"}
    assert len(task.within) == 4
    stands = [axis.at(place) for axis, place in zip(task.within, task.as_it_stands or (), strict=True)]
    assert stands == ["5.0 m/s", "45.0 deg", "80.0 mm", "135.0 mm"]
    assert read_search_file(file, {"air.speed": "2 m/s"}).as_it_stands is not None  # no axis any more
    with pytest.raises(SceneError, match="tied"):
        read_search_file(file, {"bin.middle.to": "80 mm"})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('budget = "2 hour"', ""), "budget is missing"),
        (('"2 hour"', '"2 m"'), "budget = '2 m'"),
        (('maximise = "recovery.wheat"\nminimise = ["airflow.fan_power"]', ""), "name at least one quantity"),
        (("maximise", "maximize"), "maximize: unknown key"),
        (("least", "last"), "write { least"),
        (('{ from = "3 m/s", to = "7 m/s" }', "5"), "air.speed: needs from and to"),
        (('"recovery.wheat"', '["recovery.wheat", "recovery.wheat"]'), "'recovery.wheat' is named twice"),
        (("feed.count =", '"air.speed" ='), "level.air.speed: search.within changes it too"),
        (("[search.within]", '[search.within]\n"feed.height = air.speed" = [1, 2]'), "air.speed is there twice"),
        (("[search]", "[sweep]"), r"holds \[search\] only"),
        (('"recovery.wheat"', '["recovery.hweat"]'), "no quantity 'recovery.hweat'; did you mean 'recovery.wheat'?"),
        (("purity.outer-left", "purity.outer-lift"), "did you mean 'purity.outer-left.wheat'?"),
        (("air.speed", "air.sped"), "within.air.sped: unknown key 'sped'; did you mean 'speed'?"),
        (("body.rhombus", "body.hedge"), r"unknown key 'hedge' \(known: rhombus\)"),
        (("feed.count", "feed.cuont"), "level.feed.cuont: unknown key 'cuont'; did you mean 'count'?"),
        (('from = "3 m/s"', 'from = "9 m/s"'), "within.air.speed: from must be below to"),
        (('from = "3 m/s", to = "7 m/s"', 'from = "3 kg", to = "7 kg"'), "within.air.speed = '3.0 kg': needs a number"),
        *((('"2 hour"', time), "give a time above 0") for time in ("nan", "inf", '"1e400 s"', "-1", "true")),
        *((("0.95", end), "give a number") for end in ("nan", "true", '"95 %"')),
        (("0.95", "95"), "least = 95: a share is from 0 to 1"),
        (("0.95", "0.95, most = 0.9"), "least = 0.95 is above most = 0.9"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(change: tuple[str, str], said: str, tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(FILE.replace(*change, 1))
    with pytest.raises(SceneError, match=said) as caught:
        read_search_file(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("level", ['{ "feed.count" = 256 }', "5", '["a"]', "[]"])
def test_levels_are_written_in_two_brackets(level: str, tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(FILE.partition("[[")[0].replace("budget", f"level = {level}\nbudget"))
    with pytest.raises(SceneError, match=r"search.level: write \[\[search.level\]\]"):
        read_search_file(path)


def test_a_search_sweeps_its_levels_and_goes_on_where_it_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second call computes nothing and finds the same. Figures are drawn as in any sweep."""
    monkeypatch.setattr("wakeflow.show.many_figures.draw_table_figures", lambda folder, table: None)
    monkeypatch.setattr("wakeflow.extras.search.designs._expected_price", lambda scene: 1.0)
    scene, here = shipped("rhombus", {"numerics.rung": "none"}).without_air(), Here()
    tied = "bin.middle.to = bin.inner-right.from = -bin.middle.from = -bin.inner-left.to"
    axes = (axis_of_text("feed.height=60:140:2 mm"), Axis(tied, ("60 mm", "100 mm"), (60.0, 100.0), "mm"))
    levels = ({"feed.count": 16}, {"feed.count": 32})
    task = SearchTask(scene, axes, (Goal("recovery.wheat"),), budget=3.0, levels=levels, at_a_time=2)
    found = wf.search(task, tmp_path, scheduler=here)
    assert min(found.tried) >= 1
    best = found.recommended
    assert best.quantities["recovery.wheat"].value == found.result.landings.separation.recovery["wheat"].value
    assert best.changes["bin.middle.from"] == f"-{best.changes['bin.inner-right.from']}"
    assert best.name in {one.name for one in found.front}
    own = found.as_it_stands
    assert list(own.changes.values())[:2] == ["100.0 mm", "80.0 mm"]
    assert own.quantities["recovery.wheat"].value <= best.quantities["recovery.wheat"].value
    table = (tmp_path / "level-2" / "sweep.csv").read_bytes()
    calls = len(here.calls)
    assert wf.search(task, tmp_path, scheduler=here) == found
    assert len(here.calls) == calls
    assert (tmp_path / "level-2" / "sweep.csv").read_bytes() == table
    show_search(found)
    told = capsys.readouterr().out
    assert "recommended, the first" in told
    assert "the scene as it is" in told
    assert own.allowed or "beyond the limits" in told


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
    known = history.expectations()
    coarse = [place for place in history.evaluations[0] if place not in history.evaluations[1]]
    truth = {place: -hill(1, [place])[0].quantities["good"].value for place in coarse}
    inside = [known[place].low[0] <= truth[place] <= known[place].high[0] for place in coarse]
    assert np.mean(inside) > 0.9
    for place in history.front():
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
    assert [next(iter(made)) for made in history.evaluations] == [pytest.approx((0.5, 0.5))] * 2
    few = SearchTask(scene, axes, (Goal("good"),), 300.0, levels=({}, {"fine": 1}), at_a_time=4)
    own, *others = explore(few, hill, lambda history, count: at_random(history, count)).evaluations[1]
    assert own == pytest.approx((0.5, 0.5))
    assert others  # it does not take the place of the likeliest one
    low = tuple(Axis(axis.key, axis.values, (0.0, 0.5 * axis.values[1] - 1e-3)) for axis in axes)
    outside = SearchTask(scene, low, (Goal("good"),), 300.0)
    assert outside.as_it_stands == ()


def test_the_same_search_takes_the_same_steps() -> None:
    once, again = (explore(task(200.0), hill) for _ in range(2))
    assert [list(made) for made in once.evaluations] == [list(made) for made in again.evaluations]


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
    known = history.expectations()
    kept = [place for place in history.evaluations[-1] if place in known]
    for place in kept:  # off the front is what another is better than in both, whatever their intervals
        beaten = any(np.all(known[other].high <= known[place].low) for other in kept if other != place)
        assert (place in front) is not beaten
    assert best in front
    assert not any(np.all(known[place].losses < known[best].losses) for place in kept)


def test_a_quantity_that_is_not_there_is_named() -> None:
    with pytest.raises(SceneError, match=r"level 1 has no quantity 'god'; did you mean 'good'"):
        explore(task(100.0, goals=(Goal("god"),)), hill)


def test_pressure_drop_and_fan_power_are_goals(tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(FILE.replace("airflow.fan_power", "airflow.pressure_drop"))
    assert read_search_file(path).goals[1] == Goal("airflow.pressure_drop", -1)

    def evaluate(level: int, places: Sequence[DesignPoint]) -> list[Evaluation]:
        """The air's speed is the first input: its pressure drop goes with the square, and more recover in fast air."""
        found = []
        for place, one in zip(places, hill(level, places), strict=True):
            drop, rate = 1.0 + 8.0 * place[0] ** 2, 0.2 + 0.8 * place[0]
            air = {
                "airflow.pressure_drop": TableQuantity(drop, 0.9 * drop, 1.1 * drop, name="drop", unit="Pa"),
                "airflow.flow_rate": TableQuantity(rate, name="rate", unit="m^2/s"),
                "good": replace(one.quantities["good"], value=place[0], low=place[0] - 0.01, high=place[0] + 0.01),
            }
            found.append(Evaluation(COST[level], with_fan(air)))
        return found

    for goal in ("airflow.pressure_drop", "airflow.fan_power"):
        history = explore(task(400.0, goals=(Goal("good"), Goal(goal, -1))), evaluate)
        assert len(history.front()) >= 3  # more of the one costs more of the other: every speed is a best one
        least = explore(task(400.0, goals=(Goal(goal, -1),)), evaluate).recommended()
        assert least is not None
        assert least[0] < 0.1
    quantities = evaluate(0, [(0.5, 0.0)])[0].quantities
    assert tuple(quantities["airflow.fan_power"]) == pytest.approx((1.8, 1.62, 1.98))  # 3 Pa times 0.6 m2/s


AXES = (axis_of_text("feed.height=60:140:2 mm"),)


def test_levels_that_the_budget_does_not_pay_for_are_left_out_and_said() -> None:
    levels = ({"feed.count": 64}, {"feed.count": 2**17})
    task, said = SearchTask(shipped("vacuum"), AXES, (Goal("recovery.wheat"),), budget=4.0, levels=levels), list[str]()
    kept, price = affordable(task, said.append)
    assert kept.levels == levels[:1]
    assert price(0) < 4.0 < price(1)
    assert "does not pay for the finest 1 of 2 levels" in said[0]
    assert affordable(replace(task, budget=1e4), said.append)[0] == replace(task, budget=1e4)


def test_where_the_levels_that_are_paid_for_are_void_the_finest_is_one_of_quick_answers() -> None:
    alone = {"force.air-loading": "off", "force.collisions": "off", "numerics.mesh_scale": 3.0, "feed.count": 64}
    levels = ({"numerics.rung": "draft", **alone}, {"numerics.rung": "draft"})
    task, said = SearchTask(shipped("rhombus"), AXES, (Goal("recovery.wheat"),), 60.0, levels=levels), list[str]()
    kept, price = affordable(task, said.append)
    assert len(kept.levels) == 2
    assert kept.levels[0] == levels[0]
    assert price(0) + price(1) <= 60.0
    notices = [make_plan(task.scene.replace(level)).notices for level in kept.levels]
    void = [any(one.grade is Grade.VOID for one in found) for found in notices]
    assert void == [True, False]
    assert "the answer is of quick settings" in said[0]
    with pytest.raises(SceneError, match=r"budget = 10 s: one design takes about .* of one core"):
        affordable(replace(task, budget=10.0), said.append)


def test_what_a_plan_knows_to_be_void_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    """A search whose finest level is void within all its bounds, a map of nothing else, a calibration; not a search of
    which some designs are worth something.
    """
    alone = {"force.air-loading": "off", "force.collisions": "off", "numerics.rung": "draft"}
    dense, goal = shipped("rhombus").replace(alone), (Goal("recovery.wheat"),)
    with pytest.raises(
        SceneError, match=r"finest level would be void, so that none is computed: the feed is too dense"
    ):
        search(SearchTask(dense, AXES, goal, 600.0), tmp_path / "search")
    assert not (tmp_path / "search" / ".cache").exists()
    refuse_void(SearchTask(dense, (axis_of_text("feed.rate=1:500:3 kg/hour"),), goal, 600.0))
    with pytest.raises(SceneError, match=r"every answer of the map would be void: the feed is too dense"):
        operating_map(dense, tmp_path / "map", air=[4.0, 5.0], feed=["400 kg/h", "500 kg/h"])
    with pytest.raises(SceneError, match=r"calibrate: the answer would be void: the feed is too dense"):
        calibrate(dense, {"fraction": ["wheat"], "bin": ["outer-left"], "share": [0.5], "uncertainty": [0.1]},
                  tmp_path / "calibrated")  # fmt: skip
    assert not (tmp_path / "map").exists()
    assert not (tmp_path / "calibrated").exists()


def test_a_search_keeps_its_budget_however_many_designs_are_asked_for_at_a_time() -> None:
    """Each design costs what was expected; the finest level's is set aside before the first batch."""
    task = SearchTask(
        shipped("rhombus"), (axis_of_text("feed.height=60:140:2 mm"),), (Goal("recovery.wheat"),), budget=100.0,
        levels=({}, {"feed.count": 64}), at_a_time=8,
    )  # fmt: skip
    cost = (10.0, 40.0)

    def evaluate(level: int, places: Sequence[DesignPoint]) -> list[Evaluation]:
        share = TableQuantity(0.5, 0.4, 0.6, name="recovery.wheat", unit="1")
        return [Evaluation(cost[level], {"recovery.wheat": share}) for _ in places]

    history = explore(task, evaluate, at_random, price=cost.__getitem__)
    assert sum(history.seconds(level) for level in (0, 1)) <= 1.3 * task.budget
    assert len(history.evaluations[1]) >= 1
