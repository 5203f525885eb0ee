"""Air beside no-slip walls, whose layers are thinner than triangles: eddies that the wall damps, and a mean velocity
that does not blow into it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..air.field import FlowField
from ..core.geometry import distance_to_edges
from ..laws.turbulence import damping, lifetime, shortest_life

Array = NDArray[np.float64]
Index = NDArray[np.int64]
STILL = 1e-6  # of the fastest air: a boundary that is slower in the mean is at rest; modes are rounded
FEW = 8  # edges next to a node that are looked at
LONGEST_LIFE = 1e6  # s, of an eddy where next to nothing is dissipated
LEAST = 0.1  # of sqrt(2 k / 3), up to y+ 3.5; chosen: granules of tau+ 1 to 10 are laid on walls as measured


def wall_edges(field: FlowField) -> tuple[Index, Index]:
    """Triangles (W,) with an edge on a no-slip wall, and which corner (W,) is opposite: both ends are at rest in the
    mean. Where all air is, walls are where k is 0.
    """
    triangle, corner = np.nonzero(field.neighbours < 0)
    share = None if field.times is None else field.time_axis.mean_weights()
    mean = field.velocity if share is None else np.tensordot(share, field.velocity, axes=1)
    still = np.abs(mean).max(axis=1) <= STILL * np.abs(field.velocity).max()
    if still.all():
        still = np.zeros_like(still) if field.k is None else (field.k if share is None else share @ field.k) <= 0.0
    on = np.all([still[field.triangles[triangle, (corner + step) % 3]] for step in (1, 2)], axis=0)
    return triangle[on], corner[on]


def eddies(field: FlowField, k: Array, dissipation: Array) -> tuple[Array, Array]:
    """Deviation m/s and lifetime s of the eddies (.., N) from k m2/s2 and its dissipation m2/s3 at the nodes.

    They are alike in all directions, beside a no-slip wall as weak as across it; on it there are none, whatever k says.
    """
    (walls, away), viscosity = _away(field), field.viscosity / field.density
    rms, life = np.empty(k.shape), np.empty(k.shape)
    for row in np.ndindex(*k.shape[:-1]):  # as few numbers at a time as the processor holds near
        energy, lost = np.maximum(k[row], 0.0), np.maximum(dissipation[row], 0.0)
        energy[walls] = 0.0
        deviation, lives = np.sqrt(2.0 / 3.0 * energy), lifetime(energy, lost)
        if len(walls):
            share = damping(lost, away, viscosity)
            lives = np.maximum(lives, (1.0 - share) * shortest_life(lost, viscosity))
            deviation *= np.maximum(share, LEAST)
        rms[row], life[row] = deviation, np.minimum(lives, LONGEST_LIFE)
    return rms, life


def _away(field: FlowField) -> tuple[Index, Array]:
    """Nodes (W, 2) of the edges on no-slip walls; distance (N,) m of all nodes from the nearest of those near by. Kept
    with the mesh for the next air that has the same walls.
    """
    from scipy.spatial import cKDTree

    triangle, corner = wall_edges(field)
    ends = field.triangles[triangle[:, None], (corner[:, None] + [1, 2]) % 3]
    if not len(ends):
        return ends, np.zeros(0)
    kept, away = field.geometry.get("away", (ends[:0], np.zeros(0)))
    if not np.array_equal(kept, ends):
        start, end = np.swapaxes(field.points[ends], 0, 1)
        near = cKDTree(0.5 * (start + end)).query(field.points, k=range(1, min(FEW, len(start)) + 1))[1]
        away = distance_to_edges(field.points, start[near], end[near])
        field.geometry["away"] = ends, away
    return ends, away


def hold_off(field: FlowField, velocity: Array) -> None:
    """Take from ``velocity`` (.., N, 2) m/s what blows into no-slip walls at the nodes next to them, in place.

    In the triangle on a wall all components are linear in the distance; across the wall they fall with its square. Air
    that blows towards it would carry what it carries up to it, at a constant angle.
    """
    triangle, corner = wall_edges(field)
    apex, foot = field.triangles[triangle, corner], field.triangles[triangle, (corner + 1) % 3]
    normal = field.gradients[triangle, corner]
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    order = np.argsort(apex, kind="stable")
    turn = np.arange(len(apex)) - np.searchsorted(apex[order], apex[order])  # a node may be opposite to several edges
    for which in 2 * list(range(turn.max(initial=-1) + 1)):
        row = order[turn == which]
        n, node = normal[row], apex[row]
        into = np.einsum("...nd,nd->...n", velocity[..., node, :] - velocity[..., foot[row], :], n)
        velocity[..., node, :] -= np.minimum(into, 0.0)[..., None] * n
