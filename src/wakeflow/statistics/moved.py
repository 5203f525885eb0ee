"""Shares of a finished run with its dividers elsewhere: from the landings that are stored, at once.

A run reports its shares, with their whole error, for its own dividers. The granules that it keeps say by how much a
share changes when dividers move, and that difference is added to what was reported; at the run's own dividers the
answer is its own. An interval is estimated: that of a share p is proportional to sqrt(p (1 - p)), with the largest
factor of the fraction's reported shares (a design effect: Kish 1965, Survey Sampling, 8.2), and the sampling error of
the granules that changed their bin is added to it in squares.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..answer.result import Result, kept_granules
from ..core.errors import SceneError
from ..core.number import Number
from ..planning.unknowns import SIGMAS
from ..scene import RESERVED_BIN, Scene
from .separation import purity_slopes

Array = NDArray[np.float64]
ON_LINE = 1e-6  # m: a landing is on a side that it is no further from
SAME = 1e-7  # m: a divider that has moved less has not
LEAST = 1e-3  # a share whose interval says something of the others' is at least that, and at most one less that
Ends = Mapping[str, tuple[float, float]]  # by bin: from and to (m)


class MovedShares(NamedTuple):
    """Shares by fraction and bin, purity by bin and fraction, recovery by fraction (None without a target)."""

    fractions: dict[str, dict[str, Number]]
    purity: dict[str, dict[str, Number]]
    recovery: dict[str, Number | None]


@dataclass(frozen=True)
class StoredLandings:
    """The landings of a run on the sides of its channel: ``side`` (n,) index into SIDES or -1, ``place`` (n,) m along
    it, ``fraction`` (n,) and ``bin`` (n,) indices, ``weight`` (n,) of each fraction's mass, which sum to 1 in each.
    """

    result: Result
    scene: Scene
    side: NDArray[np.int64]
    place: Array
    fraction: NDArray[np.int64]
    bin: NDArray[np.int64]
    weight: Array

    SIDES = ("floor", "top", "left", "right")

    @classmethod
    def of(cls, result: Result) -> StoredLandings:
        """Those that a run keeps. Raises SceneError where it ended before its shares, or keeps none."""
        if result.landings is None:
            raise SceneError(f"{result.folder} holds no shares: the run ended before them")
        scene, data = Scene.parse(result.scene).with_top(), kept_granules(result.folder)
        x, y = np.asarray(data["position"]).T
        half, channel = scene.channel.width / 2, scene.channel
        gaps = np.abs([y - channel.bottom, y - channel.top, x + half, x - half])
        side = np.where(gaps.min(axis=0) <= ON_LINE, gaps.argmin(axis=0), -1)
        names = list(scene.fraction)
        order = np.array([names.index(name) for name in data["names"]])
        fraction = order[data["fraction"]]
        weight = np.asarray(data["weight"], dtype=float)
        sums = np.bincount(fraction, weight, minlength=len(names))
        return cls(result, scene, side, np.where(side < 2, x, y), fraction, np.asarray(data["bin"], dtype=np.int64),
                   weight / sums[fraction])  # fmt: skip

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """The run's own dividers: from and to (m) of each bin that lies on a side."""
        bins = self.scene.bin.items()
        return {name: (float(one.start or 0.0), float(one.to or 0.0)) for name, one in bins if one.side}

    def profile(self, cells: int = 80) -> dict[str, dict[str, list[float]]]:
        """By side with bins and by fraction: the share of its mass that lands in each of ``cells`` along the side."""
        half, channel = self.scene.channel.width / 2, self.scene.channel
        found: dict[str, dict[str, list[float]]] = {}
        for on in dict.fromkeys(one.side for one in self.scene.bin.values() if one.side):
            number = self.SIDES.index(on)
            span = (-half, half) if number < 2 else (channel.bottom, channel.top)
            here = self.side == number
            found[on] = {
                name: np.histogram(self.place[mine], cells, span, weights=self.weight[mine])[0].tolist()
                for i, name in enumerate(self.scene.fraction)
                for mine in [here & (self.fraction == i)]
            }
        return found

    def shares(self, ends: Ends) -> MovedShares:
        """The answer with the bins between ``ends``. Raises SceneError for a bin that there is not, one whose ends are
        in the wrong order, and two on a side that overlap.
        """
        moved = self._moved(ends)
        bins = [*self.scene.bin, RESERVED_BIN]
        own, new = (self._table(one, len(bins)) for one in (self._placed(self.ends), self._placed(moved)))
        changed = self._placed(self.ends) != self._placed(moved)
        names = enumerate(self.scene.fraction)
        fractions = {name: self._numbers(i, bins, own[i], new[i], changed) for i, name in names}
        return MovedShares(fractions, self._purity(fractions), self._recovery(fractions))

    def _moved(self, ends: Ends) -> dict[str, tuple[float, float]]:
        own = self.ends
        for name, (low, high) in ends.items():
            if name not in own:
                raise SceneError(f"no bin {name!r} on a side of this run (known: {', '.join(own)})")
            if not low < high:
                raise SceneError(f"bin.{name}: from = {1000 * low:g} mm must be below to = {1000 * high:g} mm")
        moved = {name: ends.get(name, pair) for name, pair in own.items()}
        for on in self.SIDES:
            row = sorted((moved[name], name) for name in moved if self.scene.bin[name].side == on)
            for ((_, high), one), ((low, _), other) in pairwise(row):
                if low < high - SAME:
                    raise SceneError(f"bins {one} and {other} overlap: {other} begins at {1000 * low:g} mm")
        return moved

    def _placed(self, ends: Ends) -> NDArray[np.int64]:
        """The bin (n,) of every granule, -1 elsewhere; one that lies within the channel keeps its own."""
        found = np.where(self.side < 0, self.bin, -1)
        for i, (name, one) in enumerate(self.scene.bin.items()):
            if one.side is None:
                found[self.bin == i] = i
            else:
                low, high = ends[name]
                here = (self.side == self.SIDES.index(one.side)) & (self.place >= low) & (self.place < high)
                found[here] = i
        return found

    def _table(self, placed: NDArray[np.int64], bins: int) -> Array:
        """Share (fractions, bins) of every fraction in every bin, elsewhere last."""
        count = len(self.scene.fraction)
        where = self.fraction * bins + np.where(placed < 0, bins - 1, placed)
        return np.asarray(np.bincount(where, self.weight, minlength=count * bins), dtype=float).reshape(count, bins)

    def _numbers(
        self, which: int, bins: list[str], own: Array, new: Array, changed: NDArray[np.bool_]
    ) -> dict[str, Number]:
        """The shares of one fraction: what the run reports, changed by what its granules say."""
        assert self.result.landings is not None
        reported = self.result.landings.separation.fractions[list(self.scene.fraction)[which]]
        told = {place: reported.get(place, Number(0.0, 0.0, 0.0)) for place in bins}
        factor = max((_factor(one) for one in told.values()), default=0.0)
        mine = self.fraction == which
        grain = float((self.weight[mine] ** 2).sum())
        crossed = float(self.weight[mine & changed].sum())
        found = {}
        for i, place in enumerate(bins):
            by = float(new[i] - own[i])
            if abs(by) < 1e-12:
                found[place] = told[place]
                continue
            value = min(max(told[place].value + by, 0.0), 1.0)
            half = math.hypot(factor * math.sqrt(value * (1.0 - value)), SIGMAS * math.sqrt(grain * crossed))
            found[place] = Number(value, max(0.0, value - half), min(1.0, value + half))
        return found

    def _purity(self, fractions: Mapping[str, Mapping[str, Number]]) -> dict[str, dict[str, Number]]:
        """Of every bin that holds something; the intervals of the shares count as independent."""
        assert self.result.landings is not None
        mass, reported = self.scene.mass_shares(), self.result.landings.separation
        found: dict[str, dict[str, Number]] = {}
        for place in self.scene.bin:
            shares = {name: fractions[name][place].value for name in fractions}
            total = sum(mass[name] * share for name, share in shares.items())
            if total <= 0.0:
                continue
            same = all(fractions[name][place] is reported.fractions[name].get(place) for name in fractions)
            found[place] = {}
            for name in fractions:
                known = (reported.purity.get(place) or {}).get(name)
                if same and known is not None:
                    found[place][name] = known
                    continue
                slopes = purity_slopes(name, mass, shares)
                half = math.sqrt(sum((slopes[one] * _half(fractions[one][place])) ** 2 for one in fractions))
                value = mass[name] * shares[name] / total
                found[place][name] = Number(value, max(0.0, value - half), min(1.0, value + half))
        return found

    def _recovery(self, fractions: Mapping[str, Mapping[str, Number]]) -> dict[str, Number | None]:
        """The share in the target bins, whose errors count as together."""
        assert self.result.landings is not None
        reported, found = self.result.landings.separation, dict[str, Number | None]()
        for name, shares in fractions.items():
            targets = [shares[place] for place in self.scene.fraction[name].targets]
            own = [reported.fractions[name].get(place) for place in self.scene.fraction[name].targets]
            if not targets or all(one is other for one, other in zip(targets, own, strict=True)):
                found[name] = reported.recovery[name]
                continue
            value = min(1.0, sum(one.value for one in targets))
            half = min(sum(_half(one) for one in targets), 1.0)
            found[name] = Number(value, max(0.0, value - half), min(1.0, value + half))
        return found


def _half(one: Number) -> float:
    return max(one.value - one.low, one.high - one.value) if one.known else 1.0


def _factor(one: Number) -> float:
    """Half of an interval over sqrt(p (1 - p)), of a share that is neither nothing nor all."""
    if not one.known or not LEAST < one.value < 1.0 - LEAST:
        return 0.0
    return _half(one) / math.sqrt(one.value * (1.0 - one.value))
