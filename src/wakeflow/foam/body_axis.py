"""Values on a body's axis: the line along the air through the middle of the first body, from its rear on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .case import FlowSpec, axis_points

__all__ = ["AxisCrossings"]

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
