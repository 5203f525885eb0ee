"""All shares of an answer together with the inputs that move them: what one number that becomes known says of the rest.

Shares are linear in the inputs, which are counted in standard deviations of what was known of them before:
share = middle + slopes z + error, z ~ N(0, 1). A measurement of some shares updates all of them and the inputs (linear
Gaussian update, as of a Kalman filter: Tarantola 2005, Inverse Problem Theory, sec. 3.2). What is not linear is flown
again about the new inputs and updated from the start until that moves nothing (iterated: Gu & Oliver 2007, SPE J. 12,
438; Iglesias, Law & Stuart 2013, Inverse Problems 29, 045001); :mod:`wakeflow.batch.calibration` does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..core.number import Number
from ..planning.unknowns import SIGMAS
from ..scene.measured import Measured

Array = NDArray[np.float64]
Place = tuple[str, str]  # a fraction and a bin
TINY = 1e-10  # of the largest eigenvalue: a combination of trays that is known no better is no test of its own


@dataclass(frozen=True)
class JointShares:
    """``shares`` (S,) of the ``places`` with their ``covariance`` (S, S); ``inputs`` (K,) by their ``keys``, in
    standard deviations of what was known of them at first, with their ``spread`` (K, K); ``cross`` (K, S): covariance
    of both.
    """

    keys: tuple[str, ...]
    places: tuple[Place, ...]
    inputs: Array
    spread: Array
    shares: Array
    covariance: Array
    cross: Array

    @classmethod
    def linear(
        cls, keys: Sequence[str], places: Sequence[Place], middle: Array, slopes: Array, errors: Array
    ) -> JointShares:
        """Of shares ``middle`` (S,) + ``slopes`` (S, K) z + an error of the covariance ``errors`` (S, S)."""
        many = len(keys)
        return cls(
            tuple(keys), tuple(places), np.zeros(many), np.eye(many), middle, slopes @ slopes.T + errors, slopes.T
        )

    def seen(self, weights: Array, found: Array, noise: Array) -> JointShares:
        """What is known once ``weights`` (n, S) times the shares were measured: ``found`` (n,), with the covariance
        ``noise`` (n, n).
        """
        tray = weights @ self.covariance @ weights.T + noise
        to_shares, to_inputs = self.covariance @ weights.T, self.cross @ weights.T
        gain, gain_inputs = (np.linalg.lstsq(tray, one.T, rcond=TINY)[0].T for one in (to_shares, to_inputs))
        off = found - weights @ self.shares
        return replace(
            self,
            inputs=self.inputs + gain_inputs @ off,
            spread=_symmetric(self.spread - gain_inputs @ to_inputs.T),
            shares=self.shares + gain @ off,
            covariance=_symmetric(self.covariance - gain @ to_shares.T),
            cross=self.cross - gain_inputs @ to_shares.T,
        )

    def in_bounds(self) -> JointShares:
        """The same with each fraction's shares from 0 to 1 and of sum 1: what they have too much or too little goes to
        each in proportion to its variance, as the most probable shares of that sum have it where they are independent.
        """
        shares, variances = self.shares.copy(), np.clip(np.diag(self.covariance), 0.0, None)
        for name in dict.fromkeys(name for name, _ in self.places):
            free = np.array([other == name for other, _ in self.places])
            mine = free.copy()
            while free.any():
                rest, part = 1.0 - shares[mine].sum(), variances[free]
                shares[free] += rest * (part / part.sum() if part.sum() > 0.0 else 1.0 / free.sum())
                if not (below := free & (shares < 0.0)).any():
                    break
                shares[below], free = 0.0, free & ~below
        return replace(self, shares=shares)

    def half(self, weights: Array) -> float:
        """Half of the 95 % interval of ``weights`` (S,) times the shares."""
        return SIGMAS * sqrt(max(0.0, float(weights @ self.covariance @ weights)))

    def number(self, weights: Array) -> Number:
        """A sum of shares, ``weights`` (S,) of each, with its 95 % interval within 0 and 1."""
        value, half = float(np.clip(weights @ self.shares, 0.0, 1.0)), self.half(weights)
        return Number(value, max(0.0, value - half), min(1.0, value + half))

    def tray(self, fraction: str, bins: Sequence[str]) -> Array:
        """The weights (S,) of a fraction's share in any of ``bins``."""
        return np.array([float(name == fraction and place in bins) for name, place in self.places])


def tied_errors(places: Sequence[Place], variances: Array) -> Array:
    """The covariance (S, S) of errors of shares whose ``variances`` (S,) are known: what one bin has too much of a
    fraction, its others lack, so that each fraction's errors sum to nothing; each keeps its own variance.
    """
    made = np.zeros((len(places), len(places)))
    for name in dict.fromkeys(name for name, _ in places):
        mine = [i for i, (other, _) in enumerate(places) if other == name]
        own = variances[mine]
        if (total := float(own.sum())) <= 0.0:
            continue
        block = np.diag(own) - np.outer(own, own) / total
        scale = np.sqrt(np.divide(own, np.diag(block), out=np.zeros_like(own), where=np.diag(block) > 0.0))
        made[np.ix_(mine, mine)] = block * np.outer(scale, scale)
    return made


@dataclass(frozen=True)
class Misfit:
    """How far measured shares lie from what was expected: ``chi_square`` over so many free numbers (``freedom``), how
    probable one as large is (``chance``), and of each tray its distance from what all others let expect, ``pulls``
    (n,), in standard deviations.
    """

    chi_square: float
    freedom: int
    chance: float
    pulls: Array


def misfit(known: JointShares, measured: Measured, weights: Array) -> Misfit:
    """Of ``measured`` shares, each ``weights`` (n, S) of those that are ``known`` before it."""
    from scipy.special import chdtrc

    off = measured.shares - weights @ known.shares
    inverse, freedom = _inverse(weights @ known.covariance @ weights.T + measured.covariance)
    square = float(off @ inverse @ off)
    alone = np.diag(inverse)
    pulls = np.divide(inverse @ off, np.sqrt(alone), out=np.zeros_like(off), where=alone > 0.0)
    return Misfit(square, freedom, float(chdtrc(freedom, square)), pulls)


def _inverse(covariance: Array) -> tuple[Array, int]:
    """The inverse over the combinations that are free, and how many these are."""
    sizes, ways = np.linalg.eigh(covariance)
    free = sizes > TINY * max(float(sizes.max()), TINY)
    return (ways[:, free] / sizes[free]) @ ways[:, free].T, int(free.sum())


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))
