"""Files that are whole or absent: atomic writes."""

from __future__ import annotations

import errno
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from .errors import SceneError

__all__ = ["atomic_write", "made_folder", "path_of", "write_json"]

FULL = errno.ENOSPC, errno.EDQUOT


def path_of(given: Path | str, name: str) -> Path:
    """What a caller gives as a path. Raises SceneError, by its ``name``, where it is none."""
    if not isinstance(given, str | os.PathLike):
        raise SceneError(f"{name} = {given!r}: needs a path, not {type(given).__name__}")
    return Path(given)


def made_folder(folder: Path) -> Path:
    """The folder for results, made where it is not there. Raises SceneError where it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        if problem.errno in FULL:  # no mistake of the caller's
            raise
        raise SceneError(f"{folder}: cannot be made, {problem.strerror}; choose another --out") from None
    return folder


@contextmanager
def atomic_write(path: Path | str, mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary neighbour of ``path`` for writing; it takes the name ``path`` only when all went well."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(handle, mode, encoding=None if "b" in mode else "utf-8") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_json(path: Path | str, value: Any) -> None:
    """Write ``value`` as indented JSON. Raises ValueError for NaN and infinity: JSON has neither."""
    with atomic_write(path) as stream:
        json.dump(value, stream, indent=2, allow_nan=False)
        stream.write("\n")
