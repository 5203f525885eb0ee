"""What measured shares say of all shares and inputs: the draws of the joint answer that are as measured.

Draws of the inputs and of all other errors go from what was known before to what the trays leave of it by a sequential
Monte Carlo; the shares of a draw follow from its inputs by the response. About the inputs that come out granules are
flown again, and the response is made anew of all flights, until that moves the inputs no more.

Next to the inputs the model has errors of its own, which no measurement takes away: each share has a *discrepancy*, so
that many exact trays do not make an input known beyond what the model bears. Where the numbers as stated cannot reach
the trays, the least change of them that does is looked for, and then a larger miss of the model.

In the Monte Carlo the likelihood comes in by powers that grow from 0 to 1, each as far as half of the draws still
count; the draws are taken anew by their weights, and moved (Del Moral, Doucet & Jasra 2006, J. R. Stat. Soc. B 68,
411). A move is proposed in turn from a normal distribution that is fitted to the draws, and as a step from where a draw
is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...answer.budget.agreement import DISAGREES, RARE, Agreement, agreement_of, inverse_of, weights_in
from ...answer.budget.budget import fly_again, make_budget
from ...answer.budget.source import Flights
from ...answer.draws import DRAWS, LACK, column, less_at_ends, tied_root
from ...answer.joint import JointAnswer, bounded
from ...answer.response import Response
from ...answer.separation import acting, change_of, responses
from ...core.errors import SceneError
from ...core.lazy import cached_property
from ...core.number import Number
from ...core.quantities import say
from ...flight.stages.input_samples import DrawnLandings, Ensemble, InputSamples
from ...flight.stages.pipeline import InputRerun
from ...planning.unknowns import FARTHEST, Unknown, unknown_kinds
from ...runs.one_run import OneRun
from ...runs.run_stages import stages_of
from ...scene.measured import Measured

Array = NDArray[np.float64]
DISCREPANCY = 0.02  # half of the 95 % interval by which the model itself may miss a share of a half. Chosen
LEAST_DISCREPANCY = 0.1  # of that, for a share of 0 or 1
LARGEST_DISCREPANCY = 0.3  # of a share of a half: a model that misses by more says nothing
MOST_ROUNDS = 5  # of flights
STANDS = 0.25  # standard deviations by which an input may still move at the end
NARROWEST = 0.5  # standard deviations of the first range: narrower draws would show nothing but noise
TINY = 1e-10  # of the largest eigenvalue: a combination of trays that is known no better is no test of its own
HALVINGS = 30  # of a range in which a number is looked for
GROWN = (3.0, 10.0, np.inf)  # times the stated uncertainty that are tried where trays contradict it; at most the span
LIKELIEST = 3  # inputs that are tried
UNLIMITED = 5.0  # times a number without a largest value, to which its uncertainty may grow
Likelihood = Callable[[Array], Array]  # of draws (n, d): its logarithm (n,)
SEED = 20110  # of resampling and moves: any, but always the same
ENOUGH = 0.5  # of the draws must count after a power
MOVES = 4  # after each power
LAST = 8  # and after the last
ACCEPTED = 0.3  # part of the steps that is aimed at
RIDGE = 1e-6  # added to variances of draws


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

    def known(self, place: int) -> Number:
        """What is known of an input after it."""
        unknown, z = self.unknowns[place], self.z[:, place]
        ends = (z.mean(), *np.quantile(z, (0.025, 0.975)))
        return Number(*(float(np.clip(unknown.at(x), *unknown_kinds[unknown.kind].span)) for x in ends))


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
    covariance = np.zeros((many * bins, many * bins))
    for number, root in enumerate(roots):
        here = slice(number * bins, (number + 1) * bins)
        covariance[here, here] = root @ root.T
    return covariance


def agreement_with(joint: JointAnswer, measured: Measured, discrepancy: float) -> Agreement:
    """Agreement of ``measured`` shares with a joint answer whose model may miss shares by a ``discrepancy``."""
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


def updated(flights: Flights, joint: JointAnswer, measured: Measured, discrepancy: float = DISCREPANCY) -> Updated:
    """What ``measured`` says of the ``joint`` answer of ``flights`` and of their inputs, not all of which are known
    exactly.

    Raises SceneError for a tray of a fraction or bin that there is not.
    """
    draws = flights.draws
    agreement, model = agreement_with(joint, measured, discrepancy), _Model.of(flights, joint, draws, discrepancy)
    start = columns_of(joint)
    posterior, rounds, settled = tempered(model.likelihood(measured), start), 1, False
    while rounds < MOST_ROUNDS and not settled:
        z = model.inputs(posterior)
        mean, spread = z.mean(axis=0), np.atleast_2d(np.cov(z.T))
        more = flights.pipeline.run(InputRerun(joined=Ensemble(mean, _wide_enough(spread)).joined))
        flown = _joined(model.flown, more)
        model = replace(model, flown=flown, how=responses(flights.pipeline.scene, flown, joint.cells))
        posterior, rounds = tempered(model.likelihood(measured), start), rounds + 1
        z = model.inputs(posterior)
        settled = bool(np.max(np.abs(z.mean(axis=0) - mean) / np.maximum(z.std(axis=0), NARROWEST)) <= STANDS)
    return Updated(tuple(draws.unknowns), joint, _posterior(model, posterior), agreement, rounds, settled, discrepancy,
                   model.inputs(posterior))  # fmt: skip


def columns_of(joint: JointAnswer) -> Array:
    """What is not known before, as independent standard normal numbers (DRAWS, keys + shares): those of the inputs,
    then of each share one of all other errors together.
    """
    others = (f"error.{name}.{i}" for name in joint.fractions for i in range(len(joint.cells.bins) + 1))
    return np.stack([column(name) for name in (*joint.keys, *others)], axis=1)


@dataclass(frozen=True)
class _Model:
    """What draws (n, keys + shares) of such numbers make of all shares: by the response (``how``) of what was
    ``flown``, whose lack of fit depends on the inputs, and by all other errors, each fraction's with a covariance,
    ``beside`` (fractions, bins + 1, bins + 1).
    """

    flights: Flights
    joint: JointAnswer
    flown: InputSamples
    how: Mapping[str, Response]
    beside: Array

    @classmethod
    def of(cls, flights: Flights, joint: JointAnswer, draws: InputSamples, discrepancy: float) -> _Model:
        error = sum(
            (errors for name, errors in joint.errors.items() if name != LACK), np.zeros((DRAWS, *joint.own.value.shape))
        )
        beside = []
        for number, halves in enumerate(missed_by(joint, discrepancy)):
            missed = tied_root(halves)
            beside.append(np.atleast_2d(np.cov(error[:, number].T)) + missed @ missed.T)
        return cls(flights, joint, draws, responses(flights.pipeline.scene, draws, joint.cells), np.array(beside))

    @cached_property
    def _roots(self) -> list[tuple[Array, Array]]:
        """Root (bins + 1, bins + 1) of ``beside`` of each fraction, by whose columns the lack of fit goes too, and the
        variance that this has in each of them (bins + 1,).
        """
        roots = []
        for name, covariance in zip(self.joint.fractions, self.beside, strict=True):
            sizes, ways = np.linalg.eigh(covariance)
            free = sizes > TINY * sizes.max()
            lack = (ways[:, free] / np.sqrt(sizes[free])).T @ self.how[name].root
            more, turn = np.linalg.eigh(lack @ lack.T)
            roots.append(((ways[:, free] * np.sqrt(sizes[free])) @ turn, np.clip(more, 0.0, None)))
        return roots

    def inputs(self, draws: Array) -> Array:
        """The inputs (n, keys) of ``draws``, in standard deviations, that move together by their ties."""
        return np.clip(self.flights.ties.joined(draws[:, : len(self.joint.keys)]), -FARTHEST, FARTHEST)

    def changes(self, z: Array, *, by_bin: bool) -> tuple[Array, Array]:
        """What inputs ``z`` (n, keys) change (n, fractions, cells), or ``by_bin`` (n, fractions, bins + 1), and the
        standard deviation (n, fractions) of its lack of fit.
        """
        scene = self.flights.pipeline.scene
        moved, doubts = [], []
        for name in self.joint.fractions:
            factor = self.flights.factors.get(name, 1.0)
            change, doubt = change_of(scene, self.flown.unknowns, name, self.how[name], z, by_bin=by_bin)
            moved.append(factor * change)
            doubts.append(factor * doubt)
        return np.stack(moved, axis=1), np.stack(doubts, axis=1)

    def errors(self, draws: Array, doubt: Array, shares: Array) -> Array:
        """What else ``draws`` add to the ``shares`` (n, fractions, bins + 1) that inputs make of them, where the lack
        of fit has the standard deviation ``doubt`` (n, fractions).
        """
        others = draws[:, len(self.joint.keys) :].reshape(len(draws), len(self.joint.fractions), -1)
        errors = [
            (others[:, number, : len(more)] * np.sqrt(1.0 + doubt[:, number, None] ** 2 * more)) @ root.T
            for number, (root, more) in enumerate(self._roots)
        ]
        value = self.joint.base @ self.joint.cells.parts()
        return np.stack(errors, axis=1) * less_at_ends(shares, value * (1.0 - value))

    def likelihood(self, measured: Measured) -> Likelihood:
        """The logarithm of how likely the trays are in draws, of which those that break an order are impossible."""
        weights, (inverse, _) = weights_in(self.joint, measured), inverse_of(measured.covariance)
        value = self.joint.base @ self.joint.cells.parts()

        def likely(draws: Array) -> Array:
            z = self.inputs(draws)
            change, doubt = self.changes(z, by_bin=True)
            shares = bounded(value + change + self.errors(draws, doubt, value + change))
            off = measured.shares - shares.reshape(len(draws), -1) @ weights.T
            logarithm = -0.5 * np.einsum("ni,ij,nj->n", off, inverse, off)
            return np.where(self.flights.ties.kept(z), logarithm, -np.inf)

        return likely


def _posterior(model: _Model, draws: Array) -> JointAnswer:
    """The joint answer of draws: the mean of their shares is its value, and no source is told apart any more."""
    joint, z, parts = model.joint, model.inputs(draws), model.joint.cells.parts()
    change, doubt = model.changes(z, by_bin=False)
    cells = joint.base + change
    cells += np.einsum("nfb,fcb->nfc", model.errors(draws, doubt, cells @ parts), _within(joint.base, parts))
    # Shares have bounds, and not cells: what noise takes from one cell of an empty bin, it gives to the next
    shares = bounded(cells @ parts).mean(axis=0)
    middle = np.einsum("fb,fcb->fc", shares, _within(np.clip(cells.mean(axis=0), 0.0, None), parts))
    rest = (cells - middle).astype(np.float16).astype(np.float32)
    apart = z.std(axis=0)  # inputs by what is known of them now
    inputs = ((z - z.mean(axis=0)) / np.where(apart > 0.0, apart, 1.0)).astype(np.float32).astype(float)
    return replace(joint, base=middle, change=rest, z=inputs, sources=(), images=())


def _within(base: Array, parts: Array) -> Array:
    """Part (fractions, cells, bins + 1) of what is added to a bin that is in every cell: as the mass of the bin is, and
    evenly where that is empty.
    """
    mass = base[:, :, None] * parts
    total = mass.sum(axis=1)[:, None]
    even = np.broadcast_to(parts / np.maximum(parts.sum(axis=0), TINY), mass.shape)
    return np.asarray(np.where(total > TINY, mass / np.maximum(total, TINY), even))


def _joined(first: InputSamples, second: InputSamples) -> InputSamples:
    """Join two lots of draws into one."""

    def both(a: DrawnLandings, b: DrawnLandings) -> DrawnLandings:
        return DrawnLandings(np.concatenate([a.position, b.position]), np.concatenate([a.bin, b.bin]))

    varied = {name: both(landings, second.varied[name]) for name, landings in first.varied.items()}
    alone = {name: both(landings, second.own[name]) for name, landings in first.own.items()}
    return InputSamples(first.unknowns, np.vstack([first.z, second.z]), varied, alone)


def _wide_enough(spread: Array) -> Array:
    """The covariance (K, K) of draws that are nowhere narrower than NARROWEST."""
    sizes, ways = np.linalg.eigh(spread)
    return np.asarray((ways * np.maximum(sizes, NARROWEST**2)) @ ways.T)


# -- What agrees with the trays ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Matched:
    """What the trays say (``updates``: one, or none where nothing agrees with them); their ``agreement`` with what the
    scene says; what must be otherwise (``conflict``).
    """

    updates: tuple[Updated, ...]
    agreement: Agreement
    conflict: str = ""


def matched(run: OneRun, joint: JointAnswer, measured: Measured, discrepancy: float) -> Matched:
    """The update of a finished ``run`` with its ``joint`` answer, under the numbers as stated where these agree with
    the trays, else under the least change of them that does.
    """
    flights = run.flights
    if not flights.draws.unknowns:
        raise SceneError("calibrate: every number of the scene is exact; say how well they are known, [uncertainty]")
    agreement = agreement_with(joint, measured, discrepancy)
    if agreement.verdict != DISAGREES:
        return Matched((updated(flights, joint, measured, discrepancy),), agreement)
    for unknown, half in _grown(flights, joint, agreement):
        run.pipeline.listener("calibrate", f"trying {unknown.key} +- {half:.3g}")
        wider = _wider(run, unknown.key, half)
        known_worse, _ = make_budget(wider)
        if agreement_with(known_worse, measured, discrepancy).verdict != DISAGREES:
            update = updated(wider, known_worse, measured, discrepancy)
            return Matched((update,), agreement, _must_grow(unknown, update))
    least = least_discrepancy(joint, measured, discrepancy)
    if least is None:
        text = "No input of the scene and no miss of the model that would be believed explains the trays."
        return Matched((), agreement, text)
    text = (
        f"The model itself would have to miss shares by up to {100 * least:.2g} points, where {100 * discrepancy:.2g} "
        "are taken."
    )
    return Matched((updated(flights, joint, measured, least),), agreement, text)


def _wider(run: OneRun, key: str, half: float) -> Flights:
    """The flights of a ``run`` whose input ``key`` is known within +- ``half``; what there is comes from the cache."""
    pipeline = run.pipeline
    scene = run.given.replace({f"uncertainty.{key}": half})
    pipeline, _ = stages_of(scene, run.request, pipeline.workers, pipeline.listener)
    return fly_again(Flights(pipeline, pipeline.tracks()))


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
        for unknown in (draws.unknowns[place] for place in likely):
            half = min(times * max(unknown.low, unknown.high), _most(unknown))
            if half > max(unknown.low, unknown.high) and (unknown.key, half) not in tried:
                tried.add((unknown.key, half))
                yield unknown, half


def _most(unknown: Unknown) -> float:
    """The largest half of an interval that says anything of a number."""
    low, high = unknown_kinds[unknown.kind].span
    return max(unknown.value - low, high - unknown.value) if np.isfinite(high) else UNLIMITED * abs(unknown.value)


def _must_grow(unknown: Unknown, update: Updated) -> str:
    number = update.known([each.key for each in update.unknowns].index(unknown.key))
    unit = unknown.unit
    stated = f"{say(unknown.value, unit, 3)} +- {say(max(unknown.low, unknown.high), unit, 2)}"
    return (
        f"{unknown.key} would have to be {say(number.value, unit, 3)} ({say(number.low, unit, 3)} to "
        f"{say(number.high, unit, 3)}); the scene says {stated}."
    )


# -- Draws from before to after a measurement --------------------------------------------------------------------------


def tempered(likely: Likelihood, draws: Array) -> Array:
    """Draws (n, d) of the posterior, from ``draws`` (n, d) of independent standard normal numbers."""
    chance = np.random.default_rng(SEED)
    moved, gains = draws.copy(), likely(draws)
    power, scale = 0.0, 2.38 / np.sqrt(draws.shape[1])
    while power < 1.0:
        step = _step(gains, 1.0 - power)
        rows = _resampled(step * gains, chance)
        moved, gains, power = moved[rows], gains[rows], power + step
        for move in range(LAST if power >= 1.0 else MOVES):
            moved, gains, scale = _move(likely, moved, gains, power, scale, move, chance)
    return moved


def _step(gain: Array, most: float) -> float:
    """The largest step of the power, ``most`` at most, after which enough draws count."""

    def count(step: float) -> float:
        weight = np.exp(step * (gain - gain.max()))
        return float(weight.sum() ** 2 / (weight**2).sum()) / len(gain)

    if count(most) >= ENOUGH:
        return most
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if count(middle) >= ENOUGH else (low, middle)
    return high


def _resampled(weight: Array, chance: np.random.Generator) -> NDArray[np.int64]:
    """Rows by their weights, given as logarithms (systematic resampling)."""
    part = np.exp(weight - weight.max())
    reached = np.cumsum(part / part.sum())
    return np.searchsorted(reached, (np.arange(len(part)) + chance.random()) / len(part)).clip(0, len(part) - 1)


def _move(
    likely: Likelihood, draws: Array, gains: Array, power: float, scale: float, move: int, chance: np.random.Generator
) -> tuple[Array, Array, float]:
    """One move of every draw, and the scale of the next step."""
    mean, spread = draws.mean(axis=0), np.atleast_2d(np.cov(draws.T)) + RIDGE * np.eye(draws.shape[1])
    root, noise = np.linalg.cholesky(spread), chance.standard_normal(draws.shape)
    anywhere = move % 2 == 0
    there = mean + noise @ root.T if anywhere else draws + scale * noise @ root.T
    new = likely(there)
    gain = power * (new - gains) - 0.5 * ((there**2).sum(axis=1) - (draws**2).sum(axis=1))
    if anywhere:
        back = np.linalg.solve(root, (draws - mean).T)
        gain += 0.5 * ((noise**2).sum(axis=1) - (back**2).sum(axis=0))
    taken = np.log(chance.random(len(draws))) < gain
    if not anywhere:
        scale *= float(np.exp(taken.mean() - ACCEPTED))
    return np.where(taken[:, None], there, draws), np.where(taken, new, gains), scale


# -- What trays would leave, whatever they show ------------------------------------------------------------------------
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
    low, high = np.quantile(values, (0.025, 0.975))
    return 0.5 * float(high - low)
