"""The cache of finished stages: their keys, and folders that are whole or absent."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import SceneError
from .files import write_json

# -- The cache of finished stages --------------------------------------------------------------------------------------
MANIFEST = "manifest.json"


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


@dataclass(frozen=True)
class Store:
    """Finished stages on disk, ``root/stage/key/``.

    A stage works in ``key.part`` under a lock, so that an interrupted one finds its own unfinished files again; when it
    is done its files are listed with their checksums and the folder takes its final name. A folder whose files do not
    match that list is never used: it is removed and made anew.
    """

    root: Path

    def make(
        self, stage: str, key: str, work: Callable[[Path], None], *, on_wait: Callable[[], None] | None = None
    ) -> tuple[Path, bool]:
        """The folder of a finished stage and whether it was there already; ``work(folder)`` makes it otherwise."""
        from filelock import FileLock, Timeout

        final = self.root / stage / key
        if self._whole(final):
            _note_use(final)
            return final, True
        part = final.with_name(f"{key}.part")
        part.mkdir(parents=True, exist_ok=True)
        lock = FileLock(final.with_name(f"{key}.lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            if on_wait is not None:
                on_wait()
            lock.acquire()
        try:
            if self._whole(final):  # another process finished it while this one waited
                return final, True
            if final.exists():
                shutil.rmtree(final)
            part.mkdir(exist_ok=True)
            work(part)
            write_json(part / MANIFEST, {name: _digest(part / name) for name in _members(part)})
            os.replace(part, final)
        finally:
            lock.release()
        return final, False

    def holds(self, stage: str, key: str) -> bool:
        """Whether a finished stage is there, whole."""
        return self._whole(self.root / stage / key)

    def clean(self, *, everything: bool = False) -> tuple[int, int]:
        """Remove unfinished stages that no process works on (with ``everything`` all stages). Returns the number of
        folders and bytes that were freed.
        """
        from filelock import FileLock, Timeout

        removed = freed = 0
        for folder in sorted(self.root.glob("*/*")):
            if not folder.is_dir() or not (everything or folder.suffix == ".part"):
                continue
            try:
                with FileLock(folder.with_name(f"{folder.stem}.lock"), timeout=0):
                    freed += sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
                    shutil.rmtree(folder)
                    removed += 1
            except Timeout:
                continue
        return removed, freed

    def _whole(self, folder: Path) -> bool:
        try:
            listed = json.loads((folder / MANIFEST).read_text())
            return all(_digest(folder / name) == digest for name, digest in listed.items())
        except (FileNotFoundError, NotADirectoryError, json.JSONDecodeError):
            return False


def _members(folder: Path) -> list[str]:
    """Every file below the folder, except what a killed ``atomic_write`` left behind."""
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != MANIFEST)
    return sorted(p.relative_to(folder).as_posix() for p in files if not (p.name[0] == "." and p.suffix == ".tmp"))


def _note_use(folder: Path) -> None:
    """Note that a stage was used now, which decides what goes first when the cache is cleaned."""
    with suppress(PermissionError):  # a cache that others own and share for reading alone
        os.utime(folder / MANIFEST)


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


# -- What the cache holds ----------------------------------------------------------------------------------------------
SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(B|[kMGT]B?)\s*|\s*0\s*", re.IGNORECASE)  # a bare 10 may mean gigabytes
PREFIX = {"": 1.0, "b": 1.0, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12}


@dataclass(frozen=True)
class KeptStage:
    """A finished stage: what it is, where, ``size`` (bytes) that removing it frees, the ``seconds`` it took, None where
    nobody noted them, and when it was last ``used`` (s since 1970).
    """

    stage: str
    folder: Path
    size: int
    seconds: float | None
    used: float


def kept_stages(root: Path) -> list[KeptStage]:
    """The finished stages below the cache's ``root``, the one that was used longest ago first.

    A file that a run's folder shares (a hard link) counts nothing: it stays on the disk.
    """
    folders = [path.parent for path in root.glob("*/*/manifest.json") if path.parent.suffix != ".part"]
    found = []
    for folder in folders:
        files = [path.stat() for path in folder.rglob("*") if path.is_file()]
        try:
            seconds = float(json.loads((folder / "seconds.json").read_text()))
        except (OSError, ValueError, TypeError):  # nobody noted them, or a damaged disk did
            seconds = None
        manifest = (folder / "manifest.json").stat()
        size = sum(file.st_size for file in files if file.st_nlink == 1)
        found.append(KeptStage(folder.parent.name, folder, size, seconds, manifest.st_mtime))
    return sorted(found, key=lambda one: one.used)


def oldest_beyond(stages: Sequence[KeptStage], keep: float) -> list[KeptStage]:
    """The stages that come first, as many as must go until the others take no more than ``keep`` bytes."""
    total, gone = sum(one.size for one in stages), []
    for one in stages:
        if total <= keep:
            break
        total -= one.size
        gone.append(one)
    return gone


def remove_stages(stages: Sequence[KeptStage]) -> list[KeptStage]:
    """Remove stages; those that were removed. One that a process works on at this moment stays."""
    from filelock import FileLock, Timeout

    removed = []
    for one in stages:
        try:
            with FileLock(one.folder.with_name(f"{one.folder.name}.lock"), timeout=0):
                shutil.rmtree(one.folder)
        except Timeout:
            continue
        removed.append(one)
    return removed


def bytes_of(text: str) -> float:
    """A size such as 10GB or 500 MB in bytes.

    >>> bytes_of("1.5 GB")
    1500000000.0

    Raises SceneError for any other text.
    """
    found = SIZE.fullmatch(text)
    if found is None:
        raise SceneError(f"{text!r} is no size; write it with its unit, as 10GB or 500MB")
    return float(found[1] or 0) * PREFIX[(found[2] or "")[:1].lower()]
