"""Each part of an interval by itself: the granules and steps, the inputs, the bounds, the wake's two numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...budget.source import INPUTS
from ...laws.best_estimate import Estimate, left_one_out
from ...planning.unknowns import SIGMAS
from ...results.separation import separate
from .counted import Counted
from .flown import Predicted

__all__ = ["Bounded", "LeftOne", "bounded", "inputs_alone", "left_out_wakes", "numerical_alone", "sampling_alone"]

BROWNIAN, DISPERSION = "brownian", "dispersion"
HALF_A_GRANULE = 0.5  # a change of a share is known to that much of one granule


def sampling_alone(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    """Shares with the interval of the finite number of granules, against ``truth``: the same plan, many granules."""
    found = separate(told.scene, told.flights.landings)
    for name, shares in found.fractions.items():
        for true, (place, share) in zip(truth[name], shares.items(), strict=True):
            ends = share.value, share.low, share.high
            yield Counted(told.one.name, told.one.group, f"share.{name}.{place}", *ends, float(true))


def numerical_alone(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    """Shares with the half width of computing alone, granules and steps, against the same ``truth``."""
    for name, shares in told.separation.fractions.items():
        for true, (place, share) in zip(truth[name], shares.items(), strict=True):
            half = share.numerical
            ends = (share.value, share.low, share.high) if half is None else _about(share.value, half)
            yield Counted(told.one.name, told.one.group, f"share.{name}.{place}", *ends, float(true))


def _about(value: float, half: float) -> tuple[float, float, float]:
    return value, max(0.0, value - half), min(1.0, value + half)


def inputs_alone(told: Predicted, draws: int, count: int) -> Iterator[Counted]:
    """Shares of ``count`` granules with the range of the inputs about them, against many draws of the inputs for the
    same granules.
    """
    plan = told.pipeline.plan
    given = told.truth.shares(count, plan=plan)
    made = [told.truth.shares(count, told.truth.drawn(100 + number), plan) for number in range(draws)]
    rows = {row.quantity: row for row in told.budget}
    for name, shares in told.separation.fractions.items():
        for i, place in enumerate(shares):
            row = rows.get(f"share.{name}.{place}")
            part = None if row is None else next((one for one in row.parts if one.source == INPUTS), None)
            low, high = (0.0, 0.0) if part is None else (part.low or 0.0, part.high or 0.0)
            for found in made:
                here = float(given[name][i])
                ends = here, max(0.0, here + low), min(1.0, here + high)
                yield Counted(told.one.name, told.one.group, f"share.{name}.{place}", *ends, float(found[name][i]))


@dataclass(frozen=True)
class Bounded:
    """A term that is left out: the most by which the budget says that a share could change, and the ``change`` found
    by switching it on, known to +- ``within``.
    """

    scene: str
    term: str
    quantity: str
    bound: float
    change: float
    within: float

    @property
    def held(self) -> bool:
        return self.change <= self.bound + self.within


def bounded(told: Predicted, count: int) -> Iterator[Bounded]:
    """Every term of the air that is left out and can be computed, off and on, for the same granules."""
    plan, rows = told.pipeline.plan, {row.quantity: row for row in told.budget}
    out = sorted(frozenset[str]().union(*(told.truth.switchable(name) for name in told.scene.fraction)))
    without = told.truth.shares(count, plan=plan) if out else {}
    for term in out:
        found = told.truth.shares(count, plan=told.truth.with_terms([term]))
        for name, shares in told.separation.fractions.items():
            for i, place in enumerate(shares):
                row = rows.get(f"share.{name}.{place}")
                part = None if row is None else next((one for one in row.parts if one.source == term), None)
                if part is not None and part.error is not None:
                    before, after = float(without[name][i]), float(found[name][i])
                    quantity = f"share.{name}.{place}"
                    within = HALF_A_GRANULE / count
                    if term == BROWNIAN or DISPERSION in plan.fractions[name].forces:  # other random numbers with it
                        within = SIGMAS * math.sqrt((before * (1.0 - before) + after * (1.0 - after)) / count)
                    yield Bounded(told.one.name, term, quantity, part.error, abs(after - before), within)


@dataclass(frozen=True)
class LeftOne:
    """One measured wake that is left out of the data: what it ``gave`` and the range that the others give."""

    name: str
    number: str
    gave: float
    low: float
    high: float

    @property
    def held(self) -> bool:
        return self.low <= self.gave <= self.high


def left_out_wakes() -> list[LeftOne]:
    """Theta and the strength, each measurement predicted from all others."""
    rows: list[LeftOne] = []
    for entry, gave, others in left_one_out():
        found: Estimate = others
        which = "theta" if entry.of_theta else "strength"
        rows.append(LeftOne(entry.name, which, float(np.clip(gave.value, 0.0, 1.0)), found.low, found.high))
    return rows
