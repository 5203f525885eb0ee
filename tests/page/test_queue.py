"""Runs one after the other: each is computed as its scene was, stops and goes on, and says what went wrong."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import wakeflow as wf
from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.page.job import compute
from wakeflow.page.queue import DONE, FAILED, GOES, STOPPED, WAITS, Run, RunQueue, first_look
from wakeflow.scene import Scene

TEXT = shipped("vacuum", {"feed.count": 64}).as_toml()


@pytest.fixture
def queue() -> Iterator[RunQueue]:
    made = RunQueue(lambda: None)
    yield made
    made.close()


def _until(ready: Callable[[], bool], seconds: float = 240.0) -> None:
    end = time.monotonic() + seconds
    while not ready():
        assert time.monotonic() < end
        time.sleep(0.02)


def _asked(queue: RunQueue, folder: Path, text: str = TEXT) -> Run:
    return queue.add(name=folder.name, folder=folder, text=text, base=folder.parent, scene="vacuum")


def test_runs_are_computed_in_turn_stop_and_go_on(queue: RunQueue, tmp_path: Path) -> None:
    first, second, wrong = (_asked(queue, tmp_path / name, text) for name, text in (
        ("first", TEXT), ("second", TEXT), ("wrong", TEXT.replace("[feed]", "[fed]"))
    ))  # fmt: skip
    assert second.state == WAITS
    assert queue.busy
    with pytest.raises(SceneError, match="on its way"):
        _asked(queue, tmp_path / "second")
    _until(lambda: first.state == GOES)
    with pytest.raises(SceneError, match="stop it first"):
        queue.drop(first.number)
    queue.stop(second.number)  # one that waits
    queue.stop(first.number)  # and one that is computed
    _until(lambda: first.state == STOPPED)
    assert second.state == STOPPED
    _until(lambda: wrong.state == FAILED)
    assert "fed: unknown key" in wrong.told
    assert "did you mean 'feed'" in wrong.told
    assert not queue.busy
    queue.go_on(first.number)
    _until(lambda: first.state == DONE)
    assert "recovery" in first.told
    assert wf.Result.load(tmp_path / "first").share("hard", "far").value > 0.5
    assert first.table()["folder"] == "first"
    queue.drop(second.number)
    assert second not in queue.runs
    with pytest.raises(SceneError, match="no run 77"):
        queue.stop(77)


def test_a_first_look_is_the_scene_with_less_of_everything() -> None:
    for name in ("rhombus", "vacuum", "labyrinth", "aspirator"):
        scene = shipped(name)
        changes, options = first_look(scene)
        assert options or scene.air is None or not scene.body
        quick, whole = scene.replace(changes) if changes else scene, scene
        plans = [wf.plan(quick, **{key: value for key, value in options.items() if key == "force"}), wf.plan(whole)]
        assert "quick" in options or plans[0].estimate["seconds"] < plans[1].estimate["seconds"]


def test_measured_shares_are_calibrated_with_where_the_version_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = {"fraction": ["hard"], "bin": ["far"], "share": [0.6], "uncertainty": [0.02]}
    learnt = SimpleNamespace(value=0.45, low=0.4, high=0.5, narrower=0.5)
    asked: dict[str, object] = {}

    def calibrate(scene: Scene, measured: object, out: str, **_: object) -> object:
        asked.update(scene=scene, measured=measured, out=out)
        inputs = {"fraction.hard.restitution": learnt, "feed.width": SimpleNamespace(narrower=1.0)}
        return SimpleNamespace(agreement=SimpleNamespace(sentence="The measurement agrees."), inputs=inputs)

    monkeypatch.setattr(wf, "calibrate", calibrate, raising=False)
    ask = {"text": TEXT, "name": "vacuum", "base": str(tmp_path), "changes": {}, "options": {}, "measured": columns,
           "folder": str(tmp_path / "run")}  # fmt: skip
    assert compute(ask) == 0
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert said == {"done": "The measurement agrees. fraction.hard.restitution 0.45 (0.4 to 0.5)."}
    assert asked["measured"] == columns
    assert asked["out"] == str(tmp_path / "run")
