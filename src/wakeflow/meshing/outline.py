"""Outlines as the mesh takes them: corners and smooth parts, nodes on them, and the loops around the air.

A polygon that stands for a smooth curve turns a little at each of many corners. A corner that turns less than 25
degrees is part of a smooth *chain*; where its segments are shorter than a cell, some of the corners become nodes of the
mesh and the boundary is the polygon through them, within 5 % of a cell of the outline; longer segments are cut into
whole cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..geometry import edges
from .spec import Array, MeshSpec, Outline

__all__ = ["Piece", "chains", "distance", "loops", "sharp", "to_edges", "turning"]

SMOOTH = math.radians(25)  # a corner that turns less is part of a curve
OFF = 0.05  # of a cell: how far the mesh's boundary may lie off the outline
LONG = 0.6  # of a cell: a segment longer than this keeps both its ends
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Piece:
    """A straight part of the boundary that starts at ``start`` (m) on patch ``patch``.

    ``cells`` is how many cells lie on it, 0 for as many as the sizes around want.
    """

    start: tuple[float, float]
    patch: str
    cells: int = 0


def turning(outline: Array) -> Array:
    """Angle (rad) by which a counter-clockwise outline turns at each corner; positive where it is convex."""
    start, end = edges(outline)
    out = end - start
    into = np.roll(out, 1, axis=0)
    return np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], (into * out).sum(axis=1))


def sharp(outline: Array) -> NDArray[np.bool_]:
    """Which corners are more than a step of a smooth curve."""
    return np.abs(turning(outline)) > SMOOTH


def chains(outline: Array) -> list[tuple[Indices, bool]]:
    """Runs of corners from one sharp corner to the next, ends included; one closed run where none is sharp (True)."""
    count, ends = len(outline), np.flatnonzero(sharp(outline))
    if len(ends) == 0:
        return [(np.arange(count + 1) % count, True)]
    following = np.append(ends[1:], ends[0] + count)
    return [(np.arange(a, b + 1) % count, False) for a, b in zip(ends, following, strict=True)]


def to_edges(places: Array, outline: Array) -> Array:
    """Distance (m) from each place (k, 2) to a polygon's edges."""
    start, end = edges(outline)
    return _to_segments(places, start, end).min(axis=1)


def _to_segments(places: Array, start: Array, end: Array) -> Array:
    along = end - start
    offset = places[:, None] - start
    share = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return np.asarray(np.linalg.norm(offset - share[..., None] * along, axis=2))


def distance(one: Array, other: Array) -> float:
    """Least distance (m) between two polygons' corners and edges; 0 when edges cross."""

    def side(p: Array, q: Array, r: Array) -> Array:
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    (a, b), (c, d) = edges(one[:, None]), edges(other)
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    crossing = (side(a, b, c) * side(a, b, d) <= 0) & (side(c, d, a) * side(c, d, b) <= 0)
    return 0.0 if crossing.any() else float(min(to_edges(one, other).min(), to_edges(other, one).min()))


def loops(spec: MeshSpec, size: Callable[[Array], Array]) -> list[list[Piece]]:
    """Closed loops of pieces around the air: the channel's first, counter-clockwise, then the bodies inside it.

    ``size`` gives the cell edge (m) wanted at places (k, 2).
    """
    pieces = _channel(spec)
    holes = []
    on_axis = []
    for name, outline in zip(spec.names, spec.bodies, strict=True):
        patch = f"body_{name}"
        if not spec.half or min(x for x, _ in outline) > 0:
            ring = np.array(outline)
            holes.append([piece for chain, _ in chains(ring) for piece in _nodes(ring[chain], patch, size)])
        elif max(x for x, _ in outline) > 0:
            on_axis.append((np.array(_right_half(outline))[::-1], patch))
    for chain, patch in sorted(on_axis, key=lambda item: -item[0][0][1]):  # down the axis, from the top
        for part in _split(chain):
            pieces += _nodes(part, patch, size)
        pieces.append(Piece((float(chain[-1][0]), float(chain[-1][1])), "axis"))
    return [_even(ring) for ring in (pieces, *holes)]


def _even(ring: list[Piece]) -> list[Piece]:
    """A ring whose given cells are even in number, for only then can all triangles be paired to quadrilaterals.

    (Gmsh gives even numbers to the other pieces.) The piece with the longest cells takes one more.
    """
    if sum(piece.cells for piece in ring) % 2 == 0:
        return ring
    following = ring[1:] + ring[:1]
    given = [i for i, piece in enumerate(ring) if piece.cells]
    longest = max(given, key=lambda i: math.dist(ring[i].start, following[i].start) / ring[i].cells)
    return [replace(piece, cells=piece.cells + (i == longest)) for i, piece in enumerate(ring)]


def _channel(spec: MeshSpec) -> list[Piece]:
    """The channel's rectangle, from its lower left corner; the last piece comes down the left side or the axis."""
    up = spec.direction == "up"
    right, left = spec.width / 2, 0.0 if spec.half else -spec.width / 2
    pieces = [Piece((left, spec.bottom), "inlet" if up else "outlet")]
    pieces += _side(spec, "right", right)
    pieces.append(Piece((right, spec.top), "outlet" if up else "inlet"))
    return pieces + ([Piece((left, spec.top), "axis")] if spec.half else _side(spec, "left", left))


def _side(spec: MeshSpec, side: str, x: float) -> list[Piece]:
    """A side wall with its openings, upwards on the right and downwards on the left."""
    marks = [(spec.bottom, side)]
    for inlet in sorted((i for i in spec.inlets if i.side == side), key=lambda i: i.start):
        marks += [(inlet.start, inlet.patch), (inlet.end, side)]
    ends = [y for y, _ in marks[1:]] + [spec.top]
    parts = [(low, high, patch) for (low, patch), high in zip(marks, ends, strict=True) if high > low]
    if side == "right":
        return [Piece((x, low), patch) for low, _, patch in parts]
    return [Piece((x, high), patch) for _, high, patch in reversed(parts)]


def _split(chain: Array) -> list[Array]:
    """An open chain cut at its sharp corners."""
    along = np.diff(chain, axis=0)
    into, out = along[:-1], along[1:]
    turn = np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], (into * out).sum(axis=1))
    cuts = [0, *(np.flatnonzero(np.abs(turn) > SMOOTH) + 1).tolist(), len(chain) - 1]
    return [chain[a : b + 1] for a, b in pairwise(cuts)]


def _nodes(chain: Array, patch: str, size: Callable[[Array], Array]) -> list[Piece]:
    """Pieces along a smooth chain (k, 2), whose last point starts the next one."""
    if len(chain) == 2:
        return [Piece((float(chain[0][0]), float(chain[0][1])), patch)]
    length = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    edge = size(0.5 * (chain[1:] + chain[:-1]))
    cells = length / edge
    long = cells >= LONG
    pieces: list[Piece] = []
    first = 0
    while first < len(length):
        last = first + 1
        if not long[first]:
            while last < len(length) and not long[last]:
                last += 1
        run = chain[first : last + 1]
        kept, each = ([0], 0 if cells[first] > 4 else max(1, round(float(cells[first]))))
        if not long[first]:
            kept, each = _thinned(run, cells[first:last], float(edge[first:last].min())), 1
        pieces += [Piece((float(run[k][0]), float(run[k][1])), patch, each) for k in kept]
        first = last
    return pieces


def _thinned(run: Array, cells: Array, edge: float) -> list[int]:
    """Which corners of a run of short segments become nodes, the first included and the last not.

    Evenly spaced in cells; more of them where the boundary through them lay further than 5 % of a cell off the run.
    """
    reached = np.concatenate([[0.0], np.cumsum(cells)])
    for count in range(max(1, round(float(reached[-1]))), len(cells)):
        kept = np.unique(np.abs(reached[:, None] - np.linspace(0, reached[-1], count + 1)).argmin(axis=0))
        off = max(float(_to_segments(run[a : b + 1], run[None, a], run[None, b]).max()) for a, b in pairwise(kept))
        if off <= OFF * edge:
            return [int(k) for k in kept[:-1]]
    return list(range(len(cells)))


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
