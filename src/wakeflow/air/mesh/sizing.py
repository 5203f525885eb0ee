"""How fine the mesh is where, and how far it reaches: from a scene's outlines and a rung to a mesh spec.

Everywhere the edge is the least over the points, of (edge there + growth times distance), and over the boxes, of
theirs likewise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError
from ...core.geometry import distance_between, distance_to, edges, is_symmetric, wall_edge
from .outline import chains, seen, sharp, turn_angles
from .spec import Array, Direction, MeshSpec, SideInlet, Strategy

# -- How fine the mesh is where ----------------------------------------------------------------------------------------
# Cell edge over projected body width at the body, its corners, in the near wake and far away. "draft" is meant for
# the half domain and a steady solution; "standard" for a time-resolved one, whose time step the smallest cells dictate;
# "reference" of a scene is that table on three scales (planning.airflow.GRIDS).
RESOLUTION = {
    "draft": {"body": 1 / 60, "corner": 1 / 160, "wake": 1 / 28, "far": 1 / 6, "growth": 0.12},
    "standard": {"body": 1 / 40, "corner": 1 / 80, "wake": 1 / 26, "far": 1 / 5, "growth": 0.13},
}
# over an edge's length, a gap, the channel's width: on short edges, at narrow gaps, far away in a wide channel, and on
# no-slip side walls
SHARES = {"edge": 1 / 6, "gap": 1 / 8, "across": 1 / 40, "wall": 1 / 40}
# Distance from the bodies to inlet and outlet, in widths of the widest: the least and the most; between them what
# LEFT asks for in the channel's width. Chosen; the study domain shows what they leave.
UPSTREAM, DOWNSTREAM = (3.0, 10.0), (8.0, 20.0)
# What the ends may send back to a body, over what the body does to the air there. Between slip walls W apart the
# slowest disturbance of a potential flow, cos(pi (x + W/2)/W) exp(-pi y/W), falls by exp(-pi d/W) over the distance d:
# what the inlet's fixed velocity returns has gone there and back, what vortices do at the outlet's fixed pressure comes
# back only.
LEFT = 1e-3
NEAR_REGION = (1.0, 5.0)  # widths before and behind the bodies with cells no longer than the far ones
END = 2.5  # cell edge at inlet and outlet over the far one, at most
WAKE = 2.5  # length of the wake's fine cells in widths of the widest body. Chosen: the vortices have formed by then


def plan_mesh(
    bodies: Sequence[Array],
    *,
    width: float,
    top: float,
    bottom: float,
    names: Sequence[str] = (),
    walls: str = "slip",
    direction: Direction = "down",
    rung: str = "draft",
    scale: float = 1.0,
    inlets: Sequence[SideInlet] = (),
    extend: bool = True,
    half: bool | None = None,
    strategy: Strategy = "quads",
) -> MeshSpec:
    """Choose cell sizes for a rung, ``scale`` times its table, from the narrowest body's projected width.

    With ``extend`` a channel that ends too near to the bodies (:func:`ends`) is meshed longer, with cells that grow
    outside of it: the inlet's uniform air and the outlet's uniform pressure must not touch the wake. ``inlets``:
    openings in the side walls. ``half`` None: a draft takes the half domain where all is symmetric about x = 0; False:
    never. Raises SceneError for bodies that touch each other or a wall, openings off the channel or on each other, and
    ``half`` True without symmetry.
    """
    if rung not in RESOLUTION:
        raise SceneError(f"no mesh is planned for rung {rung!r} (known: {', '.join(RESOLUTION)})")
    outlines = [np.asarray(body, dtype=float) for body in bodies]
    _check_places(outlines, width, top, bottom)
    _check_inlets(inlets, top, bottom)
    left, right = ({(i.start, i.end) for i in inlets if i.side == side} for side in ("left", "right"))
    symmetric = all(is_symmetric(outline) for outline in outlines) and left == right
    if half and not symmetric:
        raise SceneError("the half domain needs bodies and openings that are symmetric about x = 0")
    fine = _around(outlines, top, bottom, direction, NEAR_REGION)
    if extend:
        top, bottom = _around(outlines, top, bottom, direction, ends(width / _largest(outlines)))
    return MeshSpec(
        bodies=tuple(tuple((float(x), float(y)) for x, y in outline) for outline in outlines),
        names=tuple(names or map(str, range(len(outlines)))),
        width=width, top=top, bottom=bottom, walls="slip" if walls == "slip" else "no-slip", direction=direction,
        half=(rung == "draft" and symmetric) if half is None else half, inlets=tuple(inlets),
        strategy=strategy, fine=(fine[1], fine[0]), **_sizes(rung, scale, outlines, width, walls),
    )  # fmt: skip


def ends(width: float) -> tuple[float, float]:
    """Distance from bodies to inlet and outlet that a channel needs; it and ``width`` in widths of the widest body."""
    outlet = width * math.log(1 / LEFT) / math.pi
    return (
        float(np.clip(0.5 * outlet, *UPSTREAM)),
        float(np.clip(outlet, *DOWNSTREAM)),
    )


def _around(
    outlines: list[Array], top: float, bottom: float, direction: Direction, distances: tuple[float, float]
) -> tuple[float, float]:
    """Top and bottom (m), at least ``distances`` before and behind all bodies, in widths of the widest."""
    low = min(float(o[:, 1].min()) for o in outlines)
    high = max(float(o[:, 1].max()) for o in outlines)
    before, behind = (distance * _largest(outlines) for distance in distances)
    above, below = (before, behind) if direction == "down" else (behind, before)
    return max(top, high + above), min(bottom, low - below)


def _largest(outlines: list[Array]) -> float:
    """Width (m) of the widest body across the air."""
    return max(float(np.ptp(outline[:, 0])) for outline in outlines)


def _sizes(rung: str, scale: float, outlines: list[Array], width: float, walls: str) -> dict[str, float]:
    """The cell sizes of a MeshSpec by name: edges of cells in m, the rest over other lengths."""
    table = RESOLUTION[rung] | SHARES
    across = [float(np.ptp(outline[:, 0])) for outline in outlines]
    size, largest = min(across), max(across)
    h_far = scale * max(table["far"] * largest, table["across"] * width)
    return {
        "h_body": scale * table["body"] * size,
        "h_corner": scale * table["corner"] * size,
        "h_wake": scale * table["wake"] * size,
        "h_far": h_far,
        "h_end": END * h_far,
        "growth": scale * table["growth"],
        "wake_length": WAKE * largest,
        "h_wall": min(scale * table["wall"] * width, h_far) if walls == "no-slip" else h_far,
        "of_edge": scale * table["edge"],
        "of_gap": scale * table["gap"],
    }


def _check_places(outlines: list[Array], width: float, top: float, bottom: float) -> None:
    for i, outline in enumerate(outlines):
        (left, low), (right, high) = outline.min(axis=0), outline.max(axis=0)
        inside = (-width / 2 < left and right < width / 2) or wall_edge(outline, width / 2) is not None
        if not inside or low <= bottom or high >= top:
            raise SceneError(
                f"body {i} spans x {left:g}..{right:g} m, y {low:g}..{high:g} m and must lie inside the channel "
                f"x {-width / 2:g}..{width / 2:g} m, y {bottom:g}..{top:g} m"
            )
        for j, other in enumerate(outlines[:i]):
            if distance_between(outline, other) <= 0:
                raise SceneError(f"bodies {j} and {i} touch each other: move one of them")


def _check_inlets(inlets: Sequence[SideInlet], top: float, bottom: float) -> None:
    for i, inlet in enumerate(inlets):
        if not bottom <= inlet.start < inlet.end <= top:
            raise SceneError(
                f"the opening {inlet.name!r} spans y {inlet.start:g}..{inlet.end:g} m and must rise within the "
                f"channel's {bottom:g}..{top:g} m"
            )
        for other in inlets[:i]:
            if inlet.name == other.name:
                raise SceneError(f"two openings are called {inlet.name!r}: rename one of them")
            if inlet.side == other.side and inlet.start < other.end and other.start < inlet.end:
                raise SceneError(f"the openings {other.name!r} and {inlet.name!r} overlap: move one of them")


# -- How long a cell's edge is where -----------------------------------------------------------------------------------
# Chosen:
TURN = 0.2  # rad: a cell on a rounded part turns no more than this, so that a circle has 31 of them
LEVEL_RATIO = 1.15  # ratio of neighbouring levels that the edges wanted are rounded down to: one field of Gmsh's each
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
    step = np.floor(np.log(sizes.edge / least) / np.log(LEVEL_RATIO) + 1e-9).astype(int)
    return [(least * LEVEL_RATIO**k, sizes.points[step == k]) for k in np.unique(step).tolist()]


def boxes(spec: MeshSpec) -> list[Box]:
    """Behind every body, from its widest place on, the near wake and the way out of the wake; and where cells may not
    be longer than the far ones.
    """
    result = []
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
            result.append(Box(float(middle - half), float(middle + half), ends[0], float(ends[1]), size))
    if spec.h_end > spec.h_far:
        low, high = max(spec.fine[0], spec.bottom), min(spec.fine[1], spec.top)
        result.append(Box(-spec.width / 2, spec.width / 2, low, high, spec.h_far))
    return result


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
        radius = np.minimum(length, np.roll(length, 1)) / np.abs(turn_angles(outline))
    wanted[rounded] = np.clip(TURN * radius[rounded], corner, body)
    wanted[~rounded] = corner
    along = np.full(len(outline), body)  # on each edge
    for chain, closed in chains(outline):
        total = length[chain[:-1]].sum()
        if not closed:
            along[chain[:-1]] = np.minimum(along[chain[:-1]], max(total * spec.of_edge, corner / SHORTEST))
    standing = wall_edge(outline, spec.width / 2)
    if standing is not None:  # its corners on the wall are no edges in the air
        along[standing.first] = body
        wanted[[standing.first, (standing.first + 1) % len(outline)]] = body
    points, edge = [outline], [np.minimum(wanted, np.minimum(along, np.roll(along, 1)))]
    for a, b, size in zip(start, end, along, strict=True):
        share_along = _along(0.0, 1.0, DENSE * size / float(np.linalg.norm(b - a)))[1:-1]
        points.append(a + share_along[:, None] * (b - a))
        edge.append(np.full(len(share_along), size))
    places = np.concatenate(points)
    return places, np.minimum(np.concatenate(edge), gap(spec, index, places) * spec.of_gap)


def gap(spec: MeshSpec, index: int, places: Array) -> Array:
    """Distance (m) from places on a body to the nearest side wall, that on which it stands aside, or other body."""
    edge, half = spec.standing(index), spec.width / 2
    walls = {"left": places[:, 0] + half, "right": half - places[:, 0]}
    least: Array = np.min([off for side, off in walls.items() if edge is None or side != edge.side], axis=0)
    for other, outline in enumerate(spec.bodies):
        if other != index:
            least = np.minimum(least, distance_to(places, np.array(outline)))
    return least


def _along(start: float, end: float, edge: float) -> NDArray[np.float64]:
    return np.linspace(start, end, max(2, int(np.ceil((end - start) / edge)) + 1))
