"""A force on the air by place: its density on square boxes in the plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["Boxes", "ForceDensity"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Boxes:
    """Square boxes of edge ``pitch`` (m): ``columns`` of them from ``left`` (m) on, ``rows`` from ``bottom`` (m) up."""

    left: float
    bottom: float
    pitch: float
    columns: int
    rows: int

    @classmethod
    def across(cls, width: float, bottom: float, top: float, pitch: float) -> Boxes:
        """Boxes of about ``pitch`` (m) that fill a channel of ``width`` (m) about x = 0 and reach from ``bottom`` at
        least to ``top`` (m). Their number across is even: the boxes are their own mirror image, and none lies astride
        x = 0.
        """
        half = max(1, round(0.5 * width / pitch))
        edge = 0.5 * width / half
        return cls(-0.5 * width, bottom, edge, 2 * half, max(1, int(np.ceil((top - bottom) / edge - 1e-9))))

    @property
    def centres(self) -> Array:
        """Middles of all boxes, (rows, columns, 2) m."""
        x = self.left + (np.arange(self.columns) + 0.5) * self.pitch
        y = self.bottom + (np.arange(self.rows) + 0.5) * self.pitch
        return np.stack(np.meshgrid(x, y), axis=-1)

    def holding(self, points: Array) -> NDArray[np.int64]:
        """Number of the box, row by row, that holds each of ``points`` (n, 2) m; the nearest one for those outside."""
        column = np.clip((points[:, 0] - self.left) // self.pitch, 0, self.columns - 1)
        row = np.clip((points[:, 1] - self.bottom) // self.pitch, 0, self.rows - 1)
        return (row * self.columns + column).astype(np.int64)


@dataclass(frozen=True)
class ForceDensity:
    """``density`` (rows, columns, 2) N/m3 of a force on the air, uniform in each of the ``boxes``."""

    boxes: Boxes
    density: Array

    @property
    def total(self) -> Array:
        """The whole force, (2,) N per metre across the plane."""
        return np.asarray(self.density.sum(axis=(0, 1)) * self.boxes.pitch**2)

    def mirrored(self) -> ForceDensity:
        """The mean of the force and its mirror image about x = 0."""
        image = self.density[:, ::-1] * (-1.0, 1.0)
        return replace(self, density=0.5 * (self.density + image))

    def above(self, least: float) -> ForceDensity:
        """The force where its density is at least ``least`` (N/m3), nothing elsewhere."""
        strong = np.linalg.norm(self.density, axis=2, keepdims=True) >= least
        return replace(self, density=np.where(strong, self.density, 0.0))

    def towards(self, other: ForceDensity, share: float) -> ForceDensity:
        """``share`` of the way from this force to the ``other`` on the same boxes."""
        return replace(self, density=self.density + share * (other.density - self.density))
