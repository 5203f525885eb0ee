"""What the inputs that nobody knows exactly do to an answer: of one run's draws, and over many runs.

The draws (:mod:`wakeflow.pipeline.input_samples`) say where the granules of each land, and where the same ones land in
the answer. A regression on where the draws lie parts the change of a number into what each unknown does alone, what
they do beyond it (interactions, curvature), and the sampling of few granules a draw, which is no part of the range
(Saltelli, A. et al. 2008, Global Sensitivity Analysis, ch. 1, standardised regression coefficients). The range is that
of the regression with the part beyond it, over many more points than there are draws: the quantiles of 64 draws
themselves would hold too little.

A change of a share is the density of granules at a bin's end times the mean shift of those that land there. To count
those that cross the end sees few of them; so a bin gets soft ends first, as wide as the inputs shift granules, over
which each granule near them is seen to move (a pathwise derivative with a kernel: Liu & Hong 2011, Oper. Res. 59, 106).
That is the control variate of the count: what the hard ends change beyond the soft ones is regressed as well and added.
Of each the slopes are shrunk by the noise that few granules make of them, and how the draw's own few granules land in
the answer is a covariate (Owen, Monte Carlo theory, methods and examples, ch. 8).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from itertools import islice
from operator import add
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..answer.shares import InputPart, InputSummary
from ..core.lazy import cached_property
from ..core.number import Number
from ..laws.size import normal_points
from ..planning.unknowns import FARTHEST, SIGMAS, Unknown, unknown_kinds
from .separation import LEVEL, purity_slopes

if TYPE_CHECKING:
    from ..pipeline.input_samples import DrawnLandings, InputSamples


# -- What the inputs that nobody knows exactly do to a number of the answer --------------------------------------------
Array = NDArray[np.float64]
Point = tuple[float, float]  # m
POINTS = 4096  # at which the regression is read
SEED = 20110  # of those points: any, but always the same
NOTHING = 1e-12  # of a share: a change that is none
SOFT = 1.0  # width of soft ends over the shift of granules. Chosen: coverage is alike from 0.5 to 3
LARGEST = 64  # unknowns of a purity that are kept: of 300 fractions there are 900, and as many purities as targets
FAR = 0.9  # quantile of shifts: what moves farther has met another face, and says nothing of the others' shift


@dataclass(frozen=True)
class InputRange:
    """The change of a number from the answer over all unknowns: ends of the middle 95 %, ``low`` to ``high``; the
    ``effects`` of each alone by its key, largest first.
    """

    low: float
    high: float
    effects: Mapping[str, InputPart]

    @property
    def half(self) -> float:
        """The larger of the two ends."""
        return max(-self.low, self.high, 0.0)


class Moved(NamedTuple):
    """Of every granule in every draw (R, M): how much more it is in a place than in the answer, ``change``, and how
    much it is there in the answer, ``before``.
    """

    change: Array
    before: Array

    @classmethod
    def joined(cls, parts: Iterable[Moved]) -> Moved:
        """Several lots of draws as one."""
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


@dataclass(frozen=True)
class Inputs:
    """The draws of one run, and the answer's ``shares`` by fraction and bin, of which they say the changes; the
    ``ends`` (m) of every bin over which granules can pass; the ``images`` of bins in a mirrored machine, whose draws
    are pooled; where the answer's granules meet, the ``correction`` of a fraction for that.
    """

    draws: InputSamples
    shares: Mapping[str, Mapping[str, Number]]
    mass: Mapping[str, float]
    ends: Mapping[str, Sequence[Point]]
    images: Sequence[int] | None = None
    correction: Callable[[str], float] | None = None
    _responses: dict[tuple[str, ...], Acting] = field(default_factory=dict, init=False, repr=False, compare=False)
    _masses: dict[str, tuple[Mapping[str, Array], Array]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def factor(self, name: str) -> float:
        """On what granules alone say of a fraction's shares: 1 where they fly alone."""
        return 1.0 if self.correction is None else self.correction(name)

    @cached_property
    def _places(self) -> dict[str, int]:
        """The number of every bin in landings; the last place is elsewhere."""
        names = list(next(iter(self.shares.values())))
        return {place: i for i, place in enumerate(names[:-1])} | {names[-1]: -1}

    @cached_property
    def _points(self) -> Array:
        return _points(len(self.draws.unknowns))

    def of_share(self, name: str, places: Sequence[str]) -> InputRange:
        """The range of the share of fraction ``name`` that lands in any of ``places``."""
        acting, found = self._response(name, places)
        return found.range(self._points[:, acting], [self.draws.unknowns[i] for i in acting])

    def line(self, name: str, place: str) -> Acting:
        """The places of the unknowns that act on a fraction, and how its share in a bin goes with them."""
        return self._response(name, [place])

    def of_purity(self, name: str, place: str) -> InputRange:
        """The range of the share of fraction ``name`` in the mass in a bin: all fractions vary together."""
        own = {other: found[place].value for other, found in self.shares.items()}
        inside, total = self._inside(place)
        now = self.mass[name] * own[name] / sum(self.mass[other] * own[other] for other in own)
        change = np.divide(inside[name], total, out=np.full(len(total), now), where=total > 0.0) - now
        return InputRange(*_middle(change), {})

    def _inside(self, place: str) -> tuple[Mapping[str, Array], Array]:
        """The mass (POINTS,) of every fraction in a bin, and of all together, at each of the points. Made once: the
        purity of each fraction rests on all.
        """
        if place not in self._masses:
            inside = {}
            for other, found in self.shares.items():
                acting, line = self._response(other, [place])
                share = found[place].value + line.changes(self._points[:, acting])
                inside[other] = self.mass[other] * np.clip(share, 0.0, 1.0)
            self._masses[place] = inside, np.sum(list(inside.values()), axis=0)
        return self._masses[place]

    def effects_on_purity(self, name: str, place: str) -> dict[str, InputPart]:
        """What each unknown alone does to the share of fraction ``name`` in the mass in a bin, along the tangent; of
        very many unknowns those that do most.
        """
        own = {other: found[place].value for other, found in self.shares.items()}
        known = self.draws.unknowns
        slopes, variances = np.zeros(len(known)), np.zeros(len(known))
        rest, beyond = np.zeros(0), 0.0
        for other, slope in purity_slopes(name, self.mass, own).items():
            acting, found = self._response(other, [place])
            slopes[acting] += slope * found.slopes
            variances[acting] += slope**2 * found.variances
            rest = slope * found.rest if not len(rest) else rest + slope * found.rest
            beyond += slope**2 * found.beyond
        whole = Response(0.0, slopes, variances, rest, beyond, np.ones(len(known)))
        return dict(islice(whole.range(self._points, known).effects.items(), LARGEST))

    def of_targets(self, targets: Mapping[str, Sequence[str]]) -> dict[str, dict[str, InputPart]]:
        """The effects on the recovery of every fraction in its ``targets``, and on its purity in each of them."""
        found: dict[str, dict[str, InputPart]] = {}
        for name, places in targets.items():
            if places:
                found[f"recovery.{name}"] = dict(self.of_share(name, places).effects)
            for place in places:
                if any(shares[place].value > 0.0 for shares in self.shares.values()):
                    found[f"purity.{place}.{name}"] = self.effects_on_purity(name, place)
        return found

    def _response(self, name: str, places: Sequence[str]) -> Acting:
        """The regression of a share, made once: purities ask for those of all fractions."""
        asked = (name, *places)
        if asked not in self._responses:
            self._responses[asked] = self._regression(name, places)
        return self._responses[asked]

    def _regression(self, name: str, places: Sequence[str]) -> Acting:
        """The unknowns that act on a fraction, and how the share that lands in ``places`` goes with them.

        The image of a draw has its lateral unknowns with the other sign; what is its own image goes with none of them.
        """
        known = self.draws.unknowns
        acting = [i for i, one in enumerate(known) if one.fraction in (None, name)]
        images = places if self.images is None else self._images(places)
        lateral = np.array([unknown_kinds[known[i].kind].lateral for i in acting])
        if self.images is None or set(images) == set(places):
            acting = [i for i, odd in zip(acting, lateral, strict=True) if self.images is None or not odd]
            return acting, response(self.draws.z[:, acting], self._moved(name, places))
        z = self.draws.z[:, acting]
        both = zip(self._moved(name, places), self._moved(name, images), strict=True)
        return acting, response(np.vstack([z, np.where(lateral, -z, z)]), [Moved.joined(pair) for pair in both])

    def _images(self, places: Sequence[str]) -> list[str]:
        names = list(self._places)
        return [names[(self.images or range(len(names)))[names.index(place)]] for place in places]

    def _moved(self, name: str, places: Sequence[str]) -> list[Moved]:
        """What the draws move of a fraction over the soft ends of ``places`` taken together, and beyond that over the
        ends themselves.
        """
        varied, own, width = self.draws.varied[name], self.draws.own[name], self.shift(name)
        bins, factor = [self._places[place] for place in places], self.factor(name)
        every = [point for place in places for point in self.ends[place]]
        ends = [point for point in dict.fromkeys(every) if every.count(point) == 1]
        hard = [factor * np.isin(landed.bin, bins).astype(float) for landed in (varied, own)]
        soft = [factor * softened(landed, bins, ends, SOFT * width) for landed in (varied, own)]
        rest = [one - other for one, other in zip(hard, soft, strict=True)]
        return [Moved(then - before, before) for then, before in (soft, rest)]

    def shift(self, name: str) -> float:
        """How far (m, rms) the draws shift the landings of a fraction's granules."""
        apart = self.draws.varied[name].position - self.draws.own[name].position
        shifts = np.hypot(apart[..., 0], apart[..., 1]).ravel()
        return float(np.sqrt(np.mean(np.minimum(shifts, np.quantile(shifts, FAR)) ** 2)))


def softened(landed: DrawnLandings, bins: Sequence[int], ends: Sequence[Point], width: float) -> Array:
    """How much (R, M) each granule is in ``bins`` whose ``ends`` are as soft as a normal distribution of the standard
    deviation ``width`` (m); those that no end is near are in them or not.
    """
    from scipy.special import ndtr

    inside = np.isin(landed.bin, bins)
    if not ends or width <= 0.0:
        return inside.astype(float)
    away = np.full(inside.shape, np.inf)
    for x, y in ends:
        away = np.minimum(away, np.hypot(landed.position[..., 0] - x, landed.position[..., 1] - y))
    return np.asarray(ndtr(np.where(inside, away, -away) / width))


@dataclass(frozen=True)
class Response:
    """How a number goes with unknowns at z (K,): ``middle`` + z ``slopes`` (K,), of ``variances`` (K,), and the
    ``rest`` (R,) of the draws, of which ``beyond`` is the variance that is no sampling. ``spread`` (K,) of the draws.
    """

    middle: float
    slopes: Array
    variances: Array
    rest: Array
    beyond: float
    spread: Array

    def __add__(self, other: Response) -> Response:
        """Of the sum of two numbers under the same draws."""
        names = ("middle", "slopes", "variances", "rest", "beyond")
        return replace(self, **{name: getattr(self, name) + getattr(other, name) for name in names})

    def changes(self, points: Array) -> Array:
        """The change of the number at points (n, K), with what lies beyond the line drawn from the rest."""
        scatter = float(np.mean(self.rest**2))
        kick = np.sqrt(self.beyond / scatter) if scatter > 0.0 else 0.0
        chance = np.random.default_rng(SEED).choice(self.rest, len(points))
        return np.asarray(self.middle + points @ self.slopes + kick * chance)

    def range(self, points: Array, known: Sequence[Unknown]) -> InputRange:
        """The middle 95 % over ``points`` (n, K), and the part of each of the ``known`` in the variance."""
        variance = float(np.sum((self.slopes * self.spread) ** 2)) + self.beyond
        if variance < NOTHING**2 and abs(self.middle) < NOTHING:
            return InputRange(0.0, 0.0, {})
        half, error = SIGMAS * self.slopes, SIGMAS * np.sqrt(self.variances)
        index = (self.slopes * self.spread) ** 2 / max(variance, NOTHING**2)
        doubt = 2.0 * np.abs(self.slopes) * error * self.spread**2 / max(variance, NOTHING**2)
        effects = {
            one.key: InputPart(abs(float(half[i])), float(index[i]), float(doubt[i]), float(half[i]))
            for i, one in enumerate(known)
        }
        return InputRange(
            *_middle(self.changes(points)), dict(sorted(effects.items(), key=lambda effect: -effect[1].variance))
        )


Acting = tuple[list[int], Response]  # the places of the unknowns that act on a number, and how it goes with them


def response(z: Array, parts: Sequence[Moved]) -> Response:
    """How the sum of the ``parts`` of a number goes with what draws at ``z`` (R, K) change of it."""
    made = [_fitted(np.clip(z, -FARTHEST, FARTHEST), part) for part in parts]
    return reduce(add, made)


def _fitted(z: Array, moved: Moved) -> Response:
    """The regression of the mean change of every draw on ``z`` (R, K), less its noise."""
    design = np.column_stack([np.ones(len(z)), z])
    each, used = _less_the_sample(design, moved)
    change = each.mean(axis=1)
    line, *_ = np.linalg.lstsq(design, change, rcond=None)
    rest = change - design @ line
    free = max(1, len(z) - design.shape[1] - used)
    scatter = float(rest @ rest) / free
    noise = min(scatter, float(np.mean(each.var(axis=1))) / each.shape[1])
    unit = np.diag(np.linalg.pinv(design.T @ design))
    kept = _kept(line[1:], noise * unit[1:])
    middle = float(_kept(line[:1], noise * unit[:1]) * line[0])
    rest *= np.sqrt(len(z) / free)
    return Response(middle, kept * line[1:], kept**2 * scatter * unit[1:], rest, scatter - noise, z.std(axis=0))


def _less_the_sample(design: Array, moved: Moved) -> tuple[Array, bool]:
    """The change (R, M) of each granule less what goes with how the few of its draw land in the answer, and whether
    there was any: of granules that land anew by chance in every flight that is all their own share.
    """
    before = moved.before - moved.before.mean()
    sample = before.mean(axis=1)
    if np.ptp(sample) < NOTHING:
        return moved.change, False
    both = np.column_stack([design, sample])
    found, *_ = np.linalg.lstsq(both, moved.change.mean(axis=1), rcond=None)
    return moved.change - np.clip(found[-1], -1.0, 1.0) * before, True


def _kept(found: Array, variances: Array) -> float:
    """The factor that leaves numbers (K,) ``found`` with noise of known ``variances`` (K,) the sum of squares that they
    are expected to have without it.
    """
    size = float(found @ found)
    return math.sqrt(max(0.0, 1.0 - float(variances.sum()) / size)) if size > 0.0 else 0.0


def _middle(changes: Array) -> tuple[float, float]:
    """The ends of the middle 95 %."""
    low, high = np.quantile(changes, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    return float(low), float(high)


@lru_cache(maxsize=8)  # asked for every share of a run
def _points(dimensions: int) -> Array:
    """Many points (POINTS, dimensions) of independent standard normal numbers, cut off as the draws are."""
    return np.asarray(np.clip(normal_points(dimensions, POINTS, SEED), -FARTHEST, FARTHEST))


# -- What the unknown inputs of a run were -----------------------------------------------------------------------------
Parts = dict[str, dict[str, dict[str, InputPart]]]


def inputs_of(inputs: Inputs | None) -> tuple[dict[str, InputSummary] | None, Parts | None]:
    """Every unknown with its interval by key, and by fraction and bin its part; None where everything is known."""
    if inputs is None:
        return None, None
    known = {one.key: InputSummary(one.value, *one.ends, unit=one.unit, why=one.why) for one in inputs.draws.unknowns}
    parts: Parts = {}
    for name, shares in inputs.shares.items():
        ranges = ((place, inputs.of_share(name, [place])) for place in shares)
        parts[name] = {place: dict(over.effects) for place, over in ranges if over.effects}
    return known, parts
