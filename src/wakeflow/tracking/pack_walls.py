"""From bodies and lines to the plain arrays of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..field import Swing
from ..laws.restitution import Restitution, restitution_table
from .bodies import Body
from .frame import relative
from .kernel import layout as at
from .kernel.layout import Walls

__all__ = ["pack_lines", "pack_walls", "rows_of_floats", "rows_of_ints"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
INWARDS = -1e-12  # sine of the angle by which an outline turns at a corner: below it inwards, to round-off


def pack_walls(
    bodies: Sequence[Body], lines: tuple[Array, Index], swing: Swing | None = None, restitution: Any = None
) -> Walls:
    """Edges, convex corners and motions of all bodies, one after the other; motions as seen from a mesh that swings;
    the granules' ``restitution`` where it is a law.
    """
    tables = _Tables([], [], [], [], [], [])
    for number, body in enumerate(bodies):
        _add(tables, number, body, swing)
    width = max((len(row) for row in tables.bodies), default=at.SAMPLES)
    rows = [row + [0.0] * (width - len(row)) for row in tables.bodies]
    frame = [0.0] * 4 + relative(None, swing)
    return Walls(
        rows_of_floats(tables.edges, 7), rows_of_ints(tables.edge_links, 3),
        rows_of_floats(tables.vertices, 2), rows_of_ints(tables.vertex_links, 3),
        rows_of_floats(rows, width), rows_of_ints(tables.members, 6), *lines,
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


def _add(tables: _Tables, number: int, body: Body, swing: Swing | None) -> None:
    """Add the rows of one body."""
    start = body.outline[:-1] if body.open else body.outline
    end = body.outline[1:] if body.open else np.roll(body.outline, -1, axis=0)
    along = end - start
    size = np.hypot(along[:, 0], along[:, 1])
    direction = along / size[:, None]
    first_edge, first_vertex = len(tables.edges), len(tables.vertices)
    at_start, at_end = _add_corners(tables, number, body, direction)
    for i in range(len(start)):
        tables.edges.append([*start[i], *end[i], direction[i, 1], -direction[i, 0], size[i]])
        tables.edge_links.append([number, at_start[i], at_end[i]])
    low, high = body.outline.min(axis=0), body.outline.max(axis=0)
    own = [-1.0 if value is None else value for value in (body.restitution, body.friction)]
    tables.bodies.append([*low, *high, *relative(body.motion, swing), *own, *_samples(body)])
    tables.members.append(
        [first_edge, len(tables.edges), first_vertex, len(tables.vertices), not body.open, body.capture]
    )


def _add_corners(tables: _Tables, number: int, body: Body, direction: Array) -> tuple[Index, Index]:
    """Add the convex corners and free ends of a body, whose edges come next, from their directions (m, 2); which one
    stands at the start and at the end (m,) of each edge, -1: none.
    """
    count, first_edge = len(direction), len(tables.edges)
    at_start, at_end = np.full(count, -1), np.full(count, -1)
    for i in range(len(body.outline)):
        before, after = (i - 1, i) if body.open else ((i - 1) % count, i)
        before, after = (before if before >= 0 else -1), (after if after < count else -1)
        if before >= 0 and after >= 0:
            (ax, ay), (bx, by) = direction[before], direction[after]
            if ax * by - ay * bx < INWARDS:  # a corner that turns inwards is never touched
                continue
        place = len(tables.vertices)
        tables.vertices.append(body.outline[i])
        links = [before + first_edge if before >= 0 else -1, after + first_edge if after >= 0 else -1]
        tables.vertex_links.append([number, *links])
        if before >= 0:
            at_end[before] = place
        if after >= 0:
            at_start[after] = place
    return at_start, at_end


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
        points = np.asarray(line, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.all(np.isfinite(points)):
            raise SceneError(f"line {number}: shape {points.shape}, expected at least two finite points (k, 2)")
        for a, b in pairwise(points):
            if np.array_equal(a, b):
                raise SceneError(f"line {number}: two points that follow each other are equal")
            segments.append([*a, *b])
            owner.append(number)
    return rows_of_floats(segments, 4), np.array(owner, dtype=np.int64)
