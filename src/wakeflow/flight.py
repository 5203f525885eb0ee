"""Every fraction's granules from the feed to their landing: what they meet, where they end, kept in one folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .field import FlowField
from .files import atomic_write
from .injection import Feedstock, feedstock
from .planning import Plan
from .scene import GRAVITY, Scene
from .separation import Landings
from .tracking import Body, Fate, Granules, Motion, Tracks, track

__all__ = ["Flight", "Tracked", "ends", "load", "solids"]

Array = NDArray[np.float64]
DRAWN = 48  # tracks kept for pictures, a fraction
WALL = 0.05  # thickness of the channel's walls in channel widths; only their inner faces are ever met
PATIENCE = 40.0  # channel heights at air speed before a granule counts as airborne


@dataclass(frozen=True)
class Tracked:
    """What the tracker found: landings and drawn tracks by fraction, how many were injected, counts of fates."""

    landings: dict[str, Landings]
    drawn: dict[str, list[dict[str, Array]]]
    injected: dict[str, int]
    fates: dict[str, dict[str, int]]


@dataclass(frozen=True)
class Flight:
    """How granules of a scene are flown; ``field`` None in a vacuum, ``tell`` hears of progress."""

    scene: Scene
    plan: Plan
    field: FlowField | None
    tolerance: float
    workers: int | None = None
    tell: Callable[[str], None] = lambda text: None

    def warm_up(self) -> None:
        """Have the tracker compiled, or read from its cache, before time is taken."""
        still = Granules(position=np.zeros((1, 2)), velocity=np.zeros((1, 2)), diameter=1e-3, density=1e3)
        track(None, still, until=1e-3, length=self.scene.width, forces=("gravity",))

    def fly_all(self, folder: Path, *, drawn: bool) -> None:
        """Fly every fraction and keep its landings in ``folder``; fractions that are there already are left alone."""
        for name in self.scene.fraction:
            if (folder / f"{name}.npz").exists():
                continue
            self.tell(f"{name}: injecting")
            feed = feedstock(self.scene, self.plan, name, None if self.field is None else self.field.period)
            if drawn:
                chosen = np.linspace(0, len(feed.replicate) - 1, min(DRAWN, len(feed.replicate))).astype(int)
                shown = self.fly(name, feed.granules[chosen], record=True)
                _save_drawn(folder / f"{name}.drawn.npz", [shown.path(i) for i in range(len(chosen))])
            _save_landings(folder / f"{name}.npz", feed, self._fly_ensemble(name, feed), len(self.scene.bin))

    def _fly_ensemble(self, name: str, feed: Feedstock) -> Tracks:
        """Every granule of a fraction; in a time-resolved symmetric airflow odd replicates fly in its mirror image.

        A few periods of shedding are a small sample, and their mean wake may lean to one side. In a symmetric channel
        its mirror image is as likely: the mean over both does not lean, and the spread between replicates shows how
        much either does.
        """
        if self.field is None or self.field.times is None or not self.plan.symmetric:
            return self.fly(name, feed.granules)
        odd = feed.replicate % 2 == 1
        other = replace(self, field=self.field.reflected())
        return _interleaved(odd, self.fly(name, feed.granules[~odd]), other.fly(name, feed.granules[odd]))

    def fly(self, name: str, grains: Granules, *, record: bool = False) -> Tracks:
        """Track granules of one fraction through the scene."""
        scene = self.scene
        height = scene.channel.top - scene.channel.bottom
        speed = np.sqrt(GRAVITY * height) if scene.air is None else scene.air.speed
        return track(
            self.field,
            grains,
            until=float(np.max(grains.time, initial=0.0)) + max(5.0, PATIENCE * height / speed),
            tolerance=self.tolerance,
            length=scene.width,
            forces=self.plan.forces,
            drag=self.plan.fractions[name].drag,
            bodies=solids(scene),
            lines=ends(scene),
            gravity=(0.0, -GRAVITY),
            record=record,
            workers=self.workers,
            progress=None if record else lambda done, total: self.tell(f"{name}: {done} of {total}"),
        )


def _interleaved(odd: NDArray[np.bool_], even_tracks: Tracks, odd_tracks: Tracks) -> Tracks:
    """Tracks of two complementary parts of the granules, in the granules' own order."""

    def merge(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        whole = np.empty((len(odd), *one.shape[1:]), dtype=one.dtype)
        whole[~odd], whole[odd] = one, other
        return whole

    names = [f.name for f in fields(Tracks) if f.name != "recorded"]
    parts: dict[str, Any] = {name: merge(getattr(even_tracks, name), getattr(odd_tracks, name)) for name in names}
    return Tracks(**parts)


def solids(scene: Scene) -> list[Body]:
    """What granules bounce off: the bodies, vibrating or at rest, and the channel's walls where no bin stands."""
    amplitude, omega = scene.motion
    motion = Motion(tuple(amplitude), omega / (2 * np.pi)) if omega > 0 else None
    found = [Body(body.outline(), motion=motion) for body in scene.body.values()]
    half, thick = scene.channel.width / 2, WALL * scene.channel.width
    for side, inner, outer in (("left", -half, -half - thick), ("right", half, half + thick)):
        level = scene.channel.bottom - thick
        open_ranges = sorted((b.start, b.to) for b in scene.bin.values() if b.points is None and b.on == side)
        for start, end in [*open_ranges, (scene.channel.top + thick, None)]:
            assert start is not None
            if start > level:
                low, high = sorted((inner, outer))
                found.append(Body(np.array([(low, level), (high, level), (high, start), (low, start)])))
            level = end if end is not None else level
    return found


def ends(scene: Scene) -> list[Array]:
    """Lines that end a track: the bins in the scene's order, then the floor and the top of the channel."""
    channel = scene.channel
    half, slack = 0.5 * channel.width, 1e-6 * channel.width
    across = np.array([-half - WALL * channel.width, half + WALL * channel.width])
    borders = [np.stack([across, np.full(2, y)], axis=1) for y in (channel.bottom - slack, channel.top + slack)]
    return [bin_.line(channel) for bin_ in scene.bin.values()] + borders


def _save_landings(path: Path, feed: Feedstock, tracks: Tracks, bins: int) -> None:
    binned = (tracks.line >= 0) & (tracks.line < bins)  # the lines after the bins are the channel's floor and top
    with atomic_write(path, "wb") as stream:
        np.savez(
            stream,
            position=tracks.position,
            bin=np.where(binned, tracks.line, -1),
            replicate=feed.replicate,
            diameter=feed.granules.diameter,
            fate=np.where((tracks.fate == Fate.BINNED) & ~binned, Fate.ESCAPED, tracks.fate),
            time=tracks.time - feed.granules.time,
            impacts=tracks.impacts + feed.injected,  # the tracker did not see the first impact of these
            injected=feed.injected,
        )


def _save_drawn(path: Path, paths: list[tuple[Array, Array, Array]]) -> None:
    """Tracks end to end in one file: row splits, time (s), position (m), velocity (m/s)."""
    split = np.cumsum([0] + [len(t) for t, _, _ in paths])
    joined = [np.concatenate(parts) for parts in zip(*paths, strict=True)]
    with atomic_write(path, "wb") as stream:
        np.savez(stream, split=split, time=joined[0], position=joined[1], velocity=joined[2])


def load(folder: Path, scene: Scene) -> Tracked:
    """What ``fly_all`` kept in a folder."""
    landings: dict[str, Landings] = {}
    drawn: dict[str, list[dict[str, Array]]] = {}
    injected: dict[str, int] = {}
    for name in scene.fraction:
        with np.load(folder / f"{name}.npz") as data:
            columns = {key: data[key] for key in data.files}
        injected[name] = int(columns.pop("injected").sum())
        landings[name] = Landings(**columns)
        file = folder / f"{name}.drawn.npz"
        drawn[name] = _load_drawn(file) if file.exists() else []
    fates = {
        name: {fate.name.lower(): int(np.sum(landing.fate == fate)) for fate in Fate}
        for name, landing in landings.items()
    }
    return Tracked(landings, drawn, injected, fates)


def _load_drawn(file: Path) -> list[dict[str, Array]]:
    with np.load(file) as data:
        cut = data["split"][1:-1]
        parts = [np.split(data[key], cut) for key in ("time", "position", "velocity")]
    return [dict(zip(("time", "position", "velocity"), one, strict=True)) for one in zip(*parts, strict=True)]
