"""The source that is the airflow's mesh: all granules, and the airflow's numbers, on every grid."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from math import hypot, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...air.kinds.airflow_table import Airflow, GridEstimate, GridStudy
from ...core.errors import known
from ...flight.stages.landings import Landings, pooled
from ...flight.stages.pipeline import Pipeline
from ...flight.stages.track_stage import PerturbedRerun
from ...planning.cost import flown_again
from ...planning.plan import COMPARED, REPLICATES
from ...planning.stages import AirLabel, StageCost, Workload
from ...planning.unknowns import SIGMAS
from ..grid_convergence import estimate
from ..provenance import RefinedSettings
from ..shares import PERTURBED_RERUN, BudgetPart
from ..spread import Tally, cycles_of
from .flown_again import Array, Comparison
from .source import RATE, FractionResults, Parts, Source, add, averaged

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked

ON_ANOTHER_GRID = PerturbedRerun("tracks", replicates=REPLICATES)
MESH_ORDER = 2.0  # of the schemes


class Grid(NamedTuple):
    """A grid of the plan: its ``place`` among them, 0 the answer's, and its number of ``cells``."""

    place: int
    cells: int


class Mesh(Source[Comparison[Grid]]):
    """The cells of the airflow's mesh: the same granules in the airflow on other grids."""

    name, how, place = "mesh", PERTURBED_RERUN, 40
    if_unknown = "numerics.rung = 'reference'"
    if_large = "run rung reference (--rung reference)"

    def costs(self, work: Workload) -> Iterable[StageCost]:
        for scale in work.airflow.scales[1:]:
            yield flown_again(work, ON_ANOTHER_GRID.name, REPLICATES / COMPARED, AirLabel(grid=scale))

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Comparison[Grid] | None:
        """The shares in the airflow on every grid of the plan; None where the plan has one."""
        own, *others = pipeline.grids
        if not others:
            return None
        flown = {_grid(other): other.tracks(ON_ANOTHER_GRID) for other in others}
        seconds = sum(other.spent(stage) for other in others for stage in ("airflow", "tracks"))
        flown[_grid(own)] = tracked
        names, bins, images = list(tracked.landings), len(pipeline.scene.bin), pipeline.scene.images
        shares = {
            grid: {name: found.landings[name].counts(bins, images) for name in names} for grid, found in flown.items()
        }
        noise = {
            grid: {name: difference_noise(tracked.landings[name], found.landings[name], bins, images) for name in names}
            for grid, found in flown.items()
            if found is not tracked
        }
        return Comparison(shares, seconds, noise)

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        return [partial(other.tracks, ON_ANOTHER_GRID) for other in pipeline.grids[1:]]

    def shares(self, fraction: FractionResults) -> Parts:
        flown = fraction.flights.of(self)
        if flown is None:
            return self.unless_known(fraction)
        return {bin_: [self._part(flown, fraction.name, i)] for i, bin_ in enumerate(fraction.shares)}

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """The part falls as the square of a cell's edge but for what sampling and the wake's averages make of it."""
        error = part.size
        if now.mesh_scale is None or then.mesh_scale is None:
            return error
        granules, sheddings = part.of_granules or 0.0, part.of_sheddings or 0.0
        own = sqrt(max(0.0, error**2 - granules**2 - sheddings**2))
        less = min(1.0, error / (hypot(granules, sheddings) or error or 1.0))  # noise expected, not found
        return hypot(
            own * (then.mesh_scale / now.mesh_scale) ** MESH_ORDER,
            less * granules * (now.granules / then.granules) ** RATE,  # grids are compared by granules alone
            less * sheddings * averaged(now, then),
        )

    def _part(self, flown: Comparison[Grid], name: str, number: int) -> BudgetPart:
        found, (granules, sheddings) = mesh_error(flown, name, number)
        half = max(found.high - found.value, found.value - found.low)
        part = replace(self.part(half, flown.seconds, found.why), of_granules=float(granules))
        return replace(part, of_sheddings=float(sheddings)) if sheddings else part


def _grid(pipeline: Pipeline) -> Grid:
    return Grid(pipeline.air.grid, known(pipeline.airflow.cells))


def difference_noise(own: Landings, other: Landings, bins: int, images: Sequence[int] | None = None) -> Array:
    """Halves of the 95 % intervals (2, bins + 1) of what each share differs by between two flights of the same
    granules: of the granules, and of the sheddings.

    Of the granules, from how many changed into the bin and out of it (Bonett & Price 2012, J. Educ. Behav. Stat. 37,
    479, for proportions of paired samples; meant for independent granules, so it is wide for balanced ones). Of the
    shedding cycles, those of both flights: each wake in time is a finite sample of its own. A bin and its image, where
    there are ``images``, are reached by different granules: the variance of their mean is half of their mean one.
    """
    places = np.array([*range(bins), -1])[:, None]
    here, there, size = own.bin == places, other.bin == places, len(own.bin) + 2
    into, out_of = (np.sum(moved, axis=1) + 1.0 for moved in (there & ~here, here & ~there))
    variance = (into + out_of - (into - out_of) ** 2 / size) / size**2
    if images is not None:
        variance = np.where(np.arange(bins + 1) == images, 1.0, 0.5) * pooled(variance, images)
    sheddings = (shedding_noise(landing, bins, images) for landing in (own, other))
    reached = here.any(axis=1) | there.any(axis=1)  # what nobody reaches has a limit of its own: the sampling's
    return np.asarray(reached * np.stack([SIGMAS * np.sqrt(variance), np.hypot(*sheddings)]))


def shedding_noise(landing: Landings, bins: int, images: Sequence[int] | None = None) -> Array:
    """Half of the 95 % interval (bins + 1,) of each share that a finite number of shedding cycles leaves."""
    return np.array([tally.spread.airflow for tally in Tally.every(landing, bins, cycles_of([landing]), images)])


def mesh_error(comparison: Comparison[Grid], name: str, place: int) -> tuple[GridEstimate, Array]:
    """A share with its mesh error, and what of that error a finite number of granules makes, and one of shedding cycles
    (2,). The same granules fly on all grids: what is noise is the noise of differences from the answer's own share,
    whose sampling is another part of the budget.
    """
    values = [float(shares[name][:, place].mean()) for shares in comparison.shares.values()]
    halves = [comparison.noise.get(grid) for grid in comparison.shares]
    noise = np.array([[0.0, 0.0] if half is None else half[name][:, place] for half in halves])
    both = np.hypot(*noise.T)
    found = estimate([grid.cells**-0.5 for grid in comparison.shares], values, both.tolist())
    most = int(np.argmax(both))
    return found, found.noise * noise[most] / (both[most] or 1.0)


def airflow_on_grids(pipeline: Pipeline) -> tuple[GridStudy, ...] | None:
    """Cd, base pressure and reversal length with their mesh error, and what each grid gave; None with one grid.

    Of a best estimate they are those of its time-resolved end: theta's range is no noise of a grid.
    """
    if len(pipeline.plan.airflow.scales) < 2:
        return None
    found = [_computed(other.airflow) for other in pipeline.grids]
    cells = tuple(known(row.cells) for row in found)
    drag, base = [known(row.cd) for row in found], [known(row.cp_base) for row in found]
    lengths = [known(known(row.suction).reversal_length) for row in found]
    noise = [at * one.half / one.value for at, one in zip(lengths, drag, strict=True)]
    return (
        _study("cd", cells, [one.value for one in drag], [one.half for one in drag]),
        _study("cp_base", cells, [one.value for one in base], [one.half for one in base]),
        _study("reversal_length", cells, lengths, noise),
    )


def _computed(row: Airflow) -> Airflow:
    """The numbers as they were computed in time, where the airflow is a best estimate."""
    if row.ends is None:
        return row
    end = row.ends.time_resolved
    return replace(row, cd=end.cd, cp_base=end.cp_base, suction=end.suction)


def _study(quantity: str, cells: tuple[int, ...], values: list[float], halves: list[float]) -> GridStudy:
    found = estimate([count**-0.5 for count in cells], values, halves)
    return GridStudy(**vars(found), quantity=quantity, cells=cells, values=tuple(values))


add(Mesh())
