"""The rounds of a run with a target error: look, choose, compute, check.

The target is met when every bin share's half width by computing alone is below it: what the scene does not say exactly
no computing time makes known. The total stands beside it, with what to measure for it to meet the target as well.
Every round is a whole run, whose stages come from the cache where an earlier round, or an interrupted run, made them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from ..pipeline.cache import Listener
from ..pipeline.compilation import COMPILED
from ..planning.plan import Plan
from ..results.landing_results import BudgetRow
from ..results.refinement import KnobSettings, Refinement, RefinementRound
from ..results.result import Result
from ..scene import Scene
from .choice import Choice, choose_surely, expected_half, reachable
from .cost import expected_seconds
from .knobs import applied, cheapest, finer, knobs, own_settings
from .unmet import told_unmet, what_to_measure

__all__ = ["refined"]

MOST_ROUNDS = 6
STAGE = "target error"  # as the listener hears of it


def refined(scene: Scene, target: float, compute: Callable[[Scene], Result], plan: Plan, listener: Listener) -> Result:
    """Run ``scene``, of this ``plan``, by ``compute`` until every bin share is known to the ``target`` (half width, by
    computing alone), or no setting brings it there. Returns the last round, saved with the table of all of them.
    Raises as the runs do.
    """
    way = _Way(scene, target, plan, listener)
    now: KnobSettings | None = cheapest(way.own, target)
    assert now is not None
    own = plan.estimate["seconds"]
    way.tell(f"first look with {_words(now)}; the scene's own settings would take about {own:.2g} s")
    choice: Choice | None = None
    while True:
        result = compute(applied(scene, now))
        table = way.judged(result, now, choice)
        result = replace(result, refinement=table)
        result.save()  # the answer so far, were the next round to be interrupted
        choice = None if len(way.rounds) == MOST_ROUNDS else way.next(result, now)
        if choice is None:
            way.tell_end(table)
            return result
        now = choice.settings


@dataclass
class _Way:
    """The rounds of one run so far, and what decides on the next."""

    scene: Scene
    target: float
    plan: Plan
    listener: Listener
    rounds: list[RefinementRound] = field(default_factory=list)
    made: set[tuple[str, float]] = field(default_factory=set)  # stages of all rounds, told apart by their run times

    @property
    def own(self) -> KnobSettings:
        """What the scene asks for."""
        return own_settings(self.scene, self.plan)

    def judged(self, result: Result, now: KnobSettings, choice: Choice | None) -> Refinement:
        """The table of all rounds, with the one that ``result`` is of."""
        rows, can = _rows(result), reachable(_rows(result), now, self.target)
        taken = ((name, stage.seconds) for name, stage in result.seconds.items() if name != str(COMPILED))
        spent = set(taken) - self.made
        self.made |= spent
        before = self.rounds[-1].settings if self.rounds else None
        self.rounds.append(
            RefinementRound(
                settings=now,
                bought="a first look" if before is None else _bought(before, now),
                expected=None if choice is None else choice.half,
                found=_largest(can),
                expected_seconds=None if choice is None else choice.seconds,
                seconds=sum(seconds for _, seconds in spent),
            )
        )
        unmet = told_unmet(rows, now, self.target, self.scene, self.plan)
        totals = [row.total.error for row in rows]
        known = [error for error in totals if error is not None]
        return Refinement(
            target=self.target,
            met=_largest(rows) <= self.target and not any(part.error is None for row in rows for part in row.parts),
            numerical=_largest(rows),
            total=max(known, default=0.0) if len(known) == len(totals) else None,
            rounds=tuple(self.rounds),
            unmet=unmet,
            measure=what_to_measure(result, self.target),
        )

    def next(self, result: Result, now: KnobSettings) -> Choice | None:
        """What to compute with next; None where that is done. Says it, and in the first round what cannot be met."""
        rows, spent = _rows(result), result.seconds
        can = reachable(rows, now, self.target)
        chosen = now
        if _largest(can) > self.target:
            chosen = choose_surely(can, spent, now, self.target).settings
        if len(can) < len(rows):  # what stays beyond the target is at least no coarser than the scene says
            chosen = finer(chosen, self.own)
        if len(self.rounds) == 1:
            self._tell_first(result, now)
        if chosen == now:
            return None
        half = max((expected_half(row, now, chosen) for row in can), default=0.0)
        choice = Choice(chosen, half, expected_seconds(spent, now, chosen))
        self.tell(
            f"found {100 * _largest(can):.2g} points; next {_words(chosen)}: {_bought(now, chosen)}, for "
            f"{100 * half:.2g} points in about {choice.seconds:.2g} s"
        )
        return choice

    def _tell_first(self, result: Result, now: KnobSettings) -> None:
        for line in told_unmet(_rows(result), now, self.target, self.scene, self.plan):
            self.tell(f"cannot be met by computing: {line}")
        for line in what_to_measure(result, self.target):
            self.tell(f"by a first look, {line}")

    def tell_end(self, table: Refinement) -> None:
        """Say whether the target is met."""
        met = "met" if table.met else "not met"
        self.tell(f"{100 * self.target:.2g} points by computing {met}: {100 * table.numerical:.2g} points")

    def tell(self, text: str) -> None:
        """A line that stays on the screen."""
        self.listener(STAGE, f"done {text}")


def _rows(result: Result) -> list[BudgetRow]:
    """The rows of shares."""
    return [row for row in result.budget if row.total.numerical is not None]


def _largest(rows: Sequence[BudgetRow]) -> float:
    return max((row.total.numerical or 0.0 for row in rows), default=0.0)


def _words(settings: KnobSettings) -> str:
    """The settings in a line."""
    values = ((knobs[name], knobs[name].of(settings)) for name in knobs)
    return ", ".join(f"{knob.name} {value:.4g}" for knob, value in values if value is not None)


def _bought(before: KnobSettings, now: KnobSettings) -> str:
    """What became finer, in words."""
    told = []
    for name in knobs:
        was, now_is = knobs[name].of(before), knobs[name].of(now)
        if was is not None and now_is is not None and was != now_is:
            told.append(f"{name} {was:.4g} to {now_is:.4g}")
    return ", ".join(told) or "nothing"
