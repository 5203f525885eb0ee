"""What to mesh, and the mesh files made of it by Gmsh in a process of its own, read back."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.errors import MeshError
from ...core.geometry import WallEdge, wall_edge
from ...core.number import Count, Known
from ...core.process import call_in_child
from ...core.record import Null, column, save

# -- What to mesh ------------------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
Outline = tuple[tuple[float, float], ...]
Direction = Literal["down", "up"]
Strategy = Literal["quads", "triangles"]


@dataclass(frozen=True)
class SideInlet:
    """An opening in a side wall of the channel, from y = ``start`` to ``end`` (m): the patch ``inlet_NAME``."""

    name: str
    side: Literal["left", "right"]
    start: float
    end: float

    @property
    def patch(self) -> str:
        """Name of its patch."""
        return f"inlet_{self.name}"


@dataclass(frozen=True)
class MeshSpec:
    """What to mesh: bodies in a vertical channel centred on x = 0, y up, all lengths in metres.

    ``bodies`` are (k, 2) outlines, counter-clockwise, in the air or with one edge on a side wall; ``names`` name their
    patches (``body_NAME``). ``half`` meshes x >= 0 only. Cell edges, for the narrowest body and in proportion for wider
    ones: ``h_body`` along the outlines, ``h_corner`` at their sharp corners, ``h_wake`` downstream over
    ``wake_length``; for all: ``h_wall`` on no-slip side walls, ``h_far`` at most from y = ``fine``[0] to ``fine``[1]
    (m), ``h_end`` at most beyond; between them the edge grows by ``growth`` metres a metre. On an edge between two
    sharp corners it is no longer than ``of_edge`` times that edge, at a gap between bodies or to a side wall ``of_gap``
    times the gap.
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
    h_wall: float = float("inf")
    of_edge: float = 1 / 6
    of_gap: float = 1 / 8
    inlets: tuple[SideInlet, ...] = ()
    strategy: Strategy = "quads"
    h_end: float = 0.0  # no more than h_far: the same everywhere
    fine: tuple[float, float] = (-float("inf"), float("inf"))

    @property
    def h_most(self) -> float:
        """The longest cell edge anywhere (m)."""
        return max(self.h_far, self.h_end)

    @property
    def projected_width(self) -> float:
        """Width of the first body across the air (m): the length in Reynolds, Strouhal and drag coefficient."""
        return self.widths[0]

    @property
    def widths(self) -> tuple[float, ...]:
        """Width of every body across the air (m)."""
        return tuple(float(np.ptp(np.array(body)[:, 0])) for body in self.bodies)

    def standing(self, index: int) -> WallEdge | None:
        """The edge with which a body stands on a side wall; None of one in the air."""
        return wall_edge(np.array(self.bodies[index]), self.width / 2)

    @property
    def thickness(self) -> float:
        """Depth of the single layer of cells (m); nothing depends on it."""
        return 0.2 * self.projected_width

    @property
    def meshed_inlets(self) -> tuple[SideInlet, ...]:
        """The openings that the mesh has: in a half domain those on the right."""
        return tuple(inlet for inlet in self.inlets if not self.half or inlet.side == "right")

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of all boundary patches."""
        sides = ("axis", "right") if self.half else ("left", "right")
        openings = (inlet.patch for inlet in self.meshed_inlets)
        return ("inlet", "outlet", *sides, *openings, *(f"body_{name}" for name in self.names), "front", "back")

    def scaled(self, factor: float) -> MeshSpec:
        """This spec with the cell edge multiplied by ``factor`` everywhere, growth included (for grid studies)."""
        names = ("h_body", "h_corner", "h_wake", "h_far", "h_end", "h_wall", "growth", "of_edge", "of_gap")
        longer: dict[str, Any] = {name: getattr(self, name) * factor for name in names}
        return replace(self, **longer)


# -- From a mesh spec to mesh files, through Gmsh in a process of its own ----------------------------------------------
# -- A mesh file read back ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class MeshReport:
    """Counts and quality of the mesh; of a given case only its cells."""

    cells: int = column("1", "cells")
    points: Count = column("1", "points", default=0)
    quads: int | None = column("1", "quadrangles", default=None)
    triangles: int | None = column("1", "triangles", default=None)
    min_angle: Known = column("deg", "smallest angle of a cell", default=math.nan)
    max_angle: Known = column("deg", "largest angle of a cell", default=math.nan)
    max_aspect: Known = column("1", "largest ratio of edges of a cell", default=math.nan)
    smallest_edge: Known = column("m", "smallest edge of a cell", default=math.nan)
    boundary: Annotated[dict[str, int], Null({})] = column("1", "edges of each patch", default=dict)

    def __bool__(self) -> bool:
        """Whether there is a mesh."""
        return self.cells > 0


NO_MESH = MeshReport(0)


def read_mesh(path: Path) -> tuple[Array, dict[str, NDArray[np.intp]], dict[str, int]]:
    """The 2D mesh in a one-layer ``.msh``: points (n, 2) m, cells {"triangle": (m, 3), "quad": (m, 4)}, edges per
    patch.
    """
    import meshio

    mesh = meshio.read(path, file_format="gmsh")  # left to guess, it prints an empty line to standard output
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
    return np.where(double_area(points[cells])[:, None] < 0, cells[:, ::-1], cells)


def double_area(corners: Array) -> Array:
    """Twice the signed area (m,) of polygons (m, k, 2), positive where they run counter-clockwise."""
    return np.asarray(of_sides(corners).sum(axis=1))


def of_sides(corners: Array) -> Array:
    """Twice the area (m, k) of the triangle from the origin to each side of polygons (m, k, 2)."""
    x, y = corners[..., 0], corners[..., 1]
    return np.asarray(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y)


def turn(into: Array, out: Array) -> Array:
    """Angle (...,) rad from vectors ``into`` (..., 2) to vectors ``out``; positive counter-clockwise."""
    cross = into[..., 0] * out[..., 1] - into[..., 1] * out[..., 0]
    return np.asarray(np.arctan2(cross, (into * out).sum(axis=-1)))


def angles(corners: Array) -> Array:
    """Angle (m, k) rad at each corner of counter-clockwise polygons (m, k, 2); below 0 where it turns back."""
    return turn(np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners)


def report_on(points: Array, cells: dict[str, NDArray[np.intp]], boundary: dict[str, int]) -> MeshReport:
    """Counts and quality of a mesh as :func:`read_mesh` gives it."""
    lowest, highest, aspect, shortest = 180.0, 0.0, 1.0, math.inf
    for block in cells.values():
        corner = points[block]
        angle, length = np.degrees(angles(corner)), np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
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


def write_vtu(points: Array, cells: dict[str, NDArray[np.intp]], path: Path) -> None:
    """Write the 2D mesh for ParaView."""
    import meshio

    flat = np.column_stack([points, np.zeros(len(points))])
    partial = path.with_name("partial.vtu")
    meshio.vtu.write(str(partial), meshio.Mesh(flat, list(cells.items())))
    partial.replace(path)


# -- From a mesh spec to mesh files, through Gmsh in a process of its own ----------------------------------------------
MIN_ANGLE = 12.0  # degrees: a smaller one in a 2D cell is refused. Chosen


def build_mesh(spec: MeshSpec, folder: Path, *, timeout: float = 300.0) -> MeshReport:
    """Write ``mesh.msh`` (one layer, MSH 2.2), ``mesh.vtu`` (2D) and ``mesh.json`` (the report) into ``folder``.

    Raises MeshError when Gmsh fails, does not end within ``timeout`` (s), or a 2D cell has an angle below 12 degrees.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.gmsh"
    partial = folder / "partial.msh"
    argument = {"spec": asdict(spec), "path": str(partial)}
    call_in_child(
        "wakeflow.air.mesh.gmsh_child:mesh_in_this_process", argument, log=log, timeout=timeout, error=MeshError
    )
    points, cells, boundary = read_mesh(partial)
    report = report_on(points, cells, boundary)
    missing = sorted(set(spec.patches) - {"front", "back"} - set(boundary))
    if missing:
        raise MeshError(f"the mesh has no edges on: {', '.join(missing)}; log: {log}", log=log)
    if report.min_angle < MIN_ANGLE:
        raise MeshError(
            f"the mesh has a cell with an angle of {report.min_angle:.1f} degrees (at least {MIN_ANGLE:g} needed): "
            f"check the outlines for near-coincident corners; log: {log}",
            log=log,
        )
    write_vtu(points, cells, folder / "mesh.vtu")
    save(folder / "mesh.json", report)
    partial.replace(folder / "mesh.msh")
    return report
