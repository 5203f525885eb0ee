"""A file of measured vibration: CSV with the columns time (s) and acceleration (m/s2), read as text."""

from __future__ import annotations

import csv
from pathlib import Path

from ..core.errors import SceneError

__all__ = ["read_samples"]


def read_samples(given: str, base: Path) -> dict[str, list[float]]:
    """Times (s) and accelerations (m/s2) of a CSV file, its path relative to ``base``: two numbers a line, separated by
    commas, semicolons or tabs; lines before the first number and lines that begin with # are headings.

    Raises SceneError for a file that cannot be read, and for a line that is not two numbers, naming it.
    """
    path = base / Path(given).expanduser()
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        why = problem.strerror if isinstance(problem, OSError) else "not a text file"
        raise SceneError(f"vibration.samples = {given!r}: cannot read {path}: {why}") from None
    found: dict[str, list[float]] = {"time": [], "acceleration": []}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        separator = next((mark for mark in (";", "\t", ",") if mark in line), None)
        cells = next(csv.reader([line], delimiter=separator)) if separator else line.split()
        try:
            time, acceleration = map(float, cells)
        except ValueError:
            if not found["time"]:
                continue
            raise SceneError(
                f"vibration.samples = {given!r}: line {number} of {path.name} is {line.strip()[:40]!r}; "
                "every line needs two numbers, time in s and acceleration in m/s2"
            ) from None
        found["time"].append(time)
        found["acceleration"].append(acceleration)
    if not found["time"]:
        raise SceneError(f"vibration.samples = {given!r}: no line of two numbers (time in s, acceleration in m/s2)")
    return found
