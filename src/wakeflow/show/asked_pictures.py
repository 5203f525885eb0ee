"""The pictures that a scene asks for by [picture.NAME]: each a PNG and its data as CSV.

A kind is one function of ``extras.pictures``, registered under the name of its table in ``scene.pictures``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..answer.result import PictureSummary
from ..core.errors import SceneError
from ..core.files import read_json, write_json
from ..core.record import from_json, to_json
from .canvas import SUFFIXES
from .picture_view import PictureFiles, View, pictures

if TYPE_CHECKING:
    from .outcome import Outcome

__all__ = ["PictureFiles", "View", "clear_pictures", "draw_all", "found", "pictures"]

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
    found = (path.with_suffix(suffix) for path in files if path.suffix == ".png" for suffix in SUFFIXES)
    return [path for path in found if path not in files and path.exists()]


def found(folder: Path) -> dict[str, PictureSummary]:
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
        told = {name: from_json(PictureSummary, picture, LIST) for name, picture in table.items()}
    except (OSError, SceneError, AttributeError):  # none were drawn, or the list is damaged: they are drawn again
        return {}
    inside = all(file == Path(file).name for picture in told.values() for file in picture.files)
    return told if inside else {}
