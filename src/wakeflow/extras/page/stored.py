"""What stands on the disk below the folder that the page was opened in: scenes, runs, sweeps."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

from ...answer.result import FILE
from ...core import own_files
from ...core.errors import SceneError
from ...core.files import read_whole
from ...core.quantities import say, speaking
from ...core.record import JsonTable
from ...many.agenda import AIRFLOWS
from ...many.compute import TABLE, WIDE
from ...many.variant import holds_task
from ...scene.changes import PARTS, flat
from ...scene.messages import unit_of
from ...show.plan_words import UNITS

DEEP = 3  # folders below the first that are looked into
MOST = 300  # of a kind that are listed
LARGEST = 100_000_000  # bytes of a sweep's table, or of a result
TOLD = 3  # keys that a run is said to differ in
OF_A_NAME = ("body", "bin", "fraction")  # tables whose members have names of the user's
HIDDEN = (".", "_")
Row = dict[str, object]


def listing(root: Path, scenes: Path) -> dict[str, list[Row]]:
    """Scene files below the folder ``scenes``, runs and sweeps below ``root``, the newest first."""
    runs, sweeps = runs_below(root)
    files = [path for path in sorted(scenes.glob("*.toml")) if not path.name.startswith(".") and path.is_file()][:MOST]
    searches = [path for path in files if _asks_for_a_search(path)]
    plain = [_row(scenes, path, "") for path in files if path not in searches]
    return {
        "scenes": plain,
        "searches": [_row(scenes, path, "") for path in searches],
        "runs": runs,
        "sweeps": sweeps,
    }


def runs_below(root: Path) -> tuple[list[Row], list[Row]]:
    """Runs and sweeps below the folder ``root``, the newest first; each run with what a person calls it, and in what it
    differs from the run before.
    """
    finished, sweeps = list[Row](), list[Row]()
    for folder, files in _folders(root):
        if FILE in files and (folder / FILE).is_file():
            finished.append(_row(root, folder, FILE))
        if WIDE in files and (folder / WIDE).is_file():
            sweeps.append(_row(root, folder, WIDE))
    runs = _newest(finished)
    scenes_of = [scene_of(root / str(row["name"])) for row in runs]
    for row, scene in zip(runs, scenes_of, strict=True):
        row["title"] = title_of(str(row["name"]), scene)
    for (row, now), (_, before) in pairwise(zip(runs, scenes_of, strict=True)):
        row["differs"] = differs(before, now)
    return runs, _newest(sweeps)


def _asks_for_a_search(path: Path) -> bool:
    try:
        return holds_task(path, "search")
    except (SceneError, OSError):  # no TOML yet: a scene under work, which says so where it is opened
        return False


def scene_of(folder: Path) -> JsonTable:
    """The keys of a finished run's scene, dotted, with their values (SI); none where its result cannot be read, which
    is said where the run is opened.
    """
    file = folder / FILE
    return _scene_in(file, file.stat().st_mtime_ns)


def parts_of(scene: JsonTable) -> set[tuple[str, ...]]:
    """The fractions and bins of a scene, which runs share that are read next to each other."""
    return {tuple(key.split(".")[:2]) for key in scene if key.startswith(("fraction.", "bin."))}


@lru_cache(MOST)
def _scene_in(file: Path, _: int) -> JsonTable:
    try:
        scene = json.loads(read_whole(file, LARGEST))["scene"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return flat(scene) if isinstance(scene, dict) else {}


def title_of(name: str, scene: JsonTable) -> str:
    """A name that a person reads, of a run's folder: what was changed in its scene, in the units of reports.

    >>> title_of("sharp+air.speed=4.79938802216", {"air.speed": 4.79938802216})
    'sharp: air speed 4.799 m/s'
    """
    place, _, last = name.rpartition("/")
    parts = [part.partition("=") for part in last.split(PARTS)]
    names = [key for key, sign, _ in parts if not sign]
    changed = said({key: value for key, sign, value in parts if sign}, scene)
    return ": ".join(filter(None, ("/".join(filter(None, (place, PARTS.join(names)))), changed)))


def said(changes: Mapping[str, object], scene: JsonTable) -> str:
    """What ``changes`` made of a scene as a person says it, with the values that its flat tables (SI) hold."""
    return ", ".join(
        f"{_key(key)} {_value(key, scene[key]) if key in scene else value}" for key, value in changes.items()
    )


def differs(before: JsonTable, now: JsonTable) -> str:
    """What differs in a run's scene from another: a few keys with both values, and how many more."""
    keys = [key for key in dict.fromkeys([*now, *before]) if before.get(key) != now.get(key)]
    changes = [f"{_key(key)} {_value(key, before.get(key))} → {_value(key, now.get(key))}" for key in keys[:TOLD]]
    return ", ".join(changes) + (f" and {len(keys) - TOLD} more" if len(keys) > TOLD else "")


def _key(key: str) -> str:
    """A dotted key in words: ``body.prism.slope_angle`` is "prism slope angle"."""
    first, _, rest = key.partition(".")
    return (rest if first in OF_A_NAME else key).replace(".", " ").replace("_", " ")


def _value(key: str, value: object) -> str:
    if value is None:
        return "–"
    with speaking(UNITS):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return say(float(str(value)), unit_of(key), 4).strip() if number else str(value)


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
    own_files.check(folder, WIDE, "the sweep's command writes it anew")
    try:
        rows = list(csv.DictReader(io.StringIO(read_whole(file, LARGEST).decode(), newline="")))
        runs = [(folder / row["scene"] / FILE).exists() for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise SceneError(f"{file} cannot be read: {problem}") from None
    except (KeyError, TypeError):  # other heads, a row that ends before its scene
        raise SceneError(f"{file} is no table of a sweep; the sweep's command writes it anew") from None
    heads = list(rows[0]) if rows else []
    numbers = [head for head in heads if f"{head}.low" in heads]
    first = next((heads.index(head) for head in numbers), len(heads))
    inputs = [head for head in heads[:first] if head not in ("scene", "state", "reason")]
    return {
        "inputs": inputs,
        "numbers": numbers,
        "figures": sorted(picture.name for picture in (folder / "figures").glob("*.png")),
        "rows": [row | {"run": run} for row, run in zip(rows, runs, strict=True)],
    }


def _folders(root: Path) -> Iterator[tuple[Path, list[str]]]:
    """The folders below a first one, not those within a run or a sweep, unless that is the first."""
    for place, inner, files in os.walk(root):
        folder = Path(place)
        whole = {FILE, TABLE, WIDE}.intersection(files) or AIRFLOWS in inner
        last = len(folder.relative_to(root).parts) >= DEEP or (whole and folder != root)
        inner[:] = [] if last else sorted(name for name in inner if not name.startswith(HIDDEN) and name != AIRFLOWS)
        yield folder, files


def _row(root: Path, path: Path, file: str) -> Row:
    return {"name": path.relative_to(root).as_posix(), "made": (path / file).stat().st_mtime}


def _newest(rows: list[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: -float(str(row["made"])))[:MOST]
