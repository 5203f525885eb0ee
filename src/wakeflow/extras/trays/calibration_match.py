"""What agrees with measured shares: the numbers as stated, the least change of them that does, or a larger miss of the
model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...answer.budget.agreement import DISAGREES, Agreement
from ...answer.budget.budget import fly_again, make_budget
from ...answer.budget.source import Flights
from ...answer.joint import JointAnswer
from ...answer.result import Request, Result
from ...answer.separation import acting, responses
from ...core.errors import SceneError
from ...core.quantities import say
from ...planning.stage_cache import Listener
from ...planning.unknowns import Unknown, unknown_kinds
from ...runs.one_run import OneRun
from ...runs.run_stages import stages_of
from ...scene import Scene
from ...scene.measured import Measured
from .calibration_update import Updated, agreement_with, least_discrepancy, updated

GROWN = (3.0, 10.0, np.inf)  # times the stated uncertainty that are tried where trays contradict it; at most the span
LIKELIEST = 3  # inputs that are tried
UNLIMITED = 5.0  # times a number without a largest value, to which its uncertainty may grow


@dataclass(frozen=True)
class Matched:
    """The ``flights`` that agree with the trays; the ``update`` of them, None where nothing agrees; the ``agreement``
    of the trays with what the scene says; what must be otherwise (``conflict``).
    """

    flights: Flights
    update: Updated | None
    agreement: Agreement
    conflict: str
    run: OneRun


def _flown(
    result: Result, changes: Mapping[str, float], workers: int | None, listener: Listener
) -> tuple[Flights, OneRun]:
    """The flights of a finished run under ``changes`` of what is said of its inputs; what there is comes from the
    cache.
    """
    request = Request(None, result.options.rung, result.options.force, result.options.target_error)
    scene = Scene.parse(result.scene)
    pipeline, poured = stages_of(scene.replace(dict(changes)) if changes else scene, request, workers, listener)
    flights = fly_again(Flights.begun(pipeline))
    return flights, OneRun(scene, pipeline, poured, result.folder, result.options, redraw=False, report=True)


def matched(result: Result, measured: Measured, discrepancy: float, workers: int | None, listener: Listener) -> Matched:
    """The update of a finished run, under the numbers as stated where these agree with the trays, else under the least
    change of them that does.
    """
    flights, one_run = _flown(result, {}, workers, listener)
    if not flights.draws.unknowns:
        raise SceneError("calibrate: every number of the scene is exact; say how well they are known, [uncertainty]")
    joint, _ = make_budget(flights)
    agreement = agreement_with(joint, measured, discrepancy)
    if agreement.verdict != DISAGREES:
        return Matched(flights, updated(flights, measured, discrepancy), agreement, "", one_run)
    for unknown, half in _grown(flights, joint, agreement):
        listener("calibrate", f"trying {unknown.key} +- {half:.3g}")
        wider, _ = _flown(result, {f"uncertainty.{unknown.key}": half}, workers, listener)
        if agreement_with(make_budget(wider)[0], measured, discrepancy).verdict != DISAGREES:
            update = updated(wider, measured, discrepancy)
            return Matched(wider, update, agreement, _must_grow(unknown, update), one_run)
    least = least_discrepancy(joint, measured, discrepancy)
    if least is None:
        told = "No input of the scene and no miss of the model that would be believed explains the trays."
        return Matched(flights, None, agreement, told, one_run)
    told = (
        f"The model itself would have to miss shares by up to {100 * least:.2g} points, where {100 * discrepancy:.2g} "
        "are taken."
    )
    return Matched(flights, updated(flights, measured, least), agreement, told, one_run)


def _grown(flights: Flights, joint: JointAnswer, agreement: Agreement) -> Iterator[tuple[Unknown, float]]:
    """Inputs and uncertainties that are tried, the least growth first: those that move the granules most of the tray
    that is farthest off.
    """
    draws = flights.draws
    worst = max(agreement.trays, key=lambda tray: abs(tray.pull)).fraction
    how = responses(flights.pipeline.scene, draws)
    moves: dict[int, float] = {}
    for name in [worst] if worst is not None else list(joint.fractions):
        for place, weight in zip(acting(draws.unknowns, name), how[name].weight, strict=True):
            moves[place] = moves.get(place, 0.0) + float(weight)
    likely = sorted(moves, key=lambda place: -moves[place])[:LIKELIEST]
    tried: set[tuple[str, float]] = set()
    for times in GROWN:
        for one in (draws.unknowns[place] for place in likely):
            half = min(times * max(one.low, one.high), _most(one))
            if half > max(one.low, one.high) and (one.key, half) not in tried:
                tried.add((one.key, half))
                yield one, half


def _most(one: Unknown) -> float:
    """The largest half of an interval that says anything of a number."""
    low, high = unknown_kinds[one.kind].span
    return max(one.value - low, high - one.value) if np.isfinite(high) else UNLIMITED * abs(one.value)


def _must_grow(one: Unknown, update: Updated) -> str:
    found = update.known([other.key for other in update.unknowns].index(one.key))
    unit = one.unit
    stated = f"{say(one.value, unit, 3)} +- {say(max(one.low, one.high), unit, 2)}"
    return (
        f"{one.key} would have to be {say(found.value, unit, 3)} ({say(found.low, unit, 3)} to "
        f"{say(found.high, unit, 3)}); the scene says {stated}."
    )
