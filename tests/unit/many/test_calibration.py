"""calibrate() and protocol(), and a run beside measured shares: of a machine without air, whose truth is known."""

from __future__ import annotations

import html
import json
import os
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.answer.budget.agreement import AGREES, CANNOT_TELL, DISAGREES, agreement_in
from wakeflow.cli import main
from wakeflow.core.errors import SceneError, known
from wakeflow.extras.trays.calibration import Posterior, materials_text
from wakeflow.extras.trays.calibration_update import covariance_of_missed, missed_by
from wakeflow.extras.trays.protocol import protocol, protocol_of
from wakeflow.scene.measured import Measured, Tray, read_trays

COUNT = 512  # granules a fraction
TRUE = 0.56  # restitution of the hard granules in truth; the scene says 0.5


def scene(changes: dict[str, object] | None = None) -> wf.Scene:
    return shipped("vacuum", {"feed.count": COUNT, **(changes or {})})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("calibrated")


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> float:
    """The share of the hard granules that land far when they rebound better than the scene says."""
    found = wf.run(scene({"fraction.hard.restitution": TRUE}), tmp_path_factory.mktemp("true"), report=False)
    return float(found.recovery("hard").value)


@pytest.fixture(scope="module")
def posterior(folder: Path, truth: float) -> Posterior:
    trays = {"fraction": ["hard"], "bin": ["far"], "share": [truth], "uncertainty": [0.02]}
    return wf.calibrate(scene(), trays, folder)


def test_a_measured_tray_moves_the_input_that_it_depends_on_to_its_true_value(posterior: Posterior) -> None:
    found = posterior.inputs["fraction.hard.restitution"]
    assert (found.before.value, found.before.low, found.before.high) == (0.5, pytest.approx(0.4), pytest.approx(0.6))
    assert found.after.low < TRUE < found.after.high
    assert found.after.half < 0.6 * found.before.half
    assert posterior.stands
    assert posterior.rounds > 1
    assert posterior.inputs["fraction.soft.restitution"].narrower == pytest.approx(1.0, abs=0.05)


def test_the_shares_become_as_sure_as_the_tray_and_sum_to_one(posterior: Posterior, truth: float) -> None:
    before, after = posterior.before.recovery("hard"), known(posterior.result).recovery("hard")
    assert after.low < truth < after.high
    assert after.half < 0.025 < 0.1 < before.half
    for name in ("hard", "soft"):
        shares = known(known(posterior.result).landings).separation.fractions[name]
        assert sum(one.value for one in shares.values()) == pytest.approx(1.0)
    # Nothing was measured of the soft granules, which all fall near as far as the flown ones show
    assert (shares["near"].high, shares["far"].low) == (1.0, 0.0)
    assert posterior.agreement.verdict == CANNOT_TELL  # one tray and a share that was known to 14 points


def test_what_came_out_is_written_and_the_next_scene_takes_the_materials(posterior: Posterior) -> None:
    folder = posterior.before.folder
    for name in (
        "figures/calibration.png",
        "inputs.csv",
        "shares.csv",
        "agreement.csv",
        "correlations.csv",
        "calibration.json",
        "materials.toml",
    ):
        assert (folder / name).stat().st_size > 0
    next_scene = scene().tables()
    own = {"material": "measured-hard", "mass_share": 0.5, "target": "far"}
    soft = {**next_scene["fraction"]["soft"], "mass_share": 0.5}
    next_scene |= {"materials": "materials.toml", "fraction": {"hard": own, "soft": soft}}
    again = wf.Scene.parse(next_scene, base=folder)
    after = posterior.inputs["fraction.hard.restitution"].after
    assert again.fraction["hard"].properties.restitution == pytest.approx(after.value, rel=1e-4)
    assert again.uncertainty["fraction.hard.restitution"] == pytest.approx(after.half, rel=1e-4)


@pytest.mark.parametrize("name", ["tr\U0001f33e.csv", "tr\x7f.csv", os.fsdecode(b"tr\xff.csv"), 'tr"\\\t.csv'])
def test_materials_are_toml_whatever_the_measured_file_is_called(name: str) -> None:
    text = materials_text(scene(), {}, name)
    found = tomllib.loads(text.encode().decode())["measured-hard"]["source"]
    assert found == f"calibrated with {name.replace(os.fsdecode(bytes([255])), '?')}"


@pytest.mark.parametrize(
    ("measured", "discrepancy", "message"),
    [
        ({}, 0.02, "lacks bin, or share"),
        ([], 0.02, "give a CSV file, columns by their names"),
        ({"bin": ["far"], "share": [1.2], "uncertainty": [0.1]}, 0.02, "row 1: share = 1.2"),
        ({"bin": ["far"], "share": [0.5], "uncertainty": [0.1]}, "60 %", "at most 0.5; no model is exact"),
        ({"bin": ["far"], "share": [0.5], "uncertainty": [0.1]}, [0.1], "a number such as 0.01, or '1 %'"),
    ],
)
def test_wrong_input_is_refused_before_anything_runs(
    tmp_path: Path, measured: object, discrepancy: float | str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        wf.calibrate(scene(), measured, tmp_path / "run", discrepancy=discrepancy)
    assert message in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_exchanged_labels_are_found_out_and_write_no_materials(tmp_path: Path) -> None:
    """Of the soft granules, which all fall near, none would be there."""
    trays = [Tray(fraction="soft", bin="near", share=0.01, uncertainty=0.01),
             Tray(fraction="soft", bin="far", share=0.99, uncertainty=0.01)]  # fmt: skip
    found = wf.calibrate(scene({"feed.count": 64}), trays, tmp_path)
    assert found.agreement.verdict == DISAGREES
    assert "disagrees" in found.agreement.sentence
    assert "soft in" in found.agreement.sentence
    assert found.conflict
    assert not (tmp_path / "materials.toml").exists()
    with pytest.raises(SceneError, match="no materials are written"):
        found.save(tmp_path / "own.toml")


SOFT = 0.57  # restitution of the soft granules in truth, where the scene says 0.1 +- 0.1


@pytest.fixture(scope="module")
def contradicted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Posterior, dict[str, list[object]]]:
    """A calibration with all trays of a machine whose soft granules rebound as the scene holds to be impossible."""
    said = shipped("vacuum", {"feed.count": 256})
    true = wf.run(said.replace({"fraction.soft.restitution": SOFT}), tmp_path_factory.mktemp("other"), report=False)
    rows = [(name, place, one.value, 0.02) for name, places in known(true.landings).separation.fractions.items()
            for place, one in places.items()]  # fmt: skip
    trays = dict(zip(("fraction", "bin", "share", "uncertainty"), map(list, zip(*rows, strict=True)), strict=True))
    return wf.calibrate(said, trays, tmp_path_factory.mktemp("contradicted") / "run"), trays


def test_trays_that_the_inputs_cannot_reach_name_the_input_and_are_held(
    contradicted: tuple[Posterior, dict[str, list[object]]],
) -> None:
    found, trays = contradicted
    assert found.agreement.verdict == DISAGREES
    assert found.conflict.startswith("fraction.soft.restitution would have to be ")
    assert "the scene says 0.1 +- 0.1" in found.conflict
    after = found.inputs["fraction.soft.restitution"].after
    assert after.low < SOFT < after.high
    assert after.low > 0.2  # beyond what the scene says
    assert len(found.trays) == len(trays["share"]) == 6
    for share, one in zip(trays["share"], found.trays, strict=True):
        assert one.low <= share <= one.high
        assert one.half < 0.05
    before, result = found.before.recovery("soft"), known(found.result).recovery("soft")
    assert before.low > result.high  # the answer has moved beyond its interval to where the trays are
    for name, places in known(known(found.result).landings).separation.fractions.items():
        for place, one in places.items():
            share = next(s for f, b, s, _ in zip(*trays.values(), strict=True) if (f, b) == (name, place))
            assert one.low <= share <= one.high


def test_a_calibrated_folder_is_the_run_of_the_posterior_and_says_what_contradicts(
    contradicted: tuple[Posterior, dict[str, list[object]]], capsys: pytest.CaptureFixture[str]
) -> None:
    found, _ = contradicted
    folder, result = found.folder, known(found.result)
    read = wf.Result.load(folder)
    assert known(read.calibration).conflict == found.conflict
    assert known(read.calibration).agreement == found.agreement.sentence
    assert read.separation == result.separation
    assert read.key == result.key != found.before.key
    own = read.joint.own.separation()  # what is written and what the draws say are one
    for name, places in known(read.landings).separation.fractions.items():
        for place, one in places.items():
            told = own.fractions[name][place]
            assert (told.value, told.low, told.high) == pytest.approx((one.value, one.low, one.high), abs=1e-3)
    page = (folder / "report.html").read_text()
    assert "Calibrated with measured shares" in page
    assert found.conflict in html.unescape(page)
    assert not (folder / "materials.toml").exists()
    shares = (folder / "shares.csv").read_text().splitlines()
    assert len(shares) == 7
    assert main(["report", str(folder)]) == 2
    assert "wakeflow calibrate draws it anew" in capsys.readouterr().err


def test_nothing_is_said_of_shares_where_nothing_agrees(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Trays of one fraction that hold nearly twice what was fed."""
    file, out = tmp_path / "trays.csv", tmp_path / "run"
    file.write_text("fraction,bin,share,uncertainty\nhard,near,0.95,0.01\nhard,far,0.95,0.01\n")
    few = shipped("vacuum", {"feed.count": 64})
    found = wf.calibrate(few, file, out)
    assert found.agreement.verdict == DISAGREES
    assert found.result is None
    assert not found.inputs
    assert not found.trays
    assert found.conflict.startswith("No input of the scene and no miss of the model")
    with pytest.raises(SceneError, match="no materials are written: No input of the scene"):
        found.save(tmp_path / "own.toml")
    assert not (out / "materials.toml").exists()
    kept = json.loads((out / "calibration.json").read_text())
    assert (kept["separation"], kept["inputs"]) == (None, {})
    assert (out / "shares.csv").read_text().count("\n") == 1  # the heads
    read = wf.Result.load(out)  # the run as it was
    assert (read.key, read.calibration) == (found.before.key, None)
    assert read.share("hard", "far") == found.before.share("hard", "far")
    scene_file = tmp_path / "scene.toml"
    scene_file.write_text(few.as_toml())
    capsys.readouterr()
    assert main(["calibrate", str(scene_file), str(file), "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "No input of the scene and no miss of the model" in " ".join(told.split())
    assert "Nothing is calibrated" in told
    assert "recovered" not in told
    assert "measure next" not in told


def test_a_tray_buys_no_less_than_nothing_and_no_more_than_all_of_it(tmp_path: Path, posterior: Posterior) -> None:
    """A tray that nothing depends on, two that say the same, one alone."""
    [(about, alone)] = posterior.wider_without
    assert about == "hard in far"
    before, after = posterior.before.recovery("hard"), known(posterior.result).recovery("hard")
    assert 2.0 < alone <= 1.01 * before.half / after.half
    trays = [Tray(fraction="hard", bin="far", share=0.6, uncertainty=0.02),
             Tray(fraction="hard", bin="near", share=0.4, uncertainty=0.02),
             Tray(fraction="soft", bin="near", share=0.99, uncertainty=0.02)]  # fmt: skip
    found = wf.calibrate(scene(), trays, tmp_path)
    assert not found.conflict
    wider = dict(found.wider_without)
    most = found.before.recovery("hard").half / known(found.result).recovery("hard").half
    assert all(1.0 <= times <= 1.01 * most for times in wider.values())
    assert wider["soft in near"] == pytest.approx(1.0, abs=0.05)
    for one in ("hard in far", "hard in near"):
        assert 1.1 < wider[one] < 0.5 * most


def test_a_run_beside_trays_says_whether_they_agree(posterior: Posterior, truth: float) -> None:
    def told(share: float, uncertainty: float) -> str:
        tray = Tray(fraction="hard", bin="far", share=share, uncertainty=uncertainty)
        return agreement_in(posterior.before, Measured.of([tray])).verdict

    assert told(truth, 0.02) == CANNOT_TELL  # the run itself does not know it to ten points
    assert told(0.05, 0.02) == DISAGREES
    soft = Tray(fraction="soft", bin="near", share=0.99, uncertainty=0.02)
    found = agreement_in(posterior.before, Measured.of([soft]))
    assert found.verdict == AGREES
    assert 0.0 <= found.trays[0].used <= 1.0


def test_the_discrepancy_of_the_model_is_nowhere_nothing(posterior: Posterior) -> None:
    joint = posterior.before.joint
    halves, covariance = missed_by(joint, 0.02), covariance_of_missed(joint, 0.02)
    assert np.all((halves > 0.001) & (halves <= 0.02))
    np.testing.assert_allclose(1.96 * np.sqrt(np.diag(covariance)).reshape(halves.shape), halves, rtol=1e-3)
    apart = halves.size // 2  # of one fraction nothing goes with the other
    assert not covariance[:apart, apart:].any()
    assert covariance[0, 1] < 0.0  # what one bin has too much the other lacks
    with pytest.raises(SceneError, match="no model is exact"):
        wf.calibrate(scene(), [Tray(bin="far", share=0.5, uncertainty=0.1)], discrepancy=0.0)


def test_a_protocol_promises_what_a_calibration_keeps(folder: Path, posterior: Posterior, tmp_path: Path) -> None:
    """The half that is promised for 300 kernels is what a calibration with their counts leaves, before it is flown
    again.
    """
    found = protocol(scene(), folder, kernels=300)
    assert found.steps[0].fraction == "hard"
    assert found.left <= 0.5 * found.half
    assert "halves" in found.sentence
    page = found.page.read_text()
    assert "data:image/png;base64," in page
    assert "hard" in page
    text = found.form.read_text()
    assert "hard,far,\n" in text
    filled = tmp_path / "measured.csv"
    share = posterior.before.recovery("hard").value
    counts = {"far": round(300 * share), "near": 300 - round(300 * share), "elsewhere": 0}
    filled.write_text("".join(
        f"{line.rstrip(chr(10))}{counts[line.split(',')[1]]}\n" if line.startswith("hard,") else line
        for line in text.splitlines(keepends=True) if not line.startswith("soft,")
    ))  # fmt: skip
    after = known(wf.calibrate(scene(), read_trays(filled), folder).result).recovery("hard")
    assert after.half == pytest.approx(found.steps[0].half, rel=0.3)


def test_no_count_and_no_file_of_others_is_replaced(folder: Path, posterior: Posterior, tmp_path: Path) -> None:
    own = shutil.copytree(folder, tmp_path / "own")
    found = protocol_of(posterior.before, out=own)
    found.form.write_text(f"{found.form.read_text()}hard,far,137\n")
    with pytest.raises(SceneError, match=r"measured.csv is not as the program wrote it; move it"):
        protocol_of(posterior.before, out=own)
    assert found.form.read_text().endswith("137\n")
    trays = [Tray(fraction="hard", bin="far", share=0.5, uncertainty=0.02)]
    with (own / "materials.toml").open("a") as stream:
        stream.write("# mine\n")
    with pytest.raises(SceneError, match=r"materials.toml is not as the program wrote it"):
        wf.calibrate(scene(), trays, own)
    for name, kept in (("shares.csv", own), ("agreement.csv", tmp_path / "beside")):
        kept.mkdir(exist_ok=True)
        (kept / "SHA256SUMS").unlink(missing_ok=True)
        (kept / name).write_text("mine")
    (own / "result.json").unlink()
    with pytest.raises(SceneError, match=r"which no run of wakeflow wrote"):
        wf.calibrate(scene(), trays, own)
    file = tmp_path / "trays.csv"
    file.write_text("fraction,bin,share,uncertainty\nsoft,near,0.99,0.02\n")
    assert main(["compare", str(folder), str(file), "--out", str(tmp_path / "beside")]) == 2
    assert (tmp_path / "beside" / "agreement.csv").read_text() == (own / "shares.csv").read_text() == "mine"


def test_the_commands_print_and_refuse(folder: Path, posterior: Posterior, capsys: pytest.CaptureFixture[str]) -> None:
    file = folder / "trays.csv"
    file.write_text("fraction,bin,share,uncertainty\nsoft,near,0.99,0.02\n")
    assert main(["compare", str(folder), str(file), "--out", str(folder / "beside")]) == 0
    assert "agrees with the computation" in capsys.readouterr().out
    assert (folder / "beside" / "measured.png").exists()
    file.write_text("fraction,bin,share,uncertainty\nsoft,neer,0.99,0.02\n")
    assert main(["compare", str(folder), str(file)]) == 2
    assert "no bin 'neer'; did you mean 'near'?" in capsys.readouterr().err
    assert main(["calibrate", str(folder / "nowhere.toml"), str(file)]) == 2
    for unheard in (["--set", "feed.count=64"], ["--rung", "draft"], ["--force", "lift=on"]):
        assert main(["protocol", str(folder), "--out", str(folder / "other"), *unheard]) == 2
        assert "a finished run has its numbers, rung and terms" in capsys.readouterr().err
    assert main(["protocol", str(folder), "--out", str(folder / "other"), "--kernels", "9" * 400]) == 2
    assert "count ten at least, a million at most" in capsys.readouterr().err
    assert not (folder / "other").exists()


def test_the_report_of_a_scene_with_trays_shows_both_and_the_verdict(tmp_path: Path) -> None:
    trays = [{"fraction": "soft", "bin": "near", "share": 0.99, "uncertainty": 0.02}]
    found = wf.run(scene({"measured": trays}), tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "Measured and computed" in page
    assert "agrees with the computation" in page
    assert "No measurement of granules validates" not in page
    assert (tmp_path / "figures" / "measured.png").exists()
    assert found.scene["measured"] == trays
