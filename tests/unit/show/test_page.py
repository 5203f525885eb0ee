"""The page: machine, materials, proofs, origin, what its script is handed, films on it; no browser."""

import base64
import io
import itertools
import json
import re
import shutil
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence

import wakeflow as wf
from proofs.validation_page import record_of
from support import Page, field_of, shipped
from wakeflow.air.field import FlowField
from wakeflow.answer.provenance import commit_of
from wakeflow.answer.result import Request
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.extras.motion.film import BEGIN, END, show_film, still_of, write_film
from wakeflow.extras.motion.film_stage import Film
from wakeflow.extras.motion.live import FRAMES, MAX_TRACK_POINTS, _frames
from wakeflow.laws.material import materials
from wakeflow.scene import Scene
from wakeflow.scene.changes import flat
from wakeflow.scene.rungs import rungs
from wakeflow.scene.uncertainty import source_of
from wakeflow.show.canvas import BODY, bins_across, fraction_colours
from wakeflow.show.html import render
from wakeflow.show.html.rows import machine_rows, material_rows, proofs_of, scene_in_full
from wakeflow.show.moving import body_displacement

SHIPPED = ("rhombus", "prism", "labyrinth", "aspirator", "vacuum")


@pytest.fixture(scope="module")
def text(small_run: wf.Result) -> str:
    return (small_run.folder / "report.html").read_text()


def test_the_page_is_well_formed_and_can_be_read_without_eyes_or_mouse(text: str) -> None:
    page = Page(text)
    assert page.open == []
    ids = [given["id"] for _, given in page.tags if "id" in given]
    assert len(ids) == len(set(ids))
    assert all((given["alt"] or "").strip() for given in page.every("img"))
    targets = {(given["href"] or "").removeprefix("#") for given in page.every("a")}
    assert targets
    assert targets <= set(ids)
    assert page.every("html")[0]["lang"] == "en"
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    labelled = {given["for"] for given in page.every("label") if "for" in given}
    for given in page.every("input", "select"):
        assert given.get("id") in labelled or given.get("type") == "checkbox"  # those stand inside their label
    assert all(given.get("scope") == "col" for given in page.every("th"))


def test_the_page_asks_nothing_of_the_network_and_is_small(text: str) -> None:
    assert "http" not in text
    assert "@import" not in text
    assert len(text) < 10e6


def test_the_page_tells_where_the_answer_comes_from(small_run: wf.Result, text: str) -> None:
    made = small_run.provenance
    assert made.seed == 0
    assert made.openfoam == ""
    for told in (made.system, made.date, small_run.key, small_run.versions["numpy"]):
        assert told in text
    again = wf.run(Scene.parse(small_run.scene), small_run.folder)
    assert again.provenance == made  # the answer stood there: it was made then


def test_a_page_is_called_as_the_machine_is_and_names_no_computer(small_run: wf.Result) -> None:
    def page(command: str, **changed: Any) -> str:
        made = replace(small_run.provenance, command=command, host="press-room-7")
        return render(replace(small_run, provenance=made, **changed), {})

    typed = page("wakeflow run 'my plants/pre cleaner.toml' --quick --set air.speed='4 m/s'")
    assert "<h1>pre cleaner</h1>" in typed
    assert "<title>pre cleaner" in typed
    assert "press-room-7" not in typed
    assert "<h1>prism</h1>" in page("python study.py")
    bodies = {**small_run.scene, "report": {"title": "Works 3"}}
    assert "<h1>Works 3</h1>" in page("wakeflow run a.toml", scene=bodies)


def test_the_script_is_handed_tracks_and_shares(small_run: wf.Result, text: str) -> None:
    found = re.search(r'id="live-data">(.*?)</script>', text, re.S)
    data: dict[str, Any] = json.loads(found[1])
    assert data["frames"] == []
    assert data["loop"] is None
    assert [one["name"] for one in data["bins"]] == bins_across(Scene.parse(small_run.scene))
    for one in data["fractions"]:
        assert len(one["tracks"]) == 48
        assert all(len(track["at"]) == 2 * MAX_TRACK_POINTS for track in one["tracks"])
        for place, share in data["wakes"]["answer"][one["name"]].items():
            assert share == pytest.approx(100 * small_run.share(one["name"], place)[0])


def test_a_loop_becomes_frames_and_a_steady_field_one() -> None:
    points = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [0.0, 0.0]])
    cells = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    turning = np.stack([-points[:, 1], points[:, 0]], axis=1)
    steady = FlowField.from_arrays(points, cells, turning)
    moving = FlowField.from_arrays(
        points, cells, np.stack([turning, -turning]), times=[0.0, 0.1], period=0.2
    )  # fmt: skip
    window = (-1.0, 1.0, -1.0, 1.0)
    assert len(_frames(steady, window)) == 1
    frames = _frames(moving, window)
    assert len(frames) == FRAMES
    assert all(frame.startswith("data:image/jpeg;base64,") for frame in frames)
    red, blue = (_middle(frames[i]) for i in (0, FRAMES // 2))
    assert red[0] > red[2] + 50  # counter-clockwise
    assert blue[2] > blue[0] + 50


def _middle(frame: str) -> tuple[int, int, int]:
    image = Image.open(io.BytesIO(base64.b64decode(frame.partition(",")[2])))
    pixel = image.convert("RGB").getpixel((image.width // 2, image.height // 2))
    assert isinstance(pixel, tuple)
    return pixel[0], pixel[1], pixel[2]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_scene_on_the_page_computes_the_same(name: str, cases: Path) -> None:
    scene = Scene.load(cases / f"{name}.toml")
    whole = tomllib.loads(scene_in_full(scene))
    assert whole["feed"]["seed"] == scene.feed.seed  # defaults too
    again, asked = (flat(one.model_dump(mode="json")) for one in (Scene.parse(whole), scene))
    assert again.keys() == asked.keys()
    for key, value in asked.items():
        first = value[0] if isinstance(value, list) and value else value
        number = isinstance(first, float) or (isinstance(value, list) and value and not isinstance(first, str | list))
        assert again[key] == (pytest.approx(value, rel=1e-11) if number else value), key


def test_what_was_asked_beside_the_scene_is_in_it(cases: Path) -> None:
    scene = Scene.load(cases / "rhombus.toml", {"force": {"lift": "on", "magnus": "off"}})
    whole = tomllib.loads(scene_in_full(scene, Request(None, "draft", {"magnus": True, "dust.lift": False}, 0.05)))
    again = Scene.parse(whole)
    assert (again.numerics.rung, again.numerics.target_error) == ("draft", 0.05)
    assert again.force == {"lift": True, "magnus": True, "dust.lift": False}
    assert Scene.parse(tomllib.loads(scene_in_full(scene, Request(None, None, {}, None)))).numerics == scene.numerics


def test_the_machine_is_told_in_the_units_of_machines(cases: Path) -> None:
    rows = dict(machine_rows(Scene.load(cases / "rhombus.toml")))
    assert rows["body.rhombus"] == "shape rhombus, width 50 mm, slope angle 45 deg"
    assert "rate 500 kg/h" in rows["feed"]
    assert rows["air"].startswith("speed 5 m/s, direction down")
    assert "frequency 30 Hz" in rows["vibration"]
    assert "at (-36 mm, -75 mm)" in dict(machine_rows(Scene.load(cases / "labyrinth.toml")))["body.left-prism"]


def test_every_property_tells_its_source(cases: Path) -> None:
    scene = Scene.load(cases / "rhombus.toml")
    rows = {(row.fraction, row.quantity): row for row in material_rows(scene)}
    wheat = rows["wheat", "restitution"]
    assert wheat.value == "0.5"
    assert wheat.confidence == materials["wheat"].evidence["restitution"].confidence
    assert materials["wheat"].evidence["restitution"].source in wheat.source
    assert rows["wheat", "diameter of the equal sphere"][2:] == ("3.6 mm", "given", "the scene")
    assert rows["dust", "diameter of the equal sphere"].value == "40 µm"
    assert {fraction for fraction, _ in rows} == set(scene.fraction)


def test_a_default_interval_tells_what_it_rests_on() -> None:
    assert "ISO 3966" in source_of("air.speed", "default (confidence all, uncertainty; chosen)")
    assert source_of("air.speed", "the scene") == "the scene"
    assert "materials.toml" in source_of(
        "fraction.wheat.friction", "default (confidence measured, uncertainty; derived)"
    )


def test_what_the_page_says_of_proofs_stands_in_the_validation() -> None:
    for rung in rungs:
        for proof in proofs_of(rung):
            for number in re.findall(r"\d+(?:\.\d+)?", proof.found):
                assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", record_of(proof.section)["claim"]), (
                    proof,
                    number,
                )
    assert len(proofs_of("standard")) > len(proofs_of("none"))


def test_the_commit_is_that_of_the_folder_itself(tmp_path: Path) -> None:
    assert commit_of(tmp_path) == ""
    root = Path(__file__).parents[3]
    found = commit_of(root)
    assert not found or re.fullmatch(r"[0-9a-f]{40}\+?", found)


SPAN, SIZE, PLENTY = 0.2, 300, 5e6


def _film(scene: Scene, begin: float = 3.0) -> Film:
    """One granule of every fraction, falling at 1 m/s at places of its own; the second is there from the middle on."""
    paths = {}
    for number, name in enumerate(scene.fraction):
        time = begin + np.array([0.5 * SPAN if number == 1 else -SPAN, 2.0 * SPAN])
        where = np.column_stack([np.full(2, 0.04 * (number + 1)), scene.channel.top - 0.02 - (time - begin)])
        own = {"diameter": np.array(8e-3), "bin": np.array(0), "fate": np.array(0)}
        pace = np.tile([0.0, -1.0], (2, 1))
        paths[name] = [{"time": time, "position": where, "velocity": pace, "arriving": pace, **own}]
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
    with pytest.raises(SceneError, match=r"pip install imageio-ffmpeg"):
        write_film(tmp_path / "film.mp4", _film(scene), scene, None, seconds=1.0, size=SIZE, most=PLENTY)


def test_the_page_shows_one_film_or_says_that_it_is_too_large(tmp_path: Path) -> None:
    page, film = tmp_path / "report.html", tmp_path / "film.gif"
    page.write_text(f"<p>before</p>{BEGIN}{END}<p>after</p>")
    for shade in (10, 200):
        frames = [Image.new("L", (8, 8), shade + i) for i in range(3)]
        frames[0].save(film, save_all=True, append_images=frames[1:])
        show_film(tmp_path, film)
    text = page.read_text()
    assert text.count("data:image/gif;base64,") == 1
    assert base64.b64encode(film.read_bytes()).decode() in text
    with Image.open(io.BytesIO(still_of(film))) as still:  # on paper: the frame in the middle
        assert still.getpixel((4, 4)) == (201, 201, 201)
    assert text.count('<figure class="paper">') == 1
    film.write_bytes(film.read_bytes() + bytes(5_000_001))
    show_film(tmp_path, film)
    assert "figures/film.gif, 5 MB: too large for the page." in page.read_text()
    assert page.read_text().startswith("<p>before</p>")
    assert page.read_text().endswith("<p>after</p>")


def test_a_user_makes_a_film_of_a_run(small_run: wf.Result, tmp_path: Path) -> None:
    folder = shutil.copytree(small_run.folder, tmp_path / "run")
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
    folder = tmp_path / "run"
    assert main(["animate", str(folder)]) == 2
    assert not folder.exists()
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
