"""Stages of a run are registered objects: one that is added from outside is made, planned, timed, scaled and shown."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from support import shipped
from wakeflow.answer.provenance import KnobSettings
from wakeflow.cli.show_plan import show_plan
from wakeflow.core.sources import code_key
from wakeflow.core.store import Store
from wakeflow.pipeline.cache import StageCache, StageTime, code_of
from wakeflow.planning.machine_rates import STARTS, learn, on_this_machine
from wakeflow.planning.make import make_plan
from wakeflow.planning.stages import OWN, AirLabel, Scaling, Stage, StageCost, StageKey, Workload, stages
from wakeflow.runs.progress import RunProgress
from wakeflow.runs.settings import expected_seconds

COARSE = KnobSettings(granules=1024, tolerance=1e-3, mesh_scale=2.0, averaging=None, slab=None)
FINE = KnobSettings(granules=4096, tolerance=1e-3, mesh_scale=1.0, averaging=None, slab=None)


def weighing(work: Workload) -> Iterator[StageCost]:
    """One thousand seconds for each fraction."""
    yield StageCost(StageKey(OWN, "weights"), 1000.0 * work.fractions, "after")


@pytest.fixture
def weights() -> Iterator[Stage]:
    """An example of a stage, as docs/extending.md shows it, registered and taken out again."""
    code = ("wakeflow.laws.size",)
    yield stages.add("weights", Stage("weights", code, "weighing", Scaling.CELLS, "scales", weighing))
    stages.remove("weights")


@pytest.mark.usefixtures("weights")
def test_a_new_stage_is_made_and_timed(tmp_path: Path) -> None:
    heard: list[str] = []
    cache = StageCache(Store(tmp_path), lambda stage, _: heard.append(stage), {}, AirLabel(grid=1.5))
    cache.make("weights", code_of("weights"), lambda folder: (folder / "kg").write_text("1"))
    (key,) = cache.seconds
    assert isinstance(key, StageKey)
    assert (key, key.label.grid, key.stage.heading) == ("grid x 1.5 weights", 1.5, "scales")
    assert heard == ["grid x 1.5 weights"]
    assert code_of("weights") == code_key("wakeflow.laws.size")


@pytest.mark.usefixtures("weights")
def test_a_new_stage_is_planned_learned_and_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = shipped("vacuum")
    plan = make_plan(scene)
    (planned,) = [stage for stage in plan.stages if stage.name == "weights"]
    assert planned.seconds == 1000.0 * len(scene.fraction)
    show_plan(plan, scene)
    assert "(scales " in capsys.readouterr().out.replace("\n", " ")
    learn(tmp_path, plan.stages, {"weights": 2.0 * planned.seconds})
    here = {stage.name: stage.seconds for stage in on_this_machine(plan, tmp_path)[0]}
    rate = (2.0 * planned.seconds + STARTS) / (planned.seconds + STARTS)
    assert here["weights"] == pytest.approx(rate * planned.seconds)
    assert here["tracks"] in {stage.seconds for stage in plan.stages if stage.name == "tracks"}


@pytest.mark.usefixtures("weights")
def test_a_new_stage_has_its_own_pace_and_scaling() -> None:
    progress = RunProgress(clock=lambda: 0.0)
    progress.begin([StageCost("weights", 10.0, "after"), StageCost("tracks", 10.0, "after")], cores=2)
    progress.took, progress.done["weights"] = {"weights": 40.0}, 1
    assert progress.left == pytest.approx(2.0 + 10.0)  # a slow weighing says nothing of flights
    spent = {"weights": StageTime(5.0, False)}
    assert expected_seconds(spent, COARSE, FINE) == 20.0


def test_an_unknown_stage_is_one_in_which_granules_fly_again() -> None:
    key = StageKey(OWN, "steady wake")
    assert (key.stage.scaling, key.stage.work, key.heading) == (Scaling.FLIGHTS, "flights", "companions")


def test_labels_are_as_they_are_read() -> None:
    assert str(OWN) == ""
    assert str(AirLabel(grid=1.4142, draft=True)) == "grid x 1.4 draft "
    assert str(AirLabel(neighbour=True)) == "neighbour "
