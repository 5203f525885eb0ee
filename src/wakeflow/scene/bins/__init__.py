"""[bin.NAME]: the collectors. Each kind is a table and says where its line runs, what it catches, how it is drawn and
what of it can be dragged; nobody else asks which kind a bin is. A new kind is a module of this folder, which adds its
class to :data:`bin_kinds`.

Comes in: the table of a bin. Goes out: a bin of its kind. May call it: ``scene``, and through a scene all after it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import ConfigDict, Field, GetCoreSchemaHandler, model_validator
from pydantic_core.core_schema import CoreSchema, tagged_union_schema

from ...core.errors import SceneError
from ...core.geometry import along, runs_into
from ...core.quantities import metres
from ...core.registry import Registry, did_you_mean
from ..table import SHARE, Array, Coordinate, Name, Point, Table

if TYPE_CHECKING:
    from ..machine import Body, Channel


SIDES = ("floor", "top", "left", "right")  # of the channel


class Machine(Protocol):
    """What a bin lies in: a scene."""

    @property
    def channel(self) -> Channel: ...

    @property
    def body(self) -> Mapping[str, Body]: ...

    def on_sides(self, side: str = "") -> Mapping[str, Bin]:
        """The bins that are stretches of a ``side`` of the channel, or of any."""


class Grip(NamedTuple):
    """A point of a bin that can be dragged: the last part of its dotted ``key``, its place ``at`` (2,) m, what that key
    is once it is ``moved`` to x, y. Grips of several bins that ``joins`` has equal values are one divider.
    """

    key: str
    at: Array
    moved: Callable[[float, float], object]
    label: str = ""
    axis: str = "xy"
    joins: tuple[str, float] | None = None


class Bin(Table):
    """[bin.NAME]: a collector: an opening in the channel's boundary, a line of points, or a wall that keeps what
    touches it, or a part of that: a body, or a stretch of a side.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True)
    not_with: ClassVar[tuple[tuple[str, ...], str]] = ((), "")  # keys of other kinds, and what is said of them
    on: Name = Field(
        "floor", description="the side of the channel it lies on; or a body, which then keeps what touches it"
    )

    @classmethod
    def is_asked_by(cls, _table: Mapping[str, object]) -> bool:
        """Whether a scene's table is one of this kind."""
        return True

    @model_validator(mode="before")
    @classmethod
    def _one_place(cls, table: Any) -> Any:
        keys, words = cls.not_with
        if isinstance(table, Mapping) and any(key in table for key in keys):
            raise SceneError(words.format(on=table.get("on")))
        return table

    def line(self, scene: Machine) -> Array:
        """The collector as a polyline, (k, 2) in metres."""
        raise NotImplementedError

    def along(self, scene: Machine, points: Array) -> Array:
        """Where ``points`` (n, 2) m that it caught lie along its line (n,) m."""
        return along(self.line(scene), points)[0]

    @property
    def body(self) -> str | None:
        """The body that keeps what touches it for this bin; None where crossing the line ends a track."""
        return None

    @property
    def keeps_part(self) -> float | None:
        """Part of the impacts on it that it keeps, where it is a wall; None for what takes all that comes to it."""
        return None

    def wall(self, _scene: Machine, _thick: float) -> Array | None:
        """Corners (n, 2) m of the wall ``thick`` (m) that it is on a side of the channel; None where it is none."""
        return None

    @property
    def lies_under(self) -> bool:
        """Whether it catches what falls towards the floor below it."""
        return self.body is None

    @property
    def stands(self) -> bool:
        """Whether granules come to it sideways too."""
        return True

    def wrong(self, _scene: Machine) -> Iterator[str]:
        """What is wrong with it in a scene, from its key on."""
        return iter(())

    def passed(self, scene: Machine) -> list[tuple[float, float]]:
        """The ends (m) of its line over which granules can pass."""
        line = self.line(scene)
        return [(float(x), float(y)) for x, y in (line[0], line[-1])]

    def note(self, name: str, scene: Machine) -> tuple[Array, str, bool] | None:
        """What a drawing of the machine says beside it: of which point (2,) m, the words, whether on the left; None
        where its name stands along its line.
        """
        line = self.line(scene)
        left = bool(line[:, 0].mean() < 0.0)
        return line[np.argmin(line[:, 0]) if left else np.argmax(line[:, 0])], f"bin {name}", left

    def grips(self, _scene: Machine) -> Iterator[Grip]:
        """What of it can be dragged."""
        return iter(())


bin_kinds: Registry[type[Bin]] = Registry("kind of bin")


def kind_of(table: object) -> str:
    """The name of the kind of a bin, or of a bin's ``table``: of those that it asks for, what was registered last."""
    given: Mapping[str, object] = table if isinstance(table, Mapping) else {}
    return next(
        name
        for name in reversed(list(bin_kinds))
        if (type(table) is bin_kinds[name] if isinstance(table, Bin) else bin_kinds[name].is_asked_by(given))
    )


class _OfItsKind:
    """Marks a bin that is read as one of its kind."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        choices = {name: handler.generate_schema(bin_kinds[name]) for name in bin_kinds}
        return tagged_union_schema(choices, kind_of)


# -- The bins of every scene -------------------------------------------------------------------------------------------
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
        """Axis of its side: 0 along x, 1 along y."""
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
        """Ends (m) over which granules can pass: the wall closes one in a corner, unless a bin is on that wall."""
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
        """Outline of the body, closed."""
        outline = scene.body[self.on].outline()
        return np.vstack([outline, outline[:1]])

    def wrong(self, scene: Machine) -> Iterator[str]:
        known = [*SIDES, *scene.body]
        if self.on not in known:
            yield f".on = {self.on!r}: no side and no body{did_you_mean(self.on, known)} (known: {', '.join(known)})"

    def passed(self, scene: Machine) -> list[tuple[float, float]]:
        """Outermost points (m) of the outline, over which granules pass by it."""
        x = self.line(scene)[:, 0]
        return [(float(x), float(y)) for x, y in self.line(scene)[[x.argmin(), x.argmax()]]]


AnyBin = Annotated[Bin, _OfItsKind()]
for _name in [module.name for module in iter_modules(__path__)]:
    import_module(f".{_name}", __package__)
