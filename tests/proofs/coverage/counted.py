"""How often intervals hold the truth, counted over many numbers: of the whole interval, and of each part by itself: the
granules and steps, the inputs, the bounds, the wake's two numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from proofs.coverage.flown import Predicted
from proofs.studies.laws import left_one_out
from wakeflow.answer.budget.source import INPUTS
from wakeflow.answer.separation import separate
from wakeflow.planning.unknowns import SIGMAS

MIN_DISTANCE = 1e-3  # a number that is nearer than that to 0 in value and truth, or to 1 in both, is known trivially
ROUND_OFF = 1e-9  # of an end of an interval


@dataclass(frozen=True)
class Counted:
    """One number of one scene: what the program says of it with the ends of an interval, and what is true."""

    scene: str
    group: str
    quantity: str
    value: float
    low: float
    high: float
    truth: float

    @property
    def error(self) -> float:
        return abs(self.truth - self.value)

    @property
    def half(self) -> float:
        return 0.5 * (self.high - self.low)

    @property
    def covered(self) -> bool:
        return self.low - ROUND_OFF <= self.truth <= self.high + ROUND_OFF

    @property
    def trivial(self) -> bool:
        """Whether the number is next to 0 both as said and in truth, or next to 1."""
        low, high = sorted((self.value, self.truth))
        return high < MIN_DISTANCE or low > 1.0 - MIN_DISTANCE


@dataclass(frozen=True)
class HeldTally:
    """Of some numbers: from how many ``scenes``, how ``many`` are not trivial, the share of these that their intervals
    hold (``coverage``) and of all with the trivial ones (``every``), the shares above and below their intervals, and
    the medians of half width and error. None where nothing was counted.
    """

    label: str
    scenes: int
    many: int
    coverage: float | None
    every: float | None
    above: float | None
    below: float | None
    half: float | None
    error: float | None

    @property
    def width(self) -> float | None:
        """Median half width over the median error."""
        return None if self.half is None or not self.error else self.half / self.error

    def table(self) -> dict[str, Any]:
        """For a report in JSON."""
        return {**asdict(self), "width": self.width}


def tally_of(label: str, rows: Sequence[Counted]) -> HeldTally:
    """What ``rows`` come to."""
    told = [row for row in rows if not row.trivial]
    scenes = len({row.scene for row in rows})
    every = float(np.mean([row.covered for row in rows])) if rows else None
    if not told:
        return HeldTally(label, scenes, 0, None, every, None, None, None, None)
    above, below = (row.truth > row.high + ROUND_OFF for row in told), (row.truth < row.low - ROUND_OFF for row in told)
    shares = [float(np.mean(list(part))) for part in ((row.covered for row in told), above, below)]
    halves = [float(np.median([getattr(row, name) for row in told])) for name in ("half", "error")]
    return HeldTally(label, scenes, len(told), shares[0], every, *shares[1:], *halves)


def counted(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    """Every share, recovery and purity of a scene against the shares that are true, by fraction (bins + 1,)."""
    one, separation = told.one, told.separation
    for name, shares in separation.fractions.items():
        for number, (place, share) in enumerate(shares.items()):
            true = float(truth[name][number])
            yield Counted(one.name, one.group, f"share.{name}.{place}", share.value, share.low, share.high, true)
    yield from _recoveries(told, truth)
    yield from _purities(told, truth)


def _recoveries(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    places = list(told.separation.bins)
    for name, found in told.separation.recovery.items():
        if found is not None and found.known:
            true = float(sum(truth[name][places.index(target)] for target in told.scene.fraction[name].targets))
            yield Counted(told.one.name, told.one.group, f"recovery.{name}", found.value, found.low, found.high, true)


def _purities(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    """None of a bin that nothing truly reaches: what is in it has no purity."""
    mass = told.scene.mass_shares()
    for number, (place, found) in enumerate(told.separation.purity.items()):
        inside = {name: mass[name] * float(truth[name][number]) for name in mass}
        total = sum(inside.values())
        for name, pure in (found or {}).items() if total > MIN_DISTANCE else ():
            label = f"purity.{place}.{name}"
            yield Counted(told.one.name, told.one.group, label, pure.value, pure.low, pure.high, inside[name] / total)


def of_kind(rows: Iterable[Counted], kind: str) -> list[Counted]:
    """The shares, recoveries or purities among ``rows``."""
    return [row for row in rows if row.quantity.startswith(f"{kind}.")]


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

    @property
    def tested(self) -> bool:
        """Whether a change of twice the bound would show."""
        return self.within <= self.bound


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


def left_out_wakes() -> list[dict[str, Any]]:
    """Theta, strength and lift, each source predicted from all others: what it ``gave``, and the range of these."""
    rows = []
    for row in left_one_out():
        value, others = float(np.clip(row["own"].value, 0.0, 1.0)), row["others"]
        ends = {"low": others.low, "high": others.high, "held": others.low <= value <= others.high}
        rows.append({"name": row["datum"], "number": row["number"], "gave": value, **ends})
    return rows
