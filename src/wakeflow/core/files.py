"""Files: whole or absent, shown elsewhere by links, TOML of the user's, and those that are shipped with the code."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from .errors import SceneError
from .quantities import QUANTITY

# -- Files that are whole or absent ------------------------------------------------------------------------------------
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


# -- Files of the cache shown elsewhere without a second copy on the disk ----------------------------------------------
CANNOT = (errno.EXDEV, errno.EPERM, errno.EMLINK, errno.ENOTSUP, errno.EACCES)  # another disk, or one without links


def link_or_copy(source: Path, target: Path) -> None:
    """Show the file ``source`` as ``target`` too: a hard link, or a copy where the file system has none.

    ``target`` appears whole and replaces what stood there. The two are one file afterwards: replace it, as every writer
    of this package does, and do not change it in place.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = target.with_name(f".{target.name}.tmp")
    draft.unlink(missing_ok=True)
    try:
        try:
            os.link(source, draft)
        except OSError as problem:
            if problem.errno not in CANNOT:
                raise
            shutil.copyfile(source, draft)
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)


# -- TOML files of the user's ------------------------------------------------------------------------------------------
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
    return toml_in(text, path)


def toml_in(text: str, path: Path) -> dict[str, Any]:
    """The tables of the ``text`` of a TOML file. Raises SceneError, one line that says how to mend it."""
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


# -- Files that are shipped beside the code ----------------------------------------------------------------------------
def _cases() -> Path:
    """``cases`` of the repository in an editable install, the copy inside the package in a wheel."""
    inside = Path(__file__).parents[1] / "cases"
    return inside if inside.is_dir() else Path(__file__).parents[3] / "cases"


def scene_templates() -> dict[str, Path]:
    """The shipped scenes by name; files that ask for many scenes of one are none."""
    files = sorted(_cases().glob("*.toml"))
    return {path.stem: path for path in files if not {"sweep", "search"} & tomllib.loads(path.read_text()).keys()}


def case_template() -> Path:
    """The OpenFOAM case that every airflow starts from."""
    return _cases() / "template"
