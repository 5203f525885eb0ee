"""What each part of a share's error would be with other settings, from what it is with those of a finished round.

Sampling falls with the granules as n^-RATE: plain Monte Carlo would give 1/2, balanced samples of few dimensions up to
1 (Owen 1997, SIAM J. Numer. Anal. 34, 1884); the rate between them is assumed, not fitted. What is an upper
limit of a counted share (steps, terms left out) is read back to the share and limited again: with few granules the
limit is most of it. The mesh's part falls as the square of a cell's edge but for what sampling makes of it; the
averages of a wake as the half width that they end at. The rest, a model's part, no setting changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import hypot, sqrt

from ..core.registry import Registry
from ..planning.plan import COMPARED, REPLICATES
from ..planning.unknowns import SIGMAS
from ..results.landing_results import LEFT_OUT, NOT_COMPUTED, BudgetPart, BudgetRow
from ..results.refinement import KnobSettings
from ..results.total import numerical

__all__ = ["expected_half", "expected_part", "predictions"]

RATE = 0.6  # of sampling with the number of granules; assumed
STEP_RATE = 1.0  # of the share that finer steps put into another bin, with the tolerance
MESH_ORDER = 2.0  # of the schemes

Prediction = Callable[[BudgetPart, KnobSettings, KnobSettings], float]
predictions: Registry[Prediction] = Registry("prediction of a part of the budget")


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
        return _limited_again(part.error, _landed(now), _landed(then), 1.0)
    if part.source in predictions:
        return predictions[part.source](part, now, then)
    return part.error


def _landed(settings: KnobSettings) -> int:
    """Granules of a fraction whose landings make the shares."""
    return settings.granules if settings.slab is None else settings.slab


def _sampled(now: KnobSettings, then: KnobSettings) -> float:
    return float((_landed(now) / _landed(then)) ** RATE)


def _of_sampling(part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float:
    assert part.error is not None
    return max(part.error * _sampled(now, then), 0.5 * REPLICATES / _landed(then))


def _of_steps(part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float:
    assert part.error is not None
    fewer = (then.tolerance / now.tolerance) ** STEP_RATE
    part_flown = COMPARED / REPLICATES
    return _limited_again(part.error, part_flown * now.granules, part_flown * then.granules, fewer)


def _of_mesh(part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float:
    assert part.error is not None
    if now.mesh_scale is None or then.mesh_scale is None:
        return part.error
    granules, sheddings = part.of_granules or 0.0, part.of_sheddings or 0.0
    own = sqrt(max(0.0, part.error**2 - granules**2 - sheddings**2))
    less = min(1.0, part.error / (hypot(granules, sheddings) or part.error or 1.0))  # noise expected, not found
    longer = 1.0 if now.averaging is None or then.averaging is None else then.averaging / now.averaging
    return hypot(
        own * (then.mesh_scale / now.mesh_scale) ** MESH_ORDER,
        less * granules * (now.granules / then.granules) ** RATE,  # grids are compared by granules alone
        less * sheddings * longer,
    )


def _of_averages(part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float:
    assert part.error is not None
    if now.averaging is None or then.averaging is None:
        return part.error
    return part.error * then.averaging / now.averaging


def _of_slab(part: BudgetPart, now: KnobSettings, then: KnobSettings) -> float:
    """A difference of replicates that go apart: sampling in all but the name."""
    assert part.error is not None
    return part.error * _sampled(now, then)


for _source, _prediction in (
    ("sampling", _of_sampling),
    ("integration", _of_steps),
    ("mesh", _of_mesh),
    ("airflow-statistics", _of_averages),
    ("slab-time-step", _of_slab),
    ("slab-depth", _of_slab),
):
    predictions.add(_source, _prediction)


def _limited_again(limit: float, count: float, again: float, times: float) -> float:
    """The upper 95 % limit of a share from ``again`` granules that is ``times`` the one whose limit from ``count`` is
    ``limit`` (Wilson's, solved for the share: it lies SIGMAS standard errors of the limit below it).
    """
    share = min(1.0, times * max(0.0, limit - SIGMAS * sqrt(limit * (1.0 - limit) / count)))
    beyond = SIGMAS**2 / again
    spread = SIGMAS * sqrt(share * (1.0 - share) / again + beyond / (4.0 * again))
    return (share + 0.5 * beyond + spread) / (1.0 + beyond)
