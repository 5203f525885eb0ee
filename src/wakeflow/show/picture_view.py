"""What every kind of picture is handed and hands back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.lazy import cached_property
from ..core.record import JsonMapping
from ..core.registry import Registry
from ..core.tables import CellTable
from .moving import Path2D

if TYPE_CHECKING:
    from ..scene import Picture, Scene
    from .outcome import Outcome


@dataclass(frozen=True)
class PictureFiles:
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


pictures = Registry[Callable[[View], PictureFiles]]("kind of picture", extended=True)
