"""Spread of landings: which share of each fraction lands in which bin, by mass, with 95 % intervals.

Two samples are behind a share: the granules, in independent replicates, and the airflow, in cycles of the shedding
that the stored field holds (or late states, or layers of a record). Every replicate is released in every cycle of its
field, so that the two spreads come apart in a two-way analysis of variance (Searle, Casella & McCulloch 1992, "Variance
Components", ch. 4): what the means of the cycles differ by, beyond what the granules in them explain, is the airflow's.
Cycles count as independent, and as the unit that is drawn, a cluster. Six to eight clusters are too few for the
percentiles of a bootstrap (Cameron, Gelbach & Miller 2008, Rev. Econ. Stat. 90, 414); Student's t with a degree of
freedom less than there are clusters holds its level.

Granules are injected as independent replicates of one randomised low-discrepancy sample, so the spread
between replicates measures the sampling error, whatever the variance reduction inside a replicate (randomised
quasi-Monte Carlo: Owen 1997, SIAM J. Numer. Anal. 34, 1884).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number, student
from ..flight.stages.landings import Landings, mirrored_mean
from ..planning.unknowns import SIGMAS
from ..scene import Scene
from .draws import LEVEL

Array = NDArray[np.float64]
TINY = 1e-12  # of a share


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
    """Halves of 95 % intervals: by the finite numbers of granules and of shedding cycles; the two are independent."""

    sampling: float
    airflow: float

    @property
    def together(self) -> float:
        """Half of the interval that holds both."""
        return float(np.hypot(self.sampling, self.airflow))


BY_SAMPLES = Spread(np.nan, np.nan)  # what the samples themselves say


class Tally(NamedTuple):
    """Granules of one fraction by replicate and cycle: ``hits`` (R, C) in a bin, or several, ``released`` (R, C) in
    all, each counted by its weight; ``realisation`` (R,) of the airflow in which each replicate flew.
    """

    hits: Array
    released: Array
    realisation: NDArray[np.int64]

    @classmethod
    def of_bins(cls, landing: Landings, bins: int, cycles: int, images: Sequence[int] = ()) -> list[Tally]:
        """The tally of every bin, with that of its image where there are ``images``, and of what landed elsewhere."""
        counts = landing.count_by_bin(bins, cycles)
        realisation = np.zeros(len(counts), dtype=np.int64)
        realisation[landing.replicate] = landing.realisation
        hits = np.ascontiguousarray(np.swapaxes(counts, 0, 1)).astype(float)
        return [cls(inside, hits.sum(axis=0), realisation) for inside in mirrored_mean(hits.T, images).T]

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
        """Spread of the share."""
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
    sampling = student(free or replicates - 1) * math.sqrt(by_row / (replicates * cycles))
    if clusters == 1:
        return Spread(sampling, 0.0)
    rest = np.concatenate([b - b.mean(axis=0) - b.mean(axis=1, keepdims=True) + b.mean() for b in blocks])
    by_cell = float((rest**2).sum()) / (free * (cycles - 1)) if free and cycles > 1 else by_row
    # What the granules add to the variance between clusters: between fields by whole replicates, within one by cells.
    noise = ((fields - 1) * by_row + fields * (cycles - 1) * by_cell) / ((clusters - 1) * replicates / fields)
    beyond = max(0.0, float(means.var(ddof=1)) - noise) / clusters
    return Spread(sampling, student(clusters - 1) * math.sqrt(beyond))


# -- From landings to the answer ---------------------------------------------------------------------------------------


def share_interval(samples: Array, count: int, spread: Spread = BY_SAMPLES) -> Number:
    """Mean and 95 % interval of a share from its independent replicates.

    Half of it is the ``spread``, by default Student's t over the replicates, but no narrower than half a granule a
    replicate: balanced samples may agree on a value that is off by that much. Where all agree on 0 or 1: Wilson's
    interval for ``count`` granules.
    """
    value = float(np.mean(samples))
    replicates = len(samples)
    if np.ptp(samples) == 0.0 and value in (0.0, 1.0):
        return Number(value, *wilson(round(value * count), count))
    chosen = spread
    if spread is BY_SAMPLES:
        chosen = spread_of(samples[:, None] - value, np.zeros(replicates, dtype=np.int64), 0.0)
    half = chosen._replace(sampling=max(chosen.sampling, 0.5 * replicates / count)).together
    return Number(value, max(0.0, value - half), min(1.0, value + half))


def share_spreads(landing: Landings, bins: int, images: Sequence[int] = ()) -> list[Spread]:
    """The two parts of the interval of a fraction's share in every bin, and elsewhere: each as far as the interval
    reaches to its longer side, which of an empty bin is the only one.
    """
    spreads = []
    for tally in Tally.of_bins(landing, bins, cycles_of([landing]), images):
        alone = share_interval(tally.samples, round(landing.size), tally.spread._replace(airflow=0.0))
        spreads.append(Spread(max(alone.high - alone.value, alone.value - alone.low), tally.spread.airflow))
    return spreads


def upper_limit(count: int, total: int) -> float:
    """Upper 95 % limit (Wilson) of a share of which ``count`` of ``total`` were found."""
    return wilson(count, total)[1]


class SampleErrors(NamedTuple):
    """Roots (fractions, bins + 1, rank) of the covariance of all shares, by the finite numbers of granules and of
    shedding cycles.
    """

    sampling: Array
    airflow: Array


def sample_errors(landings: Mapping[str, Landings], bins: int, images: Sequence[int] = ()) -> SampleErrors:
    """How the errors of all shares go together, each as large as :func:`share_spreads` says: of granules as the
    replicates differ, of cycles as these do, which move all bins and all fractions at once.
    """
    cycles = cycles_of(landings.values())
    tallies = [tally for landing in landings.values() for tally in Tally.of_bins(landing, bins, cycles, images)]
    spreads = [spread for landing in landings.values() for spread in share_spreads(landing, bins, images)]
    every = np.stack([tally.deviations for tally in tallies])  # (shares, replicates, cycles)
    seen = _seen(every, tallies[0].realisation, np.array([tally.chance for tally in tallies]))
    errors = []
    for which, root in zip(Spread._fields, seen, strict=True):
        wanted = np.array([getattr(spread, which) for spread in spreads]) / SIGMAS
        errors.append(_as_seen(root, wanted).reshape(len(landings), bins + 1, -1))
    return SampleErrors(*errors)


def _seen(deviations: Array, realisation: NDArray[np.int64], chance: Array) -> tuple[Array, Array]:
    """Roots (shares, n) of covariances of the mean, as :func:`spread_of` makes its variances of ``deviations`` (shares,
    R, C): of the replicates, and of the cycles beyond what the granules in them explain.
    """
    shares, replicates, cycles = deviations.shape
    blocks = [deviations[:, realisation == number] for number in np.unique(realisation)]
    fields, free = len(blocks), replicates - len(blocks)
    middle = [block.mean(axis=(1, 2))[:, None] for block in blocks]
    rows = np.concatenate([b.mean(axis=2) - m for b, m in zip(blocks, middle, strict=True)], axis=1)
    means = np.concatenate([block.mean(axis=1) for block in blocks], axis=1)
    clusters = means.shape[1]
    of_rows = student(free or replicates - 1) / SIGMAS / np.sqrt(replicates * max(1, free))
    if clusters == 1:
        return of_rows * rows, np.zeros((shares, 1))
    rest = [b - b.mean(axis=1, keepdims=True) - b.mean(axis=2, keepdims=True) + m[:, :, None]
            for b, m in zip(blocks, middle, strict=True)]  # fmt: skip
    cells = np.concatenate([residual.reshape(shares, -1) for residual in rest], axis=1)
    by_row = cycles * (rows @ rows.T / free if free else np.diag(chance))
    by_cell = cells @ cells.T / (free * (cycles - 1)) if free and cycles > 1 else by_row
    noise = ((fields - 1) * by_row + fields * (cycles - 1) * by_cell) / ((clusters - 1) * replicates / fields)
    sizes, ways = np.linalg.eigh(np.cov(means) - noise)
    of_means = student(clusters - 1) / SIGMAS / np.sqrt(clusters)
    return of_rows * rows, of_means * ways * np.sqrt(np.clip(sizes, 0.0, None))


def _as_seen(seen: Array, wanted: Array) -> Array:
    """A root (shares, rank) of a covariance of errors that go together as those ``seen`` (shares, n), each of the
    ``wanted`` standard deviation (shares,) at least. What shows none at all, as an empty bin, goes by itself.
    """
    size = np.sqrt((seen**2).sum(axis=1))
    moves = size > TINY
    grown = np.where(moves, np.maximum(1.0, wanted / np.where(moves, size, 1.0)), 0.0)
    ways, sizes, _ = np.linalg.svd(grown[:, None] * seen, full_matrices=False)
    return np.hstack([ways * sizes, np.diag(np.where(moves, 0.0, wanted))[:, ~moves]])


def shares_in(scene: Scene, landings: Mapping[str, Landings]) -> dict[str, Array]:
    """The share of every fraction in every bin and elsewhere (bins + 1,)."""
    cycles = cycles_of(landings.values())
    return {
        name: np.array([tally.share for tally in Tally.of_bins(landing, len(scene.bin), cycles, scene.images or ())])
        for name, landing in landings.items()
    }
