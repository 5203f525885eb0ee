"""What to measure next: the command, its files and its figure."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

import wakeflow as wf
from wakeflow.cli import main
from wakeflow.report.csv import SENSITIVITY_COLUMNS
from wakeflow.results.landing_results import least_certain
from wakeflow.results.result import Result

SETTINGS = ("--set", "feed.count=512", "--set", "uncertainty.fraction.hard.restitution=0.05")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sensitivity") / "run"
    scene = str(Path(__file__).parents[2] / "cases" / "vacuum.toml")
    assert main(["sensitivity", scene, "--out", str(out), *SETTINGS, "--quiet"]) == 0
    return out


def test_the_table_holds_what_the_result_holds(folder: Path) -> None:
    result = Result.load(folder)
    assert result.landings is not None
    assert result.landings.inputs is not None
    assert result.landings.inputs["fraction.hard.restitution"].high == pytest.approx(0.55)
    with (folder / "sensitivity.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == SENSITIVITY_COLUMNS
    own = [row for row in rows if (row["fraction"], row["bin"]) == ("hard", "near")]
    assert {row["number"] for row in own} == {
        "fraction.hard.restitution", "fraction.hard.friction", "fraction.hard.size", "feed.width", "feed.position",
    }  # fmt: skip
    halves = [float(row["half (percentage points)"]) for row in own]
    assert halves == sorted(halves, reverse=True)
    total = sum(float(row["index (%)"]) for row in own)
    assert 80.0 < total <= 100.5  # nearly linear: little is left for interactions


def test_half_the_uncertainty_moves_a_share_half_as_far(folder: Path, tmp_path: Path) -> None:
    settings = {"feed.count": 512, "uncertainty.fraction.hard.restitution": 0.1}
    wide = wf.run(wf.Scene.load(Path(__file__).parents[2] / "cases" / "vacuum.toml", settings), tmp_path, report=False)
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
    assert (folder / "figures" / "inputs.png").stat().st_size > 2000
    assert main(["sensitivity", str(folder)]) == 0
    told = capsys.readouterr().out
    assert "fraction.hard.restitution" in told
    result = Result.load(folder)
    assert result.landings is not None
    place, parts = least_certain(result.landings)["hard"]
    assert place in ("near", "far")
    assert next(iter(parts)) == max(parts, key=lambda key: parts[key].half)


def test_a_run_in_which_nothing_is_unknown_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = Path(__file__).parents[2] / "cases" / "vacuum.toml"
    keys = [f"fraction.{name}.{key}" for name in ("soft", "hard") for key in ("restitution", "friction", "size")]
    exact = [part for key in [*keys, "feed.width", "feed.position"] for part in ("--set", f"uncertainty.{key}=0")]
    code = main(["sensitivity", str(scene), "--out", str(tmp_path), "--set", "feed.count=64", *exact, "--quiet"])
    assert code == 2
    assert "[uncertainty]" in capsys.readouterr().err
