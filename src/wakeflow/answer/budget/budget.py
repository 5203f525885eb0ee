"""The budget: what each source of error contributes to an answer, and what knowing it cost in run time.

All parts of an answer's error are in one joint ensemble: each source is a column of it, by what it is known to be.
Halves of 95 % intervals (granules, shedding cycles, steps, mesh, the slab, the air's load) are normal; true bounds
(terms left out), of which nothing is known between -bound and +bound, are rectangular (JCGM 100:2008, 4.3.7). What one
bin of a fraction has too much by a source, its others lack. Sources of different runs are independent, but for those
that are a number of the world. A part of unknown size makes the total unknown: the row then says what to give or to
run, and its interval holds what is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core.graded import Notice, less_sure
from ...core.number import Number, student
from ...flight.stages.pipeline import Pipeline, SlabRerun
from ...flight.stages.slab_stage import SlabFound
from ...planning.terms import TYPICAL
from ...planning.unknowns import SIGMAS
from ..draws import SAMPLING, tied_root
from ..draws import ErrorSource as Column
from ..joint import JointAnswer
from ..shares import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow, BudgetTotal, Prices
from .source import INPUTS, Flights, FractionResults, budget_sources, in_order

NOTICEABLE = 0.05  # of the error of a fraction's shares, that twice as many replicates of the slab take off
ONLY_STEPS = "of the tracker's steps alone: where 95 % of the granules land with finer ones"
BOUNDS = (LEFT_OUT, NOT_COMPUTED)
WEIGHS = 1.0 / 3.0  # of a total: a bound larger than that must be computed, or the row says so
Parts = Mapping[str, Mapping[str, Sequence[BudgetPart]]]  # by fraction and bin
_OfBins = dict[str, tuple[BudgetPart, ...]]  # of a fraction


def fly_again(flights: Flights) -> Flights:
    """Run the slab where granules meet, and what every source flies again, or read it from the cache; then the slab, as
    far as more of its replicates make the shares noticeably better known. Returns the flights with these.
    """
    if flights.pipeline.plan.collisions is not None:
        flights = replace(flights, slab=(flights.pipeline.collisions(),))
    for source in in_order():
        flights.of(source)
    for slab in flights.slab:
        most = flights.pipeline.collision_stage.collisions.replicates
        while slab.replicates < most and _needs_more(flights, slab, most):
            slab = flights.pipeline.run(SlabRerun(beside=(slab,)))
            flights = replace(flights, slab=(slab,))
    return flights


def _needs_more(flights: Flights, slab: SlabFound, most: int) -> bool:
    """Whether more replicates than those of the ``slab`` would make the shares noticeably better known; says so."""
    parts = {name: _parts(fraction) for name, fraction in _results(flights, flights.ensemble).items()}
    gain = gain_by_replicates(parts, 1 + max(int(landings.replicate.max()) for landings in slab.landings.values()))
    words = f"{slab.replicates} of {most} replicates; twice as many would lower the shares' errors by "
    flights.pipeline.cache.tell("slab", f"{words}{100 * gain:.1f} %{': enough' if gain < NOTICEABLE else ''}")
    return gain >= NOTICEABLE


def gain_by_replicates(parts: Parts, groups: int) -> float:
    """Part by which twice as many replicates as ``groups`` would lower the errors of shares, of which the ``parts`` of
    each bin of each fraction are known: the root of their squares over a fraction's bins, in the mean over the
    fractions. Student's t falls with the sampling error itself.
    """
    falls = student(2 * groups - 1) / student(groups - 1) / math.sqrt(2.0)
    gains = []
    for places in parts.values():
        every = [part for of_bin in places.values() for part in of_bin]
        sampled = math.hypot(*(part.size for part in every if part.source == SAMPLING))
        others = math.hypot(*(part.size for part in every if part.source != SAMPLING))
        now = math.hypot(sampled, others)
        gains.append(1.0 - math.hypot(falls * sampled, others) / now if now else 0.0)
    return sum(gains) / len(gains)


def flights_ahead(pipeline: Pipeline) -> list[Callable[[], object]]:
    """What of :func:`fly_again` need not wait for the answer's own airflow, for another core to do meanwhile."""
    return [job for source in in_order() for job in source.ahead(pipeline)]


def make_budget(flights: Flights) -> tuple[JointAnswer, tuple[BudgetRow, ...]]:
    """The joint answer with all that is not known; and rows for the share of every fraction in every bin, also in one
    that got none, then for its landing place.

    Errors of shares are absolute; a row with a unit states its errors in that unit. The error of a landing place is
    the 95th percentile over the granules of how far the companion run moves them. A part that represents a left-out
    term has a note and a kind: left-out (small enough for the accuracy asked for) or not-computed.
    """
    joint, parts, results = _with_errors(flights)
    spent = sum(stage.seconds for stage in flights.pipeline.seconds.values())
    rows = [
        BudgetRow(f"share.{name}.{place}", None, of_bin, total_of(joint.own.share(name, place), of_bin, spent))
        for name, places in parts.items()
        for place, of_bin in places.items()
    ]
    return joint, (*rows, *map(_landing_row, results.values()))


def of_granules_alone(flights: Flights) -> JointAnswer:
    """The joint answer with all that is not known, had no granule met another."""
    return _with_errors(replace(flights, slab=()))[0]


def _with_errors(flights: Flights) -> tuple[JointAnswer, dict[str, _OfBins], dict[str, FractionResults]]:
    """The joint answer with all that is not known, the parts of its errors, and the fractions that they are of."""
    results = _results(flights, flights.ensemble)
    parts = {name: _parts(fraction) for name, fraction in results.items()}
    joint = replace(in_ensemble(flights.ensemble, parts, results), prices=_prices(flights.pipeline))
    return joint, parts, results


def _prices(pipeline: Pipeline) -> Prices | None:
    """The scene's prices, with the power of the fan that gives the air of the answer its pressure."""
    scene, price = pipeline.scene, pipeline.scene.price
    if not price.given:
        return None
    values = price.by_bin({name: tuple(fraction.targets) for name, fraction in scene.fraction.items()})
    if price.electricity is None:
        return Prices(values, None, None)
    air = None if scene.air is None else pipeline.airflow
    point = None if scene.air is None else scene.air.point
    if point is not None:
        power = price.fan_power(point.pressure, point.flow / scene.feed.depth, scene.feed.depth)
    else:
        power = 0.0 if air is None else price.fan_power(air.pressure_drop, air.flow_rate, scene.feed.depth)
    return Prices(values, power, price.electricity)


def _results(flights: Flights, joint: JointAnswer) -> dict[str, FractionResults]:
    return {name: FractionResults(name, flights.landings[name], joint.own, flights) for name in joint.fractions}


def _parts(fraction: FractionResults) -> _OfBins:
    """The parts of every bin: where nothing landed, what was left out or not computed could still have brought some."""
    by_source = [source.shares(fraction) for source in in_order()]
    return {place: tuple(part for parts in by_source for part in parts.get(place, ())) for place in fraction.shares}


def _landing_row(fraction: FractionResults) -> BudgetRow:
    parts = tuple(part for source in in_order() for part in source.landing(fraction))
    spent = fraction.flights.tracking + sum(part.seconds for part in parts)
    largest = max((part.error for part in parts if part.error is not None), default=None)
    total = BudgetTotal(largest, spent, note=ONLY_STEPS)
    return BudgetRow(f"landing.{fraction.name}", fraction.pipeline.scene.unit, parts, total)


def _cure(small: Mapping[str, float]) -> str:
    """What makes the sum of ``small`` errors by term smaller: the largest one computed, or, where several are the least
    that so few granules can show, more of them.
    """
    most = max(small, key=lambda term: small[term])
    if sum(error >= small[most] for error in small.values()) > 1:
        return "bounds that so few granules leave: raise feed.count"
    return f"most by {most}, [force] {most} = 'on'"


def total_notices(rows: Sequence[BudgetRow], target: float) -> list[Notice]:
    """A notice for each fraction whose small terms, left out one by one, add up to more than the accuracy asked for."""
    worst: dict[str, tuple[float, str]] = {}  # by fraction the largest sum, and what there is to say of it
    for row in rows:
        small = {part.source: part.size for part in row.parts if part.kind == LEFT_OUT}
        error = TYPICAL * sum(small.values())
        name, _, place = row.quantity.removeprefix("share.").partition(".")
        if error > max(target, worst[name][0] if name in worst else 0.0):
            line = f"{name}: the terms left out could change its share in {place} by {100 * error:.2g} points together"
            worst[name] = error, f"{line}, more than the {100 * target:.2g} asked for; {_cure(small)}"
    return [less_sure(text) for _, text in worst.values()]


# -- The total of a row ------------------------------------------------------------------------------------------------
def remedies(names: Iterable[str]) -> list[str]:
    """What to give or to run where the sizes of these sources' errors are not known, each once."""
    cures = dict.fromkeys(budget_sources[name].if_unknown for name in names if name in budget_sources)
    return [cure for cure in cures if cure]


def numerical(parts: Iterable[BudgetPart]) -> float:
    """Half of the 95 % interval that computing alone is expected to leave (granules, cycles, steps, mesh): of parts as
    other settings would have them, before any ensemble is there.
    """
    computed = (part for part in parts if not part.kind and not _beyond_computing(part.source))
    return math.hypot(*(part.size for part in computed))


def _beyond_computing(name: str) -> bool:
    """Whether no finer computing makes a source's error smaller."""
    return name == INPUTS or (name in budget_sources and budget_sources[name].beyond_computing)


def in_ensemble(joint: JointAnswer, parts: Parts, results: Mapping[str, FractionResults]) -> JointAnswer:
    """The ensemble with a column for each source of the ``parts``, of the fractions whose ``results`` are there."""
    columns: list[Column] = []
    every = [part for places in parts.values() for of_bin in places.values() for part in of_bin]
    bounds = {part.source: part.kind in BOUNDS for part in every if part.error is not None and part.source != INPUTS}
    for name, bounded in bounds.items():
        source = budget_sources[name] if not bounded and name in budget_sources else None
        known = () if source is None else source.column([results[fraction] for fraction in joint.fractions])
        if not known:
            halves = ([_half(name, of_bin) for of_bin in parts[fraction].values()] for fraction in joint.fractions)
            tied = np.stack([tied_root(np.array(of_fraction)) for of_fraction in halves])
            known = [Column(name, tied, computing=not bounded and not _beyond_computing(name), bounded=bounded)]
        columns += known
    return replace(joint, sources=(*joint.sources, *columns))


def _half(name: str, parts: Sequence[BudgetPart]) -> float:
    """Half of a 95 % interval that a source's parts are worth among others."""
    return math.hypot(*(part.size * (SIGMAS / math.sqrt(3.0) if part.kind in BOUNDS else 1.0)
                        for part in parts if part.source == name))  # fmt: skip


def total_of(number: Number, parts: Sequence[BudgetPart], seconds: float) -> BudgetTotal:
    """The total of a row of a share, a ``number`` of the ensemble; ``seconds``: run time of all that it rests on."""
    error, notes = max(number.value - number.low, number.high - number.value), []
    missing = [part.source for part in parts if part.error is None]
    if missing:
        notes.append(f"not known: {', '.join(missing)}; {'; '.join(remedies(missing))}".rstrip("; "))
    large = [part.source for part in parts if part.kind in BOUNDS and part.size > WEIGHS * max(error, 1e-12)]
    if large:
        notes.append(f"mostly a bound on what is not computed: {', '.join(large)}")
    end = None if missing else error
    return BudgetTotal(end, seconds, number.low, number.high, number.numerical, "; ".join(notes))
