"""The window on a machine, drawn off-screen: what is where, and in which colour."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from support import shipped
from wakeflow.cli import main
from wakeflow.report.canvas import BODY, fraction_colours
from wakeflow.report.vtk import write_tracks
from wakeflow.report.window import look

SIDES = {"soft": np.array([1.0, 1.0]), "hard": np.array([-1.0, 1.0])}  # of the vacuum scene: to the right, to the left


def _pixels(path: Path, colour: str) -> NDArray[np.bool_]:
    """Where a picture has a colour, to within what smoothing of edges does."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.abs(np.asarray(Image.open(path).convert("RGB")).astype(int) - wanted).max(axis=2) < 12


def test_a_run_shows_its_bodies_and_its_tracks(tmp_path: Path) -> None:
    scene, picture = shipped("vacuum"), tmp_path / "window.png"
    time, x = np.linspace(3.0, 3.4, 30), np.linspace(0.0, 0.25, 30)
    fall = np.column_stack([x, 0.1 - 3.0 * x**2])
    ends = {"diameter": np.array(1e-3), "bin": np.array(0), "fate": np.array(0)}
    paths = {
        name: [{"time": time, "position": side * fall, "velocity": side * fall, **ends}] for name, side in SIDES.items()
    }
    write_tracks(tmp_path, paths, scene)
    look(scene, tmp_path, picture)
    between = _pixels(picture, BODY)[200:650, 400:800]  # of walls, legend and bins, whose edges have all greys
    left, middle, right = np.quantile(np.argwhere(between)[:, 1], [0.05, 0.5, 0.95])
    assert middle == pytest.approx(200, abs=5)  # the prism stands on the axis, in the middle of 1200 pixels
    assert 45 < right - left < 90  # 50 mm are 89 pixels
    for name, colour in fraction_colours(list(SIDES)).items():
        drawn = np.argwhere(_pixels(picture, colour)[200:])[:, 1]
        assert (drawn.mean() > 600) == (SIDES[name][0] > 0)


def test_a_scene_shows_its_machine_alone(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    scene = tmp_path / "machine.toml"
    scene.write_text((cases / "vacuum.toml").read_text())
    assert main(["view", str(scene)]) == 0
    picture = tmp_path / "machine-view.png"
    assert capsys.readouterr().out.startswith(
        "no screen for a window (neither DISPLAY nor WAYLAND_DISPLAY is set); drawn instead: "
    )
    assert _pixels(picture, BODY).any()
    assert not _pixels(picture, fraction_colours(["soft"])["soft"]).any()


def test_the_picture_of_a_window_is_a_png(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(cases / "vacuum.toml"), "--picture", "machine.svg"]) == 2
    assert "is a PNG" in capsys.readouterr().err
