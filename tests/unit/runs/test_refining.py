"""A run with a target error: what is expected of other settings, what is chosen, what cannot be met, and the way."""

import json
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta, binomtest

import wakeflow as wf
from support import shipped
from wakeflow.answer.provenance import RefinedSettings, Refinement
from wakeflow.answer.result import Result
from wakeflow.answer.shares import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow, BudgetTotal
from wakeflow.planning.stage_cache import StageTime
from wakeflow.runs.planned import make_plan
from wakeflow.runs.refine import unreached_lines
from wakeflow.runs.time_budget import (
    RoundPrices,
    applied,
    cheapest,
    choose,
    choose_surely,
    expected_half,
    expected_part,
    finer,
    finest_of,
    reachable,
    settings_of,
    values,
)
from wakeflow.scene import Scene

NOW = RefinedSettings(granules=1024, tolerance=1e-3, mesh_scale=None, averaging=None, slab=None)
SPENT = {"tracks": StageTime(4.0, False), "companion": StageTime(2.0, False), "draws": StageTime(5.0, False)}
PRICES = RoundPrices.measured(SPENT, NOW)


def row(*parts: BudgetPart, place: str = "dust.middle") -> BudgetRow:
    half = hypot(*(part.error or 0.0 for part in parts))
    return BudgetRow(f"share.{place}", None, parts, BudgetTotal(half, 1.0, 0.0, 1.0, half))


def sampling(error: float) -> BudgetPart:
    return BudgetPart("sampling", error, 1.0, "measured")


def steps(changed: int, granules: int) -> BudgetPart:
    """What ``answer.budget.steps`` says where so many of the granules that fly again land in another bin."""
    flown = granules // 4
    return BudgetPart("integration", beta(changed + 0.5, flown - changed + 0.5).mean(), 1.0, "companion")


@pytest.mark.parametrize("changed", [0, 3, 40])
def test_what_was_counted_is_read_back_and_counted_again(changed: int) -> None:
    """Four times the granules with the same share of changed ones; of none the mean of the steps' part and
    the limit of a bound fall as one over them.
    """
    then = replace(NOW, granules=4096)
    expected = expected_part(steps(changed, 1024), NOW, then)
    assert expected == pytest.approx(steps(4 * changed, 4096).error, rel=1e-6)
    limits = [binomtest(changed * n, 1024 * n).proportion_ci(0.95, method="wilson").high for n in (1, 4)]
    bound = BudgetPart("lift", float(limits[0]), 1.0, "calibrated", LEFT_OUT)
    assert expected_part(bound, NOW, then) == pytest.approx(limits[1], rel=1e-6)
    if changed:
        tighter = expected_part(steps(changed, 1024), NOW, replace(then, tolerance=1e-5))
        assert tighter < 0.5 * expected


def test_what_no_setting_lowers_stays() -> None:
    model = BudgetPart("airflow-model", 0.04, 1.0, "companion")
    assert expected_part(model, NOW, finest_of(NOW)) == 0.04
    assert expected_part(BudgetPart("mesh", None), NOW, finest_of(NOW)) is None
    meshed = replace(NOW, mesh_scale=2.0)
    halved = replace(meshed, mesh_scale=1.0)
    assert expected_part(BudgetPart("mesh", 0.04, note="two grids"), meshed, halved) == pytest.approx(0.01)
    hidden = BudgetPart("mesh", 0.04, of_granules=0.04)
    assert expected_part(hidden, meshed, halved) == 0.04  # more granules, not finer cells
    colliding = replace(meshed, slab=1024)
    assert (
        expected_part(hidden, colliding, replace(colliding, slab=2**17)) == 0.04
    )  # grids are compared by granules alone
    assert expected_part(hidden, colliding, replace(colliding, granules=4096)) == pytest.approx(0.04 / 4**0.6)
    both = BudgetPart("mesh", 0.05, of_granules=0.03)
    assert expected_part(both, meshed, halved) == pytest.approx(np.hypot(0.01, 0.03))
    less = BudgetPart("mesh", 0.02, of_granules=0.03)  # smaller than is expected of noise: no more than it is
    assert expected_part(less, meshed, halved) == pytest.approx(0.02)
    shed, longer = BudgetPart("mesh", 0.05, of_sheddings=0.04), replace(meshed, averaging=0.05)
    assert expected_part(shed, longer, replace(longer, averaging=0.025)) == pytest.approx(np.hypot(0.03, 0.02))
    assert expected_part(shed, longer, replace(longer, granules=2**20)) == 0.05
    wake = replace(NOW, averaging=0.05)
    told = BudgetPart("airflow-statistics", 0.03, 1.0, "measured")
    assert expected_part(told, wake, replace(wake, averaging=0.025)) == pytest.approx(0.015)


def test_the_cheapest_settings_are_chosen_that_meet_the_target() -> None:
    """Where few granules are what limits the shares, granules are bought; where the steps are, the tolerance."""
    few = [row(sampling(0.05), steps(0, 1024))]
    chosen = choose(few, PRICES, 0.02)
    assert chosen.half == pytest.approx(expected_half(few[0], NOW, chosen.settings))
    assert chosen.half <= 0.02
    assert chosen.settings.tolerance == NOW.tolerance
    assert expected_half(few[0], NOW, replace(NOW, granules=chosen.settings.granules // 2)) > 0.02  # none too many
    assert chosen.seconds == pytest.approx(PRICES.at(chosen.settings).seconds)
    coarse = [row(sampling(0.005), steps(80, 1024))]
    chosen = choose(coarse, PRICES, 0.03)
    assert chosen.settings.tolerance < NOW.tolerance
    assert chosen.half <= 0.03


def test_nothing_is_bought_for_a_margin_that_nothing_brings() -> None:
    """What no setting lowers leaves room for the target, but not for nine tenths of it."""
    rows = [row(sampling(0.05), BudgetPart("airflow-model", 0.0185, 1.0, "companion"))]
    assert reachable(rows, NOW, 0.02) == rows
    chosen = choose_surely(rows, PRICES, 0.02)
    assert 0.018 < chosen.half <= 0.02
    assert chosen.settings == choose(rows, PRICES, 0.02).settings
    assert chosen.seconds < 0.01 * choose(rows, PRICES, 0.018).seconds
    easy = [row(sampling(0.05))]
    assert choose_surely(easy, PRICES, 0.02).half <= 0.018


def test_a_dear_knob_is_turned_only_where_the_cheap_one_does_not_serve() -> None:
    now = replace(NOW, mesh_scale=2.0)
    prices = RoundPrices.measured({**SPENT, "airflow": StageTime(100.0, False)}, now)
    parts = sampling(0.025), BudgetPart("mesh", 0.01, note="two grids")
    assert choose([row(*parts)], prices, 0.02).settings.mesh_scale == 2.0
    parts = sampling(0.005), BudgetPart("mesh", 0.03, note="two grids")
    chosen = choose([row(*parts)], prices, 0.02).settings
    assert 1.0 < chosen.mesh_scale < 2.0
    assert prices.at(chosen).seconds > 150.0


def test_rows_that_no_setting_brings_below_the_target_are_told_apart() -> None:
    scene = shipped("rhombus")
    plan = make_plan(scene, rung="draft")
    bound = BudgetPart("lift", 0.06, 0.0, "calibrated", NOT_COMPUTED)
    rows = [row(sampling(0.05)), row(sampling(0.05), bound, place="chaff.middle")]
    assert reachable(rows, NOW, 0.02) == rows  # a bound is no part of what computing alone leaves
    (line,) = unreached_lines(rows, NOW, 0.02, scene, plan)
    assert line.startswith("chaff in middle: lift is not computed")
    assert line.endswith("--force chaff.lift=on")
    model = row(BudgetPart("airflow-model", 0.1, 0.0, "companion"))
    assert reachable([model], NOW, 0.02) == []
    (line,) = unreached_lines([model], NOW, 0.02, scene, plan)
    assert line == "dust in middle: airflow-model stays at 10 points: run rung 3d (--rung 3d)"


def test_settings_go_into_a_scene_and_come_out_of_it() -> None:
    scene = shipped("rhombus")
    own = settings_of(scene, make_plan(scene, rung="draft", force={"collisions": True}))
    assert own.granules == 4096
    assert own.averaging is None
    assert own.slab is not None
    first = cheapest(own, 0.02)
    assert (first.granules, first.mesh_scale) == (256, 2.0)
    assert settings_of(applied(scene, first), make_plan(applied(scene, first), rung="draft")).granules == 256
    assert finer(first, own) == replace(own, slab=own.slab)
    assert cheapest(replace(own, granules=64), 0.02).granules == 64  # never finer than the scene
    finest = finest_of(own)
    assert values(finest).keys() == values(own).keys() == {"granules", "tolerance", "mesh", "slab"}
    shedding = settings_of(scene, make_plan(scene, rung="standard"))
    assert shedding.averaging == 0.05
    longer = scene.replace({"numerics.averaging": "1 %"})
    assert make_plan(longer, rung="standard").airflow.accuracy == 0.01
    slab = make_plan(scene.replace({"collisions.count": 64}), rung="draft", force={"collisions": True}).collisions
    assert slab.count == 64


def without_air(**more: Any) -> Scene:
    """The shipped rhombus flown from impact to impact, its inputs known exactly but for one."""
    exact = {f"uncertainty.feed.{key}": 0.0 for key in ("width", "position", "height")}
    for name in ("dust", "chaff", "wheat"):
        exact |= {f"uncertainty.fraction.{name}.{key}": 0.0 for key in ("restitution", "friction", "size")}
    scene = shipped("rhombus", {"numerics.rung": "none", "feed.count": 4096})
    return scene.replace({**exact, **more})


@pytest.fixture(scope="module")
def run_to_target(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, list[str]]:
    told: list[str] = []
    scene = shipped("vacuum", {"feed.count": 16384})
    folder = tmp_path_factory.mktemp("target")
    result = wf.run(scene, folder, target_error=0.016, report=False, listener=lambda _, text: told.append(text))
    return result, told


def test_a_run_buys_what_the_target_needs_and_no_more(run_to_target: tuple[Result, list[str]]) -> None:
    result, told = run_to_target
    table = result.refinement
    assert table.met
    rows = [row for row in result.budget if row.total.numerical is not None]
    assert table.numerical == max(row.total.numerical or 0.0 for row in rows) <= 0.016
    first, last = table.rounds[0], table.rounds[-1]
    assert first.found > 0.016  # a first look is no answer here
    assert first.settings.granules < last.settings.granules < 16384
    assert result.scene["feed"]["count"] == last.settings.granules
    assert all(one.expected is not None and one.expected_seconds is not None for one in table.rounds[1:])
    assert last.expected == pytest.approx(last.found, rel=1.0)
    words = "\n".join(told)
    assert "first look with granules" in words
    assert "points in about" in words
    assert "points by computing met" in words


def test_what_the_inputs_leave_is_said_with_what_to_measure(run_to_target: tuple[Result, list[str]]) -> None:
    """An input known as well as the table asks for brings the total below the target."""
    result, told = run_to_target
    table = result.refinement
    assert table.total > 0.016
    assert any(line.startswith("hard in ") and "measure " in line and " to +- " in line for line in table.measure)
    assert any("by a first look" in line and "measure " in line for line in told)


def test_a_killed_way_is_gone_again_from_the_cache(run_to_target: tuple[Result, list[str]], tmp_path: Path) -> None:
    result, _ = run_to_target
    again = wf.run(shipped("vacuum", {"feed.count": 16384}), tmp_path, target_error=0.016, report=False)
    assert again.refinement == result.refinement
    assert again.key == result.key
    stages = {name: stage for name, stage in again.seconds.items() if name != "compile"}
    assert stages
    assert all(stage.cached for stage in stages.values())


def test_the_table_is_read_back_and_drawn_again(run_to_target: tuple[Result, list[str]]) -> None:
    result, _ = run_to_target
    wf_table = json.loads((result.folder / "result.json").read_text())["refinement"]
    assert isinstance(Result.load(result.folder).refinement, Refinement)
    assert wf_table["rounds"][-1]["settings"]["granules"] == result.scene["feed"]["count"]
    from wakeflow.runs import report_again

    report_again(result.folder)
    assert json.loads((result.folder / "result.json").read_text())["refinement"] == wf_table


def test_without_the_option_nothing_is_chosen(tmp_path: Path) -> None:
    scene = shipped("vacuum", {"feed.count": 64, "numerics.target_error": 0.02})
    assert wf.run(scene, tmp_path / "one", report=False).refinement is None
    gated = wf.run(scene, tmp_path / "two", target_error=0.02, refine=False, report=False)
    assert gated.refinement is None
    assert gated.scene["feed"]["count"] == 64
