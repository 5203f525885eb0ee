"""What the air lifts, said before anything is computed; and targets and floors that lose granules."""

from __future__ import annotations

import pytest

import wakeflow as wf
from support import shipped
from wakeflow.planning.scene_lines import floor_notices, lifting_line, lifting_notices, narrowest_gap


def test_the_gap_is_the_flow_over_what_bodies_leave_free() -> None:
    """A prism of 60 mm in 200 mm leaves 140 mm: 6 m/s are 8.57 m/s."""
    gap = narrowest_gap(shipped("prism", {"body.prism.width": "60 mm", "air.speed": "6 m/s"}))
    assert (gap.bodies, gap.free) == (("prism",), pytest.approx(0.14, rel=1e-4))
    assert gap.speed == pytest.approx(60.0 / 7.0, rel=1e-4)
    assert not narrowest_gap(shipped("vacuum")).bodies
    assert not narrowest_gap(shipped("aspirator")).bodies


def test_bodies_side_by_side_narrow_the_channel_together() -> None:
    gap = narrowest_gap(shipped("labyrinth"))
    assert gap.bodies == ("left-prism", "right-prism")


def test_the_plan_says_what_is_lifted_in_the_gap() -> None:
    scene = shipped("prism", {"body.prism.width": "60 mm", "air.speed": "6 m/s", "air.direction": "up"})
    plan = wf.plan(scene)
    told = lifting_line(scene, plan.fractions)
    assert told.startswith("6 m/s up, 8.6 m/s beside prism (0.14 m of 0.2 m are free): ")
    assert "wheat (7.5 to 8.1 m/s) is lifted beside it" in told
    assert "chaff (1.5 to 2 m/s) is lifted, " in told
    down = lifting_line(shipped("rhombus"), wf.plan(shipped("rhombus")).fractions)
    assert "is lifted behind it" in down
    assert down.endswith("wheat (7.3 to 8.2 m/s) falls")
    assert lifting_line(shipped("vacuum"), {}) == ""


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"air.speed": "40 m/s"}, "lifts every fraction"),
        ({"air.speed": "0.01 m/s"}, "lifts no fraction"),
        ({"air.direction": "down"}, "fraction.chaff.target lies above the feed, but chaff falls"),
        ({"air.speed": "20 m/s"}, "fraction.wheat.target lies below the feed, but the air of 20 m/s up lifts wheat"),
    ],
)
def test_air_that_separates_nothing_and_targets_out_of_reach_are_told(changes: dict[str, object], said: str) -> None:
    plan = wf.plan(shipped("prism", changes))
    assert any(said in warning for warning in plan.warnings)


@pytest.mark.parametrize("name", ["rhombus", "prism", "aspirator", "labyrinth"])
def test_the_shipped_machines_are_not_doubted(name: str) -> None:
    scene = shipped(name)
    assert not list(lifting_notices(scene, wf.plan(scene).fractions))
    assert not list(floor_notices(scene))


def test_a_part_of_the_floor_without_a_bin_is_told() -> None:
    scene = shipped("rhombus", {"bin.outer-left.from": "-150 mm"})
    (notice,) = floor_notices(scene)
    assert notice.text.startswith("no bin on the floor from x = -0.2 m to -0.15 m")
