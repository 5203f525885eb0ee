"""Shares of runs in three dimensions stand beside the answer of the machine that they were found in, and no other's."""

from types import SimpleNamespace
from typing import Any

import pytest

from support import shipped
from wakeflow.answer.budget.model import FACTORS, in_three_dimensions, span_shares
from wakeflow.answer.budget.source import budget_sources
from wakeflow.runs.planned import make_plan
from wakeflow.scene import RESERVED_BIN, Scene

PRISM = {"body.rhombus.shape": "prism", "body.rhombus.slope_angle": "60 deg"}


def beside(scene: Scene, rung: str = "standard") -> Any:
    return in_three_dimensions(scene, make_plan(scene, rung=rung))


@pytest.mark.parametrize(
    ("body", "dust"),
    [
        ({}, 0.902),
        ({"feed.rate": "1 kg/h"}, 0.95),
        ({**PRISM, "body.rhombus.apex": "up"}, 0.981),
        ({**PRISM, "body.rhombus.apex": "down"}, 0.746),
    ],
)
def test_the_bodies_of_the_study_have_their_own(body: dict[str, Any], dust: float) -> None:
    found = beside(shipped("rhombus", body))
    assert list(found) == ["dust"]
    assert list(found["dust"]) == ["middle"]
    share = found["dust"]["middle"]
    assert share.value == pytest.approx(dust)
    assert share.low < share.value < share.high


@pytest.mark.parametrize(
    "changes",
    [
        {"body.rhombus.slope_angle": "50 deg"}, {"channel.width": "600 mm"}, {"fraction.dust.size.median": "60 um"},
        {"bin.middle.to": "70 mm"}, {"air.direction": "up"}, {"feed.position": "10 mm"}, {"feed.width": "60 mm"},
        {"fraction.dust.terminal_velocity": 0.04}, {"body.rhombus.at": [0.02, 0.0]},
    ],
)  # fmt: skip
def test_another_machine_has_none(changes: dict[str, Any]) -> None:
    assert not beside(shipped("rhombus", changes))


def test_one_resolved_in_three_dimensions_or_without_a_wake_in_time_has_none(rhombus: Scene) -> None:
    assert not beside(rhombus, "3d")
    assert not beside(rhombus, "draft")


def test_the_same_machine_at_another_size_has_the_same(rhombus: Scene) -> None:
    """Twice as large, with granules that take twice as long to follow."""
    lengths = {
        "body.rhombus.width": 0.1, "channel.width": 0.8, "channel.top": 0.4, "channel.bottom": -0.4, "feed.width": 0.08,
        "feed.height": 0.2, "bin.middle.from": -0.16, "bin.middle.to": 0.16, "bin.inner-left.from": -0.27,
        "bin.inner-left.to": -0.16, "bin.inner-right.from": 0.16, "bin.inner-right.to": 0.27,
        "bin.outer-left.from": -0.4, "bin.outer-left.to": -0.27, "bin.outer-right.from": 0.27,
        "bin.outer-right.to": 0.4, "feed.rate": "1000 kg/h",
    }  # fmt: skip
    larger = rhombus.replace({**lengths, "fraction.dust.size.median": "57 um"})  # twice the relaxation time
    assert beside(larger) == beside(rhombus) != {}


def test_every_entry_has_all_numbers() -> None:
    for name, one in span_shares().items():
        assert all(one[number] > 0.0 for number in FACTORS if number != "loading"), name
        for share in (one["share"], one["plane"]):
            assert 0.0 < share[0] < share[1] < 1.0


def test_the_distance_from_the_plane_share_widens_the_interval() -> None:
    """Of dust with 84.8 % in the plane air and 95 % in three dimensions, in air that does not feel it; where 91 % land,
    6 points are left.
    """
    scene = shipped("rhombus", {"feed.rate": "1 kg/h"})
    places = [*scene.bin, RESERVED_BIN]
    shares = dict(zip(places, (0.91, 0.06, 0.03, 0.0, 0.0, 0.0), strict=True))
    asked: Any = SimpleNamespace(
        name="dust", shares=shares, pipeline=SimpleNamespace(scene=scene, plan=make_plan(scene))
    )
    found = {place: parts[0].error for place, parts in budget_sources["three-dimensions"].shares(asked).items()}
    odds = 0.91 / 0.09 * (0.95 / 0.05) / (0.848 / 0.152)
    assert found["middle"] == pytest.approx(odds / (1.0 + odds) - 0.91, rel=0.02)  # and what both leave open
    assert found["inner-left"] == pytest.approx(2.0 * found["inner-right"])
    assert found["inner-left"] + found["inner-right"] == pytest.approx(found["middle"])
    asked.name = "wheat"
    assert budget_sources["three-dimensions"].shares(asked) == {}
