"""Plane geometry: closed polygons, a density on square boxes; and bisection.

An outline is a (k, 2) array of corners (m), counter-clockwise; edge i runs from corner i to corner i + 1 and has the
solid on its left.

Both functions halve a bracket a fixed number of times, so that the answer does not depend on a tolerance or on what
else is searched beside it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import SceneError
from .quantities import metres

# -- Plane geometry ----------------------------------------------------------------------------------------------------
# -- Closed polygons ---------------------------------------------------------------------------------------------------
ARC = math.radians(7.5)  # how much one chord of a rounded corner turns at most
Array = NDArray[np.float64]
ON_WALL = 1e-6  # of half the channel's width: how far off a wall a corner still lies on it


class WallEdge(NamedTuple):
    """The edge with which an outline stands on a side wall."""

    side: Literal["left", "right"]
    first: int  # corner at which the edge begins, counter-clockwise
    low: float  # m, y of its lower end
    high: float  # m


def wall_edge(outline: Array, half: float) -> WallEdge | None:
    """The edge with which a counter-clockwise ``outline`` (k, 2) m stands on a wall at x = -``half`` or ``half`` (m);
    None where it is inside of both, or touches a wall by anything but one whole edge.
    """
    x, y = outline.T
    touching = np.abs(np.abs(x) - half) <= ON_WALL * half
    if np.count_nonzero(touching) != 2 or np.any(np.abs(x) > (1.0 + ON_WALL) * half):
        return None
    first, second = np.flatnonzero(touching).tolist()
    if second - first != 1:
        first, second = second, first
    if (second - first) % len(x) != 1 or x[first] * x[second] < 0.0:
        return None
    low, high = sorted((float(y[first]), float(y[second])))
    return WallEdge("left" if x[first] < 0.0 else "right", first, low, high)


def between_walls(outlines: Iterable[Array], width: float) -> float:
    """The narrowest way (m) between ``outlines`` that stand on the left wall of a channel of ``width`` (m) and those on
    the right; infinite where no two do.
    """
    sides: dict[str, list[Array]] = {"left": [], "right": []}
    for outline in outlines:
        edge = wall_edge(outline, width / 2)
        if edge is not None:
            sides[edge.side].append(outline)
    return min((distance_between(item, other) for item, other in product(*sides.values())), default=math.inf)


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
    return np.asarray(outward / np.linalg.norm(outward, axis=1, keepdims=True))


def is_simple(outline: Array) -> bool:
    """Whether no two edges that are not neighbours touch."""
    count = len(outline)
    first, second = np.triu_indices(count, 2)
    apart = (second + 1) % count != first
    start, end = edges(outline)
    first, second = first[apart], second[apart]
    return not segments_cross(start[first], end[first], start[second], end[second]).any()


def segments_cross(a: Array, b: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    """Whether the segments ab and cd meet, points (..., 2) that broadcast; touching counts."""

    def side(p: Array, q: Array, r: Array) -> Array:
        along, off = q - p, r - p
        return np.asarray(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])

    boxes = (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))  # for collinear ones
    return (side(a, b, c) * side(a, b, d) <= 0) & (side(c, d, a) * side(c, d, b) <= 0) & boxes.all(axis=-1)


def runs_into(line: Array, outline: Array) -> bool:
    """Whether a polyline (n, 2) touches or enters an outline (k, 2)."""
    crosses = segments_cross(line[:-1, None], line[1:, None], *edges(outline)).any()
    return bool(crosses or contains(outline, line).any())


def distance_between(outline: Array, other: Array) -> float:
    """Least distance (m) between two outlines; 0 where they cross, touch or one encloses the other."""
    (a, b), (c, d) = edges(outline), edges(other)
    within = contains(outline, other).any() or contains(other, outline).any()
    if within or segments_cross(a[:, None], b[:, None], c, d).any():
        return 0.0
    return float(min(distance_to(outline, other).min(), distance_to(other, outline).min()))


def distance_to(points: Array, outline: Array) -> Array:
    """Distance (n,) m of points (n, 2) from the nearest edge of the outline, inside or out."""
    return distance_to_edges(points, *edges(outline))


def distance_to_edges(points: Array, start: Array, end: Array) -> Array:
    """Distance (n,) m of points (n, 2) from the nearest of the edges between ``start`` and ``end`` (m, 2), or of those
    of its own (n, m, 2).
    """
    along = end - start
    offset = points[:, None] - start
    share = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1))


def along(line: Array, points: Array) -> tuple[Array, Array]:
    """Arc length (n,) along a polyline (k, 2) of its place nearest to each of the points (n, 2), and its distance."""
    start, step = line[:-1], np.diff(line, axis=0)
    size = np.hypot(*step.T)
    part = np.clip(np.einsum("nkc,kc->nk", points[:, None] - start, step) / size**2, 0.0, 1.0)
    gap = np.linalg.norm(points[:, None] - start - part[..., None] * step, axis=2)
    best, each = np.argmin(gap, axis=1), np.arange(len(points))
    before = np.concatenate([[0.0], np.cumsum(size)[:-1]])
    return before[best] + part[each, best] * size[best], gap[each, best]


def rounded(outline: Array, radius: float) -> Array:
    """The outline with every corner, in or out, replaced by an arc of ``radius`` (m) that touches both its edges.

    The arc is a chain of an even number of chords whose middle lies on the bisector of the corner, each turning by at
    most ARC. An arc takes radius x tan(turn / 2) off either edge. Raises SceneError where an edge is too short for both
    of its arcs.
    """
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    length = np.linalg.norm(after, axis=1)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.arctan2(cross, (before * after).sum(axis=1))
    cut = np.abs(np.tan(turn / 2))  # length taken off either edge, in radii
    largest = float((length / np.maximum(cut + np.roll(cut, -1), 1e-12)).min())
    if radius >= largest:
        raise SceneError(f"rounding = {metres(radius)} eats an edge of the outline (allowed: < {metres(largest, 4)})")
    along = after / length[:, None]
    parts = []
    for corner, angle, take, into in zip(outline, turn, radius * cut, np.roll(along, 1, axis=0), strict=True):
        inward = np.copysign(1.0, angle) * np.array([-into[1], into[0]])
        centre = corner - take * into + radius * inward
        chords = 2 * max(1, math.ceil(abs(angle) / (2 * ARC)))
        turned = np.linspace(0.0, angle, chords + 1)
        arm = -radius * inward
        x = arm[0] * np.cos(turned) - arm[1] * np.sin(turned)
        parts.append(centre + np.stack([x, arm[0] * np.sin(turned) + arm[1] * np.cos(turned)], axis=1))
    return np.concatenate(parts)


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
    return are_symmetric([outline], axis, tolerance)


def are_symmetric(outlines: Sequence[Array], axis: float = 0.0, tolerance: float = 1e-9) -> bool:
    """Whether the mirror image about x = axis of every outline is one of them (tolerance in its own widths)."""

    def same(image: Array, other: Array) -> bool:
        if len(image) != len(other):
            return False
        apart = np.linalg.norm(image[:, None] - other[None], axis=2).min(axis=1)
        return bool(apart.max() <= tolerance * np.ptp(image[:, 0]))

    mirrored = (outline * (-1.0, 1.0) + (2 * axis, 0.0) for outline in outlines)
    return all(any(same(image, outline) for outline in outlines) for image in mirrored)


# -- A force on the air by place ---------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Boxes:
    """Square boxes of edge ``pitch`` (m): ``columns`` of them from ``left`` (m) on, ``rows`` from ``bottom`` (m) up."""

    left: float
    bottom: float
    pitch: float
    columns: int
    rows: int

    @classmethod
    def across(cls, width: float, bottom: float, top: float, pitch: float) -> Boxes:
        """Boxes of about ``pitch`` (m) that fill a channel of ``width`` (m) about x = 0 and reach from ``bottom`` at
        least to ``top`` (m). Their number across is even: the boxes are their own mirror image, and none lies astride
        x = 0.
        """
        half = max(1, round(0.5 * width / pitch))
        edge = 0.5 * width / half
        return cls(-0.5 * width, bottom, edge, 2 * half, max(1, int(np.ceil((top - bottom) / edge - 1e-9))))

    @property
    def centres(self) -> Array:
        """Middles of all boxes, (rows, columns, 2) m."""
        x = self.left + (np.arange(self.columns) + 0.5) * self.pitch
        y = self.bottom + (np.arange(self.rows) + 0.5) * self.pitch
        return np.stack(np.meshgrid(x, y), axis=-1)

    def holding(self, points: Array) -> NDArray[np.int64]:
        """Number of the box, row by row, that holds each of ``points`` (n, 2) m; the nearest one for those outside."""
        column = np.clip((points[:, 0] - self.left) // self.pitch, 0, self.columns - 1)
        row = np.clip((points[:, 1] - self.bottom) // self.pitch, 0, self.rows - 1)
        return (row * self.columns + column).astype(np.int64)


@dataclass(frozen=True)
class ForceDensity:
    """``density`` (rows, columns, 2) N/m3 of a force on the air, uniform in each of the ``boxes``."""

    boxes: Boxes
    density: Array

    @property
    def total(self) -> Array:
        """The whole force, (2,) N per metre across the plane."""
        return np.asarray(self.density.sum(axis=(0, 1)) * self.boxes.pitch**2)

    @property
    def pressure(self) -> float:
        """The most pressure (Pa) that the force adds or takes on a way through the boxes that never turns back."""
        across, along = (np.abs(self.density[..., axis]).max(axis=axis).sum() for axis in (0, 1))
        return float(along + across) * self.boxes.pitch

    @property
    def digest(self) -> str:
        """sha256 (hex) of the force and its boxes."""
        return hashlib.sha256(repr(self.boxes).encode() + self.density.tobytes()).hexdigest()

    def mirrored(self) -> ForceDensity:
        """The mean of the force and its mirror image about x = 0."""
        image = self.density[:, ::-1] * (-1.0, 1.0)
        return replace(self, density=0.5 * (self.density + image))

    def towards(self, other: ForceDensity, share: float) -> ForceDensity:
        """``share`` of the way from this force to the ``other`` on the same boxes."""
        return replace(self, density=self.density + share * (other.density - self.density))


# -- Bisection ---------------------------------------------------------------------------------------------------------
def halved(before: Callable[[float], Any], low: float, high: float, halvings: int) -> tuple[float, float]:
    """The ends (low, high) of the bracket in which ``before`` turns from true to false, after so many ``halvings``.

    ``before`` is true at ``low`` and false at ``high``; neither end is asked. The bracket shrinks by 2^halvings, or
    until its ends are neighbours.

    >>> low, high = halved(lambda x: x * x < 2.0, 1.0, 2.0, 60)
    >>> low * low < 2.0 <= high * high
    True
    """
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if before(middle) else (low, middle)
    return low, high


def halved_all(
    before: Callable[[Array], NDArray[np.bool_]], low: Array, high: Array, halvings: int
) -> tuple[Array, Array]:
    """Halve n brackets (n,) at once, ``halvings`` times or until all are as narrow as numbers are: ``before`` takes the
    middles (n,) and tells each one's side (n,).
    """
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        holds = before(middle)
        wider, (low, high) = (low, high), (np.where(holds, middle, low), np.where(holds, high, middle))
        if np.array_equal(wider, (low, high)):
            break
    return low, high
