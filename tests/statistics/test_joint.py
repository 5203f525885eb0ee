"""The update of shares and inputs by measured ones: against closed forms, against many draws, and its test of fit."""

from dataclasses import replace

import numpy as np
import pytest
from wakeflow.statistics.joint import JointShares, misfit, tied_errors

from wakeflow.scene.measured import Measured, Tray
from wakeflow.scene.uncertainty import SIGMAS

PLACES = [("a", "left"), ("a", "right"), ("b", "left"), ("b", "right")]


def joint(errors: float = 1e-4) -> JointShares:
    slopes = np.array([[0.10, 0.0, 0.03], [-0.10, 0.0, -0.03], [0.0, 0.05, 0.02], [0.0, -0.05, -0.02]])
    tied = tied_errors(PLACES, np.full(4, errors))
    return JointShares.linear(["x", "y", "z"], PLACES, np.array([0.4, 0.6, 0.7, 0.3]), slopes, tied)


def test_one_input_and_one_tray_give_the_closed_form() -> None:
    slope, noise = 0.1, 0.02
    known = JointShares.linear(["x"], PLACES[:1], np.array([0.4]), np.array([[slope]]), np.zeros((1, 1)))
    after = known.seen(np.ones((1, 1)), np.array([0.5]), np.array([[noise**2]]))
    gain = slope / (slope**2 + noise**2)
    assert after.inputs[0] == pytest.approx(gain * 0.1)
    assert after.spread[0, 0] == pytest.approx(1.0 - gain * slope)
    assert after.shares[0] == pytest.approx(0.4 + slope * gain * 0.1)
    assert after.covariance[0, 0] == pytest.approx(1.0 / (1.0 / slope**2 + 1.0 / noise**2))


def test_trays_one_by_one_say_what_they_say_together() -> None:
    known, weights = joint(), np.eye(4)[[0, 2]]
    found, noise = np.array([0.5, 0.6]), np.diag([1e-4, 4e-4])
    at_once = known.seen(weights, found, noise)
    one_by_one = known
    for row in range(2):
        part = slice(row, row + 1)
        one_by_one = one_by_one.seen(weights[part], found[part], noise[part, part])
    for name in ("inputs", "spread", "shares", "covariance", "cross"):
        np.testing.assert_allclose(getattr(at_once, name), getattr(one_by_one, name), atol=1e-12)


def test_what_is_known_afterwards_holds_the_truth_as_often_as_it_says() -> None:
    """Many machines, drawn as the model says, three trays of each: inputs and shares within their 95 %."""
    chance, known = np.random.default_rng(3), joint()
    weights, noise = np.eye(4)[[0, 2, 3]], np.diag([1e-4, 1e-4, 4e-4])
    slopes, held = known.cross.T, np.zeros(7)
    errors = known.covariance - slopes @ slopes.T
    for _ in range(2000):
        z = chance.standard_normal(3)
        true = known.shares + slopes @ z + chance.multivariate_normal(np.zeros(4), errors)
        after = known.seen(weights, chance.multivariate_normal(weights @ true, noise), noise)
        off = np.concatenate([after.inputs - z, after.shares - true])
        apart = np.sqrt(np.concatenate([np.diag(after.spread), np.diag(after.covariance)]))
        held += np.abs(off) <= SIGMAS * apart
    assert np.all(np.abs(held / 2000 - 0.95) < 0.02)


def test_errors_of_a_fraction_sum_to_nothing_and_keep_their_own_size() -> None:
    two = tied_errors(PLACES[:2], np.array([4e-4, 4e-4]))
    np.testing.assert_allclose(two, 4e-4 * np.array([[1, -1], [-1, 1]]))
    three = tied_errors([("a", "l"), ("a", "m"), ("a", "r")], np.array([1e-4, 4e-4, 9e-4]))
    np.testing.assert_allclose(np.diag(three), [1e-4, 4e-4, 9e-4])
    assert np.linalg.eigvalsh(three)[0] > -1e-18
    assert not tied_errors(PLACES[:2], np.zeros(2)).any()


def test_the_test_of_fit_knows_how_trays_go_together() -> None:
    """Two bins of one fraction are one number: a difference that both show counts once, and one that breaks the sum of
    one counts much.
    """
    known = joint()
    shares = [
        Tray(fraction="a", bin=bin_, share=share, uncertainty=0.01) for bin_, share in (("left", 0.55), ("right", 0.45))
    ]
    both = Measured.of(shares)
    fit = misfit(known, both, both.weights(PLACES, {"a": 0.5, "b": 0.5}))
    assert fit.freedom == 2
    assert fit.chi_square == pytest.approx((0.15**2) / (0.1**2 + 0.03**2 + 1e-4 + 0.5 * (0.01 / SIGMAS) ** 2), rel=1e-3)
    assert fit.chance > 0.2
    broken = Measured.of([shares[0], shares[0].model_copy(update={"bin": "right"})])
    assert misfit(known, broken, broken.weights(PLACES, {"a": 0.5, "b": 0.5})).chance < 1e-6


def test_counted_trays_of_a_whole_fraction_lose_a_degree_of_freedom() -> None:
    known = joint()
    counted = Measured.of([Tray(fraction="a", bin="left", count=80), Tray(fraction="a", bin="right", count=120)])
    fit = misfit(known, counted, counted.weights(PLACES, {"a": 0.5, "b": 0.5}))
    assert (fit.freedom, fit.chi_square) == (1, pytest.approx(0.0, abs=1e-12))


def test_shares_in_bounds_sum_to_one_and_what_is_known_well_stays() -> None:
    known = replace(
        joint(), shares=np.array([0.97, 0.05, 1.1, -0.2]), covariance=np.diag([1e-12, 1e-2, 1e-2, 1e-2])
    )  # fmt: skip
    found = known.in_bounds().shares
    np.testing.assert_allclose(found, [0.97, 0.03, 1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(known.in_bounds().in_bounds().shares, found, atol=1e-12)
    even = replace(joint(), shares=np.array([0.5, 0.7, 0.7, 0.3]), covariance=np.zeros((4, 4))).in_bounds().shares
    np.testing.assert_allclose(even, [0.4, 0.6, 0.7, 0.3])


def test_shares_in_bounds_are_the_most_probable_of_their_sum() -> None:
    """Of independent errors, none of the shares at an end: against a minimiser."""
    spread, raw = np.array([1e-3, 4e-3, 0.0, 0.0]), np.array([0.45, 0.65, 0.7, 0.3])
    found = replace(joint(), shares=raw, covariance=np.diag(spread)).in_bounds().shares[:2]
    first = np.linspace(0.3, 0.5, 200_001)
    misfit_of = (first - raw[0]) ** 2 / spread[0] + (1.0 - first - raw[1]) ** 2 / spread[1]
    assert found[0] == pytest.approx(first[np.argmin(misfit_of)], abs=1e-6)
