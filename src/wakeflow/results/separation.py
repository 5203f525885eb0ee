"""From landings to the answer: which share of each fraction lands in which bin, by mass, with 95 % intervals.

Granules are injected as independent replicates of one randomised low-discrepancy sample, so the spread
between replicates measures the sampling error, whatever the variance reduction inside a replicate (randomised
quasi-Monte Carlo: Owen 1997, SIAM J. Numer. Anal. 34, 1884).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..pipeline.landings import Landings
from ..scene import RESERVED_BIN, Scene
from .landing_results import Separation
from .measured import Measured, Share

__all__ = ["separate", "share_interval", "upper_limit"]

Array = NDArray[np.float64]
LEVEL = 0.95  # of every interval
HOUR = 3600.0  # s


def share_interval(samples: Array, count: int) -> tuple[float, float, float]:
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


def upper_limit(count: int, total: int) -> float:
    """Upper 95 % limit (Wilson) of a share of which ``count`` of ``total`` were found."""
    from scipy.stats import binomtest

    return float(binomtest(count, total).proportion_ci(LEVEL, method="wilson").high)


def _purity(name: str, masses: Mapping[str, Array], limits: Mapping[str, tuple[float, float]]) -> Measured:
    """Share of fraction ``name`` in a bin's mass: ratio of means over replicates, and its 95 % interval.

    ``masses``: mass of every fraction in the bin, one a replicate; ``limits``: (low, high) of the same masses. The
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
        others = [ends for other, ends in limits.items() if other != name]
        least_own, most_own = limits[name]
        least, most = sum(ends[0] for ends in others), sum(ends[1] for ends in others)
        low = min(low, least_own / (least_own + most) if least_own + most > 0 else 0.0)
        high = max(high, most_own / (most_own + least) if most_own + least > 0 else 1.0)
    return Measured(value, max(0.0, low), min(1.0, high))


def separate(scene: Scene, landings: Mapping[str, Landings]) -> Separation:
    """Shares, purity, recovery and throughput (kg/h) of every bin from the ``landings`` of each fraction."""
    bins = [*scene.bin, RESERVED_BIN]
    shares: dict[str, Array] = {}  # (replicates, bins)
    count: dict[str, int] = {}
    for name in landings:
        landing = landings[name]
        shares[name] = landing.counts(len(scene.bin))
        count[name] = len(landing.bin)
    fractions = {
        name: {place: Share(*share_interval(table[:, i], count[name])) for i, place in enumerate(bins)}
        for name, table in shares.items()
    }
    purity, throughput = _contents(scene, bins, shares, fractions)
    recovery = {name: _recovery(scene, name, bins, table, count[name]) for name, table in shares.items()}
    return Separation(tuple(bins), fractions, purity, recovery, throughput)


def _recovery(scene: Scene, name: str, bins: list[str], shares: Array, count: int) -> Measured | None:
    """Share of a fraction in its target bins; None where the scene names none."""
    targets = scene.fraction[name].targets
    if not targets:
        return None
    return Measured(*share_interval(np.sum([shares[:, bins.index(target)] for target in targets], axis=0), count))


def _contents(
    scene: Scene, bins: list[str], shares: Mapping[str, Array], fractions: Mapping[str, Mapping[str, Share]]
) -> tuple[dict[str, dict[str, Measured] | None], dict[str, float]]:
    """Purity of every fraction in every bin, None where it is empty, and every bin's throughput (kg/h)."""
    mass = scene.mass_shares()
    purity: dict[str, dict[str, Measured] | None] = {}
    throughput: dict[str, float] = {}
    for i, place in enumerate(bins):
        masses = {name: mass[name] * table[:, i] for name, table in shares.items()}
        found = {name: fractions[name][place] for name in shares}
        limits = {name: (mass[name] * share.low, mass[name] * share.high) for name, share in found.items()}
        inside = float(np.mean(np.sum(list(masses.values()), axis=0)))
        throughput[place] = HOUR * scene.feed.mass_flow * inside
        purity[place] = {name: _purity(name, masses, limits) for name in shares} if inside > 0 else None
    return purity, throughput
