"""What measured shares say of all shares and inputs: draws of the joint answer are moved until they are as measured.

An ensemble smoother with several data assimilations (Emerick & Reynolds 2013, Comput. Geosci. 55, 3): each of STEPS
times the draws of inputs and of all other errors go by their covariance with what the trays would show towards what
they showed, measured STEPS times as badly. The shares of a draw are computed anew after each from its inputs. About the
inputs that come out granules are flown again, until that moves them no more.

Next to the inputs the model has errors of its own, which no measurement takes away: each share has a *discrepancy*, so
that many exact trays do not make an input known beyond what the model bears.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..answer.joint import DRAWS, JointAnswer, bounded, column, quantiles, tied_root
from ..budget.agreement import RARE, Agreement, agreement_of, weights_in
from ..budget.budget import make_budget
from ..budget.inputs import UNKNOWN
from ..budget.source import Flights
from ..core.errors import SceneError, known
from ..pipeline.input_samples import DrawnLandings, Ensemble, InputSamples
from ..planning.unknowns import FARTHEST, Unknown
from ..scene.measured import Measured
from ..statistics.ensemble import acting, responses
from ..statistics.response import Response

Array = NDArray[np.float64]
DISCREPANCY = 0.02  # half of the 95 % interval by which the model itself may miss a share of a half. Chosen
LEAST_DISCREPANCY = 0.1  # of that, for a share of 0 or 1
LARGEST_DISCREPANCY = 0.3  # of a share of a half: a model that misses by more says nothing
STEPS = 4  # assimilations
MOST_ROUNDS = 5  # of flights
STANDS = 0.25  # standard deviations by which an input may still move at the end
NARROWEST = 0.5  # standard deviations of the first range: narrower draws would show nothing but noise
TINY = 1e-10  # of the largest eigenvalue: a combination of trays that is known no better is no test of its own
HALVINGS = 20  # of the range in which the least discrepancy is looked for


class State(NamedTuple):
    """Draws: of the inputs ``z`` (DRAWS, keys), and of what everything else adds to the shares, ``error`` (DRAWS,
    fractions, bins + 1).
    """

    z: Array
    error: Array


@dataclass(frozen=True)
class Updated:
    """What is known of all shares and inputs, ``before`` the measurement and ``after`` it; the ``agreement`` of the
    measurement with what was known before; ``rounds`` of flights, and whether the last moved no input (``stands``);
    the ``discrepancy`` that was taken; the inputs after it, ``z`` (DRAWS, keys), in standard deviations of what was
    known of them before.
    """

    unknowns: tuple[Unknown, ...]
    before: JointAnswer
    after: JointAnswer
    agreement: Agreement
    rounds: int
    stands: bool
    discrepancy: float
    z: Array


def missed_by(joint: JointAnswer, half: float) -> Array:
    """Half (fractions, bins + 1) of the 95 % interval by which the model itself may miss each share: ``half`` of a
    share of a half, less towards 0 and 1, and nowhere nothing.
    """
    value = np.clip(joint.own.value, 0.0, 1.0)
    return np.asarray(half * (LEAST_DISCREPANCY + (1.0 - LEAST_DISCREPANCY) * 2.0 * np.sqrt(value * (1.0 - value))))


def covariance_of_missed(joint: JointAnswer, half: float) -> Array:
    """The covariance (shares, shares) of what the model itself may miss."""
    roots = [tied_root(row) for row in missed_by(joint, half)]
    many, bins = len(roots), len(roots[0])
    found = np.zeros((many * bins, many * bins))
    for number, root in enumerate(roots):
        here = slice(number * bins, (number + 1) * bins)
        found[here, here] = root @ root.T
    return found


def agreement_with(joint: JointAnswer, measured: Measured, discrepancy: float) -> Agreement:
    """Of ``measured`` shares with a joint answer whose model may miss shares by a ``discrepancy``."""
    return agreement_of(joint, measured, covariance_of_missed(joint, discrepancy))


def least_discrepancy(joint: JointAnswer, measured: Measured, first: float) -> float | None:
    """The smallest discrepancy, ``first`` at least, at which trays and model agree; None where that says nothing."""
    low, high = first, LARGEST_DISCREPANCY
    if agreement_with(joint, measured, high).chance < RARE:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if agreement_with(joint, measured, middle).chance >= RARE else (middle, high)
    return high


def updated(flights: Flights, measured: Measured, discrepancy: float = DISCREPANCY) -> Updated:
    """What ``measured`` says of the shares of ``flights`` and of their inputs.

    Raises SceneError where everything is known exactly, and for a tray of a fraction or bin that there is not.
    """
    draws = flights.of(UNKNOWN)
    if draws is None:
        raise SceneError("calibrate: every number of the scene is exact; say how well they are known, [uncertainty]")
    joint, _ = make_budget(flights)
    agreement = agreement_with(joint, measured, discrepancy)
    first, towards = _state(joint, discrepancy), partial(_assimilated, joint, measured)
    flown, how = draws, responses(flights.pipeline.scene, draws)
    found, rounds, stands = towards(first, _table(flights, joint, draws, how)), 1, False
    while rounds < MOST_ROUNDS and not stands:
        mean, spread = found.z.mean(axis=0), np.atleast_2d(np.cov(found.z.T))
        again = known(flights.pipeline.draws_of(Ensemble(mean, _wide_enough(spread))))
        flown = _joined(flown, again)
        how = responses(flights.pipeline.scene, flown)
        found, rounds = towards(first, _table(flights, joint, flown, how)), rounds + 1
        apart = np.abs(found.z.mean(axis=0) - mean) / np.maximum(found.z.std(axis=0), NARROWEST)
        stands = bool(np.max(apart) <= STANDS)
    after = _posterior(joint, found, _changes(flights, joint, flown, how))
    return Updated(tuple(draws.unknowns), joint, after, agreement, rounds, stands, discrepancy, found.z)


def _state(joint: JointAnswer, discrepancy: float) -> State:
    """The draws before anything is measured."""
    error = sum(joint.errors.values(), np.zeros((DRAWS, *joint.own.value.shape)))
    for number, (name, halves) in enumerate(zip(joint.fractions, missed_by(joint, discrepancy), strict=True)):
        root = tied_root(halves)
        drawn = np.stack([column(f"discrepancy.{name}.{i}") for i in range(root.shape[1])], axis=1)
        error[:, number] += drawn @ root.T
    return State(joint.z, error)


Changes = Callable[[Array], Array]  # of the inputs (n, keys), what they change of every cell (n, fractions, cells)


def _changes(flights: Flights, joint: JointAnswer, draws: InputSamples, how: Mapping[str, Response]) -> Changes:
    factors = {name: 1.0 if flights.among is None else flights.among.factor(name) for name in joint.fractions}

    def change(z: Array) -> Array:
        told = [factors[name] * how[name](z[:, acting(draws.unknowns, name)])[0] for name in joint.fractions]
        return np.stack(told, axis=1)

    return change


def _table(flights: Flights, joint: JointAnswer, draws: InputSamples, how: Mapping[str, Response]) -> Changes:
    """What draws at z make of every share (n, fractions, bins + 1) without other errors."""
    change, parts = _changes(flights, joint, draws, how), joint.cells.parts()
    return lambda z: np.asarray((joint.base + change(z)) @ parts)


def _assimilated(joint: JointAnswer, measured: Measured, state: State, table: Changes) -> State:
    """The draws once what was measured is known."""
    weights, (sizes, ways) = weights_in(joint, measured), np.linalg.eigh(measured.covariance)
    root = ways * np.sqrt(STEPS * np.clip(sizes, 0.0, None))
    for step in range(STEPS):
        shares = bounded(table(state.z) + state.error)
        shown = shares.reshape(DRAWS, -1) @ weights.T
        noise = np.stack([column(f"tray.{step}.{i}") for i in range(len(root))], axis=1) @ root.T
        every = np.hstack([state.z, state.error.reshape(DRAWS, -1)])
        apart, off = every - every.mean(axis=0), shown - shown.mean(axis=0)
        tray = off.T @ off / (DRAWS - 1) + STEPS * measured.covariance
        gain = np.linalg.lstsq(tray, off.T @ apart / (DRAWS - 1), rcond=TINY)[0]
        every = every + (measured.shares + noise - shown) @ gain
        z = np.clip(every[:, : state.z.shape[1]], -FARTHEST, FARTHEST)
        state = State(z, every[:, state.z.shape[1] :].reshape(state.error.shape))
    return state


def _posterior(joint: JointAnswer, state: State, change: Changes) -> JointAnswer:
    """The joint answer of the draws: their mean is its value, and no source is told apart any more."""
    cells, parts = joint.base + change(state.z), joint.cells.parts()
    cells += np.einsum("nfb,fcb->nfc", state.error, _within(joint.base, parts))
    bounded(cells)
    middle = cells.mean(axis=0)
    rest = (cells - middle).astype(np.float16).astype(np.float32)
    apart = state.z.std(axis=0)  # inputs by what is known of them now
    z = (state.z - state.z.mean(axis=0)) / np.where(apart > 0.0, apart, 1.0)
    z = z.astype(np.float32).astype(float)
    return replace(joint, base=middle, change=rest, z=z, sources=(), images=None)


def _within(base: Array, parts: Array) -> Array:
    """Of what is added to a bin, the part (fractions, cells, bins + 1) that is in every cell: as its mass is, and
    evenly where it is empty.
    """
    mass = base[:, :, None] * parts
    total = mass.sum(axis=1)[:, None]
    even = np.broadcast_to(parts / np.maximum(parts.sum(axis=0), TINY), mass.shape)
    return np.asarray(np.where(total > TINY, mass / np.maximum(total, TINY), even))


def _joined(one: InputSamples, other: InputSamples) -> InputSamples:
    """Two lots of draws as one."""
    varied, own = (
        {name: _both(a[name], b[name]) for name in one.varied}
        for a, b in ((one.varied, other.varied), (one.own, other.own))
    )
    return InputSamples(one.unknowns, np.vstack([one.z, other.z]), varied, own)


def _both(one: DrawnLandings, other: DrawnLandings) -> DrawnLandings:
    return DrawnLandings(np.concatenate([one.position, other.position]), np.concatenate([one.bin, other.bin]))


def _wide_enough(spread: Array) -> Array:
    """The covariance (K, K) of draws that are nowhere narrower than NARROWEST."""
    sizes, ways = np.linalg.eigh(spread)
    return np.asarray((ways * np.maximum(sizes, NARROWEST**2)) @ ways.T)


# -- what trays would leave, whatever they show ------------------------------------------------------------------------
def left_by(joint: JointAnswer, wanted: Array, weights: Array, noise: Array, key: str = "") -> float:
    """Half of the 95 % interval of a number ``wanted`` (DRAWS,) that is left once ``weights`` (n, shares) of all shares
    are measured with the covariance ``noise`` (n, n), whatever they show: the part of its draws that does not go with
    what the trays of the same draws would show. Never more than it is now.
    """
    shares = joint.own.tables()[0].reshape(DRAWS, -1)
    sizes, ways = np.linalg.eigh(noise)
    drawn = np.stack([column(f"noise.{key}.{i}") for i in range(len(noise))], axis=1)
    shown = shares @ weights.T + drawn @ (ways * np.sqrt(np.clip(sizes, 0.0, None))).T
    off = shown - shown.mean(axis=0)
    gain = np.linalg.lstsq(off.T @ off, off.T @ (wanted - wanted.mean()), rcond=TINY)[0]
    return min(half_of(wanted), half_of(wanted - off @ gain))


def half_of(values: Array) -> float:
    """Half of the middle 95 % of draws (DRAWS,)."""
    low, high = quantiles(values, (0.025, 0.975))
    return 0.5 * float(high - low)
