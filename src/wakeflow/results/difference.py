"""By how much the numbers of later results differ from those of a first one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from .quantities import TableQuantity
from .table import Entry

__all__ = ["Difference", "differences_of"]


@dataclass(frozen=True)
class Difference:
    """A quantity of one run less that of the first: ``value`` and its 95 % interval, None where one of them has none.

    What is unknown of the scene is the same in both runs and moves both alike: the interval of a share holds what
    computing adds, and takes that as independent (squares of the arms add up: Zou & Donner 2008, Stat. Med. 27, 1693).
    Runs that feed the same granules agree better than that, so that it errs on the wide side.
    """

    scene: str
    against: str
    quantity: str
    unit: str
    value: float
    low: float | None
    high: float | None

    @property
    def clear(self) -> bool:
        """Whether the interval leaves zero out."""
        return self.low is not None and self.high is not None and (self.low > 0.0 or self.high < 0.0)


def differences_of(entries: Sequence[Entry]) -> Iterator[Difference]:
    """Those of every later entry from the first, quantity by quantity."""
    first = entries[0]
    for entry in entries[1:]:
        for one in entry.quantities:
            base = first.by_name.get(one.name)
            if base is None:
                continue
            yield Difference(entry.name, first.name, one.name, one.unit, one.value - base.value, *_ends(base, one))


def _ends(base: TableQuantity, one: TableQuantity) -> tuple[float | None, float | None]:
    if base.low is None or base.high is None or one.low is None or one.high is None:
        return None, None
    value = one.value - base.value
    if one.numerical is not None and base.numerical is not None:
        half = math.hypot(one.numerical, base.numerical)
        return value - half, value + half
    low = value - math.hypot(one.value - one.low, base.high - base.value)
    return low, value + math.hypot(one.high - one.value, base.value - base.low)
