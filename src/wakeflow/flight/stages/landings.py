"""What is kept of the tracks: where every granule ended, and the tracks that pictures draw."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.tables import AnyArray, Columns, save_arrays
from ...planning.plan import INPUT_SAMPLES, KEPT, REPLICATES
from ...scene import Scene
from .. import Fate, Granules, Tracks

# -- Recorded tracks ---------------------------------------------------------------------------------------------------
# (m,) s, (m, 2) m, (m, 2) m/s of a track; arriving (m, 2) m/s: before the impact there, where there is one
MOMENTS = ("time", "position", "velocity", "arriving")
OWN = ("diameter", "bin", "fate")  # () m, place among the scene's bins or -1, value of Fate, of a track


def paths_of(tracks: Tracks, grains: Granules, bins: int) -> list[Columns]:
    """Recorded tracks with their granules' diameters, and where and how they ended in a scene of so many ``bins``."""
    ends = zip(grains.diameter, *tracks.ends(bins), strict=True)
    return [
        dict(zip((*MOMENTS, *OWN), (*tracks.path(i), tracks.arriving(i), *map(np.asarray, end)), strict=True))
        for i, end in enumerate(ends)
    ]


def save_recorded_tracks(path: Path, paths: Sequence[Columns]) -> None:
    """Keep tracks end to end in one file (.npz), ``split`` saying where each begins."""
    split = np.cumsum([0] + [len(track["time"]) for track in paths])
    room = {"time": np.zeros(0), **dict.fromkeys(MOMENTS[1:], np.zeros((0, 2)))}
    joined = {key: np.concatenate([none, *(track[key] for track in paths)]) for key, none in room.items()}
    ends = {key: np.array([track[key] for track in paths]) for key in OWN}
    save_arrays(path, {"split": split, **ends, **joined})


def load_recorded_tracks(file: Path) -> list[Columns]:
    """What :func:`save_recorded_tracks` kept."""
    with np.load(file) as data:
        if len(data["split"]) == 1:
            return []
        cut = data["split"][1:-1]
        rows = zip(*(np.split(data[key], cut) for key in MOMENTS), *(data[key] for key in OWN), strict=True)
        return [dict(zip((*MOMENTS, *OWN), map(np.asarray, row), strict=True)) for row in rows]


def recorded_tracks(folder: Path, names: Iterable[str]) -> dict[str, list[Columns]]:
    """Tracks of each fraction that were kept in a folder."""
    return {name: load_recorded_tracks(folder / f"{name}.drawn.npz") for name in names}


# -- What is kept of the tracks ----------------------------------------------------------------------------------------
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Landings:
    """Where the granules of one fraction ended; one entry a granule, every granule represents the same mass; integers
    and lesser columns in few bytes, since there may be very many.

    ``position`` (n, 2) m, ``bin`` (n,) index into the scene's bins or -1 for elsewhere, ``replicate`` (n,),
    ``diameter`` (n,) m, ``fate`` (n,) values of Fate, ``time`` (n,) s in flight, ``impacts`` (n,) on bodies,
    ``realisation`` (n,) of the airflow and ``cycle`` (n,) of the shedding in it at which the granule was released. Of
    granules that meet others: ``weight`` (n,), what each represents, its mean such that the sum is the number of equal
    granules that would be as large a sample, and ``meetings`` (n,) with others; None where each flies alone. ``drag``
    (n,): the factor on its drag law. ``table`` (replicates, bins + 1, cycles): the count of all granules, where these
    are more than the n of them that are kept, a balanced sample.
    """

    position: Array
    bin: NDArray[np.int16]
    replicate: NDArray[np.uint8]
    diameter: NDArray[np.float32]
    fate: NDArray[np.int8]
    time: NDArray[np.float32]
    impacts: NDArray[np.int32]
    realisation: NDArray[np.uint8]
    cycle: NDArray[np.uint16]
    weight: Array | None = None
    meetings: NDArray[np.int32] | None = None
    drag: NDArray[np.float32] | None = None
    table: NDArray[np.int64] | None = None

    @property
    def size(self) -> float:
        """How many granules of equal mass the landings are worth."""
        if self.table is not None:
            return float(self.table.sum())
        return float(len(self.bin)) if self.weight is None else float(self.weight.sum())

    @property
    def mass_shares(self) -> Array:
        """Share (n,) of the fraction's mass that each granule represents."""
        weight = np.ones(len(self.bin)) if self.weight is None else self.weight
        return np.asarray(weight / weight.sum())

    @property
    def escaped(self) -> NDArray[np.bool_]:
        """Granules (n,) that left the box of the airflow."""
        return np.asarray(self.fate == Fate.ESCAPED)

    def counts(self, bins: int, images: Sequence[int] = ()) -> Array:
        """Share of every replicate in every bin, (replicates, bins + 1); the last column is elsewhere. Where bins have
        ``images`` (bins + 1) in a mirrored machine the mean of both.
        """
        table = self.count_by_bin(bins)[:, :, 0]
        return np.asarray(mirrored_mean(table / table.sum(axis=1, keepdims=True), images))

    def count_by_bin(self, bins: int, cycles: int = 1) -> AnyArray:
        """Granules by their weight, (replicates, bins + 1, cycles), elsewhere last; of all cycles where that is one."""
        if self.table is not None:
            return self.table if cycles > 1 else self.table.sum(axis=2, keepdims=True)
        shape = int(self.replicate.max()) + 1, bins + 1, cycles
        place = np.where(self.bin >= 0, self.bin, bins).astype(np.int64)
        place += self.replicate.astype(np.int64) * (bins + 1)
        if cycles > 1:
            place = place * cycles + self.cycle
        return np.bincount(place, self.weight, minlength=int(np.prod(shape))).reshape(shape)


def mirrored_mean(values: Array, images: Sequence[int]) -> Array:
    """Values (..., bins + 1) that are those of each bin and of its image, if it has one: what is as likely on either
    side is one number.
    """
    return 0.5 * (values + values[..., list(images)]) if images else values


FATES = tuple(fate.name.lower() for fate in Fate)  # names, in the order of their numbers


def fates_of(fate: NDArray[np.int8]) -> dict[str, int]:
    """How many of the granules (n,) met each fate, by its name."""
    return {each.name.lower(): int(np.sum(fate == each)) for each in Fate}


BLOCKS = INPUT_SAMPLES // REPLICATES  # of a replicate: a draw of what is unknown flies one, a mirror image two


def block_of(size: int) -> tuple[int, int]:
    """Granules in each block of a replicate of ``size``, and how many of them, the first ones, have their landings
    kept. Blocks of 2^m points of a Sobol set, and what they begin with, are balanced samples themselves.
    """
    block = max(1, size // BLOCKS)
    return block, min(block, max(1, KEPT // (REPLICATES * BLOCKS)))


class LandingCount:
    """The granules of one fraction as they land, part by part: all are counted, and KEPT of them are kept.

    ``size`` of a replicate, number of ``bins``, and of ``cycles`` of the airflow.
    """

    def __init__(self, size: int, replicates: int, bins: int, cycles: int) -> None:
        self._size, self._bins, self._kept = size, bins, list[Columns]()
        self._table = np.zeros((replicates, bins + 1, cycles), dtype=np.int64)
        self._injected, self._fates = 0, np.zeros(len(FATES), dtype=np.int64)

    def add(self, part: Columns, first: int) -> None:
        """Add whole replicates, or granules of one from its number ``first`` on; ``part`` as of ``tracks``."""
        injected, (block, few) = part.pop("injected"), block_of(self._size)
        self._injected += int(injected.sum())
        self._fates += list(fates_of(part["fate"]).values())
        here = Landings(**part).count_by_bin(self._bins, self._table.shape[2])
        self._table[: len(here)] += here
        rows = (first + np.arange(len(injected))) % block < few
        self._kept.append({key: values[rows] for key, values in part.items()})

    def save(self, path: Path) -> None:
        """Keep the rows in the order of their replicates, and the counts."""
        columns = {key: np.concatenate([part.pop(key) for part in self._kept]) for key in list(self._kept[0])}
        order = np.argsort(columns["replicate"], kind="stable")
        columns = {key: values[order] for key, values in columns.items()}
        counts = {"injected": np.array(self._injected), "fates": self._fates}
        some = {} if len(order) == self._table.sum() else {"table": self._table}
        save_arrays(path, {**columns, **counts, **some})


@dataclass(frozen=True)
class Tracked:
    """What the tracker found: landings and drawn tracks by fraction, how many were injected, counts of fates."""

    landings: dict[str, Landings]
    drawn: dict[str, list[Columns]]
    injected: dict[str, int]
    fates: dict[str, dict[str, int]]


def load_tracked(folder: Path, scene: Scene) -> Tracked:
    """What ``Flight.fly_all`` kept in a folder."""
    landings: dict[str, Landings] = {}
    drawn: dict[str, list[Columns]] = {}
    injected: dict[str, int] = {}
    fates: dict[str, dict[str, int]] = {}
    for name in scene.fraction:
        with np.load(folder / f"{name}.npz") as data:
            columns = {key: data[key] for key in data.files}
        injected[name] = int(columns.pop("injected"))
        fates[name] = dict(zip(FATES, columns.pop("fates").tolist(), strict=True))
        landings[name] = Landings(**columns)
        file = folder / f"{name}.drawn.npz"
        drawn[name] = load_recorded_tracks(file) if file.exists() else []
    return Tracked(landings, drawn, injected, fates)
