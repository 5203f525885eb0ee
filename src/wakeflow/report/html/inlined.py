"""Pictures inside a page: PNG files as base64."""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterable
from pathlib import Path

__all__ = ["inlined_pictures", "is_long"]

LONG = 1.75  # width over height of a picture that takes the page's whole width


def inlined_pictures(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """The PNG files of ``names`` in a folder as base64, those that there are."""
    files = {name: folder / f"{name}.png" for name in names}
    return {n: base64.b64encode(f.read_bytes()).decode("ascii") for n, f in files.items() if f.exists()}


def is_long(picture: str) -> bool:
    """Whether a base64 PNG is so much wider than high that half a page is too narrow for it."""
    width, height = struct.unpack(">II", base64.b64decode(picture[:48])[16:24])
    return bool(width > LONG * height)
