"""What a setting earns an hour: the joint draws as the prices of the scene value them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.answer.budget.budget import _prices
from wakeflow.answer.joint import HOUR, difference
from wakeflow.answer.result import Result
from wakeflow.answer.result_table import names_for, quantities_of
from wakeflow.answer.shares import Prices
from wakeflow.core.graded import Grade
from wakeflow.flight.stages.pipeline import unweighed
from wakeflow.scene import Scene
from wakeflow.show.many_figures import main_quantities
from wakeflow.show.words import money_lines

if TYPE_CHECKING:
    from wakeflow.flight.stages.pipeline import Pipeline

HARD, SOFT = {"far": 200.0, "near": 80.0}, {"near": -30.0}  # EUR/t


def priced(run: Result, prices: Prices) -> Result:
    """A run valued with some prices, as its scene would have it."""
    assert run.landings is not None
    joint = replace(run.joint, prices=prices)
    landings = replace(run.landings, separation=joint.own.separation(), joint=joint.record())
    return replace(run, landings=landings).with_joint(joint)


def test_a_setting_earns_what_every_bin_is_worth_less_the_fan_draw_by_draw(small_run: Result) -> None:
    joint = small_run.joint
    run = priced(small_run, Prices({"hard": HARD, "soft": SOFT}, 2000.0, 0.3))
    assert run.landings is not None
    money = run.landings.separation.money
    assert money is not None
    assert money.total is not None
    names, flow = joint.own.names, HOUR * joint.flow * joint.mass / 1e3  # t/h
    worth = np.zeros((len(joint.fractions), len(names)))
    for name, row in (("hard", HARD), ("soft", SOFT)):
        for place, price in row.items():
            worth[joint.fractions.index(name), names.index(place)] = price
    every = np.einsum("cdfb,f,fb->cd", joint.own.tables(), flow, worth)
    assert money.products.value == pytest.approx(float(np.einsum("fb,f,fb->", joint.own.value, flow, worth)), rel=1e-12)
    low, high = np.mean([np.quantile(one, (0.025, 0.975)) for one in every], axis=0)
    assert money.products.low == pytest.approx(min(low, money.products.value))
    assert money.products.high == pytest.approx(max(high, money.products.value))
    assert (money.fan, money.fan_power) == (pytest.approx(0.6), 2000.0)
    assert [*money.total] == pytest.approx([one - 0.6 for one in money.products])


def test_money_is_in_tables_and_a_difference_of_two_runs_is_taken_draw_by_draw(small_run: Result) -> None:
    run, dear = (priced(small_run, Prices({"hard": HARD}, power, 0.3)) for power in (1e3, 3e3))
    told = {one.name: one for one in quantities_of(run)}
    assert told["money.total"].unit == "EUR/h"
    assert told["money.total"].known
    assert told["money.fan"].value == pytest.approx(0.3)
    less = difference(run.joint.own, dear.joint.own, "money.total")
    assert less is not None
    assert [*less] == pytest.approx([0.6, 0.6, 0.6])  # the fan alone: all that is not known moves both alike
    scene = shipped("vacuum", {"price.value.hard": "200 EUR/t"})
    assert {"money.total", "money.products", "money.fan", "money.fan_power"} <= set(names_for(scene))
    assert not [name for name in names_for(shipped("vacuum")) if name.startswith("money")]


def test_money_is_said_on_the_page_and_on_the_screen(small_run: Result) -> None:
    run = priced(small_run, Prices({"hard": HARD}, 2000.0, 0.3))
    (line,) = money_lines(run)
    assert line.startswith("It earns ")
    assert line.endswith(" EUR/h, less 0.6 EUR/h for a fan that draws 2000 W.")
    assert " to " in line
    (without,) = money_lines(priced(small_run, Prices({"hard": HARD}, None, None)))
    assert "fan" not in without
    (unknown,) = money_lines(priced(small_run, Prices({"hard": HARD}, None, 0.3)))
    assert "the fan's cost is not known" in unknown
    void = replace(run, grades=(Grade.VOID.value,), warnings=("the feed is too dense",))
    assert money_lines(void) == ["Money: void."]
    assert money_lines(small_run) == []


def test_a_run_with_prices_tells_its_money_everywhere_and_flies_nothing_again(
    tmp_path: Path, small_run: Result
) -> None:
    changes = {"price.value.hard": "0.2 EUR/kg", "price.value.soft": {"near": "-30 EUR/t"}}
    scene = Scene.parse(small_run.scene).replace(changes)
    assert unweighed(scene) == unweighed(Scene.parse(small_run.scene))
    run = wf.run(scene, tmp_path / "priced")
    assert run.landings is not None
    money = run.landings.separation.money
    assert money is not None
    assert money.total == money.products
    again = Result.load(tmp_path / "priced")
    assert again.landings is not None
    assert again.landings.separation.money == money
    assert money_lines(run)[0] in (tmp_path / "priced" / "report.html").read_text()
    found = wf.sweep(wf.variants(scene, {"price.value.hard.target": [100.0, 200.0]}), tmp_path / "swept")
    assert main_quantities(found.table)[0] == "money.total"
    low, high = (entry.by_name["money.total"].value for entry in found.table.entries)
    assert high > low


def test_prices_are_read_with_their_units_and_mistakes_are_named() -> None:
    scene = shipped("vacuum", {"price.value.hard": "20 EUR/dt", "price.electricity": "30 ct/kWh",
                               "price.fan_efficiency": "50 %", "price.other_drop": "4 hPa"})  # fmt: skip
    assert scene.price.value["hard"] == {"target": pytest.approx(200.0)}
    assert scene.price.electricity == pytest.approx(0.3)
    assert scene.price.fan_power(100.0, 2.0, 0.5) == pytest.approx((100.0 + 400.0) * 2.0 * 0.5 / 0.5)
    assert scene.price.fan_power(None, 2.0, 0.5) is None
    assert Scene.parse(scene.tables()) == scene
    for changes, message in (
        ({"price.value.hrad": 5.0}, "no fraction; did you mean 'hard'?"),
        ({"price.value.hard": {"nar": 5.0}}, "no bin; did you mean 'near'?"),
        ({"price.value.hard": "200 USD/t"}, "needs a number in EUR/t or a string such as '220 EUR/t'"),
        ({"price.electricity": 0.3}, "price.fan_efficiency: missing"),
        ({"price.fan_efficiency": 0.5}, "price.electricity: missing"),
    ):
        with pytest.raises(wf.SceneError) as caught:
            shipped("vacuum", changes)
        assert message in str(caught.value)


def test_the_fan_gives_the_channel_and_the_rest_their_drop_over_the_depth() -> None:
    keys = {"price.electricity": 0.25, "price.fan_efficiency": 0.5, "price.other_drop": "395 Pa"}
    scene = shipped("rhombus", {**keys, "price.value.wheat": 220.0})

    def prices(drop: float | None) -> Prices:
        flights = SimpleNamespace(scene=scene, airflow=SimpleNamespace(pressure_drop=drop, flow_rate=2.0))
        found = _prices(cast("Pipeline", flights))
        assert found is not None
        return found

    power = (5.0 + 395.0) * 2.0 * 0.3 / 0.5  # W, over a depth of 300 mm
    assert prices(5.0).fan_power == pytest.approx(power)
    assert prices(5.0).fan == pytest.approx(0.25 * power / 1e3)
    assert prices(5.0).value == {"wheat": {"outer-left": 220.0, "outer-right": 220.0}}
    assert (prices(None).fan_power, prices(None).fan) == (None, None)
    assert _prices(cast("Pipeline", SimpleNamespace(scene=shipped("rhombus")))) is None


def test_a_bin_s_own_price_goes_before_that_of_the_targets() -> None:
    scene = shipped("rhombus", {"price.value.wheat": {"target": 200.0, "outer-left": 150.0, "elsewhere": -10.0}})
    targets = {name: tuple(one.targets) for name, one in scene.fraction.items()}
    worth = scene.price.by_bin(targets)["wheat"]
    assert worth == {"outer-left": 150.0, "outer-right": 200.0, "elsewhere": -10.0}
