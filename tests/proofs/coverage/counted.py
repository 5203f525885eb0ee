"""How often intervals hold the truth, counted over many numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from proofs.coverage.flown import Predicted

LEAST = 1e-3  # a number that is nearer than that to 0 in value and truth, or to 1 in both, is known trivially
ROUND_OFF = 1e-9  # of an end of an interval


@dataclass(frozen=True)
class Counted:
    """One number of one scene: what the program says of it with the ends of an interval, and what is true."""

    scene: str
    group: str
    quantity: str
    value: float
    low: float
    high: float
    truth: float

    @property
    def error(self) -> float:
        return abs(self.truth - self.value)

    @property
    def half(self) -> float:
        return 0.5 * (self.high - self.low)

    @property
    def covered(self) -> bool:
        return self.low - ROUND_OFF <= self.truth <= self.high + ROUND_OFF

    @property
    def trivial(self) -> bool:
        """Whether the number is next to 0 both as said and in truth, or next to 1."""
        low, high = sorted((self.value, self.truth))
        return high < LEAST or low > 1.0 - LEAST


@dataclass(frozen=True)
class HeldTally:
    """Of some numbers: from how many ``scenes``, how ``many`` are not trivial, the share of these that their intervals
    hold (``coverage``) and of all with the trivial ones (``every``), the shares above and below their intervals, and
    the medians of half width and error. None where nothing was counted.
    """

    label: str
    scenes: int
    many: int
    coverage: float | None
    every: float | None
    above: float | None
    below: float | None
    half: float | None
    error: float | None

    @property
    def width(self) -> float | None:
        """Median half width over the median error."""
        return None if self.half is None or not self.error else self.half / self.error

    def table(self) -> dict[str, Any]:
        """For a report in JSON."""
        return {**asdict(self), "width": self.width}


def tally_of(label: str, rows: Sequence[Counted]) -> HeldTally:
    """What ``rows`` come to."""
    told = [row for row in rows if not row.trivial]
    scenes = len({row.scene for row in rows})
    every = float(np.mean([row.covered for row in rows])) if rows else None
    if not told:
        return HeldTally(label, scenes, 0, None, every, None, None, None, None)
    return HeldTally(
        label,
        scenes,
        len(told),
        float(np.mean([row.covered for row in told])),
        every,
        float(np.mean([row.truth > row.high + ROUND_OFF for row in told])),
        float(np.mean([row.truth < row.low - ROUND_OFF for row in told])),
        float(np.median([row.half for row in told])),
        float(np.median([row.error for row in told])),
    )


def counted(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    """Every share, recovery and purity of a scene against the shares that are true, by fraction (bins + 1,)."""
    one, separation = told.one, told.separation
    for name, shares in separation.fractions.items():
        for number, (place, share) in enumerate(shares.items()):
            true = float(truth[name][number])
            yield Counted(one.name, one.group, f"share.{name}.{place}", share.value, share.low, share.high, true)
    yield from _recoveries(told, truth)
    yield from _purities(told, truth)


def _recoveries(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    places = list(told.separation.bins)
    for name, found in told.separation.recovery.items():
        if found is not None and found.value is not None and found.low is not None and found.high is not None:
            true = float(sum(truth[name][places.index(target)] for target in told.scene.fraction[name].targets))
            ends = found.value, found.low, found.high
            yield Counted(told.one.name, told.one.group, f"recovery.{name}", *ends, true)


def _purities(told: Predicted, truth: dict[str, Any]) -> Iterator[Counted]:
    """None of a bin that nothing truly reaches: what is in it has no purity."""
    mass = told.scene.mass_shares()
    for number, (place, found) in enumerate(told.separation.purity.items()):
        inside = {name: mass[name] * float(truth[name][number]) for name in mass}
        total = sum(inside.values())
        for name, pure in (found or {}).items() if total > LEAST else ():
            if pure.value is not None and pure.low is not None and pure.high is not None:
                ends, label = (pure.value, pure.low, pure.high), f"purity.{place}.{name}"
                yield Counted(told.one.name, told.one.group, label, *ends, inside[name] / total)


def of_kind(rows: Iterable[Counted], kind: str) -> list[Counted]:
    """The shares, recoveries or purities among ``rows``."""
    return [row for row in rows if row.quantity.startswith(f"{kind}.")]
