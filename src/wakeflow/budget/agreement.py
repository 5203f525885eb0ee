"""An answer beside measured shares: both with their intervals, and whether they agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ..answer.result import Result
from ..answer.shares import BudgetRow, LandingResults
from ..core.errors import SceneError, known
from ..core.number import Number
from ..core.tables import CellTable
from ..planning.unknowns import SIGMAS
from ..scene import Scene
from ..scene.measured import Measured
from ..statistics.joint import JointShares, Misfit, Place, misfit, tied_errors
from .source import INPUTS
from .total import half_of

Array = NDArray[np.float64]
AGREES, DISAGREES, CANNOT_TELL = "agrees", "disagrees", "cannot tell"
RARE = 0.01  # a misfit that is less probable than that is none of chance
COARSE = 0.1  # of a share: a comparison that no tray would notice less of says nothing
LARGE_PULL = 2.0  # standard deviations of a tray from what the others let expect, from which it is named
COLUMNS = {
    "fraction": "fraction", "bin": "bin", "measured": "found", "measured low": "found_low",
    "measured high": "found_high", "computed": "value", "computed low": "low", "computed high": "high",
    "part of the interval": "used", "from the other trays (standard deviations)": "pull",
}  # fmt: skip


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

    found = property(lambda self: self.measured.value)
    found_low = property(lambda self: self.measured.low)
    found_high = property(lambda self: self.measured.high)
    value = property(lambda self: self.computed.value)
    low = property(lambda self: self.computed.low)
    high = property(lambda self: self.computed.high)


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
    def verdict(self) -> str:
        """Agrees, disagrees, or cannot tell."""
        if self.chance < RARE:
            return DISAGREES
        return CANNOT_TELL if self.notices > COARSE else AGREES

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        test = f"chi-square {self.chi_square:.3g} of {self.freedom}, probability {self.chance:.2g}"
        if self.verdict == DISAGREES:
            worst = max(self.trays, key=lambda tray: abs(tray.pull))
            return (
                f"The measurement disagrees with the computation ({test}): {worst.about} is {abs(worst.pull):.1f} "
                f"standard deviations {'above' if worst.pull > 0.0 else 'below'} what the other trays let expect."
            )
        if self.verdict == CANNOT_TELL:
            return (
                f"The measurement cannot tell ({test}): no tray would show a difference below "
                f"{100 * self.notices:.2g} points."
            )
        return (
            f"The measurement agrees with the computation ({test}); the best tray would show a difference of "
            f"{100 * self.notices:.2g} points."
        )

    def cells(self) -> CellTable:
        """A row a tray, as the CSV file has it: shares from 0 to 1."""
        return CellTable.of(self.trays, COLUMNS)


def agreement_of(
    known: JointShares, measured: Measured, mass: Mapping[str, float], about: JointShares | None = None
) -> Agreement:
    """Of ``measured`` shares with those that are ``known`` without them; ``mass``: share of each fraction in the feed.
    ``about``: the same, linear about the inputs that explain the measurement best, which the test of both is made with.

    Raises SceneError for a tray of a fraction or bin that there is not.
    """
    weights = measured.weights(known.places, mass)
    found: Misfit = misfit(about or known, measured, weights)
    trays, least = [], np.inf
    for row, (place, share) in enumerate(zip(measured.places, measured.numbers(), strict=True)):
        own, half = known.number(weights[row]), known.half(weights[row])
        both = hypot(half, SIGMAS * sqrt(float(measured.covariance[row, row])))
        off = abs(share.value - float(weights[row] @ known.shares))
        trays.append(ComparedTray(*place, share, own, off / both if both > 0.0 else 0.0, float(found.pulls[row])))
        least = min(least, both)
    return Agreement(tuple(trays), found.chi_square, found.freedom, found.chance, float(least))


def agreement_in(result: Result, measured: Measured) -> Agreement:
    """Of ``measured`` shares with a finished run. Raises SceneError where that ended before its shares, or has no such
    fraction or bin.
    """
    if result.landings is None:
        raise SceneError(f"{result.folder} holds no shares: the run ended before them")
    return agreement_of(joint_of(result.landings), measured, Scene.parse(result.scene).mass_shares())


def measured_in(result: Result) -> Measured | None:
    """What was measured, as the scene of a run says; None without it."""
    trays = Scene.parse(result.scene).measured if result.scene.get("measured") else []
    return Measured.of(trays) if trays else None


# -- What is known of all shares of an answer together -----------------------------------------------------------------
def joint_of(landings: LandingResults) -> JointShares:
    """Of a finished run: its regression on the inputs, and the errors of the other sources."""
    shares = landings.separation.fractions
    places = [(name, place) for name, found in shares.items() for place in found]
    keys = list(landings.inputs or {})
    rows = {row.quantity: row for row in landings.budget}
    middle, slopes = np.zeros(len(places)), np.zeros((len(places), len(keys)))
    beyond = np.zeros(len(places))
    for i, (name, place) in enumerate(places):
        parts = ((landings.measure_next or {}).get(name) or {}).get(place) or {}
        for key, part in parts.items():
            slopes[i, keys.index(key)] = (part.half if part.rise is None else part.rise) / SIGMAS
        low, high = _ends(rows.get(f"share.{name}.{place}"))
        middle[i] = shares[name][place].value + 0.5 * (low + high)
        beyond[i] = max(0.0, (0.5 * (high - low) / SIGMAS) ** 2 - float(slopes[i] @ slopes[i]))
    errors = tied_errors(places, beyond + other_errors(places, shares, landings.budget))
    return JointShares.linear(keys, places, middle, slopes, errors)


def _ends(row: BudgetRow | None) -> tuple[float, float]:
    """How far the inputs move a share, below and above."""
    part = None if row is None else next((one for one in row.parts if one.source == INPUTS), None)
    if part is None or part.error is None:
        return 0.0, 0.0
    return (-part.error if part.low is None else part.low), (part.error if part.high is None else part.high)


def other_errors(
    places: Sequence[Place], shares: Mapping[str, Mapping[str, Number]], budget: Sequence[BudgetRow]
) -> Array:
    """The variances (S,) of the shares by all sources but the inputs; of a share without a row that of its interval."""
    rows, found = {row.quantity: row for row in budget}, np.zeros(len(places))
    for i, (name, place) in enumerate(places):
        row, share = rows.get(f"share.{name}.{place}"), known(shares.get(name))[place]
        if row is None:
            half = max(share.high - share.value, share.value - share.low) if share.known else 0.0
        else:
            half = hypot(*(half_of(part) for part in row.parts if part.source != INPUTS))
        found[i] = (half / SIGMAS) ** 2
    return found
