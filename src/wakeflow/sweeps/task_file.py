"""Files that ask for many scenes: one table, [sweep] or [search], which names the scene file that it changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import SceneError
from ..core.files import path_of
from ..core.registry import did_you_mean
from ..core.toml import read_toml

__all__ = ["TaskFile", "holds_task"]


@dataclass(frozen=True)
class TaskFile:
    """The ``table`` called ``kind`` of the file at ``path``, which holds nothing beside it."""

    path: Path
    kind: str
    table: Mapping[str, Any]

    @classmethod
    @contextmanager
    def open(cls, path: Path | str, kind: str, known: Sequence[str]) -> Iterator[TaskFile]:
        """The file's table, whose keys are all ``known``. Raises SceneError where it is none; what is raised within
        names the file.
        """
        path = path_of(path, f"{kind} file")
        whole = _read(path)
        if not isinstance(whole.get(kind), Mapping):
            raise SceneError(f"{path}: has no [{kind}] table, so it is no {kind} file")
        if len(whole) > 1:
            raise SceneError(f"{path}: a {kind} file holds [{kind}] only; keys of the scene belong into [{kind}.set]")
        try:
            if unknown := [key for key in whole[kind] if key not in known]:
                raise SceneError(
                    f"{kind}.{unknown[0]}: unknown key{did_you_mean(unknown[0], list(known))} "
                    f"(known: {', '.join(known)})"
                )
            yield cls(path, kind, whole[kind])
        except SceneError as problem:
            raise SceneError(f"{path}: {problem}") from None

    @property
    def scene(self) -> Path:
        """The scene file to change. Raises SceneError where none is named."""
        name = self.table.get("scene")
        if not isinstance(name, str):
            raise SceneError(f"{self.kind}.scene is missing: name the scene file to change, relative to this one")
        return self.path.parent / name

    def inside(self, key: str) -> Mapping[str, Any]:
        """The table ``key`` of the table; empty where there is none. Raises SceneError where it is something else."""
        found = self.table.get(key, {})
        if not isinstance(found, Mapping):
            raise SceneError(f"{self.kind}.{key} = {found!r}: must be a table")
        return found

    def whole_number(self, key: str, least: int = 0) -> int | None:
        """The number ``key``; None where none is given. Raises SceneError where it is not whole or below ``least``."""
        found = self.table.get(key)
        if found is not None and (not isinstance(found, int) or isinstance(found, bool) or found < least):
            raise SceneError(f"{self.kind}.{key} = {found!r}: give a whole number of at least {least}")
        return found


def holds_task(path: Path | str, kind: str) -> bool:
    """Whether a TOML file has a table ``kind``; a scene has not. Raises SceneError where it is no TOML file."""
    return kind in _read(Path(path))


def _read(path: Path) -> Mapping[str, Any]:
    try:
        return read_toml(path)
    except (FileNotFoundError, IsADirectoryError):
        raise SceneError(f"no file {str(path)!r}") from None
