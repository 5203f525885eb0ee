"""SHA256SUMS: which files of a folder the program wrote, and their checksums. ``sha256sum -c SHA256SUMS`` checks them.

Only files that are listed there are ever replaced or removed, and one that is listed is not read once it has changed.
While the program writes into a folder BEGUN is in it: where that was killed, its files are the program's all the same.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import SceneError
from .files import atomic_write, made_folder, read_whole

SUMS = "SHA256SUMS"
BEGUN = ".begun"
RESULT = "result.json"  # of a run
_THIS = secrets.token_hex(8)  # this process
LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def listed(folder: Path) -> dict[str, str]:
    """The checksums (hex) of what was written into a folder, by path relative to it; empty where none are noted. A path
    that leads out of the folder is none.
    """
    try:
        lines = read_whole(folder / SUMS).decode().splitlines()
    except (OSError, UnicodeDecodeError, SceneError):  # no list: nothing is the program's
        return {}
    found = {match[2]: match[1] for match in map(LINE.fullmatch, lines) if match}
    return {name: digest for name, digest in found.items() if name[0] != "/" and ".." not in Path(name).parts}


def note(folder: Path, files: Iterable[Path], *, anew: bool = True) -> None:
    """Note that the program wrote ``files`` into a folder, beside what is listed and still there; not ``anew``: only
    those that are not listed.
    """
    own = {name: digest for name, digest in listed(folder).items() if (folder / name).is_file()}
    for path in files:
        name = path.relative_to(folder).as_posix()
        if path.is_file() and not path.is_symlink() and (anew or name not in own):
            own[name] = digest_of(path)
    with atomic_write(folder / SUMS) as stream:
        stream.writelines(f"{digest}  {name}\n" for name, digest in sorted(own.items()))


def digest_of(path: Path) -> str:
    """sha256 (hex) of a file's bytes. Raises SceneError for a pipe or a device, which may give none."""
    if path.exists() and not path.is_file():
        raise SceneError(f"{path} is no file; move it, or choose another --out")
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def refuse_foreign(folder: Path, files: Iterable[Path]) -> None:
    """Raise SceneError where one of ``files`` is in a folder and the program did not write it."""
    with suppress(OSError):
        if (folder / BEGUN).read_text() != _THIS:  # of a process that was killed
            return
    own = listed(folder)
    for path in files:
        name = path.relative_to(folder).as_posix()
        if (path.is_symlink() or path.exists()) and name not in own:
            raise SceneError(
                f"--out {folder}: holds {name}, which no run of wakeflow wrote and this one would replace; name "
                "another folder"
            )


def claim(folder: Path, files: Iterable[Path]) -> None:
    """As :func:`refuse_foreign`, for what is added to the folder of a finished run; one of an earlier version has no
    list, and everything in it passes. Raises SceneError too where a link leads out of the folder.
    """
    if (made_folder(folder) / SUMS).exists() or not (folder / RESULT).exists():
        refuse_foreign(folder, files)


@contextmanager
def writing(folder: Path, files: Callable[[], Iterable[Path]]) -> Iterator[None]:
    """While the block runs ``files`` of a folder are written; they are asked for and noted when it has ended. Where it
    ends by an exception, what is listed stays as it is, so that no damage of it is noted. What no run wrote is refused
    before (:func:`refuse_foreign`, :func:`claim`).
    """
    if not (folder / BEGUN).exists():
        (folder / BEGUN).write_text(_THIS)
    try:
        yield
    except BaseException as problem:
        if isinstance(problem, OSError) and problem.filename is None:  # as where the disk is full
            problem.filename = str(folder)
        with suppress(OSError):  # a full disk, say: BEGUN stays
            note(folder, files(), anew=False)
            (folder / BEGUN).unlink(missing_ok=True)
        raise
    note(folder, files())
    (folder / BEGUN).unlink(missing_ok=True)


def refuse_changed(folder: Path, path: Path) -> None:
    """Raise SceneError where a file that people edit is no more as the program wrote it."""
    if path.exists() and listed(folder).get(path.relative_to(folder).as_posix()) != digest_of(path):
        raise SceneError(f"{path} is not as the program wrote it; move it, or choose another --out")


def check(folder: Path, name: str, cure: str) -> None:
    """Raise SceneError, with the ``cure``, where a file has changed since the program wrote it."""
    known = listed(folder).get(name)
    if known is not None and digest_of(folder / name) != known:
        raise SceneError(f"{folder / name} is damaged: its checksum is not that in {SUMS}; {cure}")
