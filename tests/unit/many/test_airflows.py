"""Airflows of a sweep: each solved once, kept once on the disk, started from each other; the answer stays."""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import wakeflow as wf
from support import ALONE, shipped
from wakeflow.answer.result import Request
from wakeflow.core.errors import SceneError
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.many import agenda as run_agenda
from wakeflow.many.agenda import Job, Step, make_agenda, starts
from wakeflow.runs import report_again
from wakeflow.runs.planned import make_plan

COARSE = {"numerics.mesh_scale": 3.0, "feed.count": 256, "feed.rate": "0.5 kg/hour"}  # too few to meet or load the air


def test_the_most_central_starts_from_rest_and_the_others_from_the_nearest() -> None:
    speeds = [{"air.speed": float(speed)} for speed in (3, 4, 5, 6, 7)]
    assert starts(speeds) == [2, 2, 2, 2, 2]  # 4 is as near to 3 as to 5, which is there first
    assert starts([{"air.speed": float(speed)} for speed in range(11)])[:3] == [5, 0, 0]
    two = [{"air.speed": 1.0, "body.shape": shape} for shape in ("prism", "rhombus", "rhombus")]
    two.append({"air.speed": 1.1, "body.shape": "prism"})
    assert starts(two) == [1, 1, 1, 1]  # speeds span 1.0 to 1.1: as far apart as two shapes
    assert starts([]) == []
    assert starts([{}]) == [0]
    assert starts([{"a": 1.0}, {"a": 1.0}]) == [0, 0]


def test_an_airflow_waits_for_the_one_that_it_starts_from(tmp_path: Path) -> None:
    found = wf.variants(shipped("rhombus", COARSE), ["air.speed=4,5,6", "fraction.chaff.restitution=0.2,0.3"])
    cold, warm = (
        make_agenda(found, tmp_path, Request(None, "draft", {}, None), neighbours=near) for near in (False, True)
    )
    airflows = [step for step in warm.steps if step.airflow]
    roots = [step for step in airflows if not step.needs]
    assert len(airflows) == 3
    assert len(roots) == 1
    assert {step.needs for step in airflows} == {"", roots[0].name}
    for step in warm.steps:  # flights ask for the air that was solved so
        if not step.airflow:
            speed = step.job.tables["air"]["speed"]
            assert (step.job.request.near is None) == (speed == roots[0].job.tables["air"]["speed"])
    assert cold.stamps != warm.stamps
    again = make_agenda(found[::-1], tmp_path, Request(None, "draft", {}, None), neighbours=True)
    assert again.stamps == warm.stamps


def test_where_a_neighbour_fails_the_others_start_from_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = wf.variants(shipped("rhombus", COARSE), ["air.speed=4,5"])
    asked: dict[float, str | None] = {}

    def solve(job: Job) -> str:
        speed = float(job.tables["air"]["speed"])
        asked[speed] = job.request_now.near
        return "no luck" if job.request.near is None else ""

    monkeypatch.setattr(run_agenda, "solve_airflow_of", solve)
    monkeypatch.setattr(run_agenda, "fly_scene", lambda job: "")
    agenda = make_agenda(found, tmp_path, Request(None, "draft", {}, None), neighbours=True)
    ends: dict[str, str] = {}
    with ThreadPoolExecutor(1) as pool:
        run_agenda.do_agenda(agenda, pool, lambda _: None, lambda step, end: ends.update({step.name: end}))
    assert asked == {4.0: None, 5.0: None}
    assert sorted(bool(end) for name, end in ends.items() if not name.startswith("airflows")) == [False, True]


@pytest.mark.openfoam
def test_the_answer_does_not_hang_on_where_the_airflow_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another speed, another mesh: fewer iterations, the same drag and shares within what they are said to be."""
    base = shipped("rhombus", {**COARSE, "feed.count": 64})
    first = wf.run(base, tmp_path / "first", rung="draft", until="airflow", report=False)
    other = base.replace({"air.speed": 5.5, "numerics.mesh_scale": 2.85})
    rest = wf.run(other, tmp_path / "rest", rung="draft", report=False)
    near = wf.run(other, tmp_path / "near", rung="draft", near=tmp_path / "first", report=False)
    steps = [run.table["airflow"]["steps"] for run in (first, rest, near)]
    assert steps[2] < 0.9 * steps[1]
    drag = [run.table["airflow"]["cd"]["value"] for run in (rest, near)]
    assert drag[1] == pytest.approx(drag[0], rel=2e-3)
    for name, row in rest.separation["fractions"].items():
        for place, share in row.items():
            assert near.separation["fractions"][name][place]["value"] == pytest.approx(share["value"], abs=0.02)
    assert near.key != rest.key
    options: dict[str, Any] = json.loads((tmp_path / "near" / "result.json").read_text())["options"]
    assert options["near"] == str(tmp_path / "first")
    drawn: list[Pipeline] = []
    monkeypatch.setattr("wakeflow.runs.one_run.report_into", lambda pipeline, *_, **__: drawn.append(pipeline))
    report_again(tmp_path / "near")  # finds the airflow that was started so
    (again,) = drawn
    assert again.seconds["airflow"].cached
    assert again.air.key != Pipeline(again.scene, again.plan).air.key


def test_a_wake_in_time_starts_from_the_neighbours_on_every_grid() -> None:
    """What it is then like: tests/unit/air/test_airflow.py, where a wake starts from a similar one."""
    base = shipped("rhombus", {"numerics.mesh_scale": 4.0, "numerics.rung": "standard"})
    known = Pipeline(base, make_plan(base, force=ALONE)).airs
    other = base.replace({"air.speed": 6.0})
    plan = make_plan(other, force=ALONE)
    rest, near = (Pipeline(other, plan, near=one).airs for one in (None, known))
    assert len(plan.airflow.scales) == len(known.resolved) > 1
    assert [air.start for air in near.resolved] == [*known.resolved]
    assert [air.start for air in near.steady] == [*known.steady]
    assert [air.start for air in rest.resolved] == [*rest.resolved[1:], rest.steady[-1]]  # the next coarser grid's
    assert [air.start for air in rest.steady] == [None] * len(rest.steady)


def test_a_start_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    scene = shipped("rhombus", COARSE)
    with pytest.raises(SceneError, match="own folder"):
        wf.run(scene, tmp_path, near=tmp_path)
    with pytest.raises(SceneError, match="holds no finished run"):
        wf.run(scene, tmp_path / "run", near=tmp_path / "nothing")


@pytest.mark.openfoam
def test_a_change_of_restitution_solves_no_airflow(tmp_path: Path) -> None:
    """Two scenes fly at once in one airflow, which neither of them solves."""
    few = {"feed.count": 64, "feed.rate": "0.5 kg/hour"}  # that neither meet nor load the air
    scene = shipped("rhombus", {"numerics.mesh_scale": 3.0, **few})
    found = wf.variants(scene, {"fraction.chaff.restitution": [0.21, 0.34]})
    sweep = wf.sweep(found, tmp_path, rung="draft", workers=2, figures=False)
    assert sweep.failed == {}
    assert len(list((tmp_path / "airflows").iterdir())) == 1
    stages = [json.loads((tmp_path / one.name / "result.json").read_text())["seconds"] for one in found]
    assert all(seconds["airflow"]["cached"] and seconds["mesh"]["cached"] for seconds in stages)
    assert len({seconds["airflow"]["seconds"] for seconds in stages}) == 1
    drag = [entry.by_name["airflow.cd"] for entry in sweep.table.entries]
    assert drag[0] == drag[1]
    assert drag[0].value > 1.0


def test_runs_in_one_airflow_share_the_fields_files(tmp_path: Path) -> None:
    scene = shipped("aspirator", {"feed.count": 16, "numerics.mesh_scale": 2.0})
    first, second = (
        wf.run(scene.replace({"fraction.straw.target": target}), tmp_path / target, force=ALONE).folder / "field.vtu"
        for target in ("light", "heavy")
    )
    assert first.samefile(second)
    before = first.read_bytes()
    wf.run(scene.replace({"air.speed": 5.0}), tmp_path / "heavy", force=ALONE)  # another airflow in the second folder
    assert not first.samefile(second)
    assert first.read_bytes() == before


def _step(name: str, *, airflow: bool, needs: str, seconds: float) -> Step:
    job = SimpleNamespace(threads=1)
    return Step(name, job, airflow, needs, seconds, 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("slow", [(1.0, 1.0), (2.5, 0.5), (0.4, 3.0)])
def test_the_time_left_of_a_sweep_is_true(slow: tuple[float, float]) -> None:
    """Two workers, three airflows, twelve scenes in them: as the plan expects, and where it is wrong of either kind."""
    steps = [_step(f"air {i}", airflow=True, needs="", seconds=60.0) for i in range(3)]
    steps += [_step(f"scene {i}", airflow=False, needs=f"air {i % 3}", seconds=40.0) for i in range(12)]
    now, told, running, todo = 0.0, list[tuple[float, float, str]](), dict[str, float](), list(steps)
    progress = run_agenda.SweepProgress(steps, 2, clock=lambda: now)
    while running or todo:
        for step in [one for one in todo if not one.needs or one.needs in progress.took][: 2 - len(running)]:
            todo.remove(step)
            progress.begin([step])
            running[step.name] = now + step.seconds * slow[0 if step.airflow else 1]
        told.append((now, progress.left, str(progress)))
        now = min(running.values())
        for name in [name for name, end in running.items() if end <= now]:
            del running[name]
            progress.end(next(one for one in steps if one.name == name), "")
    right = [left / (now - at) for at, left, _ in told]
    known = right if slow == (1.0, 1.0) else right[6:]  # of each kind some have ended
    assert all(1 / 1.5 < one < 1.5 for one in known), right
    assert told[0][2].startswith("0 of 12 scenes, 0 of 15 stages, about ")
    assert str(progress) == "12 of 12 scenes, 15 of 15 stages"


def test_the_time_left_of_a_sweep_falls_while_nothing_ends_and_never_grows_by_more_than_a_quarter() -> None:
    now = 0.0
    steps = [_step(f"scene {i}", airflow=False, needs="", seconds=40.0) for i in range(3)]
    progress = run_agenda.SweepProgress(steps, 1, clock=lambda: now)
    progress.begin(steps[:1])
    assert str(progress) == "0 of 3 scenes, 0 of 3 stages, about 2 min left"
    now = 40.0 + run_agenda.STARTS
    progress.end(steps[0], "")
    progress.begin(steps[1:])
    assert str(progress) == "1 of 3 scenes, 1 of 3 stages, about 80 s left"
    now = 75.0 + run_agenda.STARTS
    assert str(progress) == "1 of 3 scenes, 1 of 3 stages, about 45 s left"
    now = 200.0  # the second takes four times as long
    assert str(progress) == "1 of 3 scenes, 1 of 3 stages, at least 56 s left"


def test_the_time_left_of_a_short_sweep_is_true() -> None:
    """Two workers that take 3.5 s to start, scenes in 2.7 s each of which 6.6 s were expected, as measured on an idle
    machine: from the first scenes on.
    """
    steps = [_step(f"scene {i}", airflow=False, needs="", seconds=6.6) for i in range(6)]
    now = 0.0
    progress = run_agenda.SweepProgress(steps, 2, clock=lambda: now)
    right = []
    for i in range(0, 6, 2):
        progress.begin(steps[i : i + 2])
        now += 2.7 + 3.5 * (i == 0)
        for step in steps[i : i + 2]:
            progress.end(step, "")
        right.append((progress.left, 2.7 * (4 - i) / 2))
    assert all(truth / 1.5 <= left <= 1.5 * truth for left, truth in right), right


def test_a_sweep_says_a_line_a_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_agenda, "fly_scene", lambda job: str(time.sleep(0.3) or ""))
    monkeypatch.setattr(run_agenda, "LOOK_EVERY", 0.01)
    scene = shipped("vacuum", {"feed.count": 16})
    found = wf.variants(scene, {"fraction.hard.restitution": [0.4, 0.6, 0.8]})
    agenda, told = make_agenda(found, tmp_path, Request(None, None, {}, None)), list[str]()
    with ThreadPoolExecutor(1) as pool:
        run_agenda.do_agenda(agenda, pool, told.append, lambda *_: None)
    assert [one.partition(" scenes")[0] for one in told] == ["0 of 3", "1 of 3", "2 of 3", "done 3 of 3"]
    assert all(" left" in one for one in told[:-1])
    run_agenda.do_agenda(run_agenda.Agenda((), {}, {}), pool, told.append, lambda *_: None)
    assert len(told) == 4
