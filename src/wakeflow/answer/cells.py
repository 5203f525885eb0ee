"""Where granules can land, cut into cells: a bin, and a bin that was moved, is a sum of cells and parts of cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.registry import did_you_mean
from ..scene import Scene
from ..scene.bins import SIDES

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
Landed = Sequence[tuple[NDArray[np.floating], NDArray[np.integer]]]  # positions (..., 2) m and bins (...) of granules
Ends = Mapping[str, tuple[float, float]]  # of bins on sides of the channel: from and to (m)
ON_LINE = 1e-6  # m: a landing is on a side that it is no further from
END_ROUNDING = 1e-7  # m: ends of bins that are nearer to each other are one
FINE = 160  # cells of a side at most, beside what bins end in; chosen: moved ends are read between them
MOST = 3000  # cells of all fractions together: a scene of very many fractions has coarser ones
SHORTEST = 1e-9  # m


@dataclass(frozen=True)
class LandingCells:
    """The cells of a scene: those along each side of the channel that has bins (``edges`` (n + 1,) m by side, of
    ascending place), one for each other bin (``others``), and elsewhere. ``ends`` of the bins on sides, in the scene's
    order of ``bins``; ``on``: the side of each.
    """

    bins: tuple[str, ...]
    on: Mapping[str, str]
    ends: Ends
    edges: Mapping[str, Array]

    @classmethod
    def of(cls, scene: Scene, fractions: int = 1, landed: Landed = ()) -> LandingCells:
        """Cells of a ``scene`` as it is flown, for so many ``fractions``; short ones where granules ``landed``."""
        placed = scene.on_sides()
        ends, on = ({name: getattr(bin_, key) for name, bin_ in placed.items()} for key in ("ends", "on"))
        fine = int(np.clip(MOST // max(1, fractions * len(set(on.values()))), 4, FINE))
        edges = {side: np.array(scene.channel.span(side)) for side in SIDES if side in on.values()}
        cells = cls(tuple(scene.bin), on, ends, edges)
        return replace(cells, edges=cells._shorter(scene, landed, fine))

    def _shorter(self, scene: Scene, landed: Landed, fine: int) -> dict[str, Array]:
        """Edges of cells that are short where granules ``landed``; in a machine with two equal sides their images."""
        places, shorter, even = [self.along(scene, *lot) for lot in landed], {}, len(scene.images) > 0
        for number, (name, edges) in enumerate(self.edges.items()):
            level = name in ("floor", "top")
            alike = [i for i, side in enumerate(self.edges) if even and not level and side not in ("floor", "top")]
            here = [place[np.isin(side, alike or [number])] for side, place in places]
            inner = [end for bin_ in self.on if self.on[bin_] == name for end in self.ends[bin_]]
            every = np.concatenate([np.array([]), *here, *(-along for along in here if even and level)])
            shorter[name] = _edges([edges[0], edges[-1], *inner], fine, every)
            if even and level:
                shorter[name] = 0.5 * (shorter[name] - shorter[name][::-1])
        return shorter

    @property
    def others(self) -> list[str]:
        """The bins that lie on no side."""
        return [name for name in self.bins if name not in self.on]

    @property
    def first(self) -> dict[str, int]:
        """The number of the first cell of every side."""
        starts = np.cumsum([0, *(len(edges) - 1 for edges in self.edges.values())])
        return dict(zip(self.edges, map(int, starts), strict=False))

    @property
    def count(self) -> int:
        """How many cells there are, elsewhere the last."""
        return sum(len(edges) - 1 for edges in self.edges.values()) + len(self.others) + 1

    # -- landings ------------------------------------------------------------------------------------------------------
    def along(self, scene: Scene, position: NDArray[np.floating], bin_: NDArray[np.integer]) -> tuple[Whole, Array]:
        """The side (..., index into ``edges``) and the place (...) m along it of landings at ``position`` (..., 2) in
        ``bin_`` (...); -1 of those on no side that has bins.
        """
        x, y = np.moveaxis(np.asarray(position, dtype=float), -1, 0)
        channel, half, names = scene.channel, scene.channel.width / 2, list(self.edges)
        gaps = {"floor": y - channel.bottom, "top": y - channel.top, "left": x + half, "right": x - half}
        side, place = np.full(x.shape, -1), np.zeros(x.shape)
        for number, name in enumerate(names):
            inside = np.isin(bin_, [i for i, label in enumerate(self.bins) if self.on.get(label) == name])
            here = inside | ((bin_ < 0) & (side < 0) & (np.abs(gaps[name]) <= ON_LINE))
            side[here] = number
            place[here] = (x if name in ("floor", "top") else y)[here]
        return side, place

    def at(self, side: Whole, place: Array, otherwise: Whole) -> Whole:
        """The number of the cell (...) at a ``place`` of a ``side``, the nearest beyond its ends; ``otherwise`` where
        there is no side.
        """
        cells = np.broadcast_to(otherwise, np.shape(side)).copy()
        for number, (name, edges) in enumerate(self.edges.items()):
            mine = side == number
            cell = np.clip(np.searchsorted(edges, place[mine], side="right") - 1, 0, len(edges) - 2)
            cells[mine] = self.first[name] + cell
        return cells

    def off_sides(self, bin_: NDArray[np.integer]) -> Whole:
        """The number of the cell (...) of landings on no side, which the ``bin_`` alone tells."""
        last, table = self.count - 1, np.full(len(self.bins) + 1, self.count - 1)
        for number, name in enumerate(self.others):
            table[self.bins.index(name)] = last - len(self.others) + number
        return np.asarray(table[np.where(np.asarray(bin_) < 0, len(self.bins), bin_)])

    def mirrored(self, images: Sequence[int]) -> Whole:
        """The image (cells,) of every cell in a machine with two equal sides, whose bins have ``images``."""
        image, twin = np.arange(self.count), {"left": "right", "right": "left"}
        for name, edges in self.edges.items():
            here = self.first[name] + np.arange(len(edges) - 1)
            image[here] = here[::-1] if name not in twin else self.first[twin[name]] + np.arange(len(edges) - 1)
        for name in self.others:
            number = self.bins.index(name)
            image[self.off_sides(np.array(number))] = self.off_sides(np.array(images[number]))
        return image

    # -- bins ----------------------------------------------------------------------------------------------------------
    def moved(self, ends: Ends) -> dict[str, tuple[float, float]]:
        """The ends of all bins on sides, some of them moved. Raises SceneError for a bin that there is not, ends in the
        wrong order or beyond the channel, and bins that overlap.
        """
        for name, (low, high) in ends.items():
            if name not in self.ends:
                raise SceneError(f"no bin {name!r} on a side of this run{did_you_mean(name, list(self.ends))} "
                                 f"(known: {', '.join(self.ends)})")  # fmt: skip
            if not low < high:
                raise SceneError(f"bin.{name}: from = {1000 * low:g} mm must be below to = {1000 * high:g} mm")
            edges = self.edges[self.on[name]]
            if low < edges[0] - END_ROUNDING or high > edges[-1] + END_ROUNDING:
                raise SceneError(f"bin.{name}: {1000 * low:g} to {1000 * high:g} mm is not within the "
                                 f"{self.on[name]}, {1000 * edges[0]:g} to {1000 * edges[-1]:g} mm")  # fmt: skip
        all_ends = {name: ends.get(name, pair) for name, pair in self.ends.items()}
        for side in self.edges:
            row = sorted((all_ends[name], name) for name in all_ends if self.on[name] == side)
            for ((_, high), first), ((low, _), second) in pairwise(row):
                if low < high - END_ROUNDING:
                    raise SceneError(f"bins {first} and {second} overlap: {second} begins at {1000 * low:g} mm")
        return all_ends

    def parts(self, ends: Ends = MappingProxyType({})) -> Array:
        """The part (cells, bins + 1) of every cell that is in every bin, elsewhere last, the bins between other
        ``ends`` where some are given.
        """
        parts = np.zeros((self.count, len(self.bins) + 1))
        for name, (low, high) in {**self.ends, **ends}.items():
            parts[:, self.bins.index(name)] = self.along_side(self.on[name], [(low, high)])
        for number, name in enumerate(self.others):
            parts[self.count - 1 - len(self.others) + number, self.bins.index(name)] = 1.0
        parts[:, -1] = 1.0 - parts[:, :-1].sum(axis=1)
        return np.clip(parts, 0.0, 1.0)

    def along_side(self, side: str, stretches: Sequence[tuple[float, float]]) -> Array:
        """The part (cells,) of every cell between the ends (m) of some ``stretches`` of a side that has bins."""
        parts, edges = np.zeros(self.count), self.edges[side]
        for low, high in stretches:
            parts[self.first[side] + np.arange(len(edges) - 1)] += np.diff(np.clip(edges, low, high)) / np.diff(edges)
        return np.clip(parts, 0.0, 1.0)


def _edges(ends: Sequence[float], fine: int, landed: Array) -> Array:
    """Edges of cells that hold all ``ends``. Of about ``fine`` cells a quarter are spread evenly over all, a half over
    where granules ``landed`` (n,), and a quarter hold as many of these each; all evenly where none did.
    """
    marks = np.unique(np.round(ends, 12))
    marks = marks[np.concatenate([[True], np.diff(marks) > SHORTEST])]
    spread = [marks[[0, -1]]]
    if len(landed) and np.ptp(landed) > SHORTEST:
        inside = np.clip(np.unique(np.quantile(landed, np.linspace(0.0, 1.0, fine + 1))), *spread[0])
        spread += [inside[[0, -1]], inside[[0, -1]], inside]
    places = np.unique(np.concatenate(spread))
    parts = np.mean([np.interp(places, knots, np.linspace(0.0, 1.0, len(knots))) for knots in spread], axis=0)
    edges = []
    for a, b in pairwise(marks):  # as many cells between two ends as their part of all
        low, high = np.interp([a, b], places, parts)
        inner = np.linspace(low, high, max(1, round((high - low) * fine)) + 1)[1:-1]
        edges.append([a, *np.interp(inner, parts, places)])
    return np.concatenate([*edges, marks[-1:]])
