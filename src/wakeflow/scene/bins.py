"""[bin.NAME]: the collectors."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from ..core.errors import SceneError, known
from ..core.quantities import metres
from .surroundings import Channel
from .table import Array, Table
from .units import Coordinate, Point

__all__ = ["Bin"]


class Bin(Table):
    """[bin.NAME]: a collector, a stretch of the channel's boundary or a line of points."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)
    start: Coordinate | None = Field(None, alias="from", description="x on the floor or top, y on a side")
    to: Coordinate | None = None
    on: Literal["floor", "left", "right", "top"] = Field("floor", description="the side of the channel it lies on")
    points: list[Point] | None = Field(None, description="a polyline anywhere in the channel, instead of from and to")

    @model_validator(mode="after")
    def _one_place(self) -> Bin:
        if self.points is not None:
            if self.start is not None or self.to is not None:
                raise SceneError("give either points, or from and to")
            if len(self.points) < 2:
                raise SceneError("points needs at least two [x, y] pairs")
            if not np.all(np.linalg.norm(np.diff(self.points, axis=0), axis=1) > 0):
                raise SceneError("points repeats a point")
        elif self.start is None or self.to is None:
            raise SceneError("give from and to (or points)")
        elif not self.start < self.to:
            raise SceneError(f"from = {metres(self.start)} must be below to = {metres(self.to)}")
        return self

    def line(self, channel: Channel) -> Array:
        """The collector as a polyline, (k, 2) in metres."""
        if self.points is not None:
            return np.asarray(self.points, dtype=float)
        along = np.array([known(self.start), known(self.to)])
        fixed = {"floor": channel.bottom, "top": channel.top, "left": -channel.width / 2, "right": channel.width / 2}[
            self.on
        ]
        across = np.full(2, fixed)
        return np.stack([along, across] if self.on in ("floor", "top") else [across, along], axis=1)
