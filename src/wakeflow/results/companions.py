"""Granules flown again with another step, airflow or grid, and what that changes of their shares.

Each comparison flies the granules of the first replicates again, with the same random numbers, so that the difference
shows the change and not another sample. A share's part of the error is that difference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import known
from ..pipeline.airflow import Airflow, GridEstimate, GridStudy
from ..pipeline.landings import Landings
from ..pipeline.pipeline import Pipeline
from ..pipeline.track_stage import Companion
from ..planning.plan import COMPARED
from ..planning.unknowns import SIGMAS
from ..planning.wake import Wake
from ..scene import RESERVED_BIN
from .grid_convergence import estimate
from .spread import Tally, cycles_of

if TYPE_CHECKING:
    from ..pipeline.landings import Tracked

__all__ = [
    "FINER",
    "Comparison",
    "Grid",
    "Shares",
    "airflow_on_grids",
    "airflows",
    "compared",
    "difference_noise",
    "differences",
    "finer_steps",
    "grids",
    "mesh_error",
    "on_other_grids",
    "shares_of",
    "shedding_noise",
    "steady_wake",
]

Array = NDArray[np.float64]
Shares = dict[str, Array]  # a fraction's share in every bin and elsewhere, (replicates, bins + 1)
FINER = 0.01  # tolerance of the companion run over the scene's: a tenth may give the same steps, cut at the cells
IN_STEADY_WAKE, ON_ANOTHER_GRID = Companion(f"{Wake.STEADY} wake"), Companion("tracks")


class Grid(NamedTuple):
    """A grid of the plan: its ``place`` among them, 0 the answer's, and its number of ``cells``."""

    place: int
    cells: int


Key = TypeVar("Key", bound=Wake | Grid)


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


def difference_noise(own: Landings, other: Landings, bins: int) -> Array:
    """Halves of the 95 % intervals (2, bins + 1) of what each share differs by between two flights of the same
    granules: of the granules, and of the sheddings.

    Of the granules, from how many changed into the bin and out of it (Bonett & Price 2012, J. Educ. Behav. Stat. 37,
    479, for proportions of paired samples; meant for independent granules, so it is wide for balanced ones). Of the
    sheddings, those of both flights: each wake in time is a finite sample of its own.
    """
    places = np.array([*range(bins), -1])[:, None]
    here, there, size = own.bin == places, other.bin == places, len(own.bin) + 2
    into, out_of = (np.sum(moved, axis=1) + 1.0 for moved in (there & ~here, here & ~there))
    variance = (into + out_of - (into - out_of) ** 2 / size) / size**2
    sheddings = (shedding_noise(landing, bins) for landing in (own, other))
    reached = here.any(axis=1) | there.any(axis=1)  # what nobody reaches has a limit of its own: the sampling's
    return np.asarray(reached * np.stack([SIGMAS * np.sqrt(variance), np.hypot(*sheddings)]))


def shedding_noise(landing: Landings, bins: int) -> Array:
    """Half of the 95 % interval (bins + 1,) of each share that the airflow's finite number of sheddings leaves."""
    return np.array([tally.spread.airflow for tally in Tally.every(landing, bins, cycles_of([landing]))])


def finer_steps(pipeline: Pipeline) -> tuple[Tracked, float]:
    """The same granules at a hundredth of the tolerance, and the run time (s)."""
    finer = Companion("companion", tolerance=FINER * pipeline.scene.numerics.tolerance)
    return pipeline.tracks(finer), pipeline.spent(finer.name)


def airflows(pipeline: Pipeline, tracked: Tracked) -> Comparison[Wake] | None:
    """The shares in the other wakes of the plan: the two ends between which the truth lies, and what is between them.

    None where the computed airflow is the flow itself, or is the steady end.
    """
    beside = pipeline.plan.airflow.wakes_beside
    if not beside or pipeline.field[1].times is None:
        return None
    shares, seconds = {}, 0.0
    for wake, numbers in beside.items():
        where, change = pipeline, Companion(f"{wake} wake", wake=numbers)
        if wake is Wake.STEADY:  # on its own mesh, where a second core may have flown it already
            where, change = pipeline.draft, IN_STEADY_WAKE
        shares[wake] = shares_of(pipeline, where.tracks(change))
        seconds += where.spent(change.name)
    return Comparison({**shares, Wake.ANSWER: shares_of(pipeline, tracked)}, seconds)


def steady_wake(pipeline: Pipeline) -> list[Callable[[], object]]:
    """What flies the granules of :func:`airflows` through the steady wake; nothing where that is no companion."""
    if not pipeline.plan.airflow.brackets:
        return []
    return [lambda: pipeline.draft.tracks(IN_STEADY_WAKE)]


def on_other_grids(pipeline: Pipeline) -> list[Callable[[], object]]:
    """What flies the granules of :func:`grids` through the airflow on each grid but the answer's."""
    others = (pipeline.on_grid(i) for i in range(1, len(pipeline.plan.airflow.scales)))
    return [partial(other.tracks, ON_ANOTHER_GRID) for other in others]


def grids(pipeline: Pipeline, tracked: Tracked) -> Comparison[Grid] | None:
    """The same granules in the airflow on every grid of the plan; None where the plan has one."""
    own, *others = (pipeline.on_grid(i) for i in range(len(pipeline.plan.airflow.scales)))
    if not others:
        return None
    flown = {_grid(other): other.tracks(ON_ANOTHER_GRID) for other in others}
    seconds = sum(other.spent(stage) for other in others for stage in ("airflow", "tracks"))
    flown[_grid(own)] = tracked
    shares = {grid: shares_of(pipeline, found) for grid, found in flown.items()}
    first, bins = {name: compared(landing) for name, landing in tracked.landings.items()}, len(pipeline.scene.bin)
    noise = {
        grid: {name: difference_noise(first[name], compared(found.landings[name]), bins) for name in first}
        for grid, found in flown.items()
        if found is not tracked
    }
    return Comparison(shares, seconds, noise)


def _grid(pipeline: Pipeline) -> Grid:
    return Grid(pipeline.grid, known(pipeline.airflow.cells))


def mesh_error(comparison: Comparison[Grid], name: str, place: int) -> tuple[GridEstimate, Array]:
    """A share with its mesh error, from :func:`grids`, and what of that error a finite number of granules makes, and
    one of sheddings (2,). The same granules fly on all grids: what is noise is the noise of differences from the
    answer's own share, whose sampling is another part of the budget.
    """
    values = [float(shares[name][:, place].mean()) for shares in comparison.shares.values()]
    known = [comparison.noise.get(grid) for grid in comparison.shares]
    noise = np.array([[0.0, 0.0] if halves is None else halves[name][:, place] for halves in known])
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
    found = [_computed(pipeline.on_grid(i).airflow) for i in range(len(pipeline.plan.airflow.scales))]
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


def differences(comparison: Comparison[Key], name: str, place: int) -> Iterator[tuple[Key, float]]:
    """How far each other wake's or grid's share of a fraction in bin number ``place`` lies from the answer's own."""
    *others, (_, own) = comparison.shares.items()
    here = own[name][:, place].mean()
    for which, shares in others:
        yield which, float(shares[name][:, place].mean() - here)
