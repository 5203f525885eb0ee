"""The force of granules on the air, gathered along their tracks.

In steady operation a mass flow M of granules that pass along a track exerts on the air, between two of its points,

    F = -M (dv - g' dt),   g' = g (1 - rho_air / rho) with buoyancy, else g,

with dv the velocity that all but walls and other granules gave it in between and dt the time that it took: the
track-length estimate of particle-source-in-cell (Crowe, Sharma & Stock 1977, J. Fluids Eng. 99, 325). The tracker keeps
that velocity with every point of a path, impacts and collisions left out, so that the forces of all boxes add up to
what the granules lost to the air, to round-off, however coarse the boxes are. All forces of the air count, not drag
alone.

Range: granules that fill little of the volume; the force of a whole step lies on the straight line between its ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.geometry import Boxes, ForceDensity
from ..laws.constants import GRAVITY
from .granules import Granules
from .tracks import Tracks

Array = NDArray[np.float64]
TOGETHER = 128  # tracks that are laid into the boxes at a time
PIECES = 4  # a track is laid into the boxes in pieces of at most this part of a box's edge; chosen


def force_on_the_air(
    tracks: Tracks,
    grains: Granules,
    mass_flow: float | Array,
    boxes: Boxes,
    *,
    air_density: float = 0.0,
    forces: Sequence[str] = ("drag", "gravity"),
    gravity: Sequence[float] = (0.0, -GRAVITY),
) -> ForceDensity:
    """What ``tracks`` of ``grains``, kept with their paths, exert on the air when a ``mass_flow`` (kg/s per metre
    across the plane) comes along all of them together, each granule standing for the same part of it; or along each
    its own (n,).

    ``air_density`` (kg/m3) and ``forces`` as flown, for the buoyancy. What lies outside the ``boxes`` goes to those on
    their edge. Raises SceneError where no paths were kept.
    """
    if len(tracks.recorded) < len(grains):
        raise SceneError("force_on_the_air: no paths were kept; call track(..., record=True)")
    lift = air_density / grains.density if "buoyancy" in forces else np.zeros(len(grains))
    weight = (1.0 - lift)[:, None] * np.asarray(gravity, dtype=float)
    count = boxes.rows * boxes.columns
    found = np.zeros((count, 2))
    flow = mass_flow if isinstance(mass_flow, np.ndarray) else np.full(len(grains), mass_flow / max(len(grains), 1))
    for low in range(0, len(grains), TOGETHER):
        some = slice(low, low + TOGETHER)
        place, given = _laid(tracks.recorded[some], weight[some], flow[some], boxes)
        for axis in (0, 1):
            found[:, axis] -= np.bincount(place, given[:, axis], count)
    return ForceDensity(boxes, found.reshape(boxes.rows, boxes.columns, 2) / boxes.pitch**2)


def _laid(paths: Sequence[Array], pull: Array, flow: Array, boxes: Boxes) -> tuple[NDArray[np.int64], Array]:
    """Boxes (k,) along ``paths``, and what the air gave the granules in each (k, 2), N/m: ``flow`` (n,) kg/s a metre of
    each times the velocity.
    """
    lengths = np.array([len(path) for path in paths])
    points = np.concatenate(paths)
    owner = np.repeat(np.arange(len(paths)), np.maximum(lengths - 1, 0))
    begins = np.delete(np.arange(len(points)), np.cumsum(lengths) - 1)
    start = points[begins]
    change = points[begins + 1] - start
    given = (change[:, 5:7] - change[:, :1] * pull[owner]) * flow[owner, None]
    way = np.hypot(change[:, 1], change[:, 2])
    pieces = np.maximum(1, np.ceil(PIECES * way / boxes.pitch).astype(np.int64))
    step = np.repeat(np.arange(len(pieces)), pieces)
    number = np.arange(len(step)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    along = ((number + 0.5) / pieces[step])[:, None]
    return boxes.holding(start[step, 1:3] + along * change[step, 1:3]), (given / pieces[:, None])[step]
