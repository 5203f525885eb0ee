"""Which airflow of a sweep starts from which: told by the inputs alone, so that every order of work and every machine
starts them alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["starts"]


def starts(points: Sequence[Mapping[str, Any]]) -> list[int | None]:
    """For each of the ``points`` (inputs by dotted key) the place of the one that it starts from; None for the most
    central one, which starts from rest.

    Whoever is farthest from those that are there comes next, and starts from the nearest of them (farthest-first
    traversal: Gonzalez 1985, Theor. Comput. Sci. 38, 293): few wait for few. Numbers are compared over the range that
    the points span, other values by whether they are the same.
    """
    count = len(points)
    found: list[int | None] = [None] * count
    if not count:
        return found
    apart = _distances(points)
    near = np.full(count, int(apart.sum(axis=1).argmin()))
    there = np.arange(count) == near[0]
    for _ in range(count - 1):
        away = np.where(there, -1.0, apart[np.arange(count), near])
        new = int(away.argmax())
        found[new] = int(near[new])
        there[new] = True
        near = np.where(apart[:, new] < apart[np.arange(count), near], new, near)
    return found


def _distances(points: Sequence[Mapping[str, Any]]) -> NDArray[np.float64]:
    """Between all of the points, (n, n)."""
    squares = np.zeros((len(points), len(points)))
    for key in sorted({key for point in points for key in point}):
        values = [point.get(key) for point in points]
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            numbers = np.array(values, dtype=float)
            squares += ((numbers[:, None] - numbers) / (np.ptp(numbers) or 1.0)) ** 2
        else:
            squares += [[float(one != other) for other in values] for one in values]
    return np.asarray(np.sqrt(squares))
