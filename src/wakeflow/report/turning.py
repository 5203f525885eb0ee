"""The air's vorticity as a raster in pale colours, at any moment of its loop: what granules are shown in front of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..field import FlowField
    from .canvas import Window

__all__ = ["Turning", "tone"]

Array = NDArray[np.float64]
STRONGEST = 97.0  # percentile of |vorticity| at which its colour is full
CLOCKWISE, COUNTER = (0.30, 0.55, 0.85), (0.88, 0.42, 0.35)  # blue, red
PALE = 0.75  # of the full colour


class Turning:
    """The vorticity of a ``field`` on ``size`` (across, up) dots of a ``window``, the upper left first."""

    def __init__(self, field: FlowField, window: Window, size: tuple[int, ...]) -> None:
        from ..field.derived import vorticity

        self.field, self.size = field, size
        x = window[0] + (np.arange(size[0]) + 0.5) / size[0] * (window[1] - window[0])
        y = window[3] - (np.arange(size[1]) + 0.5) / size[1] * (window[3] - window[2])
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        triangle = field.locate(points)
        self.inside = triangle >= 0
        self.weight = field.barycentric(triangle[self.inside], points[self.inside])
        self.corner = field.triangles[triangle[self.inside]]
        self.parts = vorticity(field).reshape(-1, len(field.points))

    def _nodal(self, time: float) -> Array:
        steady = self.field.times is None
        return self.parts[0] if steady else np.asarray(self.field.weights(time) @ self.parts)

    def strongest(self) -> float:
        """What the colour is full at: few nodes at the first moment have more (1/s)."""
        first = 0.0 if self.field.times is None else float(self.field.times[0])
        return float(np.percentile(np.abs(self._nodal(first)), STRONGEST)) or 1.0

    def shaded(self, time: float, strongest: float, levels: int | None = None) -> NDArray[np.uint8]:
        """Colours (up, across, 3) at ``time`` (s): blue turns clockwise, red counter-clockwise, white does not or is
        outside; in so many ``levels`` either way, or smooth.
        """
        values = np.zeros(len(self.inside))
        values[self.inside] = np.einsum("nk,nk->n", self.weight, self._nodal(time)[self.corner]) / strongest
        signed = np.tanh(values)
        if levels is not None:
            signed = np.round(signed * levels) / levels
        return np.rint(tone(signed)).astype(np.uint8).reshape(self.size[1], self.size[0], 3)


def tone(signed: Array) -> Array:
    """Colours (n, 3), 0 to 255, of vorticity (n,) between -1 and 1: pale, so that granules stand out."""
    colour = np.where((signed < 0.0)[:, None], CLOCKWISE, COUNTER)
    return 255.0 * (1.0 - PALE * np.abs(signed)[:, None] * (1.0 - colour))
