"""The mesh: deterministic, named, graded, fit for a solver, for every shape of body."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wakeflow.errors import MeshError, SceneError
from wakeflow.geometry import area
from wakeflow.laws.shape import shapes
from wakeflow.meshing import MeshSpec, build_mesh, plan_mesh, read_mesh

RHOMBUS = shapes["rhombus"](width=0.05, slope_angle=np.pi / 4)
BODIES = {
    "rhombus": [RHOMBUS],
    "prism apex up": [shapes["prism"](width=0.05, slope_angle=np.pi / 3)],
    "prism apex down": [shapes["prism"](width=0.05, slope_angle=np.pi / 3, apex="down")],
    "flat rhombus": [shapes["rhombus"](width=0.05, height=0.01)],
    "polygon": [shapes["polygon"](points=[(-0.02, -0.03), (0.03, -0.01), (0.01, 0.03), (-0.03, 0.02)])],
    "two bodies": [RHOMBUS, RHOMBUS + np.array([0.06, -0.08])],
    "two on the axis": [RHOMBUS, RHOMBUS * 0.5 + np.array([0.0, -0.1])],
}


def coarse(bodies: list[np.ndarray], **how: object) -> MeshSpec:
    return plan_mesh(bodies, **{"width": 0.3, "top": 0.2, "bottom": -0.45, "scale": 2.0, **how})  # type: ignore[arg-type]


def cell_areas(points: np.ndarray, cells: dict[str, np.ndarray]) -> np.ndarray:
    x = [points[block, 0] for block in cells.values()]
    y = [points[block, 1] for block in cells.values()]
    return np.concatenate(
        [0.5 * (a * np.roll(b, -1, axis=1) - np.roll(a, -1, axis=1) * b).sum(axis=1) for a, b in zip(x, y, strict=True)]
    )


@pytest.mark.parametrize(("name", "rung"), list(itertools.product(BODIES, ["draft", "standard"])))
def test_every_shape_gives_a_sound_mesh_with_named_patches(name: str, rung: str, tmp_path: Path) -> None:
    spec = coarse(BODIES[name], rung=rung, names=[f"b{i}" for i in range(len(BODIES[name]))])
    report = build_mesh(spec, tmp_path)
    assert spec.half == (rung == "draft" and name not in ("polygon", "two bodies"))
    assert set(report.boundary) == set(spec.patches) - {"front", "back"}
    assert report.min_angle > 15
    assert report.max_angle < 165
    assert report.max_aspect < 8
    assert report.triangles < 0.05 * report.cells
    points, cells, _ = read_mesh(tmp_path / "mesh.msh")
    air = spec.width * (spec.top - spec.bottom) - sum(area(body) for body in BODIES[name])
    areas = cell_areas(points, cells)
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(air / 2 if spec.half else air, rel=1e-9)
    assert json.loads((tmp_path / "mesh.json").read_text())["cells"] == report.cells == len(areas)
    assert (tmp_path / "mesh.vtu").stat().st_size > 0


def test_the_same_spec_gives_the_same_mesh_to_the_byte(tmp_path: Path) -> None:
    spec = coarse([RHOMBUS])
    for name in ("one", "two"):
        build_mesh(spec, tmp_path / name)
    assert (tmp_path / "one" / "mesh.msh").read_bytes() == (tmp_path / "two" / "mesh.msh").read_bytes()


def test_cells_are_smallest_at_corners_and_small_in_the_wake_only(tmp_path: Path) -> None:
    spec = coarse([RHOMBUS], rung="standard", direction="down")
    build_mesh(spec, tmp_path)
    points, cells, _ = read_mesh(tmp_path / "mesh.msh")
    centres = np.vstack([points[block].mean(axis=1) for block in cells.values()])
    size = np.sqrt(cell_areas(points, cells))

    def typical(x: float, y: float, radius: float) -> float:
        near = np.linalg.norm(centres - (x, y), axis=1) < radius
        assert near.any()
        return float(np.median(size[near]))

    corner, behind, ahead = typical(0.026, 0.0, 0.003), typical(0.0, -0.08, 0.01), typical(0.0, 0.15, 0.02)
    assert corner < 1.6 * spec.h_corner
    assert behind == pytest.approx(spec.h_wake, rel=0.4)
    assert ahead > 2 * behind


def test_neighbouring_cells_grow_smoothly(tmp_path: Path) -> None:
    build_mesh(coarse([RHOMBUS], rung="standard"), tmp_path)
    points, cells, _ = read_mesh(tmp_path / "mesh.msh")
    areas = cell_areas(points, cells)
    owner: dict[tuple[int, int], list[int]] = {}
    number = itertools.count()
    for block in cells.values():
        for cell in block:
            index = next(number)
            for a, b in zip(cell, np.roll(cell, -1), strict=True):
                owner.setdefault((min(a, b), max(a, b)), []).append(index)
    pairs = np.array([both for both in owner.values() if len(both) == 2])
    ratio = areas[pairs].max(axis=1) / areas[pairs].min(axis=1)
    assert np.quantile(ratio, 0.99) < 2.5


def test_cells_grow_fourfold_when_every_edge_is_halved(tmp_path: Path) -> None:
    spec = coarse([RHOMBUS])
    counts = [build_mesh(spec.scaled(factor), tmp_path / str(factor)).cells for factor in (1.0, 0.5)]
    assert counts[1] / counts[0] == pytest.approx(4, rel=0.12)


def test_a_short_channel_is_meshed_longer_along_the_air() -> None:
    down = coarse([RHOMBUS], top=0.05, bottom=-0.06)
    up = coarse([RHOMBUS], top=0.05, bottom=-0.06, direction="up")
    assert (down.top, down.bottom) == pytest.approx((0.025 + 0.15, -0.025 - 0.4))
    assert (up.top, up.bottom) == pytest.approx((0.025 + 0.4, -0.025 - 0.15))
    assert coarse([RHOMBUS], bottom=-2.0).bottom == -2.0


def test_narrow_gaps_and_short_edges_get_cells_of_their_own() -> None:
    wide, narrow = coarse([RHOMBUS], scale=1.0), coarse([RHOMBUS], scale=1.0, width=0.054)
    assert wide.h_body == pytest.approx(0.05 / 60)
    assert narrow.h_body == pytest.approx(0.002 / 8)
    blunt = shapes["polygon"](points=[(-0.025, 0), (-0.001, -0.02), (0.001, -0.02), (0.025, 0), (0, 0.02)])
    assert coarse([blunt], scale=1.0).h_body == pytest.approx(0.002 / 6)


@pytest.mark.parametrize(
    ("bodies", "width", "word"),
    [
        ([RHOMBUS], 0.05, "inside the channel"),
        ([RHOMBUS, RHOMBUS + np.array([0.01, 0.01])], 0.3, "touch"),
        ([RHOMBUS, RHOMBUS * 0.2], 0.3, "touch"),
        ([RHOMBUS, RHOMBUS + np.array([0.05, 0.0])], 0.3, "touch"),
    ],
)
def test_bodies_that_touch_are_refused_in_one_line(bodies: list[np.ndarray], width: float, word: str) -> None:
    with pytest.raises(SceneError, match=word) as refused:
        coarse(bodies, width=width)
    assert "\n" not in str(refused.value)


def test_a_rung_without_a_mesh_is_refused() -> None:
    with pytest.raises(SceneError, match="reference"):
        coarse([RHOMBUS], rung="reference")


def test_a_mesh_that_gmsh_cannot_make_is_a_mesh_error_with_its_log(tmp_path: Path) -> None:
    crossed = ((0.02, 0.0), (-0.02, 0.02), (0.02, 0.02), (-0.02, 0.0))
    spec = replace(coarse([RHOMBUS], rung="standard"), bodies=(crossed,))
    with pytest.raises(MeshError) as failed:
        build_mesh(spec, tmp_path)
    assert failed.value.log == tmp_path / "log.gmsh"
    assert not (tmp_path / "mesh.msh").exists()
