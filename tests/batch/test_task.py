"""A search from its file to its answer, on granules without air."""

from pathlib import Path

import pytest

import wakeflow as wf
from support import CASES, Here, shipped
from wakeflow.batch.axis import Axis, axis_of_text
from wakeflow.batch.task import Goal, QuantityLimit, SearchTask, read_search_file
from wakeflow.cli.show_many import show_search
from wakeflow.core.errors import SceneError

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
        (("[search]", "[sweep]"), r"holds \[search\] only"),
        (('"recovery.wheat"', '["recovery.hweat"]'), "no quantity 'recovery.hweat'; did you mean 'recovery.wheat'?"),
        (("purity.outer-left", "purity.outer-lift"), "did you mean 'purity.outer-left.wheat'?"),
        (("air.speed", "air.sped"), "within.air.sped: unknown key 'sped'; did you mean 'speed'?"),
        (("body.rhombus", "body.hedge"), r"unknown key 'hedge' \(known: rhombus\)"),
        (("feed.count", "feed.cuont"), "level.feed.cuont: unknown key 'cuont'; did you mean 'count'?"),
        (('from = "3 m/s"', 'from = "9 m/s"'), "within.air.speed: from must be below to"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(change: tuple[str, str], said: str, tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(FILE.replace(*change, 1))
    with pytest.raises(SceneError, match=said) as caught:
        read_search_file(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_search_sweeps_its_levels_and_goes_on_where_it_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second call computes nothing and finds the same. Figures are drawn as in any sweep."""
    monkeypatch.setattr("wakeflow.report.many.draw_table_figures", lambda folder, table: None)
    scene, here = shipped("rhombus", {"numerics.rung": "none"}), Here()
    tied = "bin.middle.to = bin.inner-right.from = -bin.middle.from = -bin.inner-left.to"
    axes = (axis_of_text("feed.height=60:140:2 mm"), Axis(tied, ("60 mm", "100 mm"), (60.0, 100.0), "mm"))
    levels = ({"feed.count": 16}, {"feed.count": 32})
    task = SearchTask(scene, axes, (Goal("recovery.wheat"),), budget=1.0, levels=levels, at_a_time=2)
    found = wf.search(task, tmp_path, scheduler=here)
    assert found.tried == (2, 1)
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
    assert all(word in told for word in ("stands", "beyond the limits" if not own.allowed else "recommended"))
