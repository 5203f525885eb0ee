"""Granules flown again with another step, airflow or grid, and what that changes of their shares.

Each comparison flies the granules of the first replicates again, with the same random numbers, so that the difference
shows the change and not another sample. A share's part of the error is that difference.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..pipeline.landings import Landings
from ..pipeline.pipeline import Pipeline
from ..planning.plan import COMPARED
from ..scene import RESERVED_BIN

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

Array = NDArray[np.float64]
Shares = dict[str, Array]  # a fraction's share in every bin and elsewhere, (replicates, bins + 1)
Key = TypeVar("Key", bound=Hashable)  # of an airflow: its wake, its grid


@dataclass(frozen=True)
class Comparison(Generic[Key]):
    """Shares by wake or by grid, the answer's own last, and the run time (s) of the others.

    ``noise``: halves of the 95 % intervals (2, bins + 1) that a finite number of granules, and one of sheddings, leave
    of what a fraction's shares differ from the answer's by, where that is known.
    """

    shares: dict[Key, Shares]
    seconds: float
    noise: dict[Key, dict[str, Array]] = field(default_factory=dict)

    def means(self, bins: list[str]) -> dict[str, dict[str, dict[str, float]]]:
        """Mean shares {fraction: {bin: {wake or grid: share}}}."""
        names = list(next(iter(self.shares.values())))
        return {
            name: {
                place: {str(which): float(found[name][:, i].mean()) for which, found in self.shares.items()}
                for i, place in enumerate([*bins, RESERVED_BIN])
            }
            for name in names
        }


def compared(landing: Landings) -> Landings:
    """The landings of the replicates that fly in comparisons."""
    kept = landing.replicate < COMPARED
    return replace(landing, **{name: values[kept] for name, values in vars(landing).items() if values is not None})


def shares_of(pipeline: Pipeline, tracked: Tracked) -> Shares:
    """The shares of the granules that fly in comparisons."""
    landings: Mapping[str, Landings] = tracked.landings
    return {name: compared(landings[name]).counts(len(pipeline.scene.bin)) for name in landings}


def differences(comparison: Comparison[Key], name: str, place: int) -> Iterator[tuple[Key, float]]:
    """How far each other wake's or grid's share of a fraction in bin number ``place`` lies from the answer's own."""
    *others, (_, own) = comparison.shares.items()
    here = own[name][:, place].mean()
    for which, shares in others:
        yield which, float(shares[name][:, place].mean() - here)
