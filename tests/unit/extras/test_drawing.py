"""A body's outline out of a DXF drawing."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
from ezdxf.layouts import Modelspace

from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.extras.drawing import read_outline
from wakeflow.scene import Scene

SQUARE = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)]  # mm


@pytest.fixture
def drawn(tmp_path: Path) -> Callable[..., Scene]:
    """The vacuum scene with a body as drawn by ``draw(model space)``, with keys of the body's table."""

    def made(draw: Callable[[Modelspace], object], units: int = 4, **keys: object) -> Scene:
        drawing = ezdxf.new(units=units)
        draw(drawing.modelspace())
        drawing.saveas(tmp_path / "hood.dxf")
        tables: dict[str, Any] = shipped("vacuum").tables()
        name = next(iter(tables["body"]))
        body = {"outline": "hood.dxf", "at": tables["body"][name].get("at", [0.0, 0.0]), **keys}
        return Scene.parse({**tables, "body": {name: body}}, base=tmp_path)

    return made


def area(scene: Scene) -> float:
    """Of the first body, m2."""
    x, y = next(iter(scene.body.values())).outline().T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def closed(space: Modelspace) -> None:
    space.add_lwpolyline(SQUARE, close=True)


def lines(space: Modelspace) -> None:
    """The square side by side, in no order, each in a direction of its own, with texts beside it."""
    for a, b in ((2, 1), (3, 0), (0, 1), (2, 3)):
        space.add_line(SQUARE[a], SQUARE[b])
    space.add_text("Hood, steel")


def half_round(space: Modelspace) -> None:
    """A half circle of radius 20 mm on a line: by an arc."""
    space.add_arc((0.0, 0.0), 20.0, 0.0, 180.0)
    space.add_line((-20.0, 0.0), (20.0, 0.0))


def bulged(space: Modelspace) -> None:
    """The same by the bulge of a polyline."""
    space.add_lwpolyline([(20.0, 0.0, 1.0), (-20.0, 0.0, 0.0)], format="xyb", close=True)


@pytest.mark.parametrize("draw", [closed, lines])
def test_straight_outlines_keep_their_corners(drawn: Callable[..., Scene], draw: Callable[[Modelspace], None]) -> None:
    scene = drawn(draw)
    body = next(iter(scene.body.values()))
    assert body.shape == "polygon"
    assert len(body.outline()) == 4
    assert area(scene) == pytest.approx(1.6e-3, rel=1e-12)


@pytest.mark.parametrize("draw", [half_round, bulged, lambda space: space.add_circle((0.0, 0.0), 20.0)])
def test_arcs_become_corners_near_them(drawn: Callable[..., Scene], draw: Callable[[Modelspace], None]) -> None:
    scene = drawn(draw)
    body = next(iter(scene.body.values())).outline() - next(iter(scene.body.values())).at
    whole = np.ptp(body[:, 1]) > 0.03
    assert area(scene) == pytest.approx((1.0 if whole else 0.5) * np.pi * 4e-4, rel=2e-3)
    assert len(body) < 200


@pytest.mark.parametrize(
    ("units", "keys", "metre"), [(6, {}, 1.0), (1, {}, 0.0254), (13, {}, 1e-6), (0, {"outline_unit": "cm"}, 0.01)]
)
def test_the_unit_is_the_drawings_or_as_given(
    drawn: Callable[..., Scene], units: int, keys: dict[str, str], metre: float
) -> None:
    small = [(0.04 * x / (40.0 * metre), 0.04 * y / (40.0 * metre)) for x, y in SQUARE]
    assert area(drawn(lambda space: space.add_lwpolyline(small, close=True), units, **keys)) == pytest.approx(1.6e-3)


def with_a_frame(space: Modelspace) -> None:
    """The square as a block on a layer of its own, and what hides nothing of it: a frame, hidden lines, a dimension."""
    block = space.doc.blocks.new("HOOD")
    block.add_lwpolyline(SQUARE, close=True)
    for name, state in (("machine", ""), ("old", "off"), ("sketch", "freeze")):
        layer = space.doc.layers.add(name)
        getattr(layer, state or "on")()
    space.add_blockref("HOOD", (40.0, 0.0), {"layer": "machine", "rotation": 90.0})
    for layer in ("old", "sketch"):
        space.add_circle((0.0, 0.0), 5.0, {"layer": layer})
    space.add_line((0.0, 0.0), (9.0, 9.0), {"invisible": 1})


def framed(space: Modelspace) -> None:
    with_a_frame(space)
    space.add_lwpolyline([(-500.0, -500.0), (500.0, -500.0), (500.0, 500.0), (-500.0, 500.0)], close=True)


@pytest.mark.parametrize(("draw", "keys"), [(with_a_frame, {}), (framed, {"outline_layer": "Machine"})])
def test_what_a_draughtsman_does_not_see_is_not_seen(
    draw: Callable[[Modelspace], object], keys: dict[str, str], drawn: Callable[..., Scene]
) -> None:
    assert area(drawn(draw, **keys)) == pytest.approx(1.6e-3)


def two(space: Modelspace) -> None:
    closed(space)
    space.add_circle((100.0, 0.0), 5.0)


@pytest.mark.parametrize(
    ("draw", "units", "keys", "says"),
    [
        (closed, 0, {}, 'does not say its unit; write outline_unit = "mm"'),
        (closed, 4, {"outline_unit": "kg"}, "outline_unit = 'kg': "),
        (closed, 4, {"outline_unit": "mile"}, "outline_unit = 'mile': 'mile' may be 1609 m or a sea mile"),
        (lambda space: space.add_lwpolyline(SQUARE, close=True, dxfattribs={"extrusion": (1, 0, 1)}), 4, {},
         "does not lie in the plane of x and y"),
        (two, 4, {}, "2 closed outlines and 0 lines that do not close; keep one"),
        (lambda space: space.add_lwpolyline(SQUARE), 4, {}, "0 closed outlines and 1 lines that do not close"),
        (lambda space: None, 4, {}, "no closed outline in it; draw one"),
        (lambda space: space.add_blockref("*Model_Space", (0, 0)), 4, {}, "holds blocks in each other, deeper than 16"),
        (closed, 4, {"outline_layer": "hod"}, "outline_layer = 'hod' (it has 0, Defpoints)"),
        (closed, 4, {"shape": "prism"}, "is its shape; delete shape and points"),
        (closed, 4, {"outline": "none.dxf"}, "No such file"),
    ],
)  # fmt: skip
def test_another_drawing_is_one_line_that_says_what_to_do(
    drawn: Callable[..., Scene], draw: Callable[[Modelspace], None], units: int, keys: dict[str, str], says: str
) -> None:
    with pytest.raises(SceneError) as problem:
        drawn(draw, units, **keys)
    assert says in str(problem.value)
    assert "\n" not in str(problem.value)
    assert "is no DXF drawing" not in str(problem.value)


def test_what_the_reader_mends_is_not_told_in_the_letters_of_the_file(
    tmp_path: Path, drawn: Callable[..., Scene], caplog: pytest.LogCaptureFixture
) -> None:
    drawn(closed)
    file = tmp_path / "hood.dxf"
    file.write_text(file.read_text().replace("  0\nLAYER\n", "  0\n\x1b[31mRED\n", 1))
    logging.getLogger("ezdxf").setLevel(logging.NOTSET)
    read_outline("hood.dxf", tmp_path)
    assert caplog.text == ""


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n", b"AutoCAD Binary DXF\r\n\x1a\x00", b"0\nSECTION\n2\n"])
def test_no_drawing_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.dxf").write_bytes(content)
    tables = shipped("vacuum").tables()
    name = next(iter(tables["body"]))
    with pytest.raises(SceneError, match=r"outline = 'bad.dxf'"):
        Scene.parse({**tables, "body": {name: {"outline": "bad.dxf"}}}, base=tmp_path)


def test_a_drawing_without_a_unit_is_not_read_in_metres(tmp_path: Path) -> None:
    """The entities alone, as small programs write them: no header."""
    ends = [(*SQUARE[n], *SQUARE[(n + 1) % 4]) for n in range(4)]
    parts = [f"0\nLINE\n8\n0\n10\n{a}\n20\n{b}\n11\n{c}\n21\n{d}\n" for a, b, c, d in ends]
    (tmp_path / "bare.dxf").write_text(f"0\nSECTION\n2\nENTITIES\n{''.join(parts)}0\nENDSEC\n0\nEOF\n")
    with pytest.raises(SceneError, match='does not say its unit; write outline_unit = "mm"'):
        read_outline("bare.dxf", tmp_path)
    assert len(read_outline("bare.dxf", tmp_path, "mm")) == 4


def test_lines_are_joined_in_a_time_that_grows_with_their_number(drawn: Callable[..., Scene]) -> None:
    """Each of 3000 loose lines is not compared with all others."""

    def loose(space: Modelspace) -> None:
        for start, end in np.random.default_rng(31).uniform(0.0, 100.0, (3000, 2, 2)):
            space.add_line(start, end)

    began = time.process_time()
    with pytest.raises(SceneError, match="0 closed outlines and"):
        drawn(loose)
    assert time.process_time() - began < 10.0


PATHS: dict[str, Callable[[str], dict[str, Any]]] = {
    "materials": lambda path: {"materials": path},
    "measured": lambda path: {"measured": path},
    "outline": lambda path: {"body": {"hood": {"outline": path}}},
    "vibration.samples": lambda path: {"vibration": {"samples": path}},
    "report.logo": lambda path: {"report": {"logo": path}},
    "air.case": lambda path: {"air": {"case": path}},
}


@pytest.mark.parametrize(("path", "says"), [("~nosuchuser/x", "no home of that user"), ("a\0b", "no path holds a")])
@pytest.mark.parametrize("key", PATHS)
def test_a_path_that_no_file_can_have_is_one_line(key: str, path: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=f"{key} = .*{says}"):
        Scene.parse({**shipped("vacuum").tables(), **PATHS[key](path)}, base=tmp_path)
