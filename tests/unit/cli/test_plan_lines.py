"""What `wakeflow plan` says and draws: ten lines within the width of a screen, the rest on request."""

import re
from pathlib import Path

import pytest

from support import shipped
from wakeflow.cli import main
from wakeflow.core.files import scene_templates
from wakeflow.core.graded import Grade
from wakeflow.runs.planned import make_plan

LABELS = ("machine", "air", "feed", "flown with", "left out", "costs")
NARROW = 80  # columns


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", str(NARROW))


@pytest.mark.parametrize("kind", scene_templates())
def test_the_plan_is_short_and_draws_the_machine(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(scene_templates()[kind])]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [label for label in LABELS if any(line.startswith(f"{label}  ") for line in lines)] == list(LABELS)
    assert max(map(len, lines[:-1])) <= NARROW
    assert len(lines) <= 27  # ten facts, two of them in words: what is lifted, where no bin lies
    assert lines[-1] == f"drawing: runs/{kind}-plan.png"
    assert Path("runs", f"{kind}-plan.png").read_bytes().startswith(b"\x89PNG")


def test_a_changed_machine_is_drawn_beside_its_own_results(cases: Path) -> None:
    assert main(["plan", str(cases / "vacuum.toml"), "--set", "channel.top=200 mm"]) == 0
    assert Path("runs", "vacuum+channel.top=0.2-plan.png").exists()
    assert not Path("runs", "vacuum-plan.png").exists()


def test_lengths_are_said_as_the_user_writes_them(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (cases / "vacuum.toml").read_text()
    Path("mine.toml").write_text(re.sub(r'"(-?\d+)0 mm"', r'"\1 cm"', text))
    assert main(["plan", "mine.toml"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "prism 5 cm wide, 45 deg, vibrating at 20 Hz, ± 0.2 cm (3.22 g) in a channel of 60 cm x 26 cm" in told


def test_all_tells_bounds_stages_and_every_warning(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(cases / "rhombus.toml"), "--all", "--picture", "machine.svg"]) == 0
    out = capsys.readouterr().out
    assert all(word in out for word in ("left out below", "basset-history", "draft airflow", "for information", "* "))
    assert "on two cores (= is " in out
    (airflow,) = re.findall(r"^ *airflow ( +)(=+) ", out, re.MULTILINE)
    (grid,) = re.findall(r"^ *grid x 1.5 airflow ( +)(=+) ", out, re.MULTILINE)
    assert len(airflow[1]) > len(grid[1])
    assert "<svg" in Path("machine.svg").read_text()


def test_json_draws_only_where_it_is_told_to(cases: Path) -> None:
    assert main(["plan", str(cases / "vacuum.toml"), "--json"]) == 0
    assert not Path("runs").exists()
    assert main(["plan", str(cases / "vacuum.toml"), "--json", "--picture", "machine.pdf"]) == 0
    assert Path("machine.pdf").read_bytes().startswith(b"%PDF")


def test_a_picture_has_a_known_kind(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(cases / "vacuum.toml"), "--picture", "machine.txt"]) == 2
    assert capsys.readouterr().err == "wakeflow: machine.txt: a picture's name ends in .png, .svg, .pdf\n"


def test_without_a_screen_the_drawing_is_named(
    cases: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["plan", str(cases / "vacuum.toml"), "--open"]) == 0
    assert capsys.readouterr().out.endswith("no screen to open it on: runs/vacuum-plan.png\n")


@pytest.mark.parametrize(("size", "first"), [("7 mm", False), ("30 mm", True)])
def test_a_granule_as_large_as_the_body_is_the_first_doubt(size: str, first: bool) -> None:
    """It is told whatever else is doubtful: no granule of that size is a point in the air."""
    told = make_plan(shipped("rhombus", {"fraction.wheat.size": size})).notices[0]
    assert ("treated as points" in told.text) == first
    assert (told.grade is Grade.VOID) == first


def test_a_feed_that_begins_above_the_channel_is_doubted() -> None:
    above = make_plan(shipped("prism", {"feed.height": "900 mm"})).warnings
    (told,) = (line for line in above if line.startswith("the feed begins at y = "))
    assert "above channel.top" in told
    assert not [line for line in make_plan(shipped("prism")).warnings if line.startswith("the feed begins")]


def test_the_plan_tells_the_granules_that_fly(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(cases / "vacuum.toml"), "--set", "feed.count=100"]) == 0
    assert "128 granules of each fly" in " ".join(capsys.readouterr().out.split())
