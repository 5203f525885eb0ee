"""What is dragged: a point that stays where it is changes nothing, one that moves takes its keys along."""

import tomllib

import numpy as np
import pytest

from support import shipped
from wakeflow.core.files import scene_templates
from wakeflow.extras.page.document import SceneDocument
from wakeflow.extras.page.handles import Handle, dragged, handles_of, step_of
from wakeflow.scene import Scene

KINDS = [*scene_templates()]
SHAPES = {
    "polygon": {"shape": "polygon", "points": [["-20 mm", "-10 mm"], ["20 mm", "-10 mm"], ["0 mm", "20 mm"]]},
    "plate": {"shape": "plate", "length": "60 mm", "thickness": "4 mm", "slope_angle": "30 deg"},
    "left plate": {
        "shape": "plate", "length": "60 mm", "thickness": "4 mm", "slope_angle": "30 deg", "descends": "left"
    },
    "circle": {"shape": "circle", "width": "40 mm"},
    "tall prism": {"shape": "prism", "width": "40 mm", "height": "60 mm"},
    "hanging prism": {"shape": "prism", "width": "40 mm", "slope_angle": "50 deg", "apex": "down"},
}  # fmt: skip


def _moved(document: SceneDocument, name: str, by: tuple[float, float]) -> tuple[Handle, Handle, Scene]:
    """The handle before, after, and the scene after it was dragged by so much (m)."""
    scene, data = document.look.scene, document.look.data
    assert scene is not None
    assert data is not None
    handle = handles_of(scene)[name]
    document.set(dragged(handle, scene, data, handle.point[0] + by[0], handle.point[1] + by[1]))
    after = document.look.scene
    assert after is not None, document.look.mistake
    return handle, handles_of(after)[name], after


def _document(kind: str) -> SceneDocument:
    return SceneDocument(scene_templates()[kind].read_text(), base=scene_templates()[kind].parent)


@pytest.mark.parametrize("kind", KINDS)
def test_a_point_that_stays_leaves_the_machine(kind: str) -> None:
    document = _document(kind)
    scene, data = document.look.scene, document.look.data
    assert scene is not None
    assert data is not None
    for handle in handles_of(scene).values():
        document.set(dragged(handle, scene, data, *handle.point))
    after = document.look.scene
    assert after is not None, document.look.mistake
    for name, body in scene.body.items():
        assert np.allclose(after.body[name].outline(), body.outline(), atol=step_of(scene))
    for name, one in scene.bin.items():
        assert np.allclose(after.bin[name].line(after), one.line(scene), atol=step_of(scene))
    assert after.feed.position == pytest.approx(scene.feed.position, abs=step_of(scene))


@pytest.mark.parametrize("shape", SHAPES)
def test_each_point_of_each_shape_follows_the_mouse(shape: str) -> None:
    tables = shipped("rhombus").tables()
    tables["body"] = {"one": SHAPES[shape] | {"at": [0.01, 0.0]}}
    for name in [name for name in handles_of(Scene.parse(tables)) if name.startswith("body.")]:
        document = SceneDocument(Scene.parse(tables).as_toml())
        before, after, _ = _moved(document, name, (0.01 if "x" in before_ways(tables, name) else 0.0, 0.006))
        for i, way in enumerate("xy"):
            if way in before.ways:
                assert after.point[i] == pytest.approx(before.point[i] + (0.01, 0.006)[i], abs=1.5e-3), name


def before_ways(tables: dict[str, object], name: str) -> str:
    return handles_of(Scene.parse(tables))[name].ways


def test_a_divider_moves_both_bins_and_is_written_in_their_unit() -> None:
    document = _document("rhombus")
    _, _, scene = _moved(document, "divider bin.middle.to", (0.012, 0.3))
    assert scene.bin["middle"].to == scene.bin["inner-right"].start == pytest.approx(0.092)
    bins = tomllib.loads(document.text)["bin"]
    assert bins["middle"]["to"] == bins["inner-right"]["from"] == "92 mm"
    assert document.text.count("# below the suction zone") == 1


def test_a_number_without_a_unit_stays_one() -> None:
    document = SceneDocument(shipped("rhombus").as_toml().replace('"80 mm"', "0.08").replace('"0.08 m"', "0.08"))
    _, _, scene = _moved(document, "divider bin.middle.to", (0.01, 0.0))
    assert scene.bin["middle"].to == pytest.approx(0.09)


def test_turning_a_face_keeps_the_width() -> None:
    document = _document("prism")
    _, _, scene = _moved(document, "body.prism slope", (0.0, -0.008))
    body = scene.body["prism"]
    assert np.ptp(body.outline()[:, 0]) == pytest.approx(0.05)
    assert body.slope_angle is not None
    assert np.degrees(body.slope_angle) == pytest.approx(52.5, abs=2.0)
