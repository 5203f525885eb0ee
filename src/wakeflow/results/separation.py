"""From landings to the answer: which share of each fraction lands in which bin, by mass, with 95 % intervals.

Granules are injected as independent replicates of one randomised low-discrepancy sample, so the spread
between replicates measures the sampling error, whatever the variance reduction inside a replicate (randomised
quasi-Monte Carlo: Owen 1997, SIAM J. Numer. Anal. 34, 1884). Where the airflow sheds, or has several realisations, its
finite sample is in the interval too (:mod:`wakeflow.results.spread`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number
from ..pipeline.landings import Landings
from ..scene import RESERVED_BIN, Scene
from .landing_results import Separation
from .spread import Spread, Tally, cycles_of, spread_of, wilson

__all__ = ["purity_slopes", "separate", "share_interval", "share_spreads", "upper_limit"]

Array = NDArray[np.float64]
HOUR = 3600.0  # s


def share_interval(samples: Array, count: int, spread: Spread | None = None) -> tuple[float, float, float]:
    """Mean and 95 % interval of a share from its independent replicates.

    Half of it is ``spread``, by default Student's t over the replicates, but no narrower than half a granule a
    replicate: balanced samples may agree on a value that is off by that much. Where all agree on 0 or 1: Wilson's
    interval for ``count`` granules.
    """
    value = float(np.mean(samples))
    replicates = len(samples)
    if np.ptp(samples) == 0.0 and value in (0.0, 1.0):
        return value, *wilson(round(value * count), count)
    found = spread or spread_of(samples[:, None] - value, np.zeros(replicates, dtype=np.int64), 0.0)
    half = found._replace(sampling=max(found.sampling, 0.5 * replicates / count)).together
    return value, max(0.0, value - half), min(1.0, value + half)


def share_spreads(landing: Landings, bins: int) -> list[Spread]:
    """The two parts of the interval of a fraction's share in every bin, and elsewhere."""
    found = []
    for tally in Tally.every(landing, bins, cycles_of([landing])):
        _, low, high = share_interval(tally.samples, round(landing.size), tally.spread._replace(airflow=0.0))
        found.append(Spread(0.5 * (high - low), tally.spread.airflow))
    return found


def upper_limit(count: int, total: int) -> float:
    """Upper 95 % limit (Wilson) of a share of which ``count`` of ``total`` were found."""
    return wilson(count, total)[1]


def separate(scene: Scene, landings: Mapping[str, Landings]) -> Separation:
    """Shares, purity, recovery and throughput (kg/h) of every bin from the ``landings`` of each fraction."""
    bins = [*scene.bin, RESERVED_BIN]
    cycles = cycles_of(landings[name] for name in landings)
    tallies: dict[str, list[Tally]] = {}  # one a bin
    count: dict[str, int] = {}
    for name in landings:
        landing = landings[name]
        tallies[name] = Tally.every(landing, len(scene.bin), cycles)
        count[name] = round(landing.size)
    fractions = {
        name: {place: Number(*_interval(tally, count[name])) for place, tally in zip(bins, found, strict=True)}
        for name, found in tallies.items()
    }
    purity, throughput = _contents(scene, bins, tallies, fractions)
    recovery = {name: _recovery(scene, name, bins, found, count[name]) for name, found in tallies.items()}
    return Separation(tuple(bins), fractions, purity, recovery, throughput)


def _interval(tally: Tally, count: int) -> tuple[float, float, float]:
    return share_interval(tally.samples, count, tally.spread)


def _recovery(scene: Scene, name: str, bins: list[str], tallies: Sequence[Tally], count: int) -> Number | None:
    """Share of a fraction in its target bins; None where the scene names none."""
    targets = scene.fraction[name].targets
    if not targets:
        return None
    hits = np.sum([tallies[bins.index(target)].hits for target in targets], axis=0)
    return Number(*_interval(tallies[0]._replace(hits=hits), count))


def _contents(
    scene: Scene,
    bins: list[str],
    tallies: Mapping[str, Sequence[Tally]],
    fractions: Mapping[str, Mapping[str, Number]],
) -> tuple[dict[str, dict[str, Number] | None], dict[str, float]]:
    """Purity of every fraction in every bin, None where it is empty, and every bin's throughput (kg/h)."""
    mass = scene.mass_shares()
    purity: dict[str, dict[str, Number] | None] = {}
    throughput: dict[str, float] = {}
    for i, place in enumerate(bins):
        here = {name: found[i] for name, found in tallies.items()}
        limits = {
            name: (mass[name] * found[place].low, mass[name] * found[place].high) for name, found in fractions.items()
        }
        inside = sum(mass[name] * tally.share for name, tally in here.items())
        throughput[place] = HOUR * scene.feed.mass_flow * inside
        purity[place] = {name: _purity(name, mass, here, limits) for name in here} if inside > 0 else None
    return purity, throughput


def _purity(
    name: str, mass: Mapping[str, float], tallies: Mapping[str, Tally], limits: Mapping[str, tuple[float, float]]
) -> Number:
    """Share of fraction ``name`` in a bin's mass: ratio of means over replicates, and its 95 % interval.

    ``mass``: share of every fraction in the feed; ``limits``: (low, high) of its mass in the bin. The interval holds
    the one of the linearised ratio (delta method) and, where a fraction's granules are too few to spread over the
    replicates, what the intervals of the shares allow.
    """
    own = tallies[name]
    shares = {other: tally.share for other, tally in tallies.items()}
    value = mass[name] * own.share / sum(mass[other] * share for other, share in shares.items())
    slope = purity_slopes(name, mass, shares)
    deviations = np.sum([slope[other] * tally.deviations for other, tally in tallies.items()], axis=0)
    chance = sum(slope[other] ** 2 * tally.chance for other, tally in tallies.items())
    half = spread_of(deviations, own.realisation, chance).together
    low, high = value - half, value + half
    if any(np.ptp(tally.samples) == 0.0 or np.any(tally.samples == 0.0) for tally in tallies.values()):
        others = [ends for other, ends in limits.items() if other != name]
        least_own, most_own = limits[name]
        least, most = sum(ends[0] for ends in others), sum(ends[1] for ends in others)
        low = min(low, least_own / (least_own + most) if least_own + most > 0 else 0.0)
        high = max(high, most_own / (most_own + least) if most_own + least > 0 else 1.0)
    return Number(value, max(0.0, low), min(1.0, high))


def purity_slopes(name: str, mass: Mapping[str, float], shares: Mapping[str, float]) -> dict[str, float]:
    """By how much the share of fraction ``name`` in a bin's mass grows with each fraction's own share in that bin.

    ``mass``: share of every fraction in the feed; ``shares`` of each in the bin, which must hold some.
    """
    total = sum(mass[other] * share for other, share in shares.items())
    value = mass[name] * shares[name] / total
    return {other: mass[other] * (float(other == name) - value) / total for other in shares}
