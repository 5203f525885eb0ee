"""Outlines as the mesh takes them: corners and smooth parts, nodes on them, and the loops around the air.

A polygon that represents a smooth curve turns a little at each of many corners. A corner that turns less than 25
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

from ...core.errors import MeshError
from ...core.geometry import distance_to_edges, edges, wall_edge
from .spec import Array, MeshSpec, turn

# Chosen:
SMOOTH = math.radians(25)  # a corner that turns less is part of a curve; core.geometry's roundings turn by 7.5 a chord
OFF = 0.05  # of a cell: how far the mesh's boundary may lie off the outline
LONG = 0.6  # of a cell: a segment longer than this keeps both its ends
SPECK = 0.75  # of a corner cell: of a row of corners nearer to each other than this only the middle one counts
ON_AXIS = 1e-9  # of the outline's largest coordinate: how far off x = 0 a point still lies on the axis
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Piece:
    """A straight part of the boundary from ``start`` (m) on, of patch ``patch``; ``whole``: it is one cell's edge."""

    start: tuple[float, float]
    patch: str
    whole: bool = False


def seen(spec: MeshSpec, index: int) -> Array:
    """A body's outline as the mesh sees it: of a row of corners shorter than 3/4 of a corner cell, the middle one.

    So that no speck rules the time step; a right angle's rounding moves by a seventh of a corner cell at most.
    """
    outline = np.array(spec.bodies[index])
    least = SPECK * min(spec.h_corner, spec.h_body) * spec.widths[index] / min(spec.widths)
    start, end = edges(outline)
    length = np.linalg.norm(end - start, axis=1)
    if (length >= least).sum() < 3:  # a smooth curve of short segments all around
        return outline
    first = int(np.flatnonzero(length >= least)[0]) + 1
    rows: list[list[int]] = []
    for corner in (np.arange(first, first + len(outline)) % len(outline)).tolist():
        if rows and length[rows[-1][-1]] < least:
            rows[-1].append(corner)
        else:
            rows.append([corner])
    return np.array([
        corner
        for row in rows
        for corner in (outline[row] if length[row[:-1]].sum() > least else outline[row[len(row) // 2], None])
    ])  # fmt: skip


def turn_angles(outline: Array) -> Array:
    """Angle (rad) by which a counter-clockwise outline turns at each corner; positive where it is convex."""
    start, end = edges(outline)
    return turn(np.roll(end - start, 1, axis=0), end - start)


def sharp(outline: Array) -> NDArray[np.bool_]:
    """Which corners are more than a step of a smooth curve."""
    return np.abs(turn_angles(outline)) > SMOOTH


def chains(outline: Array) -> list[tuple[Indices, bool]]:
    """Runs of corners from one sharp corner to the next, ends included; one closed run where none is sharp (True)."""
    count, ends = len(outline), np.flatnonzero(sharp(outline))
    if len(ends) == 0:
        return [(np.arange(count + 1) % count, True)]
    following = np.append(ends[1:], ends[0] + count)
    return [(np.arange(a, b + 1) % count, False) for a, b in zip(ends, following, strict=True)]


def loops(spec: MeshSpec, size: Callable[[Array], Array]) -> list[list[Piece]]:
    """Closed loops of pieces around the air: the channel's first, counter-clockwise, then the bodies inside it.

    ``size`` gives the cell edge (m) wanted at places (k, 2).
    """
    pieces = _channel(spec, size)
    holes = []
    on_axis = []
    for index, name in enumerate(spec.names):
        ring, patch = seen(spec, index), f"body_{name}"
        if spec.standing(index) is not None:
            continue  # part of the channel's side
        if not spec.half or ring[:, 0].min() > 0:
            holes.append([piece for chain, _ in chains(ring) for piece in _nodes(ring[chain], patch, size)])
        elif ring[:, 0].max() > 0:
            on_axis.append((_right_half(ring)[::-1], patch))
    for chain, patch in sorted(on_axis, key=lambda item: -item[0][0][1]):  # down the axis, from the top
        for part in _split(chain):
            pieces += _nodes(part, patch, size)
        pieces.append(Piece((float(chain[-1][0]), float(chain[-1][1])), "axis"))
    return [_even(ring) for ring in (pieces, *holes)]


def _even(ring: list[Piece]) -> list[Piece]:
    """A ring with evenly many whole pieces, for only then can all triangles be paired to quadrilaterals.

    (Gmsh itself gives even numbers to the other pieces.) The longest is halved.
    """
    whole = [i for i, piece in enumerate(ring) if piece.whole]
    if len(whole) % 2 == 0:
        return ring
    ends = [piece.start for piece in ring[1:] + ring[:1]]
    longest = max(whole, key=lambda i: math.dist(ring[i].start, ends[i]))
    (x0, y0), (x1, y1) = ring[longest].start, ends[longest]
    return [*ring[: longest + 1], replace(ring[longest], start=((x0 + x1) / 2, (y0 + y1) / 2)), *ring[longest + 1 :]]


def _channel(spec: MeshSpec, size: Callable[[Array], Array]) -> list[Piece]:
    """The channel's rectangle, from its lower left corner; the last piece comes down the left side or the axis."""
    up = spec.direction == "up"
    right, left = spec.width / 2, 0.0 if spec.half else -spec.width / 2
    pieces = [Piece((left, spec.bottom), "inlet" if up else "outlet")]
    pieces += _side(spec, "right", right, size)
    pieces.append(Piece((right, spec.top), "outlet" if up else "inlet"))
    return pieces + ([Piece((left, spec.top), "axis")] if spec.half else _side(spec, "left", left, size))


def _side(spec: MeshSpec, side: str, x: float, size: Callable[[Array], Array]) -> list[Piece]:
    """A side wall with its openings and the bodies that stand on it, upwards on the right and downwards on the left."""
    upwards = side == "right"
    parts = [
        (inlet.start, inlet.end, [Piece((x, inlet.start if upwards else inlet.end), inlet.patch)])
        for inlet in spec.inlets
        if inlet.side == side
    ]
    for index, name in enumerate(spec.names):
        edge = spec.standing(index)
        if edge is not None and edge.side == side:
            parts.append((edge.low, edge.high, _standing(seen(spec, index), f"body_{name}", spec, size)))
    result, level = [], spec.bottom
    for low, high, pieces in [*sorted(parts, key=lambda part: part[0]), (spec.top, spec.top, [])]:
        if low > level:
            result.append([Piece((x, level if upwards else low), side)])
        result.append(pieces)
        level = high
    return [piece for pieces in (result if upwards else reversed(result)) for piece in pieces]


def _standing(ring: Array, patch: str, spec: MeshSpec, size: Callable[[Array], Array]) -> list[Piece]:
    """A body that stands on a side wall, from where the side comes to it to where the side goes on."""
    edge = wall_edge(ring, spec.width / 2)
    if edge is None:
        raise MeshError(f"{patch} stands on a wall with an edge shorter than a cell: make it longer")
    chain = np.roll(ring, -edge.first - 1, axis=0)[::-1]
    return [piece for part in _split(chain) for piece in _nodes(part, patch, size)]


def _split(chain: Array) -> list[Array]:
    """An open chain cut at its sharp corners."""
    along = np.diff(chain, axis=0)
    cuts = [0, *(np.flatnonzero(np.abs(turn(along[:-1], along[1:])) > SMOOTH) + 1).tolist(), len(chain) - 1]
    return [chain[a : b + 1] for a, b in pairwise(cuts)]


def _nodes(chain: Array, patch: str, size: Callable[[Array], Array]) -> list[Piece]:
    """One piece a cell along a smooth chain (k, 2), whose last point starts the next one."""
    length = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    cells = length / size(0.5 * (chain[1:] + chain[:-1]))
    long = cells >= LONG if len(length) > 1 else np.ones(1, dtype=bool)
    nodes: list[Array] = []
    first = 0
    while first < len(length):
        last = first + 1
        while not long[first] and last < len(length) and not long[last]:
            last += 1
        run = chain[first : last + 1]
        nodes.append(
            _divided(run[0], run[1], size, even=len(length) == 1) if long[first] else _thinned(run, cells[first:last])
        )
        first = last
    return [Piece((x, y), patch, whole=True) for x, y in np.concatenate(nodes).tolist()]


def _divided(start: Array, end: Array, size: Callable[[Array], Array], *, even: bool) -> Array:
    """Nodes on a straight line with cells of the size wanted, evenly many if so; ``end`` is left out."""
    share = np.linspace(0, 1, 401)
    cells = float(np.linalg.norm(end - start)) / size(start + share[:, None] * (end - start))
    reached = np.concatenate([[0.0], np.cumsum(0.5 * (cells[1:] + cells[:-1]) * np.diff(share))])
    wanted = float(reached[-1]) - 1e-9
    count = 2 * math.ceil(wanted / 2) if even else max(1, round(wanted))
    at = np.interp(np.linspace(0, reached[-1], count + 1)[:-1], reached, share)
    return np.asarray(start + at[:, None] * (end - start))


def _thinned(run: Array, cells: Array) -> Array:
    """Which corners of a run (k, 2) of short segments become nodes; its end is left out.

    Evenly many and evenly spaced in cells (k - 1,); more where the boundary through them lay further than 5 % of the
    shortest cell off the run.
    """
    reached = np.concatenate([[0.0], np.cumsum(cells)])
    edge = float((np.linalg.norm(np.diff(run, axis=0), axis=1) / cells).min())
    wanted = float(reached[-1])
    for count in range(1 if wanted < 1.5 else max(2, 2 * round(wanted / 2)), len(cells)):
        kept = np.unique(np.abs(reached[:, None] - np.linspace(0, reached[-1], count + 1)).argmin(axis=0))
        parts = ((run[a : b + 1], run[None, a], run[None, b]) for a, b in pairwise(kept))
        off = max(float(distance_to_edges(*part).max()) for part in parts)
        if off <= OFF * edge:
            return np.asarray(run[kept[:-1]])
    return run[:-1]


def _right_half(outline: Array) -> Array:
    """The part of a counter-clockwise outline at x >= 0, from its lower to its upper end on the axis x = 0."""
    size = float(np.abs(outline).max())
    points: list[tuple[float, float]] = []
    for (x0, y0), (x1, y1) in zip(*edges(outline), strict=True):
        points.append((0.0 if abs(x0) < ON_AXIS * size else x0, y0))
        if min(x0, x1) < -ON_AXIS * size and max(x0, x1) > ON_AXIS * size:
            points.append((0.0, y0 - x0 * (y1 - y0) / (x1 - x0)))
    count = len(points)
    starts = [i for i in range(count) if points[i][0] == 0.0 and points[(i + 1) % count][0] > 0]
    if len(starts) != 1:
        raise MeshError("a body meets the axis more than once: it cannot be meshed as a half domain")
    chain = [points[starts[0]]]
    while len(chain) == 1 or chain[-1][0] > 0:
        chain.append(points[(starts[0] + len(chain)) % count])
    return np.array(chain)
