"""The motion of a field's whole mesh, which swings with the vibrating bodies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import SceneError

Array = NDArray[np.float64]
WHOLE = 0.01  # vibrations by which a moving field's period may miss a whole number of them. Chosen: 4 degrees of phase


class Swing(NamedTuple):
    """Harmonic motion of the whole mesh: displacement (x, y) sin(omega t + phase); m, rad/s, rad."""

    x: float
    y: float
    omega: float
    phase: float = 0.0

    def displacement(self, t: ArrayLike) -> Array:
        """Where the mesh is (.., 2) m at times ``t`` (..,) s, from where its points say."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.sin(angle)[..., None] * np.array([self.x, self.y]))

    def velocity(self, t: ArrayLike) -> Array:
        """How fast the mesh moves (.., 2) m/s."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        return np.asarray(np.cos(angle)[..., None] * np.array([self.x, self.y]) * self.omega)

    def check(self, in_time: bool, period: float | None) -> None:
        """Raise SceneError for numbers that are not finite, and for a field in time (``in_time``) whose ``period`` (s)
        is not a whole number of swings.
        """
        if not (np.all(np.isfinite(self)) and self.omega > 0):
            raise SceneError(f"motion: amplitude, omega and phase {tuple(self)} must be finite, and omega positive")
        if in_time:
            turns = np.inf if period is None else period * self.omega / (2 * np.pi)
            if not abs(turns - np.round(turns)) <= WHOLE:
                raise SceneError(f"motion: the field repeats after {turns:.4g} swings of its mesh, not a whole number")
