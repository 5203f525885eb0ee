"""Bisection: the one search for where a condition changes that needs neither a derivative nor luck.

Both functions halve a bracket a fixed number of times, so that the answer does not depend on a tolerance or on what
else is searched beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def halved(before: Callable[[float], Any], low: float, high: float, halvings: int) -> tuple[float, float]:
    """The ends (low, high) of the bracket in which ``before`` turns from true to false, after so many ``halvings``.

    ``before`` is true at ``low`` and false at ``high``; neither end is asked. The bracket shrinks by 2^halvings, or
    until its ends are neighbours.

    >>> low, high = halved(lambda x: x * x < 2.0, 1.0, 2.0, 60)
    >>> low * low < 2.0 <= high * high
    True
    """
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if before(middle) else (low, middle)
    return low, high


def halved_all(
    before: Callable[[Array], NDArray[np.bool_]], low: Array, high: Array, halvings: int
) -> tuple[Array, Array]:
    """The same for n brackets (n,) at once: ``before`` takes the middles (n,) and tells each one's side (n,)."""
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        holds = before(middle)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return low, high
