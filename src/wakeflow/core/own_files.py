"""SHA256SUMS: which files of a folder the program wrote, and their checksums. ``sha256sum -c SHA256SUMS`` checks them.

Only files that are listed there are ever replaced or removed, and one that is listed is not read once it has changed.
While a command writes into a folder a file that begins with BEGUN and bears the command's name is in it: where that was
killed, the files of this command, and no others, are the program's all the same.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import SceneError
from .files import atomic_write, digest_of, made_folder, read_whole

SUMS = "SHA256SUMS"
MARK = "# written by wakeflow"  # the first line; sha256sum skips it. One of a user's own has none
BEGUN = ".begun-"
RESULT = "result.json"  # of a run
LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def listed(folder: Path) -> dict[str, str]:
    """The checksums (hex) of what was written into a folder, by path relative to it; empty where none are noted. A path
    that leads out of the folder is none.
    """
    result = {match[2]: match[1] for match in map(LINE.fullmatch, _lines(folder)) if match}
    return {name: digest for name, digest in result.items() if name[0] != "/" and ".." not in Path(name).parts}


def _lines(folder: Path) -> list[str]:
    """The lines of the program's list, MARK the first; none where there is no list, or one of others."""
    try:
        lines = read_whole(folder / SUMS).decode().splitlines()
    except (OSError, UnicodeDecodeError, SceneError):
        return []
    return lines if lines[:1] == [MARK] else []


def note(folder: Path, files: Iterable[Path], *, anew: bool = True) -> None:
    """Note that the program wrote ``files`` into a folder, beside what is listed and still there; not ``anew``: only
    those that are not listed.
    """
    with _one_at_a_time(folder):
        sums = {name: digest for name, digest in listed(folder).items() if (folder / name).is_file()}
        for path in files:
            name = path.relative_to(folder).as_posix()
            if path.is_file() and not path.is_symlink() and (anew or name not in sums):
                sums[name] = digest_of(path)
        with atomic_write(folder / SUMS) as stream:
            stream.writelines([f"{MARK}\n", *(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))])


@contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Keep other processes out of such a block for this folder, where the file system can lock."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def refuse_foreign(folder: Path, files: Iterable[Path], command: str) -> None:
    """Raise SceneError where one of the ``files`` of a ``command`` is in a folder and the program did not write it."""
    sums = listed(folder)
    held = [
        name for path in files if os.path.lexists(path) and (name := path.relative_to(folder).as_posix()) not in sums
    ]
    if (folder / f"{BEGUN}{command}").exists():  # it was killed
        held = []
    if os.path.lexists(folder / SUMS) and not _lines(folder):
        held = [SUMS]
    if held:
        raise SceneError(
            f"--out {folder}: holds {held[0]}, which no run of wakeflow wrote and this one would replace; name "
            "another folder"
        )


def claim(folder: Path, files: Iterable[Path], command: str) -> None:
    """Refuse files as :func:`refuse_foreign`, for what is added to the folder of a finished run; one of an earlier
    version has no list, and everything in it passes. Raises SceneError too where a link leads out of the folder.
    """
    if (made_folder(folder) / SUMS).exists() or not (folder / RESULT).exists():
        refuse_foreign(folder, files, command)


@contextmanager
def writing(folder: Path, files: Callable[[], Iterable[Path]], command: str) -> Iterator[None]:
    """Note ``files`` of a folder that a ``command`` writes in the block; they are asked for and noted when it has
    ended. Where it ends by an exception, what is listed stays as it is, so that no damage of it is noted. What no run
    wrote is refused before (:func:`refuse_foreign`, :func:`claim`).
    """
    begun = folder / f"{BEGUN}{command}"
    _append(begun, "")
    try:
        yield
    except BaseException as problem:
        if isinstance(problem, OSError) and problem.filename is None:  # as where the disk is full
            problem.filename = str(folder)
        with suppress(OSError):  # a full disk, say: it stays begun
            note(folder, files(), anew=False)
            begun.unlink(missing_ok=True)
        raise
    note(folder, files())
    begun.unlink(missing_ok=True)


@contextmanager
def replacing(path: Path, command: str) -> Iterator[Path]:
    """A draft of a file that people edit: it takes the name ``path`` when the block has ended. A ``command`` that is
    killed before it has noted the file has not changed it.
    """
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        yield draft
        _append(path.with_name(f"{BEGUN}{command}"), f"{digest_of(draft)}  {path.name}\n")
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def _append(path: Path, text: str) -> None:
    """Add to a file, which is made where there is none, but not through a link."""
    handle = os.open(path, os.O_CREAT | os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    with os.fdopen(handle, "a", encoding="utf-8") as stream:
        stream.write(text)


def refuse_changed(path: Path, command: str) -> None:
    """Raise SceneError where a file that people edit is no more as a ``command`` wrote it."""
    if not os.path.lexists(path):
        return
    known = [listed(path.parent).get(path.name, "")]
    with suppress(OSError):  # as a killed one was about to write it
        known += (path.with_name(f"{BEGUN}{command}")).read_text(errors="replace").split()
    if not path.exists() or digest_of(path) not in known:
        raise SceneError(f"{path} is not as the program wrote it; move it, or choose another --out")


def check(folder: Path, name: str, cure: str) -> None:
    """Raise SceneError, with the ``cure``, where a file has changed since the program wrote it."""
    known = listed(folder).get(name)
    if known is not None and digest_of(folder / name) != known:
        raise SceneError(f"{folder / name} is damaged: its checksum is not that in {SUMS}; {cure}")
