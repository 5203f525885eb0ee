"""From landings to the answer: which share of each fraction lands in which bin, by mass, with 95 % intervals.

Granules are injected as independent replicates of one randomised low-discrepancy sample, so the spread
between replicates measures the sampling error, whatever the variance reduction inside a replicate (randomised
quasi-Monte Carlo: Owen 1997, SIAM J. Numer. Anal. 34, 1884).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..pipeline.landings import Landings
from ..scene import RESERVED_BIN, Scene

__all__ = ["interval", "separate"]

Array = NDArray[np.float64]
LEVEL = 0.95


def interval(samples: Array, count: int) -> tuple[float, float, float]:
    """Mean and 95 % interval of a share from its independent replicates.

    Student's t over the replicates, but no narrower than half a granule a replicate: balanced samples may agree on a
    value that is off by that much. Where all agree on 0 or 1: Wilson's interval for ``count`` granules.
    """
    from scipy.stats import binomtest, t

    value = float(np.mean(samples))
    replicates = len(samples)
    if np.ptp(samples) == 0.0 and value in (0.0, 1.0):
        wilson = binomtest(round(value * count), count).proportion_ci(LEVEL, method="wilson")
        return value, float(wilson.low), float(wilson.high)
    half = float(t.ppf(0.5 + LEVEL / 2, replicates - 1) * np.std(samples, ddof=1) / np.sqrt(replicates))
    half = max(half, 0.5 * replicates / count)
    return value, max(0.0, value - half), min(1.0, value + half)


def _share(samples: Array, count: int, name: str = "value") -> dict[str, float]:
    value, low, high = interval(samples, count)
    return {name: value, "low": low, "high": high}


def _purity(name: str, masses: dict[str, Array], shares: dict[str, dict[str, float]]) -> dict[str, float]:
    """Share of fraction ``name`` in a bin's mass: ratio of means over replicates, and its 95 % interval.

    ``masses``: mass of every fraction in the bin, a replicate each; ``shares``: {low, high} of the same as masses. The
    interval holds the one of the linearised ratio (delta method) and, where a fraction's granules are too few to spread
    over the replicates, what the intervals of the shares allow.
    """
    from scipy.stats import t

    total = np.sum(list(masses.values()), axis=0)
    value = float(masses[name].mean() / total.mean())
    spread = np.std(masses[name] - value * total, ddof=1) / total.mean() / np.sqrt(len(total))
    half = float(t.ppf(0.5 + LEVEL / 2, len(total) - 1) * spread)
    low, high = value - half, value + half
    if any(np.ptp(mass) == 0.0 or np.any(mass == 0.0) for mass in masses.values()):
        others = [row for other, row in shares.items() if other != name]
        own = shares[name]
        least, most = sum(row["low"] for row in others), sum(row["high"] for row in others)
        low = min(low, own["low"] / (own["low"] + most) if own["low"] + most > 0 else 0.0)
        high = max(high, own["high"] / (own["high"] + least) if own["high"] + least > 0 else 1.0)
    return {"value": value, "low": max(0.0, low), "high": min(1.0, high)}


def separate(scene: Scene, landings: Mapping[str, Landings]) -> dict[str, Any]:
    """The ``separation`` table of result.json: shares, purity, recovery, throughput (kg/h) per bin."""
    bins = [*scene.bin, RESERVED_BIN]
    mass = scene.mass_shares()
    shares, count = {}, {}
    for name in landings:
        landing = landings[name]
        shares[name] = landing.counts(len(scene.bin))  # (replicates, bins)
        count[name] = len(landing.bin)
    fractions = {
        name: {b: _share(table[:, i], count[name], "share") for i, b in enumerate(bins)}
        for name, table in shares.items()
    }
    recovery = {
        name: _share(np.sum([shares[name][:, bins.index(t)] for t in targets], axis=0), count[name])
        if (targets := scene.fraction[name].targets)
        else None
        for name in landings
    }
    purity: dict[str, dict[str, Any] | None] = {}
    throughput: dict[str, float] = {}
    for i, b in enumerate(bins):
        masses = {name: mass[name] * table[:, i] for name, table in shares.items()}
        limits = {name: {end: mass[name] * fractions[name][b][end] for end in ("low", "high")} for name in shares}
        inside = float(np.mean(np.sum(list(masses.values()), axis=0)))
        throughput[b] = 3600.0 * scene.feed.mass_flow * inside
        purity[b] = {name: _purity(name, masses, limits) for name in shares} if inside > 0 else None
    return {
        "bins": bins,
        "fractions": fractions,
        "purity": purity,
        "recovery": recovery,
        "throughput": throughput,
        "cut": [],
    }
