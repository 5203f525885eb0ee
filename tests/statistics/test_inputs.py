"""The range over unknown inputs from draws: slopes, what is beyond them, and the sampling that is no part of it."""

import math

import numpy as np
import pytest
from scipy.stats import norm, qmc

from wakeflow.planning.unknowns import FARTHEST, SIGMAS, Unknown
from wakeflow.statistics.inputs import regressed

DRAWS = 64


def points(dimensions: int, seed: int) -> np.ndarray:
    """Where draws lie, as in ``pipeline.draws``."""
    sobol = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    return np.clip(norm.ppf(sobol.random(DRAWS)), -FARTHEST, FARTHEST)


def known(count: int) -> list[Unknown]:
    return [Unknown(f"number-{i}", "size", 1.0, 0.1, 0.1, "1", "the test") for i in range(count)]


def test_a_straight_response_has_the_range_of_a_sum_of_normal_numbers() -> None:
    slopes = np.array([0.02, -0.05, 0.0, 0.01])
    z = points(4, 1)
    found = regressed(z, z @ slopes, np.zeros(DRAWS), known(4))
    half = SIGMAS * float(np.linalg.norm(slopes))
    assert found.high == pytest.approx(half, rel=0.05)
    assert found.low == pytest.approx(-half, rel=0.05)
    first = found.effects[0]
    assert first.unknown.key == "number-1"
    assert first.half == pytest.approx(SIGMAS * 0.05)
    assert first.share == pytest.approx(25.0 / 30.0, abs=0.06)  # of 64 draws' own variances
    assert sum(effect.share for effect in found.effects) == pytest.approx(1.0)


def test_what_never_changes_has_no_range() -> None:
    found = regressed(points(3, 1), np.zeros(DRAWS), np.zeros(DRAWS), known(3))
    assert (found.low, found.high, found.effects) == (0.0, 0.0, ())


@pytest.mark.parametrize("granules", [32, 128])
def test_few_granules_a_draw_are_no_part_of_the_range(granules: int) -> None:
    """The change of a share from few granules, each moved or not by chance: over many tries the ranges hold what they
    say of the response itself, though the changes scatter by more.
    """
    slopes, held = np.array([0.04, 0.03, 0.02, 0.01, 0.01]), []
    spread = float(np.linalg.norm(slopes))
    for seed in range(30):
        z, chance = points(5, seed), np.random.default_rng(seed)
        moved = chance.random((DRAWS, granules)) < (0.3 + z @ slopes)[:, None]
        found = regressed(z, moved.mean(axis=1) - 0.3, moved.var(axis=1) / granules, known(5))
        held.append(norm.cdf(found.high / spread) - norm.cdf(found.low / spread))
    assert 0.93 <= np.mean(held) <= 0.975


def test_the_range_holds_what_it_says_of_responses_that_are_not_straight() -> None:
    """Shares in a bin of granules that land about a place which the inputs move, some of them by bends: over many such
    bins 93 to 97.5 % of fresh draws lie within.
    """
    held = []
    for seed in range(40):
        chance = np.random.default_rng(seed)
        many = int(chance.integers(5, 12))
        slopes = chance.normal(size=many) * np.exp(chance.normal(size=many))
        slopes *= math.exp(chance.uniform(-2.0, 0.4)) / np.linalg.norm(slopes)
        bends = np.outer(slopes, slopes) * chance.normal(size=(many, many)) * 0.2
        spread, edge = math.exp(chance.uniform(-1.5, 0.7)), chance.normal()

        def share(z: np.ndarray, slopes=slopes, bends=bends, spread=spread, edge=edge) -> np.ndarray:
            return norm.cdf((z @ slopes + ((z @ bends) * z).sum(axis=1) - edge) / spread)

        z = points(many, seed)
        own = float(share(np.zeros((1, many)))[0])
        found = regressed(z, share(z) - own, np.zeros(DRAWS), known(many))
        fresh = np.clip(chance.standard_normal((500, many)), -FARTHEST, FARTHEST)
        change = share(fresh) - own
        held.append(np.mean((change >= found.low) & (change <= found.high)))
    assert 0.93 <= np.mean(held) <= 0.975
