"""The pictures that a scene asks for by [picture.NAME]: each a PNG and its data as CSV, an animation a GIF as well.

A kind is one function here, registered under the name of its table in ``tables.pictures``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.files import write_json
from .animation import draw_animation
from .curves import draw_curves
from .maps import draw_density, draw_streamlines
from .view import Drawn, View, pictures

if TYPE_CHECKING:
    from .. import Outcome

__all__ = ["Drawn", "View", "clear", "draw_all", "found", "pictures"]

LIST = "pictures.json"  # beside the pictures: what was drawn, so that nothing else is ever removed

for _name, _draw in (
    ("curves", draw_curves),
    ("animation", draw_animation),
    ("streamlines", draw_streamlines),
    ("density", draw_density),
):
    pictures.add(_name, _draw)


def draw_all(folder: Path, outcome: Outcome) -> dict[str, Any]:
    """Draw every picture of the scene into ``folder``.

    Returns name to kind, files, ``text`` (a sentence with the picture's numbers) and ``numbers``, what result.json
    holds of them. Raises SceneError where a picture cannot be drawn of what was computed.
    """
    table: dict[str, Any] = {}
    for name, picture in outcome.scene.picture.items():
        view = View(name, folder, picture, outcome)
        drawn = pictures[picture.kind](view)
        table[name] = {
            "kind": picture.kind,
            "files": [path.name for path in drawn.files],
            "text": " ".join(part for part in (picture.caption, drawn.text) if part),
            "numbers": drawn.numbers,
        }
    if table:
        write_json(folder / LIST, table)
    return table


def found(folder: Path) -> dict[str, Any]:
    """What ``draw_all`` left in a folder; empty where it left nothing or a file of it is gone."""
    try:
        table: dict[str, Any] = json.loads((folder / LIST).read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return {}
    whole = all((folder / file).exists() for row in table.values() for file in row["files"])
    return table if whole else {}


def clear(folder: Path) -> None:
    """Remove what ``draw_all`` left in a folder."""
    try:
        table = json.loads((folder / LIST).read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return
    for row in table.values():
        for file in row["files"]:
            (folder / file).unlink(missing_ok=True)
    (folder / LIST).unlink()
