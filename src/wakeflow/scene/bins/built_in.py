"""The bins of every scene: a stretch of the channel's boundary, a line of points, a body that keeps what touches it, or
a part of that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.errors import SceneError
from ...core.geometry import runs_into
from ...core.quantities import metres
from ...core.registry import did_you_mean
from ..table import SHARE, Array, Coordinate, Name, Point
from . import SIDES, Bin, Grip, Machine, bin_kinds

CORNER = 1e-9  # channel widths: an end so near to a corner of the channel is in it
OUTWARD = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "floor": (0.0, -1.0), "top": (0.0, 1.0)}
Side = Literal["floor", "left", "right", "top"]
Kept = Annotated[float, Field(ge=0, le=1), SHARE]
KEEPS = "part of what meets the wall, at each impact, that stays there"


@bin_kinds.register("side")
class SideBin(Bin):
    """[bin.NAME]: a stretch of the channel's boundary: an opening, or a wall that keeps a part of what meets it."""

    start: Coordinate = Field(alias="from", description="x on the floor or top, y on a side")
    to: Coordinate
    on: Side = Field("floor", description="the side of the channel it lies on")
    keeps: Kept | None = Field(
        None, description=f"{KEEPS}; the side is then a wall there, not an opening. 0: only what stays by its fraction"
    )

    @model_validator(mode="after")
    def _ascends(self) -> SideBin:
        if not self.start < self.to:
            raise SceneError(f"from = {metres(self.start)} must be below to = {metres(self.to)}")
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """Where it begins and ends along its side (m)."""
        return self.start, self.to

    @property
    def axis(self) -> int:
        """Of its side: 0 along x, 1 along y."""
        return int(self.on in ("left", "right"))

    def line(self, scene: Machine) -> Array:
        parts = np.array(self.ends), np.full(2, scene.channel.sides[self.on])
        return np.stack(parts[::-1] if self.axis else parts, axis=1)

    @property
    def keeps_part(self) -> float | None:
        return self.keeps

    def wall(self, scene: Machine, thick: float) -> Array | None:
        line = self.line(scene)
        return None if self.keeps is None else np.concatenate([line, line[::-1] + thick * np.array(OUTWARD[self.on])])

    def along(self, _scene: Machine, points: Array) -> Array:
        return points[:, self.axis]

    @property
    def lies_under(self) -> bool:
        return self.on == "floor"

    @property
    def stands(self) -> bool:
        return bool(self.axis)

    def passed(self, scene: Machine) -> list[tuple[float, float]]:
        """In a corner of the channel the wall closes it, unless a bin is on that wall."""
        within = scene.channel.width / 2 - CORNER * scene.channel.width
        return [(x, y) for x, y in super().passed(scene)
                if abs(x) < within or scene.on_sides("right" if x > 0 else "left")]  # fmt: skip

    def note(self, name: str, scene: Machine) -> tuple[Array, str, bool] | None:
        words = f"bin {name}: y {metres(self.start)} to {metres(self.to)}"
        return (self.line(scene).mean(axis=0), words, self.on == "left") if self.axis else None

    def grips(self, scene: Machine) -> Iterator[Grip]:
        for key, place, at in zip(("from", "to"), self.ends, self.line(scene), strict=True):
            yield Grip(key, at, lambda *to: to[self.axis], axis="xy"[self.axis], joins=(self.on, round(place, 9)))


@bin_kinds.register("polyline")
class PolylineBin(Bin):
    """[bin.NAME]: a line of points."""

    not_with = ("from", "start", "to", "keeps"), "give either points, or from and to (keeps is of a wall)"
    on: Side = Field("floor", description="of no effect")
    points: list[Point] = Field(description="a polyline anywhere in the channel, instead of from and to")

    @classmethod
    def is_asked_by(cls, table: Mapping[str, object]) -> bool:
        return "points" in table

    @model_validator(mode="after")
    def _has_a_length(self) -> PolylineBin:
        if len(self.points) < 2:
            raise SceneError("points needs at least two [x, y] pairs")
        if not np.all(np.linalg.norm(np.diff(self.points, axis=0), axis=1) > 0):
            raise SceneError("points repeats a point")
        return self

    def line(self, _scene: Machine) -> Array:
        return np.asarray(self.points, dtype=float)

    def wrong(self, scene: Machine) -> Iterator[str]:
        if any(runs_into(self.line(scene), body.outline()) for body in scene.body.values()):
            yield " runs through a body"

    def grips(self, scene: Machine) -> Iterator[Grip]:
        for i, at in enumerate(self.line(scene)):
            yield Grip("points", at, partial(self._moved, i), f"point {i + 1}")

    def _moved(self, which: int, *to: float) -> list[list[float]]:
        return [list(to) if i == which else [float(x), float(y)] for i, (x, y) in enumerate(self.points)]


@bin_kinds.register("body")
class BodyBin(Bin):
    """[bin.NAME]: a body that keeps what touches it, or a part of that."""

    not_with = (
        ("from", "start", "to", "points"), "on = {on!r} is the whole body of that name: leave out from, to and points"
    )  # fmt: skip
    on: Name = Field(description="a body, which then keeps what touches it")
    keeps: Kept = Field(1.0, description=f"{KEEPS}. 0: only what stays by sticks or capture_speed of its fraction")

    @classmethod
    def is_asked_by(cls, table: Mapping[str, object]) -> bool:
        return table.get("on", "floor") not in SIDES

    @property
    def body(self) -> str:
        return self.on

    @property
    def keeps_part(self) -> float:
        return self.keeps

    def line(self, scene: Machine) -> Array:
        """Its outline, closed."""
        outline = scene.body[self.on].outline()
        return np.vstack([outline, outline[:1]])

    def wrong(self, scene: Machine) -> Iterator[str]:
        known = [*SIDES, *scene.body]
        if self.on not in known:
            yield f".on = {self.on!r}: no side and no body{did_you_mean(self.on, known)} (known: {', '.join(known)})"

    def passed(self, scene: Machine) -> list[tuple[float, float]]:
        """Granules pass by it over its outermost points."""
        x = self.line(scene)[:, 0]
        return [(float(x), float(y)) for x, y in self.line(scene)[[x.argmin(), x.argmax()]]]
