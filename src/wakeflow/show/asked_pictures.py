"""The pictures that a scene asks for by [picture.NAME]: each a PNG and its data as CSV.

A kind is one function of ``extras.pictures``, registered under the name of its table in ``scene.pictures``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..answer.result import PictureSummary
from ..core.errors import SceneError
from ..core.files import read_json, write_json
from ..core.lazy import cached_property
from ..core.record import JsonMapping, from_json, to_json
from ..core.registry import Registry
from ..core.tables import CellTable
from .canvas import SUFFIXES
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


__all__ = ["PictureFiles", "View", "clear_pictures", "draw_all", "finished_pictures", "pictures"]

LIST = "pictures.json"  # beside the pictures: what was drawn, so that nothing else is ever removed


def draw_all(folder: Path, outcome: Outcome) -> dict[str, PictureSummary]:
    """Draw every picture of the scene into ``folder``.

    Returns what result.json holds of each, by name. Raises SceneError where a picture cannot be drawn of what was
    computed.
    """
    drawn: dict[str, PictureSummary] = {}
    for name, picture in outcome.scene.picture.items():
        made = pictures[picture.kind](View(name, folder, picture, outcome))
        text = " ".join(part for part in (picture.caption, made.text) if part)
        files = tuple(path.name for path in (*made.files, *_beside(made.files)))
        drawn[name] = PictureSummary(picture.kind, files, text, to_json(made.numbers))
    if drawn:
        write_json(folder / LIST, to_json(drawn))
    return drawn


def _beside(files: list[Path]) -> list[Path]:
    """What :func:`.canvas.save` left beside each PNG, but what the picture told itself."""
    left = (path.with_suffix(suffix) for path in files if path.suffix == ".png" for suffix in SUFFIXES)
    return [path for path in left if path not in files and path.exists()]


def finished_pictures(folder: Path) -> dict[str, PictureSummary]:
    """What ``draw_all`` left in a folder; empty where it left nothing or a file of it is gone."""
    drawn = _listed(folder)
    whole = all((folder / file).exists() for picture in drawn.values() for file in picture.files)
    return drawn if whole else {}


def clear_pictures(folder: Path) -> None:
    """Remove what ``draw_all`` left in a folder."""
    for picture in _listed(folder).values():
        for file in picture.files:
            (folder / file).unlink(missing_ok=True)
    (folder / LIST).unlink(missing_ok=True)


def _listed(folder: Path) -> dict[str, PictureSummary]:
    try:
        table = read_json(folder / LIST)
        listed = {name: from_json(PictureSummary, picture, LIST) for name, picture in table.items()}
    except (OSError, SceneError, AttributeError):  # none were drawn, or the list is damaged: they are drawn again
        return {}
    inside = all(file == Path(file).name for picture in listed.values() for file in picture.files)
    return listed if inside else {}
