"""Recorded tracks, as pictures take them and as they are kept in a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.files import atomic_write
from ..tracking import Granules, Tracks

__all__ = ["load_drawn_tracks", "paths_of", "save_drawn_tracks"]

Array = NDArray[Any]
MOMENTS = ("time", "position", "velocity")  # (m,) s, (m, 2) m, (m, 2) m/s of a track
OWN = ("diameter", "bin", "fate")  # () m, place among the scene's bins or -1, value of Fate, of a track


def paths_of(tracks: Tracks, grains: Granules, bins: int) -> list[dict[str, Array]]:
    """Recorded tracks with their granules' diameters, and where and how they ended in a scene of so many ``bins``."""
    own = zip(grains.diameter, *tracks.ends(bins), strict=True)
    return [
        dict(zip((*MOMENTS, *OWN), (*tracks.path(i), *map(np.asarray, one)), strict=True)) for i, one in enumerate(own)
    ]


def save_drawn_tracks(path: Path, paths: Sequence[dict[str, Array]]) -> None:
    """Keep tracks end to end in one file (.npz), ``split`` saying where each begins."""
    split = np.cumsum([0] + [len(one["time"]) for one in paths])
    room: dict[str, Any] = {"time": np.zeros(0), "position": np.zeros((0, 2)), "velocity": np.zeros((0, 2))}
    joined: dict[str, Any] = {key: np.concatenate([none, *(one[key] for one in paths)]) for key, none in room.items()}
    own: dict[str, Any] = {key: np.array([one[key] for one in paths]) for key in OWN}
    with atomic_write(path, "wb") as stream:
        np.savez(stream, split=split, **own, **joined)


def load_drawn_tracks(file: Path) -> list[dict[str, Array]]:
    """What :func:`save_drawn_tracks` kept."""
    with np.load(file) as data:
        if len(data["split"]) == 1:
            return []
        cut = data["split"][1:-1]
        rows = zip(*(np.split(data[key], cut) for key in MOMENTS), *(data[key] for key in OWN), strict=True)
        return [dict(zip((*MOMENTS, *OWN), map(np.asarray, row), strict=True)) for row in rows]
