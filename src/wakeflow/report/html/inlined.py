"""Pictures inside a page: PNG files as base64."""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterable
from pathlib import Path

__all__ = ["inlined_pictures", "shape_of"]

LONG = 1.75  # width over height of a picture that takes the page's whole width
TALL = 0.8  # of one that takes a sheet's whole height


def inlined_pictures(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """The PNG files of ``names`` in a folder as base64, those that there are."""
    files = {name: folder / f"{name}.png" for name in names}
    return {n: base64.b64encode(f.read_bytes()).decode("ascii") for n, f in files.items() if f.exists()}


def shape_of(picture: str) -> str:
    """What a base64 PNG is on a page: "long" where half of its width is too narrow for it, "tall", or neither."""
    width, height = struct.unpack(">II", base64.b64decode(picture[:48])[16:24])
    return "long" if width > LONG * height else "tall" if width < TALL * height else ""
