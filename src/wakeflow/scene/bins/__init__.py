"""[bin.NAME]: the collectors. Each kind is a table and says where its line runs, what it catches, how it is drawn and
what of it can be dragged; nobody else asks which kind a bin is. A new kind is a module of this folder, which adds its
class to :data:`bin_kinds`.

Comes in: the table of a bin. Goes out: a bin of its kind. May call it: ``scene``, and through a scene all after it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from pydantic import ConfigDict, Field, GetCoreSchemaHandler, model_validator
from pydantic_core.core_schema import CoreSchema, tagged_union_schema

from ...core.errors import SceneError
from ...core.geometry import along
from ...core.registry import Registry
from ..table import Array, Name, Table

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


AnyBin = Annotated[Bin, _OfItsKind()]
for _name in ("built_in", *(found.name for found in iter_modules(__path__))):
    import_module(f".{_name}", __package__)
