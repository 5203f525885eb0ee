"""What granules meet in flight: faces and corners of all bodies, how they move, and the lines that end a track.

A granule of radius r touches a body where its centre meets the outline offset by r: a ring of faces shifted outward and
arcs about the convex corners. Both are *pieces* with a normal that turns by (arc length) / r along an arc and not at
all along a face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..tracking import Body, Motion
from ..tracking.pack_walls import pack_lines, pack_walls

__all__ = ["Index", "Surfaces"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Surfaces:
    """Faces and convex corners of all bodies in one table each, at rest (m).

    ``start`` (m, 2), ``normal`` (m, 2) outward, ``size`` (m,) of the faces; ``face_body`` (m,) whose they are;
    ``face_ends`` (m, 2) the corner at their start and end, -1 where it turns inwards; ``corner`` (c, 2),
    ``corner_body`` (c,), ``corner_faces`` (c, 2) the faces before and after; of bodies ``swing`` (b, 2) amplitude (m),
    ``pace`` (b,) rad/s of its fastest change and ``period`` (b,) s, 0 at rest, ``motions``, ``restitution`` and
    ``friction`` (b,), NaN where the granule's own count, ``captures``. ``line`` (k, 4) segments with ``line_of`` (k,).
    """

    start: Array
    normal: Array
    size: Array
    face_body: Index
    face_ends: Index
    corner: Array
    corner_body: Index
    corner_faces: Index
    swing: Array
    pace: Array
    period: Array
    motions: tuple[Motion, ...]
    restitution: Array
    friction: Array
    captures: NDArray[np.bool_]
    line: Array
    line_of: Index

    @classmethod
    def of(cls, bodies: Sequence[Body], lines: Sequence[Any]) -> Surfaces:
        """The tables of ``bodies`` and polylines ``lines``."""
        segments, owner = pack_lines(lines)
        walls = pack_walls(bodies, (segments, owner))
        still = Motion((0.0, 0.0), 0.0)
        motions = tuple(still if body.motion is None or not body.motion.moves else body.motion for body in bodies)
        return cls(
            walls.edges[:, 0:2], walls.edges[:, 4:6], walls.edges[:, 6],
            walls.edge_links[:, 0], walls.edge_links[:, 1:3],
            walls.vertices, walls.vertex_links[:, 0], walls.vertex_links[:, 1:3],
            np.array([motion.amplitude for motion in motions], dtype=float).reshape(-1, 2),
            np.array([motion.pace for motion in motions]),
            np.array([1.0 / motion.frequency if motion.moves else 0.0 for motion in motions]),
            motions,
            np.array([np.nan if body.restitution is None else body.restitution for body in bodies]),
            np.array([np.nan if body.friction is None else body.friction for body in bodies]),
            np.array([body.capture for body in bodies], dtype=bool),
            segments, owner,
        )  # fmt: skip

    def moved(self, body: Index, t: Array) -> tuple[Array, Array, Array]:
        """Displacement (m), velocity (m/s) and acceleration (m/s2), (n, 2) each, of bodies (n,) at times t (n,)."""
        found = np.zeros((3, len(t), 2))
        for motion in {id(motion): motion for motion in self.motions if motion.moves}.values():
            its = np.array([other is motion for other in self.motions])[body]
            if its.all():
                return motion.at(t)
            found[:, its] = motion.at(t[its])
        return found[0], found[1], found[2]
