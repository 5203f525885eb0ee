"""Numbers with their 95 % interval."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.record import column

__all__ = ["Measured", "Share"]


@dataclass(frozen=True)
class Measured:
    """A number and the ends of its 95 % interval, in the unit of what it measures."""

    value: float | None = column("as said", "the number; null where it could not be measured")
    low: float | None = column("as said", "lower end of the 95 % interval; null where none is known")
    high: float | None = column("as said", "upper end of the 95 % interval; null where none is known")
    numerical: float | None = column(
        "as said", "half of the 95 % interval by computing alone, of purities and recoveries", absent=True, default=None
    )

    @property
    def half(self) -> float | None:
        """Half of the interval's width; None where no interval is known."""
        return None if self.low is None or self.high is None else 0.5 * (self.high - self.low)


@dataclass(frozen=True)
class Share:
    """The share of a fraction's mass that lands in a bin, 0 to 1, and its 95 % interval."""

    value: float = column("1", "the share, by mass", key="share")
    low: float = column("1", "lower end of the 95 % interval that holds every known part of the error")
    high: float = column("1", "upper end of the 95 % interval that holds every known part of the error")
    numerical: float | None = column(
        "1",
        "half of the 95 % interval by computing alone, with the scene's numbers as given",
        absent=True,
        default=None,
    )
