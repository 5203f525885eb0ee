"""What measured shares say of all shares and inputs: the draws of the joint answer that are as measured.

Draws of the inputs and of all other errors go from what was known before to what the trays leave of it by a sequential
Monte Carlo (:mod:`.tempering`); the shares of a draw follow from its inputs by the response. About the inputs that come
out granules are flown again, and the response is made anew of all flights, until that moves the inputs no more.

Next to the inputs the model has errors of its own, which no measurement takes away: each share has a *discrepancy*, so
that many exact trays do not make an input known beyond what the model bears.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..answer.joint import DRAWS, JointAnswer, bounded, column, quantiles, tied_root
from ..budget.agreement import RARE, Agreement, agreement_of, inverse_of, weights_in
from ..budget.budget import make_budget
from ..budget.inputs import UNKNOWN
from ..budget.source import Flights
from ..core.errors import SceneError, known
from ..pipeline.input_samples import DrawnLandings, Ensemble, InputSamples
from ..planning.dependence import Dependence
from ..planning.unknowns import FARTHEST, Unknown
from ..scene.measured import Measured
from ..statistics.ensemble import change_of, in_order, responses
from ..statistics.response import Response
from .tempering import Likelihood, tempered

Array = NDArray[np.float64]
DISCREPANCY = 0.02  # half of the 95 % interval by which the model itself may miss a share of a half. Chosen
LEAST_DISCREPANCY = 0.1  # of that, for a share of 0 or 1
LARGEST_DISCREPANCY = 0.3  # of a share of a half: a model that misses by more says nothing
MOST_ROUNDS = 5  # of flights
STANDS = 0.25  # standard deviations by which an input may still move at the end
NARROWEST = 0.5  # standard deviations of the first range: narrower draws would show nothing but noise
TINY = 1e-10  # of the largest eigenvalue: a combination of trays that is known no better is no test of its own
HALVINGS = 20  # of the range in which the least discrepancy is looked for


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
    agreement, scene = agreement_with(joint, measured, discrepancy), flights.pipeline.scene
    known_before = _Before.of(joint, known(flights.ties), discrepancy)
    flown, how = draws, responses(scene, draws)
    target = _likelihood(known_before, measured, _changes(flights, joint, draws, how))
    found, rounds, stands = tempered(target, known_before.draws), 1, False
    while rounds < MOST_ROUNDS and not stands:
        z = known_before.inputs(found)
        mean, spread = z.mean(axis=0), np.atleast_2d(np.cov(z.T))
        flown = _joined(flown, known(flights.pipeline.draws_of(Ensemble(mean, _wide_enough(spread)))))
        how, old = responses(scene, flown), target
        target = _likelihood(known_before, measured, _changes(flights, joint, flown, how))
        found, rounds = tempered(target, found, old), rounds + 1
        z = known_before.inputs(found)
        stands = bool(np.max(np.abs(z.mean(axis=0) - mean) / np.maximum(z.std(axis=0), NARROWEST)) <= STANDS)
    z = in_order(known_before.inputs(found), known(flights.ties))
    after = _posterior(joint, z, known_before.error(found), _changes(flights, joint, flown, how))
    return Updated(tuple(draws.unknowns), joint, after, agreement, rounds, stands, discrepancy, z)


@dataclass(frozen=True)
class _Before:
    """What is known before: independent standard normal ``draws`` (DRAWS, keys + shares), of which the first are the
    inputs, that move together by their ``ties``, and the others, by ``roots`` (fractions, bins + 1, bins + 1), all
    other errors together.
    """

    joint: JointAnswer
    ties: Dependence
    roots: Array
    draws: Array

    @classmethod
    def of(cls, joint: JointAnswer, ties: Dependence, discrepancy: float) -> _Before:
        error = sum(joint.errors.values(), np.zeros((DRAWS, *joint.own.value.shape)))
        roots = []
        for number, halves in enumerate(missed_by(joint, discrepancy)):
            spread = np.atleast_2d(np.cov(error[:, number].T)) + (one := tied_root(halves)) @ one.T
            sizes, ways = np.linalg.eigh(spread)
            roots.append(ways * np.sqrt(np.clip(sizes, 0.0, None)))
        names = [*joint.keys, *(f"error.{name}.{i}" for name in joint.fractions for i in range(len(roots[0])))]
        return cls(joint, ties, np.array(roots), np.stack([column(name) for name in names], axis=1))

    def inputs(self, draws: Array) -> Array:
        """The inputs (n, keys) of ``draws`` (n, keys + shares), in standard deviations."""
        return np.clip(self.ties.joined(draws[:, : len(self.joint.keys)]), -FARTHEST, FARTHEST)

    def error(self, draws: Array) -> Array:
        """What else is added to the shares (n, fractions, bins + 1)."""
        own = draws[:, len(self.joint.keys) :].reshape(len(draws), *self.roots.shape[:2])
        return np.asarray(np.einsum("nfi,fbi->nfb", own, self.roots))


def _likelihood(before: _Before, measured: Measured, change: Changes) -> Likelihood:
    """The logarithm of how likely the trays are in draws, of which those that break an order are impossible."""
    weights, (inverse, _) = weights_in(before.joint, measured), inverse_of(measured.covariance)
    value = before.joint.base @ before.joint.cells.parts()

    def likely(draws: Array) -> Array:
        z = before.inputs(draws)
        shares = bounded(value + change(z, True) + before.error(draws))
        off = measured.shares - shares.reshape(len(draws), -1) @ weights.T
        found = -0.5 * np.einsum("ni,ij,nj->n", off, inverse, off)
        return np.where(before.ties.kept(z), found, -np.inf)

    return likely


Changes = Callable[[Array, bool], Array]  # of the inputs (n, keys), what they change (n, fractions, cells or bins + 1)


def _changes(flights: Flights, joint: JointAnswer, draws: InputSamples, how: Mapping[str, Response]) -> Changes:
    factors = {name: 1.0 if flights.among is None else flights.among.factor(name) for name in joint.fractions}

    def change(z: Array, by_bin: bool) -> Array:
        scene, known = flights.pipeline.scene, draws.unknowns
        told = [
            factors[name] * change_of(scene, known, name, how[name], z, by_bin=by_bin)[0] for name in joint.fractions
        ]
        return np.stack(told, axis=1)

    return change


def _posterior(joint: JointAnswer, z: Array, error: Array, change: Changes) -> JointAnswer:
    """The joint answer of draws: their mean is its value, and no source is told apart any more."""
    cells, parts = joint.base + change(z, False), joint.cells.parts()
    cells += np.einsum("nfb,fcb->nfc", error, _within(joint.base, parts))
    middle = bounded(cells.mean(axis=0))  # of what nothing lands in, nothing
    rest = (bounded(cells) - middle).astype(np.float16).astype(np.float32)
    apart = z.std(axis=0)  # inputs by what is known of them now
    own = ((z - z.mean(axis=0)) / np.where(apart > 0.0, apart, 1.0)).astype(np.float32).astype(float)
    return replace(joint, base=middle, change=rest, z=own, sources=(), images=None)


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
