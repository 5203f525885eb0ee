"""Designs: which combinations of the axes' values a sweep computes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

from ..core.errors import SceneError
from ..core.registry import Registry
from .axis import MOST_SCENES, Axis

__all__ = ["Design", "designs"]

Changes = dict[str, Any]  # dotted key to value
# (axes, count of scenes or None, seed) to the changes of every scene
Design = Callable[[Sequence[Axis], int | None, int], list[Changes]]
designs: Registry[Design] = Registry("design of a sweep")


@designs.register("grid")
def full_grid(axes: Sequence[Axis], count: int | None, seed: int) -> list[Changes]:
    """Every combination; the last axis changes fastest."""
    del seed
    _no_count("grid", count)
    _few_enough(math.prod(len(axis.values) for axis in axes))
    return [_changes(axes, row) for row in itertools.product(*(axis.values for axis in axes))]


@designs.register("list")
def listed(axes: Sequence[Axis], count: int | None, seed: int) -> list[Changes]:
    """The first value of every axis, then the second of every axis: rows of a table."""
    del seed
    _no_count("list", count)
    lengths = {axis.key: len(axis.values) for axis in axes}
    _few_enough(max(lengths.values(), default=0))
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise SceneError(f'design = "list": every key needs as many values as the others ({told})')
    return [_changes(axes, row) for row in zip(*(axis.values for axis in axes), strict=True)]


@designs.register("one-at-a-time")
def one_at_a_time(axes: Sequence[Axis], count: int | None, seed: int) -> list[Changes]:
    """The scene as it is, then every key alone at each of its values."""
    del seed
    _no_count("one-at-a-time", count)
    _few_enough(1 + sum(len(axis.values) for axis in axes))
    return [{}, *(axis.changes(value) for axis in axes for value in axis.values)]


@designs.register("latin-hypercube")
def latin_hypercube(axes: Sequence[Axis], count: int | None, seed: int) -> list[Changes]:
    """``count`` scenes, one in each of ``count`` equal parts of every range: McKay, Beckman & Conover 1979,
    Technometrics 21, 239.
    """
    from scipy.stats import qmc

    if count is None or count < 2:
        raise SceneError('design = "latin-hypercube": give count, the number of scenes, at least 2')
    _few_enough(count)
    return _drawn(axes, qmc.LatinHypercube(len(axes), rng=seed).random(count))


@designs.register("sobol")
def sobol(axes: Sequence[Axis], count: int | None, seed: int) -> list[Changes]:
    """``count`` scenes of a scrambled Sobol' sequence, which is balanced for powers of two: Owen 1998, J. Complexity
    14, 466.
    """
    from scipy.stats import qmc

    if count is None or count < 2 or count & (count - 1):
        raise SceneError('design = "sobol": give count, the number of scenes, as a power of two (8, 16, 32 ...)')
    _few_enough(count)
    return _drawn(axes, qmc.Sobol(len(axes), scramble=True, rng=seed).random(count))


def _drawn(axes: Sequence[Axis], places: Any) -> list[Changes]:
    return [_changes(axes, [axis.at(place) for axis, place in zip(axes, row, strict=True)]) for row in places.tolist()]


def _changes(axes: Sequence[Axis], row: Sequence[Any]) -> Changes:
    return {key: one for axis, value in zip(axes, row, strict=True) for key, one in axis.changes(value).items()}


def _few_enough(scenes: int) -> None:
    if scenes > MOST_SCENES:
        raise SceneError(f"a sweep of {scenes} scenes: {MOST_SCENES} at most; give fewer values, or draw a --count")


def _no_count(design: str, count: int | None) -> None:
    if count is not None:
        raise SceneError(f'design = "{design}" takes its scenes from the values; leave count out')
