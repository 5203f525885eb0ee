"""The cache of finished stages: their keys, and folders that are whole or absent."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .files import write_json

__all__ = ["Store", "cache_root", "content_key", "digest_files"]

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
