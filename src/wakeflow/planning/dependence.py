"""How the unknowns of a scene depend on each other: what moves together, and what is never above another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.quantities import say
from ..scene import Scene
from ..scene.uncertainty import correlation_of, orders_of, said_of
from .plan import Plan
from .unknowns import Unknown, numbers, unknown_kinds

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dependence:
    """The ``correlation`` (K, K) of the ``unknowns`` (K), and each pair of numbers of which the first is never above
    the second, ``orders``: either may be exact.
    """

    unknowns: tuple[Unknown, ...]
    correlation: Array
    orders: tuple[tuple[Unknown, Unknown], ...] = ()

    @property
    def of_air(self) -> NDArray[np.bool_]:
        """Which unknowns (K,) are the air's, shared by several draws."""
        return np.array([unknown_kinds[one.kind].of_air for one in self.unknowns], dtype=bool)

    def joined(self, xi: Array) -> Array:
        """Independent standard normal numbers ``xi`` (N, K) as standard normal ones that move together; those of the
        air by each other alone, so that they stay shared. Without any correlation ``xi`` itself.
        """
        tied = np.count_nonzero(self.correlation) > len(self.unknowns)
        return correlated(xi, self.correlation, self.of_air) if tied else xi

    def kept(self, z: Array) -> NDArray[np.bool_]:
        """Which draws (N,), each unknown ``z`` (N, K) standard deviations off, keep to the orders."""
        column = {one.key: z[:, i] for i, one in enumerate(self.unknowns)}
        exact, kept = np.zeros(len(z)), np.ones(len(z), dtype=bool)
        for low, high in self.orders:
            kept &= low.all_at(column.get(low.key, exact)) <= high.all_at(column.get(high.key, exact))
        return kept

    def among(self, which: NDArray[np.bool_]) -> Dependence:
        """The same with the orders of ``which`` unknowns (K,) and exact numbers alone."""
        others = {one.key for one, own in zip(self.unknowns, which, strict=True) if not own}
        return replace(self, orders=tuple(pair for pair in self.orders if not others & {one.key for one in pair}))


def dependence(scene: Scene, plan: Plan, unknowns: Sequence[Unknown]) -> Dependence:
    """How the ``unknowns`` of ``scene`` under ``plan`` depend on each other: as the scene says of those that it names
    in any tie, the others by their common causes. Raises SceneError as :func:`orders`.
    """
    correlation, said = correlation_of(scene.uncertainty, [one.key for one in unknowns]), said_of(scene.uncertainty)
    causes = [{} if one.key in said else dict(one.causes) for one in unknowns]
    every = sorted(set().union(*causes))
    parts = np.array([[own.get(cause, 0.0) for cause in every] for own in causes]).reshape(len(causes), len(every))
    common = parts @ parts.T
    np.fill_diagonal(common, 0.0)
    return Dependence(tuple(unknowns), correlation + common, orders(scene, plan))


def orders(scene: Scene, plan: Plan) -> tuple[tuple[Unknown, Unknown], ...]:
    """Each pair of numbers that act under ``plan`` of which the first is never above the second.

    Raises SceneError where the scene's own first number is above the second.
    """
    pairs = orders_of(scene.uncertainty)
    acting = {one.key: one for one in numbers(scene, plan)} if pairs else {}
    found = tuple((acting[low], acting[high]) for low, high in pairs if low in acting and high in acting)
    for low, high in found:
        if low.value > high.value:
            own, other = (f"{one.key} = {say(one.value, one.unit, 4)}" for one in (low, high))
            raise SceneError(f"uncertainty.never_above: {own} is above {other}; change one, or leave this order out")
    return found


def correlated(xi: Array, covariance: Array, first: NDArray[np.bool_]) -> Array:
    """Independent standard normal numbers ``xi`` (N, K) as numbers with a ``covariance`` (K, K). Those that are
    ``first`` (K,) go with each other alone: what several rows have in common of them, they have in common still.
    """
    order = np.argsort(~first, kind="stable")
    found = np.empty_like(xi)
    found[:, order] = xi[:, order] @ np.linalg.cholesky(covariance[np.ix_(order, order)]).T
    return found
