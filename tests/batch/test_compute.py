"""Sweeps as a whole: one table, each stage once, going on after a kill, failures on record."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import CASES, Here, shipped
from wakeflow.answer.result import Request
from wakeflow.batch import compute
from wakeflow.batch.agenda import make_agenda
from wakeflow.batch.compute import look_ahead
from wakeflow.batch.variant import Variant, variants
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.core.executor import Workers

CHAIN = {"numerics.rung": "none", "feed.count": 64}  # flown without air: seconds, and no compiled tracker
OVER = {"fraction.wheat.restitution": [0.3, 0.5, 1.5], "feed.height": ["80 mm", "120 mm"]}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[wf.Sweep, list[Variant], Here]:
    found, here = variants(shipped("rhombus", CHAIN), OVER), Here()
    return wf.sweep(found, tmp_path_factory.mktemp("sweep"), scheduler=here), found, here


def test_the_table_holds_every_number_with_its_interval_unit_and_inputs(swept: Any) -> None:
    sweep, found, _ = swept
    with (sweep.folder / "sweep.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert list(dict.fromkeys(row["scene"] for row in rows)) == [one.name for one in found]
    name = "fraction.wheat.restitution=0.5+feed.height=0.12"
    result = wf.Result.load(sweep.folder / name)
    mine = {row["quantity"]: row for row in rows if row["scene"] == name}
    for fraction in ("wheat", "chaff", "dust"):
        for place in (*result.scene["bin"], "elsewhere"):
            row = mine[f"share.{fraction}.{place}"]
            given = [float(row[key]) for key in ("value", "low", "high")]
            assert given == pytest.approx(result.share(fraction, place), abs=1e-9)
            assert (row["unit"], row["feed.height (m)"], row["fraction.wheat.restitution"]) == ("1", "0.12", "0.5")
    recovery = result.landings.separation.recovery["wheat"]
    assert float(mine["recovery.wheat"]["high"]) == pytest.approx(recovery.high)
    assert {row["unit"] for key, row in mine.items() if key.startswith("throughput.")} == {"kg/h"}
    assert float(mine["seconds"]["value"]) > 0
    assert {key.partition(".")[0] for key in mine} == {"share", "purity", "recovery", "throughput", "seconds"}


def test_a_scene_that_fails_is_in_the_table_with_its_reason(swept: Any) -> None:
    sweep, _, here = swept
    assert set(sweep.failed) == {f"fraction.wheat.restitution=1.5+feed.height={mm}-mm" for mm in (80, 120)}
    assert all("fraction.wheat.restitution = 1.5" in reason for reason in sweep.failed.values())
    assert "failed" in (sweep.folder / "sweep.csv").read_text()
    assert len(here.calls) == 4


def test_frames_are_columns_tidy_or_a_row_a_scene(swept: Any) -> None:
    sweep, found, _ = swept
    tidy, wide = sweep.table.frame(), sweep.frame(wide=True)
    assert len(tidy["value"]) == len(sweep.table.tidy().rows)
    assert list(wide["scene"]) == [one.name for one in found]
    value, low, high = (np.asarray(wide[f"recovery.wheat{end}"], dtype=float) for end in ("", ".low", ".high"))
    assert np.isnan(value[4:]).all()
    assert ((low <= value) & (value <= high))[:4].all()
    assert value[2:4].min() > value[0:2].min()  # bouncier wheat goes further out


def test_figures_are_drawn_and_others_on_request(swept: Any, tmp_path: Path) -> None:
    sweep, _, _ = swept
    drawn = {path.name for path in (sweep.folder / "figures").glob("*.png")}
    lines = {f"lines-{key}.png" for key in OVER}
    assert drawn == {*lines, "map-fraction.wheat.restitution-feed.height.png", "trade-off.png"}
    path = sweep.plot("share.wheat.outer-left", "feed.height", path=tmp_path / "one.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(SceneError, match=r"did you mean 'recovery\.wheat'"):
        sweep.plot("recovery.weat", "feed.height")
    with pytest.raises(SceneError, match="no two numbers"):
        sweep.plot("recovery.wheat", "air.speed")


def test_a_second_call_computes_nothing_and_writes_the_same_table(swept: Any) -> None:
    sweep, found, _ = swept
    before, here = (sweep.folder / "sweep.csv").read_bytes(), Here()
    again = wf.sweep(found, sweep.folder, scheduler=here)
    assert here.calls == []
    assert (sweep.folder / "sweep.csv").read_bytes() == before
    assert again.table == sweep.table
    other = wf.sweep(found[:1], sweep.folder, scheduler=here, target_error=0.02)
    assert len(here.calls) == 1  # asked for otherwise: computed anew
    assert len(other.table.entries) == 1


def test_scenes_share_airflows_and_flights(tmp_path: Path) -> None:
    """Nothing is computed: an agenda is made of plans."""
    base = shipped("rhombus", {"feed.count": 64, "fraction.chaff.mass_share": 0.05, "fraction.dust.mass_share": 0.05})
    axes = ["air.speed=4,5", "fraction.chaff.restitution=0.2,0.3", "feed.rate=400:500:2 kg/hour"]
    agenda = make_agenda(variants(base, axes), tmp_path, Request(None, "draft", {}, None))
    airflows, flights = [[step for step in agenda.steps if step.airflow is kind] for kind in (True, False)]
    assert (len(airflows), len(flights)) == (2, 8)
    assert agenda.steps[:2] == tuple(airflows)
    assert all(step.needs is None for step in airflows)
    waiting = [step.needs for step in flights]
    assert sum(needs in {one.name for one in airflows} for needs in waiting) == 4
    assert sum(needs in {one.name for one in flights} for needs in waiting) == 4  # the other rate flies no granule
    assert all(step.seconds > 0 and step.disk > 0 for step in agenda.steps)


def test_an_airflow_that_fails_takes_its_scenes_along_and_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from wakeflow.batch import agenda as run_agenda

    base = shipped("rhombus", {"feed.count": 64})
    found = variants(base, ["air.speed=4,5", "fraction.chaff.restitution=0.2,0.3"])
    flown: list[str] = []

    def solve(job: Any) -> str:
        return "it diverged" if job.tables["air"]["speed"] == 4 else ""

    def fly_scene(job: Any) -> str:
        flown.append(job.folder.name)
        return "no granules"

    monkeypatch.setattr(run_agenda, "solve_airflow_of", solve)
    monkeypatch.setattr(run_agenda, "fly_scene", fly_scene)
    sweep = wf.sweep(found, tmp_path, scheduler=Here(), rung="draft")
    assert flown == [f"air.speed=5+fraction.chaff.restitution={value}" for value in (0.2, 0.3)]
    reasons = list(sweep.failed.values())
    assert reasons == ["its airflow failed: it diverged"] * 2 + ["no granules"] * 2


def test_where_fewer_scenes_than_workers_are_open_each_flies_on_more_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compute, "cores", lambda: 8)
    with Workers(4, tmp_path) as workers:
        assert [compute._threads(workers, scenes) for scenes in (0, 1, 2, 3, 4, 9)] == [8, 8, 4, 2, 2, 2]
    assert compute._threads(Here(), 1) == 1
    found = variants(shipped("rhombus", CHAIN), {"feed.height": ["80 mm", "120 mm"]})
    agenda = make_agenda(found, tmp_path, Request(None, None, {}, None), threads=lambda scenes: 8 // scenes)
    assert {step.job.threads for step in agenda.steps} == {4}


def test_what_a_sweep_will_cost(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    found = variants(shipped("rhombus"), ["air.speed=4,5", "fraction.chaff.restitution=0.2,0.3,7"])
    alone = {"collisions": False, "air-loading": False}  # what a flight costs of its own
    seen = look_ahead(found, tmp_path, rung="draft", force=alone)
    assert (seen.scenes, seen.airflows, seen.flights, len(seen.failed)) == (6, 2, 4, 2)
    one = wf.plan(shipped("rhombus"), rung="draft", force=alone).estimate
    assert one["seconds"] < seen.seconds < 4 * one["seconds"]  # airflows are shared
    arguments = ["sweep", str(CASES / "rhombus.toml"), "--set", "air.speed=4,5", "--dry-run", "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert "2 scenes: 2 airflows and 2 flights to compute" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_a_sweep_that_would_not_fit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: usage._replace(free=1000))
    with pytest.raises(SceneError, match="GB are free"):
        wf.sweep([shipped("rhombus", CHAIN)], tmp_path)


def test_the_same_command_goes_on_after_a_kill(tmp_path: Path) -> None:
    """Killed with scenes behind and ahead, workers included; then no finished scene is computed again."""
    command = ["sweep", str(CASES / "rhombus.toml"), "--rung", "none", "--set", "feed.count=64"]
    command += ["--set", "feed.height=80:140:4 mm", "--workers", "1", "--out", str(tmp_path), "--quiet"]
    program = [sys.executable, "-m", "wakeflow.cli", *command]
    with subprocess.Popen(program, start_new_session=True) as sweep:
        while not (points := sorted(tmp_path.glob("*/point.json"))):
            assert sweep.poll() is None
            time.sleep(0.02)
        os.kill(sweep.pid, signal.SIGKILL)
    done = {path: path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/point.json"))}
    assert 1 <= len(points) <= len(done) < 4
    assert main(command) == 0
    after = {path: path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/point.json"))}
    assert len(after) == 4
    assert {path: after[path] for path in done} == done
    with (tmp_path / "sweep.csv").open() as stream:
        assert {row["state"] for row in csv.DictReader(stream)} == {"done"}


def test_two_sweeps_do_not_write_to_one_folder(tmp_path: Path) -> None:
    from filelock import FileLock

    with FileLock(tmp_path / ".lock"), pytest.raises(SceneError, match="another sweep"):
        wf.sweep([shipped("rhombus", CHAIN)], tmp_path)


def test_a_broken_result_is_computed_again(tmp_path: Path) -> None:
    scenes = {"one": shipped("rhombus", CHAIN)}
    wf.sweep(scenes, tmp_path, scheduler=Here())
    table = json.loads((tmp_path / "one" / "result.json").read_text())
    (tmp_path / "one" / "result.json").unlink()
    here = Here()
    again = wf.sweep(scenes, tmp_path, scheduler=here)
    assert here.calls == [("fly_scene", "one")]
    assert again.result("one").table["separation"] == table["separation"]


def test_what_would_not_fit_on_the_disk_is_refused_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wakeflow.batch.compute.shutil.disk_usage", lambda place: SimpleNamespace(free=1000))
    here = Here()
    with pytest.raises(SceneError, match=r"needs about .* GB .*wakeflow clean --keep"):
        wf.sweep([shipped("vacuum", {"feed.count": 16})], tmp_path, scheduler=here)
    assert not here.calls
