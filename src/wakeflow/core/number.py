"""A number with its 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from .record import Null, column

# What has no bound is infinite here and null in JSON; what is not known is not a number here.
Most = Annotated[float, Null(math.inf)]
Least = Annotated[float, Null(-math.inf)]
Known = Annotated[float, Null(math.nan)]
Count = Annotated[int, Null(0)]


@dataclass(frozen=True)
class Number:
    """A number and its 95 % interval, in the unit of what it measures; ``value, low, high = number`` takes it apart.

    The ends are infinite, null in JSON, where nothing is known of them.
    """

    value: Most = column("as said", "the number; null where it is beyond what can be measured")
    low: Least = column("as said", "lower end of the 95 % interval; null where none is known", default=-math.inf)
    high: Most = column("as said", "upper end of the 95 % interval; null where none is known", default=math.inf)
    numerical: float | None = column(
        "as said", "half of the 95 % interval by computing alone, of shares, purities and recoveries", absent=True,
        default=None,
    )  # fmt: skip

    def __iter__(self) -> Iterator[float]:
        yield from (self.value, self.low, self.high)

    def __getitem__(self, place: int) -> float:
        return (self.value, self.low, self.high)[place]

    def __len__(self) -> int:
        return 3

    def __bool__(self) -> bool:
        """Whether there is a number, :data:`NO_NUMBER` being none."""
        return not math.isnan(self.value)

    def __reduce_ex__(self, protocol: Any) -> str | tuple[Any, ...]:
        """:data:`NO_NUMBER` stays the one that it is in another process too: no NaN equals another."""
        return "NO_NUMBER" if type(self) is Number and not self else super().__reduce_ex__(protocol)

    @property
    def known(self) -> bool:
        """Whether both ends of the interval are known."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def ends(self) -> tuple[float | None, float | None]:
        """Low and high end, for tables: None for what is not known."""
        return self.low if math.isfinite(self.low) else None, self.high if math.isfinite(self.high) else None

    @property
    def half(self) -> float:
        """Half of the interval's width; infinite where it is not known."""
        return 0.5 * (self.high - self.low)

    def shifted(self, by: float) -> Number:
        """The number and its interval moved."""
        return Number(self.value + by, self.low + by, self.high + by)

    def times(self, factor: float) -> Number:
        """The number and its interval times a positive factor."""
        return Number(self.value * factor, self.low * factor, self.high * factor)


NO_NUMBER = Number(math.nan)
Measured = Annotated[Number, Null(NO_NUMBER)]  # or not: null in JSON then
NO_VALUE = "–"
UNKNOWN_ERROR = "unknown"
VOID = "void"  # the caveat of an answer that is worth nothing
UNKNOWN_SPAN = 0.5  # of a part of a whole: an interval from which on nothing is known of it
MAX_DIGITS = 4  # after the point of a percentage, however narrow its interval
COARSE = 2.5  # percentage points: an arm of an interval from which on a percentage has no decimals


def percent(number: Number | None, *, void: bool = False) -> str:
    """``"62.1 (61.3 to 62.9)"`` from a measured number in 0..1: percent and its 95 % interval; ``"unknown (0 to 50)"``
    where that spans half of all that it could be, a dash for none, and ``"void"`` for a number of an answer that is
    worth nothing.

    The number of decimals follows the shorter arm of the interval that is not zero, so that both arms are seen.
    """
    if number is None or not math.isfinite(number.value):
        return NO_VALUE
    if void:
        return VOID
    if not number.known:
        return f"{100 * number.value:.1f}"
    arms = [100.0 * arm for arm in (number.value - number.low, number.high - number.value) if arm > 0.0]
    digits = -math.floor(math.log10(min(arms) / COARSE)) if arms else 1
    digits = min(MAX_DIGITS, max(0, digits))
    value, low, high = (_whole(f"{100 * item:.{digits}f}") for item in number)
    wide = round(number.high - number.low, 2) >= UNKNOWN_SPAN
    return f"{UNKNOWN_ERROR if wide else value} ({low} to {high})"


def _whole(text: str) -> str:
    """Drop the decimals of none and all of a whole: 0 and 100 percent."""
    return f"{float(text):.0f}" if float(text) in (0.0, 100.0) else text


def student(degrees: int) -> float:
    """Student's t for a two-sided 95 % interval."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 0.975))
