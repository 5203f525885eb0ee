"""From landings to the answer: which share of each fraction lands in which bin, by mass, with 95 % intervals.

Granules are injected as independent replicates of one randomised low-discrepancy sample, so the spread
between replicates measures the sampling error, whatever the variance reduction inside a replicate (randomised
quasi-Monte Carlo: Owen 1997, SIAM J. Numer. Anal. 34, 1884).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .scene import RESERVED_BIN, Scene

__all__ = ["Landings", "interval", "separate"]

Array = NDArray[np.float64]
LEVEL = 0.95


@dataclass(frozen=True)
class Landings:
    """Where the granules of one fraction ended; one entry a granule, every granule stands for the same mass.

    ``position`` (n, 2) m, ``bin`` (n,) index into the scene's bins or -1 for elsewhere, ``replicate`` (n,),
    ``diameter`` (n,) m, ``fate`` (n,) values of Fate, ``time`` (n,) s in flight, ``impacts`` (n,) on bodies.
    """

    position: Array
    bin: NDArray[np.int64]
    replicate: NDArray[np.int64]
    diameter: Array
    fate: NDArray[np.int64]
    time: Array
    impacts: NDArray[np.int64]

    def counts(self, bins: int) -> Array:
        """Share of every replicate in every bin, (replicates, bins + 1); the last column is elsewhere."""
        replicates = int(self.replicate.max()) + 1
        place = np.where(self.bin >= 0, self.bin, bins)
        table = np.zeros((replicates, bins + 1))
        np.add.at(table, (self.replicate, place), 1.0)
        return table / table.sum(axis=1, keepdims=True)


def interval(samples: Array, count: int) -> tuple[float, float, float]:
    """Mean and 95 % interval of a share from its independent replicates.

    Student's t over the replicates. Where all agree on 0 or 1 they tell nothing about the spread: Wilson's interval for
    ``count`` granules then.
    """
    from scipy.stats import binomtest, t

    value = float(np.mean(samples))
    if np.ptp(samples) == 0.0 and value in (0.0, 1.0):
        wilson = binomtest(round(value * count), count).proportion_ci(LEVEL, method="wilson")
        return value, float(wilson.low), float(wilson.high)
    replicates = len(samples)
    half = float(t.ppf(0.5 + LEVEL / 2, replicates - 1) * np.std(samples, ddof=1) / np.sqrt(replicates))
    return value, max(0.0, value - half), min(1.0, value + half)


def _measured(samples: Array, count: int, name: str = "value") -> dict[str, float]:
    value, low, high = interval(samples, count)
    return {name: value, "low": low, "high": high}


def separate(scene: Scene, landings: dict[str, Landings]) -> dict[str, Any]:
    """The ``separation`` table of result.json: shares, purity, recovery, throughput (kg/h) per bin."""
    bins = [*scene.bin, RESERVED_BIN]
    mass = scene.mass_shares()
    shares = {name: landing.counts(len(scene.bin)) for name, landing in landings.items()}  # (replicates, bins)
    count = {name: len(landing.bin) for name, landing in landings.items()}
    fractions = {
        name: {b: _measured(table[:, i], count[name], "share") for i, b in enumerate(bins)}
        for name, table in shares.items()
    }
    recovery = {
        name: _measured(sum(shares[name][:, bins.index(t)] for t in targets), count[name])  # type: ignore[arg-type]
        if (targets := scene.fraction[name].targets)
        else None
        for name in landings
    }
    replicates = min(len(table) for table in shares.values())
    weighted = {name: mass[name] * table[:replicates] for name, table in shares.items()}
    total = sum(weighted.values())
    purity: dict[str, dict[str, Any] | None] = {}
    throughput: dict[str, float] = {}
    for i, b in enumerate(bins):
        inside = total[:, i]  # type: ignore[index]
        throughput[b] = 3600.0 * scene.feed.mass_flow * float(np.mean(inside))
        purity[b] = (
            {name: _measured(table[:, i] / inside, count[name]) for name, table in weighted.items()}
            if np.all(inside > 0)
            else None
        )
    return {
        "bins": bins,
        "fractions": fractions,
        "purity": purity,
        "recovery": recovery,
        "throughput": throughput,
        "cut": [],
    }
