"""TOML files of the user's, as editors on every system save them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from .errors import SceneError
from .quantities import QUANTITY

__all__ = ["read_toml"]


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file, in UTF-8 with or without a mark of the byte order at its head.

    Raises SceneError, one line that says how to mend it, where it is no such text; OSError where it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:  # as half of the bytes of UTF-16 are
        raise SceneError(f"{path}: not UTF-8; save it as UTF-8 in your editor")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise SceneError(f"{path}: not valid TOML: {problem}{_hint(text, str(problem))}") from None


def _hint(text: str, problem: str) -> str:
    """A hint for the line that is not TOML, as ``speed = 7 m/s`` and ``speed = 1,5`` are not; empty where there is
    none. ``problem``: tomllib's message, which tells the line.
    """
    found, lines = re.search(r"at line (\d+)", problem), text.splitlines()
    line = lines[int(found[1]) - 1] if found and int(found[1]) <= len(lines) else ""
    key, sign, value = (part.strip() for part in line.partition("#")[0].partition("="))
    if "Cannot declare" in problem:
        return "; a table stands twice: rename one"
    if sign and re.fullmatch(r"[-+]?\d+,\d+", value):
        return f"; write a decimal point: {key} = {value.replace(',', '.')}"
    if sign and re.fullmatch(QUANTITY, value):
        return f"; put quotes round a value with a unit: {key} = {value!r}"
    return ""
