"""Bodies that stand on a side wall: they narrow the channel, and are part of its side."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from support import shipped
from wakeflow.air.foam.sanity import blockage
from wakeflow.air.mesh import SideInlet, build_mesh, plan_mesh, read_mesh
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import between_walls, contains, wall_edge
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.scene_lines import narrowest_gap
from wakeflow.planning.wake import family_of
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

WIDTH = 0.08
LEFT = np.array([[-0.04, -0.03], [-0.01, 0.0], [-0.04, 0.03]])
RIGHT = np.array([[0.04, -0.072], [0.04, -0.012], [0.01, -0.042]])
AREA = 0.5 * 0.03 * 0.06  # m2, of each
CALM = {"collisions": False, "air-loading": False}


def test_the_edge_on_a_wall_is_found_whichever_corner_comes_first() -> None:
    for shift in range(3):
        edge = wall_edge(np.roll(LEFT, shift, axis=0), WIDTH / 2)
        assert edge is not None
        assert (edge.side, edge.low, edge.high) == ("left", -0.03, 0.03)
        assert np.roll(LEFT, shift, axis=0)[edge.first, 1] == 0.03  # counter-clockwise: down the left wall
    assert wall_edge(RIGHT, WIDTH / 2).side == "right"  # type: ignore[union-attr]
    for other in (
        0.9 * LEFT,  # in the air
        LEFT * (1.1, 1.0),  # through the wall
        np.array([[-0.04, 0.0], [-0.01, -0.01], [-0.01, 0.01]]),  # by a corner
        np.array([[-0.04, -0.01], [0.04, -0.01], [0.0, 0.01]]),  # from wall to wall
    ):
        assert wall_edge(other, WIDTH / 2) is None


def test_the_way_between_bodies_on_both_walls_is_measured_aslant() -> None:
    corner = np.linalg.norm(LEFT[1] - RIGHT[2])  # apex to apex; the faces are parallel, farther along
    faces = abs(float((RIGHT[2] - LEFT[1]) @ (1.0, -1.0))) / math.sqrt(2.0)
    assert between_walls([LEFT, RIGHT], WIDTH) == pytest.approx(min(corner, faces))
    assert between_walls([LEFT], WIDTH) == math.inf
    outlines = [[(float(x), float(y)) for x, y in one] for one in (LEFT, RIGHT)]
    assert blockage(outlines, WIDTH) == pytest.approx(1.0 - faces / WIDTH)  # what bounds of the airflow go by
    assert blockage(outlines[:1], WIDTH) == pytest.approx(0.03 / WIDTH, rel=1e-4)
    gap = narrowest_gap(shipped("zigzag"))
    assert gap is not None
    assert gap.free == pytest.approx(faces, rel=1e-6)
    assert gap.speed == pytest.approx(2.4 * WIDTH / faces)


@pytest.mark.parametrize("walls", ["slip", "no-slip"])
def test_the_mesh_leaves_the_bodies_out_and_names_their_faces(tmp_path: Path, walls: str) -> None:
    """Its area is the channel's less theirs, and its boundary goes round them: each patch as long as it is."""
    spec = plan_mesh(
        [LEFT, RIGHT], width=WIDTH, top=0.1, bottom=-0.15, names=["one", "two"], walls=walls, scale=2.0, extend=False
    )
    assert not spec.half
    build_mesh(spec, tmp_path)
    points, cells, boundary = read_mesh(tmp_path / "mesh.msh")
    x, y = points.T
    whole = sum(
        0.5 * abs((x[c] * y[np.roll(c, -1, axis=1)] - x[np.roll(c, -1, axis=1)] * y[c]).sum(axis=1)).sum()
        for c in cells.values()
    )
    assert whole == pytest.approx(WIDTH * 0.25 - 2.0 * AREA, rel=1e-9)
    assert set(boundary) == {"inlet", "outlet", "left", "right", "body_one", "body_two"}
    for corner in (*LEFT, *RIGHT):
        assert np.linalg.norm(points - corner, axis=1).min() < 1e-12


def test_a_stream_beside_a_body_on_the_wall_is_part_of_the_side(tmp_path: Path) -> None:
    spec = plan_mesh(
        [LEFT, RIGHT], width=WIDTH, top=0.1, bottom=-0.15, names=["one", "two"], scale=2.0, extend=False,
        inlets=[SideInlet("jet", "left", 0.04, 0.05)],
    )  # fmt: skip
    build_mesh(spec, tmp_path)
    assert "inlet_jet" in read_mesh(tmp_path / "mesh.msh")[2]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"body.first.points": [[-0.045, -0.03], [-0.01, 0.0], [-0.045, 0.03]]}, "or one edge on it"),
        ({"body.first.points": [[-0.04, -0.03], [0.04, 0.0], [-0.04, 0.03]]}, "or one edge on it"),
        ({"vibration": {"frequency": "10 Hz", "amplitude": "1 mm"}}, r"stands on the left wall, and \[vibration\]"),
        ({"bin.side": {"on": "left", "from": 0.0, "to": 0.02}}, "bin.side is where body.first stands"),
        (
            {"channel.inlet.jet": {"side": "right", "position": -0.04, "width": 0.01, "velocity": 1.0}},
            "channel.inlet.jet is where body.second stands on the right wall",
        ),
    ],
)
def test_what_cannot_stand_on_a_wall_is_told_in_one_line(changes: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        shipped("zigzag", changes)


def mirrored(scene: Scene) -> Scene:
    """The scene in a mirror about x = 0."""
    tables = scene.tables()
    for body in tables["body"].values():
        body["points"] = [[-x, y] for x, y in reversed(body["points"])]
    tables["feed"]["position"] *= -1.0
    return Scene.parse(tables)


def test_granules_slide_from_face_to_face_and_none_enters_a_body_or_a_corner() -> None:
    """Through air at rest, beside its mirror image: they end on the floor, after some impacts each."""
    scene = shipped("zigzag", {"air.speed": 0.0, "air.profile": "uniform", "numerics.rung": "auto", "feed.count": 64})
    found = []
    for one in (scene, mirrored(scene)):
        tracked = Pipeline(one, make_plan(one, force=CALM)).tracks()
        landing = tracked.landings["wheat"]
        assert np.all(landing.bin == list(scene.bin).index("heavy"))
        assert landing.impacts.mean() > 4.0
        assert landing.impacts.min() >= 2
        places = np.concatenate([path["position"] for path in tracked.drawn["wheat"]])
        for body in one.body.values():
            middle = body.outline().mean(axis=0)
            assert not contains(middle + 0.999 * (body.outline() - middle), places).any()
        found.append(float(landing.time.mean()))
    assert found[0] == pytest.approx(found[1], rel=0.05)


@pytest.mark.openfoam
def test_the_shipped_zigzag_parts_chaff_from_wheat() -> None:
    """On a coarse mesh: air goes through it, its mass is kept, and each fraction ends where it is wanted."""
    scene = shipped("zigzag", {"feed.count": 64, "numerics.mesh_scale": 2.5})
    pipeline = Pipeline(scene, make_plan(scene, force=CALM))
    assert abs(pipeline.airflow.mass_error or 0.0) < 1e-3
    assert set(pipeline.airflow.cd_of or {}) == set(scene.body)
    shares = {
        name: {place: float(np.mean(one.bin == i)) for i, place in enumerate(scene.bin)}
        for name, one in pipeline.tracks().landings.items()
    }
    assert shares["wheat"]["heavy"] > 0.9
    assert shares["chaff"]["light"] > 0.9


def test_a_body_on_a_wall_is_no_shape_of_the_measured_wakes() -> None:
    points = [[-0.04, -0.002], [0.0, -0.002], [0.0, 0.002], [-0.04, 0.002]]
    tables = shipped("zigzag").tables()
    tables["body"] = {"step": {"shape": "polygon", "points": points}}
    assert not family_of(Scene.parse(tables)).name
    tables["body"]["step"]["at"] = [0.015, 0.0]
    assert family_of(Scene.parse(tables)).name == "plate"
