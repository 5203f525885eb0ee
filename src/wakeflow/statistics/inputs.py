"""What the inputs that nobody knows exactly do to an answer: of one run's draws, and over many runs.

The draws (:mod:`wakeflow.pipeline.input_samples`) say by how much the number changes in each. A regression on where the
draws lie parts that into what each unknown does alone, what they do beyond it (interactions, curvature), and the
sampling of few granules a draw, whose size is known from the same granules in the answer and is no part of the range
(Saltelli, A. et al. 2008, Global Sensitivity Analysis, ch. 1, standardised regression coefficients). The range is that
of the regression with the part beyond it, over many more points than there are draws: the quantiles of 64 draws
themselves would hold too little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..answer.shares import InputPart, InputSummary, LandingResults
from ..answer.table import is_part
from ..core.lazy import cached_property
from ..core.number import Number
from ..laws.size import normal_points
from ..planning.unknowns import FARTHEST, SIGMAS, Unknown
from .separation import LEVEL, purity_slopes

if TYPE_CHECKING:
    from ..pipeline.input_samples import InputSamples


# -- What the inputs that nobody knows exactly do to a number of the answer --------------------------------------------
Array = NDArray[np.float64]
POINTS = 4096  # at which the regression is read
SEED = 20110  # of those points: any, but always the same
NOTHING = 1e-12  # of a share: a change that is none


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


@dataclass(frozen=True)
class Inputs:
    """The draws of one run, and the answer's ``shares`` by fraction and bin, of which they say the changes; where
    the answer's granules meet, the ``correction`` of a fraction for that.
    """

    draws: InputSamples
    shares: Mapping[str, Mapping[str, Number]]
    mass: Mapping[str, float]
    correction: Callable[[str], float] | None = None

    def factor(self, name: str) -> float:
        """On what granules alone say of a fraction's shares: 1 where they fly alone."""
        return 1.0 if self.correction is None else self.correction(name)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {place: i for i, place in enumerate(next(iter(self.shares.values())))}

    def of_share(self, name: str, places: Sequence[str]) -> InputRange:
        """The range of the share of fraction ``name`` that lands in any of ``places``."""
        change, noise = self._change(name, places)
        return self._range(change, noise, [name])

    def of_purity(self, name: str, place: str) -> InputRange:
        """The range of the share of fraction ``name`` in the mass in a bin."""
        own = {other: found[place].value for other, found in self.shares.items()}
        changes = {other: self._change(other, [place]) for other in own}
        slopes = purity_slopes(name, self.mass, own)
        inside = {other: self.mass[other] * np.clip(own[other] + changes[other][0], 0.0, 1.0) for other in own}
        total = np.sum(list(inside.values()), axis=0)
        now = self.mass[name] * own[name] / sum(self.mass[other] * own[other] for other in own)
        change = np.divide(inside[name], total, out=np.full(len(total), now), where=total > 0.0) - now
        noise = np.sum([slopes[other] ** 2 * changes[other][1] for other in own], axis=0)
        return self._range(change, noise, list(own))

    def _change(self, name: str, places: Sequence[str]) -> tuple[Array, Array]:
        """By how much each draw (R,) changes a share, and the variance of that for being taken from few granules."""
        varied, own = self.draws.hits(name, [self._places[place] for place in places])
        moved = self.factor(name) * (varied - own)
        return moved.mean(axis=1), moved.var(axis=1) / moved.shape[1]

    def _range(self, change: Array, noise: Array, names: Sequence[str]) -> InputRange:
        known = self.draws.unknowns
        acting = [i for i, one in enumerate(known) if one.fraction is None or one.fraction in names]
        return regressed(self.draws.z[:, acting], change, noise, [known[i] for i in acting])


def regressed(z: Array, change: Array, noise: Array, known: Sequence[Unknown]) -> InputRange:
    """The range of a number over its unknowns, from its ``change`` (R,) in draws at ``z`` (R, K) and the variance
    ``noise`` (R,) of each for its granules.
    """
    if np.abs(change).max() < NOTHING:
        return InputRange(0.0, 0.0, {})
    z = np.clip(z, -FARTHEST, FARTHEST)
    design = np.column_stack([np.ones(len(z)), z])
    found, *_ = np.linalg.lstsq(design, change, rcond=None)
    free = max(1, len(z) - design.shape[1])
    rest = change - design @ found
    scatter = float(rest @ rest) / free
    beyond = max(0.0, scatter - float(noise.mean()))  # what is neither linear nor sampling
    slope_error = np.sqrt(scatter * np.diag(np.linalg.pinv(design.T @ design)))[1:]
    slopes, spread = found[1:], z.std(axis=0)
    variance = float(np.sum((slopes * spread) ** 2)) + beyond
    points, kick = _points(z.shape[1]), np.sqrt(beyond / scatter) if scatter > 0.0 else 0.0
    chance = np.random.default_rng(SEED).choice(rest, len(points)) * np.sqrt(len(rest) / free)
    many = found[0] + points @ slopes + kick * chance
    low, high = np.quantile(many, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    effects = {
        one.key: InputPart(
            half=float(abs(SIGMAS * slope)),
            variance=float((slope * width) ** 2 / variance) if variance > 0.0 else 0.0,
            error=float(2.0 * SIGMAS * abs(slope) * error * width**2 / variance) if variance > 0.0 else 0.0,
            rise=float(SIGMAS * slope),
        )
        for one, slope, width, error in zip(known, slopes, spread, slope_error, strict=True)
    }
    largest = sorted(effects.items(), key=lambda effect: -effect[1].variance)
    return InputRange(float(low), float(high), dict(largest))


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


# -- Which input moves which number of an answer by how much -----------------------------------------------------------
SHARE = "share."
REGRESSION, SWEEP = "regression", "sweep"


@dataclass(frozen=True)
class InputMove:
    """What one input alone does to a number of the answer.

    ``quantity`` as in a sweep's table, its ``value`` and ``measure`` ("1" for parts of a whole); the input's ``key``,
    the ends ``low`` and ``high`` that it was taken to, and their ``unit``; ``at_low`` and ``at_high``: the changes of
    the quantity there, None where that was not computed, with the half ``error`` of their 95 % interval, None where
    unknown. From the regression on a run's draws also the input's part ``index`` of the quantity's variance
    (first-order index), known to +- ``index_error``. ``how``: regression, or sweep.
    """

    quantity: str
    value: float
    measure: str
    key: str
    low: float
    high: float
    unit: str
    at_low: float | None
    at_high: float | None
    error: float | None
    index: float | None
    index_error: float | None
    how: str

    @property
    def is_part(self) -> bool:
        """Whether the quantity is a part of a whole, whose changes are reported in percentage points."""
        return self.measure == "1" and is_part(self.quantity)

    @property
    def reach(self) -> float:
        """The larger of the two changes."""
        return max(abs(self.at_low or 0.0), abs(self.at_high or 0.0))


def regressed_moves(landings: LandingResults | None) -> list[InputMove]:
    """What the regression on a run's draws says of every share; nothing where no input is unknown, or where an older
    version that did not tell directions made the result.
    """
    if landings is None or landings.measure_next is None:
        return []
    known, found = landings.inputs or {}, []
    for name, places in landings.measure_next.items():
        for place, parts in places.items():
            value = landings.separation.fractions[name][place].value
            for key, part in parts.items():
                if part.rise is None:
                    return []
                number = known[key]
                found.append(
                    InputMove(
                        f"{SHARE}{name}.{place}", value, "1", key, number.low, number.high, number.unit, -part.rise,
                        part.rise, part.uncertainty, part.variance, part.error, REGRESSION,
                    )
                )  # fmt: skip
    return found


def grouped(moves: Iterable[InputMove]) -> dict[str, list[InputMove]]:
    """The moves of each quantity, the largest first."""
    found: dict[str, list[InputMove]] = {}
    for one in moves:
        found.setdefault(one.quantity, []).append(one)
    return {name: sorted(members, key=lambda one: -one.reach) for name, members in found.items()}


def least_sure(moves: Mapping[str, Sequence[InputMove]]) -> list[str]:
    """Of each fraction the share that its inputs move most, in squares."""
    worst: dict[str, tuple[float, str]] = {}
    for name, members in moves.items():
        if name.startswith(SHARE):
            fraction, moved = name.split(".")[1], hypot(*(one.reach for one in members))
            if moved > worst.get(fraction, (-1.0, ""))[0]:
                worst[fraction] = moved, name
    return [name for _, name in worst.values()]
