"""Runs one after the other: each is computed as its scene was, stops and goes on, and says what went wrong."""

import errno
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import wakeflow as wf
from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.extras.page.job import compute
from wakeflow.extras.page.queue import DONE, FAILED, GOES, STOPPED, WAITS, Run, RunQueue

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


def test_measured_shares_are_calibrated_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    columns = {"fraction": ["hard"], "bin": ["far"], "share": [0.6], "uncertainty": [0.02]}
    ask = {"text": TEXT, "name": "vacuum", "base": str(tmp_path), "changes": {}, "options": {}, "measured": columns,
           "folder": str(tmp_path / "run")}  # fmt: skip
    assert compute(ask) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])["done"]
    assert told.startswith("The measurement ")
    assert (tmp_path / "run" / "calibration.json").exists()


SEARCH = """[search]
scene = "vacuum.toml"
maximise = ["recovery.hard"]
within = { "fraction.hard.restitution" = [0.4, 0.6] }
budget = "5 s"
"""


@pytest.mark.parametrize(
    ("kind", "typed", "told", "left"),
    [
        ("sweep", "fraction.hard.restitution=0.4,0.6", "2 of 2 scenes done over", "scenes.csv"),
        ("capacity", "feed.rate=1:2:2 g/hour", "loss.hard at most 99 %: met up to 0.002 kg/h", "figures/capacity.png"),
        ("search", "search.toml", "recommended: hard restitution 0.", "level-1/scenes.csv"),
        ("protocol", "hard", "the interval of", "protocol.html"),
    ],
)
def test_other_tasks_are_done_and_say_what_came_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, typed: str, told: str, left: str
) -> None:
    few = {"feed.count": 64, "feed.rate": "1 g/hour", "feed.depth": "1 m", "limit.loss.hard": "99 %"}
    text = shipped("vacuum", few).as_toml()
    (tmp_path / "vacuum.toml").write_text(text)
    (tmp_path / "search.toml").write_text(SEARCH)
    ask = {"text": text, "name": "vacuum", "base": str(tmp_path), "changes": {}, "options": {}, "kind": kind,
           "typed": typed, "files": str(tmp_path), "folder": str(tmp_path / "out")}  # fmt: skip
    assert compute(ask) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert told in lines[-1]["done"]
    assert (tmp_path / "out" / left).is_file()
    if kind in ("sweep", "capacity"):
        assert "scenes, " in str([line["text"] for line in lines[:-1]])


def test_a_full_disk_fails_the_run_and_the_next_is_begun(
    queue: RunQueue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "/tmp/wakeflow-1")

    monkeypatch.setattr("wakeflow.extras.page.queue.TemporaryDirectory", full)
    both = [_asked(queue, tmp_path / name) for name in ("first", "second")]
    _until(lambda: not queue.busy, 20.0)
    assert [one.state for one in both] == [FAILED, FAILED]
    assert "No space left on device" in both[0].told
