"""One interval for every number that leaves the program: all parts of its error together.

What nobody knows of the scene gives a range (:mod:`.inputs`). In addition there are the parts that computing leaves:
halves of 95 % intervals (granules, shedding cycles, steps, mesh, the slab, the air's load), which count as independent
and add up in squares; and true bounds (terms left out), of which nothing is known between -bound and +bound: a
rectangular distribution of the standard deviation bound / sqrt(3) (JCGM 100:2008, 4.3.7). A part of unknown size makes
the total unknown: the row then says what to give or to run, and its interval holds what is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ..answer.shares import LEFT_OUT, MEASURED, NOT_COMPUTED, BudgetPart, BudgetRow, BudgetTotal, Separation
from ..core.number import Number
from ..planning.unknowns import SIGMAS
from ..scene import Scene
from ..statistics.separation import purity_slopes
from .source import INPUTS, budget_sources

if TYPE_CHECKING:
    from ..statistics.inputs import InputRange, Inputs

BOUNDS = (LEFT_OUT, NOT_COMPUTED)
WEIGHS = 1.0 / 3.0  # of a total: a bound larger than that must be computed, or the row says so


def remedies(names: Iterable[str]) -> list[str]:
    """What to give or to run where the sizes of these sources' errors are not known, each once."""
    found = (budget_sources[name].if_unknown for name in names if name in budget_sources)
    return list(dict.fromkeys(one for one in found if one))


def numerical(parts: Iterable[BudgetPart]) -> float:
    """Half of the 95 % interval by computing alone (granules, cycles, steps, mesh): neither inputs nor bounds."""
    computed = (part for part in parts if part.kind is None and not _beyond_computing(part.source))
    return math.sqrt(sum((part.error or 0.0) ** 2 for part in computed))


def _beyond_computing(name: str) -> bool:
    """Whether no finer computing makes a source's error smaller."""
    return name == INPUTS or (name in budget_sources and budget_sources[name].beyond_computing)


def half_of(part: BudgetPart) -> float:
    """Half of a 95 % interval that a part is worth among others."""
    error = part.error or 0.0
    return SIGMAS / math.sqrt(3.0) * error if part.kind in BOUNDS else error


def combine(value: float, parts: Sequence[BudgetPart], seconds: float) -> BudgetTotal:
    """The total of a row of a share with ``value``; ``seconds``: run time of everything that it rests on."""
    beside = math.sqrt(sum(half_of(part) ** 2 for part in parts if part.source != INPUTS))
    inputs = next((part for part in parts if part.source == INPUTS), None)
    below, above = _ends(inputs)
    low, high = max(0.0, value - math.hypot(below, beside)), min(1.0, value + math.hypot(above, beside))
    error, notes = max(value - low, high - value), []
    missing = [part.source for part in parts if part.error is None]
    if missing:
        notes.append(f"not known: {', '.join(missing)}; {'; '.join(remedies(missing))}".rstrip("; "))
    large = [part.source for part in parts if part.kind in BOUNDS and (part.error or 0.0) > WEIGHS * max(error, 1e-12)]
    if large:
        notes.append(f"mostly a bound on what is not computed: {', '.join(large)}")
    return BudgetTotal(None if missing else error, seconds, low, high, numerical(parts), "; ".join(notes) or None)


def _ends(inputs: BudgetPart | None) -> tuple[float, float]:
    """How far below and above the value the inputs reach."""
    if inputs is None or inputs.error is None:
        return 0.0, 0.0
    low = -inputs.error if inputs.low is None else inputs.low
    high = inputs.error if inputs.high is None else inputs.high
    return max(0.0, -low), max(0.0, high)


def totalled(separation: Separation, budget: Sequence[BudgetRow], inputs: Inputs | None, scene: Scene) -> Separation:
    """``separation`` with the total of its ``budget`` as the interval of every number; what was its interval, of finite
    numbers of granules and shedding cycles, is part of that. ``inputs``: what they change; None where nothing is
    uncertain.
    """
    rows = {row.quantity: row for row in budget}
    mirror = _Mirror(list(separation.bins), scene.images)
    fractions = {
        name: mirror.pooled({p: _with_total(share, rows.get(f"share.{name}.{p}")) for p, share in shares.items()})
        for name, shares in separation.fractions.items()
    }
    parts = {
        (name, place): rows[f"share.{name}.{place}"].parts if f"share.{name}.{place}" in rows else ()
        for name, shares in separation.fractions.items()
        for place in shares
    }
    made = _Combined(separation, parts, inputs, scene)
    recovery = {
        name: found and (made.recovery(name, found) if len(targets := scene.fraction[name].targets) > 1
                         else _as_share(found, fractions[name][targets[0]]))
        for name, found in separation.recovery.items()
    }  # fmt: skip
    purity = {
        place: found and {name: made.purity(name, place, pure) for name, pure in found.items()}
        for place, found in separation.purity.items()
    }
    return replace(separation, fractions=fractions, recovery=recovery, purity=mirror.pooled(purity))


@dataclass(frozen=True)
class _Mirror:
    """Pools what two bins hold that are each other's image in a machine with two equal sides; ``images`` by place, None
    where the sides differ.
    """

    bins: Sequence[str]
    images: Sequence[int] | None

    def pooled(self, found: Mapping[str, Any]) -> dict[str, Any]:
        """The numbers, or tables of numbers, by bin; a bin and its image have the mean of both."""
        if self.images is None:
            return dict(found)
        image = {place: self.bins[other] for place, other in zip(self.bins, self.images, strict=True)}
        return {place: _mean(one, found[image[place]]) for place, one in found.items()}


def _mean(one: Any, other: Any) -> Any:
    """The mean of two numbers with their intervals, or of two tables of them; None where one is none."""
    if one is None or other is None:
        return None
    if isinstance(one, Mapping):
        return {key: _mean(found, other[key]) for key, found in one.items()}
    value, low, high = (0.5 * (a + b) for a, b in zip(one, other, strict=True))
    sure = one.numerical is not None and other.numerical is not None
    return Number(value, low, high, 0.5 * (one.numerical + other.numerical) if sure else None)


def _as_share(found: Number, share: Number) -> Number:
    """A recovery in one bin, which is the share there: one number has one interval."""
    return replace(found, low=share.low, high=share.high, numerical=share.numerical)


def _with_total(share: Number, row: BudgetRow | None) -> Number:
    if row is None or row.total.low is None or row.total.high is None:
        return share
    return replace(share, low=row.total.low, high=row.total.high, numerical=row.total.numerical)


@dataclass(frozen=True)
class _Combined:
    """Totals of what is made of several shares: their errors by one source may all point one way, and count with the
    sum of their sizes.
    """

    separation: Separation
    parts: Mapping[tuple[str, str], Sequence[BudgetPart]]
    inputs: Inputs | None
    scene: Scene

    def recovery(self, name: str, found: Number) -> Number:
        """A fraction's share in its targets. Its error by a source is also that of all other bins together."""
        targets = self.scene.fraction[name].targets
        others = [place for place in self.separation.bins if place not in targets]
        weights = [{(name, place): 1.0 for place in places} for places in (targets, others)]
        inside, outside = (self._by_source(one) for one in weights)
        beside = {key: min(error, outside.get(key, 0.0)) for key, error in inside.items()}
        return _ranged(found, beside, None if self.inputs is None else self.inputs.of_share(name, targets))

    def purity(self, name: str, place: str, found: Number) -> Number:
        """A fraction's share of what is in a bin: by the slope of that with every fraction's share there."""
        own = {other: shares[place].value for other, shares in self.separation.fractions.items()}
        slopes = purity_slopes(name, self.scene.mass_shares(), own)
        beside = self._by_source({(other, place): abs(slope) for other, slope in slopes.items()})
        return _ranged(found, beside, None if self.inputs is None else self.inputs.of_purity(name, place))

    def _by_source(self, weights: Mapping[tuple[str, str], float]) -> dict[tuple[str, bool], float]:
        """Weighted sums of the errors of some shares, by source and whether it is a bound, but for what is measured on
        the number itself.
        """
        found: dict[tuple[str, bool], float] = {}
        for which, weight in weights.items():
            for part in self.parts.get(which, ()):
                if part.how != MEASURED and part.source != INPUTS:
                    key = part.source, part.kind is not None
                    found[key] = min(1.0, found.get(key, 0.0) + weight * half_of(part))
        return found


def _ranged(found: Number, beside: Mapping[tuple[str, bool], float], inputs: InputRange | None) -> Number:
    """A number with the interval that its own, other parts of its error (by source, and whether that is a bound) and
    its inputs make together.
    """
    below, above = (0.0, 0.0) if inputs is None else (max(0.0, -inputs.low), max(0.0, inputs.high))
    own = 0.5 * (found.high - found.low)
    computed = math.hypot(
        *(error for (name, bound), error in beside.items() if not bound and not _beyond_computing(name))
    )
    rest = math.hypot(*beside.values())
    low = found.value - math.hypot(found.value - found.low, rest, below)
    high = found.value + math.hypot(found.high - found.value, rest, above)
    return replace(found, low=max(0.0, low), high=min(1.0, high), numerical=math.hypot(own, computed))
