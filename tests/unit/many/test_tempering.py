"""Draws of a posterior that is known otherwise: of normal numbers in closed form, of a bent one by a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wakeflow.answer.draws import DRAWS, column
from wakeflow.extras.trays.calibration_update import tempered

Array = NDArray[np.float64]


def _prior(many: int) -> Array:
    return np.stack([column(f"tempering.{i}") for i in range(many)], axis=1)


@pytest.mark.parametrize(("shown", "noise"), [((0.3, -0.2), 0.5), ((2.0, 1.0), 0.05), ((4.0, -3.0), 0.3)])
def test_the_posterior_of_normal_numbers_is_the_one_in_closed_form(shown: tuple[float, float], noise: float) -> None:
    """Two sums of six numbers are measured, one of them where hardly any draw was before."""
    ways = np.array([[1.0, 0.5, 0.0, 0.0, 0.2, 0.0], [0.0, -1.0, 1.0, 0.0, 0.0, 0.3]])
    exact = np.linalg.inv(np.eye(6) + ways.T @ ways / noise**2)
    mean = exact @ ways.T @ np.array(shown) / noise**2
    found = tempered(lambda draws: -0.5 * (((draws @ ways.T - shown) / noise) ** 2).sum(axis=1), _prior(6))
    assert found.shape == (DRAWS, 6)
    spread = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.05 * spread.max())
    np.testing.assert_allclose(found.std(axis=0), spread, rtol=0.05)
    told = (found - mean) @ ways.T
    np.testing.assert_allclose(told.std(axis=0), np.sqrt(np.diag(ways @ exact @ ways.T)), rtol=0.05)
    assert np.corrcoef(found.T)[0, 1] == pytest.approx(exact[0, 1] / spread[0] / spread[1], abs=0.05)


def _two_sided(draws: Array) -> Array:
    """A share that falls to both sides of an input: its measurement leaves two places, the farther less likely."""
    x = draws[:, 0]
    return np.asarray(-0.5 * (((x - 0.1) ** 2 - 1.2**2) / 0.3) ** 2)


def test_both_sides_of_a_bent_response_keep_their_draws() -> None:
    fine = np.linspace(-4.0, 4.0, 20001)
    weight = np.exp(_two_sided(fine[:, None]) - 0.5 * fine**2)
    weight /= weight.sum()
    x = tempered(_two_sided, _prior(3))[:, 0]
    right = float(weight[fine > 0.1].sum())
    assert np.mean(x > 0.1) == pytest.approx(right, abs=0.05)
    assert 0.35 < right < 0.5  # the farther one from what was known
    for side in (fine > 0.1, fine <= 0.1):
        there = x[x > 0.1] if side[-1] else x[x <= 0.1]
        part = weight[side] / weight[side].sum()
        mean = float(part @ fine[side])
        spread = float(np.sqrt(part @ (fine[side] - mean) ** 2))
        assert there.mean() == pytest.approx(mean, abs=0.05 * spread + 0.005)
        assert there.std() == pytest.approx(spread, rel=0.1)
    for level in (0.025, 0.5, 0.975):
        assert np.interp(np.quantile(x, level), fine, weight.cumsum()) == pytest.approx(level, abs=0.03)


def test_impossible_draws_are_left() -> None:
    """An order that the draws must keep."""

    def ordered(draws: Array) -> Array:
        told = -0.5 * ((draws[:, 0] - 1.0) / 0.2) ** 2
        return np.where(draws[:, 0] < draws[:, 1], told, -np.inf)

    found = tempered(ordered, _prior(2))
    assert (found[:, 0] < found[:, 1]).all()
    np.testing.assert_array_equal(tempered(ordered, _prior(2)), found)  # always the same
