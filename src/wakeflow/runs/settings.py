"""What a run's time is spent on: settings, what each would cost, and the cheapest that are expected to do.

A knob is one number of a scene. All of them together are :class:`RefinedSettings`; a number is None where the scene has
no such knob: no mesh without a solver, no averaging where nothing sheds, no slab where granules do not meet.

One knob at a time is turned a step finer, always the one whose second lowers the squares of the errors beyond the
target most; what a later step has made needless is taken back in the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, log, log2, sqrt
from typing import Any

from ..answer.budget.budget import numerical
from ..answer.budget.source import landed, limited_again, source_of
from ..answer.budget.steps import FINER, FINER_STEPS
from ..answer.provenance import RefinedSettings
from ..answer.shares import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow
from ..core.registry import Registry
from ..planning.plan import COMPARED, REPLICATES, Plan, replicate_size
from ..planning.stage_cache import StageTime
from ..planning.stages import Scaling, StageKey
from ..planning.unknowns import SIGMAS
from ..scene import Scene

# -- The knobs ---------------------------------------------------------------------------------------------------------
COARSER_MESH = 2.0  # of the cheapest pass, times the scene's own cells: an eighth of the time
MAX_COARSE = 4.0  # largest numerics.mesh_scale of a scene
LOOSER = 0.1  # of the target: a landing error that moves few granules over a bin's end
MIN_PASS_GRANULES = 256  # granules of the cheapest pass: 16 a replicate
# Granules of the cheapest pass times the target: what any answer needs, since the limit on a term left out of which
# nothing was found among them is SIGMAS^2 over their number
IN_FIRST = SIGMAS**2


@dataclass(frozen=True)
class Setting:
    """One knob: the ``field`` of :class:`RefinedSettings` that holds it, the ``key`` of a scene, the factor ``step`` of
    its next finer value, and the ``finest`` that a scene may ask for; ``name`` in words.
    """

    name: str
    field: str
    key: str
    step: float
    finest: float

    def of(self, settings: RefinedSettings) -> float | None:
        """Where the knob stands; None where the scene has no such knob."""
        value: float | None = getattr(settings, self.field)
        return value

    def at(self, settings: RefinedSettings, value: float) -> RefinedSettings:
        """The settings with the knob at a value."""
        change: dict[str, Any] = {self.field: round(value) if self.step > 1.0 else value}
        return replace(settings, **change)

    def next(self, settings: RefinedSettings) -> RefinedSettings | None:
        """One step finer; None at the finest."""
        now = self.of(settings)
        if now is None or (now * self.step - self.finest) * (self.step - 1.0) > 0.0:
            return None
        return self.at(settings, now * self.step)

    def finer(self, one: float, other: float) -> float:
        """The finer of two values."""
        return max(one, other) if self.step > 1.0 else min(one, other)


knobs: Registry[Setting] = Registry("knob")
for _knob in (
    Setting("granules", "granules", "feed.count", 2.0, 2**23),
    Setting("tolerance", "tolerance", "numerics.tolerance", 10**-0.5, 1e-9),
    Setting("mesh", "mesh_scale", "numerics.mesh_scale", sqrt(0.5), 0.2),
    Setting("averaging", "averaging", "numerics.averaging", sqrt(0.5), 0.002),
    Setting("slab", "slab", "collisions.count", 2.0, 2**17),
):
    knobs.add(_knob.name, _knob)


def own_settings(scene: Scene, plan: Plan) -> RefinedSettings:
    """What the scene itself asks for, under its ``plan``."""
    solved = plan.airflow.stepping is not None and plan.airflow.span is None
    sheds = solved and plan.airflow.stepping == "time-resolved"
    return RefinedSettings(
        granules=REPLICATES * replicate_size(scene.feed.count),
        tolerance=scene.numerics.tolerance,
        mesh_scale=scene.numerics.mesh_scale if solved else None,
        averaging=plan.airflow.accuracy if sheds else None,
        slab=None if plan.crowd is None else plan.crowd.count,
    )


def cheapest(own: RefinedSettings, target: float) -> RefinedSettings:
    """Of the first pass, which measures how the errors stand: never finer than the scene's ``own``."""
    count = max(MIN_PASS_GRANULES, 2 ** ceil(log2(IN_FIRST / target)))
    mesh = None if own.mesh_scale is None else max(own.mesh_scale, min(COARSER_MESH * own.mesh_scale, MAX_COARSE))
    return replace(
        own,
        granules=min(own.granules, count),
        tolerance=max(own.tolerance, LOOSER * target),
        mesh_scale=mesh,
        slab=None if own.slab is None else min(own.slab, count),
    )


def finer(one: RefinedSettings, other: RefinedSettings) -> RefinedSettings:
    """Every knob at the finer of two settings."""
    for knob in _present(one):
        here, there = knob.of(one), knob.of(other)
        assert here is not None
        one = knob.at(one, here if there is None else knob.finer(here, there))
    return one


def finest_of(settings: RefinedSettings) -> RefinedSettings:
    """Every knob at the end of its steps."""
    for knob in _present(settings):
        while (further := knob.next(settings)) is not None:
            settings = further
    return settings


def applied(scene: Scene, settings: RefinedSettings) -> Scene:
    """The scene with the settings in it."""
    return scene.replace({knob.key: knob.of(settings) for knob in _present(settings)})


def _present(settings: RefinedSettings) -> Iterator[Setting]:
    return (knobs[name] for name in knobs if knobs[name].of(settings) is not None)


# -- What a round would cost -------------------------------------------------------------------------------------------
OVERHEAD = 0.4  # s of a stage in which granules fly, however few they are
MIN_POWER, MAX_POWER = 0.02, 0.34  # of a flight's time with its tolerance: from one step a cell to order three


def expected_seconds(spent: Mapping[str, StageTime], now: RefinedSettings, then: RefinedSettings) -> float:
    """Run time (s) of a round with the settings ``then``, from what the stages of one with those of ``now`` took."""
    if then == now:
        return 0.0
    slab_only = all(getattr(then, key) == getattr(now, key) for key in ("granules", "tolerance", "mesh_scale"))
    same_air = (then.mesh_scale, then.averaging) == (now.mesh_scale, now.averaging)
    power, whole = _power(spent), 0.0
    for name, stage in spent.items():
        match StageKey.of(name).stage.scaling:
            case Scaling.AIR | Scaling.CELLS as scaling:
                whole += 0.0 if same_air else stage.seconds * _air_factor(scaling, now, then)
            case Scaling.SLAB:
                whole += stage.seconds * (then.slab or 1) / (now.slab or 1)
            case Scaling.FLIGHTS if not (slab_only and same_air):
                whole += OVERHEAD + max(0.0, stage.seconds - OVERHEAD) * _flight_factor(power, now, then)
    return whole


def _air_factor(scaling: Scaling, now: RefinedSettings, then: RefinedSettings) -> float:
    """Steps go with the cells' edges, averages with the square of what they are known to."""
    finer = (now.mesh_scale or 1.0) / (then.mesh_scale or 1.0)
    longer = (now.averaging or 1.0) / (then.averaging or 1.0)
    return float(finer**2 if scaling is Scaling.CELLS else finer**3 * longer**2)


def _flight_factor(power: float, now: RefinedSettings, then: RefinedSettings) -> float:
    crossed = (now.mesh_scale or 1.0) / (then.mesh_scale or 1.0)  # cells on a granule's way
    return float(then.granules / now.granules * (now.tolerance / then.tolerance) ** power * crossed)


def _power(spent: Mapping[str, StageTime]) -> float:
    """Of a flight's time with its tolerance, as the companion with finer steps shows it."""
    own, finer = spent.get("tracks"), spent.get(FINER_STEPS)
    if own is None or finer is None or min(own.seconds, finer.seconds) <= 2.0 * OVERHEAD:
        return MIN_POWER
    slower = finer.seconds / own.seconds * REPLICATES / COMPARED
    return min(max(log(max(slower, 1.0)) / log(1.0 / FINER), MIN_POWER), MAX_POWER)


# -- Which settings to compute with next -------------------------------------------------------------------------------
MARGIN = 0.9  # of the target that is aimed at: what is expected is itself an estimate
MIN_GAIN = 1e-12  # of the squares of shares: less is nothing
QUICKEST = 1e-3  # s: a step that costs nothing still costs that


@dataclass(frozen=True)
class Choice:
    """The ``settings`` of the next round, the largest ``half`` width by computing that is expected of the rows that can
    meet the target, and the run time expected (s).
    """

    settings: RefinedSettings
    half: float
    seconds: float


def expected_half(row: BudgetRow, now: RefinedSettings, then: RefinedSettings) -> float:
    """Half of the 95 % interval of a ``row`` by computing alone, expected with the settings ``then``, from parts that
    were found with those of ``now``.
    """
    return numerical(replace(part, error=expected_part(part, now, then)) for part in row.parts)


def expected_part(part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float | None:
    """The error of one part, likewise; None where it is unknown."""
    if part.error is None:
        return None
    if part.kind in (LEFT_OUT, NOT_COMPUTED):
        return limited_again(part.error, landed(now), landed(then))
    source = source_of(part)
    return part.error if source is None else source.expected(part, now, then)


def reachable(rows: Sequence[BudgetRow], now: RefinedSettings, target: float) -> list[BudgetRow]:
    """The rows that settings can bring below the target, found with those of ``now``."""
    finest = finest_of(now)
    return [row for row in rows if expected_half(row, now, finest) <= target]


def choose(
    rows: Sequence[BudgetRow],
    spent: Mapping[str, StageTime],
    now: RefinedSettings,
    start: RefinedSettings,
    target: float,
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
        if best[0] <= MIN_GAIN:
            break
        way.append(best[1])
        chosen = best[2]
    chosen = _thrifty(rows, now, chosen, way, target)
    half = max((expected_half(row, now, chosen) for row in rows), default=0.0)
    return Choice(chosen, half, expected_seconds(spent, now, chosen))


def choose_surely(
    rows: Sequence[BudgetRow], spent: Mapping[str, StageTime], now: RefinedSettings, target: float
) -> Choice:
    """The cheapest settings, from those of ``now`` on, that are expected to stay within MARGIN of the ``target``; where
    what no setting lowers comes too near to it for that, to meet the target itself, and not whatever could be bought.
    """
    sure = choose(rows, spent, now, now, MARGIN * target)
    return sure if sure.half <= MARGIN * target else choose(rows, spent, now, now, target)


def _thrifty(
    rows: Sequence[BudgetRow], now: RefinedSettings, chosen: RefinedSettings, way: Sequence[str], target: float
) -> RefinedSettings:
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


def _excess(rows: Sequence[BudgetRow], now: RefinedSettings, then: RefinedSettings, target: float) -> float:
    """Sum over the rows of how far the squares of their errors lie beyond the target's."""
    return sum(max(0.0, expected_half(row, now, then) ** 2 - target**2) for row in rows)
