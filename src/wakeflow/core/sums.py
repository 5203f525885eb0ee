"""SHA256SUMS: which files of a folder the program wrote, and their checksums. ``sha256sum -c SHA256SUMS`` checks them.

Only files that are listed there are ever replaced or removed, and one that is listed is not read once it has changed.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

from .errors import SceneError
from .files import atomic_write, made_folder, read_whole

SUMS = "SHA256SUMS"
LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def listed(folder: Path) -> dict[str, str]:
    """The checksums (hex) of what was written into a folder, by path relative to it; empty where none are noted."""
    try:
        lines = read_whole(folder / SUMS).decode().splitlines()
    except (OSError, UnicodeDecodeError, SceneError):  # no list: nothing is the program's
        return {}
    return {found[2]: found[1] for found in map(LINE.fullmatch, lines) if found}


def note(folder: Path, files: Iterable[Path]) -> None:
    """Note that the program wrote ``files`` into a folder, beside what is listed and still there. What is in a folder
    among them counts with everything below it.
    """
    own = {name: digest for name, digest in listed(folder).items() if (folder / name).is_file()}
    for path in files:
        for member in path.rglob("*") if path.is_dir() and not path.is_symlink() else (path,):
            if member.is_file() and not member.is_symlink():
                own[member.relative_to(folder).as_posix()] = digest_of(member)
    with atomic_write(folder / SUMS) as stream:
        stream.writelines(f"{digest}  {name}\n" for name, digest in sorted(own.items()))


def digest_of(path: Path) -> str:
    """sha256 (hex) of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def refuse_foreign(folder: Path, files: Iterable[Path]) -> None:
    """Raise SceneError where one of ``files`` is in a folder and the program did not write it."""
    own = listed(folder)
    for path in files:
        name = path.relative_to(folder).as_posix()
        if (path.is_symlink() or path.exists()) and name not in own and not any(n.startswith(f"{name}/") for n in own):
            raise SceneError(
                f"--out {folder}: holds {name}, which no run of wakeflow wrote and this one would replace; name "
                "another folder"
            )


def claim(folder: Path, files: Iterable[Path]) -> None:
    """As :func:`refuse_foreign`, for what is added to the folder of a finished run; one of an earlier version has no
    list, and everything in it passes. Raises SceneError too where a link leads out of the folder.
    """
    if (made_folder(folder) / SUMS).exists():
        refuse_foreign(folder, files)


def check(folder: Path, name: str, cure: str) -> None:
    """Raise SceneError, with the ``cure``, where a file has changed since the program wrote it."""
    known = listed(folder).get(name)
    if known is not None and digest_of(folder / name) != known:
        raise SceneError(f"{folder / name} is damaged: its checksum is not that in {SUMS}; {cure}")
