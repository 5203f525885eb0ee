"""The mesh: a two-dimensional Gmsh mesh of the channel around the bodies, extruded by one layer for OpenFOAM.

Gmsh is one global object that no two threads may touch: :func:`build_mesh` runs it in a process of its own. Everything
else here reads the ``.msh`` file through meshio. The same spec always gives the same mesh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .errors import MeshError, SceneError
from .files import write_json
from .geometry import contains, edges, is_symmetric, segments_cross
from .process import call_in_child

__all__ = ["MeshReport", "MeshSpec", "build_mesh", "plan_mesh", "read_mesh"]

Array = NDArray[np.float64]
Outline = tuple[tuple[float, float], ...]
Direction = Literal["down", "up"]

# Cell edge over projected body width at the body, its corners, in the near wake and far away. "draft" is meant for
# the half domain and a steady solution; "standard" for a time-resolved one, whose time step the smallest cells dictate.
RESOLUTION = {
    "draft": {"body": 1 / 60, "corner": 1 / 160, "wake": 1 / 28, "far": 1 / 6, "growth": 0.12},
    "standard": {"body": 1 / 40, "corner": 1 / 80, "wake": 1 / 26, "far": 1 / 5, "growth": 0.13},
}
UPSTREAM, DOWNSTREAM = 3.0, 8.0  # shortest distance from bodies to inlet and outlet, in projected widths
MIN_ANGLE = 12.0  # degrees: a smaller one in a 2D cell is refused


@dataclass(frozen=True)
class MeshSpec:
    """What to mesh: bodies in a vertical channel centred on x = 0, y up, all lengths in metres.

    ``bodies`` are (k, 2) outlines, counter-clockwise; ``names`` name their patches (``body_NAME``). ``half`` meshes x
    >= 0 only. Cell edges: ``h_body`` along the outlines, ``h_corner`` at their corners, ``h_wake`` downstream of each
    body over ``wake_length``, ``h_far`` at most; between them the edge grows by ``growth`` metres a metre.
    """

    bodies: tuple[Outline, ...]
    names: tuple[str, ...]
    width: float
    top: float
    bottom: float
    walls: Literal["slip", "no-slip"]
    direction: Direction
    half: bool
    h_body: float
    h_corner: float
    h_wake: float
    h_far: float
    growth: float
    wake_length: float
    cells: Literal["quad", "triangle"] = "quad"

    @property
    def projected_width(self) -> float:
        """Width of the first body across the air (m): the length in Reynolds, Strouhal and drag coefficient."""
        x = np.array(self.bodies[0])[:, 0]
        return float(np.ptp(x))

    @property
    def thickness(self) -> float:
        """Depth of the single layer of cells (m); nothing depends on it."""
        return 2 * self.h_far

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of all boundary patches."""
        sides = ("axis", "right") if self.half else ("left", "right")
        return ("inlet", "outlet", *sides, *(f"body_{name}" for name in self.names), "front", "back")

    def scaled(self, factor: float) -> MeshSpec:
        """The same spec with the cell edge multiplied by ``factor`` everywhere, growth included (for grid studies)."""
        names = ("h_body", "h_corner", "h_wake", "h_far", "growth")
        sizes = {name: getattr(self, name) * factor for name in names}
        return replace(self, **sizes)


@dataclass(frozen=True)
class MeshReport:
    """What the mesh is: counts, quality of its 2D cells (angles in degrees), edges on each patch, where it lies."""

    cells: int
    points: int
    quads: int
    triangles: int
    min_angle: float
    max_angle: float
    max_aspect: float
    smallest_edge: float
    boundary: dict[str, int] = field(default_factory=dict)


def plan_mesh(
    bodies: Sequence[Array],
    *,
    width: float,
    top: float,
    bottom: float,
    names: Sequence[str] | None = None,
    walls: Literal["slip", "no-slip"] = "slip",
    direction: Direction = "down",
    rung: str = "draft",
    scale: float = 1.0,
) -> MeshSpec:
    """Choose cell sizes for a rung; ``scale`` multiplies all of them.

    Sizes follow each rung's table from the narrowest body's projected width, and are reduced where an edge of an
    outline or a gap to a wall would get fewer than 6 or 8 cells. A channel that ends too near to the bodies (3 widths
    upstream, 8 downstream) is meshed longer than it is: the inlet's uniform air and the outlet's uniform pressure
    must not touch the wake. The half domain is chosen for a draft when all bodies are symmetric about x = 0.
    Raises SceneError for bodies that touch each other or a wall.
    """
    if rung not in RESOLUTION:
        raise SceneError(f"no mesh is planned for rung {rung!r} (known: {', '.join(RESOLUTION)})")
    outlines = [np.asarray(body, dtype=float) for body in bodies]
    _check_places(outlines, width, top, bottom)
    table = RESOLUTION[rung]
    across = [float(np.ptp(outline[:, 0])) for outline in outlines]
    size, largest = min(across), max(across)
    shortest = min(float(np.linalg.norm(b - a, axis=1).min()) for a, b in map(edges, outlines))
    gap = _narrowest_gap(outlines, width)
    h_body = scale * min(table["body"] * size, shortest / 6, gap / 8)
    low = min(float(o[:, 1].min()) for o in outlines)
    high = max(float(o[:, 1].max()) for o in outlines)
    before, behind = UPSTREAM * largest, DOWNSTREAM * largest
    above, below = (before, behind) if direction == "down" else (behind, before)
    return MeshSpec(
        bodies=tuple(tuple((float(x), float(y)) for x, y in outline) for outline in outlines),
        names=tuple(names) if names is not None else tuple(str(i) for i in range(len(outlines))),
        width=width,
        top=max(top, high + above),
        bottom=min(bottom, low - below),
        walls=walls,
        direction=direction,
        half=rung == "draft" and all(is_symmetric(outline) for outline in outlines),
        h_body=h_body,
        h_corner=min(scale * table["corner"] * size, h_body),
        h_wake=scale * min(table["wake"] * size, gap / 5),
        h_far=scale * min(table["far"] * largest, width / 10, gap / 2),
        growth=scale * table["growth"],
        wake_length=2.5 * largest,
    )


def _check_places(outlines: list[Array], width: float, top: float, bottom: float) -> None:
    for i, outline in enumerate(outlines):
        (left, low), (right, high) = outline.min(axis=0), outline.max(axis=0)
        if left <= -width / 2 or right >= width / 2 or low <= bottom or high >= top:
            raise SceneError(
                f"body {i} spans x {left:g}..{right:g} m, y {low:g}..{high:g} m and must lie inside the channel "
                f"x {-width / 2:g}..{width / 2:g} m, y {bottom:g}..{top:g} m"
            )
        for j, other in enumerate(outlines[:i]):
            if contains(other, outline).any() or contains(outline, other).any() or _distance(outline, other) <= 0:
                raise SceneError(f"bodies {j} and {i} touch each other: move one of them")


def _distance(one: Array, other: Array) -> float:
    """Least distance (m) between two polygons' corners and edges; 0 when edges cross."""
    crossing = any(
        segments_cross(a, b, c, d) for a, b in zip(*edges(one), strict=True) for c, d in zip(*edges(other), strict=True)
    )
    return 0.0 if crossing else min(_corner_to_edges(one, other), _corner_to_edges(other, one))


def _corner_to_edges(corners: Array, outline: Array) -> float:
    start, end = edges(outline)
    along = end - start
    offset = corners[:, None] - start
    share = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return float(np.linalg.norm(offset - share[..., None] * along, axis=2).min())


def _narrowest_gap(outlines: list[Array], width: float) -> float:
    """Least free distance (m) between bodies, or between a body and a channel wall."""
    gaps = [width / 2 - float(np.abs(outline[:, 0]).max()) for outline in outlines]
    gaps += [_distance(a, b) for i, a in enumerate(outlines) for b in outlines[:i]]
    return min(gaps)


def build_mesh(spec: MeshSpec, folder: Path, *, timeout: float = 300.0) -> MeshReport:
    """Write ``mesh.msh`` (one layer, MSH 2.2), ``mesh.vtu`` (2D) and ``mesh.json`` (the report) into ``folder``.

    Raises MeshError when Gmsh fails, does not end within ``timeout`` (s), or a 2D cell has an angle below 12 degrees.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.gmsh"
    partial = folder / "partial.msh"
    argument = {"spec": asdict(spec), "thickness": spec.thickness, "path": str(partial)}
    call_in_child("wakeflow.meshing:_gmsh_in_this_process", argument, log=log, timeout=timeout, error=MeshError)
    points, cells, boundary = read_mesh(partial)
    report = _quality(points, cells, boundary)
    missing = sorted(set(spec.patches) - {"front", "back"} - set(boundary))
    if missing:
        raise MeshError(f"the mesh has no edges on: {', '.join(missing)}; log: {log}", log=log)
    if report.min_angle < MIN_ANGLE:
        raise MeshError(
            f"the mesh has a cell with an angle of {report.min_angle:.1f} degrees (at least {MIN_ANGLE:g} needed): "
            f"check the outlines for near-coincident corners; log: {log}",
            log=log,
        )
    _write_vtu(points, cells, folder / "mesh.vtu")
    write_json(folder / "mesh.json", asdict(report))
    partial.replace(folder / "mesh.msh")
    return report


def read_mesh(path: Path) -> tuple[Array, dict[str, NDArray[np.intp]], dict[str, int]]:
    """The 2D mesh in a one-layer ``.msh``: points (n, 2) m, cells {"triangle": (m, 3), "quad": (m, 4)}, edges per
    patch.
    """
    import contextlib
    import io

    import meshio

    with contextlib.redirect_stdout(io.StringIO()):  # meshio prints an empty line
        mesh = meshio.read(path)
    tags = {int(tag): name for name, (tag, dimension) in mesh.field_data.items() if dimension == 2}
    cells: dict[str, NDArray[np.intp]] = {}
    boundary: dict[str, int] = {}
    for block, physical in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        if block.type not in ("triangle", "quad"):
            continue
        for tag in np.unique(physical):
            name, chosen = tags[int(tag)], block.data[physical == tag].astype(np.intp)
            if name == "back":
                cells[block.type] = np.vstack([cells[block.type], chosen]) if block.type in cells else chosen
            elif name != "front":
                boundary[name] = boundary.get(name, 0) + len(chosen)
    used = np.unique(np.concatenate([block.ravel() for block in cells.values()]))
    renumber = np.full(len(mesh.points), -1, dtype=np.intp)
    renumber[used] = np.arange(len(used))
    points = np.ascontiguousarray(mesh.points[used, :2])
    return points, {kind: _anticlockwise(points, renumber[block]) for kind, block in cells.items()}, boundary


def _anticlockwise(points: Array, cells: NDArray[np.intp]) -> NDArray[np.intp]:
    x, y = points[cells, 0], points[cells, 1]
    area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    return np.where(area[:, None] < 0, cells[:, ::-1], cells)


def _quality(points: Array, cells: dict[str, NDArray[np.intp]], boundary: dict[str, int]) -> MeshReport:
    lowest, highest, aspect, shortest = 180.0, 0.0, 1.0, math.inf
    for block in cells.values():
        corner = points[block]
        out, back = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
        turn = out[..., 0] * back[..., 1] - out[..., 1] * back[..., 0]
        angle = np.degrees(np.arctan2(turn, (out * back).sum(axis=2)))
        length = np.linalg.norm(out, axis=2)
        lowest, highest = min(lowest, float(angle.min())), max(highest, float((angle % 360).max()))
        aspect = max(aspect, float((length.max(axis=1) / length.min(axis=1)).max()))
        shortest = min(shortest, float(length.min()))
    count = {kind: len(block) for kind, block in cells.items()}
    return MeshReport(
        cells=sum(count.values()),
        points=len(points),
        quads=count.get("quad", 0),
        triangles=count.get("triangle", 0),
        min_angle=lowest,
        max_angle=highest,
        max_aspect=aspect,
        smallest_edge=shortest,
        boundary=dict(sorted(boundary.items())),
    )


def _write_vtu(points: Array, cells: dict[str, NDArray[np.intp]], path: Path) -> None:
    import meshio

    flat = np.column_stack([points, np.zeros(len(points))])
    partial = path.with_name("partial.vtu")
    meshio.vtu.write(str(partial), meshio.Mesh(flat, list(cells.items())))
    partial.replace(path)


# ---- below: runs only in the child process -------------------------------------------------------------------------


def _gmsh_in_this_process(argument: dict[str, Any]) -> None:
    """Mesh ``argument['spec']`` into the file ``argument['path']``."""
    import gmsh

    spec = MeshSpec(**argument["spec"])
    gmsh.initialize(argv=["gmsh"], readConfigFiles=False, interruptible=False)
    try:
        for option, value in _options(spec).items():
            gmsh.option.setNumber(option, value)
        _model(gmsh, spec, argument["thickness"])
        gmsh.model.mesh.generate(3)
        gmsh.write(argument["path"])
    except Exception as problem:  # Gmsh raises bare Exception; its own words say what it stumbled over
        raise MeshError(f"Gmsh could not mesh the channel: {problem}") from None
    finally:
        gmsh.finalize()


def _options(spec: MeshSpec) -> dict[str, float]:
    quad = spec.cells == "quad"
    return {
        "General.NumThreads": 1,  # more threads would make the numbering depend on their timing
        "Mesh.MshFileVersion": 2.2,
        "Mesh.Binary": 0,
        "Mesh.Algorithm": 8 if quad else 6,  # frontal-Delaunay, for quads or for triangles
        "Mesh.RecombineAll": int(quad),
        "Mesh.RecombinationAlgorithm": 1,  # blossom
        "Mesh.Smoothing": 10 if quad else 3,
        "Mesh.MeshSizeExtendFromBoundary": 0,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.MeshSizeFromCurvature": 0,
        "Mesh.RandomSeed": 1,
    }


def _model(gmsh: Any, spec: MeshSpec, thickness: float) -> None:
    """The channel as one plane surface, extruded by one layer, with a physical group a patch."""
    geo = gmsh.model.geo
    loops = _loops(spec)
    curves: list[tuple[int, str]] = []
    loop_tags = []
    ends: list[int] = []
    for corners, labels in loops:
        points = [geo.addPoint(x, y, 0.0) for x, y in corners]
        lines = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
        curves += zip(lines, labels, strict=True)
        loop_tags.append(geo.addCurveLoop(lines))
        for i, label in enumerate(labels):
            if label.startswith("body_"):
                ends += [points[i], points[(i + 1) % len(points)]]
    surface = geo.addPlaneSurface(loop_tags)
    made = geo.extrude([(2, surface)], 0, 0, thickness, numElements=[1], recombine=True)
    geo.synchronize()
    groups: dict[str, list[int]] = {"back": [surface], "front": [made[0][1]]}
    for (_, label), (_, side) in zip(curves, made[2:], strict=True):
        groups.setdefault(label, []).append(side)
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.addPhysicalGroup(3, [made[1][1]], name="air")
    _sizes(gmsh, spec, [line for line, label in curves if label.startswith("body_")], sorted(set(ends)))


def _sizes(gmsh: Any, spec: MeshSpec, outlines: list[int], corners: list[int]) -> None:
    """Cell edge = the least over outlines, corners and wakes of (edge there + growth times distance to it)."""
    fields = gmsh.model.mesh.field

    def graded(kind: str, tags: list[int], near: float) -> int:
        distance = fields.add("Distance")
        fields.setNumbers(distance, kind, tags)
        fields.setNumber(distance, "Sampling", 200)
        threshold = fields.add("Threshold")
        numbers = {"InField": distance, "SizeMin": near, "SizeMax": spec.h_far, "DistMin": 0.0}
        numbers["DistMax"] = max((spec.h_far - near) / spec.growth, 1e-9)
        for name, value in numbers.items():
            fields.setNumber(threshold, name, value)
        return int(threshold)

    parts = [graded("CurvesList", outlines, spec.h_body), graded("PointsList", corners, spec.h_corner)]
    for outline in spec.bodies:
        parts += [_wake_box(fields, spec, outline, *zone) for zone in _wake_zones(spec)]
    least = fields.add("Min")
    fields.setNumbers(least, "FieldsList", parts)
    fields.setAsBackgroundMesh(least)


def _wake_zones(spec: MeshSpec) -> list[tuple[float, float, float]]:
    """(length behind the body m, half width over half body width, cell edge m) of the near wake and of the way out."""
    return [
        (spec.wake_length, 1.25, spec.h_wake),
        (3 * spec.wake_length, 1.5, min(2.0 * spec.h_wake, spec.h_far)),
    ]


def _wake_box(fields: Any, spec: MeshSpec, outline: Outline, length: float, wide: float, edge: float) -> int:
    (left, low), (right, high) = np.min(outline, axis=0), np.max(outline, axis=0)
    centre, half = (left + right) / 2, wide * (right - left) / 2
    widest = float(np.mean([y for x, y in outline if max(abs(x - left), 0) < 1e-9 or abs(x - right) < 1e-9]))
    ahead = 1.0 if spec.direction == "up" else -1.0
    ends = sorted((widest, (high if ahead > 0 else low) + ahead * length))
    box = fields.add("Box")
    numbers = {"VIn": edge, "VOut": spec.h_far, "XMin": centre - half, "XMax": centre + half}
    numbers |= {"YMin": ends[0], "YMax": ends[1], "ZMin": -1.0, "ZMax": 1.0}
    numbers["Thickness"] = max((spec.h_far - edge) / spec.growth, 1e-9)
    for name, value in numbers.items():
        fields.setNumber(box, name, float(value))
    return int(box)


def _loops(spec: MeshSpec) -> list[tuple[list[tuple[float, float]], list[str]]]:
    """Closed loops of corners with the patch of the edge that starts at each: the outer loop first, then holes."""
    up = spec.direction == "up"
    floor, ceiling = ("inlet", "outlet") if up else ("outlet", "inlet")
    right = spec.width / 2
    left = 0.0 if spec.half else -right
    corners = [(left, spec.bottom), (right, spec.bottom), (right, spec.top), (left, spec.top)]
    labels = [floor, "right", ceiling, "axis" if spec.half else "left"]
    holes = []
    on_axis = []
    for name, outline in zip(spec.names, spec.bodies, strict=True):
        label = f"body_{name}"
        if not spec.half or min(x for x, _ in outline) > 0:
            holes.append((list(outline), [label] * len(outline)))
        elif max(x for x, _ in outline) > 0:
            on_axis.append((_right_half(outline), label))
    for chain, label in sorted(on_axis, key=lambda item: -item[0][-1][1]):  # down the axis, from the top
        corners += chain[::-1]
        labels += [label] * (len(chain) - 1) + ["axis"]
    return [(corners, labels), *holes]


def _right_half(outline: Outline) -> list[tuple[float, float]]:
    """The part of a counter-clockwise outline at x >= 0, from its lower to its upper end on the axis x = 0."""
    size = max(abs(v) for corner in outline for v in corner)
    points: list[tuple[float, float]] = []
    for (x0, y0), (x1, y1) in zip(outline, outline[1:] + outline[:1], strict=True):
        points.append((0.0 if abs(x0) < 1e-9 * size else x0, y0))
        if min(x0, x1) < -1e-9 * size and max(x0, x1) > 1e-9 * size:
            points.append((0.0, y0 - x0 * (y1 - y0) / (x1 - x0)))
    count = len(points)
    starts = [i for i in range(count) if points[i][0] == 0.0 and points[(i + 1) % count][0] > 0]
    if len(starts) != 1:
        raise MeshError("a body meets the axis more than once: it cannot be meshed as a half domain")
    chain = [points[starts[0]]]
    while len(chain) == 1 or chain[-1][0] > 0:
        chain.append(points[(starts[0] + len(chain)) % count])
    return chain
