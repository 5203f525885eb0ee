"""Sweeps: which scenes they are made of, one table, each stage once, going on after a kill, failures on record."""

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
from support import ALONE, CASES, Here, shipped
from wakeflow.answer.result import Request
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.core.executor import Workers
from wakeflow.many import compute
from wakeflow.many.agenda import make_agenda
from wakeflow.many.axis import Axis, axes_of, axis_of_text, designs
from wakeflow.many.compute import look_ahead
from wakeflow.many.variant import Variant, read_scenes, read_sweep_file, variants
from wakeflow.scene.changes import differing, folder_name, run_folder


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("air.speed=3,4,5", (3, 4, 5)),
        ("air.speed=3 m/s, 400 cm/s", ("3 m/s", "400 cm/s")),
        ("air.speed = 20, 40 km/h", ("20 km/h", "40 km/h")),
        ("air.turbulence=5,10 %", ("5 %", "10 %")),
        ("vibration.frequency=1800 1/min,2000 1/min", ("1800 1/min", "2000 1/min")),
        ("air.speed=3:5:3 m/s", ("3.0 m/s", "4.0 m/s", "5.0 m/s")),
        ("air.speed=3 m/s:5 m/s:2", ("3.0 m/s", "5.0 m/s")),
        ("fraction.chaff.restitution=0.2:0.4:5", (0.2, 0.25, 0.3, 0.35, 0.4)),
        ("feed.height=-1e-1:1e-1:3", (-0.1, 0.0, 0.1)),
        ('fraction.wheat.target=["a", "b"],"c"', (["a", "b"], "c")),
        ("numerics.rung=draft,standard", ("draft", "standard")),
    ],
)
def test_values_of_a_text(text: str, values: tuple[object, ...]) -> None:
    assert axis_of_text(text).values == values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("air.speed", "write it as KEY=VALUES"),
        ("=3", "write it as KEY=VALUES"),
        ("air.speed=", "write it as KEY=VALUES"),
        ("air.speed=3:5:1", "a count of at least 2"),
        ("x=3 m/s:5 km/h:3", "both ends in one unit"),
        ("x=4:4:3", "two different ends"),
        ("air.speed=3:5:2.9 m/s", "the count, behind the second colon, is a whole number"),
        ("air.speed=3:5:many", "is a whole number"),
        ("air.speed=20, 5 km/h, 40", "the unit once, behind the last value, or behind each"),
        ("air.speed=20, 5 m/s, 40 km/h", "the unit once, behind the last value, or behind each"),
        ("feed.height=0.08:0.1:100000", "20000 scenes at most"),
    ],
)
def test_a_text_that_is_no_axis(text: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        axis_of_text(text)


def test_a_sweep_that_nobody_could_read_is_refused_before_it_is_planned() -> None:
    axes = [axis_of_text(f"{key}=1:2:200") for key in ("a", "b", "c")]
    with pytest.raises(SceneError, match="a sweep of 8000000 scenes: 20000 at most"):
        designs["grid"](axes, 0, 0)
    with pytest.raises(SceneError, match="32768 scenes"):
        designs["sobol"](axes, 2**15, 0)


def test_a_key_with_a_star_is_one_number() -> None:
    found = wf.variants(CASES / "rhombus.toml", ["body.*.width=40,50 mm", "fraction.*.impact=paper,sphere"])
    assert [one.inputs["body.*.width"] for one in found] == [0.04, 0.04, 0.05, 0.05]
    assert [one.inputs["fraction.*.impact"] for one in found] == ["paper", "sphere"] * 2


def test_values_that_are_equal_are_one_scene() -> None:
    margins = "fraction.soft.restitution={value = 0.1, uncertainty = 0.01},{value = 0.1, uncertainty = 0.02}"
    assert len(read_scenes(CASES / "vacuum.toml", [margins], "grid", None, 0)[0]) == 2
    for text, names in (("80 mm,0.08 m,90 mm", ["0.08", "0.09"]), ("0.08,0.08", ["0.08"])):
        found, _ = read_scenes(CASES / "vacuum.toml", [f"feed.height={text}"], "grid", None, 0)
        assert [one.name for one in found] == [f"feed.height={name}" for name in names]


def test_a_dry_run_counts_and_fails_as_the_sweep_would(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["sweep", str(CASES / "vacuum.toml"), "--dry-run", "--out", str(tmp_path), "--workers"]
    assert main([*command, "1", "--set", "feed.count=64"]) == 0
    assert "1 scene: 0 airflows and 1 flight to compute" in capsys.readouterr().out
    assert main([*command, "1", "--set", "fraction.soft.restitution=0.1,1.5"]) == 1
    assert "restitution = 1.5: too large" in capsys.readouterr().out
    assert main([*command, "0", "--set", "feed.count=64"]) == 2
    assert "at least 1" in capsys.readouterr().err


def test_axes_of_a_table_take_dotted_keys_and_units() -> None:
    table = {
        "air": {"speed": {"from": "2 m/s", "to": "8 m/s", "count": 3, "scale": "log"}},
        "bin": {"near": {"from": [0.0, 0.1], "to": [0.2, 0.3]}},  # keys of the scene, no range
    }
    speed, start, to = axes_of(table, "a file")
    assert (speed.key, speed.values) == ("air.speed", ("2.0 m/s", "4.0 m/s", "8.0 m/s"))
    assert (start.key, start.values, to.key) == ("bin.near.from", (0.0, 0.1), "bin.near.to")
    for wrong in ({"from": 1, "to": 2, "step": 1}, {"from": 0, "to": 2, "scale": "log"}, {"from": "1 m", "to": "2 s"}):
        with pytest.raises(SceneError, match=r"air\.speed"):
            axes_of({"air": {"speed": wrong}}, "a file")


def test_designs_cover_their_ranges_and_say_what_they_need() -> None:
    axes = axes_of({"a": {"from": 0.0, "to": 1.0, "count": 3}, "b": {"from": 1.0, "to": 100.0, "scale": "log"}}, "x")
    assert [tuple(row.values()) for row in designs["grid"](axes, 0, 0)][:3] == [(0.0, 1.0), (0.0, 100.0), (0.5, 1.0)]
    with pytest.raises(SceneError, match="as many values"):
        designs["list"](axes, 0, 0)
    for name in ("latin-hypercube", "sobol"):
        rows = designs[name](axes, 16, 1)
        assert rows == designs[name](axes, 16, 1) != designs[name](axes, 16, 2)
        a, b = np.array([row["a"] for row in rows]), np.log10([row["b"] for row in rows]) / 2
        for places in (a, b):  # one in each sixteenth: what tells these designs from random numbers
            assert sorted(np.floor(16 * places).tolist()) == list(range(16))
    with pytest.raises(SceneError, match="power of two"):
        designs["sobol"](axes, 12, 0)
    with pytest.raises(SceneError, match="count"):
        designs["latin-hypercube"](axes, 0, 0)
    with pytest.raises(SceneError, match="leave count out"):
        designs["grid"](axes, 4, 0)


@pytest.mark.parametrize("design", ["latin-hypercube", "sobol"])
def test_a_seed_is_not_below_zero(design: str) -> None:
    with pytest.raises(SceneError, match="seed = -1: give a whole number of at least 0"):
        wf.variants(shipped("vacuum"), ["feed.height=60:80:2 mm"], design=design, count=4, seed=-1)


def test_variants_are_named_after_what_is_changed_in_si() -> None:
    found = wf.variants(CASES / "rhombus.toml", ["air.speed=360 cm/s,7.2 km/h", "feed.count=64"])
    assert [one.name for one in found] == ["air.speed=3.6", "air.speed=2"]
    assert [one.inputs for one in found] == [{"air.speed": 3.6}, {"air.speed": 2.0}]
    assert all(one.scene is not None and one.scene.feed.count == 64 for one in found)
    same = wf.variants(shipped("rhombus"), {"air.speed": [3.6, 3.6000000001]})
    assert [one.name for one in same] == ["air.speed=3.6", "air.speed=3.6-2"]


def test_a_variant_that_is_no_scene_says_why_and_the_others_stand() -> None:
    good, bad = wf.variants(shipped("rhombus"), {"fraction.wheat.restitution": [0.5, 1.5]})
    assert good.scene is not None
    assert bad.scene is None
    assert "fraction.wheat.restitution = 1.5" in bad.problem
    with pytest.raises(SceneError, match=r"air\.spead"):
        wf.variants(CASES / "rhombus.toml", ["feed.count=64,128", "air.spead=3"])


def test_a_day_is_no_number_and_no_end_of_the_sweep(tmp_path: Path) -> None:
    (tmp_path / "vacuum.toml").write_text((CASES / "vacuum.toml").read_text())
    (tmp_path / "sweep.toml").write_text("[sweep]\nscene = 'vacuum.toml'\nover.feed.height = [2020-01-01, 0.1]")
    day, good = read_sweep_file(tmp_path / "sweep.toml")
    assert "feed.height = '2020-01-01': needs a number" in day.problem
    assert good.scene is not None


def test_variants_are_a_line_each() -> None:
    found = wf.variants(shipped("vacuum"), {"fraction.soft.restitution": [0.1, 1.5]})
    assert repr(found[0]) == "<Variant fraction.soft.restitution=0.1>"
    assert repr(found[1]).startswith("<Variant fraction.soft.restitution=1.5: scene: fraction.soft.restitution = 1.5:")
    assert repr(Variant("mine", {"feed.height": 0.1}, found[0].scene)) == "<Variant mine: feed.height = 0.1>"


def test_folders_of_runs_tell_variants_apart() -> None:
    scene = shipped("rhombus", {"air.speed": "7 m/s"})
    assert run_folder("rhombus", scene, [], {}) == "rhombus"
    assert run_folder("rhombus", scene, ["air.speed"], {"rung": "draft"}) == "rhombus+air.speed=7+rung=draft"
    margins = [{"uncertainty.air.speed": margin} for margin in ("3 %", 3.0)]
    assert [folder_name(one) for one in margins] == ["uncertainty.air.speed=3pct", "uncertainty.air.speed=3"]
    long = {f"fraction.f{number}.restitution": 0.1 for number in range(9)}
    assert len(folder_name(long)) <= 100
    assert folder_name(long) != folder_name({**long, "fraction.f8.restitution": 0.2})
    assert "/" not in folder_name({"air.case": "../there/case"})


def test_what_differs_counts_defaults() -> None:
    scenes = [shipped("vacuum"), shipped("vacuum", {"numerics.tolerance": 1e-3}), shipped("rhombus")]
    assert differing(scenes[:2]) == {"numerics.tolerance": [1e-2, 1e-3]}
    assert differing(scenes)["fraction.chaff.material"] == [None, None, "chaff"]


def test_the_shipped_sweep_is_five_speeds() -> None:
    found = read_sweep_file(CASES / "sweep-air-speed.toml")
    assert [one.inputs for one in found] == [{"air.speed": speed} for speed in (4.0, 5.0, 6.0, 7.0, 8.0)]
    assert {one.scene.feed.count for one in found if one.scene is not None} == {4096}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[sweep]\nover.air.speed = [1, 2]", "sweep.scene is missing"),
        ("[air]\nspeed = 3", "no \\[sweep\\] table"),
        ("[sweep]\nscene = 'vacuum.toml'\nspeed = 2", "sweep.speed: unknown key"),
        ("[sweep]\nscene = 'vacuum.toml'", "needs a key to change"),
        ("[sweep]\nscene = 'vacuum.toml'\n[air]\nspeed = 2", "belong into"),
        ("[sweep]\nscene = 'no.toml'\nover.air.speed = [1, 2]", "no scene file"),
        ("[sweep]\nscene = 'vacuum.toml'\ndesign = 'cube'\nover.feed.count = [64, 128]", "unknown design of a sweep"),
        ("[sweep", "not valid TOML"),
        ('[sweep]\nscene = "a\\u0000b"\nover.feed.count = [64, 128]', r"sweep.scene = 'a\\x00b': no path holds"),
    ],
)
def test_a_wrong_sweep_file_is_one_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "vacuum.toml").write_text((CASES / "vacuum.toml").read_text())
    (tmp_path / "sweep.toml").write_text(text)
    with pytest.raises(SceneError, match=message) as caught:
        read_sweep_file(tmp_path / "sweep.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("axis", "held", "place"),
    [
        (Axis("air.speed", (), (3.0, 7.0), "m/s"), {"air.speed": 5.0}, 0.5),
        (Axis("air.speed", (), (10.8, 25.2), "km/hour"), {"air.speed": 5.0}, 0.5),
        (Axis("air.speed", (), (1.0, 100.0), "m/s", log=True), {"air.speed": 10.0}, 0.5),
        (Axis("air.speed", ("4 m/s", "5 m/s")), {"air.speed": 5.0}, 0.75),
        (Axis("air.speed", ("4 m/s", "6 m/s")), {"air.speed": 5.0}, np.nan),
        (Axis("air.speed", (), (3.0, 4.0), "m/s"), {"air.speed": 5.0}, np.nan),
        (Axis("air.speed", (), (3.0, 7.0), "m/s"), {}, np.nan),
        (Axis("air.speed", (), (3.0, 7.0), "mm"), {"air.speed": 5.0}, np.nan),
        (Axis("air.speed", ("3 mm", "5 mm")), {"air.speed": 5.0}, np.nan),
        (Axis("air.speed", (), (3.0, 7.0), "m/s"), {"air.speed": None}, np.nan),
        (Axis("air.turbulence", (), (0.0, 20.0), "%"), {"air.turbulence": 0.05}, 0.25),
        (Axis("air.turbulence", ("1 %", "5 %")), {"air.turbulence": 0.05}, 0.75),
        (Axis("feed.position", (), (-3.0, 7.0), "mm"), {"feed.position": 0.0}, 0.3),
        (Axis("air.direction", ("up", "down")), {"air.direction": "up"}, 0.25),
        (Axis("air.direction", (), (1.0, 2.0)), {"air.direction": "up"}, np.nan),
        (Axis("force.collisions", ("on", "off")), {"force.collisions": False}, 0.75),
        (Axis("-bin.a.from = bin.b.to", (), (50.0, 90.0), "mm"), {"bin.a.from": -0.08, "bin.b.to": 0.08}, 0.75),
        (Axis("-bin.a.from = bin.b.to", (), (50.0, 90.0), "mm"), {"bin.a.from": -0.08, "bin.b.to": 0.07}, np.nan),
    ],
)
def test_an_axis_knows_where_a_scene_stands(axis: Axis, held: dict[str, object], place: float) -> None:
    assert axis.where(held) == pytest.approx(place, nan_ok=True)


CHAIN = {"numerics.rung": "none", "feed.count": 64}  # flown without air: seconds, and no compiled tracker
OVER = {"fraction.wheat.restitution": [0.3, 0.5, 1.5], "feed.height": ["80 mm", "120 mm"]}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[wf.Sweep, list[Variant], Here]:
    alone = shipped("rhombus", {**CHAIN, "feed.rate": "0.1 kg/hour"}).without_air()  # so few that they do not meet
    found, here = variants(alone, OVER), Here()
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
    kinds = {"share", "purity", "recovery", "loss", "lost", "dirt", "throughput", "seconds"}
    assert {key.partition(".")[0] for key in mine} == kinds


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
    agenda = make_agenda(variants(base, axes), tmp_path, Request(None, "draft", {"air-loading": False}, None))
    airflows, flights = [[step for step in agenda.steps if step.airflow is kind] for kind in (True, False)]
    assert (len(airflows), len(flights)) == (2, 8)
    assert agenda.steps[:2] == tuple(airflows)
    assert not any(step.needs for step in airflows)
    waiting = [step.needs for step in flights]
    assert sum(needs in {one.name for one in airflows} for needs in waiting) == 4
    assert sum(needs in {one.name for one in flights} for needs in waiting) == 4  # the other rate flies no granule
    assert all(step.seconds > 0 and step.disk > 0 for step in agenda.steps)
    felt = make_agenda(variants(base, axes), tmp_path, Request(None, "draft", {}, None))
    assert sum(step.airflow for step in felt.steps) == 8  # each cloud has an air of its own


def test_an_airflow_that_fails_takes_its_scenes_along_and_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from wakeflow.many import agenda as run_agenda

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
    seen = look_ahead(found, tmp_path, rung="draft", force=ALONE)
    assert (seen.scenes, seen.airflows, seen.flights, len(seen.failed)) == (6, 2, 4, 2)
    alone = [
        look_ahead(variants(shipped("rhombus"), [f"air.speed={u}", f"fraction.chaff.restitution={r}"]), tmp_path,
                   rung="draft", force=ALONE).seconds
        for u in (4, 5) for r in (0.2, 0.3)
    ]  # fmt: skip
    assert max(alone) < seen.seconds < sum(alone)  # airflows are shared
    arguments = ["sweep", str(CASES / "rhombus.toml"), "--set", "air.speed=4,5", "--dry-run", "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert "2 scenes: 2 airflows and 2 flights to compute" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_the_same_command_goes_on_after_a_kill(tmp_path: Path) -> None:
    """Killed with scenes behind and ahead, workers included; then no finished scene is computed again."""
    command = ["sweep", str(CASES / "vacuum.toml"), "--set", "feed.count=64", "--set", "feed.height=80:140:4 mm"]
    command += ["--workers", "1", "--out", str(tmp_path), "--quiet"]
    program = [sys.executable, "-m", "wakeflow.cli", *command]
    with subprocess.Popen(program, start_new_session=True) as sweep:
        while not (points := sorted(tmp_path.glob("*/.point.json"))):
            assert sweep.poll() is None
            time.sleep(0.02)
        os.kill(sweep.pid, signal.SIGKILL)
    done = {path: path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/.point.json"))}
    assert 1 <= len(points) <= len(done) < 4
    assert main(command) == 0
    after = {path: path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/.point.json"))}
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
    monkeypatch.setattr("wakeflow.many.compute.shutil.disk_usage", lambda place: SimpleNamespace(free=1000))
    here = Here()
    with pytest.raises(SceneError, match=r"needs about .* GB .* GB are free.*wakeflow clean --keep"):
        wf.sweep([shipped("vacuum", {"feed.count": 16})], tmp_path, scheduler=here)
    assert not here.calls
