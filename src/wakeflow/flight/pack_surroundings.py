"""Pack field, bodies and lines into the plain arrays of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from threading import Lock
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..air.field import AT_REST, FlowField, MeshOscillation
from ..core.arrays import numbers
from ..core.errors import SceneError
from ..core.geometry import distance_to_edges
from ..laws.forces import forces as all_forces
from ..laws.restitution import Restitution, restitution_table
from ..laws.turbulence import damping, lifetime, shortest_life
from .bodies import Body
from .kernel import layout as at
from .kernel.layout import PackedAir, Walls
from .pack import VACUUM, mesh_motion_of, relative

# -- From bodies and lines to the plain arrays of the kernel -----------------------------------------------------------
Array = NDArray[np.float64]
Index = NDArray[np.int64]
INWARDS = -1e-12  # sine of the angle by which an outline turns at a corner: below it inwards, to round-off
FEW = 8  # edges of an outline that are looked at one by one
BOXED = 1e-9  # of a part's coordinates: its box is larger by that, so that round-off keeps nothing out of it


def pack_walls(
    bodies: Sequence[Body], lines: tuple[Array, Index], swing: MeshOscillation = AT_REST, restitution: Any = None
) -> Walls:
    """Edges, convex corners and motions of all bodies, one after the other; motions as seen from a mesh that swings;
    the granules' ``restitution`` where it is a law.
    """
    tables = _Tables([], [], [], [], [], [], [])
    for number, body in enumerate(bodies):
        _add(tables, number, body, swing)
    width = max((len(row) for row in tables.bodies), default=at.SAMPLES)
    rows = [row + [0.0] * (width - len(row)) for row in tables.bodies]
    frame = [0.0] * 4 + ([0.0 - swing.x, 0.0 - swing.y, swing.omega, swing.phase] if swing != AT_REST else [0.0] * 4)
    return Walls(
        rows_of_floats(tables.edges, 7), rows_of_ints(tables.edge_links, 3),
        rows_of_floats(tables.vertices, 2), rows_of_ints(tables.vertex_links, 3),
        rows_of_floats(rows, width), rows_of_ints(tables.members, 4), rows_of_floats(tables.parts, 9), *lines,
        rows_of_floats([frame + [0.0] * (at.SAMPLES - len(frame))], at.SAMPLES),
        restitution_table(restitution) if isinstance(restitution, Restitution) else np.zeros((0, 6)),
    )  # fmt: skip


class _Tables(NamedTuple):
    """Rows of the tables of ``Walls`` that grow with every body."""

    edges: list[Any]
    edge_links: list[list[int]]
    vertices: list[Any]
    vertex_links: list[list[int]]
    bodies: list[list[float]]
    members: list[list[int]]
    parts: list[list[float]]


def _add(tables: _Tables, number: int, body: Body, swing: MeshOscillation) -> None:
    """Add the rows of one body."""
    outline = _straightened(body)
    start, end = (outline[:-1], outline[1:]) if body.open else (outline, np.roll(outline, -1, axis=0))
    along = end - start
    size = np.hypot(along[:, 0], along[:, 1])
    direction = along / size[:, None]
    first_part, first_vertex = len(tables.parts), len(tables.vertices)
    at_start, at_end = _add_corners(tables, number, outline, body.open, direction)
    before = np.append(first_vertex + np.cumsum(at_start >= 0) - (at_start >= 0), len(tables.vertices))
    _add_parts(tables, start, end, before, len(tables.edges), 0, len(start))
    low, high = outline.min(axis=0), outline.max(axis=0)
    tables.parts[first_part][:4] = [*low, *high]
    for i in range(len(start)):
        tables.edges.append([*start[i], *end[i], direction[i, 1], -direction[i, 0], size[i]])
        tables.edge_links.append([number, at_start[i], at_end[i]])
    coefficients = [-1.0 if value is None else value for value in (body.restitution, body.friction)]
    count, period, *samples = _samples(body)
    about = [*_rocking(body), float(body.capture)]
    tables.bodies.append([*low, *high, *relative(body, swing), *coefficients, count, period, *about, *samples])
    tables.members.append([first_part, len(tables.parts), not body.open, body.line])


def _straightened(body: Body) -> Array:
    """The outline (k, 2) without the points at which it goes straight on: the face goes on there, and what slides on it
    would be thrown off by a corner.
    """
    onward = np.roll(body.outline, -1, axis=0) - body.outline
    back = np.roll(onward, 1, axis=0)
    turn = back[:, 0] * onward[:, 1] - back[:, 1] * onward[:, 0]
    ahead = np.sum(back * onward, axis=1)
    keep = (abs(turn) > -INWARDS * np.hypot(*back.T) * np.hypot(*onward.T)) | (ahead < 0.0)
    if body.open:
        keep[[0, -1]] = True
    return body.outline[keep] if body.open or keep.sum() > 2 else body.outline  # a needle is left as it is


def _add_parts(tables: _Tables, start: Array, end: Array, vertex: Index, first: int, low: int, high: int) -> None:
    """Add the part of an outline that is its edges ``low`` to ``high``, and its halves; from all edges, of which the
    ``first`` has that number, and the number of the ``vertex`` that is the next at the start of each.
    """
    ends = np.concatenate([start[low:high], end[low:high]])
    grown = BOXED * np.abs(ends).max()
    box = [*(ends.min(axis=0) - grown), *(ends.max(axis=0) + grown)]
    row = [*box, first + low, first + high, vertex[low], vertex[high], 0.0]
    tables.parts.append(row)
    if high - low > FEW:
        middle = (low + high) // 2
        _add_parts(tables, start, end, vertex, first, low, middle)
        _add_parts(tables, start, end, vertex, first, middle, high)
    row[at.BEYOND] = len(tables.parts)


def _add_corners(tables: _Tables, number: int, outline: Array, is_open: bool, direction: Array) -> tuple[Index, Index]:
    """Add the convex corners and free ends of a body, whose edges come next, from their directions (m, 2); which one
    is at the start and at the end (m,) of each edge, -1: none.
    """
    count, first_edge = len(direction), len(tables.edges)
    at_start, at_end = np.full(count, -1), np.full(count, -1)
    for i in range(len(outline)):
        before, after = (i - 1, i) if is_open else ((i - 1) % count, i)
        before, after = (before if before >= 0 else -1), (after if after < count else -1)
        if before >= 0 and after >= 0:
            (ax, ay), (bx, by) = direction[before], direction[after]
            if ax * by - ay * bx < INWARDS:  # a corner that turns inwards is never touched
                continue
        place = len(tables.vertices)
        tables.vertices.append(outline[i])
        links = [before + first_edge if before >= 0 else -1, after + first_edge if after >= 0 else -1]
        tables.vertex_links.append([number, *links])
        if before >= 0:
            at_end[before] = place
        if after >= 0:
            at_start[after] = place
    return at_start, at_end


def _rocking(body: Body) -> list[float]:
    """The largest angle and the pivot (x, y) of a body that rocks; zeros of others."""
    motion = body.motion
    if motion is None or not motion.moves or motion.pivot is None:
        return [0.0] * 3
    return [float(np.asarray(motion.amplitude)), *motion.pivot]


def _samples(body: Body) -> list[float]:
    """Number of a body's samples, their period, and of each time, displacement, velocity, acceleration, its slope."""
    record = None if body.motion is None or not body.motion.moves else body.motion.record
    if record is None:
        return [0.0, 0.0]
    slope = np.append(np.diff(record.acceleration) / np.diff(record.time), 0.0)
    parts = np.stack([record.displacement, record.velocity, record.acceleration, slope], axis=1) / record.reach
    table = np.concatenate([record.time[:, None], parts], axis=1)
    return [float(len(table)), record.period, *table.ravel().tolist()]


def rows_of_floats(rows: Sequence[object], width: int) -> Array:
    """Rows of ``width`` numbers as a contiguous array, also where there are none."""
    return np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(len(rows), width))


def rows_of_ints(rows: Sequence[object], width: int) -> Index:
    """Rows of ``width`` whole numbers as a contiguous array, also where there are none."""
    return np.ascontiguousarray(np.array(rows, dtype=np.int64).reshape(len(rows), width))


def pack_lines(lines: Sequence[object]) -> tuple[Array, Index]:
    """Segments (K, 4) of polylines and the polyline each belongs to."""
    segments, owner = [], []
    for number, line in enumerate(lines):
        points = numbers(f"line {number}", line, "m")  # type: ignore[arg-type]
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.all(np.isfinite(points)):
            raise SceneError(f"line {number}: shape {points.shape}, expected at least two finite points (k, 2)")
        for a, b in pairwise(points):
            if np.array_equal(a, b):
                raise SceneError(f"line {number}: two points that follow each other are equal")
            segments.append([*a, *b])
            owner.append(number)
    return rows_of_floats(segments, 4), np.array(owner, dtype=np.int64)


# -- From a field to the plain arrays of the kernel --------------------------------------------------------------------
PRODUCTS = 2**18  # in a product of matrices: of more than some 2^19 BLAS starts threads, which wait for each other
TURNED = 0, 2  # of the values: those of the other sign in a mirror
ROUND = 1e-9  # of the mesh's extent: so near to its box an edge is on it
# Chosen by experiment, see docs/model.md: a tenth of them, which an interval of noise lasts, keeps tracers well mixed
STEEP, REACH = 2.0, 1.0
LOT = 16  # times that are read at once
LEAST = 1e-30  # 1/s, m/s and s: in place of zero, where nothing is steep or nothing moves


@dataclass
class _Kept:
    """What was made of one field, by what it depends on; one thread at a time makes it."""

    lock: Lock = field(default_factory=Lock)
    air: dict[tuple[object, ...], PackedAir] = field(default_factory=dict)
    values: dict[_Needs, tuple[Array, Array, Array]] = field(default_factory=dict)


_KEPT: WeakKeyDictionary[FlowField, _Kept] = WeakKeyDictionary()
_KEEPING = Lock()


def pack_air(field: FlowField, bodies: Sequence[Body], reach: float, forces: Sequence[str]) -> PackedAir:
    """The field's arrays; boundary edges with both ends within ``reach`` (m) of a body's outline count as covered by
    it. They are kept as long as the field is: making them takes as long as a few hundred flights.
    """
    if field is VACUUM:
        empty = np.zeros((0, 3), dtype=np.int64)
        nothing = (np.zeros(0), np.zeros(1), rows_of_ints([], 4), np.zeros(3), empty[:, 0], np.zeros(5), np.zeros(4))
        return PackedAir(np.zeros((0, 8)), empty, empty, np.zeros((0, 0, 4)), *nothing, np.zeros(0))
    key = (*_needs(forces), reach, *(part.tobytes() for body in bodies for part in body.edges))
    kept = _kept(field)
    with kept.lock:
        if key not in kept.air:
            kept.air[key] = _packed(field, kept, bodies, reach, forces)
        return kept.air[key]


def _kept(field: FlowField) -> _Kept:
    with _KEEPING:
        return _KEPT.setdefault(field, _Kept())


def _packed(field: FlowField, kept: _Kept, bodies: Sequence[Body], reach: float, forces: Sequence[str]) -> PackedAir:
    first = field.points[field.triangles[:, 0]]
    geometry = np.concatenate([first, field.gradients.reshape(-1, 6)], axis=1)
    needs = _needs(forces)
    if needs not in kept.values:
        kept.values[needs] = _interpolant(field, needs)
    values, smooth, even = kept.values[needs]
    neighbours = field.neighbours.copy()
    covered = _covered(field, neighbours, bodies, reach)
    times = field.times if field.in_time and smooth[1] == 0.0 else np.zeros(1)
    return PackedAir(
        np.ascontiguousarray(geometry),
        np.array(field.triangles),
        neighbours,
        values,
        np.array(times, dtype=np.float64),
        np.array([field.period]),
        covered,
        smooth,
        *_places(field, neighbours),
        np.array(mesh_motion_of(field), dtype=np.float64),
        even,
    )


def _places(field: FlowField, neighbours: Index) -> tuple[Index, Array]:
    """The grid of ``PackedAir``, and where it lies. There is none where an edge that no body covers lies elsewhere than
    around all of the mesh: a granule that leaves by it has left, though triangles lie beyond.
    """
    triangle, edge = np.nonzero(neighbours == -1)
    start, end = (field.points[field.triangles[triangle, (edge + step) % 3]] for step in (1, 2))
    low, high = field.box
    slack = ROUND * (high - low)
    around = [np.abs(np.maximum(start, end) - low) <= slack, np.abs(np.minimum(start, end) - high) <= slack]
    if not np.any(around, axis=(0, 2)).all():
        return np.zeros(0, dtype=np.int64), np.zeros(5)
    nearest, corner, pitch, side = field.nearest_by_cell
    return nearest, np.array([*corner, *(1.0 / pitch), side])


class _Needs(NamedTuple):
    """Which fields the forces need beside the air's velocity."""

    pressure: bool
    turbulence: bool

    @property
    def width(self) -> int:
        """How many quantities: velocity, pressure gradient, deviation and lifetime of the eddies."""
        return 6 if self.turbulence else (4 if self.pressure else 2)


def _needs(forces: Sequence[str]) -> _Needs:
    """What a field must have for the ``forces``."""
    return _Needs(*(any(all_forces[name].needs == need for name in forces) for need in _Needs._fields))


def eddy_life(field: FlowField) -> float:
    """Lifetime (s) of the eddies in a turbulent ``field``: the median over the nodes, at the mean of k and of its
    dissipation, or of the first snapshot's.
    """
    lives = lifetime(*(np.maximum(part[0] if field.in_time else part, 0.0) for part in (field.k, field.dissipation)))
    return float(np.median(np.minimum(lives, LONGEST_LIFE)))


def _interpolant(field: FlowField, needs: _Needs) -> tuple[Array, Array, Array]:
    """Values at the nodes, the knots in time, and how even the eddies are; those of a mirror image are the original's
    but for their signs.
    """
    original = None if field.original is None else field.original()
    if original is not None:
        there = _kept(original).values.get(needs) or _interpolant(original, needs)
        values = there[0].copy()
        for turned in TURNED[: values.shape[-1] // 2]:
            np.negative(values[..., turned], out=values[..., turned])
        return values, *there[1:]
    swing = mesh_motion_of(field)
    if swing == AT_REST and not field.has("coefficients"):
        values, smooth = _values(field, needs), np.zeros(3)
    else:
        values, smooth = _smooth(field, needs, swing)
    if not needs.turbulence:
        return values, smooth, np.zeros(0)
    nodes = values if smooth[1] == 0.0 else np.swapaxes(values, 0, 1)
    return values, smooth, evenness(field, nodes[..., at.NODE_RMS], nodes[..., at.NODE_LIFE])


def evenness(field: FlowField, rms: Array, life: Array) -> Array:
    """The time (N,) s for which eddies stay what they are about each node, from their deviation m/s and lifetime s at
    the nodes (T, N).

    In the triangles at it for their lifetime (not for less than a fluctuation as large as the deviation s takes through
    one: the mesh tells nothing finer), or ``STEEP`` / |grad s|, the time in which it meets an s that is e times as
    large, if that is less: FLEXPART's limit of a step (Pisso, I. et al. 2019, Geosci. Model Dev. 12, 4955). And nowhere
    longer than elsewhere and the time to get there along the mesh's edges, ``REACH`` times as fast as s: an interval of
    noise is drawn before anything is known of where it leads. Means over the time.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    corners, count = field.triangles, len(field.points)
    slope, at_corners = np.zeros(len(corners)), np.ascontiguousarray(corners.T)
    along = np.ascontiguousarray(np.moveaxis(field.gradients, 0, 2))
    for low in range(0, len(rms), LOT):  # the times of a node lie side by side
        for deviation in np.ascontiguousarray(rms[low : low + LOT]):
            first, second, third = deviation[at_corners]
            x, y = (along[0, i] * first + along[1, i] * second + along[2, i] * third for i in (0, 1))
            slope += np.sqrt(x**2 + y**2) / len(rms)
    lasting, mean = np.full(count, LONGEST_LIFE), rms.mean(axis=0)
    across = 1.0 / np.linalg.norm(field.gradients, axis=2).max(axis=1)
    lives = np.maximum(life.mean(axis=0)[corners].mean(axis=1), across / np.maximum(mean[corners].max(axis=1), LEAST))
    inside = np.minimum(lives, STEEP / np.maximum(slope, LEAST))
    np.minimum.at(lasting, corners, inside[:, None])
    here, there, away = field.sides
    way = away / np.maximum(REACH * np.maximum(mean[here], mean[there]), LEAST)
    # the shortest way, either way along each side, from a place from which each node is as far as its own time
    rows = np.concatenate([here, there, np.full(count, count)])
    columns, weights = np.concatenate([there, here, np.arange(count)]), np.concatenate([way, way, lasting])
    graph = csr_array((np.maximum(weights, LEAST), (rows, columns)), shape=(count + 1, count + 1))
    return np.ascontiguousarray(dijkstra(graph, indices=count)[:count])


def _values(field: FlowField, needs: _Needs) -> Array:
    """Nodal values (T, N, 2 to 6) of a steady field or of snapshots."""
    lead = field.velocity.shape[:-1]
    values = np.zeros((*lead, needs.width))
    values[..., :2] = field.velocity
    hold_off(field, values[..., :2])
    if needs.pressure:
        values[..., 2:4] = field.pressure_gradient
    if needs.turbulence:
        values[..., 4], values[..., 5] = eddies(field, field.k, field.dissipation)
    return values if field.in_time else values[None]


def _smooth(field: FlowField, needs: _Needs, swing: MeshOscillation) -> tuple[Array, Array]:
    """Spline coefficients by nodes (N, knots + 3, 2 to 6), the last knot's first, and the knots: first, per s, number.

    A steady field on a mesh that swings is one whose knots are all alike. Deviation and lifetime of the eddies, which
    must not become negative, take the values at the knots for coefficients (Schoenberg's variation diminishing splines,
    second-order accurate).
    """
    if not field.in_time:
        same = np.repeat(_values(field, needs), 7, axis=0)
        return np.ascontiguousarray(np.swapaxes(same, 0, 1)), np.array([0.0, 4 * swing.omega / (2 * np.pi), 4.0])
    if not field.has("coefficients"):
        raise SceneError("a field of snapshots on a moving mesh must be compressed first: field.compressed()")
    knots, count = len(field.times), len(field.points)
    around = np.arange(-1, knots + 2) % knots
    shares = field.coefficients[around]
    values, each = np.empty((count, len(around), needs.width)), max(1, PRODUCTS // (2 * shares.size))
    vectors = [field.velocity, *([field.pressure_gradient] if needs.pressure else [])]
    stirred: tuple[Array, ...] = ()
    if needs.turbulence:
        stirred = eddies(field, field.at_knots("k"), field.at_knots("dissipation"))
    for low in range(0, count, each):
        part = slice(low, low + each)
        for place, parts in enumerate(vectors):
            drawn = (shares @ parts[:, part].reshape(len(parts), -1)).reshape(len(around), -1, 2)
            values[part, :, 2 * place : 2 * place + 2] = np.swapaxes(drawn, 0, 1)
        for place, scalar in enumerate(stirred, 4):
            values[part, :, place] = scalar[around, part].T
    hold_off(field, np.swapaxes(values, 0, 1)[..., :2])
    return values, np.array([field.times[0], knots / field.time_axis.period, knots])


def _covered(field: FlowField, neighbours: Index, bodies: Sequence[Body], reach: float) -> Index:
    """Covered boundary edges (C, 4) in order along the boundary; marks them in ``neighbours``."""
    triangle, edge = np.nonzero(neighbours < 0)
    start = field.triangles[triangle, (edge + 1) % 3]
    end = field.triangles[triangle, (edge + 2) % 3]
    nodes, place = np.unique(np.concatenate([start, end]), return_inverse=True)
    near = np.zeros((len(bodies) + 1, len(nodes)), dtype=bool)
    for number, body in enumerate(bodies):
        near[number] = distance_to_edges(field.points[nodes], *body.edges) <= reach
    both = (near[:, place[: len(start)]] & near[:, place[len(start) :]]).any(axis=0)
    triangle, edge, start, end = triangle[both], edge[both], start[both], end[both]
    place = np.arange(len(start))
    neighbours[triangle, edge] = -2 - place
    from_node = dict(zip(start.tolist(), place.tolist(), strict=True))
    to_node = dict(zip(end.tolist(), place.tolist(), strict=True))
    before = [to_node.get(node, -1) for node in start.tolist()]
    after = [from_node.get(node, -1) for node in end.tolist()]
    return rows_of_ints(list(zip(triangle.tolist(), edge.tolist(), before, after, strict=True)), 4)


# -- Air beside no-slip walls, whose layers are thinner than triangles -------------------------------------------------
# Eddies that the wall damps, and a mean velocity that does not blow into it
STILL = 1e-6  # of the fastest air: a boundary that is slower in the mean is at rest; modes are rounded
NEARBY = 8  # edges next to a node that are looked at
LONGEST_LIFE = 1e6  # s, of an eddy where next to nothing is dissipated
LEAST_DEVIATION = 0.1  # of sqrt(2 k / 3), up to y+ 3.5; chosen: granules of tau+ 1 to 10 are laid on walls as measured


def wall_edges(field: FlowField) -> tuple[Index, Index]:
    """Triangles (W,) with an edge on a no-slip wall, and which corner (W,) is opposite: both ends are at rest in the
    mean. Where all air is, walls are where k is 0.
    """
    triangle, corner = np.nonzero(field.neighbours < 0)
    share = field.time_axis.mean_weights() if field.in_time else np.ones(1)
    velocity, k = (part if field.in_time else part[None] for part in (field.velocity, field.k))
    mean = np.tensordot(share, velocity, axes=1)
    still = np.abs(mean).max(axis=1) <= STILL * np.abs(field.velocity).max()
    if still.all():
        still = share @ k <= 0.0 if field.has("k") else np.zeros_like(still)
    on = np.all([still[field.triangles[triangle, (corner + step) % 3]] for step in (1, 2)], axis=0)
    return triangle[on], corner[on]


def eddies(field: FlowField, k: Array, dissipation: Array) -> tuple[Array, Array]:
    """Deviation m/s and lifetime s of the eddies (.., N) from k m2/s2 and its dissipation m2/s3 at the nodes.

    They are alike in all directions, beside a no-slip wall as weak as across it; on it there are none, whatever k says.
    """
    (walls, away), viscosity = _away(field), field.viscosity / field.density
    rms, life = np.empty(k.shape), np.empty(k.shape)
    for row in np.ndindex(*k.shape[:-1]):  # as few numbers at a time as the processor holds near
        energy, lost = np.maximum(k[row], 0.0), np.maximum(dissipation[row], 0.0)
        energy[walls] = 0.0
        deviation, lives = np.sqrt(2.0 / 3.0 * energy), lifetime(energy, lost)
        if len(walls):
            share = damping(lost, away, viscosity)
            lives = np.maximum(lives, (1.0 - share) * shortest_life(lost, viscosity))
            deviation *= np.maximum(share, LEAST_DEVIATION)
        rms[row], life[row] = deviation, np.minimum(lives, LONGEST_LIFE)
    return rms, life


def _away(field: FlowField) -> tuple[Index, Array]:
    """Nodes (W, 2) of the edges on no-slip walls; distance (N,) m of all nodes from the nearest of those near by. Kept
    with the mesh for the next air that has the same walls.
    """
    from scipy.spatial import cKDTree

    triangle, corner = wall_edges(field)
    ends = field.triangles[triangle[:, None], (corner[:, None] + [1, 2]) % 3]
    if not len(ends):
        return ends, np.zeros(0)
    kept, away = field.geometry.get("away", (ends[:0], np.zeros(0)))
    if not np.array_equal(kept, ends):
        start, end = np.swapaxes(field.points[ends], 0, 1)
        near = cKDTree(0.5 * (start + end)).query(field.points, k=range(1, min(NEARBY, len(start)) + 1))[1]
        away = distance_to_edges(field.points, start[near], end[near])
        field.geometry["away"] = ends, away
    return ends, away


def hold_off(field: FlowField, velocity: Array) -> None:
    """Take from ``velocity`` (.., N, 2) m/s what blows into no-slip walls at the nodes next to them, in place.

    In the triangle on a wall all components are linear in the distance; across the wall they fall with its square. Air
    that blows towards it would carry what it carries up to it, at a constant angle.
    """
    triangle, corner = wall_edges(field)
    apex, foot = field.triangles[triangle, corner], field.triangles[triangle, (corner + 1) % 3]
    normal = field.gradients[triangle, corner]
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    order = np.argsort(apex, kind="stable")
    turn = np.arange(len(apex)) - np.searchsorted(apex[order], apex[order])  # a node may be opposite to several edges
    for which in 2 * list(range(turn.max(initial=-1) + 1)):
        row = order[turn == which]
        n, node = normal[row], apex[row]
        into = np.einsum("...nd,nd->...n", velocity[..., node, :] - velocity[..., foot[row], :], n)
        velocity[..., node, :] -= np.minimum(into, 0.0)[..., None] * n
