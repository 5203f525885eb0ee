"""What the cache holds: what each stage takes on disk and would take to make again, and removal of the oldest."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import SceneError

__all__ = ["KeptStage", "bytes_of", "kept_stages", "oldest_beyond", "remove_stages"]

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
