"""Draws from what is known before a measurement to what it leaves: a sequential Monte Carlo.

The likelihood comes in by powers that grow from 0 to 1, each as far as half of the draws still count; the draws are
taken anew by their weights, and moved (Del Moral, Doucet & Jasra 2006, J. R. Stat. Soc. B 68, 411). A move is proposed
in turn from a normal distribution that is fitted to the draws, and as a step from where a draw is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Likelihood = Callable[[Array], Array]  # of draws (n, d): its logarithm (n,)
SEED = 20110  # of resampling and moves: any, but always the same
ENOUGH = 0.5  # of the draws must count after a power
MOVES = 4  # after each power
LAST = 8  # and after the last
ACCEPTED = 0.3  # part of the steps that is aimed at
HALVINGS = 30  # of the next power's range
RIDGE = 1e-6  # added to variances of draws


def tempered(likely: Likelihood, draws: Array) -> Array:
    """Draws (n, d) of the posterior, from ``draws`` (n, d) of independent standard normal numbers."""
    chance = np.random.default_rng(SEED)
    found, own = draws.copy(), likely(draws)
    power, scale = 0.0, 2.38 / np.sqrt(draws.shape[1])
    while power < 1.0:
        step = _step(own, 1.0 - power)
        rows = _resampled(step * own, chance)
        found, own, power = found[rows], own[rows], power + step
        for move in range(LAST if power >= 1.0 else MOVES):
            found, own, scale = _move(likely, found, own, power, scale, move, chance)
    return found


def _step(gain: Array, most: float) -> float:
    """The largest step of the power, ``most`` at most, after which enough draws count."""

    def count(step: float) -> float:
        weight = np.exp(step * (gain - gain.max()))
        return float(weight.sum() ** 2 / (weight**2).sum()) / len(gain)

    if count(most) >= ENOUGH:
        return most
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if count(middle) >= ENOUGH else (low, middle)
    return high


def _resampled(weight: Array, chance: np.random.Generator) -> NDArray[np.int64]:
    """Rows by their weights, given as logarithms (systematic resampling)."""
    part = np.exp(weight - weight.max())
    reached = np.cumsum(part / part.sum())
    return np.searchsorted(reached, (np.arange(len(part)) + chance.random()) / len(part)).clip(0, len(part) - 1)


def _move(
    likely: Likelihood, draws: Array, own: Array, power: float, scale: float, move: int, chance: np.random.Generator
) -> tuple[Array, Array, float]:
    """One move of every draw, and the scale of the next step."""
    mean, spread = draws.mean(axis=0), np.atleast_2d(np.cov(draws.T)) + RIDGE * np.eye(draws.shape[1])
    root, noise = np.linalg.cholesky(spread), chance.standard_normal(draws.shape)
    anywhere = move % 2 == 0
    there = mean + noise @ root.T if anywhere else draws + scale * noise @ root.T
    new = likely(there)
    gain = power * (new - own) - 0.5 * ((there**2).sum(axis=1) - (draws**2).sum(axis=1))
    if anywhere:
        back = np.linalg.solve(root, (draws - mean).T)
        gain += 0.5 * ((noise**2).sum(axis=1) - (back**2).sum(axis=0))
    taken = np.log(chance.random(len(draws))) < gain
    if not anywhere:
        scale *= float(np.exp(taken.mean() - ACCEPTED))
    return np.where(taken[:, None], there, draws), np.where(taken, new, own), scale
