"""The source that is the airflow's mesh: all granules, and the airflow's numbers, on every grid.

What a few grids say: Richardson extrapolation and the grid convergence index (GCI), after Celik, Ghia, Roache & Freitas
2008 (J. Fluids Eng. 130, 078001), ASME V&V 20-2009 and Eca & Hoekstra 2014 (J. Comput. Phys. 262, 104). The index is
meant as a 95 % band round the finest grid's value. It holds for values that approach their limit from one side at a
plausible order; an observed order above the schemes' own is an accident of three grids and enters as the formal one.
Where values oscillate or move apart the band is three times their range to either side; where their statistical error
hides the differences of three grids only the range is reported. Two grids have one difference, which is taken for the
mesh's once the variance of its statistical error is off its square; what is left is expected to be the mesh's alone,
and the statistical error stays beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import hypot, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...air.kinds.airflow_table import Airflow, GridEstimate, GridStudy
from ...core.errors import SceneError
from ...core.geometry import halved
from ...flight.stages.landings import Landings, mirrored_mean
from ...flight.stages.pipeline import PerturbedRerun, Pipeline
from ...planning.plan import COMPARED, REPLICATES
from ...planning.stages import AirLabel, StageCost, Workload
from ...planning.unknowns import SIGMAS
from ..provenance import RefinedSettings
from ..shares import PERTURBED_RERUN, BudgetPart
from ..spread import Tally, cycles_of
from .flown_again import Array, Comparison
from .source import RATE, FractionResults, Parts, Source, add, averaged

if TYPE_CHECKING:
    from ...flight.stages.landings import Tracked


SAFETY = 1.25  # factor of the GCI from three grids (Roache)
SAFETY_TWO = 3.0  # from two grids, the order assumed
MIN_RATIO = 1.1  # of cell sizes: nearer grids differ by their irregularities (Celik et al. ask for 1.3)
MIN_ORDER, ABOVE_FORMAL = 0.5, 0.5  # orders from 0.5 to the formal one plus 0.5 are plausible
OF_RANGE = 3.0  # half bands over the range, where no order is seen (Eca & Hoekstra's procedure)
OF_RANGE_ABOVE = 1.25  # the same where values settle faster than the schemes can (likewise)
NOISE = 1 / 3  # largest statistical half width over a difference of three grids that still lets the order count
BY_CHANCE = (2.0 / (math.pi * math.e)) ** 0.25  # rms of what is left of a normal difference less its variance
TINY = 1e-14  # relative: values that agree so well are one value


def cell_size(area: float, cells: int) -> float:
    """Representative cell edge h = (area / cells)^(1/2) (m) of a two-dimensional mesh of ``area`` (m2)."""
    return math.sqrt(area / cells)


def observed_order(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Order p of the error from three grids, finest first: ``sizes`` (m, any unit) and their ``values``.

    Solves (f3 - f2)/(f2 - f1) = r21^p (r32^p - 1)/(r21^p - 1), r21 = h2/h1, r32 = h3/h2, for any two ratios: Celik's
    iteration has the same solution. Not a number where the values oscillate or do not approach each other (p <= 0).
    """
    (h1, h2, h3), (f1, f2, f3) = _finest_first(sizes, values, 3)
    near, far = f2 - f1, f3 - f2
    if near * far <= 0:
        return math.nan
    a, b, wanted = math.log(h2 / h1), math.log(h3 / h2), far / near

    def growth(p: float) -> float:  # rises with p from b/a at p = 0
        return float(math.exp(a * p) * math.expm1(b * p) / math.expm1(a * p))

    low, high = 1e-6, 1.0
    if growth(low) >= wanted:
        return math.nan
    while growth(high) < wanted:
        low, high = high, 2 * high
        if high > 64:
            return math.nan  # the two finer grids agree to round-off beside the third
    low, high = halved(lambda p: growth(p) < wanted, low, high, 100)
    return 0.5 * (low + high)


def extrapolate(sizes: Sequence[float], values: Sequence[float], order: float) -> float:
    """Richardson's value at cells of no size from the two finest grids: (r^p f1 - f2)/(r^p - 1), r = h2/h1."""
    fine, coarse = float(values[0]), float(values[1])
    return float(fine + (fine - coarse) / ((sizes[1] / sizes[0]) ** order - 1))


def estimate(
    sizes: Sequence[float], values: Sequence[float], half_widths: Sequence[float] = (), *, formal: float = 2.0
) -> GridEstimate:
    """The finest grid's value with its mesh error, from two grids or the three finest of more, in any sequence.

    ``sizes``: cell edges, in any unit (:func:`cell_size`); ``half_widths``: statistical 95 % half widths of the values,
    in their unit, or, of values from one sample, those of their differences from the finest's, with 0 for its own;
    ``formal``: the schemes' order. Raises SceneError for fewer than two grids, or cells whose sizes are nearer to each
    other than a factor of 1.1.
    """
    noise = [abs(float(h)) for h in half_widths] or [0.0] * len(values)
    if not len(sizes) == len(values) == len(noise):
        raise SceneError(f"a grid study needs as many cell sizes ({len(sizes)}) as values ({len(values)})")
    ranked = sorted(zip(sizes, values, noise, strict=True))[:3]
    if len(ranked) < 2:
        raise SceneError("a grid study needs at least two grids")
    h, f, e = ([float(row[i]) for row in ranked] for i in range(3))
    _finest_first(h, f, len(h))
    differences = [abs(b - a) for a, b in pairwise(f)]
    scale = max(abs(value) for value in f)
    if max(differences) <= TINY * scale and not any(e):
        kind = "two-grid" if len(f) == 2 else "richardson"
        return _round(f[0], 0.0, math.nan, kind, "all grids agree", extrapolated=f[0], gci_fine=0.0, gci_coarse=0.0)
    if len(f) == 2:
        return _two(h, f, e, formal)
    if max(e) >= NOISE * min(differences) and any(e):
        why = f"statistical half width {max(e):.2g} is not below a third of the grid difference {min(differences):.2g}"
        return _range(f, e, why)
    return _three(h, f, e, formal)


def _finest_first(sizes: Sequence[float], values: Sequence[float], count: int) -> tuple[list[float], list[float]]:
    h, f = [float(size) for size in sizes], [float(value) for value in values]
    if len(h) != count or len(f) != count:
        raise SceneError(f"{count} grids are needed, {len(h)} sizes and {len(f)} values are given")
    if not (all(map(math.isfinite, f)) and h[0] > 0 and all(b >= MIN_RATIO * a for a, b in pairwise(h))):
        listed = ", ".join(f"{size:.4g}" for size in h)
        raise SceneError(f"cell sizes {listed}: finest first, each at least {MIN_RATIO:g} times the one before it")
    return h, f


def _three(h: list[float], f: list[float], e: list[float], formal: float) -> GridEstimate:
    order = observed_order(h, f)
    near, far = f[1] - f[0], f[2] - f[1]
    if math.isnan(order):
        why = "the values oscillate" if near * far <= 0 else "the differences do not shrink as the grids get finer"
        return _multiple_of_range(f, e, OF_RANGE, why)
    highest = formal + ABOVE_FORMAL
    if not MIN_ORDER <= order <= highest:
        why = f"the observed order {order:.2f} is not between {MIN_ORDER:g} and {highest:g}"
        return _multiple_of_range(f, e, OF_RANGE if order < MIN_ORDER else OF_RANGE_ABOVE, why)
    counted = min(order, formal)
    grown = (h[1] / h[0]) ** counted
    fine = SAFETY * abs(near) / (grown - 1)
    coarse = SAFETY * abs(far) / ((h[2] / h[1]) ** counted - 1)
    half = math.hypot(fine, e[0])
    why = f"three grids converge at order {order:.2f}" + (f", counted as {formal:g}" if order > formal else "")
    return _round(
        f[0], half, order, "richardson", why, extrapolated=extrapolate(h, f, counted),
        gci_fine=fine, gci_coarse=coarse, asymptotic=coarse / (grown * fine), noise=e[0],
    )  # fmt: skip


def _two(h: list[float], f: list[float], e: list[float], formal: float) -> GridEstimate:
    factor, noise = SAFETY_TWO / ((h[1] / h[0]) ** formal - 1), math.hypot(*e)
    fine = factor * math.sqrt(max(0.0, (f[1] - f[0]) ** 2 - (noise / SIGMAS) ** 2))
    by_chance = math.hypot(factor * BY_CHANCE * noise / SIGMAS, noise)
    half = math.hypot(fine, noise)
    why = f"two grids, order {formal:g} assumed, three times the difference to the extrapolated value"
    if noise >= (difference := abs(f[1] - f[0])):  # as likely chance as the mesh: nothing to extrapolate
        why = f"statistical half width {noise:.2g} is not below the grid difference {difference:.2g}: {why}, with it"
        return _round(f[0], half, math.nan, "two-grid", why, gci_fine=fine, noise=by_chance)
    return _round(f[0], half, math.nan, "two-grid", why,
                        extrapolated=extrapolate(h, f, formal), gci_fine=fine, noise=by_chance)  # fmt: skip


def _multiple_of_range(f: list[float], e: list[float], times: float, why: str) -> GridEstimate:
    half = math.hypot(times * (max(f) - min(f)), e[0])
    why = f"{why}: {times:g} times the range of the grids"
    return _round(f[0], half, math.nan, "range-oscillating", why, noise=e[0])


def _range(f: list[float], e: list[float], why: str) -> GridEstimate:
    low = min(value - half for value, half in zip(f, e, strict=True))
    high = max(value + half for value, half in zip(f, e, strict=True))
    why = f"{why}: the range of the grids"
    return GridEstimate(f[0], low, high, order=math.nan, kind="range-statistics", why=why, noise=max(e))


def _round(value: float, half: float, order: float, kind: str, why: str, **more: float) -> GridEstimate:
    return GridEstimate(value, value - half, value + half, order=order, kind=kind, why=why, **more)


# -- The mesh as a source of error -------------------------------------------------------------------------------------
ON_ANOTHER_GRID = PerturbedRerun("tracks", REPLICATES / COMPARED, replicates=REPLICATES)
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
            yield from ON_ANOTHER_GRID.costs(work, AirLabel(grid=scale))

    def fly(self, pipeline: Pipeline, tracked: Tracked) -> Iterable[Comparison[Grid]]:
        """The shares in the airflow on every grid of the plan; nothing where the plan has one."""
        main, *others = pipeline.grids
        if not others:
            return ()
        flown = {_grid(other): other.run(ON_ANOTHER_GRID) for other in others}
        seconds = sum(other.spent(stage) for other in others for stage in ("airflow", "tracks"))
        flown[_grid(main)] = tracked
        names, bins, images = list(tracked.landings), len(pipeline.scene.bin), pipeline.scene.images
        shares = {
            grid: {name: tracks.landings[name].counts(bins, images) for name in names} for grid, tracks in flown.items()
        }
        noise = {
            grid: {
                name: difference_noise(tracked.landings[name], tracks.landings[name], bins, images or ())
                for name in names
            }
            for grid, tracks in flown.items()
            if tracks is not tracked
        }
        return [Comparison(shares, seconds, noise)]

    def ahead(self, pipeline: Pipeline) -> Sequence[Callable[[], object]]:
        return [partial(grid.run, ON_ANOTHER_GRID) for grid in pipeline.grids[1:]]

    def shares(self, fraction: FractionResults) -> Parts:
        for flown in fraction.flights.of(self):
            return {bin_: [self._part(flown, fraction.name, i)] for i, bin_ in enumerate(fraction.shares)}
        return self.unless_known(fraction)

    def expected(self, part: BudgetPart, now: RefinedSettings, then: RefinedSettings) -> float:
        """The part falls as the square of a cell's edge but for what sampling and the wake's averages make of it."""
        error = part.size
        if now.mesh_scale is None or then.mesh_scale is None:
            return error
        granules, sheddings = part.of_granules or 0.0, part.of_sheddings or 0.0
        of_mesh = sqrt(max(0.0, error**2 - granules**2 - sheddings**2))
        less = min(1.0, error / (hypot(granules, sheddings) or error or 1.0))  # noise expected, not found
        return hypot(
            of_mesh * (then.mesh_scale / now.mesh_scale) ** MESH_ORDER,
            less * granules * (now.granules / then.granules) ** RATE,  # grids are compared by granules alone
            less * sheddings * averaged(now, then),
        )

    def _part(self, flown: Comparison[Grid], name: str, number: int) -> BudgetPart:
        share, (granules, sheddings) = mesh_error(flown, name, number)
        half = max(share.high - share.value, share.value - share.low)
        part = replace(self.part(half, flown.seconds, share.why), of_granules=float(granules))
        return replace(part, of_sheddings=float(sheddings)) if sheddings else part


def _grid(pipeline: Pipeline) -> Grid:
    return Grid(pipeline.air.grid, pipeline.airflow.cells)


def difference_noise(first: Landings, second: Landings, bins: int, images: Sequence[int] = ()) -> Array:
    """Halves of the 95 % intervals (2, bins + 1) of what each share differs by between two flights of the same
    granules: of the granules, and of the sheddings.

    Of the granules, from how many changed into the bin and out of it (Bonett & Price 2012, J. Educ. Behav. Stat. 37,
    479, for proportions of paired samples; meant for independent granules, so it is wide for balanced ones). Of the
    shedding cycles, those of both flights: each wake in time is a finite sample of its own. A bin and its image, where
    there are ``images``, are reached by different granules: the variance of their mean is half of their mean one.
    """
    places = np.array([*range(bins), -1])[:, None]
    here, there, size = first.bin == places, second.bin == places, len(first.bin) + 2
    into, out_of = (np.sum(moved, axis=1) + 1.0 for moved in (there & ~here, here & ~there))
    variance = (into + out_of - (into - out_of) ** 2 / size) / size**2
    if images:
        variance = np.where(np.arange(bins + 1) == images, 1.0, 0.5) * mirrored_mean(variance, images)
    sheddings = (shedding_noise(landing, bins, images) for landing in (first, second))
    reached = here.any(axis=1) | there.any(axis=1)  # what nobody reaches has a limit of its own: the sampling's
    return np.asarray(reached * np.stack([SIGMAS * np.sqrt(variance), np.hypot(*sheddings)]))


def shedding_noise(landing: Landings, bins: int, images: Sequence[int] = ()) -> Array:
    """Half of the 95 % interval (bins + 1,) of each share that a finite number of shedding cycles leaves."""
    return np.array([tally.spread.airflow for tally in Tally.of_bins(landing, bins, cycles_of([landing]), images)])


def mesh_error(comparison: Comparison[Grid], name: str, place: int) -> tuple[GridEstimate, Array]:
    """A share with its mesh error, and what of that error a finite number of granules makes, and one of shedding cycles
    (2,). The same granules fly on all grids: what is noise is the noise of differences from the answer's own share,
    whose sampling is another part of the budget.
    """
    values = [float(shares[name][:, place].mean()) for shares in comparison.shares.values()]
    halves = [comparison.noise.get(grid) for grid in comparison.shares]
    noise = np.array([[0.0, 0.0] if half is None else half[name][:, place] for half in halves])
    both = np.hypot(*noise.T)
    share = estimate([grid.cells**-0.5 for grid in comparison.shares], values, both.tolist())
    most = int(np.argmax(both))
    return share, share.noise * noise[most] / (both[most] or 1.0)


def airflow_on_grids(pipeline: Pipeline) -> tuple[GridStudy, ...]:
    """Cd, base pressure and reversal length with their mesh error, and what each grid gave; none with one grid.

    Of a best estimate they are those of its time-resolved end: theta's range is no noise of a grid.
    """
    if len(pipeline.plan.airflow.scales) < 2:
        return ()
    airflows = [_computed(grid.airflow) for grid in pipeline.grids]
    cells = tuple(row.cells for row in airflows)
    drag, base = [row.cd for row in airflows], [row.cp_base for row in airflows]
    lengths = [row.suction.reversal_length for row in airflows]
    noise = [at * number.half / number.value for at, number in zip(lengths, drag, strict=True)]
    return (
        _study("cd", cells, [number.value for number in drag], [number.half for number in drag]),
        _study("cp_base", cells, [number.value for number in base], [number.half for number in base]),
        _study("reversal_length", cells, lengths, noise),
    )


def _computed(row: Airflow) -> Airflow:
    """The numbers as they were computed in time, where the airflow is a best estimate."""
    if not row.ends:
        return row
    end = row.ends.time_resolved
    return replace(row, cd=end.cd, cp_base=end.cp_base, suction=end.suction)


def _study(quantity: str, cells: tuple[int, ...], values: list[float], halves: list[float]) -> GridStudy:
    estimated = estimate([count**-0.5 for count in cells], values, halves)
    return GridStudy(**vars(estimated), quantity=quantity, cells=cells, values=tuple(values))


add(Mesh())
