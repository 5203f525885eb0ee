"""One total a row: how its parts make an interval."""

import math

import pytest

from wakeflow.answer.shares import LEFT_OUT, NOT_COMPUTED, BudgetPart
from wakeflow.budget.source import INPUTS
from wakeflow.budget.total import numerical, whole


def part(source: str, error: float | None, kind: str | None = None, **more: float) -> BudgetPart:
    return BudgetPart(source, error, 1.0, "measured", kind, **more)


def inputs(low: float, high: float) -> BudgetPart:
    return part(INPUTS, max(-low, high), low=low, high=high)


def test_independent_parts_add_up_in_squares() -> None:
    total = whole(0.5, [part("sampling", 0.03), part("mesh", 0.04)], 7.0)
    assert (total.error, total.numerical, total.seconds) == (pytest.approx(0.05), pytest.approx(0.05), 7.0)
    assert (total.low, total.high) == (pytest.approx(0.45), pytest.approx(0.55))
    assert total.note is None


def test_a_range_over_inputs_keeps_its_two_arms() -> None:
    total = whole(0.5, [inputs(-0.08, 0.03), part("sampling", 0.04)], 0.0)
    assert total.low == pytest.approx(0.5 - math.hypot(0.08, 0.04))
    assert total.high == pytest.approx(0.5 + math.hypot(0.03, 0.04))
    assert total.error == pytest.approx(0.5 - total.low)
    assert total.numerical == pytest.approx(0.04)  # inputs are not computed away


def test_a_bound_is_a_rectangular_distribution_and_no_part_of_computing() -> None:
    total = whole(0.5, [part("lift", 0.01, LEFT_OUT), part("sampling", 0.05)], 0.0)
    assert total.high == pytest.approx(0.5 + math.hypot(1.959964 / math.sqrt(3.0) * 0.01, 0.05))
    assert total.numerical == pytest.approx(0.05)
    assert total.note is None  # small beside the total


@pytest.mark.parametrize("kind", [LEFT_OUT, NOT_COMPUTED])
def test_a_row_says_when_it_is_mostly_a_bound(kind: str) -> None:
    total = whole(0.5, [part("magnus", 0.2, kind), part("sampling", 0.01)], 0.0)
    assert total.error == pytest.approx(0.226, abs=1e-3)
    assert total.note is not None
    assert "magnus" in total.note


def test_an_unknown_part_leaves_no_total_but_says_what_to_do() -> None:
    total = whole(0.5, [part("sampling", 0.01), part("mesh", None)], 0.0)
    assert total.error is None
    assert (total.low, total.high) == (pytest.approx(0.49), pytest.approx(0.51))  # of what is known
    assert total.note is not None
    assert "mesh" in total.note
    assert "numerics.rung" in total.note


def test_shares_keep_within_nothing_and_everything() -> None:
    total = whole(0.99, [inputs(-0.5, 0.5)], 0.0)
    assert (total.low, total.high) == (pytest.approx(0.49), 1.0)
    assert whole(0.0, [part("sampling", 0.02)], 0.0).low == 0.0


def test_a_range_that_leaves_the_answer_out_does_not_turn_its_interval_round() -> None:
    """All draws lie above the answer: nothing below it but the numerical part."""
    total = whole(0.5, [inputs(0.02, 0.1), part("sampling", 0.01)], 0.0)
    assert total.low == pytest.approx(0.49)
    assert total.high == pytest.approx(0.5 + math.hypot(0.1, 0.01))


def test_the_numerical_part_is_neither_inputs_nor_bounds() -> None:
    parts = [inputs(-0.3, 0.3), part("magnus", 0.2, NOT_COMPUTED), part("steps", 0.03), part("mesh", 0.04)]
    assert numerical(parts) == pytest.approx(0.05)
