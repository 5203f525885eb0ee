"""The mesh: deterministic, named, graded, fit for a solver, for every shape of body."""

import itertools
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from support import RHOMBUS
from wakeflow.air.mesh import MeshSpec, SideInlet, build_mesh, ends, plan_mesh, read_mesh
from wakeflow.air.mesh.sizing import sources
from wakeflow.air.mesh.spec import MeshReport
from wakeflow.core.code_key import code_key
from wakeflow.core.errors import MeshError, SceneError
from wakeflow.core.geometry import area, distance_to
from wakeflow.core.record import load
from wakeflow.core.store import Store, cache_root, content_key
from wakeflow.laws.shape import shapes


def circle(points: int, width: float = 0.05) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    return 0.5 * width * np.column_stack([np.cos(angle), np.sin(angle)])


def rounded(outline: np.ndarray, radius: float, points: int = 9) -> np.ndarray:
    """A convex outline with arcs of ``points`` corners for corners."""
    made = []
    for before, corner, after in zip(np.roll(outline, 1, axis=0), outline, np.roll(outline, -1, axis=0), strict=True):
        into, out = (corner - before, after - corner)
        start, end = (np.arctan2(along[1], along[0]) - np.pi / 2 for along in (into, out))
        turn = (end - start) % (2 * np.pi)
        bisector = (out / np.linalg.norm(out) - into / np.linalg.norm(into)) / np.linalg.norm(
            out / np.linalg.norm(out) - into / np.linalg.norm(into)
        )
        centre = corner + bisector * radius / np.cos(turn / 2)
        angle = start + np.linspace(0, turn, points)
        made.append(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(made)


BODIES = {
    "rhombus": [RHOMBUS],
    "prism apex up": [shapes["prism"](width=0.05, slope_angle=np.pi / 3)],
    "prism apex down": [shapes["prism"](width=0.05, slope_angle=np.pi / 3, apex="down")],
    "flat rhombus": [shapes["rhombus"](width=0.05, height=0.01)],
    "polygon": [shapes["polygon"](points=[(-0.02, -0.03), (0.03, -0.01), (0.01, 0.03), (-0.03, 0.02)])],
    "two bodies": [RHOMBUS, RHOMBUS + np.array([0.06, -0.08])],
    "two on the axis": [RHOMBUS, RHOMBUS * 0.5 + np.array([0.0, -0.1])],
    "fine circle": [circle(720)],
    "coarse circle": [circle(48)],
    "circle off the axis": [circle(360) + np.array([0.01, 0.0])],
    "rounded rhombus": [rounded(RHOMBUS, 0.005)],
    "hardly rounded rhombus": [rounded(RHOMBUS, 0.0002)],
    "very round prism": [rounded(shapes["prism"](width=0.05, slope_angle=np.pi / 3), 0.01, 25)],
    "three bodies": [RHOMBUS, RHOMBUS * 0.7 + np.array([0.05, -0.05]), circle(200, 0.02) + np.array([-0.04, -0.06])],
}
LEANING = ("polygon", "two bodies", "circle off the axis", "three bodies")


def coarse(bodies: list[np.ndarray], **how: object) -> MeshSpec:
    return plan_mesh(bodies, **{"width": 0.3, "top": 0.2, "bottom": -0.45, "scale": 2.0, **how})  # type: ignore[arg-type]


def meshed(spec: MeshSpec) -> tuple[Path, MeshReport]:
    """Folder and report of a mesh, kept between sessions until the code that makes it, or Gmsh, is another."""
    key = content_key(repr(spec), code_key("wakeflow.air.mesh"), version("gmsh"))
    folder, _ = Store(cache_root()).make("tested-mesh", key, lambda part: build_mesh(spec, part))
    return folder, load(MeshReport, folder / "mesh.json")


def cell_areas(points: np.ndarray, cells: dict[str, np.ndarray]) -> np.ndarray:
    x = [points[block, 0] for block in cells.values()]
    y = [points[block, 1] for block in cells.values()]
    return np.concatenate(
        [0.5 * (a * np.roll(b, -1, axis=1) - np.roll(a, -1, axis=1) * b).sum(axis=1) for a, b in zip(x, y, strict=True)]
    )


def test_reading_meshes_in_two_threads_leaves_standard_output_alone(capsys: pytest.CaptureFixture[str]) -> None:
    """It is the process's: who turns it aside for a moment in one thread may turn it aside for good."""
    folder, _ = meshed(coarse(BODIES["rhombus"]))
    before = sys.stdout
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(read_mesh, folder / "mesh.msh") for _ in range(4)]
        while not all(job.done() for job in jobs):
            assert sys.stdout is before
    assert all(len(job.result()) == 3 for job in jobs)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("name", "rung"),
    [  # a body that leans is whole in both rungs, in cells of other sizes
        pytest.param(name, rung, marks=[pytest.mark.slow] if rung == "draft" and name in LEANING else [])
        for name, rung in itertools.product(BODIES, ["draft", "standard"])
    ],
)
def test_every_shape_gives_a_sound_mesh_with_named_patches(name: str, rung: str) -> None:
    spec = coarse(BODIES[name], rung=rung, names=[f"b{i}" for i in range(len(BODIES[name]))])
    folder, report = meshed(spec)
    assert spec.half == (rung == "draft" and name not in LEANING)
    assert set(report.boundary) == set(spec.patches) - {"front", "back"}
    assert report.min_angle > 15
    assert report.max_angle < 165
    assert report.max_aspect < 8
    assert report.triangles < 0.05 * report.cells
    points, cells, _ = read_mesh(folder / "mesh.msh")
    air = spec.width * (spec.top - spec.bottom) - sum(area(body) for body in BODIES[name])
    areas = cell_areas(points, cells)
    assert (areas > 0).all()
    exact = 2e-4 if any(len(body) > 50 for body in BODIES[name]) or "round" in name else 1e-9
    assert areas.sum() == pytest.approx(air / 2 if spec.half else air, rel=exact)
    assert json.loads((folder / "mesh.json").read_text())["cells"] == report.cells == len(areas)
    assert (folder / "mesh.vtu").stat().st_size > 0


def test_a_cell_that_gmsh_folds_over_is_not_kept() -> None:
    """At this size of cells Gmsh 4.15 lays a triangle into the tip of the second rhombus."""
    steep = shapes["rhombus"](width=0.05, slope_angle=np.radians(75))
    bodies = [steep, steep + np.array([0.0375, 0.05 + float(np.ptp(steep[:, 1]))])]
    top, bottom = float(bodies[1][:, 1].max()) + 0.05, float(steep[:, 1].min()) - 0.05
    how = {"width": 0.5, "top": top, "bottom": bottom, "direction": "up", "walls": "no-slip", "rung": "draft"}
    for scale in (2.7, 2.9201969796573657):
        spec = plan_mesh(bodies, scale=scale, **how)  # type: ignore[arg-type]
        folder, _ = meshed(spec)
        points, cells, _ = read_mesh(folder / "mesh.msh")
        air = spec.width * (spec.top - spec.bottom) - sum(area(body) for body in bodies)
        assert cell_areas(points, cells).sum() == pytest.approx(air, rel=1e-9)


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
    centres[:, 0] = np.abs(centres[:, 0])  # both corners: either has but eight cells around it
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
    assert np.quantile(ratio, 0.99) < 2.6  # the worst lie at the body, where quads meet: 2.4 to 2.55 by mesh


def test_cells_grow_fourfold_when_every_edge_is_halved(tmp_path: Path) -> None:
    spec = coarse([RHOMBUS])
    counts = [build_mesh(spec.scaled(factor), tmp_path / str(factor)).cells for factor in (1.0, 0.5)]
    assert counts[1] / counts[0] == pytest.approx(4, rel=0.12)


def test_a_short_channel_is_meshed_longer_along_the_air() -> None:
    down = coarse([RHOMBUS], top=0.05, bottom=-0.06)
    up = coarse([RHOMBUS], top=0.05, bottom=-0.06, direction="up")
    before, behind = (distance * 0.05 for distance in ends(0.3 / 0.05))
    assert (down.top, down.bottom) == pytest.approx((0.025 + before, -0.025 - behind))
    assert (up.top, up.bottom) == pytest.approx((0.025 + behind, -0.025 - before))
    assert coarse([RHOMBUS], bottom=-2.0).bottom == -2.0


def test_inlet_and_outlet_are_so_far_off_that_they_send_little_back() -> None:
    """Of what a body does to the air between slip walls; no nearer than the wake is long, no farther than is usual."""
    for width in (1.2, 4.0, 6.0, 8.0, 12.0, 50.0):
        before, behind = ends(width)
        assert 3.0 <= before <= 10.0
        assert 8.0 <= behind <= 20.0
        assert np.exp(-2 * np.pi * before / width) <= 0.00101 or before == 10.0
        assert np.exp(-np.pi * behind / width) <= 0.00101 or behind == 20.0


def test_cells_grow_towards_inlet_and_outlet_but_not_where_granules_fly(tmp_path: Path) -> None:
    spec = plan_mesh([RHOMBUS], width=0.4, top=0.2, bottom=-0.2, rung="standard")
    build_mesh(spec, tmp_path)
    points, cells, _ = read_mesh(tmp_path / "mesh.msh")
    centres = np.vstack([points[block].mean(axis=1) for block in cells.values()])
    size = np.sqrt(cell_areas(points, cells))
    assert size[(centres[:, 1] < 0.2) & (centres[:, 1] > -0.2)].max() < 1.4 * spec.h_far
    assert size[centres[:, 1] < spec.bottom + 0.05].mean() > 1.7 * spec.h_far
    everywhere = build_mesh(replace(spec, h_end=0.0), tmp_path / "fine").cells
    assert len(size) < 0.95 * everywhere


def edge_wanted(spec: MeshSpec, x: float, y: float) -> float:
    return float(sources(spec).at(np.array([[x, y]]))[0])


def test_short_edges_and_narrow_gaps_get_small_cells_where_they_are_and_only_there() -> None:
    blunt = shapes["polygon"](points=[(-0.025, 0), (-0.001, -0.02), (0.001, -0.02), (0.025, 0), (0, 0.02)])
    spec = coarse([blunt], scale=1.0)
    assert edge_wanted(spec, 0.0, -0.02) == pytest.approx(0.002 / 6, rel=0.02)
    assert edge_wanted(spec, 0.0125, 0.01) == pytest.approx(spec.h_body, rel=0.05)
    narrow = coarse([RHOMBUS], scale=1.0, width=0.054)
    assert edge_wanted(narrow, 0.025, 0.0) == pytest.approx(0.002 / 8)
    assert edge_wanted(narrow, 0.0125, 0.0125) == pytest.approx(narrow.h_body, rel=0.05)
    pair = coarse([RHOMBUS, RHOMBUS * 3 + np.array([0.0, -0.11])], scale=1.0, width=0.5)
    assert edge_wanted(pair, 0.0, -0.025) == pytest.approx(0.01 / 8 if pair.h_corner > 0.01 / 8 else pair.h_corner)
    assert edge_wanted(pair, 0.0375, -0.1475) == pytest.approx(3 * pair.h_body, rel=0.05)


@pytest.mark.parametrize("name", ["fine circle", "rounded rhombus", "hardly rounded rhombus", "very round prism"])
def test_the_boundary_keeps_to_a_smooth_outline_with_cells_of_the_size_wanted(name: str) -> None:
    spec = coarse(BODIES[name], rung="standard")
    folder, report = meshed(spec)
    points, cells, _ = read_mesh(folder / "mesh.msh")
    outline = BODIES[name][0]
    ends = boundary_edges(cells)
    ends = ends[(np.abs(points[ends]) < 0.06).all(axis=(1, 2))]
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    assert len(ends) == report.boundary["body_0"]
    off = np.maximum(distance_to(points[ends].mean(axis=1), outline), distance_to(points[ends[:, 0]], outline))
    wanted = sources(spec).at(points[ends].mean(axis=1))
    assert (off / wanted).max() < (0.15 if "hardly" in name else 0.05)
    assert np.quantile(length / wanted, 0.9) < 1.3
    assert np.quantile(length / wanted, 0.1) > 0.55
    assert report.smallest_edge > 0.5 * spec.h_corner


def boundary_edges(cells: dict[str, np.ndarray]) -> np.ndarray:
    pairs = np.concatenate(
        [np.stack([block, np.roll(block, -1, axis=1)], axis=2).reshape(-1, 2) for block in cells.values()]
    )
    _, first, count = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True)
    return pairs[first[count == 1]]


def test_triangles_are_a_way_to_mesh(tmp_path: Path) -> None:
    report = build_mesh(coarse([RHOMBUS], strategy="triangles"), tmp_path)
    assert (report.quads, report.triangles) == (0, report.cells)
    assert json.loads((tmp_path / "mesh.json").read_text()) == asdict(report)
    assert report.min_angle > 25


def test_cells_stand_near_to_their_neighbours_in_memory(tmp_path: Path) -> None:
    """Gauss-Seidel and the cache want it: the reach of a cell's points is near the square root of their number."""
    report = build_mesh(coarse([RHOMBUS], rung="standard", scale=1.5), tmp_path)
    _, cells, _ = read_mesh(tmp_path / "mesh.msh")
    reach = np.concatenate([np.ptp(block, axis=1) for block in cells.values()])
    assert reach.max() < 5 * np.sqrt(report.points)


STREAMS = (SideInlet("low", "left", -0.2, -0.15), SideInlet("high", "right", 0.0, 0.06))
MIRRORED = (SideInlet("a", "left", -0.2, -0.15), SideInlet("b", "right", -0.2, -0.15))


@pytest.mark.parametrize("direction", ["down", "up"])
def test_openings_in_the_side_walls_are_patches_of_their_own(direction: str, tmp_path: Path) -> None:
    spec = coarse([RHOMBUS], inlets=STREAMS, direction=direction, top=0.5)
    assert not spec.half
    assert {"inlet_low", "inlet_high"} < set(spec.patches)
    report = build_mesh(spec, tmp_path)
    assert set(report.boundary) == set(spec.patches) - {"front", "back"}
    assert report.boundary["inlet_low"] >= 4
    points, cells, _ = read_mesh(tmp_path / "mesh.msh")
    nodes = points[np.unique(boundary_edges(cells))]
    for inlet in STREAMS:
        side = -0.15 if inlet.side == "left" else 0.15
        for y in (inlet.start, inlet.end):
            assert np.linalg.norm(nodes - (side, y), axis=1).min() < 1e-9


def test_a_half_domain_needs_openings_that_mirror_each_other(tmp_path: Path) -> None:
    half = coarse([RHOMBUS], inlets=MIRRORED)
    assert half.half
    assert set(build_mesh(half, tmp_path).boundary) == {"inlet", "outlet", "axis", "right", "inlet_b", "body_0"}
    assert not coarse([RHOMBUS], inlets=MIRRORED, half=False).half
    assert not coarse([RHOMBUS], inlets=STREAMS).half
    with pytest.raises(SceneError, match="symmetric"):
        coarse([RHOMBUS], inlets=STREAMS, half=True)


@pytest.mark.parametrize(
    ("inlets", "word"),
    [
        ([SideInlet("a", "left", 0.1, 0.0)], "must rise"),
        ([SideInlet("a", "left", 0.1, 0.3)], "within the channel"),
        ([SideInlet("a", "left", 0.0, 0.1), SideInlet("b", "left", 0.05, 0.15)], "overlap"),
        ([SideInlet("a", "left", 0.0, 0.1), SideInlet("a", "right", 0.0, 0.1)], "called"),
    ],
)
def test_openings_that_cannot_be_are_refused_in_one_line(inlets: list[SideInlet], word: str) -> None:
    with pytest.raises(SceneError, match=word) as refused:
        coarse([RHOMBUS], inlets=inlets)
    assert "\n" not in str(refused.value)


def test_the_channel_is_meshed_exactly_when_it_must_not_be_extended(tmp_path: Path) -> None:
    """The DFG cylinder: a circle near the inlet of a channel with no-slip walls, a little off its axis."""
    body = circle(360, 0.1) + np.array([0.005, 0.0])
    spec = plan_mesh(
        [body], width=0.41, top=0.2, bottom=-2.0, walls="no-slip", extend=False, scale=2.0, rung="standard"
    )
    assert (spec.top, spec.bottom) == (0.2, -2.0)
    report = build_mesh(spec, tmp_path)
    points, _, _ = read_mesh(tmp_path / "mesh.msh")
    assert (points.min(axis=0), points.max(axis=0)) == (pytest.approx([-0.205, -2.0]), pytest.approx([0.205, 0.2]))
    assert report.boundary["left"] == pytest.approx(2.2 / spec.h_wall, rel=0.1)


SLOPES, BLOCKAGES = (10, 45, 80), (0.02, 0.2, 0.5)
OTHERS = {"rhombus": "standard", "prism": "draft"}  # of the range each shape in one rung, so that both meet all of it


@pytest.mark.parametrize(
    ("shape", "slope", "blockage", "rung"),
    [
        pytest.param(shape, slope, blockage, rung, marks=[pytest.mark.slow] if rung == OTHERS[shape] else [])
        for shape, slope, blockage, rung in itertools.product(OTHERS, SLOPES, BLOCKAGES, ["draft", "standard"])
        if (slope != 45) == (blockage != 0.2)
    ],
)
def test_slopes_and_blockages_of_the_whole_range_mesh_with_few_sound_cells(
    shape: str, slope: float, blockage: float, rung: str
) -> None:
    body = shapes[shape](width=0.05, slope_angle=np.radians(slope))
    spec = plan_mesh([body], width=0.05 / blockage, top=0.4, bottom=-0.4, rung=rung)
    _, report = meshed(spec)
    assert 1000 < report.cells < 30_000
    assert report.min_angle > 18
    assert report.max_angle < 165
    assert report.max_aspect < 8
    assert report.smallest_edge > 0.3 * spec.h_corner


def test_the_three_grids_of_a_study_are_similar() -> None:
    fine, usual, rough = (coarse([RHOMBUS], scale=scale, rung="standard") for scale in (1 / 1.5, 1.0, 1.5))
    for name in ("h_body", "h_corner", "h_wake", "growth", "of_edge", "of_gap"):
        assert getattr(fine.scaled(1.5), name) == pytest.approx(getattr(usual, name))
    cells = [meshed(spec)[1].cells for spec in (rough, usual)]
    assert cells[1] / cells[0] == pytest.approx(2.25, rel=0.1)


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
    with pytest.raises(SceneError, match="none"):
        coarse([RHOMBUS], rung="none")


def test_a_mesh_that_gmsh_cannot_make_is_a_mesh_error_with_its_log(tmp_path: Path) -> None:
    crossed = ((0.02, 0.0), (-0.02, 0.02), (0.02, 0.02), (-0.02, 0.0))
    spec = replace(coarse([RHOMBUS], rung="standard"), bodies=(crossed,))
    with pytest.raises(MeshError) as failed:
        build_mesh(spec, tmp_path, timeout=4.0)
    assert failed.value.log == tmp_path / "log.gmsh"
    assert not (tmp_path / "mesh.msh").exists()
