"""The pressing zone by momentum alone: what the paper's impact law says of air.

A stream that meets a face inclined by beta to the horizontal with V cos(beta) normal to it and leaves along it, without
rebound and friction (R = f = 0 in the impact law, Spade, Vaicis, Vutukuru & Irbe 2020), presses with p = rho V^2
cos^2(beta): Cp = 2 cos^2(beta) on the whole face. On the leeward side the model says nothing; with the base pressure
from elsewhere Cd = mean of Cp over the projected front - Cp of the base.

Range: a stream of particles that do not meet each other (Newton's impact theory; hypersonic flow). In air of low speed
the pressure cannot exceed that of the stagnation point, Cp = 1, and falls to the suction of the wake at the corners. So
the model is more than twice too high for a face across the air, a third too high for a diamond, and near the mean of
the two only by luck, at beta about 60 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Momentum:
    """``cp`` (k,): pressure coefficient of every edge of the outline, 0 where the stream does not reach it; edge i runs
    from corner i to i + 1. ``front``: its mean over the projected width, the front's part of Cd. ``lit`` (k,): the
    share of each edge's own projected width that the stream reaches.
    """

    cp: Array
    front: float
    lit: Array

    def drag(self, cp_base: float) -> float:
        """Cd on the projected width: the front's part less ``cp_base``, the pressure coefficient of the lee side."""
        return self.front - cp_base


def momentum_pressure(outline: ArrayLike, direction: Literal["down", "up"] = "down") -> Momentum:
    """Cp = 2 cos^2(beta) on the edges of ``outline`` that air flowing ``direction`` meets; (k, 2) m, counter-clockwise.

    beta: inclination of an edge to the horizontal. Edges in the shadow of others upstream of them are not met.
    """
    corners = np.asarray(outline, dtype=float)
    start, end = corners, np.roll(corners, -1, axis=0)
    along = end - start
    cosine = along[:, 0] / np.linalg.norm(along, axis=1)
    pressure = 2 * cosine**2
    against = 1.0 if direction == "down" else -1.0  # upstream is +y in downward air
    reached = np.zeros(len(corners))
    for left, right in pairwise(np.unique(corners[:, 0])):
        middle = 0.5 * (left + right)
        spans = np.flatnonzero(
            (np.minimum(start[:, 0], end[:, 0]) < middle) & (middle < np.maximum(start[:, 0], end[:, 0]))
        )
        height = start[spans, 1] + (middle - start[spans, 0]) * along[spans, 1] / along[spans, 0]
        reached[spans[np.argmax(against * height)]] += right - left
    width = float(np.ptp(corners[:, 0]))
    lit = np.divide(reached, np.abs(along[:, 0]), out=np.zeros_like(reached), where=along[:, 0] != 0)
    return Momentum(np.where(lit > 0, pressure, 0.0), float((pressure * reached).sum() / width), lit)
