"""What every kind of picture is handed and hands back: a view of the run, and recorded tracks at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import distance_to, halved
from ...core.lazy import cached_property
from ...core.record import JsonMapping
from ...core.registry import Registry
from ...core.tables import AnyArray, CellTable
from ...injection.first_contact import motion_of

if TYPE_CHECKING:
    from ...scene import Picture, Scene
    from ..outcome import Outcome

Array = NDArray[np.float64]
TOUCH = 1e-3  # of its radius: a recorded point nearer than that to a body is a contact


def body_displacement(scene: Scene, time: Array) -> Array:
    """Where the bodies are off the middle of their vibration, (n, 2) m at times (n,) s."""
    motion = motion_of(scene)
    return np.zeros((len(time), 2)) if motion is None else motion.at(time)[0]


@dataclass(frozen=True)
class Path2D:
    """One recorded track: time (m,) s, position (m, 2) m, velocity (m, 2) m/s, the granule's diameter (m).

    Between two points the acceleration is taken as constant, from the velocity after the first to the position of the
    second: exact in free flight without air, and right up to an impact, which is a point.
    """

    time: Array
    position: Array
    velocity: Array
    diameter: float

    @classmethod
    def of(cls, track: Mapping[str, AnyArray]) -> Path2D:
        return cls(track["time"], track["position"], track["velocity"], float(track["diameter"]))

    def at(self, time: Array) -> tuple[Array, Array]:
        """Positions (k, 2) m and velocities (k, 2) m/s at ``time`` (k,) s; before and after the track, its ends."""
        moments = np.clip(time, self.time[0], self.time[-1])
        if len(self.time) < 2:
            return np.tile(self.position[0], (len(moments), 1)), np.tile(self.velocity[0], (len(moments), 1))
        i = np.clip(np.searchsorted(self.time, moments, side="right") - 1, 0, len(self.time) - 2)
        span, s = (self.time[i + 1] - self.time[i])[:, None], (moments - self.time[i])[:, None]
        start = self.velocity[i]
        mean = np.divide(self.position[i + 1] - self.position[i], span, out=start.copy(), where=span > 0)
        part = np.divide(s, span, out=np.zeros_like(s), where=span > 0)
        return self.position[i] + s * (start + part * (mean - start)), start + 2.0 * part * (mean - start)

    def touches(self, scene: Scene) -> NDArray[np.bool_]:
        """Which recorded points (m,) touch a body."""
        shift = body_displacement(scene, self.time)
        near = np.full(len(self.time), np.inf)
        for body in scene.body.values():
            near = np.minimum(near, distance_to(self.position - shift, body.outline()))
        return near <= (1.0 + TOUCH) * self.diameter / 2

    def separation(self, scene: Scene) -> int | None:
        """The recorded point at which it last touches a body; None where it never does."""
        touching = np.flatnonzero(self.touches(scene))
        return int(touching[-1]) if len(touching) else None

    def falls_to(self, level: float, first: int) -> float | None:
        """Time (s) at which it first comes down to y = ``level`` (m) after recorded point ``first``; None: never."""
        below = np.flatnonzero(self.position[first:, 1] <= level)
        if not len(below) or below[0] == 0:
            return None
        low, high = self.time[first + below[0] - 1], self.time[first + below[0]]
        return float(halved(lambda time: self.at(np.array([time]))[0][0, 1] > level, low, high, 60)[1])


@dataclass(frozen=True)
class Drawn:
    """What a picture left: its files, the PNG first; a sentence with its numbers; the numbers for result.json."""

    files: list[Path]
    text: str = ""
    numbers: JsonMapping = field(default_factory=dict)


@dataclass(frozen=True)
class View:
    """One picture of a run: its name, the folder it goes to, its table, and the run."""

    name: str
    folder: Path
    picture: Picture
    outcome: Outcome

    @property
    def scene(self) -> Scene:
        return self.outcome.scene

    @cached_property
    def paths(self) -> dict[str, list[Path2D]]:
        """The recorded tracks that this picture draws, by fraction."""
        shown = self.outcome.shown[self.name]
        return {name: [Path2D.of(track) for track in part] for name, part in shown.items()}

    def file(self, suffix: str) -> Path:
        return self.folder / f"{self.name}{suffix}"

    def write_csv(self, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
        """The data of the picture; ``columns`` carry their units."""
        near = [[round(cell, 12) if isinstance(cell, float) else cell for cell in row] for row in rows]  # no round-off
        CellTable(columns, near).write_csv(self.file(".csv"), 9)
        return self.file(".csv")


pictures = Registry[Callable[[View], Drawn]]("kind of picture")
