"""What measured shares say of all shares and inputs: the update, and the rounds of flights about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..answer.shares import BudgetRow
from ..budget.agreement import Agreement, agreement_of, other_errors
from ..budget.source import Flights
from ..core.errors import SceneError, known
from ..core.number import Number
from ..pipeline.input_samples import Ensemble
from ..planning.unknowns import SIGMAS, Unknown
from ..scene.measured import Measured
from ..statistics.inputs import Inputs, Response
from ..statistics.joint import JointShares, Place, tied_errors

Array = NDArray[np.float64]
DISCREPANCY = 0.02  # half of the 95 % interval by which the model itself may miss a share of a half. Chosen
LEAST_DISCREPANCY = 0.1  # of that, for a share of 0 or 1
MOST_ROUNDS = 5  # of flights
STANDS = 0.25  # standard deviations by which an input may still move at the end
DAMPED_FROM = 3  # rounds after which half of a step is taken: the draws' noise must not carry it to and fro
NARROWEST = 0.5  # standard deviations of the first range: narrower draws would show nothing but noise


@dataclass(frozen=True)
class Updated:
    """What is known of all shares and inputs, ``before`` the measurement and ``after`` it; the ``agreement`` of the
    measurement with what was known before, about the inputs that came out; ``rounds`` of flights, and whether the last
    moved no input (``stands``).
    """

    unknowns: tuple[Unknown, ...]
    before: JointShares
    after: JointShares
    agreement: Agreement
    rounds: int
    stands: bool


def discrepancy_of(places: Sequence[Place], shares: Mapping[str, Mapping[str, Number]], half: float) -> Array:
    """The covariance (S, S) of what the model itself may miss shares by; ``half`` of the 95 % interval at a share of a
    half, less towards 0 and 1, and nowhere nothing.
    """
    value = np.clip([shares[name][place].value for name, place in places], 0.0, 1.0)
    halves = half * (LEAST_DISCREPANCY + (1.0 - LEAST_DISCREPANCY) * 2.0 * np.sqrt(value * (1.0 - value)))
    return tied_errors(places, (halves / SIGMAS) ** 2)


def updated(
    flights: Flights,
    shares: Mapping[str, Mapping[str, Number]],
    budget: Sequence[BudgetRow],
    measured: Measured,
    discrepancy: float = DISCREPANCY,
) -> Updated:
    """What ``measured`` says of the ``shares`` of ``flights``, whose errors by other sources than the inputs are in the
    ``budget``, and of their inputs.

    Raises SceneError where everything is known exactly, and for a tray of a fraction or bin that there is not.
    """
    inputs, mass = flights.inputs(shares), flights.pipeline.scene.mass_shares()
    if inputs is None:
        raise SceneError("calibrate: every number of the scene is exact; say how well they are known, [uncertainty]")
    places = [(name, place) for name, found in shares.items() for place in found]
    weights = measured.weights(places, mass)
    errors = other_errors(places, shares, budget), discrepancy_of(places, shares, discrepancy)
    first = joint = _linearised(inputs, places, *errors, np.zeros(len(inputs.draws.unknowns)))
    found, centre, rounds, stands = joint.seen(weights, measured.shares, measured.covariance), joint.inputs, 1, False
    while rounds < MOST_ROUNDS and not stands:
        step = found.inputs - centre
        centre = centre + (step if rounds < DAMPED_FROM else 0.5 * step)
        draws = known(flights.pipeline.draws_of(Ensemble(centre, _wide_enough(found.spread))))
        about = replace(inputs, draws=replace(draws, z=draws.z - centre), images=None)
        joint = _linearised(about, places, *errors, centre)
        found, rounds = joint.seen(weights, measured.shares, measured.covariance), rounds + 1
        stands = bool(np.max(np.abs(found.inputs - centre)) <= STANDS)
    return Updated(
        tuple(inputs.draws.unknowns), first, found, agreement_of(first, measured, mass, joint), rounds, stands
    )


def _linearised(
    inputs: Inputs, places: Sequence[Place], others: Array, discrepancy: Array, centre: Array
) -> JointShares:
    """The shares about the inputs at ``centre`` (K,), from draws about it: what is known of them unmeasured."""
    middle, slopes = np.zeros(len(places)), np.zeros((len(places), len(centre)))
    beyond = np.zeros(len(places))
    for i, (name, place) in enumerate(places):
        acting, line = inputs.line(name, place)
        slopes[i, acting] = _sure(line)
        middle[i] = inputs.shares[name][place].value + line.middle - float(slopes[i] @ centre)
        beyond[i] = _unexplained(line)
    errors = tied_errors(places, others + beyond) + discrepancy
    return JointShares.linear([one.key for one in inputs.draws.unknowns], places, middle, slopes, errors)


def _sure(line: Response) -> Array:
    """The slopes (K,), each less what its own error makes of it: a slope that is no larger than that is none, so that
    nothing is learnt about inputs that only seem to act (positive part of Stein's estimate).
    """
    squares = line.slopes**2
    kept = 1.0 - np.divide(line.variances, squares, out=np.ones_like(squares), where=squares > 0.0)
    return np.asarray(line.slopes * np.clip(kept, 0.0, 1.0))


def _unexplained(line: Response) -> float:
    """The variance of a share that no slope explains, and that of the slopes themselves within a standard deviation."""
    return max(0.0, line.beyond) + float(np.sum(line.variances * line.spread**2))


def _wide_enough(spread: Array) -> Array:
    """The covariance (K, K) of draws that are nowhere narrower than NARROWEST."""
    sizes, ways = np.linalg.eigh(spread)
    return np.asarray((ways * np.maximum(sizes, NARROWEST**2)) @ ways.T)
