"""Stages of a run are registered objects: one that is added from outside is made, planned, timed, scaled and shown."""

import json
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import CASES, shipped
from wakeflow.answer.budget.source import budget_sources
from wakeflow.answer.provenance import RefinedSettings
from wakeflow.core.code_key import code_key
from wakeflow.core.files import write_json
from wakeflow.core.store import Store
from wakeflow.flight.stages.machine_rates import STARTS, learn, note_compiled, on_this_machine, to_compile
from wakeflow.planning.cost import COMPILE, STARTED, begins, wall_seconds
from wakeflow.planning.plan import Plan
from wakeflow.planning.stage_cache import StageCache, StageTime, StageTimes, code_of
from wakeflow.planning.stages import OWN, AirLabel, Scaling, Stage, StageCost, StageKey, Workload, stages
from wakeflow.runs.planned import make_plan
from wakeflow.runs.progress import RunProgress
from wakeflow.runs.time_budget import RoundPrices
from wakeflow.show.plan_words import cost_words

COARSE = RefinedSettings(granules=1024, tolerance=1e-3, mesh_scale=2.0, averaging=None, slab=None)
FINE = RefinedSettings(granules=4096, tolerance=1e-3, mesh_scale=1.0, averaging=None, slab=None)


def weighing(work: Workload) -> Iterator[StageCost]:
    """One thousand seconds for each fraction."""
    yield StageCost(StageKey(OWN, "weights"), 1000.0 * work.fractions, "after")


@pytest.fixture
def weights() -> Iterator[Stage]:
    """An example of a stage, as docs/extending.md shows it, registered and taken out again."""
    yield stages.add("weights", Stage("weights", "weighing", Scaling.CELLS, "scales", weighing))
    stages.remove("weights")


@pytest.mark.usefixtures("weights")
def test_a_new_stage_is_made_and_timed(tmp_path: Path) -> None:
    heard: list[str] = []
    cache = StageCache(Store(tmp_path), lambda stage, _: heard.append(stage), StageTimes(), AirLabel(grid=1.5))
    cache.make("weights", code_of("laws.size"), lambda folder: (folder / "kg").write_text("1"))
    (key,) = cache.seconds
    assert isinstance(key, StageKey)
    assert (key, key.label.grid, key.stage.heading) == ("grid x 1.5 weights", 1.5, "scales")
    assert heard == ["grid x 1.5 weights"]
    assert code_of("laws.size") == code_key("wakeflow.laws.size")


@pytest.mark.usefixtures("weights")
def test_a_new_stage_is_planned_learned_and_shown(tmp_path: Path) -> None:
    scene = shipped("vacuum")
    plan = make_plan(scene)
    (planned,) = [stage for stage in plan.stages if stage.name == "weights"]
    assert planned.seconds == 1000.0 * len(scene.fraction)
    assert "(scales " in cost_words(plan, *on_this_machine(plan, tmp_path))
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
    assert progress.left == pytest.approx(STARTED + 10.0)  # a slow weighing says nothing of flights
    spent = {"weights": StageTime(5.0, False)}
    assert RoundPrices.measured(spent, COARSE).at(FINE).seconds == 20.0


def test_an_unknown_stage_is_one_in_which_granules_fly_again() -> None:
    key = StageKey(OWN, "steady wake")
    assert (key.stage.scaling, key.stage.work, key.heading) == (Scaling.FLIGHTS, "flights", "companions")


def test_labels_are_as_they_are_read() -> None:
    assert str(OWN) == ""
    assert str(AirLabel(grid=1.4142, draft=True)) == "grid x 1.4 draft "
    assert str(AirLabel(neighbour=True)) == "neighbour "


# Seconds of the stages of `wakeflow run cases/rhombus.toml` on two idle cores
MEASURED = {"mesh": 3.6, "draft mesh": 1.5, "draft airflow": 13.0, "airflow": 27.0, "tracks": 3.3, "slab": 7.2,
            "companion": 3.0, "draws": 3.5, "grid x 1.5 early-airflow": 14.0, "grid x 1.5 airflow": 13.0}  # fmt: skip
WHOLE = 101.0


@pytest.fixture(scope="module")
def plan() -> Plan:
    return make_plan(shipped("rhombus"))


def test_each_stage_is_expected_to_take_what_it_took(plan: Plan) -> None:
    expected = {stage.name: stage.whole for stage in plan.stages}
    off = {name: expected[name] / seconds for name, seconds in MEASURED.items()}
    assert not {name: ratio for name, ratio in off.items() if not 1 / 1.5 < ratio < 1.5}
    assert WHOLE / 1.5 < plan.estimate["seconds"] < WHOLE * 1.5


def test_what_needs_no_airflow_is_done_beside_it() -> None:
    stages = [StageCost("airflow", 100.0, "answer"), StageCost("grid x 1.5 airflow", 30.0, "beside", times=2)]
    assert wall_seconds(stages, cores=2) == wall_seconds(stages[:1])
    assert wall_seconds(stages, cores=1) == wall_seconds(stages[:1]) + 60.0
    last = StageCost("tracks", 10.0, "after")
    assert np.diff(list(begins([*stages, last], cores=2))).tolist() == [0.0, 100.0]
    assert np.diff(list(begins([*stages, last], cores=1))).tolist() == [100.0, 60.0]


@pytest.mark.parametrize(
    ("label", "stage", "text", "work", "heading"),
    [(AirLabel(draft=True), "loaded-airflow", "draft loaded-airflow", "airflow", "air loading"),
     (AirLabel(grid=1.5), "mesh", "grid x 1.5 mesh", "mesh", "other meshes"),
     (AirLabel(grid=1.5, draft=True), "field", "grid x 1.5 draft field", "field", "other meshes"),
     (AirLabel(neighbour=True), "airflow", "neighbour airflow", "airflow", "airflow"),
     (OWN, "slab longer steps", "slab longer steps", "slab", "slab"),
     (OWN, "thinner slab", "thinner slab", "slab", "slab"),
     (OWN, "time-resolved wake", "time-resolved wake", "flights", "companions"),
     (OWN, "draws", "draws", "flights", "draws")],
)  # fmt: skip
def test_a_stage_is_one_kind_of_work(label: AirLabel, stage: str, text: str, work: str, heading: str) -> None:
    assert list(budget_sources)  # of which the slab's register stages
    key = pickle.loads(pickle.dumps(StageKey(label, stage)))  # as a plan travels to another process
    assert (key, key.stage.work, key.heading) == (text, work, heading)


def test_a_machine_is_known_by_its_runs(plan: Plan, tmp_path: Path) -> None:
    fresh, runs = on_this_machine(plan, tmp_path)
    assert runs == 0
    assert [stage for stage in fresh if stage.name != COMPILE.name] == list(plan.stages)

    twice = {stage.name: 2.0 * stage.whole for stage in plan.stages if stage.key.stage.work == "flights"}
    for slower in (2.0, 1.0, 40.0):  # the last one beside other programs: the median leaves it out
        learn(tmp_path, plan.stages, {name: slower / 2.0 * seconds for name, seconds in twice.items()})
    here, runs = on_this_machine(plan, tmp_path)
    assert runs == 3
    meant = sum(twice.values()) / 2.0
    rate = (2.0 * meant + STARTS) / (meant + STARTS)  # a little below two: programs start, too
    for stage, own in zip([one for one in here if one.name != COMPILE.name], plan.stages, strict=True):
        assert stage.seconds == pytest.approx(own.seconds * (rate if own.name in twice else 1.0), rel=1e-3)


def test_a_run_of_seconds_tells_little_of_one_of_minutes(plan: Plan, tmp_path: Path) -> None:
    """Of coarse runs starting the programs is the most: five times as long as expected is none of a full one's pace."""
    air = [stage for stage in plan.stages if stage.key.stage.work == "airflow"]
    coarse = [replace(stage, seconds=0.01 * stage.seconds) for stage in air]
    for _ in range(4):
        learn(tmp_path, coarse, {stage.name: 5.0 * stage.seconds for stage in coarse})
    expected, after_coarse = (sum(one.seconds for one in air), _of_air(plan, tmp_path))
    assert expected < after_coarse < 1.5 * expected
    learn(tmp_path, air, {stage.name: 0.9 * stage.seconds for stage in air})
    assert _of_air(plan, tmp_path) == pytest.approx(0.9 * expected, rel=0.1)


def _of_air(plan: Plan, root: Path) -> float:
    return sum(one.seconds for one in on_this_machine(plan, root)[0] if one.key.stage.work == "airflow")


@pytest.mark.parametrize("text", ['{"mesh": [1.2, 0.9]}', '{"mesh": []}', "[]", "{"])
def test_a_note_of_another_version_or_damaged_teaches_nothing(plan: Plan, tmp_path: Path, text: str) -> None:
    (tmp_path / "machine-rates.json").write_text(text)
    assert on_this_machine(plan, tmp_path)[1] == 0


def test_what_came_from_the_cache_teaches_nothing(plan: Plan, tmp_path: Path) -> None:
    learn(tmp_path / "cache", plan.stages, {})
    assert not (tmp_path / "cache").exists()


def test_a_machine_keeps_its_last_runs(plan: Plan, tmp_path: Path) -> None:
    for number in range(20):
        learn(tmp_path, plan.stages, {"mesh": 1.0 + number})
    (noted,) = json.loads((tmp_path / "machine-rates.json").read_text()).values()
    assert len(noted) == 9
    assert noted == sorted(noted)


def test_the_compilation_is_expected_until_it_is_done(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wakeflow.flight.stages.machine_rates.kernel_folder", lambda module: tmp_path / "kernels")
    (compiled,) = (stage for stage in on_this_machine(plan, tmp_path)[0] if stage.name == COMPILE.name)
    assert compiled.when == "beside"
    assert compiled.memory > 1e9  # measured: 650 MB of the process that compiles, next to a run of 400 MB
    write_json(tmp_path / "kernels" / "loop" / "fly_block.nbi", None)
    assert not [stage for stage in on_this_machine(plan, tmp_path)[0] if stage.name == COMPILE.name]


def test_the_compilation_is_expected_to_take_what_it_last_took_here(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wakeflow.flight.stages.machine_rates.kernel_folder", lambda module: tmp_path / module)
    monkeypatch.setattr("wakeflow.flight.stages.machine_rates.kernel_root", lambda: tmp_path)
    usual = to_compile()
    assert min(usual.values()) > 10.0  # measured: tens of processor seconds each
    note_compiled("slab", 300.0)
    assert to_compile() == usual | {"slab": 300.0}
    assert to_compile(slab=False) == {"tracker": usual["tracker"]}
    (tmp_path / "compile-seconds.json").write_text('{"slab": "soon"}')
    assert to_compile() == usual


SCENES = [path.stem for path in sorted(CASES.glob("*.toml")) if "[channel]" in path.read_text()]


@pytest.mark.parametrize("name", SCENES)
def test_a_plan_that_was_sent_is_the_same_and_stays_read_only(name: str) -> None:
    plan = make_plan(CASES / f"{name}.toml")
    sent = pickle.loads(pickle.dumps(plan))
    assert sent == plan
    assert [row.tracked for row in sent.fractions.values()] == [row.tracked for row in plan.fractions.values()]
    with pytest.raises(TypeError):
        sent.fractions["more"] = None
