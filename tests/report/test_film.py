"""Films: what is where in which frame, how large they are, and that they stand on the page."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence

import wakeflow as wf
from support import field_of, shipped
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.field import FlowField
from wakeflow.pipeline.film_stage import Film
from wakeflow.report.canvas import BODY, fraction_colours
from wakeflow.report.film import BEGIN, END, show_film, write_film
from wakeflow.report.pictures.view import body_displacement
from wakeflow.scene import Scene

SPAN, SIZE, PLENTY = 0.2, 300, 5e6


def _film(scene: Scene, begin: float = 3.0) -> Film:
    """One granule of every fraction, falling at 1 m/s at places of its own; the second is there from the middle on."""
    paths = {}
    for number, name in enumerate(scene.fraction):
        time = begin + np.array([0.5 * SPAN if number == 1 else -SPAN, 2.0 * SPAN])
        where = np.column_stack([np.full(2, 0.04 * (number + 1)), scene.channel.top - 0.02 - (time - begin)])
        own = {"diameter": np.array(8e-3), "bin": np.array(0), "fate": np.array(0)}
        paths[name] = [{"time": time, "position": where, "velocity": np.tile([0.0, -1.0], (2, 1)), **own}]
    return Film(begin, SPAN, 0.05, dict.fromkeys(scene.fraction, 1.0), True, paths)


def _made(path: Path, scene: Scene, field: FlowField | None = None, **more: Any) -> list[NDArray[np.uint8]]:
    """The frames of a film (k, up, across, 3)."""
    asked = {"seconds": 1.2, "size": SIZE, "most": PLENTY, **more}
    with Image.open(write_film(path, _film(scene), scene, field, **asked)) as film:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]


def _where(frame: NDArray[np.uint8], colour: str, near: int = 40) -> NDArray[np.float64]:
    """The middle (down, across) of what has a colour in a frame; NaN where nothing has."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    there = np.argwhere(np.abs(frame.astype(int) - wanted).max(axis=2) < near)
    return there.mean(axis=0) if len(there) else np.full(2, np.nan)


def test_granules_come_when_they_do_and_fall_as_far_as_they_do(tmp_path: Path) -> None:
    scene = shipped("rhombus")
    frames = [frame[:, : 3 * SIZE // 4] for frame in _made(tmp_path / "film.gif", scene)]  # without the legend
    assert len(frames) == 15
    colours = fraction_colours(list(scene.fraction))
    chaff, wheat = (np.array([_where(frame, colours[name]) for frame in frames]) for name in ("chaff", "wheat"))
    assert np.isfinite(chaff[:, 0]).tolist() == [False] * 8 + [True] * 7  # frame 8 is the first after the middle
    scale = (wheat - chaff)[13, 1] / 0.04  # dots per m
    assert wheat[13] - wheat[3] == pytest.approx([scale * SPAN * 10 / 15, 0.0], abs=1.5)
    assert chaff[13, 0] == pytest.approx(wheat[13, 0], abs=1.0)


def test_the_body_vibrates_and_the_air_turns(tmp_path: Path) -> None:
    scene = shipped("rhombus", {"vibration.frequency": 1.0 / SPAN})
    field = field_of(lambda x: np.stack([-x[:, 1], x[:, 0]], axis=1))
    frames = _made(tmp_path / "film.gif", scene, field, size=400)
    at = np.array([_where(frame, BODY, 6) for frame in frames])
    moved = body_displacement(scene, 3.0 + np.arange(15) / 15 * SPAN)
    along = scene.vibration.along  # type: ignore[union-attr]
    off = (at - at.mean(axis=0)) @ np.array([-along[1], along[0]])
    assert np.corrcoef(off, (moved - moved.mean(axis=0)) @ along)[0, 1] > 0.9
    corner = frames[0][60, 60].astype(int)
    assert corner[0] > corner[2] + 10  # red: the air turns counter-clockwise everywhere


def test_a_film_is_as_small_as_it_must_be(tmp_path: Path) -> None:
    scene, path = shipped("vacuum"), tmp_path / "film.gif"
    whole = _made(path, scene, size=500)[0].shape
    size = path.stat().st_size
    small = _made(path, scene, size=500, most=0.7 * size)[0].shape
    assert path.stat().st_size <= 0.7 * size
    assert max(small) < max(whole) <= 500
    with pytest.raises(SceneError, match="are too few; ask for fewer seconds, or allow more"):
        _made(path, scene, most=1e3)


def test_an_mp4_is_read_by_ffmpeg(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    scene, path = shipped("vacuum"), tmp_path / "film.mp4"
    write_film(path, _film(scene), scene, None, seconds=1.0, size=SIZE, most=PLENTY)
    frames, seconds = ffmpeg.count_frames_and_secs(str(path))
    assert frames == 30
    assert seconds == pytest.approx(1.0, abs=0.04)
    assert b"avc1" in path.read_bytes()  # H.264, which browsers play
    assert list(tmp_path.iterdir()) == [path]


def test_an_mp4_without_its_extra_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    scene = shipped("vacuum")
    with pytest.raises(SceneError, match=r"pip install 'wakeflow\[mp4\]'"):
        write_film(tmp_path / "film.mp4", _film(scene), scene, None, seconds=1.0, size=SIZE, most=PLENTY)


def test_the_page_shows_one_film_or_says_that_it_is_too_large(tmp_path: Path) -> None:
    page, film = tmp_path / "report.html", tmp_path / "film.gif"
    page.write_text(f"<p>before</p>{BEGIN}{END}<p>after</p>")
    film.write_bytes(b"one")
    show_film(tmp_path, film)
    film.write_bytes(b"other")
    show_film(tmp_path, film)
    text = page.read_text()
    assert text.count("data:image/gif;base64,") == 1
    assert "b3RoZXI=" in text
    film.write_bytes(bytes(5_000_001))
    show_film(tmp_path, film)
    assert "figures/film.gif, 5 MB: too large for the page." in page.read_text()
    assert page.read_text().startswith("<p>before</p>")
    assert page.read_text().endswith("<p>after</p>")


def test_a_user_makes_a_film_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    wf.run(shipped("vacuum", {"feed.count": 64}), folder)
    assert main(["animate", str(folder), "--seconds", "1", "--size", "240", "--span", "100 ms", "--quiet"]) == 0
    film = folder / "figures" / "film.gif"
    with Image.open(film) as made:
        assert max(made.size) <= 240
    assert "data:image/gif;base64," in (folder / "report.html").read_text()
    assert main(["report", str(folder)]) == 0
    assert "data:image/gif;base64," in (folder / "report.html").read_text()
    wf.run(shipped("vacuum", {"feed.count": 32}), folder)  # another answer: that film is not of it
    assert not film.exists()
    assert "data:image/gif" not in (folder / "report.html").read_text()


def test_what_cannot_be_filmed_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["animate", str(tmp_path)]) == 2
    folder = tmp_path / "run"
    wf.run(shipped("vacuum", {"feed.count": 32}), folder, report=False)
    for options, told in (
        (["--fraction", "sfot"], "unknown fraction 'sfot'; did you mean 'soft'? (known: soft, hard)"),
        (["--span", "5 mm"], "needs a number in s or a string such as '0.2 s'"),
        (["--out", "film.avi"], "name it *.gif"),
        (["--most", "much"], "is no size"),
    ):
        capsys.readouterr()
        assert main(["animate", str(folder), *options]) == 2
        assert told in capsys.readouterr().err
