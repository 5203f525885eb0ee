"""[air.fan]: where a fan's curve meets the machine's pressure drop, and what is made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.air.kinds.airflow_table import Airflow
from wakeflow.answer.budget.budget import _prices
from wakeflow.answer.notices import _off_the_fan
from wakeflow.extras.studies import operating
from wakeflow.laws.operating_point import borne, meeting
from wakeflow.planning.plan import Plan
from wakeflow.planning.scene_lines import trade_lines
from wakeflow.runs.run_stages import CHANNEL, FEW, _blown, as_blown
from wakeflow.scene import Scene

if TYPE_CHECKING:
    from wakeflow.flight.stages.pipeline import Pipeline

G, P0, K = 9.81, 400.0, 2000.0
AREA = 0.2 * 0.3  # m2, of the aspirator


def blown(changes: dict[str, Any] | None = None, name: str = "aspirator") -> Scene:
    """A shipped scene whose air a fan blows, fed without a rate: no weight is borne."""
    tables = shipped(name).tables()
    del tables["air"]["speed"], tables["feed"]["rate"]
    return Scene.parse({**tables, "air": {**tables["air"], "fan": {"p0": P0, "k": K}}}).replace(changes or {})


@pytest.mark.parametrize(
    ("rest", "taken"),
    [
        ({"air.fan.rest_drop": "250 Pa", "air.fan.rest_flow": "1300 m3/hour"}, 250.0 / (1300.0 / 3600.0) ** 2),
        ({"air.fan.rest_loss": 10.0}, 10.0 * 0.5 / AREA**2),  # times the density
        ({"channel.inlet": {}, "air.fan.rest_loss": 0.0}, 0.0),
    ],
)
def test_a_quadratic_curve_meets_a_quadratic_drop_where_both_are_equal(rest: dict[str, Any], taken: float) -> None:
    for ratio in (1.0, 0.7):
        scene = blown({**rest, "air.fan.speed_ratio": ratio})
        air, point = scene.airstream, scene.airstream.point
        assert point is not None
        by_flow = taken * air.density if "air.fan.rest_loss" in rest else taken
        flow = ratio * math.sqrt(P0 / (K + by_flow))
        assert point.flow == pytest.approx(flow, rel=1e-8)
        assert (air.speed, point.speed.value) == (point.speed.value, pytest.approx(flow / AREA, rel=1e-8))
        assert point.pressure == pytest.approx(by_flow * flow**2, rel=1e-6, abs=1e-3)
        assert (point.channel, point.feed, point.others) == (0.0, 0.0, 0)


def test_laminar_air_takes_a_drop_that_grows_with_its_speed() -> None:
    tables = blown().tables()
    tables["channel"] |= {"width": 0.02, "walls": "no-slip"}
    tables["air"] |= {"profile": "parabolic", "turbulence": 0.0, "fan": {"p0": 0.02, "k": 1000.0}}
    tables["feed"]["width"], tables["bin"] = 0.005, {"light": {"on": "top", "from": -0.01, "to": 0.01}}
    tables["bin"]["heavy"] = {"from": -0.01, "to": 0.01}
    air = Scene.parse(tables).airstream
    linear = 12.0 * air.viscosity / 0.02**2 * 1.0 / (0.02 * 0.3)  # Pa s/m3
    flow = (-linear + math.sqrt(linear**2 + 4.0 * 1000.0 * 0.02)) / 2000.0
    assert air.speed == pytest.approx(flow / (0.02 * 0.3), rel=1e-6)


def test_the_feed_weighs_on_the_air_as_long_as_it_is_in_it() -> None:
    """At their terminal velocity granules give the air their whole weight; far from it, none."""
    given = borne(np.array([8.0]), np.array([-5.0]), 3.0, 0.4, 0.6, G)  # they fall at 3 m/s through 0.4 m
    assert given.item() == pytest.approx(G * 0.4 / 3.0, rel=1e-9)
    given = borne(np.array([3.0]), np.array([-5.0]), -2.0, 0.4, 0.6, G)  # they rise at 2 m/s through 0.6 m
    assert given.item() == pytest.approx(G * 0.6 / 2.0, rel=1e-9)
    assert borne(np.array([1e5]), np.array([-5.0]), 1.0, 0.4, 0.6, G).item() == pytest.approx(0.0, abs=1e-6)
    time = 8.0 / G * math.acosh(math.exp(G * 0.4 / 8.0**2))  # from rest, through air at rest
    gained = 8.0 * math.tanh(G * time / 8.0)
    assert borne(np.array([8.0]), np.zeros(1), 0.0, 0.4, 0.6, G).item() == pytest.approx(
        G * time - gained, abs=0.01 * gained
    )

    tables = blown({"feed.rate": "2000 kg/hour", "air.fan.rest_loss": 20.0}).tables()
    tables["fraction"] = {"wheat": {"material": "wheat", "terminal_velocity": 8.0}}
    point = Scene.parse(tables).airstream.point
    assert point is not None
    start = math.sqrt(2.0 * G * 0.02)
    by_hand = borne(np.array([8.0]), np.array([-point.speed.value]), start, 0.4, 0.6, G).item() * 2000.0 / 3600.0 / AREA
    assert point.feed == pytest.approx(by_hand, rel=1e-3)
    assert point.feed > 5.0
    assert point.pressure == pytest.approx(point.rest + point.feed, rel=1e-6)
    assert point.speed.value < Scene.parse(tables).replace({"feed.rate": "1 kg/hour"}).airstream.speed


def test_the_largest_flow_counts_where_a_curve_meets_the_drop_more_than_once() -> None:
    flow, pressure = [0.0, 0.1, 0.2, 0.4], [300.0, 50.0, 280.0, 0.0]  # it stalls between
    keys = {"flow": flow, "pressure": pressure, "rest_loss": 60.0}  # 100 Pa at 0.1, 401 Pa at 0.2 m3/s
    alone = blown({"air.fan": keys}).airstream.point
    assert alone is not None
    assert (alone.flow < 0.1, alone.others) == (True, 0)
    twice = blown({"air.fan": {**keys, "rest_loss": 36.0}})  # 60 and 241 Pa
    assert twice.airstream.point is not None
    assert 0.2 < twice.airstream.point.flow < 0.4
    assert twice.airstream.point.others == 2
    (warned,) = [one.text for one in wf.plan(twice).notices if "lower flow" in one.text]
    assert warned.startswith("the fan's curve meets the machine's pressure drop at 2 lower flows too")
    with pytest.raises(ValueError, match="still gives 1 Pa too much"):
        meeting(lambda q: 3.0 - q, lambda q: 0.0 * q, 2.0)
    with pytest.raises(ValueError, match="at least 1 Pa too little"):
        meeting(lambda q: 3.0 - q, lambda q: 4.0 + q, 3.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"air.speed": 5.0}, "speed does not go with fan"),
        ({"air.fan.flow": [0.0, 1.0]}, "give flow and pressure together, or p0 and k"),
        ({"air.fan": {"flow": [0.0, 1.0], "pressure": [400.0]}}, "as many pressures as flows"),
        ({"air.fan": {"flow": [0.5, 1.0], "pressure": [400.0, 0.0]}}, "flows rise from 0"),
        ({"air.fan": {"rest_loss": 1.0}}, "give the curve"),
        ({"air.fan.rest_drop": 100.0}, "rest_drop is that at rest_flow"),
        ({"air.fan": {"flow": [0.0, 0.1], "pressure": [400.0, 390.0]}}, "the fan still gives 390 Pa too much"),
        ({"feed.rate": "90 t/hour", "feed.width": "200 mm", "air.fan.p0": 1.0}, "too little at every flow"),
        ({"air.fan.k": 1e-3}, "the air would blow at"),
        ({"price.other_drop": 5.0}, "air.fan.rest_drop"),
    ],
)
def test_a_fan_that_blows_no_air_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(wf.SceneError, match=message):
        blown(changes)


def test_the_speed_of_a_fan_is_found_anew_and_is_none_that_was_given() -> None:
    scene = blown({"air.fan.rest_loss": 10.0, "feed.rate": "100 kg/hour"})
    assert "speed" not in scene.tables()["air"]
    again = Scene.parse(scene.tables())
    assert (again, again.airstream.speed) == (scene, scene.airstream.speed)
    assert again.replace({"air.fan.rest_loss": 20.0}).airstream.speed < scene.airstream.speed


# -- the drop that is computed -----------------------------------------------------------------------------------------
LOSS = 5.0  # of the channel below, which nobody knows before; the estimate is 1


@dataclass
class Computed:
    """Stages whose airflow has the drop of a loss coefficient that falls a little with the speed."""

    scene: Scene
    plan: Any = None
    solved: list[float] = field(default_factory=list)
    loss: float = LOSS

    def listener(self, stage: str, text: str) -> None:
        assert (stage, "m/s" in text) == ("airflow", True)

    @cached_property
    def air(self) -> Any:
        air = self.scene.airstream
        self.solved.append(air.speed)
        drop = self.loss * (4.0 / air.speed) ** 0.1 * 0.5 * air.density * air.speed**2
        return SimpleNamespace(numbers=Airflow(verdict="settled", pressure_drop=drop))


def prism(changes: dict[str, Any] | None = None) -> Scene:
    return blown({"air.fan.p0": 90.0, "air.fan.k": 1000.0, **(changes or {})}, "prism")


def blown_by(scene: Scene, loss: float = LOSS) -> Computed:
    plan = wf.plan(scene, rung="draft")
    made = Computed(scene, plan, loss=loss)
    found = _blown(cast("Pipeline", made), partial(wf.plan, rung="draft"))
    assert isinstance(found, Computed)
    return found


def test_the_air_goes_to_where_the_curve_meets_the_computed_drop() -> None:
    """p0 - k Q^2 = c rho U^2 / 2: within the 3 % to which the answer takes the air's speed to be known."""
    scene = prism()
    assert scene.airstream.point is not None
    assert scene.airstream.point.speed.low < scene.airstream.speed < scene.airstream.point.speed.high
    found = blown_by(scene)
    air, area = found.scene.airstream, 0.2 * scene.feed.depth
    by_hand = math.sqrt(90.0 / (1000.0 * area**2 + 0.5 * air.density * LOSS * (4.0 / air.speed) ** 0.1))
    assert air.speed == pytest.approx(by_hand, rel=0.03)
    assert abs(scene.airstream.speed - by_hand) > 0.1 * by_hand
    assert len(found.solved) <= FEW
    assert as_blown(scene, cast("Pipeline", found)).airstream.speed == air.speed
    table = found.air.numbers.by_fan(found.scene, loaded=False)
    assert table.meets == pytest.approx(by_hand, rel=1e-3)
    exact = blown_by(prism({"uncertainty.air.speed": 0.0})).solved
    assert len(exact) <= FEW
    assert exact[-1] == pytest.approx(by_hand, rel=3e-3)


def test_a_speed_that_holds_solves_the_airflow_once() -> None:
    first = blown_by(prism())
    again = blown_by(as_blown(prism(), cast("Pipeline", first)))
    assert again.solved == [first.scene.airstream.speed]


def test_what_is_left_between_curve_and_drop_is_said() -> None:
    scene = prism()
    drop = 40.0 * 0.5 * scene.airstream.density * scene.airstream.speed**2
    airflow = Airflow(verdict="settled", pressure_drop=drop)
    fan = airflow.by_fan(scene, loaded=False)
    assert fan is not None
    told = Airflow(verdict="settled", pressure_drop=drop, fan=fan)
    (notice,) = _off_the_fan(scene, told)
    assert f"computed at {fan.meets:.3g} m/s, the air blows at {scene.airstream.speed:.3g}" in notice.text
    held = scene.replace({CHANNEL: airflow.loss(scene, loaded=False)})
    near = Airflow(verdict="settled", pressure_drop=0.5 * held.airstream.density * held.airstream.speed**2 * 40.0)
    assert not [*_off_the_fan(held, Airflow(verdict="settled", fan=near.by_fan(held, loaded=False)))]
    assert shipped("prism").air is not None
    assert airflow.by_fan(shipped("prism"), loaded=False) is None


# -- what it costs -----------------------------------------------------------------------------------------------------
def test_the_fan_s_power_is_its_pressure_times_its_flow_over_its_efficiency() -> None:
    scene = blown({"air.fan.rest_loss": 10.0, "price": {
        "value": {"wheat": 200.0}, "electricity": 0.25,
        "fan_efficiency": {"flow": ["0 m3/h", "3600 m3/h"], "efficiency": ["20 %", 0.6]},
    }})  # fmt: skip
    point = scene.airstream.point
    assert point is not None
    power = point.pressure * point.flow / (0.2 + 0.4 * point.flow)
    prices = _prices(cast("Pipeline", SimpleNamespace(scene=scene, airflow=None)))
    assert prices is not None
    assert prices.fan_power == pytest.approx(power)
    told = dict(trade_lines(scene))
    assert f"{point.speed.value:.3g} m/s at {3600 * point.flow:.4g} m3/h" in told["fan"]
    assert told["money"].startswith("at most ")
    assert f"{0.25 * power / 1e3:.2g} EUR/h" in told["money"]
    used = wf.plan(scene).used
    assert [line for line in used if line.startswith("fan: ")]
    assert [line for line in used if line.startswith("money: ")]
    assert not dict(trade_lines(shipped("aspirator")))


def test_a_map_turns_the_fan_where_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(operating, "_swept", lambda _scene, axes, *_rest: asked.append(axes))
    operating.operating_map(blown({"feed.rate": 0.01, "air.fan.speed_ratio": 0.5}), "nowhere")
    operating.operating_map(shipped("aspirator"), "nowhere")
    assert asked[0]["air.fan.speed_ratio"] == pytest.approx([0.4, 0.5, 0.6])
    assert "air.speed" in asked[1]


def test_plans_are_of_the_found_speed() -> None:
    assert isinstance(wf.plan(prism(), rung="draft"), Plan)
    assert "speed_ratio" in str(Scene.model_json_schema()["$defs"]["Fan"]["properties"])
