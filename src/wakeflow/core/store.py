"""The cache of finished stages: their keys, and folders that are whole or absent."""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import SceneError
from .files import atomic_write, digest_of, read_json, read_whole, user_secret, write_json
from .process import check_cancelled, is_worked_in, wait_for_orphans

if TYPE_CHECKING:
    from filelock import BaseFileLock

# -- The cache of finished stages --------------------------------------------------------------------------------------
MANIFEST = "manifest.json"
BEGUN = ".begun"  # in the folder of a stage that is worked on: its seal
DIGEST = re.compile(r"[0-9a-f]{64}")
PATIENCE = 0.5  # s of waiting for another process between looks at whether this one's work is still wanted


def cache_root() -> Path:
    """Where finished stages are kept: ``$WAKEFLOW_CACHE``, else ``runs/.cache`` below the current folder."""
    return Path(os.environ.get("WAKEFLOW_CACHE") or Path("runs", ".cache")).absolute()


def content_key(*parts: Any) -> str:
    """sha256 (hex) of JSON-able parts; equal for equal contents, whatever the order of keys."""
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def digest_files(paths: Iterable[Path]) -> str:
    """sha256 (hex) over names and contents of files; folders count with everything below them."""
    total = hashlib.sha256()
    for path in paths:
        members = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for member in members:
            if "__pycache__" in member.parts:
                continue
            name = member.relative_to(path).as_posix() if path.is_dir() else member.name
            total.update(name.encode() + b"\0" + hashlib.sha256(member.read_bytes()).digest())
    return total.hexdigest()


# -- What is the cache's own -------------------------------------------------------------------------------------------
TAG = "CACHEDIR.TAG"  # bford.info/cachedir: programs for backups leave such folders out
MARK = (
    "Signature: 8a477f597d28d172789f06886806bc55\n"
    "# This folder is a cache of wakeflow. Where this file is, wakeflow clean may remove finished stages.\n"
)
USERS = ".users"  # locked, with others, by all who read finished stages; alone by who removes them
OWN = re.compile(r"CACHEDIR\.TAG|\.users|machine-rates\.json|numba|(compile-.*\.|\.)lock|log\..*")  # beside the stages
OF_STAGE = re.compile(r"(CACHEDIR\.TAG|[0-9a-f]{64}(\.part|\.lock)?)")  # all that is in the folder of a stage


def is_marked(folder: Path) -> bool:
    """Whether the store has marked a folder as its own: the cache, or all there is of one stage."""
    tag = folder / TAG
    with suppress(OSError, UnicodeDecodeError):
        return not folder.is_symlink() and not tag.is_symlink() and tag.read_text()[: len(MARK)] == MARK
    return False


def mark(root: Path, stage: str) -> None:
    """Mark the cache, and the folder of a stage in it, as the store's own where they are new or empty. A folder that
    other things are in stays without a mark, and is never cleaned.
    """
    folder = root / stage
    folder.mkdir(parents=True, exist_ok=True)
    if _adopt(root) and not any(folder.iterdir()):
        _write_mark(folder)


def _adopt(root: Path) -> bool:
    """Whether the cache has its mark: one of an earlier version, with nothing else in it, gets it here."""
    if is_marked(root):
        return True
    if aliens_in(root) or not os.access(root, os.W_OK):
        return False
    for folder in [path for path in root.iterdir() if path.is_dir() and not OWN.fullmatch(path.name)]:
        _write_mark(folder)
    _write_mark(root)
    return True


def _write_mark(folder: Path) -> None:
    with atomic_write(folder / TAG) as stream:
        stream.write(MARK)


def aliens_in(root: Path) -> list[Path]:
    """What is in the cache's folder that the store does not write."""
    paths = [path for path in sorted(root.iterdir()) if not OWN.fullmatch(path.name)]
    return [path for path in paths if path.is_symlink() or not path.is_dir() or any(map(_is_alien, path.iterdir()))]


def _is_alien(path: Path) -> bool:
    """Whether a path in the folder of a stage is none that the store writes."""
    return path.is_symlink() or not OF_STAGE.fullmatch(path.name)


def stage_folders(root: Path) -> list[Path]:
    """The folders of stages in the cache, finished ones and unfinished ones (.part), that its marks vouch for; those of
    other names, and what a link leads to, are nobody's here.

    Raises SceneError where the cache itself has no mark.
    """
    if not root.is_dir():
        return []
    if not _adopt(root):
        alien = next(iter(aliens_in(root)), root).name
        raise SceneError(
            f"{root}: has no mark of wakeflow's cache ({TAG}) and holds {alien}, which is not the cache's; nothing is "
            "removed there; give the cache a folder of its own: WAKEFLOW_CACHE"
        )
    stages = [folder for folder in sorted(root.iterdir()) if folder.is_dir() and is_marked(folder)]
    return [path for stage in stages for path in sorted(stage.iterdir()) if _is_stage(path)]


def _is_stage(path: Path) -> bool:
    if path.is_symlink() or not path.is_dir() or not DIGEST.fullmatch(path.name.removesuffix(".part")):
        return False
    return path.suffix == ".part" or bool(listed_in(path))


def listed_in(folder: Path) -> Mapping[str, str]:
    """The files of a stage and their checksums, as its manifest has them; empty where it has none that can be used."""
    try:
        table = read_json(folder / MANIFEST)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, SceneError):
        return {}
    usable = isinstance(table, dict) and all(isinstance(key, str) and DIGEST.fullmatch(key) for key in table.values())
    return table if usable else {}


@contextmanager
def cache_in_use(root: Path, *, alone: bool = False) -> Iterator[bool]:
    """Keep others from removing finished stages of the cache while the block runs; or ``alone``: from reading any, and
    yield whether that is so; the block runs either way.
    """
    root.mkdir(parents=True, exist_ok=True)
    handle = -1
    # For reading where others own the cache and share it for reading alone: their cleaning waits for us too
    for way in [os.O_RDWR | os.O_CREAT] if alone else [os.O_RDWR | os.O_CREAT, os.O_RDONLY]:
        with suppress(OSError):
            handle = os.open(root / USERS, way | os.O_CLOEXEC, 0o666)
            break
    if handle < 0:  # that cannot be, or the cache is theirs and we would clean it
        yield not alone
        return
    try:
        yield _used(handle, alone)
    finally:
        os.close(handle)


def _used(handle: int, alone: bool) -> bool:
    """Lock the open file; whether nobody else removes stages now, or ``alone``: uses them."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB if alone else fcntl.LOCK_SH)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks: nobody knows who else reads
        return not alone
    return True


@dataclass(frozen=True)
class Store:
    """Finished stages on disk, ``root/stage/key/``.

    A stage works in ``key.part`` under a lock, so that an interrupted one finds its own unfinished files again; when it
    is done its files are listed with their checksums and the folder takes its final name. A folder whose files do not
    match that list is never used: it is removed and made anew. So is a ``key.part`` that this user has not begun: one
    that came with a cache from others may hold what outside programs would run.
    """

    root: Path

    def make(
        self, stage: str, key: str, work: Callable[[Path], None], *, on_wait: Callable[[], None] = lambda: None
    ) -> tuple[Path, bool]:
        """The folder of a finished stage and whether it was there already; ``work(folder)`` makes it otherwise."""
        from filelock import FileLock, Timeout

        final = self.root / stage / key
        if self._whole(final):
            with suppress(PermissionError):  # a cache that others own and share for reading alone
                os.utime(final / MANIFEST)  # the stage that was used longest ago goes first when the cache is cleaned
            return final, True
        mark(self.root, stage)
        part = final.with_name(f"{key}.part")
        lock = FileLock(final.with_name(f"{key}.lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            on_wait()
            _wait_for(lock)
        try:
            if self._whole(final):  # another process finished it while this one waited
                return final, True
            _remove(final)
            if not part.is_symlink():  # what a link leads to is not the cache's
                wait_for_orphans(part)
            if not _is_begun_here(part):
                _remove(part)
                part.mkdir()
                with atomic_write(part / BEGUN, "wb") as stream:
                    stream.write(_seal(part))
            work(part)
            write_json(part / MANIFEST, {name: digest_of(part / name) for name in _members(part)})
            (part / BEGUN).unlink()
            os.replace(part, final)
        finally:
            lock.release()
        return final, False

    def holds(self, stage: str, key: str) -> bool:
        """Whether a finished stage is there, whole."""
        return self._whole(self.root / stage / key)

    def _whole(self, folder: Path) -> bool:
        listed = listed_in(folder)
        try:
            return bool(listed) and _members(folder) == sorted(listed) and all(
                digest_of(folder / name) == digest for name, digest in listed.items()
            )  # fmt: skip
        except (FileNotFoundError, NotADirectoryError):  # removed meanwhile
            return False


class NotFinished(Exception):
    """A stage that is asked for is not in the cache."""


class FinishedStages(Store):
    """What is finished in the cache, and nothing else: whatever is not there is not made."""

    def make(
        self, stage: str, key: str, work: Callable[[Path], None], *, on_wait: Callable[[], None] = lambda: None
    ) -> tuple[Path, bool]:
        """The folder of a finished stage, and True. Raises NotFinished for one that is not there."""
        del work, on_wait
        if not self.holds(stage, key):
            raise NotFinished(stage)
        return self.root / stage / key, True


def _wait_for(lock: BaseFileLock) -> None:
    """Take the lock as soon as the other process lets go of it; ends with this thread's work."""
    from filelock import Timeout

    while True:
        check_cancelled()
        with suppress(Timeout):
            lock.acquire(timeout=PATIENCE)
            return


def _is_begun_here(part: Path) -> bool:
    """Whether this user has begun the stage that works in a folder."""
    with suppress(OSError, SceneError):
        return not part.is_symlink() and read_whole(part / BEGUN) == _seal(part)
    return False


def _seal(part: Path) -> bytes:
    """What only this user can write, for a stage in this folder: in a copy of it another would belong."""
    return hmac.digest(user_secret(), f"{part.name} {part.stat().st_ino}".encode(), "sha256")


def _remove(folder: Path) -> None:
    """Remove what is at the place of a stage's folder, a link itself and not what it leads to."""
    if folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder)
    else:
        folder.unlink(missing_ok=True)


def _members(folder: Path) -> list[str]:
    """Every file below the folder, except what a killed ``atomic_write`` left behind."""
    files = (p for p in folder.rglob("*") if p.is_file() and p.name not in (MANIFEST, BEGUN))
    return sorted(p.relative_to(folder).as_posix() for p in files if not (p.name[0] == "." and p.suffix == ".tmp"))


# -- What the cache holds ----------------------------------------------------------------------------------------------
SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(B|[kMGT]B?)\s*|\s*0\s*", re.IGNORECASE)  # a bare 10 may mean gigabytes
PREFIX = {"": 1.0, "b": 1.0, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}


@dataclass(frozen=True)
class KeptStage:
    """A stage in the cache: what it is, where, ``size`` (bytes) that removing it frees, the ``seconds`` it took, None
    where nobody noted them, and when it was last ``used`` (s since 1970); ``finished``, or left by an interrupted run.
    """

    stage: str
    folder: Path
    size: int
    seconds: float | None
    used: float
    finished: bool = True


def kept_stages(root: Path) -> list[KeptStage]:
    """The stages below the cache's ``root``, unfinished ones first, then the one that was used longest ago.

    A file that a run's folder shares (a hard link) counts nothing: it stays on the disk. Raises SceneError where the
    folder is not the cache's own.
    """
    result = []
    for folder in stage_folders(root):
        with suppress(FileNotFoundError):  # a run that ends at this moment gives it its final name
            result.append(_kept(folder))
    return sorted(result, key=lambda stage: (stage.finished, stage.used))


def _kept(folder: Path) -> KeptStage:
    files = [path.lstat() for path in folder.rglob("*") if path.is_file() or path.is_symlink()]
    finished = folder.suffix != ".part"
    try:
        seconds = float(read_json(folder / "seconds.json"))
    except (OSError, ValueError, TypeError):  # nobody noted them, or a damaged disk did
        seconds = None
    size = sum(file.st_size for file in files if file.st_nlink == 1)
    used = (folder / MANIFEST if finished else folder).stat().st_mtime
    return KeptStage(folder.parent.name, folder, size, seconds, used, finished)


def oldest_beyond(stages: Sequence[KeptStage], keep: float) -> list[KeptStage]:
    """The stages that come first, as many as must go until the others take no more than ``keep`` bytes."""
    total, gone = sum(item.size for item in stages), []
    for item in stages:
        if total <= keep:
            break
        total -= item.size
        gone.append(item)
    return gone


def remove_stages(root: Path, stages: Sequence[KeptStage]) -> list[KeptStage]:
    """Remove stages of the cache's ``root``; those that were removed. One that a process works on at this moment stays,
    a killed run's solver too, and while a run reads the cache every finished one.
    """
    from filelock import FileLock, Timeout

    removed: list[KeptStage] = []
    if not stages:
        return removed
    with cache_in_use(root, alone=True) as alone:
        for item in stages:
            if item.finished and not alone:
                continue
            try:
                with FileLock(item.folder.with_name(f"{item.folder.name.removesuffix('.part')}.lock"), timeout=0):
                    if is_worked_in(item.folder):
                        continue
                    _remove(item.folder)
            except Timeout:
                continue
            removed.append(item)
    return removed


def bytes_of(text: str) -> float:
    """A size such as 10GB or 500 MB in bytes.

    >>> bytes_of("1.5 GB")
    1500000000.0

    Raises SceneError for any other text.
    """
    match = SIZE.fullmatch(text)
    if match is None:
        raise SceneError(f"{text!r} is no size; write it with its unit, as 10GB or 500MB")
    return float(match[1] or 0) * PREFIX[(match[2] or "")[:1].lower()]
