"""What stands on the disk below the folder that the page was opened in: scenes, runs, sweeps."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from pathlib import Path

from ..answer.result import FILE
from ..batch.compute import WIDE
from ..core import sums
from ..core.errors import SceneError
from ..core.files import read_whole

DEEP = 3  # folders below the first that are looked into
MOST = 300  # of a kind that are listed
LARGEST = 100_000_000  # bytes of a sweep's table
HIDDEN = (".", "_")


def listing(root: Path, scenes: Path) -> dict[str, object]:
    """Scene files below the folder ``scenes``, runs and sweeps below ``root``, the newest first."""
    runs, sweeps = [], []
    for folder, files in _folders(root):
        if FILE in files and (folder / FILE).is_file():
            runs.append(_row(root, folder, FILE))
        if WIDE in files and (folder / WIDE).is_file():
            sweeps.append(_row(root, folder, WIDE))
    own = [path for path in sorted(scenes.glob("*.toml")) if not path.name.startswith(".") and path.is_file()]
    found = [_row(scenes, path, "") for path in own]
    return {"scenes": found[:MOST], "runs": _newest(runs), "sweeps": _newest(sweeps)}


def inside(root: Path, name: str) -> Path:
    """The file or folder ``name`` below ``root``, links followed. Raises SceneError where it is not there."""
    base = root.resolve()
    path = (base / name.replace("\0", "?")).resolve()
    if not path.is_relative_to(base) or not path.exists():
        raise SceneError(f"no {name!r} in {root}")
    return path


def points_of(folder: Path) -> dict[str, object]:
    """A sweep's table, a row a scene: what was varied, the numbers with the ends of their intervals, and which scenes
    have a run to open. Raises SceneError where there is no such table.
    """
    file = folder / WIDE
    sums.check(folder, WIDE, "the sweep's command writes it anew")
    try:
        rows = list(csv.DictReader(io.StringIO(read_whole(file, LARGEST).decode(), newline="")))
        runs = [(folder / row["scene"] / FILE).exists() for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise SceneError(f"{file} cannot be read: {problem}") from None
    except (KeyError, TypeError):  # other heads, a row that ends before its scene
        raise SceneError(f"{file} is no table of a sweep; the sweep's command writes it anew") from None
    heads = list(rows[0]) if rows else []
    numbers = [head for head in heads if f"{head}.low" in heads]
    first = next((heads.index(one) for one in numbers), len(heads))
    inputs = [head for head in heads[:first] if head not in ("scene", "state", "reason")]
    return {
        "inputs": inputs,
        "numbers": numbers,
        "rows": [row | {"run": run} for row, run in zip(rows, runs, strict=True)],
    }


def _folders(root: Path) -> Iterator[tuple[Path, list[str]]]:
    for place, inner, files in os.walk(root):
        folder = Path(place)
        deep = len(folder.relative_to(root).parts) >= DEEP
        inner[:] = [] if deep else sorted(one for one in inner if not one.startswith(HIDDEN))
        yield folder, files


def _row(root: Path, path: Path, file: str) -> dict[str, object]:
    return {"name": path.relative_to(root).as_posix(), "made": (path / file).stat().st_mtime}


def _newest(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    return sorted(rows, key=lambda row: -float(str(row["made"])))[:MOST]
