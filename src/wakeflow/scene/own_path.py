"""Where a file of the user's is that a scene, a sweep or a search names."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import SceneError


def own_path(given: str, base: Path, key: str) -> Path:
    """The path ``given`` under a ``key`` of a file in the folder ``base``: relative to that; ~ is the home of a user.

    Raises SceneError, naming the key, where no file can have that path.
    """
    if "\0" in given:
        raise SceneError(f"{key} = {given!r}: no path holds a zero byte; write it anew")
    try:
        return base / Path(given).expanduser()
    except RuntimeError:
        raise SceneError(f"{key} = {given!r}: no home of that user is known; write the whole path") from None
