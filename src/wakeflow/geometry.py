"""Closed polygons: what the mesh, the injection and the tracker all need to know of a body's outline.

An outline is a (k, 2) array of corners (m), counter-clockwise; edge i runs from corner i to corner i + 1 and has the
solid on its left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["area", "contains", "edges", "is_simple", "is_symmetric", "normals", "segments_cross"]

Array = NDArray[np.float64]


def edges(outline: Array) -> tuple[Array, Array]:
    """Start and end of every edge, two (k, 2) arrays."""
    return outline, np.roll(outline, -1, axis=0)


def area(outline: Array) -> float:
    """Enclosed area (m2), positive for a counter-clockwise outline (shoelace formula)."""
    (x0, y0), (x1, y1) = (points.T for points in edges(outline))
    return 0.5 * float(np.sum(x0 * y1 - x1 * y0))


def normals(outline: Array) -> Array:
    """Outward unit normal of every edge, (k, 2)."""
    start, end = edges(outline)
    along = end - start
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return outward / np.linalg.norm(outward, axis=1, keepdims=True)


def is_simple(outline: Array) -> bool:
    """Whether no two edges that are not neighbours touch."""
    start, end = edges(outline)
    count = len(outline)
    for i in range(count):
        for j in range(i + 2, count):
            if (j + 1) % count != i and segments_cross(start[i], end[i], start[j], end[j]):
                return False
    return True


def segments_cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Whether the segments ab and cd meet; touching counts."""

    def side(p: Array, q: Array, r: Array) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) <= 0 and side(c, d, a) * side(c, d, b) <= 0


def contains(outline: Array, points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 2) lie inside the outline (even-odd rule; points on it may fall on either side)."""
    x, y = np.asarray(points, dtype=float).T
    inside = np.zeros(x.shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(*edges(outline), strict=True):
        spans = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def is_symmetric(outline: Array, axis: float = 0.0, tolerance: float = 1e-9) -> bool:
    """Whether the outline is its own mirror image about x = axis (tolerance in its own widths)."""
    mirrored = outline * (-1.0, 1.0) + (2 * axis, 0.0)
    distance = np.linalg.norm(mirrored[:, None] - outline[None], axis=2).min(axis=1)
    return bool(distance.max() <= tolerance * np.ptp(outline[:, 0]))
