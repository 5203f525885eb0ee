"""All exact problems and numbers flown by the tracker: error, cost, order, and whether the stated error covers the
actual one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from proofs.problems import ensembles, flights, memory, terms
from proofs.problems.exact import Answer, accepts, exact_numbers, exact_problems, fly
from wakeflow.core.errors import SceneError

Array = NDArray[np.float64]
FLOOR = 1e-12  # m: errors below it are round-off of coordinates of about 1 m, added up over steps
COLUMNS = {
    "problem": "{problem}", "tolerance": "{tolerance:.0e}", "error (m)": "{error:.1e}", "steps": "{steps:.0f}",
    "order": "{order:.2f}", "expected": "{expected_order:g}", "error / tolerance": "{ratio:.1e}",
}  # fmt: skip
NUMBERS = {
    "number": "{number}", "what": "{label}", "value": "{value:g}", "from": "{low:g}", "to": "{high:g}",
    "exact": "{exact:g}",
}  # fmt: skip
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
MODULES = (flights, terms, ensembles, memory)  # importing them registers their problems


@dataclass(frozen=True, eq=False)
class FlightErrors:
    """One flight of a problem at one ``tolerance``, per granule (n,): ``error`` of the end position in m, error of
    the end ``time`` in s, of ``velocity`` in m/s and ``spin`` in rad/s (0 where no answer is known), ``steps`` and
    ``evaluations`` (steps where the tracker does not count them); ``astray``: how many have another fate than the exact
    one.
    """

    tolerance: float
    error: Array
    time: Array
    velocity: Array
    spin: Array
    steps: Array
    evaluations: Array
    astray: int


def fly_at_tolerances(
    name: str, tolerances: Sequence[float] = TOLERANCES, cells: int | None = None, *, march: bool = True
) -> list[FlightErrors]:
    """Fly a problem at each tolerance; without ``march`` in third-order steps alone, whose order can be observed.

    Raises SceneError for an unknown problem, or a force that is not computed.
    """
    setting, answer = exact_problems[name].at(cells)
    forces = exact_problems[name].forces
    missing = [force for force in forces if not accepts(force)]
    if missing:
        raise SceneError(f"problem {name}: the tracker does not compute {', '.join(missing)}")
    return [_outcome(fly(setting, tolerance, march=march), answer, tolerance) for tolerance in tolerances]


def _outcome(tracks: Any, answer: Answer, tolerance: float) -> FlightErrors:
    nothing = np.zeros(len(tracks))
    wrong = nothing if answer.fate is None else tracks.fate != answer.fate
    time = nothing if answer.time is None else np.abs(tracks.time - answer.time)
    velocity = nothing if answer.velocity is None else np.linalg.norm(tracks.velocity - answer.velocity, axis=1)
    spin = nothing if answer.spin is None else np.abs(tracks.spin - answer.spin)
    return FlightErrors(
        tolerance, np.linalg.norm(tracks.position - answer.position, axis=1), time, velocity, spin, tracks.steps,
        getattr(tracks, "evaluations", tracks.steps), int(np.sum(wrong)),
    )  # fmt: skip


def order_in_steps(outcomes: Sequence[FlightErrors], granule: int, floor: float = FLOOR) -> float | None:
    """Slope of log error against log mean step of one granule: the least-squares line through the finest five flights
    above ``floor`` (m), since errors at the coarsest steps may be small by chance.

    None where there are fewer than three, or their steps do not span a factor of two.
    """
    pairs = [(float(o.steps[granule]), float(o.error[granule])) for o in outcomes]
    pairs = sorted(pair for pair in pairs if pair[1] > floor)[-5:]
    if len(pairs) < 3 or pairs[-1][0] < 2 * pairs[0][0]:
        return None
    steps, errors = np.array(pairs).T
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


def run_problems(
    progress: Callable[[int, int], object] | None = None, tolerances: Sequence[float] = TOLERANCES
) -> list[dict[str, Any]]:
    """Every problem whose forces the tracker computes: one row a problem and tolerance, the worst granule's numbers.

    Keys: problem, means, source, tags, cells, tolerance, error (m), steps, evaluations (means over granules), ratio
    (error / tolerance), order (without marching, median over granules; None where exact or too few steps),
    expected_order, astray.
    """
    rows = []
    for done, name in enumerate(names := [n for n in exact_problems if all(map(accepts, exact_problems[n].forces))]):
        entry, outcomes = exact_problems[name], fly_at_tolerances(name, tolerances)
        length = float(entry.at()[0].arguments.get("length", 1.0))
        alone = fly_at_tolerances(name, tolerances, march=False)
        orders = [order_in_steps(alone, i) for i in range(len(alone[0].error))]
        known = [order for order in orders if order is not None]
        for o in outcomes:
            worst = float(o.error.max())
            rows.append({
                "problem": name, "means": entry.means, "source": entry.source, "tags": sorted(entry.tags),
                "cells": entry.cells, "tolerance": o.tolerance, "error": worst, "steps": float(o.steps.mean()),
                "evaluations": float(o.evaluations.mean()), "ratio": worst / (o.tolerance * length),
                "order": float(np.median(known)) if known else None, "expected_order": entry.order,
                "astray": o.astray,
            })  # fmt: skip
        if progress is not None:
            progress(done + 1, len(names))
    return rows


def _bound(value: float) -> float | None:
    """An end of an interval; None where it has none there."""
    return float(value) if np.isfinite(value) else None


def run_numbers(progress: Callable[[int, int], object] | None = None, tolerance: float = 1e-5) -> list[dict[str, Any]]:
    """Every number whose forces the tracker computes, one row a value: number, label, value, low, high, exact, holds,
    source.
    """
    rows = []
    for done, name in enumerate(names := [n for n in exact_numbers if all(map(accepts, exact_numbers[n].forces))]):
        entry = exact_numbers[name]
        for k, value in enumerate(entry.measure(tolerance)):
            exact = None if entry.exact is None else float(entry.exact[k])
            rows.append({
                "number": name, "label": entry.labels[k], "value": float(value), "low": _bound(entry.low[k]),
                "high": _bound(entry.high[k]), "exact": exact,
                "holds": bool(entry.low[k] <= value <= entry.high[k]), "source": entry.source,
            })  # fmt: skip
        if progress is not None:
            progress(done + 1, len(names))
    return rows
