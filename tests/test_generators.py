"""The scripts that make families of scenes: each runs, and what it writes is a scene."""

from __future__ import annotations

from pathlib import Path

import labyrinths
import prisms
import pytest
import rhombi

import wakeflow as wf
from support import CASES

MADE = {"labyrinths", "prisms", "rhombi"}


def test_every_generator_is_tried() -> None:
    assert {path.stem for path in CASES.glob("*.py")} == MADE


def test_rhombi_keep_their_bins_beside_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = rhombi.main(tmp_path, [45.0, 50.0], [25.0])
    assert not found.failed
    scene = wf.Scene.load(tmp_path / "rhombus-50-25.toml")
    assert scene.width == pytest.approx(0.025)
    assert scene.bin["middle"].to == pytest.approx(0.04)
    assert capsys.readouterr().out.count("% of the wheat") == 2


def test_prisms_are_written_and_planned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prisms.main(tmp_path, [45.0])
    assert {path.stem for path in tmp_path.glob("*.toml")} == {"prism-up-45", "prism-down-45"}
    assert wf.Scene.load(tmp_path / "prism-down-45.toml").body["prism"].apex == "down"
    assert capsys.readouterr().out.count("about") == 2


def test_labyrinths_have_their_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = labyrinths.main(tmp_path, [1, 2])
    assert not found.failed
    assert len(wf.Scene.load(tmp_path / "labyrinth-2.toml").body) == 3
    assert "labyrinth-2: recovered" in capsys.readouterr().out
