"""By how much the numbers of later results differ from those of a first one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..core.number import Number
from .quantities import TableQuantity, is_part
from .result import VOID
from .table import Entry

__all__ = ["RUNG", "SWITCHED", "Difference", "differences_of"]

RUNG, SWITCHED = "rung", "force."  # keys of how runs were asked for, beside those of their scenes


@dataclass(frozen=True, kw_only=True)
class Difference(Number):
    """A quantity of one run less that of the first, with its 95 % interval where both have one.

    What is unknown of the scene is the same in two runs on one rung with the same terms and moves both alike: the
    interval of a share then holds what computing adds. Otherwise, and of purities, it holds all that is not known of
    both. Either is taken as independent (squares of the arms add up: Zou & Donner 2008, Stat. Med. 27, 1693), and parts
    of a whole differ by no more than one. Runs that feed the same granules agree better than that, so that it errs on
    the wide side. ``void``: one of the two answers is worth nothing.
    """

    scene: str
    against: str
    quantity: str
    unit: str
    void: bool = False

    @property
    def clear(self) -> bool:
        """Whether the interval leaves zero out, of answers that are worth something."""
        return not self.void and (self.low > 0.0 or self.high < 0.0)


def differences_of(entries: Sequence[Entry]) -> Iterator[Difference]:
    """Those of every later entry from the first, quantity by quantity."""
    first = entries[0]
    for entry in entries[1:]:
        alike, void = _computed_alike(first, entry), VOID in (first.reason, entry.reason)
        for one in entry.quantities:
            base = first.by_name.get(one.name)
            if base is None:
                continue
            low, high = _ends(base, one, alike)
            yield Difference(one.value - base.value, low, high, scene=entry.name, against=first.name,
                             quantity=one.name, unit=one.unit, void=void)  # fmt: skip


def _computed_alike(first: Entry, entry: Entry) -> bool:
    """Whether two runs leave out the same: their rung and the terms that were switched by hand."""
    keys = {key for one in (first, entry) for key in one.inputs if key == RUNG or key.startswith(SWITCHED)}
    return all(first.inputs.get(key) == entry.inputs.get(key) for key in keys)


def _ends(base: TableQuantity, one: TableQuantity, alike: bool) -> tuple[float, float]:
    if not (base.known and one.known):
        return -math.inf, math.inf
    value = one.value - base.value
    if alike and one.numerical is not None and base.numerical is not None:
        below = above = math.hypot(one.numerical, base.numerical)
    else:
        below = math.hypot(one.value - one.low, base.high - base.value)
        above = math.hypot(one.high - one.value, base.value - base.low)
    if is_part(one.name):
        return max(value - below, -1.0), min(value + above, 1.0)
    return value - below, value + above
