"""An answer beside measured shares, both with their intervals, whether they agree; and beside the limits of its scene:
met, not met or open, and what would decide.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.number import Number
from ...core.tables import CellTable
from ...planning.unknowns import SIGMAS
from ...scene import Scene
from ...scene.measured import Measured
from ..joint import JointAnswer, Of
from ..measurements import measured_words, purchases
from ..result import Result
from ..shares import OPEN, Standing, Verdict
from .budget import remedies

Array = NDArray[np.float64]
RARE = 0.01  # a misfit that is less probable than that is none of chance
COARSE = 0.1  # of a share: a comparison that no tray would notice less of says nothing
TINY = 1e-10  # of the largest eigenvalue: a combination of trays that is known no better is no test of its own
SEED = 20110  # of what is measured of every draw: any, but always the same
HEADS = (
    "fraction", "bin", "measured", "measured low", "measured high", "computed", "computed low", "computed high",
    "part of the interval", "from the other trays (standard deviations)",
)  # fmt: skip


class Agrees(StrEnum):
    """Whether measured shares agree with an answer, each with what it says of the test and of the best or worst tray,
    by their numbers.
    """

    AGREES = "agrees"
    DISAGREES = "disagrees"
    CANNOT_TELL = "cannot tell"

    @property
    def says(self) -> str:
        """The verdict in a sentence, to be formatted."""
        return {
            self.AGREES: "agrees with the computation ({test}); the best tray would show a difference of {points:.2g} "
            "points.",
            self.DISAGREES: "disagrees with the computation ({test}): {worst.about} is {pull:.1f} standard deviations "
            "{side} what the other trays let expect.",
            self.CANNOT_TELL: "cannot tell ({test}): no tray would show a difference below {points:.2g} points.",
        }[self]


AGREES, DISAGREES, CANNOT_TELL = Agrees


@dataclass(frozen=True)
class ComparedTray:
    """One tray: its share as ``measured`` and as ``computed``; the part of both intervals together that their
    difference takes (``used``: 1 is the end of the 95 %), and its distance from what all other trays let expect
    (``pull``, standard deviations).
    """

    fraction: str | None
    bin: str
    measured: Number
    computed: Number
    used: float
    pull: float

    @property
    def about(self) -> str:
        """The tray in words."""
        return f"{self.fraction or 'all fractions'} in {self.bin}"


@dataclass(frozen=True)
class Agreement:
    """Measured shares beside those of an answer: a row a tray; how far they are off together, which knows how the
    errors of bins go together; the least difference of a share that any tray would have shown (``notices``).
    """

    trays: tuple[ComparedTray, ...]
    chi_square: float
    freedom: int
    chance: float
    notices: float

    @property
    def verdict(self) -> Agrees:
        """Whether the answer agrees with the trays, disagrees, or cannot tell."""
        return DISAGREES if self.chance < RARE else CANNOT_TELL if self.notices > COARSE else AGREES

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        worst = max(self.trays, key=lambda tray: abs(tray.pull))
        return "The measurement " + self.verdict.says.format(
            test=f"chi-square {self.chi_square:.3g} of {self.freedom}, probability {self.chance:.2g}",
            points=100 * self.notices,
            worst=worst,
            pull=abs(worst.pull),
            side="above" if worst.pull > 0.0 else "below",
        )

    def cells(self) -> CellTable:
        """A row a tray, as the CSV file has it: shares from 0 to 1."""
        return CellTable(HEADS, [(tray.fraction, tray.bin, *tray.measured, *tray.computed, tray.used, tray.pull)
                                 for tray in self.trays])  # fmt: skip


def weights_in(joint: JointAnswer, measured: Measured) -> Array:
    """What each tray (n, shares) holds of all shares."""
    places = [(name, place) for name in joint.fractions for place in joint.own.names]
    return measured.weights(places, dict(zip(joint.fractions, joint.mass, strict=True)))


def agreement_of(joint: JointAnswer, measured: Measured, missed: Array | None = None) -> Agreement:
    """Agreement of ``measured`` shares with a joint answer that knows nothing of them; ``missed``: covariance (shares,
    shares) of what the model itself may miss.

    How probable a misfit as large is, is counted over the draws, each measured as the trays were: shares are seldom
    normal. Raises SceneError for a tray of a fraction or bin that there is not.
    """
    weights, tables = weights_in(joint, measured), joint.own.tables()
    in_draws = tables.reshape(tables.shape[0] * tables.shape[1], -1) @ weights.T  # what each tray holds in every draw
    noise = measured.covariance + (0.0 if missed is None else weights @ missed @ weights.T)
    off = measured.shares - in_draws.mean(axis=0)
    inverse, freedom = inverse_of(np.atleast_2d(np.cov(in_draws.T)) + noise)
    chosen = np.random.default_rng(SEED).multivariate_normal(np.zeros(len(off)), noise, len(in_draws))
    seen = in_draws - in_draws.mean(axis=0) + chosen
    squares, square = np.einsum("ni,ij,nj->n", seen, inverse, seen), float(off @ inverse @ off)
    chance = (1.0 + float((squares >= square).sum())) / (1.0 + len(squares))
    alone = np.diag(inverse)
    pulls = np.divide(inverse @ off, np.sqrt(alone), out=np.zeros_like(off), where=alone > 0.0)
    trays, least = [], np.inf
    for row, (place, share) in enumerate(zip(measured.places, measured.numbers(), strict=True)):
        computed = joint.own.number(of_tray(weights[row]))
        both = hypot(computed.half, SIGMAS * sqrt(float(measured.covariance[row, row])))
        away = abs(share.value - computed.value)
        trays.append(ComparedTray(*place, share, computed, away / both if both > 0.0 else 0.0, float(pulls[row])))
        least = min(least, both)
    return Agreement(tuple(trays), square, freedom, chance, float(least))


def of_tray(weights: Array) -> Of:
    """What a tray holds, by its ``weights`` (shares,)."""
    return lambda table: np.asarray(table.reshape(*table.shape[:-2], -1) @ weights)


def inverse_of(covariance: Array) -> tuple[Array, int]:
    """The inverse over the combinations that are free, and how many these are."""
    sizes, ways = np.linalg.eigh(covariance)
    free = sizes > TINY * max(float(sizes.max()), TINY)
    return (ways[:, free] / sizes[free]) @ ways[:, free].T, int(free.sum())


def agreement_in(result: Result, measured: Measured) -> Agreement:
    """Agreement of ``measured`` shares with a finished run. Raises SceneError where that ended before its shares, or
    has no such fraction or bin.
    """
    return agreement_of(result.joint, measured)


def measured_in(result: Result) -> Measured | None:
    """What was measured, as the scene of a run says; None without it."""
    trays = Scene.parse(result.scene).measured if result.scene.get("measured") else []
    return Measured.of(trays) if trays else None


# -- An answer beside its limits ---------------------------------------------------------------------------------------
def verdicts_of(result: Result) -> Iterator[Verdict]:
    """A verdict on every limit of the scene of a ``result`` that has shares."""
    if result.landings is None:
        return
    separation = result.landings.separation
    for name, most in Scene.parse(result.scene).limit.by_name.items():
        kind, of = name.split(".")
        value = separation.loss[of] if kind == "loss" else separation.dirt[of]
        verdict = judged(result, value, most)
        yield Verdict(name, most, value, verdict, _deciding(result, name, value, most) if verdict is OPEN else "")


def judged(result: Result, value: Number | None, most: float) -> Standing:
    """Whether a ``value`` of a ``result`` is known to be at most so much: met, not met or open. An answer that is void
    says nothing, and one whose interval lacks something at most what exceeds the limit is known to be too little.
    """
    if value is None or result.void or result.lacking:
        return OPEN
    return Standing.of(value.low, value.high, most)


def _deciding(result: Result, name: str, value: Number | None, most: float) -> str:
    """What would decide of a limit that is open: first what is against every number of the answer, then finer
    computing where that alone leaves it open, then the measurement that leaves the limit out of the interval.
    """
    if result.void:
        return f"an answer that is not void: {result.why_void}"
    if value is None:
        return "a design in which something lands there"
    if result.lacking:
        cures = "; ".join(remedies(result.lacking)) or "nothing that the program computes"
        return f"the size of {', '.join(result.lacking)}, which the interval lacks: {cures}"
    if value.numerical is not None and value.value - value.numerical <= most < value.value + value.numerical:
        return f"finer computing, which alone leaves +- {100 * value.numerical:.2g} points (--target-error)"
    bins = result.joint.own
    of = bins.of_name(name)
    bought = [] if of is None else purchases(result, name, value, bins.effects(of))
    for purchase in bought:
        if Standing.of(purchase.number.low, purchase.number.high, most) is not OPEN:
            return f"measuring {measured_words(purchase)}"
    return f"no measurement alone; first {measured_words(bought[0])}" if bought else "no single measurement"
