"""How long a cell's edge is where: a list of points with an edge each, and boxes behind the bodies.

Everywhere the edge is the least over the points, of (edge there + growth times distance), and over the boxes, of
theirs likewise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import distance_to, edges
from .outline import chains, seen, sharp, turning
from .spec import Array, MeshSpec

__all__ = ["Box", "Sizes", "boxes", "gap", "levels", "sources"]

# Chosen:
TURN = 0.2  # rad: a cell on a rounded part turns no more than this, so that a circle has 31 of them
STEP = 1.15  # ratio of neighbouring levels that the edges wanted are rounded down to: one field of Gmsh's each
DENSE = 0.5  # cell edges between the points along an outline at which sizes are set: between them nothing is missed
SHORTEST = 3.0  # corner cells over the shortest cell that an edge between two sharp corners may ask for
# Boxes behind a body, (length over the wake's, width over the body's, cell edge over the wake's): the near wake, in
# which the vortices form, and the way out of it.
WAKE_BOXES = ((1.0, 1.25, 1.0), (3.0, 1.5, 2.0))


@dataclass(frozen=True)
class Sizes:
    """Points (n, 2) m, the cell edge wanted at each (n,) m, and how fast it grows (m a metre) up to ``largest`` (m)."""

    points: Array
    edge: Array
    growth: float
    largest: float

    def at(self, places: Array) -> Array:
        """Cell edge (m) at places (k, 2), without the boxes."""
        distance = np.linalg.norm(places[:, None] - self.points, axis=2)
        return np.asarray(np.minimum((self.edge + self.growth * distance).min(axis=1), self.largest))


@dataclass(frozen=True)
class Box:
    """x from ``left`` to ``right``, y from ``low`` to ``high`` (m) with the cell edge ``edge`` (m) inside."""

    left: float
    right: float
    low: float
    high: float
    edge: float


def sources(spec: MeshSpec) -> Sizes:
    """The points that ask for small cells: on outlines, around openings and on no-slip side walls."""
    parts = [_on_body(spec, index) for index in range(len(spec.bodies))]
    for inlet in spec.inlets:
        x = spec.width / 2 * (1 if inlet.side == "right" else -1)
        size = min((inlet.end - inlet.start) * spec.of_gap, spec.h_far)
        y = _along(inlet.start, inlet.end, size)
        parts.append((np.column_stack([np.full(len(y), x), y]), np.full(len(y), size)))
    if spec.h_wall < spec.h_far:
        y = _along(spec.bottom, spec.top, spec.h_wall)
        for x in (-spec.width / 2, spec.width / 2):
            parts.append((np.column_stack([np.full(len(y), x), y]), np.full(len(y), spec.h_wall)))
    points, edge = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Sizes(points, np.minimum(edge, spec.h_far), spec.growth, spec.h_far)


def levels(sizes: Sizes) -> list[tuple[float, Array]]:
    """The points by their edge rounded down to a geometric ladder: (edge m, points (n, 2) m), finest first."""
    least = float(sizes.edge.min())
    step = np.floor(np.log(sizes.edge / least) / np.log(STEP) + 1e-9).astype(int)
    return [(least * STEP**k, sizes.points[step == k]) for k in np.unique(step).tolist()]


def boxes(spec: MeshSpec) -> list[Box]:
    """Behind every body, from its widest place on, the near wake and the way out of the wake; and where cells may not
    be longer than the far ones.
    """
    found = []
    ahead = 1.0 if spec.direction == "up" else -1.0
    for outline, width in zip(spec.bodies, spec.widths, strict=True):
        share = width / min(spec.widths)
        (left, low), (right, high) = np.min(outline, axis=0), np.max(outline, axis=0)
        widest = float(np.mean([y for x, y in outline if min(x - left, right - x) < 1e-9 * width]))
        reach = spec.wake_length * width / max(spec.widths)
        for length, wide, edge in WAKE_BOXES:
            ends = sorted((widest, (high if ahead > 0 else low) + ahead * length * reach))
            middle, half = (left + right) / 2, wide * width / 2
            size = min(edge * share * spec.h_wake, spec.h_far)
            found.append(Box(float(middle - half), float(middle + half), ends[0], float(ends[1]), size))
    if spec.h_end > spec.h_far:
        low, high = max(spec.fine[0], spec.bottom), min(spec.fine[1], spec.top)
        found.append(Box(-spec.width / 2, spec.width / 2, low, high, spec.h_far))
    return found


def _on_body(spec: MeshSpec, index: int) -> tuple[Array, Array]:
    """Points along one outline and the edge wanted at each: corners, short edges, tight roundings, narrow gaps."""
    outline = seen(spec, index)
    share = spec.widths[index] / min(spec.widths)
    body, corner = share * spec.h_body, share * min(spec.h_corner, spec.h_body)
    wanted = np.full(len(outline), body)
    rounded = ~sharp(outline)
    start, end = edges(outline)
    length = np.linalg.norm(end - start, axis=1)
    with np.errstate(divide="ignore"):
        radius = np.minimum(length, np.roll(length, 1)) / np.abs(turning(outline))
    wanted[rounded] = np.clip(TURN * radius[rounded], corner, body)
    wanted[~rounded] = corner
    along = np.full(len(outline), body)  # on each edge
    for chain, closed in chains(outline):
        total = length[chain[:-1]].sum()
        if not closed:
            along[chain[:-1]] = np.minimum(along[chain[:-1]], max(total * spec.of_edge, corner / SHORTEST))
    points, edge = [outline], [np.minimum(wanted, np.minimum(along, np.roll(along, 1)))]
    for a, b, size in zip(start, end, along, strict=True):
        share_along = _along(0.0, 1.0, DENSE * size / float(np.linalg.norm(b - a)))[1:-1]
        points.append(a + share_along[:, None] * (b - a))
        edge.append(np.full(len(share_along), size))
    places = np.concatenate(points)
    return places, np.minimum(np.concatenate(edge), gap(spec, index, places) * spec.of_gap)


def gap(spec: MeshSpec, index: int, places: Array) -> Array:
    """Distance (m) from places on a body to the nearest side wall or other body."""
    least = spec.width / 2 - np.abs(places[:, 0])
    for other, outline in enumerate(spec.bodies):
        if other != index:
            least = np.minimum(least, distance_to(places, np.array(outline)))
    return least


def _along(start: float, end: float, edge: float) -> NDArray[np.float64]:
    return np.linspace(start, end, max(2, int(np.ceil((end - start) / edge)) + 1))
