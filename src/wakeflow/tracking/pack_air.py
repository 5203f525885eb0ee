"""From a field to the plain arrays of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError, known
from ..field import FlowField, Swing
from ..laws.forces import forces as all_forces
from ..laws.forces.record import Needs
from ..laws.turbulence import lifetime
from .bodies import Body
from .frame import swing_of
from .kernel.layout import PackedAir
from .pack_walls import rows_of_ints

__all__ = ["pack_air"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
NODES = 128  # of which splines are made at a time: they fit into a core's cache
LONGEST_LIFE = 1e6  # s, of an eddy where next to nothing is dissipated


def pack_air(field: FlowField | None, bodies: Sequence[Body], reach: float, forces: Sequence[str]) -> PackedAir:
    """The field's arrays; boundary edges with both ends within ``reach`` (m) of a body's outline count as covered by
    it.
    """
    if field is None:
        empty = np.zeros((0, 3), dtype=np.int64)
        nothing = (np.zeros(0), np.zeros(1), rows_of_ints([], 4), np.zeros(3), np.zeros(4))
        return PackedAir(np.zeros((0, 8)), empty, empty, np.zeros((0, 0, 4)), *nothing)
    first = field.points[field.triangles[:, 0]]
    geometry = np.concatenate([first, field.gradients.reshape(-1, 6)], axis=1)
    swing = swing_of(field)
    flat = swing is None and field.coefficients is None
    values, smooth = (_values(field, forces), np.zeros(3)) if flat else _smooth(field, forces, swing)
    neighbours = field.neighbours.copy()
    covered = _covered(field, neighbours, bodies, reach)
    times = np.zeros(1) if field.times is None or smooth[1] != 0.0 else field.times
    return PackedAir(
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


def _needed(need: Needs, forces: Sequence[str]) -> bool:
    """Whether one of the forces needs a field with pressure or turbulence."""
    return any(all_forces[name].needs == need for name in forces)


def _width(forces: Sequence[str]) -> int:
    """How many quantities of the air are needed: velocity, pressure gradient, deviation and lifetime of the eddies."""
    return 6 if _needed("turbulence", forces) else (4 if _needed("pressure", forces) else 2)


def _eddies(field: FlowField) -> tuple[Array, Array]:
    """Deviation m/s and lifetime s of the eddies (.., N)."""
    k = np.maximum(known(field.k), 0.0)
    return np.sqrt(2.0 / 3.0 * k), np.minimum(lifetime(k, np.maximum(known(field.dissipation), 0.0)), LONGEST_LIFE)


def _values(field: FlowField, forces: Sequence[str]) -> Array:
    """Nodal values (T, N, 2 to 6) of a steady field or of snapshots."""
    lead = field.velocity.shape[:-1]
    values = np.zeros((*lead, _width(forces)))
    values[..., :2] = field.velocity
    if _needed("pressure", forces):
        values[..., 2:4] = field.pressure_gradient
    if _needed("turbulence", forces):
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
    knots, count = len(field.times), len(field.points)
    around = np.arange(-1, knots + 2) % knots
    shares = field.coefficients[around]
    values = np.zeros((count, len(around), _width(forces)))
    vectors = [field.velocity, *([field.pressure_gradient] if _needed("pressure", forces) else [])]
    eddies: tuple[Array, ...] = ()
    if _needed("turbulence", forces):
        eddies = _eddies(replace(field, pressure=None, given_gradient=None).snapshots())
    for low in range(0, count, NODES):
        part = slice(low, low + NODES)
        for place, parts in enumerate(vectors):
            assert parts is not None
            drawn = (shares @ parts[:, part].reshape(len(parts), -1)).reshape(len(around), -1, 2)
            values[part, :, 2 * place : 2 * place + 2] = np.swapaxes(drawn, 0, 1)
        for place, scalar in enumerate(eddies, 4):
            values[part, :, place] = scalar[around, part].T
    return values, np.array([field.times[0], knots / known(field.period), knots])


def _covered(field: FlowField, neighbours: Index, bodies: Sequence[Body], reach: float) -> Index:
    """Covered boundary edges (C, 4) in order along the boundary; marks them in ``neighbours``."""
    triangle, edge = np.nonzero(neighbours < 0)
    start = field.triangles[triangle, (edge + 1) % 3]
    end = field.triangles[triangle, (edge + 2) % 3]
    nodes, place = np.unique(np.concatenate([start, end]), return_inverse=True)
    near = np.zeros((len(bodies) + 1, len(nodes)), dtype=bool)
    for number, body in enumerate(bodies):
        near[number] = _distance(body, field.points[nodes]) <= reach
    both = (near[:, place[: len(start)]] & near[:, place[len(start) :]]).any(axis=0)
    triangle, edge, start, end = triangle[both], edge[both], start[both], end[both]
    place = np.arange(len(start))
    neighbours[triangle, edge] = -2 - place
    from_node = dict(zip(start.tolist(), place.tolist(), strict=True))
    to_node = dict(zip(end.tolist(), place.tolist(), strict=True))
    before = [to_node.get(node, -1) for node in start.tolist()]
    after = [from_node.get(node, -1) for node in end.tolist()]
    return rows_of_ints(list(zip(triangle.tolist(), edge.tolist(), before, after, strict=True)), 4)


def _distance(body: Body, points: Array) -> Array:
    """Distance (n,) of points from a body's outline at rest."""
    start = body.outline[:-1] if body.open else body.outline
    end = body.outline[1:] if body.open else np.roll(body.outline, -1, axis=0)
    least = np.full(len(points), np.inf)
    for a, b in zip(start, end, strict=True):
        along = b - a
        w = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(points - a - w[:, None] * along, axis=1))
    return least
