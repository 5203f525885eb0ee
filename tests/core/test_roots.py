"""Bisection keeps its bracket about the change, halves it as often as told, and does so for many at once alike."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from wakeflow.core.roots import halved, halved_all


@pytest.mark.parametrize("halvings", [0, 1, 7, 200])
def test_the_bracket_keeps_the_change_and_shrinks_by_two_each_time(halvings: int) -> None:
    low, high = halved(lambda x: x < math.pi, 3.0, 4.0, halvings)
    assert low < math.pi <= high
    assert high - low == max(0.5**halvings, math.ulp(math.pi))


def _cube_below(value: float, x: float) -> bool:
    return x**3 < value


def test_many_brackets_at_once_give_what_each_gives_alone() -> None:
    rng = np.random.default_rng(4)
    at = rng.uniform(-5.0, 5.0, 50)
    low, high = halved_all(lambda x: x**3 < at, np.full(50, -2.0), np.full(50, 2.0), 45)
    for i, value in enumerate(at):
        assert (low[i], high[i]) == halved(partial(_cube_below, float(value)), -2.0, 2.0, 45)
    assert np.all((low**3 < at) & (at <= high**3))


def test_a_condition_that_never_changes_ends_at_the_end_it_points_to() -> None:
    assert halved(lambda _: True, 0.0, 1.0, 100)[1] == 1.0
    assert halved(lambda _: False, 0.0, 1.0, 100)[0] == 0.0


def test_nothing_to_search_is_no_error() -> None:
    low, high = halved_all(lambda x: x < 0.0, np.zeros(0), np.zeros(0), 60)
    assert low.shape == high.shape == (0,)
