"""Which settings to compute with next: the cheapest that are expected to meet the target.

One knob at a time is turned a step finer, always the one whose second lowers the squares of the errors beyond the
target most; what a later step has made needless is taken back in the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..budget.prediction import landed, limited_again
from ..budget.source import source_of
from ..budget.total import numerical
from ..pipeline.stages import StageTime
from ..results.landing_results import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow
from ..results.refinement import KnobSettings
from .cost import expected_seconds
from .knobs import finest_of, knobs

MARGIN = 0.9  # of the target that is aimed at: what is expected is itself an estimate
LEAST_GAIN = 1e-12  # of the squares of shares: less is nothing
QUICKEST = 1e-3  # s: a step that costs nothing still costs that


@dataclass(frozen=True)
class Choice:
    """The ``settings`` of the next round, the largest ``half`` width by computing that is expected of the rows that can
    meet the target, and the run time expected (s).
    """

    settings: KnobSettings
    half: float
    seconds: float


def expected_half(row: BudgetRow, now: KnobSettings, then: KnobSettings) -> float:
    """Half of the 95 % interval of a ``row`` by computing alone, expected with the settings ``then``, from parts that
    were found with those of ``now``.
    """
    return numerical(replace(part, error=expected_part(part, now, then)) for part in row.parts)


def expected_part(part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float | None:
    """The error of one part, likewise; None where it is unknown."""
    if part.error is None:
        return None
    if part.kind in (LEFT_OUT, NOT_COMPUTED):
        return limited_again(part.error, landed(now), landed(then))
    source = source_of(part)
    return part.error if source is None else source.expected(part, now, then)


def reachable(rows: Sequence[BudgetRow], now: KnobSettings, target: float) -> list[BudgetRow]:
    """The rows that settings can bring below the target, found with those of ``now``."""
    finest = finest_of(now)
    return [row for row in rows if expected_half(row, now, finest) <= target]


def choose(
    rows: Sequence[BudgetRow], spent: Mapping[str, StageTime], now: KnobSettings, start: KnobSettings, target: float
) -> Choice:
    """The cheapest settings, from those of ``start`` on, with which every row of ``rows`` is expected to meet the
    ``target``; ``now``: those with which the rows were found and the run times ``spent``.
    """
    chosen, way = start, []
    while (before := _excess(rows, now, chosen, target)) > 0.0:
        price = expected_seconds(spent, now, chosen)
        steps = []
        for name in knobs:
            further = knobs[name].next(chosen)
            if further is not None:
                gain = before - _excess(rows, now, further, target)
                cost = max(expected_seconds(spent, now, further) - price, QUICKEST)
                steps.append((gain / cost, name, further))
        best = max(steps, default=(0.0, "", chosen), key=lambda step: step[0])
        if best[0] <= LEAST_GAIN:
            break
        way.append(best[1])
        chosen = best[2]
    chosen = _thrifty(rows, now, chosen, way, target)
    half = max((expected_half(row, now, chosen) for row in rows), default=0.0)
    return Choice(chosen, half, expected_seconds(spent, now, chosen))


def choose_surely(
    rows: Sequence[BudgetRow], spent: Mapping[str, StageTime], now: KnobSettings, target: float
) -> Choice:
    """The cheapest settings, from those of ``now`` on, that are expected to stay within MARGIN of the ``target``; where
    what no setting lowers comes too near to it for that, to meet the target itself, and not whatever could be bought.
    """
    sure = choose(rows, spent, now, now, MARGIN * target)
    return sure if sure.half <= MARGIN * target else choose(rows, spent, now, now, target)


def _thrifty(
    rows: Sequence[BudgetRow], now: KnobSettings, chosen: KnobSettings, way: Sequence[str], target: float
) -> KnobSettings:
    """The settings without the steps that are needless beside the others, the last first."""
    if _excess(rows, now, chosen, target) > 0.0:
        return chosen
    for name in reversed(way):
        value = knobs[name].of(chosen)
        assert value is not None
        back = knobs[name].at(chosen, value / knobs[name].step)
        if _excess(rows, now, back, target) <= 0.0:
            chosen = back
    return chosen


def _excess(rows: Sequence[BudgetRow], now: KnobSettings, then: KnobSettings, target: float) -> float:
    """Sum over the rows of how far the squares of their errors lie beyond the target's."""
    return sum(max(0.0, expected_half(row, now, then) ** 2 - target**2) for row in rows)
