"""The whole chain on real Gmsh and real OpenFOAM: mass balance, symmetry, cache, resume, failures."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import ALONE, shipped, working_in
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.terms import STICKING
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

COUNT = 256


@pytest.fixture(scope="session")
def rhombus_run(tmp_path_factory: pytest.TempPathFactory) -> wf.Result:
    scene = shipped("rhombus", {"feed.count": COUNT, "numerics.rung": "draft", "numerics.mesh_scale": 2.0})
    return wf.run(scene, tmp_path_factory.mktemp("rhombus"), force=ALONE)


@pytest.fixture(scope="session")
def prism_run(tmp_path_factory: pytest.TempPathFactory) -> wf.Result:
    scene = shipped("prism", {"feed.count": COUNT, "numerics.mesh_scale": 2.0})
    return wf.run(scene, tmp_path_factory.mktemp("prism"), force=ALONE)


def check_contract(result: wf.Result) -> None:
    table = json.loads((result.folder / "result.json").read_text())
    assert "NaN" not in json.dumps(table)
    keys = "schema scene plan airflow separation fates budget seconds warnings versions"
    assert set(keys.split()) <= set(table)
    for name, fates in table["fates"].items():
        assert sum(fates.values()) == table["scene"]["feed"]["count"]
        assert fates["stopped"] == 0
        shares = table["separation"]["fractions"][name]
        assert set(shares) == {*table["scene"]["bin"], "elsewhere"}
        assert sum(row["value"] for row in shares.values()) == pytest.approx(1.0, abs=1e-12)
        assert all(0 <= row["low"] <= row["value"] <= row["high"] <= 1 for row in shares.values())
    scene = Scene.parse(table["scene"])
    assert sum(table["separation"]["throughput"].values()) == pytest.approx(3600 * scene.feed.mass_flow)
    for name, how in table["plan"]["fractions"].items():
        parts = {
            p["source"] for row in table["budget"] if row["quantity"].startswith(f"share.{name}.") for p in row["parts"]
        }
        left_out = {row["name"] for row in table["plan"]["left_out"] if row["fraction"] == name}
        single = set() if scene.feed.rate else {"collisions"}  # without a rate the question is that of single granules
        assert left_out - single - {STICKING} <= parts
        assert not parts & set(how["forces"])
    for row in table["budget"]:
        assert all(part["error"] is not None and part["note"] for part in row["parts"] if part["how"] == "calibrated")
        assert {part["how"] for part in row["parts"]} <= {"measured", "companion", "calibrated", "unknown"}
        unknown = any(part["error"] is None for part in row["parts"])
        assert (row["total"]["error"] is None) == unknown
        assert not unknown or row["total"]["note"]  # what to give or to run
    page = (result.folder / "report.html").read_text()
    assert ('id="bounds"' in page) == any(row["bounds"] for row in table["plan"]["fractions"].values())
    assert 'id="impact"' in page
    for file in ("separation.csv", "budget.csv", "impact.csv", "granules.npz", "report.html", "tracks.vtp"):
        assert (result.folder / file).stat().st_size > 200, file


@pytest.mark.openfoam
def test_rhombus_gives_a_whole_answer(rhombus_run: wf.Result) -> None:
    check_contract(rhombus_run)
    airflow = rhombus_run.table["airflow"]
    assert airflow["rung"] == "draft"
    assert 0.8 < airflow["cd"]["value"] < 2.5  # diamonds: 1.2 steady to 2.4 time-resolved in two dimensions
    assert airflow["cp_base"]["value"] < -0.2
    assert airflow["suction"]["cp_min"] < -0.5
    assert airflow["pressure_drop"] > 0
    assert 0 < airflow["divergence"]["rms"] < 0.05
    assert rhombus_run.table["mesh"]["min_angle"] > 15
    assert airflow["mesh"]["non_orthogonality"] < 70
    assert airflow["flow_rate"] == pytest.approx(5.0 * 0.4, rel=1e-3)


@pytest.mark.openfoam
def test_what_is_recovered_in_one_bin_is_the_share_there(rhombus_run: wf.Result) -> None:
    found, share = rhombus_run.landings.separation.recovery["dust"], rhombus_run.share("dust", "middle")
    assert [found.value, found.low, found.high] == [*share]


@pytest.mark.openfoam
def test_rhombus_separates_dust_from_wheat(rhombus_run: wf.Result) -> None:
    """Dust follows the air into the wake, chaff lands beside it, wheat is thrown outwards."""
    assert rhombus_run.share("dust", "middle")[0] > rhombus_run.share("wheat", "middle")[0] + 0.1
    spread = {}
    with np.load(rhombus_run.folder / "granules.npz") as data:
        names = list(data["names"])
        for index, name in enumerate(names):
            spread[name] = np.abs(data["position"][data["fraction"] == index, 0]).mean()
    assert spread["dust"] < spread["wheat"]


@pytest.mark.openfoam
def test_a_symmetric_scene_separates_symmetrically(rhombus_run: wf.Result) -> None:
    for name in rhombus_run.table["fates"]:
        for left, right in (("inner-left", "inner-right"), ("outer-left", "outer-right")):
            a, b = (rhombus_run.separation["fractions"][name][place] for place in (left, right))
            half = 0.5 * (a["high"] - a["low"] + b["high"] - b["low"])
            assert abs(a["value"] - b["value"]) <= 1.5 * half + 2 / COUNT


@pytest.mark.openfoam
def test_prism_in_upward_air_lifts_chaff_and_lets_wheat_fall(prism_run: wf.Result) -> None:
    check_contract(prism_run)
    assert prism_run.share("wheat", "through")[0] > 0.99
    assert prism_run.share("chaff", "over")[0] > 0.9
    assert prism_run.share("dust", "over")[0] > 0.9
    assert prism_run.table["airflow"]["pressure_drop"] > 0


def test_vacuum_touches_neither_mesh_nor_openfoam(small_run: wf.Result) -> None:
    check_contract(small_run)
    assert small_run.table["airflow"] is None
    assert set(small_run.table["seconds"]) <= {"compile", "tracks", "companion", "draws", "drawings"}


def test_vacuum_flight_is_the_papers_parabola(cases: Path, tmp_path: Path) -> None:
    """No vibration: after one impact every granule flies  y = x vy/vx - g x^2 / 2 vx^2  to the floor."""
    tables = Scene.load(cases / "vacuum.toml", {"feed.count": 64, "feed.width": "0.1 mm"}).tables()
    del tables["vibration"]
    scene = Scene.parse(tables)
    result = wf.run(scene, tmp_path, report=False)
    raised = 1e-3 * np.sqrt(2)  # the centre of a 2 mm granule on a 45 degree slope lies that much above it
    out = wf.impact(np.pi / 4, np.sqrt(2 * 9.81 * (0.1 + 0.0125 - raised)), 0.0, 0.5, 0.3)
    vx, vy = out.velocity
    with np.load(result.folder / "granules.npz") as data:
        hard = data["fraction"] == list(data["names"]).index("hard")
        x, impacts = data["position"][hard, 0], data["impacts"][hard]
    top = scene.body["prism"].outline()[:, 1].max()
    fall = top - 0.0125 + raised + 0.11
    time_of_flight = (vy + np.sqrt(vy**2 + 2 * 9.81 * fall)) / 9.81
    assert np.all(impacts == 1)
    np.testing.assert_allclose(x, 0.0125 + vx * time_of_flight, atol=6e-5)


@pytest.mark.openfoam
def test_the_second_run_answers_from_the_cache(rhombus_run: wf.Result) -> None:
    scene = Scene.parse(rhombus_run.table["scene"])
    started = time.monotonic()
    again = wf.run(scene, rhombus_run.folder, force=ALONE)
    assert time.monotonic() - started < 8.0
    assert all(stage["cached"] for stage in again.table["seconds"].values())
    assert again.table["separation"] == rhombus_run.table["separation"]


@pytest.mark.openfoam
def test_changing_a_target_keeps_airflow_and_tracks(rhombus_run: wf.Result, tmp_path: Path) -> None:
    changed = Scene.parse(rhombus_run.table["scene"]).replace({"fraction.dust.target": "inner-left", "feed.rate": 0.1})
    result = wf.run(changed, tmp_path, force=ALONE, report=False)
    assert all(stage["cached"] for stage in result.table["seconds"].values())


@pytest.mark.openfoam
def test_pressure_gradient_can_be_switched_off_and_matters(rhombus_run: wf.Result, tmp_path: Path) -> None:
    scene = Scene.parse(rhombus_run.table["scene"])
    without = wf.run(scene, tmp_path, force={"pressure-gradient": False, **ALONE}, report=False)
    assert "pressure-gradient" in [row["name"] for row in without.table["plan"]["left_out"]]
    moved = {}
    for name in ("chaff", "wheat"):
        with np.load(rhombus_run.folder / "granules.npz") as a, np.load(tmp_path / "granules.npz") as b:
            rows = a["fraction"] == list(a["names"]).index(name)
            moved[name] = np.median(np.abs(a["position"][rows, 0] - b["position"][rows, 0])) / scene.width
    assert min(moved.values()) > 1e-3


def test_the_order_of_bins_in_the_file_changes_no_share(small_run: wf.Result, tmp_path: Path) -> None:
    tables = Scene.parse(small_run.table["scene"]).tables()
    tables["bin"] = dict(reversed(tables["bin"].items()))
    swapped = wf.run(Scene.parse(tables), tmp_path, report=False)
    assert list(swapped.landings.separation.bins) == ["far", "near", "elsewhere"]
    for name, row in small_run.landings.separation.fractions.items():
        for place, one in row.items():
            found = swapped.share(name, place)
            assert found.value == one.value
            for a, b in ((found.low, one.low), (found.high, one.high), (found.numerical, one.numerical)):
                assert a == pytest.approx(b, abs=0.15 * one.half)  # read off other draws: 3 to 5 % each


def test_granules_that_leave_through_floor_or_top_without_a_bin_have_escaped(cases: Path, tmp_path: Path) -> None:
    scene = Scene.load(cases / "vacuum.toml", {"feed.count": 64, "bin.far.to": 0.125})
    result = wf.run(scene, tmp_path, report=False)
    for name, fates in result.table["fates"].items():
        assert fates["binned"] + fates["escaped"] == 64
        assert result.share(name, "elsewhere")[0] == pytest.approx(fates["escaped"] / 64)
    assert result.table["fates"]["hard"]["escaped"] > 10


def test_a_lost_report_is_written_again_and_an_old_one_goes(cases: Path, tmp_path: Path) -> None:
    scene = Scene.load(cases / "vacuum.toml", {"feed.count": 64})
    wf.run(scene, tmp_path)
    (tmp_path / "report.html").unlink()
    wf.run(scene, tmp_path)
    assert (tmp_path / "report.html").exists()
    wf.run(scene.replace({"feed.seed": 5}), tmp_path, until="tracks")
    assert not (tmp_path / "report.html").exists()
    assert not (tmp_path / "separation.csv").exists()


def test_until_mesh_stops_there(cases: Path, tmp_path: Path) -> None:
    assert main(["run", str(cases / "rhombus.toml"), "--until", "mesh", "--out", str(tmp_path), "--quiet"]) == 0
    table = json.loads((tmp_path / "result.json").read_text())
    assert list(table["seconds"]) == ["mesh"]
    assert "separation" not in table


@pytest.mark.openfoam
def test_an_interrupted_run_goes_on_and_leaves_no_solver(cases: Path, tmp_path: Path) -> None:
    """Ctrl-C during the airflow: code 130, no result, no child left; the same command finishes from where it was."""
    command = [
        sys.executable, "-m", "wakeflow.cli", "run", str(cases / "rhombus.toml"), "--out", str(tmp_path / "out"),
        "--rung", "draft", "--set", "feed.count=64", "--until", "airflow", "--set", "numerics.mesh_scale=2.0",
        "--force", "air-loading=off", "--force", "collisions=off",
    ]  # fmt: skip
    cache = tmp_path / "cache"
    env = {**os.environ, "WAKEFLOW_CACHE": str(cache)}
    case = cache / "airflow"
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs are deaf to Ctrl-C
    child = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True, preexec_fn=heard)
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and len(list(case.glob("*/case/segments.json"))) < 2:  # first segments ended
        time.sleep(0.1)
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=120)
    assert child.returncode == 130, errors
    assert "interrupted" in errors
    assert not (tmp_path / "out" / "result.json").exists()
    assert not working_in(tmp_path)
    saved = next(case.glob("*.part/case/segments.json")).parents[1]  # of the two grids, one beside the other
    before = (saved / "case" / "log.simpleFoam").read_text().count("\nTime = ")
    assert subprocess.run(command, env=env, check=False).returncode == 0
    assert json.loads((tmp_path / "out" / "result.json").read_text())["airflow"]["verdict"] == "steady"
    log = saved.with_suffix("") / "case" / "log.simpleFoam"
    iterations = [int(line.split("=")[1]) for line in log.read_text().splitlines() if line.startswith("Time = ")]
    assert iterations[before] > 1  # it went on from what was saved


@pytest.mark.openfoam
def test_dust_past_a_body_that_swings_sideways_flies_with_the_air(cases: Path, tmp_path: Path) -> None:
    """Dust that was in the gap behind a swinging wall finds the air again: none is slow in fast air."""
    changes = {
        "body.prism.width": 0.06, "body.prism.slope_angle": "68 deg", "air.speed": 4.5, "numerics.mesh_scale": 2.0,
        "vibration": {"frequency": 25, "gamma": 8.0, "direction": "0 deg"}, "feed.count": 256,
    }  # fmt: skip
    scene = Scene.load(cases / "prism.toml", changes)
    calm = {"dispersion": False, **ALONE}  # gusts may stop a grain of dust
    result = wf.run(scene, tmp_path, force=calm, report=False)
    pipeline = Pipeline(scene, make_plan(scene, force=calm))
    _, field = pipeline.field
    slow = 0
    for track in pipeline.tracks().drawn["dust"]:
        air = field.sample(track["position"])[0]
        late = track["time"] > track["time"][0] + 0.1
        fast = np.linalg.norm(air, axis=1) > 2.0  # NaN in the gap compares false
        slow += np.count_nonzero(late & fast & (np.linalg.norm(track["velocity"], axis=1) < 0.15))
    assert slow == 0
    assert result.table["fates"]["dust"]["stopped"] == 0


def test_files_that_no_run_wrote_are_not_replaced(tmp_path: Path) -> None:
    scene = shipped("vacuum", {"feed.count": 64})
    (tmp_path / "machine").mkdir()
    (tmp_path / "machine" / "drawing.dwg").write_text("my own")
    for name in ("notes.txt", "report.html"):
        (tmp_path / name).write_text("my own")
    with pytest.raises(SceneError, match=r"holds report.html, which no run of wakeflow wrote .* name another folder"):
        wf.run(scene, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["machine", "notes.txt", "report.html"]
    (tmp_path / "report.html").rename(tmp_path / "page.html")
    wf.run(scene, tmp_path, report=False)  # beside files that it does not touch
    (tmp_path / "result.json").unlink()
    (tmp_path / "report.html").write_text("of a run that was killed before it ended")
    (tmp_path / ".begun-run").touch()
    assert wf.run(scene, tmp_path).landings is not None
    for name in ("notes.txt", "page.html", "machine/drawing.dwg"):
        assert (tmp_path / name).read_text() == "my own"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rung": 2}, "rung = 2: unknown (known: auto"),
        ({"rung": ["draft"]}, "rung = ['draft']: unknown"),
        ({"until": ["mesh"]}, "choose funnel, mesh"),
        ({"workers": "two"}, "workers = 'two': a whole number"),
        ({"workers": 1.5}, "workers = 1.5: a whole number"),
        ({"workers": True}, "workers = True: a whole number"),
        ({"workers": 0}, "workers = 0: at least 1"),
        ({"out": 7}, "out = 7: needs a path, not int"),
        ({"out": "/proc/x"}, "/proc/x: cannot be made"),
        ({"near": 7}, "near = 7: needs a path, not int"),
        ({"force": ["lift"]}, "name each term and its state"),
        ({"target_error": "one"}, "target_error = 'one': needs a share"),
    ],
)
@pytest.mark.parametrize("start", [wf.run, wf.sweep])
def test_what_cannot_be_asked_for_is_one_line(
    start: Callable[..., object], options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    known = signature(start).parameters
    if not set(options) <= set(known):
        pytest.skip(f"{start.__name__} has no such option")
    scene = shipped("vacuum", {"feed.count": 32})
    with pytest.raises(SceneError) as caught:
        start(scene if start is wf.run else [scene], **{"out": tmp_path / "out", **options})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out" / "result.json").exists()


def test_switches_and_errors_as_the_command_line_has_them_are_kept(tmp_path: Path) -> None:
    scene = shipped("vacuum", {"feed.count": 32})
    how: dict[str, Any] = {"force": {"collisions": "off"}, "target_error": "2 %", "report": False}
    asked = wf.run(scene, tmp_path / "one", refine=False, **how).options
    assert (asked.force, asked.target_error) == ({"collisions": False}, 0.02)
    assert wf.Result.load(tmp_path / "one").options == asked
    swept = wf.sweep([scene], tmp_path / "many", workers=1, figures=False, **how)
    assert swept.result(swept.table.entries[0].name).options == asked


@pytest.mark.openfoam
def test_a_second_core_works_meanwhile_and_changes_no_air(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The steady end's airflow is solved beside the answer's; on one core after it. That flights ahead change nothing:
    tests/unit/air/test_same_answer.py, of a run on all cores and of one on one.
    """
    scene = shipped("rhombus", {"numerics.mesh_scale": 4.0, "numerics.target_error": 0.2, "numerics.rung": "standard"})
    found, order = {}, {}
    for cores in (1, 2):
        monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / f"cache-{cores}"))
        monkeypatch.setattr("os.sched_getaffinity", lambda _, cores=cores: set(range(cores)))
        told: list[str] = []

        def hear(stage: str, text: str, told: list[str] = told) -> None:
            told.append(stage + text[:4])

        done = wf.run(scene, tmp_path / f"{cores}", until="airflow", listener=hear, force=ALONE)
        found[cores] = {key: value for key, value in done.table["airflow"].items() if key != "seconds"}
        assert told.index("grid x 1.5 airflowdone") < told.index("airflowdone")  # which starts from it
        order[cores] = told.index("draft airflowdone") < told.index("airflowdone")
    assert order == {1: False, 2: True}
    assert found[1] == found[2]


def test_every_blas_has_one_thread_in_a_run() -> None:
    """One that is first loaded within it as well: its waiting threads made a mapping of fields eighty times as long."""
    code = """
from wakeflow.runs.run_stages import one_thread_of_blas
with one_thread_of_blas():
    import scipy.linalg, scipy.interpolate, threadpoolctl
    found = [pool["num_threads"] for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas"]
assert found and set(found) == {1}, found
"""
    several = os.environ | {"OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=several)
    assert done.stderr == ""
