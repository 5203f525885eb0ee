"""How far a share may be off for being taken from few granules and from few sheddings of the wake.

Two samples stand behind a share: the granules, in independent replicates, and the airflow, in cycles of the shedding
that the stored field holds (or late states, or layers of a record). Every replicate is released in every cycle of its
field, so that the two spreads come apart in a two-way analysis of variance (Searle, Casella & McCulloch 1992, "Variance
Components", ch. 4): what the means of the cycles differ by, beyond what the granules in them explain, is the airflow's.
Cycles count as independent, and as the unit that is drawn, a cluster. Six to eight clusters are too few for the
percentiles of a bootstrap (Cameron, Gelbach & Miller 2008, Rev. Econ. Stat. 90, 414); Student's t with a degree of
freedom less than there are clusters holds its level.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.number import student
from ..pipeline.landings import Landings

__all__ = ["LEVEL", "Spread", "Tally", "cycles_of", "spread_of", "student", "wilson"]

Array = NDArray[np.float64]
LEVEL = 0.95  # of every interval


def wilson(count: int, total: int) -> tuple[float, float]:
    """The 95 % interval of a share of which ``count`` of ``total`` > 0 were found (Wilson 1927, J. Am. Stat. Assoc. 22,
    209). scipy's binomtest gives it too, after a test that nobody asks for; a run needs hundreds of
    intervals.
    """
    from scipy.special import ndtri

    share, z2 = count / total, float(ndtri(0.5 * (1.0 + LEVEL))) ** 2
    centre = (count + 0.5 * z2) / (total + z2)
    half = np.sqrt(z2 * (total * share * (1.0 - share) + 0.25 * z2)) / (total + z2)
    return (0.0 if count == 0 else float(centre - half)), (1.0 if count == total else float(centre + half))


class Spread(NamedTuple):
    """Halves of 95 % intervals: by the finite number of granules, and by that of sheddings; the two are independent."""

    sampling: float
    airflow: float

    @property
    def together(self) -> float:
        """Half of the interval that holds both."""
        return float(np.hypot(self.sampling, self.airflow))


class Tally(NamedTuple):
    """Granules of one fraction by replicate and cycle: ``hits`` (R, C) in a bin, or several, ``released`` (R, C) in
    all, each counted by its weight; ``realisation`` (R,) of the airflow in which each replicate flew.
    """

    hits: Array
    released: Array
    realisation: NDArray[np.int64]

    @classmethod
    def every(cls, landing: Landings, bins: int, cycles: int) -> list[Tally]:
        """The tally of every bin, and of what landed elsewhere."""
        replicates = int(landing.replicate.max()) + 1
        realisation = np.zeros(replicates, dtype=np.int64)
        realisation[landing.replicate] = landing.realisation
        place = np.where(landing.bin >= 0, landing.bin, bins).astype(np.int64)
        place = (place * replicates + landing.replicate) * cycles + landing.cycle
        shape = bins + 1, replicates, cycles
        hits = np.bincount(place, landing.weight, minlength=int(np.prod(shape))).reshape(shape).astype(float)
        return [cls(inside, hits.sum(axis=0), realisation) for inside in hits]

    @property
    def samples(self) -> Array:
        """The share of every replicate (R,)."""
        return np.asarray(self.hits.sum(axis=1) / self.released.sum(axis=1))

    @property
    def share(self) -> float:
        """The mean over the replicates."""
        return float(np.mean(self.samples))

    @property
    def deviations(self) -> Array:
        """What the granules of every replicate and cycle (R, C) add to the share, less what they would at the mean
        share, scaled so that the means of rows are the replicates' deviations from it.
        """
        scale = self.released.shape[1] / self.released.sum(axis=1, keepdims=True)
        return np.asarray(scale * (self.hits - self.share * self.released))

    @property
    def chance(self) -> float:
        """The variance of a replicate's share if its granules were independent; balanced ones have less."""
        return self.share * (1.0 - self.share) / float(self.released.sum(axis=1).mean())

    @property
    def spread(self) -> Spread:
        """Of the share."""
        return spread_of(self.deviations, self.realisation, self.chance)


def cycles_of(landings: Iterable[Landings]) -> int:
    """The cycles of the shedding in which granules were released."""
    return 1 + max(int(landing.cycle.max()) for landing in landings)


def spread_of(deviations: Array, realisation: NDArray[np.int64], chance: float) -> Spread:
    """The spread of a mean from ``deviations`` (R, C) as in :class:`Tally`, and the ``realisation`` (R,) of each row.

    ``chance``: variance of a row's mean, where each realisation has one row only, so that rows show none.
    """
    replicates, cycles = deviations.shape
    blocks = [deviations[realisation == number] for number in np.unique(realisation)]
    fields, clusters = len(blocks), len(blocks) * cycles
    means = np.stack([block.mean(axis=0) for block in blocks])
    free = replicates - fields
    rows = np.concatenate([block.mean(axis=1) - block.mean() for block in blocks])
    by_row = cycles * (float(rows @ rows) / free if free else chance)
    sampling = _half(by_row / (replicates * cycles), student(free or replicates - 1))
    if clusters == 1:
        return Spread(sampling, 0.0)
    rest = np.concatenate([b - b.mean(axis=0) - b.mean(axis=1, keepdims=True) + b.mean() for b in blocks])
    by_cell = float((rest**2).sum()) / (free * (cycles - 1)) if free and cycles > 1 else by_row
    # What the granules add to the variance between clusters: between fields by whole replicates, within one by cells.
    noise = ((fields - 1) * by_row + fields * (cycles - 1) * by_cell) / ((clusters - 1) * replicates / fields)
    beyond = max(0.0, float(means.var(ddof=1)) - noise) / clusters
    return Spread(sampling, _half(beyond, student(clusters - 1)))


def _half(variance: float, quantile: float) -> float:
    return float(quantile * np.sqrt(variance))
