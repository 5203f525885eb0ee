"""Which input moves which number: the command, its files and its figures, by regression and by sweep."""

import csv
from pathlib import Path

import pytest

import wakeflow as wf
from support import Here, shipped
from wakeflow.answer.result import Result
from wakeflow.answer.shares import least_certain
from wakeflow.batch.sensitivity import COLUMNS
from wakeflow.cli import main

SETTINGS = {"feed.count": 512, "uncertainty.fraction.hard.restitution": 0.05}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sensitivity") / "run"
    wf.run(shipped("vacuum", SETTINGS), out, rung="none", report=False)
    assert main(["sensitivity", str(out), "--quiet"]) == 0
    return out


def test_the_table_holds_what_the_result_holds(folder: Path) -> None:
    result = Result.load(folder)
    assert result.landings.inputs["fraction.hard.restitution"].high == pytest.approx(0.55)
    with (folder / "sensitivity.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    own = [row for row in rows if row["quantity"] == "share.hard.near"]
    assert {row["input"] for row in own} == {
        "fraction.hard.restitution", "fraction.hard.friction", "fraction.hard.size", "feed.width", "feed.position",
    }  # fmt: skip
    parts = result.landings.measure_next["hard"]["near"]  # type: ignore[index]
    for row in own:
        assert float(row["change at high"]) == pytest.approx(parts[row["input"]].rise)
        assert abs(float(row["change at low"])) == pytest.approx(parts[row["input"]].half)
    total = sum(float(row["index"]) for row in own)
    assert 0.8 < total <= 1.005  # nearly linear: little is left for interactions


def test_half_the_uncertainty_moves_a_share_half_as_far(folder: Path, tmp_path: Path) -> None:
    settings = {"feed.count": 512, "uncertainty.fraction.hard.restitution": 0.1}
    wide = wf.run(
        wf.Scene.load(Path(__file__).parents[2] / "cases" / "vacuum.toml", settings),
        tmp_path,
        rung="none",
        report=False,
    )
    narrow = Result.load(folder)
    assert wide.landings is not None
    assert narrow.landings is not None
    key = "fraction.hard.restitution"
    parts = [one.landings.measure_next["hard"]["near"][key] for one in (narrow, wide)]  # type: ignore[index, union-attr]
    assert parts[0].half == pytest.approx(0.5 * parts[1].half, rel=0.25)
    a, b = (one.landings.separation.fractions["hard"]["near"] for one in (narrow, wide))  # type: ignore[union-attr]
    assert a.value == b.value
    assert a.numerical == b.numerical
    assert a.high - a.low < b.high - b.low


def test_the_figure_and_the_terminal_name_the_number(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("sensitivity.png", "sensitivity.svg"):
        assert (folder / "figures" / name).stat().st_size > 2000
    assert main(["sensitivity", str(folder)]) == 0
    told = capsys.readouterr().out
    assert "fraction.hard.restitution" in told
    result = Result.load(folder)
    assert result.landings is not None
    place, parts = least_certain(result.landings)["hard"]
    assert place in ("near", "far")
    assert next(iter(parts)) == max(parts, key=lambda key: parts[key].half)
    assert main(["sensitivity", str(folder), "--set", "feed.count=64"]) == 2
    assert "give its scene file" in capsys.readouterr().err


def test_a_sweep_of_both_ends_agrees_with_the_regression(folder: Path) -> None:
    """Restitution moves the hard granule's share nearly linearly: flown anew at the ends of its interval the share
    changes as the draws say, within the error of these, to either side. Nobody doubts the height of the feed: the draws
    say nothing of it, the sweep does. What is flown stands where it is looked for, and is not flown twice.
    """
    key, quantity = "fraction.hard.restitution", "share.hard.near"
    drawn = wf.sensitivity(folder)
    found = wf.sensitivity(folder, over=[key, "feed.height=80 mm,120 mm"], scheduler=Here())
    before = next(one for one in drawn.by_quantity[quantity] if one.key == key)
    after = {one.key: one for one in found.by_quantity[quantity]}
    assert (before.how, after[key].how) == ("regression", "sweep")
    assert (after[key].low, after[key].high) == (before.low, before.high)
    assert after[key].index == before.index
    assert before.error is not None
    for end in ("at_low", "at_high"):
        assert getattr(after[key], end) == pytest.approx(getattr(before, end), abs=before.error)
    assert before.at_high < 0.0 < before.at_low  # type: ignore[operator]
    assert "feed.height" not in {one.key for one in drawn.moves}
    higher = after["feed.height"]
    assert (higher.low, higher.high, higher.unit) == (0.08, 0.12, "m")
    assert higher.at_high < 0.0 < higher.at_low  # type: ignore[operator]  # it throws them farther
    assert {one.quantity for one in found.moves} >= {quantity, "recovery.hard", "purity.near.hard"}
    assert len(found.frame()["quantity"]) == len(found.moves)
    assert found.plot(["recovery.hard"], folder / "hard.png").stat().st_size > 2000
    again = Here()
    assert wf.sensitivity(folder, over=[key, "feed.height=80 mm,120 mm"], scheduler=again).moves == found.moves
    assert not again.calls


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ("fraction.hard.restitutio", "did you mean 'fraction.hard.restitution'"),
        ("feed.height", "give its ends"),
        ("feed.height=80 mm", "give its two ends"),
        ("fraction.hard.target=near,far", "a sensitivity is that of a number"),
    ],
)
def test_a_wrong_key_is_one_line(over: str, said: str, folder: Path) -> None:
    with pytest.raises(wf.SceneError, match=said):
        wf.sensitivity(folder, over=[over], scheduler=Here())


@pytest.mark.parametrize(
    ("over", "said"),
    [("feed.heigth=80 mm,120 mm", "unknown key 'heigth'; did you mean 'height'"), ("feed.height=1:2:x", "--over")],
)
def test_a_wrong_key_of_a_scene_is_told_before_it_is_run(over: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(wf.SceneError, match=said):
        wf.sensitivity(shipped("vacuum", SETTINGS), tmp_path, over=[over], rung="none")
    assert not any(tmp_path.iterdir())


def test_a_run_in_which_nothing_is_unknown_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = Path(__file__).parents[2] / "cases" / "vacuum.toml"
    keys = [f"fraction.{name}.{key}" for name in ("soft", "hard") for key in ("restitution", "friction", "size")]
    exact = [part for key in [*keys, "feed.width", "feed.position"] for part in ("--set", f"uncertainty.{key}=0")]
    code = main(["sensitivity", str(scene), "--out", str(tmp_path), "--set", "feed.count=64", *exact, "--quiet"])
    assert code == 2
    assert "[uncertainty]" in capsys.readouterr().err
