"""The rounds of a run with a target error, and what no setting brings there.

The target is met when every bin share's half width by computing alone is below it: what the scene does not say exactly
no computing time makes known. The total is next to it, with what to measure for it to meet the target as well.
Every round is a whole run, whose stages come from the cache where an earlier round, or an interrupted run, made them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, sqrt

from ..answer.budget.source import INPUTS, source_of
from ..answer.provenance import RefinedSettings, Refinement, RefinementRound
from ..answer.result import Result
from ..answer.shares import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow, InputPart, InputSummary
from ..core.errors import SceneError
from ..flight.stages.compilation import COMPILED
from ..planning.make import TURNING
from ..planning.plan import Plan
from ..planning.stage_cache import Listener
from ..planning.terms import AIR, COLLISIONS, LOADING, VIBRATION, bounds, check_switches
from ..scene import Scene
from .time_budget import (
    Choice,
    RoundPrices,
    applied,
    cheapest,
    choose_surely,
    expected_half,
    expected_part,
    finer,
    finest_of,
    reachable,
    settings_of,
    values,
)

# -- What computing cannot bring to a target error ---------------------------------------------------------------------
WEIGHTY = 0.5  # of the target: a part that stays larger than that is in the way
MIN_FACTOR = 0.25  # an interval is asked to shrink to that at most, as long as others can shrink too
SPARED = 0.5  # of the target: what computing may take of it, for the inputs to have the rest
OF_THE_WAKE = "wake."  # keys of unknowns that only a resolved wake makes known
WHOLE_RUN = (COLLISIONS, VIBRATION, LOADING)  # terms that are switched for all fractions together
OTHERS: Mapping[str, str] = {  # terms that are no bounds, and what has them computed
    AIR: "compute the air (--rung draft)",
    TURNING: "release the granules above the body (--set feed.mode=resolved)",
}


@dataclass(frozen=True)
class _Obstacle:
    """A ``part`` of a fraction's error in a bin, as it is with the finest settings: too large all the same."""

    name: str
    place: str
    part: BudgetPart

    @property
    def error(self) -> float:
        return self.part.error or 0.0


def unreached_lines(
    rows: Sequence[BudgetRow], now: RefinedSettings, target: float, scene: Scene, plan: Plan
) -> tuple[str, ...]:
    """A line for each fraction and part of its error, but for the inputs, that is beyond the ``target`` however fine
    the settings; the ``rows`` were found with those of ``now``.
    """
    worst: dict[tuple[str, str], _Obstacle] = {}
    unknown: dict[str, str] = {}
    for row in rows:
        for obstacle in _obstacles(row, now, target):
            at = obstacle.name, obstacle.part.source
            if at not in worst or obstacle.error > worst[at].error:
                worst[at] = obstacle
        if any(part.error is None for part in row.parts) and row.total.note:
            unknown.setdefault(row.total.note, row.quantity.removeprefix("share."))
    lines = [_line(obstacle, scene, plan) for obstacle in sorted(worst.values(), key=lambda obstacle: -obstacle.error)]
    return (*lines, *(f"{place}: {note}" for note, place in unknown.items()))


def _obstacles(row: BudgetRow, now: RefinedSettings, target: float) -> Iterator[_Obstacle]:
    """The parts of a row that are in its way: bounds beyond the target, and what no setting computes well enough."""
    finest = finest_of(now)
    name, _, place = row.quantity.removeprefix("share.").partition(".")
    parts = (replace(part, error=expected_part(part, now, finest)) for part in row.parts if part.source != INPUTS)
    left = sorted(parts, key=lambda part: -(part.error or 0.0))
    computed = [part for part in left if not part.kind and part.error is not None]
    beyond = [part for part in left if part.kind and (part.error or 0.0) > target]
    if expected_half(row, now, finest) > target:
        beyond += computed[:1] + [part for part in computed[1:] if (part.error or 0.0) > WEIGHTY * target]
    for part in beyond:
        yield _Obstacle(name, place, part)


def _line(obstacle: _Obstacle, scene: Scene, plan: Plan) -> str:
    """One obstacle in words, with what to do."""
    source = obstacle.part.source
    where, by = f"{obstacle.name} in {obstacle.place}", f"{100 * obstacle.error:.2g} points"
    if obstacle.part.kind in (LEFT_OUT, NOT_COMPUTED):
        return f"{where}: {source} is not computed and could change it by up to {by}: {_switch(obstacle, scene, plan)}"
    return f"{where}: {source} stays at {by}: {source_of(obstacle.part).if_large}"


def _switch(obstacle: _Obstacle, scene: Scene, plan: Plan) -> str:
    """How to have a term computed, or why it cannot be."""
    source = obstacle.part.source
    if source not in bounds:
        return OTHERS.get(source, "nothing in this version computes it")
    key = source if source in WHOLE_RUN else f"{obstacle.name}.{source}"
    try:
        check_switches(plan.airflow.flown(scene), {key: True}, plan.airflow.turbulence)
    except SceneError as problem:
        return str(problem).partition(": ")[2]
    return f"--force {key}=on"


def what_to_measure(result: Result, target: float) -> tuple[str, ...]:
    """Inputs to measure for each fraction whose least certain share misses the ``target`` for its inputs, and how well,
    so that the total meets it.
    """
    landings = result.landings
    if landings is None or not landings.inputs or not landings.measure_next:
        return ()
    worst: dict[str, tuple[float, BudgetRow, float]] = {}
    for row in result.budget:
        inputs = next((part.error for part in row.parts if part.source == INPUTS), None)
        if not inputs or row.total.numerical is None:
            continue
        name, total = row.quantity.split(".")[1], hypot(inputs, row.total.numerical)
        if total > target and total > worst.get(name, (0.0,))[0]:
            worst[name] = total, row, inputs
    lines = []
    for name, (total, row, half) in worst.items():
        place = row.quantity.removeprefix(f"share.{name}.")
        parts = landings.measure_next.get(name, {}).get(place, {})
        beside = min(row.total.numerical or 0.0, SPARED * target)
        words = _measurements(parts, landings.inputs, half, sqrt(target**2 - beside**2))
        if words:
            lines.append(f"{name} in {place} is known to {100 * total:.2g} points in all: {words}")
    return tuple(lines)


def _measurements(parts: Mapping[str, InputPart], known: Mapping[str, InputSummary], half: float, room: float) -> str:
    """Which inputs to know how well, so that all of them together are worth ``room`` instead of ``half``; empty where
    they are.

    With first-order parts s_i of the variance, intervals that shrink to the factor f leave 1 - (1 - f^2) sum s_i of it.
    """
    wanted = (room / half) ** 2
    if wanted >= 1.0:
        return ""
    ranked = sorted(parts, key=lambda key: -parts[key].variance)
    removed = 0.0
    for count, key in enumerate(ranked, start=1):
        removed += parts[key].variance
        square = 1.0 - (1.0 - wanted) / removed if removed > 0.0 else 0.0
        if square >= MIN_FACTOR**2:
            return _to_measure(ranked[:count], known, sqrt(square))
    return _to_measure(ranked, known, sqrt(wanted))


def _to_measure(keys: Sequence[str], known: Mapping[str, InputSummary], factor: float) -> str:
    measured = [_interval(key, known[key], factor) for key in keys if not key.startswith(OF_THE_WAKE)]
    resolved = [_interval(key, known[key], factor) for key in keys if key.startswith(OF_THE_WAKE)]
    lines = [f"measure {', '.join(measured)}"] if measured else []
    lines += [f"run rung 3d for {', '.join(resolved)}"] if resolved else []
    return " and ".join(lines)


def _interval(key: str, known: InputSummary, factor: float) -> str:
    half, unit = 0.5 * (known.high - known.low), "" if known.unit == "1" else f" {known.unit}"
    return f"{key} to +- {factor * half:.2g}{unit} (now {half:.2g})"


# -- The rounds of a run with a target error ---------------------------------------------------------------------------
MAX_ROUNDS = 6
STAGE = "target error"  # as the listener hears of it


def refined(scene: Scene, target: float, compute: Callable[[Scene], Result], plan: Plan, listener: Listener) -> Result:
    """Run ``scene``, of this ``plan``, by ``compute`` until every bin share is known to the ``target`` (half width, by
    computing alone), or no setting brings it there. Returns the last round, saved with the table of all of them.
    Raises as the runs do.
    """
    way = _Refining(scene, target, plan, listener)
    choice = Choice(cheapest(settings_of(scene, plan), target))
    seconds = plan.estimate["seconds"]
    way.tell(f"first look with {_words(choice.settings)}; the scene's own settings would take about {seconds:.2g} s")
    while True:
        result = compute(applied(scene, choice.settings))
        table = way.judged(result, choice)
        result = replace(result, refinement=table)
        result.save()  # the answer so far, were the next round to be interrupted
        if len(way.rounds) == 1:
            way.tell_first(table)
        following = choice if len(way.rounds) == MAX_ROUNDS else way.next(result, choice.settings)
        if following.settings == choice.settings:
            way.tell_end(table)
            return result
        choice = following


@dataclass
class _Refining:
    """The rounds of one run so far, and what decides on the next."""

    scene: Scene
    target: float
    plan: Plan
    listener: Listener
    rounds: list[RefinementRound] = field(default_factory=list)
    made: set[tuple[str, float]] = field(default_factory=set)  # stages of all rounds, told apart by their run times

    def judged(self, result: Result, choice: Choice) -> Refinement:
        """The table of all rounds, with the one that ``result`` is of, whose settings were the ``choice``."""
        now, first = choice.settings, not self.rounds
        rows, can = _rows(result), reachable(_rows(result), now, self.target)
        taken = ((name, stage.seconds) for name, stage in result.seconds.items() if name != str(COMPILED))
        spent = set(taken) - self.made
        self.made |= spent
        self.rounds.append(
            RefinementRound(
                settings=now,
                bought="a first look" if first else _bought(self.rounds[-1].settings, now),
                expected=choice.half,
                found=_largest(can),
                expected_seconds=choice.seconds,
                seconds=sum(seconds for _, seconds in spent),
            )
        )
        unmet = unreached_lines(rows, now, self.target, self.scene, self.plan)
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

    def next(self, result: Result, now: RefinedSettings) -> Choice:
        """What to compute with next, which it says; the settings are those of ``now`` where nothing is to be done."""
        rows, prices = _rows(result), RoundPrices.measured(result.seconds, now)
        can = reachable(rows, now, self.target)
        chosen = now
        if _largest(can) > self.target:
            chosen = choose_surely(can, prices, self.target).settings
        if len(can) < len(rows):  # what stays beyond the target is at least no coarser than the scene says
            chosen = finer(chosen, settings_of(self.scene, self.plan))
        choice = Choice.of(can, prices, chosen)
        if chosen != now:
            self.tell(
                f"found {100 * _largest(can):.2g} points; next {_words(chosen)}: {_bought(now, chosen)}, for "
                f"{100 * choice.half:.2g} points in about {choice.seconds:.2g} s"
            )
        return choice

    def tell_first(self, table: Refinement) -> None:
        """Say what the first round shows that no other will change."""
        for line in table.unmet:
            self.tell(f"cannot be met by computing: {line}")
        for line in table.measure:
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


def _words(settings: RefinedSettings) -> str:
    """The settings in a line."""
    return ", ".join(f"{name} {value:.4g}" for name, value in values(settings).items())


def _bought(before: RefinedSettings, now: RefinedSettings) -> str:
    """What became finer, in words."""
    was, finer_ones = values(before), values(now).items()
    return ", ".join(f"{name} {was[name]:.4g} to {at:.4g}" for name, at in finer_ones if was[name] != at) or "nothing"
