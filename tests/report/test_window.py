"""The window on a machine, drawn off-screen: what is where, and in which colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import wakeflow as wf
from support import shipped
from wakeflow.cli import main
from wakeflow.report.canvas import BODY, fraction_colours

COUNT = 64


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> wf.Result:
    return wf.run(shipped("vacuum", {"feed.count": COUNT}), tmp_path_factory.mktemp("vacuum"))


def _pixels(path: Path, colour: str) -> NDArray[np.bool_]:
    """Where a picture has a colour, to within what smoothing of edges does."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.abs(np.asarray(Image.open(path).convert("RGB")).astype(int) - wanted).max(axis=2) < 12


def test_a_run_shows_its_bodies_and_its_tracks(run: wf.Result, tmp_path: Path) -> None:
    picture = tmp_path / "window.png"
    assert main(["view", str(run.folder), "--picture", str(picture)]) == 0
    body = np.argwhere(_pixels(picture, BODY))
    assert abs(body[:, 1].mean() - 600) < 10  # the prism stands on the axis, in the middle of 1200 pixels
    assert 50.0 / 600.0 < np.ptp(body[:, 1]) / 1200 < 1.2 * 50.0 / 600.0 + 0.02  # 50 mm wide in a channel of 600 mm
    for colour in fraction_colours(["soft", "hard"]).values():
        assert _pixels(picture, colour).sum() > 500


def test_a_scene_shows_its_machine_alone(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    scene = tmp_path / "machine.toml"
    scene.write_text((cases / "vacuum.toml").read_text())
    assert main(["view", str(scene)]) == 0
    picture = tmp_path / "machine-view.png"
    assert capsys.readouterr().out.startswith("no screen for a window (neither DISPLAY nor WAYLAND_DISPLAY is set): ")
    assert _pixels(picture, BODY).any()
    assert not _pixels(picture, fraction_colours(["soft"])["soft"]).any()


def test_the_picture_of_a_window_is_a_png(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(cases / "vacuum.toml"), "--picture", "machine.svg"]) == 2
    assert "is a PNG" in capsys.readouterr().err
