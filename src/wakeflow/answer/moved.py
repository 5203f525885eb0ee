"""Where the granules of a finished run landed along the sides of its channel, for pictures of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..scene import Scene
from ..scene.bins import SIDES
from .result import Result, kept_granules

Array = NDArray[np.float64]
ON_LINE = 1e-6  # m: a landing is on a side that it is no further from


@dataclass(frozen=True)
class StoredLandings:
    """The landings of a run on the sides of its channel: ``side`` (n,) index into SIDES or -1, ``place`` (n,) m along
    it, ``fraction`` (n,) index, ``weight`` (n,) of each fraction's mass, which sum to 1 in each.
    """

    result: Result
    scene: Scene
    side: NDArray[np.int64]
    place: Array
    fraction: NDArray[np.int64]
    weight: Array

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
        return cls(result, scene, side, np.where(side < 2, x, y), fraction, weight / sums[fraction])

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """The run's own dividers: from and to (m) of each bin that is open on a side."""
        return {name: one.ends for name, one in self.scene.on_sides().items() if one.keeps_part is None}

    def profile(self, cells: int = 80) -> dict[str, dict[str, list[float]]]:
        """By side with bins and by fraction: the share of its mass that lands in each of ``cells`` along the side."""
        found: dict[str, dict[str, list[float]]] = {}
        for on in dict.fromkeys(one.on for one in self.scene.on_sides().values()):
            number = SIDES.index(on)
            span = self.scene.channel.span(on)
            here = self.side == number
            found[on] = {
                name: np.histogram(self.place[mine], cells, span, weights=self.weight[mine])[0].tolist()
                for i, name in enumerate(self.scene.fraction)
                for mine in [here & (self.fraction == i)]
            }
        return found
