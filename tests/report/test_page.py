"""What the page tells of machine, materials, proofs and origin, and what its script is handed; no browser."""

import itertools
import json
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.answer.provenance import commit_of
from wakeflow.answer.result import Request
from wakeflow.field import FlowField
from wakeflow.laws.material import materials
from wakeflow.report.canvas import bins_across
from wakeflow.report.html.live import FRAMES, POINTS, _frames
from wakeflow.report.html.rows import machine_rows, material_rows, proofs_of, scene_in_full, source_of
from wakeflow.scene import Scene
from wakeflow.scene.changes import flat
from wakeflow.scene.rungs import rungs

SHIPPED = ("rhombus", "prism", "labyrinth", "aspirator", "vacuum")
VOID = ("meta", "img", "br", "input", "link", "hr")


class Outline(HTMLParser):
    """Every tag with its attributes, ids, what is not closed, and addresses."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def every(self, *names: str) -> list[dict[str, str | None]]:
        return [given for tag, given in self.tags if tag in names]


@pytest.fixture(scope="module")
def vacuum(tmp_path_factory: pytest.TempPathFactory) -> tuple[wf.Result, str]:
    scene = Scene.load(Path(__file__).parents[2] / "cases" / "vacuum.toml").replace({"feed.count": 64})
    result = wf.run(scene, tmp_path_factory.mktemp("vacuum"))
    return result, (result.folder / "report.html").read_text()


def test_the_page_is_well_formed_and_can_be_read_without_eyes_or_mouse(vacuum: tuple[wf.Result, str]) -> None:
    page = Outline(vacuum[1])
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


def test_the_page_asks_nothing_of_the_network_and_is_small(vacuum: tuple[wf.Result, str]) -> None:
    assert "http" not in vacuum[1]
    assert "@import" not in vacuum[1]
    assert len(vacuum[1]) < 10e6


def test_the_page_tells_where_the_answer_comes_from(vacuum: tuple[wf.Result, str]) -> None:
    result, text = vacuum
    made = result.provenance
    assert made.seed == 0
    assert made.openfoam is None
    for told in (made.host, made.system, made.date, result.key, result.versions["numpy"]):
        assert told in text
    again = wf.run(Scene.parse(result.scene), result.folder)
    assert again.provenance == made  # the answer stood there: it was made then


def test_the_script_is_handed_tracks_and_shares(vacuum: tuple[wf.Result, str]) -> None:
    result, text = vacuum
    found = re.search(r'id="live-data">(.*?)</script>', text, re.S)
    data: dict[str, Any] = json.loads(found[1])
    assert data["frames"] == []
    assert data["loop"] is None
    assert [one["name"] for one in data["bins"]] == bins_across(Scene.parse(result.scene))
    for one in data["fractions"]:
        assert len(one["tracks"]) == 48
        assert all(len(track["at"]) == 2 * POINTS for track in one["tracks"])
        for place, share in data["wakes"]["answer"][one["name"]].items():
            assert share == pytest.approx(100 * result.share(one["name"], place)[0])


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
    import base64
    import io

    from PIL import Image

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
        number = isinstance(value, float) or (isinstance(value, list) and not isinstance(value[0], str | list))
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
    assert rows["wheat", "diameter of the equal sphere"][2:] == ("3.88 mm", "given", "the scene")
    assert rows["dust", "diameter of the equal sphere"].value == "40 µm"
    assert {fraction for fraction, _ in rows} == set(scene.fraction)


def test_a_default_interval_tells_what_it_rests_on() -> None:
    assert "ISO 3966" in source_of("air.speed", "default (confidence all, uncertainty; chosen)")
    assert source_of("air.speed", "the scene") == "the scene"
    assert "materials.toml" in source_of(
        "fraction.wheat.friction", "default (confidence measured, uncertainty; derived)"
    )


def test_what_the_page_says_of_proofs_stands_in_the_validation() -> None:
    text = (Path(__file__).parents[2] / "docs" / "validation.md").read_text()
    sections = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", text, flags=re.M | re.S))
    for rung in rungs:
        for proof in proofs_of(rung):
            for number in re.findall(r"\d+(?:\.\d+)?", proof.found):
                assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", sections[proof.section]), (
                    proof,
                    number,
                )
    assert len(proofs_of("standard")) > len(proofs_of("none"))


def test_the_commit_is_that_of_the_folder_itself(tmp_path: Path) -> None:
    assert commit_of(tmp_path) is None
    root = Path(__file__).parents[2]
    found = commit_of(root)
    assert found is None or re.fullmatch(r"[0-9a-f]{40}\+?", found)
