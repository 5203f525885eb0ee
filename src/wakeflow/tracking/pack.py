"""From fields, bodies and granules to the plain arrays of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..field import FlowField, Swing
from ..laws.drag import drag_laws, drag_table, slip_correction
from ..laws.forces import forces as forces_known
from ..laws.restitution import Restitution, restitution_table
from ..laws.rotation import spin_rate
from ..laws.turbulence import brownian_diffusivity, lifetime
from .frame import relative, swing_of
from .granules import Body, Granules
from .kernel import layout as at
from .kernel.layout import Air, Walls

__all__ = [
    "FORCES",
    "check_forces",
    "pack_air",
    "pack_granules",
    "pack_lines",
    "pack_state",
    "pack_tables",
    "pack_walls",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
FORCES = tuple(name for name in forces_known if forces_known[name].computed)
MOST_TABLES = 4096
BY_LAW = -1.0  # in place of a granule's restitution: look it up at the approach speed
LONGEST_LIFE = 1e6  # s, of an eddy where next to nothing is dissipated


def pack_walls(
    bodies: Sequence[Body], lines: tuple[Array, Index], swing: Swing | None = None, restitution: Any = None
) -> Walls:
    """Edges, convex corners and motions of all bodies, one after the other; motions as seen from a mesh that swings;
    the granules' ``restitution`` where it is a law.
    """
    edges: list[Any] = []
    vertices: list[Any] = []
    edge_links: list[list[int]] = []
    vertex_links: list[list[int]] = []
    rows: list[list[float]] = []
    members: list[list[int]] = []
    for number, body in enumerate(bodies):
        start = body.outline[:-1] if body.open else body.outline
        end = body.outline[1:] if body.open else np.roll(body.outline, -1, axis=0)
        along = end - start
        size = np.hypot(along[:, 0], along[:, 1])
        direction = along / size[:, None]
        first_edge, first_vertex = len(edges), len(vertices)
        count = len(start)
        at_start, at_end = np.full(count, -1), np.full(count, -1)
        for i in range(len(body.outline)):
            before, after = (i - 1, i) if body.open else ((i - 1) % count, i)
            before, after = (before if before >= 0 else -1), (after if after < count else -1)
            if before >= 0 and after >= 0:
                (ax, ay), (bx, by) = direction[before], direction[after]
                if ax * by - ay * bx < -1e-12:  # a corner that turns inwards is never touched
                    continue
            place = len(vertices)
            vertices.append(body.outline[i])
            vertex_links.append(
                [number, before + first_edge if before >= 0 else -1, after + first_edge if after >= 0 else -1]
            )
            if before >= 0:
                at_end[before] = place
            if after >= 0:
                at_start[after] = place
        for i in range(count):
            edges.append([*start[i], *end[i], direction[i, 1], -direction[i, 0], size[i]])
            edge_links.append([number, at_start[i], at_end[i]])
        low, high = body.outline.min(axis=0), body.outline.max(axis=0)
        own = [-1.0 if value is None else value for value in (body.restitution, body.friction)]
        rows.append([*low, *high, *relative(body.motion, swing), *own, *_samples(body)])
        members.append([first_edge, len(edges), first_vertex, len(vertices), not body.open, body.capture])
    width = max((len(row) for row in rows), default=at.SAMPLES)
    rows = [row + [0.0] * (width - len(row)) for row in rows]
    frame = [0.0] * 4 + relative(None, swing)
    return Walls(
        _floats(edges, 7), _ints(edge_links, 3), _floats(vertices, 2), _ints(vertex_links, 3), _floats(rows, width),
        _ints(members, 6), *lines, _floats([frame + [0.0] * (at.SAMPLES - len(frame))], at.SAMPLES),
        restitution_table(restitution) if isinstance(restitution, Restitution) else np.zeros((0, 6)),
    )  # fmt: skip


def _samples(body: Body) -> list[float]:
    """Number of a body's samples, their period, and of each time, displacement, velocity, acceleration, its slope."""
    record = None if body.motion is None or not body.motion.moves else body.motion.record
    if record is None:
        return [0.0, 0.0]
    slope = np.append(np.diff(record.acceleration) / np.diff(record.time), 0.0)
    parts = np.stack([record.displacement, record.velocity, record.acceleration, slope], axis=1) / record.reach
    table = np.concatenate([record.time[:, None], parts], axis=1)
    return [float(len(table)), record.period, *table.ravel().tolist()]


def _floats(rows: Sequence[object], width: int) -> Array:
    return np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(len(rows), width))


def _ints(rows: Sequence[object], width: int) -> Index:
    return np.ascontiguousarray(np.array(rows, dtype=np.int64).reshape(len(rows), width))


def pack_lines(lines: Sequence[object]) -> tuple[Array, Index]:
    """Segments (K, 4) of polylines and the polyline each belongs to."""
    segments, owner = [], []
    for number, line in enumerate(lines):
        points = np.asarray(line, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.all(np.isfinite(points)):
            raise SceneError(f"line {number}: shape {points.shape}, expected at least two finite points (k, 2)")
        for a, b in pairwise(points):
            if np.array_equal(a, b):
                raise SceneError(f"line {number}: two points that follow each other are equal")
            segments.append([*a, *b])
            owner.append(number)
    return _floats(segments, 4), np.array(owner, dtype=np.int64)


def check_forces(forces: Sequence[str], field: FlowField | None) -> None:
    """Raise SceneError for a force that is unknown, not computed, or lacks what it needs of the field."""
    for force in forces:
        needs = forces_known[force].needs
        if not forces_known[force].computed:
            raise SceneError(f"force {force!r} is only bounded, not computed (computed: {', '.join(FORCES)})")
        if field is None:
            continue
        if needs == "pressure" and field.pressure_gradient is None:
            raise SceneError(f"forces: {force} needs a field with pressure")
        if needs == "turbulence" and (field.k is None or field.dissipation is None):
            raise SceneError(f"forces: {force} needs a field with k and dissipation; a laminar airflow has none")


def pack_air(field: FlowField | None, bodies: Sequence[Body], reach: float, forces: Sequence[str]) -> Air:
    """The field's arrays; boundary edges with both ends within ``reach`` (m) of a body's outline count as covered by
    it.
    """
    if field is None:
        empty = np.zeros((0, 3), dtype=np.int64)
        nothing = (np.zeros(0), np.zeros(1), _ints([], 4), np.zeros(3), np.zeros(4))
        return Air(np.zeros((0, 8)), empty, empty, np.zeros((0, 0, 4)), *nothing)
    first = field.points[field.triangles[:, 0]]
    geometry = np.concatenate([first, field.gradients.reshape(-1, 6)], axis=1)
    swing = swing_of(field)
    flat = swing is None and field.coefficients is None
    values, smooth = (_values(field, forces), np.zeros(3)) if flat else _smooth(field, forces, swing)
    neighbours = field.neighbours.copy()
    covered = _covered(field, neighbours, bodies, reach)
    times = np.zeros(1) if field.times is None or smooth[1] != 0.0 else field.times
    return Air(
        np.ascontiguousarray(geometry),
        np.array(field.triangles),
        neighbours,
        values,
        np.array(times, dtype=np.float64),
        np.array([field.period or 0.0]),
        covered,
        smooth,
        np.array(swing or (0.0,) * 4, dtype=np.float64),
    )


def _width(forces: Sequence[str]) -> int:
    """How many quantities of the air are needed: velocity, pressure gradient, deviation and lifetime of the eddies."""
    return 6 if "dispersion" in forces else (4 if "pressure-gradient" in forces else 2)


def _eddies(field: FlowField) -> tuple[Array, Array]:
    """Deviation m/s and lifetime s of the eddies (.., N)."""
    assert field.k is not None
    assert field.dissipation is not None
    k = np.maximum(field.k, 0.0)
    return np.sqrt(2.0 / 3.0 * k), np.minimum(lifetime(k, np.maximum(field.dissipation, 0.0)), LONGEST_LIFE)


def _values(field: FlowField, forces: Sequence[str]) -> Array:
    """Nodal values (T, N, 2 to 6) of a steady field or of snapshots."""
    lead = field.velocity.shape[:-1]
    values = np.zeros((*lead, _width(forces)))
    values[..., :2] = field.velocity
    if "pressure-gradient" in forces:
        values[..., 2:4] = field.pressure_gradient
    if "dispersion" in forces:
        values[..., 4], values[..., 5] = _eddies(field)
    return values if field.times is not None else values[None]


def _smooth(field: FlowField, forces: Sequence[str], swing: Swing | None) -> tuple[Array, Array]:
    """Spline coefficients by nodes (N, knots + 3, 2 to 6), the last knot's first, and the knots: first, per s, number.

    A steady field on a mesh that swings is one whose knots are all alike. Deviation and lifetime of the eddies, which
    must not become negative, take the values at the knots for coefficients (Schoenberg's variation diminishing splines,
    second-order accurate).
    """
    if field.times is None:
        assert swing is not None
        same = np.repeat(_values(field, forces), 7, axis=0)
        return np.ascontiguousarray(np.swapaxes(same, 0, 1)), np.array([0.0, 4 * swing.omega / (2 * np.pi), 4.0])
    if field.coefficients is None:
        raise SceneError("a field of snapshots on a moving mesh must be compressed first: field.compressed()")
    assert field.period is not None
    knots, count = len(field.times), len(field.points)
    around = np.arange(-1, knots + 2) % knots
    shares = field.coefficients[around]
    values = np.zeros((count, len(around), _width(forces)))

    def drawn(parts: Array) -> Array:
        flat = shares @ parts.reshape(len(parts), -1)
        return np.swapaxes(flat.reshape(len(around), count, 2), 0, 1)

    values[..., :2] = drawn(field.velocity)
    if "pressure-gradient" in forces:
        assert field.pressure_gradient is not None
        values[..., 2:4] = drawn(field.pressure_gradient)
    if "dispersion" in forces:
        deviation, life = _eddies(replace(field, pressure=None, given_gradient=None).snapshots())
        values[..., 4], values[..., 5] = deviation[around].T, life[around].T
    return values, np.array([field.times[0], knots / field.period, knots])


def _covered(field: FlowField, neighbours: Index, bodies: Sequence[Body], reach: float) -> Index:
    """Covered boundary edges (C, 4) in order along the boundary; marks them in ``neighbours``."""
    triangle, edge = np.nonzero(neighbours < 0)
    start = field.triangles[triangle, (edge + 1) % 3]
    end = field.triangles[triangle, (edge + 2) % 3]
    nodes, place = np.unique(np.concatenate([start, end]), return_inverse=True)
    near = np.zeros((len(bodies) + 1, len(nodes)), dtype=bool)
    for number, body in enumerate(bodies):
        near[number] = distance_to(body, field.points[nodes]) <= reach
    both = (near[:, place[: len(start)]] & near[:, place[len(start) :]]).any(axis=0)
    triangle, edge, start, end = triangle[both], edge[both], start[both], end[both]
    place = np.arange(len(start))
    neighbours[triangle, edge] = -2 - place
    from_node = dict(zip(start.tolist(), place.tolist(), strict=True))
    to_node = dict(zip(end.tolist(), place.tolist(), strict=True))
    before = [to_node.get(node, -1) for node in start.tolist()]
    after = [from_node.get(node, -1) for node in end.tolist()]
    return _ints(list(zip(triangle.tolist(), edge.tolist(), before, after, strict=True)), 4)


def distance_to(body: Body, points: Array) -> Array:
    """Distance (n,) of points from a body's outline at rest."""
    start = body.outline[:-1] if body.open else body.outline
    end = body.outline[1:] if body.open else np.roll(body.outline, -1, axis=0)
    least = np.full(len(points), np.inf)
    for a, b in zip(start, end, strict=True):
        along = b - a
        w = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(points - a - w[:, None] * along, axis=1))
    return least


def pack_granules(grains: Granules, field: FlowField | None, forces: Sequence[str], gravity: Sequence[float]) -> Array:
    """Constants of every granule (n, CONSTANTS), see ``state``."""
    rows = np.zeros((len(grains), at.CONSTANTS))
    g = np.asarray(gravity, dtype=float)
    if g.shape != (2,) or not np.all(np.isfinite(g)):
        raise SceneError(f"gravity = {gravity}, expected two finite numbers in m/s2")
    rows[:, at.RADIUS] = grains.diameter / 2
    rows[:, at.RESTITUTION] = BY_LAW if isinstance(grains.restitution, Restitution) else grains.restitution
    rows[:, at.FRICTION] = grains.friction
    rows[:, at.MOBILITY] = 1.0 / grains.inertia
    pull = np.tile(g if "gravity" in forces else np.zeros(2), (len(grains), 1))
    if field is None:
        rows[:, [at.GX, at.GY]] = pull
        return rows
    ratio = field.density / grains.density
    added = 0.5 * ratio if "added-mass" in forces else np.zeros(len(grains))
    if "buoyancy" in forces:
        pull -= ratio[:, None] * g
    rows[:, [at.GX, at.GY]] = pull / (1.0 + added)[:, None]
    rows[:, at.REYNOLDS2] = (field.density * grains.diameter / field.viscosity) ** 2
    rows[:, at.VORTICITY] = field.density * grains.diameter**2 / field.viscosity
    rows[:, at.INERTIAL] = added / (1.0 + added)
    for force, column, value in (
        ("drag", at.STOKES, grains.drag_scale * 18.0 * field.viscosity / (grains.density * grains.diameter**2)),
        ("pressure-gradient", at.PRESSURE, -1.0 / grains.density),
        ("lift", at.LIFT, ratio),
        ("magnus", at.MAGNUS, 0.75 * ratio),
    ):
        if force in forces:
            rows[:, column] = value / (1.0 + added)
    if "magnus" in forces:
        rows[:, at.SPIN_RATE] = spin_rate(grains.diameter, grains.density, field.viscosity, grains.inertia)
    rows[:, at.EXTRA] = np.any(rows[:, [at.INERTIAL, at.LIFT, at.MAGNUS]] != 0.0, axis=1)
    rows[:, at.DISPERSION] = "dispersion" in forces
    if "brownian" in forces:
        rows[:, at.DIFFUSIVITY] = brownian_diffusivity(
            grains.diameter, field.viscosity, slip_correction=slip_correction(grains.diameter)
        )
    rows[:, at.NOISE] = (rows[:, at.DISPERSION] != 0.0) | (rows[:, at.DIFFUSIVITY] != 0.0)
    return rows


def pack_tables(law: str, sphericity: Array) -> tuple[Array, Index]:
    """Tables of the drag law (k, cells, 4), one for every sphericity that occurs, and which one each granule uses."""
    if not drag_laws[law].uses_sphericity:
        return drag_table(law)[None], np.zeros(len(sphericity), dtype=np.int64)
    values, which = np.unique(sphericity, return_inverse=True)
    if len(values) > MOST_TABLES:
        raise SceneError(f"granule sphericity: {len(values)} different values, allowed {MOST_TABLES}; round them")
    if not len(values):
        values = np.ones(1)
    return np.stack([drag_table(law, float(value)) for value in values]), which.astype(np.int64)


def pack_state(
    grains: Granules, first: int, field: FlowField | None, air: Air, bodies: Sequence[Body], reach: float
) -> tuple[Array, Index]:
    """State arrays at birth of granules numbered from ``first``; one in the room a vibrating body has left begins at
    the boundary edge it is next to.
    """
    floats = np.zeros((len(grains), at.FLOATS))
    floats[:, at.X], floats[:, at.Y] = grains.position.T
    floats[:, at.VX], floats[:, at.VY] = grains.velocity.T
    floats[:, at.SPIN], floats[:, at.T], floats[:, at.BORN] = grains.spin, grains.time, grains.time
    ints = np.zeros((len(grains), at.INTS), dtype=np.int64)
    ints[:, [at.FATE, at.LINE, at.FEATURE, at.GAP, at.TRI]] = -1
    ints[:, at.FATE] = at.FLYING
    ints[:, at.STREAM] = first + np.arange(len(grains))
    if field is not None and len(grains):
        ints[:, at.TRI] = field.locate(grains.position)
        outside = np.flatnonzero(ints[:, at.TRI] < 0)
        if len(outside) and len(air.covered):
            ints[outside, at.GAP] = _nearest_covered(grains.position[outside], field, air, bodies, reach)
    return floats, ints


def _nearest_covered(x: Array, field: FlowField, air: Air, bodies: Sequence[Body], reach: float) -> Index:
    """Covered edge next to each point outside the mesh, -1 where none is as near as its body may have moved."""
    swing = max(
        (
            float(np.hypot(body.motion.amplitude[0], body.motion.amplitude[1]))
            for body in bodies
            if body.motion is not None
        ),
        default=0.0,
    )
    triangle, edge = air.covered[:, 0], air.covered[:, 1]
    a = field.points[field.triangles[triangle, (edge + 1) % 3]]
    along = field.points[field.triangles[triangle, (edge + 2) % 3]] - a
    found = np.full(len(x), -1, dtype=np.int64)
    for low in range(0, len(x), 1024):
        offset = x[low : low + 1024, None] - a
        w = np.clip(np.einsum("nci,ci->nc", offset, along) / np.einsum("ci,ci->c", along, along), 0.0, 1.0)
        distance = np.linalg.norm(offset - w[..., None] * along, axis=2)
        best = distance.argmin(axis=1)
        near = distance[np.arange(len(best)), best] <= swing + reach
        found[low : low + 1024] = np.where(near, best, -1)
    return found
