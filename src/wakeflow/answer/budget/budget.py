"""The budget: what each source of error contributes to an answer, and what knowing it cost in run time.

The sources are registered objects, a file each or a family; their parts make one total a row (:mod:`.total`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from ...core.graded import Notice, less_sure
from ...core.number import student
from ...flight.stages.pipeline import Pipeline
from ...planning.terms import TYPICAL
from ..draws import SAMPLING
from ..joint import JointAnswer
from ..shares import LEFT_OUT, BudgetPart, BudgetRow, BudgetTotal, Prices
from .source import Flights, FractionResults, in_order
from .total import Parts, in_ensemble, total_of

NOTICEABLE = 0.05  # of the error of a fraction's shares, that twice as many replicates of the slab take off
ONLY_STEPS = "of the tracker's steps alone: where 95 % of the granules land with finer ones"


def fly_again(flights: Flights) -> Flights:
    """Run what every source flies again, or read it from the cache; then the slab, as far as more of its replicates
    make the shares noticeably better known. Returns the flights with these.
    """
    for source in in_order():
        flights.of(source)
    most, slab = flights.pipeline.plan.crowd, flights.crowd
    while most is not None and slab is not None and slab.replicates < most.replicates:
        parts = {name: _parts(one) for name, one in _results(flights, flights.ensemble).items()}
        groups = 1 + max(int(one.replicate.max()) for one in slab.landings.values())
        gain = gain_by_replicates(parts, groups)
        enough = gain < NOTICEABLE
        said = f"{slab.replicates} of {most.replicates} replicates; twice as many would lower the shares' errors by "
        flights.pipeline.cache.tell("slab", f"{said}{100 * gain:.1f} %{': enough' if enough else ''}")
        if enough:
            break
        slab = flights.pipeline.crowd(beside=slab)
        flights = replace(flights, crowd=slab)
    return flights


def gain_by_replicates(parts: Parts, groups: int) -> float:
    """By which part twice as many replicates than ``groups`` would lower the errors of shares, of which the ``parts``
    of each bin of each fraction are known: the root of their squares over a fraction's bins, in the mean over the
    fractions. Student's t falls with the sampling error itself.
    """
    falls = student(2 * groups - 1) / student(groups - 1) / math.sqrt(2.0)
    gains = []
    for places in parts.values():
        every = [one for found in places.values() for one in found]
        sampled = math.hypot(*(one.error or 0.0 for one in every if one.source == SAMPLING))
        others = math.hypot(*(one.error or 0.0 for one in every if one.source != SAMPLING))
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
    pipeline, joint = flights.pipeline, flights.ensemble
    results = _results(flights, joint)
    parts = {name: _parts(fraction) for name, fraction in results.items()}
    joint = replace(in_ensemble(joint, parts, results), prices=_prices(pipeline))
    spent = sum(stage.seconds for stage in pipeline.seconds.values())
    rows = [
        BudgetRow(f"share.{name}.{place}", None, found, total_of(joint.own.share(name, place), found, spent))
        for name, places in parts.items()
        for place, found in places.items()
    ]
    return joint, (*rows, *(_landing_row(fraction) for fraction in results.values()))


def _prices(pipeline: Pipeline) -> Prices | None:
    """The scene's prices, with the power of the fan that gives the air of the answer its pressure."""
    scene, price = pipeline.scene, pipeline.scene.price
    if not price.asked:
        return None
    values = price.by_bin({name: tuple(one.targets) for name, one in scene.fraction.items()})
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


def _parts(fraction: FractionResults) -> dict[str, tuple[BudgetPart, ...]]:
    """The parts of every bin: where nothing landed, what was left out or not computed could still have brought some."""
    found = [source.shares(fraction) for source in in_order()]
    return {place: tuple(part for parts in found for part in parts.get(place, ())) for place in fraction.shares}


def _landing_row(fraction: FractionResults) -> BudgetRow:
    parts = tuple(part for source in in_order() for part in source.landing(fraction))
    spent = fraction.flights.tracking + sum(part.seconds for part in parts)
    largest = max((part.error for part in parts if part.error is not None), default=None)
    total = BudgetTotal(largest, spent, note=ONLY_STEPS)
    return BudgetRow(f"landing.{fraction.name}", fraction.pipeline.scene.unit, parts, total)


@dataclass(frozen=True)
class _Sum:
    """What the small terms of a fraction could change its share in a bin by, together."""

    error: float
    place: str
    cure: str


def _cure(small: Mapping[str, float]) -> str:
    """What makes the sum of ``small`` errors by term smaller: the largest one computed, or, where several are the least
    that so few granules can show, more of them.
    """
    most = max(small, key=lambda term: small[term])
    if sum(error >= small[most] for error in small.values()) > 1:
        return "bounds that so few granules leave: raise feed.count"
    return f"most by {most}, [force] {most} = 'on'"


def total_notices(rows: Sequence[BudgetRow], target: float) -> list[Notice]:
    """One for each fraction whose small terms, left out one by one, add up to more than the accuracy asked for."""
    worst: dict[str, _Sum] = {}
    for row in rows:
        small = {part.source: part.error or 0.0 for part in row.parts if part.kind == LEFT_OUT}
        error = TYPICAL * sum(small.values())
        name, _, place = row.quantity.removeprefix("share.").partition(".")
        if error > max(target, worst[name].error if name in worst else 0.0):
            worst[name] = _Sum(error, place, _cure(small))
    return [
        less_sure(
            f"{name}: the terms left out could change its share in {found.place} by {100 * found.error:.2g} points "
            f"together, more than the {100 * target:.2g} asked for; {found.cure}"
        )
        for name, found in worst.items()
    ]
