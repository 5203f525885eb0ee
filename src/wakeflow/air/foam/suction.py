"""The suction zone behind a body: how far, how wide, how deep, and how far the air runs backwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import area
from .airflow_result import SuctionZone
from .case import FlowSpec, axis_points

# -- Values on a body's axis -------------------------------------------------------------------------------------------
Array = NDArray[np.float64]
ASIDE = 1e-7  # widths beside the axis, where no node lies: an edge that ends on the axis would cross it twice or never
ON_BODY = 1e-9  # widths before the rear: edges of the body's own, which round-off puts before it, count


@dataclass(frozen=True, eq=False)
class AxisCrossings:
    """The places where the edges of a mesh cross the axis behind the body.

    ``behind`` (p,) m from the rear, rising; ``ends`` (p, 2) the nodes of the edge that crosses there, and how far along
    it, from the first to the second, ``share`` (p,).
    """

    behind: Array
    ends: NDArray[np.intp]
    share: Array

    @classmethod
    def of(cls, spec: FlowSpec, points: Array, triangles: NDArray[np.intp]) -> AxisCrossings:
        """Those of the mesh of ``triangles`` (t, 3) between ``points`` (n, 2) m."""
        middle, _, rear = axis_points(spec)
        size = spec.mesh.projected_width
        x, s = points[:, 0] - middle - ASIDE * size, spec.along * points[:, 1]
        sides = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        ends = np.unique(np.sort(sides, axis=1), axis=0)
        ends = ends[(x[ends[:, 0]] * x[ends[:, 1]] < 0) & (s[ends].max(axis=1) > rear - ON_BODY * size)]
        share = x[ends[:, 0]] / (x[ends[:, 0]] - x[ends[:, 1]])
        place = s[ends[:, 0]] + share * (s[ends[:, 1]] - s[ends[:, 0]])
        order = np.argsort(place)
        return cls(place[order] - rear, ends[order], share[order])

    def values(self, nodes: Array) -> Array:
        """Values (p,) at the crossings of what is ``nodes`` (n,) at the mesh's nodes: linear along each edge."""
        first, second = nodes[self.ends[:, 0]], nodes[self.ends[:, 1]]
        return np.asarray(first + self.share * (second - first))

    def at(self, behind: Array, nodes: Array) -> Array:
        """The same at ``behind`` (q,) m from the rear: linear from one crossing to the next."""
        return np.interp(behind, self.behind, self.values(nodes))


# -- The suction zone behind a body ------------------------------------------------------------------------------------
THRESHOLD = -0.5  # pressure coefficient below which the air counts as the suction zone


def suction_zone(
    spec: FlowSpec, points: Array, triangles: NDArray[np.intp], cp: Array, velocity: Array, body: NDArray[np.intp]
) -> SuctionZone:
    """Extent of the suction zone from node values; triangles are cut along Cp = threshold and at the body's widest
    place.
    """
    outline = np.array(spec.mesh.bodies[0])
    along = spec.along * outline[:, 1]
    left, right = outline[:, 0].min(), outline[:, 0].max()
    size = right - left
    widest = float(max(s for (x, _), s in zip(outline, along, strict=True) if min(x - left, right - x) < 1e-6 * size))
    rear = float(along.max())
    x, s = points[:, 0], spec.along * points[:, 1]
    inside = _connected((cp < THRESHOLD) & (s >= widest - 1e-6 * size), triangles, body)
    chosen = triangles[inside[triangles].any(axis=1)]
    whole = (cp[chosen] <= THRESHOLD).all(axis=1) & (s[chosen] >= widest).all(axis=1)  # nearly all: nothing to cut
    pieces = [_cut(np.column_stack([x[t], s[t], cp[t]]), widest) for t in chosen[~whole]]
    pieces = [piece[:, :2] for piece in pieces if len(piece) >= 3]
    uncut = np.stack([x, s], axis=1)[chosen[whole]]  # (w, 3, 2)
    reversal = _reversal(spec, points, triangles, spec.along * velocity[:, 1])
    if not pieces and not len(uncut):
        return SuctionZone(THRESHOLD, float(cp[s >= widest].min()), 0.0, 0.0, 0.0, reversal)
    corners = np.vstack([uncut.reshape(-1, 2), *pieces])
    (x1, s1), (x2, s2) = ((uncut[:, i] - uncut[:, 0]).T for i in (1, 2))
    twice = 2.0 if spec.mesh.half else 1.0
    across = 2 * corners[:, 0].max() if spec.mesh.half else np.ptp(corners[:, 0])
    return SuctionZone(
        threshold=THRESHOLD,
        cp_min=float(cp[inside].min()),
        length=max(float(corners[:, 1].max()) - rear, 0.0),
        width=float(across),
        area=twice * (0.5 * float(np.abs(x1 * s2 - x2 * s1).sum()) + sum(abs(area(item - item[0])) for item in pieces)),
        reversal_length=reversal,
    )


def _connected(low: NDArray[np.bool_], triangles: NDArray[np.intp], body: NDArray[np.intp]) -> NDArray[np.bool_]:
    """The nodes of ``low`` that a chain of mesh edges within ``low`` joins to the body."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    pairs = pairs[low[pairs].all(axis=1)]
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(low), len(low)))
    _, label = connected_components(graph, directed=False)
    return low & np.isin(label, label[body[low[body]]])


def _cut(corners: Array, widest: float) -> Array:
    """The part of a triangle, rows (x, s, Cp), with Cp below the threshold and s beyond ``widest``."""
    for column, sign, level in ((2, 1.0, THRESHOLD), (1, -1.0, widest)):
        if len(corners) == 0:
            break
        level_distance = sign * (corners[:, column] - level)
        kept = []
        for i, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
            da, db = level_distance[i], level_distance[(i + 1) % len(corners)]
            if da <= 0:
                kept.append(a)
            if da * db < 0:
                kept.append(a + da / (da - db) * (b - a))
        corners = np.array(kept).reshape(-1, 3)
    return corners


def _reversal(spec: FlowSpec, points: Array, triangles: NDArray[np.intp], forward: Array) -> float:
    """Distance (m) from the rear to where the velocity along the air on the body's axis turns forward; 0 when it
    never turns back.
    """
    axis = AxisCrossings.of(spec, points, triangles)
    place, speed = axis.behind, axis.values(forward)
    backwards = np.flatnonzero(speed < -1e-6 * spec.speed)
    if not len(backwards) or place[backwards[0]] > spec.mesh.projected_width:
        return 0.0
    turns = np.flatnonzero((speed[:-1] < 0) & (speed[1:] >= 0) & (place[1:] > place[backwards[0]]))
    if not len(turns):
        return float(place[-1])
    i = turns[0]
    return float(place[i] - speed[i] * (place[i + 1] - place[i]) / (speed[i + 1] - speed[i]))
