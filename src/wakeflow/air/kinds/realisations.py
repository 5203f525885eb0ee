"""Realisations of an airflow: fields that are as likely as each other, in which the replicates fly in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SceneError

if TYPE_CHECKING:
    from ..field import FlowField


@dataclass(frozen=True)
class Realisations:
    """The fields of one airflow. Replicate r flies in number r mod n of the n there are.

    ``field``: the first, which pictures show too; None in a vacuum. ``others`` make the further ones when they are
    flown in, since fields may be large: a late state of a steady airflow that does not settle, a layer of a record in
    three dimensions. All have one period, or none has. ``cycles``: of the shedding in that period, or parts of a record
    that are as good as independent; 1 where nothing changes. Each of them is one draw of the real airflow: their number
    is what the intervals rest on beside that of the granules.
    """

    field: FlowField | None
    others: tuple[Callable[[], FlowField], ...] = ()
    cycles: int = 1

    def __len__(self) -> int:
        return 1 + len(self.others)

    @property
    def period(self) -> float:
        """Over which granules are released (s); 0 in a steady airflow and in a vacuum."""
        return 0.0 if self.field is None else self.field.period

    def make(self, number: int) -> FlowField | None:
        """One of the fields. Raises SceneError where its period is not the first one's."""
        if number == 0:
            return self.field
        made = self.others[number - 1]()
        if made.period != self.period:
            raise SceneError(f"realisation {number}: its period is {made.period} s, the first one's {self.period} s")
        return made

    def mapped(self, change: Callable[[FlowField], FlowField]) -> Realisations:
        """The same realisations with ``change`` applied to each field."""
        if self.field is None:
            return self
        others = tuple(partial(_changed, change, other) for other in self.others)
        return replace(self, field=change(self.field), others=others)

    def cycle_of(self, time: NDArray[np.float64]) -> NDArray[np.uint16]:
        """The cycle, from 0, within which granules are released at ``time`` (n,) s."""
        if not self.period:
            return np.zeros(len(time), dtype=np.uint16)
        return np.minimum(np.floor(time / self.period % 1.0 * self.cycles), self.cycles - 1).astype(np.uint16)


def _changed(change: Callable[[FlowField], FlowField], make: Callable[[], FlowField]) -> FlowField:
    return change(make())
