"""Granules flown again with another step, airflow or grid, and what that changes of their shares.

Each comparison flies the granules of the first replicates again, with the same random numbers, so that the difference
shows the change and not another sample. A share's part of the error is that difference.

A number that is not known exactly shifts where granules land. What that changes of bins' shares goes as how many land
near their ends: alone a fraction may fly well past an end on which it lands among others, and the other way round. So
much is corrected in what the draws, which fly alone, say of the slab's shares. That the shift itself is the same is
what remains assumed; the study collision_draws prints both.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.lazy import cached_property
from ...flight.stages.landings import Landings
from ...flight.stages.pipeline import Pipeline
from ...planning.plan import COMPARED
from ...scene import RESERVED_BIN, Scene

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked


# -- Granules flown again with another step, airflow or grid -----------------------------------------------------------
Array = NDArray[np.float64]
Shares = dict[str, Array]  # a fraction's share in every bin and elsewhere, (replicates, bins + 1)
Key = TypeVar("Key", bound=Hashable)  # of an airflow: its wake, its grid


@dataclass(frozen=True)
class Comparison(Generic[Key]):
    """Shares by wake or by grid, the answer's own last, and the run time (s) of the others.

    ``noise``: halves of the 95 % intervals (2, bins + 1) that a finite number of granules, and one of shedding cycles,
    leave of what a fraction's shares differ from the answer's by, where that is known.
    """

    shares: dict[Key, Shares]
    seconds: float
    noise: dict[Key, dict[str, Array]] = field(default_factory=dict)

    def means(self, bins: list[str]) -> dict[str, dict[str, dict[str, float]]]:
        """Mean shares {fraction: {bin: {wake or grid: share}}}."""
        names = list(next(iter(self.shares.values())))
        return {
            name: {
                place: {str(which): float(shares[name][:, i].mean()) for which, shares in self.shares.items()}
                for i, place in enumerate([*bins, RESERVED_BIN])
            }
            for name in names
        }


def compared(landing: Landings) -> Landings:
    """The landings of the replicates that fly in comparisons."""
    kept = landing.replicate < COMPARED
    arrays = {name: values[kept] for name, values in vars(landing).items() if values is not None and name != "table"}
    return replace(landing, **arrays, table=None if landing.table is None else landing.table[:COMPARED])


def shares_of(pipeline: Pipeline, tracked: Tracked) -> Shares:
    """The shares of the granules that fly in comparisons."""
    landings: Mapping[str, Landings] = tracked.landings
    bins, images = len(pipeline.scene.bin), pipeline.scene.images
    return {name: compared(landings[name]).counts(bins, images) for name in landings}


def differences(comparison: Comparison[Key], name: str, place: int) -> Iterator[tuple[Key, float]]:
    """How far each other wake's or grid's share of a fraction in bin number ``place`` lies from the answer's own."""
    *others, (_, reference) = comparison.shares.items()
    here = reference[name][:, place].mean()
    for which, shares in others:
        yield which, float(shares[name][:, place].mean() - here)


# -- The ends of bins over which granules can pass ---------------------------------------------------------------------
BinEnds = dict[str, list[tuple[float, float]]]  # m: the ends of every bin
DIGITS = 9  # of a place in m: ends that agree in them are one end
END_REACH = 0.3  # body widths to either side of an end: about as far as what is unknown shifts landings
ADDED_GRANULES = 8.0  # granules: as many are added to both counts, so that a few near an end alone make no large factor
MAX_FACTOR = 3.0  # largest factor, and one over the least


def free_ends(scene: Scene) -> BinEnds:
    """The ends (m) of every bin over which granules can pass, and for ``elsewhere`` the ends that no two bins share."""
    ends: BinEnds = {
        name: [(round(x, DIGITS), round(y, DIGITS)) for x, y in bin_.passed(scene)] for name, bin_ in scene.bin.items()
    }
    every = list(points_of(ends, repeated=True))
    ends[RESERVED_BIN] = [point for point in dict.fromkeys(every) if every.count(point) == 1]
    return ends


def points_of(ends: BinEnds, *, repeated: bool = False) -> Iterator[tuple[float, float]]:
    """All ends, those that bins share once, or ``repeated`` as often as they are shared."""
    points = [point for of_bin in ends.values() for point in of_bin]
    yield from points if repeated else dict.fromkeys(points)


@dataclass(frozen=True)
class AmongOthers:
    """The landings by fraction, each granule ``alone`` and of those that ``met`` others."""

    scene: Scene
    alone: Mapping[str, Landings]
    met: Mapping[str, Landings]

    @cached_property
    def _ends(self) -> list[tuple[float, float]]:
        return list(points_of(free_ends(self.scene)))

    def factor(self, name: str) -> float:
        """Factor on what a shift alone moves of the shares of fraction ``name``: one for all bins, since at an end near
        which hardly any land a shift is no longer small. 1 where no bin has an end that granules pass.
        """
        if not self._ends:
            return 1.0
        few = ADDED_GRANULES / self.alone[name].size
        alone, met = (self._near(landings[name]) + few for landings in (self.alone, self.met))
        return float(np.clip(met / alone, 1.0 / MAX_FACTOR, MAX_FACTOR))

    def _near(self, landing: Landings) -> float:
        """The share of a fraction's mass that lands near any end."""
        away = np.min([np.linalg.norm(landing.position - point, axis=1) for point in self._ends], axis=0)
        return float(landing.mass_shares @ (away <= END_REACH * self.scene.width))
